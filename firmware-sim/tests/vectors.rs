//! The exchange of `docs/protocol.md` with the rig itself: its answers are those of the vectors,
//! computed by the sensor model, and its raw rows leave by an interface of the board's own where
//! there is one.

use camrig_firmware_sim::{Memory, Rig, RowMemory};
use camrig_rig_link::device::{Device, RowSink};
use camrig_rig_link::message::{FrameStart, RECEIPT_BYTES};
use camrig_rig_link::wire::{HEADER_BYTES, Kind, Packet, RawHeader, crc32c, seal};
use camrig_sensor_core::arith::BLOCK;
use serde_json::Value;

const WIDTH: usize = 64;

fn vectors() -> Value {
    serde_json::from_str(include_str!("../../tests/protocol/vectors.json")).unwrap()
}

fn bytes(value: &Value) -> Vec<u8> {
    let digits = value.as_str().unwrap();
    (0..digits.len())
        .step_by(2)
        .map(|i| u8::from_str_radix(&digits[i..i + 2], 16).unwrap())
        .collect()
}

/// Runs a test with a rig for rows of 64 pixels, whose rows may leave by `sink`.
fn with_rig(sink: Option<&mut Interface>, test: impl FnOnce(&mut Rig<'_>)) {
    let mut float = ([[0.0; BLOCK]; 40], [[0.0; 16]; 4]);
    let mut fixed = ([[Default::default(); BLOCK]; 40], [[Default::default(); 16]; 4]);
    let (mut mantissas, mut exponents, mut crosstalk) = ([0; WIDTH], [0; 4], [0.0; 16]);
    let mut rig = Rig::new(
        "test",
        Memory::new(&mut mantissas, &mut exponents, &mut crosstalk, 8)
            .with_float(RowMemory { rows: &mut float.0, sums: &mut float.1 })
            .with_fixed(RowMemory { rows: &mut fixed.0, sums: &mut fixed.1 }),
    );
    if let Some(sink) = sink {
        rig.set_sink(sink);
    }
    test(&mut rig);
}

#[test]
fn the_rig_answers_the_exchange_to_the_byte() {
    with_rig(None, |rig| {
        let mut device = Device::<128>::new(600, 32);
        let mut out = [0; 600];
        for entry in vectors()["exchange"].as_array().unwrap() {
            let packet = bytes(&entry["packet"]);
            if entry["from"] == "host" {
                device.receive(&packet, rig);
                continue;
            }
            let n = device.transmit(&mut out, rig).expect("an answer");
            if entry["kind"] == "Hello" {
                continue; // It speaks of itself.
            }
            assert_eq!(out[..n], packet, "{}", entry["says"]);
        }
    });
}

/// A camera interface of 10 bits.
#[derive(Default)]
struct Interface(Vec<(u16, Vec<u8>)>);

impl RowSink for Interface {
    fn raw_bits(&self) -> u8 {
        10
    }

    fn begin(&mut self, start: &FrameStart, row_bytes: u16) {
        assert_eq!((start.shape.raw_bytes, row_bytes), (RECEIPT_BYTES as u16, 40));
        self.0.clear();
    }

    fn row(&mut self, row: u16, packed: &[u8]) {
        self.0.push((row, packed.to_vec()));
    }
}

/// The same exchange, its frame announced with raw rows of 0 bits.
#[test]
fn rows_leave_by_the_boards_interface_and_the_link_has_receipts() {
    /// Place of `raw_bits` in the announcement of the vectors.
    const RAW_BITS: usize = HEADER_BYTES + 8;
    let (mut interface, vectors) = (Interface::default(), vectors());
    let raw: Vec<Vec<u8>> = (vectors["exchange"].as_array().unwrap().iter())
        .filter(|entry| entry["kind"] == "Raw")
        .map(|entry| bytes(&entry["body"]["bytes"]))
        .collect();
    let mut receipts = Vec::new();
    with_rig(Some(&mut interface), |rig| {
        let mut device = Device::<128>::new(600, 32);
        let mut out = [0; 600];
        for entry in vectors["exchange"].as_array().unwrap() {
            if entry["from"] != "host" {
                continue;
            }
            let mut packet = bytes(&entry["packet"]);
            if entry["body"][0] == "FrameBegin" {
                assert_eq!(packet[RAW_BITS], 10);
                packet[RAW_BITS] = 0;
                let header = Packet::parse(&bytes(&entry["packet"])).unwrap().header;
                let body_bytes = packet.len() - HEADER_BYTES - 4;
                seal(&mut packet, header, body_bytes);
            }
            device.receive(&packet, rig);
            while let Some(n) = device.transmit(&mut out, rig) {
                let answer = Packet::parse(&out[..n]).unwrap();
                if answer.header.kind == Kind::Raw {
                    receipts.push(RawHeader::split(answer.body).unwrap().1.to_vec());
                }
            }
        }
    });
    let rows: Vec<_> = (0..2).zip(raw.clone()).collect();
    assert_eq!(interface.0, rows);
    assert_eq!(receipts, raw.iter().map(|row| crc32c(row).to_le_bytes()).collect::<Vec<_>>());
}
