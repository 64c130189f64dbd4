//! The bytes on the link, written out: both ends of this crate would agree on any layout, a rig in
//! another language only on this one. Where one of these changes, `VERSIONS` changes with it.

use camrig_rig_link::message::*;
use camrig_rig_link::wire::*;

/// CRC-32C bit by bit (polynomial 0x1edc6f41, reflected).
fn crc_by_bits(bytes: &[u8]) -> u32 {
    let step = |crc: u32| if crc & 1 == 1 { crc >> 1 ^ 0x82f6_3b78 } else { crc >> 1 };
    !bytes.iter().fold(!0, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), |crc, _| step(crc)))
}

fn postcard(message: &impl serde::Serialize) -> Vec<u8> {
    let mut buffer = [0; CONTROL_BYTES];
    postcard::to_slice(message, &mut buffer).unwrap().to_vec()
}

#[test]
fn a_packet_is_a_header_of_little_endian_numbers_body_and_crc() {
    let header = Header { kind: Kind::Raw, flags: 2, session: 0x1234, seq: 0x0102, ack: 0xfffe };
    let mut packet = [0; 32];
    packet[HEADER_BYTES..][..3].copy_from_slice(&[7, 8, 9]);
    let n = seal(&mut packet, header, 3);
    let front = [5, 2, 0x34, 0x12, 0x02, 0x01, 0xfe, 0xff, 7, 8, 9];
    assert_eq!(packet[..n - 4], front);
    assert_eq!(packet[n - 4..n], crc_by_bits(&front).to_le_bytes());
    assert_eq!(Packet::parse(&packet[..n]).unwrap().header, header);
    let kinds =
        [Kind::Hello, Kind::Control, Kind::Camera, Kind::Part, Kind::Raw, Kind::Ack, Kind::Ping];
    assert!((1..).zip(kinds).all(|(number, kind)| kind as u8 == number));
}

#[test]
fn fixed_fields_follow_one_another() {
    let mut bytes = [0; 16];
    CameraHeader { id: 0x0102_0304_0506_0708, total: 0x0a0b_0c0d, offset: 0x10 }.write(&mut bytes);
    assert_eq!(bytes, [8, 7, 6, 5, 4, 3, 2, 1, 0x0d, 0x0c, 0x0b, 0x0a, 0x10, 0, 0, 0]);
    let mut bytes = [0; 6];
    PartHeader { transfer: 0x0102, row: 0x0304, unit: 0x0506 }.write(&mut bytes);
    assert_eq!(bytes, [2, 1, 4, 3, 6, 5]);
    AckBody { transfer: 0x1112, row: 0x1314, unit: 0x1516 }.write(&mut bytes);
    assert_eq!(bytes, [0x12, 0x11, 0x14, 0x13, 0x16, 0x15]);
    let mut bytes = [0; 10];
    RawHeader { transfer: 0x0102, row: 0x0304, offset: 0x0506, row_crc: 0x0a0b_0c0d }
        .write(&mut bytes);
    assert_eq!(bytes, [2, 1, 4, 3, 6, 5, 0x0d, 0x0c, 0x0b, 0x0a]);
}

#[test]
fn the_first_message_and_its_answer() {
    let hello = Hello { magic: MAGIC, oldest: 1, newest: 1, packet_bytes: 4400, credit: 64 };
    // 4400 = 0x22 x 128 + 0x30.
    assert_eq!(postcard(&hello), *b"camrig\x01\x01\xb0\x22\x40");
    let device = Capabilities {
        firmware: "ab".try_into().unwrap(),
        packet_bytes: 600,
        credit: 32,
        max_width: 200,
        max_bands: 8,
        max_camera: 1000,
        arithmetics: 3,
        codecs: 1,
        memory_bytes: 128,
        effects: [0, 7].into_iter().collect(),
        camera: 5,
    };
    let reply = HelloReply { version: 1, oldest: 1, newest: 2, device: Some(device) };
    let mut bytes = vec![1, 1, 2, 1, 2, b'a', b'b', 0xd8, 0x04, 32, 0xc8, 0x01, 8];
    bytes.extend([0xe8, 0x07, 3, 1, 0x80, 0x01, 0x81, 0x01, 5]);
    assert_eq!(postcard(&reply), bytes);
}

