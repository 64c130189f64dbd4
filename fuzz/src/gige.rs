//! The GigE Vision camera against arbitrary datagrams of two applications, one of which is in
//! control, and the reader of its stream against arbitrary bytes.

use camrig_gige::gvcp::{self, code};
use camrig_gige::{Device, Next, Pattern, Sensor, Taken, Timing, gvsp};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

/// Most packets that are fetched after a datagram.
const PACKETS: usize = 200;

/// A conversation in chunks of [kind, length, body...]: from kind 0x80 on, the body is a datagram;
/// below, the payload of a command with that number.
pub fn converse(data: &[u8]) {
    let sensor = Sensor {
        model: "fuzz".into(),
        serial: "1".into(),
        width: 64,
        height: 48,
        pattern: Pattern::BayerGr,
        bits: 12,
        line_ns: 10_000,
        min_frame_lines: 48,
        timing: Timing { exposure_lines: 10, frame_lines: 100, gain_code: 256 },
    };
    let mut device = Device::new(sensor, Ipv4Addr::LOCALHOST, 1);
    let hosts = [5000, 5001].map(|port| SocketAddrV4::new(Ipv4Addr::LOCALHOST, port));
    for (address, value) in [(0x0A00u32, 2u32), (0x0D00, 6000), (0xF040, 1)] {
        let payload = [address, value].map(u32::to_be_bytes);
        let request = gvcp::request(code::WRITE_REGISTERS, 1, false, payload.as_flattened());
        device.receive(Duration::ZERO, hosts[0], &request);
    }
    let (mut rest, mut now, mut packet) = (data, Duration::ZERO, Vec::new());
    while let [kind, length, left @ ..] = rest {
        let (body, left) = left.split_at((*length as usize).min(left.len()));
        rest = left;
        now += Duration::from_micros(u64::from(*length) * 100);
        let host = hosts[usize::from(kind & 1)];
        let command = gvcp::request((kind & 0x7e).into(), 1, kind & 1 == 1, body);
        device.receive(now, host, if *kind < 0x80 { &command } else { body });
        if let Some(order) = device.order(now) {
            device.deliver(match kind & 0x30 {
                0x30 => Taken::Dropped(0),
                _ => Taken::Image(vec![0; order.image_bytes], 0),
            });
        }
        for _ in 0..PACKETS {
            match device.next(now, &mut packet) {
                Next::Packet { .. } => {}
                Next::Wait(Some(until)) if until > now => now = until,
                Next::Wait(_) => break,
            }
        }
    }
    gvsp::parse(data);
    gvcp::parse_acknowledgement(data);
}
