//! The host side of the link against arbitrary answers: it ends every operation and writes only
//! within its buffers.

use camrig_rig_link::host::{FrameIo, Host, Limits, Poll};
use camrig_rig_link::message::*;
use camrig_rig_link::wire::{CHECK_BYTES, HEADER_BYTES, Header, Kind, seal};

const ROWS: usize = 8;
const RAW: usize = 20;

struct Io([[u8; RAW]; ROWS]);

impl FrameIo for Io {
    fn spectral(&mut self, row: u16, first: u16, out: &mut [u8]) {
        assert!(usize::from(row) < ROWS && usize::from(first) * 33 + out.len() <= 4 * 33);
        out.fill(1);
    }

    fn raw_row(&mut self, row: u16) -> &mut [u8] {
        &mut self.0[usize::from(row)]
    }

    fn camera(&mut self, offset: u32, out: &mut [u8]) {
        assert!(offset as usize + out.len() <= 100);
        out.fill(2);
    }
}

const KINDS: [Kind; 5] = [Kind::Hello, Kind::Control, Kind::Raw, Kind::Ack, Kind::Part];

fn begin() -> FrameBegin {
    FrameBegin {
        transfer: 0,
        frame: 0,
        rows: ROWS as u16,
        width: 10,
        bands: 4,
        codec: Codec::Bfp16,
        arithmetic: NumberFormat::F32,
        raw_bits: 16,
        temperature_c: 25.0,
        before: Before::Dark,
        exposure: None,
    }
}

const SHAPE: FrameShape =
    FrameShape { rows: ROWS as u16, units: 4, unit_bytes: 33, raw_bytes: RAW as u16, halo: 1 };

/// Four operations, answered with packets of [kind, length, body...].
pub fn converse(data: &[u8]) {
    let mut limits = Limits::default();
    limits.timeout = 10;
    limits.idle_steps = 5;
    let mut host = Host::new(limits, [0; ROWS]);
    let mut io = Io([[0; RAW]; ROWS]);
    let (mut now, mut seq, mut rest) = (1, 0u16, data);
    let mut out = [0; 4400];
    for operation in 0..4 {
        match operation {
            0 => host.connect(1),
            1 => host.send_camera(7, 100),
            2 => host.begin(begin(), SHAPE, false),
            _ => host.request(ToDevice::Statistics),
        }
        let mut done = false;
        // Every operation ends by itself, because the answers are finite and time-outs follow.
        for _ in 0..200_000 {
            match host.poll(now, &mut io, &mut out) {
                Poll::Done(_) => {
                    done = true;
                    break;
                }
                Poll::Send(_) => {}
                Poll::Wait(until) => now = until.max(now + 1),
            }
            let [kind, length, left @ ..] = rest else { continue };
            let (body, left) = left.split_at((*length as usize).min(left.len()));
            rest = left;
            seq = seq.wrapping_add(1);
            let mut packet = [0; HEADER_BYTES + 255 + CHECK_BYTES];
            packet[HEADER_BYTES..][..body.len()].copy_from_slice(body);
            let kind = KINDS[*kind as usize % KINDS.len()];
            let header = Header { kind, flags: *length & 3, session: 1, seq, ack: seq };
            let n = seal(&mut packet, header, body.len());
            if host.receive(now, &packet[..n], &mut io).is_some() {
                done = true;
                break;
            }
        }
        assert!(done, "operation {operation} does not end");
    }
}