#[test]
fn the_announcement_of_a_frame_and_its_answer() {
    let begin = FrameBegin {
        transfer: 300,
        frame: 5,
        rows: 2,
        width: 80,
        bands: 31,
        codec: Codec::Electrons16,
        arithmetic: NumberFormat::F32,
        raw_bits: 12,
        temperature_c: 25.0,
        before: Before::Lit,
        exposure: Some(Exposure { exposure_s: 0.5, analog_gain: 2.0 }),
    };
    let mut bytes = vec![0, 0xac, 0x02, 5, 2, 80, 31, 1, 0, 12, 0, 0, 0xc8, 0x41, 1, 1];
    bytes.extend([0, 0, 0, 0x3f, 0, 0, 0, 0x40]);
    assert_eq!(postcard(&ToDevice::FrameBegin(begin)), bytes);
    // Dark and lit are the bytes of a bool; another exposure follows its number.
    let at = bytes.len() - 10;
    let with = |before, of: &[u8]| {
        let other = [&bytes[..at], of, &bytes[at + 1..]].concat();
        assert_eq!(postcard(&ToDevice::FrameBegin(FrameBegin { before, ..begin })), other);
    };
    with(Before::Dark, &[0]);
    with(Before::LitFor { exposure_s: 0.5 }, &[2, 0, 0, 0, 0x3f]);
    let shape = FrameShape { rows: 2, units: 155, unit_bytes: 33, raw_bytes: 120, halo: 1 };
    let start = FrameStart {
        transfer: 300,
        shape,
        exposure: Exposure { exposure_s: 0.5, analog_gain: 2.0 },
        counter: 7,
        frame: 5,
        seed: 9,
        test_pattern: 4,
        fault: Fault::CorruptRow(11),
    };
    let mut bytes = vec![0, 0xac, 0x02, 2, 0x9b, 0x01, 33, 120, 1];
    bytes.extend([0, 0, 0, 0x3f, 0, 0, 0, 0x40, 7, 5, 9, 4, 2, 11]);
    assert_eq!(postcard(&ToHost::FrameStart(start)), bytes);
}

#[test]
fn variants_have_their_numbers() {
    let sent = [
        (ToDevice::Abort, vec![1]),
        (ToDevice::RegRead(0x0202), vec![2, 0x82, 0x04]),
        (ToDevice::RegWrite(0x0202, 500), vec![3, 0x82, 0x04, 0xf4, 0x03]),
        (ToDevice::Statistics, vec![4]),
        (ToDevice::ByteRead(0x0203), vec![5, 0x83, 0x04]),
        (ToDevice::ByteWrite(0x0203, 0xf4), vec![6, 0x83, 0x04, 0xf4]),
    ];
    for (message, bytes) in sent {
        assert_eq!(postcard(&message), bytes, "{message:?}");
    }
    let statistics = Statistics {
        packets: 1,
        damaged: 2,
        stale: 3,
        gaps: 4,
        rows_in: 5,
        rows_out: 6,
        frames: 7,
    };
    let nack = |nack| ToHost::Nack(nack);
    let answered = [
        (ToHost::Aborted, vec![1]),
        (ToHost::Register(1, 2), vec![2, 1, 2]),
        (ToHost::Statistics(statistics), vec![3, 1, 2, 3, 4, 5, 6, 7]),
        (ToHost::Camera { id: 1, received: 2, ready: true }, vec![4, 1, 2, 1]),
        (nack(Nack::NoSession), vec![5, 0]),
        (nack(Nack::NoTransfer(9)), vec![5, 1, 9]),
        (nack(Nack::Unsupported(2)), vec![5, 2, 2]),
        (nack(Nack::Register(9)), vec![5, 3, 9]),
        (nack(Nack::Refused(Refusal::TooWide { max: 64 })), vec![5, 4, 4, 64]),
        (nack(Nack::Refused(Refusal::Exposure)), vec![5, 4, 10]),
    ];
    for (message, bytes) in answered {
        assert_eq!(postcard(&message), bytes, "{message:?}");
    }
    let faults = [
        Fault::None,
        Fault::DropFrame,
        Fault::CorruptRow(3),
        Fault::StuckCounter,
        Fault::LateFrame(3),
    ];
    assert!((0..).zip(faults).all(|(number, fault)| postcard(&fault)[0] == number));
}
