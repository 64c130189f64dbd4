//! The device side of the link against arbitrary bytes: as bytes of the link, and as bodies of
//! packets with a correct CRC.

use camrig_firmware_sim::{CaptureMemory, Memory, Rig, RowMemory};
use camrig_rig_link::device::Device;
use camrig_rig_link::framing::{Framing, Receiver};
use camrig_rig_link::wire::{CHECK_BYTES, HEADER_BYTES, seal};
use camrig_rig_link::wire::{Header, Kind};
use camrig_sensor_core::arith::BLOCK;

const WIDTH: usize = 64;

/// A whole conversation in chunks of [kind, length, body...]; the kind byte 0xff sends the body
/// without framing.
pub fn converse(data: &[u8]) {
    let mut rows = vec![[0.0f32; BLOCK]; 13 * 2];
    let mut sums = vec![[0.0f32; 16]; 4];
    let mut fixed_rows = vec![[Default::default(); BLOCK]; 13 * 2];
    let mut fixed_sums = vec![[Default::default(); 16]; 4];
    let (mut mantissas, mut exponents, mut table) = ([0; WIDTH], [0; 4], [0.0; 64]);
    let mut captures = [const { CaptureMemory::EMPTY }; 3];
    let mut rig = Rig::new(
        "fuzz",
        Memory::new(&mut mantissas, &mut exponents, &mut table, 8)
            .with_float(RowMemory { rows: &mut rows, sums: &mut sums })
            .with_fixed(RowMemory { rows: &mut fixed_rows, sums: &mut fixed_sums })
            .with_captures(&mut captures),
    );
    let mut device = Device::<128>::new(600, 32);
    let mut receivers =
        [Framing::Cobs, Framing::Length, Framing::Report(64)].map(|f| Receiver::new(f, [0; 700]));
    let mut out = [0; 600];
    let mut rest = data;
    let mut seq = 0u16;
    while let [kind, length, left @ ..] = rest {
        let (body, left) = left.split_at((*length as usize).min(left.len()));
        rest = left;
        seq = seq.wrapping_add(1);
        if *kind == 0xff {
            for receiver in &mut receivers {
                let mut input = body;
                while receiver.push(&mut input) == Ok(true) {
                    device.receive(receiver.packet(), &mut rig);
                }
            }
        } else {
            let mut packet = [0; HEADER_BYTES + 255 + CHECK_BYTES];
            packet[HEADER_BYTES..][..body.len()].copy_from_slice(body);
            let kind = Kind::ALL[*kind as usize % Kind::ALL.len()];
            let header = Header { kind, flags: seq as u8 & 1, session: 1, seq, ack: seq };
            let n = seal(&mut packet, header, body.len());
            device.receive(&packet[..n], &mut rig);
        }
        for _ in 0..1000 {
            if device.transmit(&mut out, &mut rig).is_none() {
                break;
            }
        }
    }
}
