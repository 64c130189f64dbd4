//! The USB camera, and the I2C adapter beside it, against arbitrary requests of an attached host.

use camrig_gige::{Pace, Pattern, Sensor, Taken, Timing};
use camrig_profiles::Profile;
use camrig_usbip::protocol::{HEADER_BYTES, Operation, Request};
use camrig_usbip::{Adapter, Device};
use std::sync::Mutex;
use std::time::Duration;

/// Requests one after another: the least significant bytes of the code, the number, the direction,
/// the endpoint and the length, eight of set-up, and the data.
pub fn attach(data: &[u8]) {
    let sensor = Sensor {
        model: "fuzz".into(),
        serial: "1".into(),
        width: 64,
        height: 48,
        pattern: Pattern::BayerRg,
        bits: 10,
        line_ns: 10_000,
        min_frame_lines: 48,
        timing: Timing { exposure_lines: 10, frame_lines: 100, gain_code: 256 },
    };
    let mut device = Device::new(sensor);
    let Ok(profile) = Profile::builtin("ov7670") else { return };
    let bus = Mutex::new(camrig_profiles::Sensor::new(profile));
    let mut adapter = Adapter::new(&bus, "1");
    let (mut rest, mut now) = (data, Duration::ZERO);
    while let [code, seq, direction, endpoint, length, setup @ ..] = rest {
        let Some((setup, left)) = setup.split_at_checked(8) else { break };
        let mut header = [0; HEADER_BYTES];
        header[3] = *code;
        (header[7], header[15], header[19], header[27]) = (*seq, *direction, *endpoint, *length);
        header[23] = *endpoint;
        header[40..].copy_from_slice(setup);
        let Some(request) = Request::parse(&header) else { break };
        let (body, left) = left.split_at(request.body_bytes().min(left.len()));
        rest = left;
        now += Duration::from_millis(1);
        device.receive(now, &request, body);
        adapter.receive(&request, body);
        let pace = match seq & 0x18 {
            0x18 => Pace::Standby,
            0x10 => Pace::Every(Duration::MAX),
            _ => Pace::AsOrdered,
        };
        if let Some(order) = device.order(now, pace) {
            device.deliver(match seq & 7 {
                7 => Taken::Dropped(0),
                6 => Taken::End,
                _ => Taken::Image(vec![0; order.image_bytes], 0),
            });
        }
        if *seq == 0xff {
            device.detach();
        }
    }
    if let Some(header) = data.first_chunk() {
        Request::parse(header);
    }
    if let Some(header) = data.first_chunk() {
        Operation::parse(*header);
    }
}
