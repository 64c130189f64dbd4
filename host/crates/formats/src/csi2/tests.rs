use super::*;
use crate::{Facts, Frames};
use camrig_base::Plane;

fn frames() -> Frames {
    let plane = Plane::from_fn(8, 3, |x, y| (100 * y + x) as u16);
    let facts = Facts { bits: Some(10), ..Facts::default() };
    Frames { planes: vec![plane.clone(), plane], facts }
}

#[test]
fn a_stream_is_laid_out_as_specified() {
    let bytes = encode(&frames()).unwrap();
    assert_eq!(bytes[..4], [0x00, 1, 0, ecc(0, 1)]);
    assert_eq!(bytes[4..8], [0x2B, 10, 0, ecc(0x2B, 10)]);
    assert_eq!(bytes.len(), 2 * (4 + 3 * (4 + 10 + 2) + 4));
    let kinds: Vec<u8> = Packets::new(&bytes).map(|p| p.unwrap().data_type).collect();
    assert_eq!(kinds, [0, 0x2B, 0x2B, 0x2B, 1, 0, 0x2B, 0x2B, 0x2B, 1]);
}

#[test]
fn embedded_lines_channels_and_line_packets_come_back() {
    let line = Embedded::of_frame(0.01, 2.0, 7).line(10);
    let options = Options {
        virtual_channel: 2,
        line_packets: true,
        embedded: vec![vec![line.clone()], vec![]],
        ..Options::default()
    };
    let mut bytes = encode_with(&frames(), &options).unwrap();
    bytes[0] ^= 0x20;
    let stream = decode_stream(&bytes).unwrap();
    let channel = &stream.channels[0];
    assert_eq!((&channel.frames, channel.virtual_channel), (&frames(), 2));
    assert_eq!(channel.embedded, options.embedded);
    assert_eq!((&channel.frame_numbers[..], stream.corrected_headers), (&[1, 2][..], 1));
}

#[test]
fn frame_numbers_come_back_as_given() {
    let numbered = |numbers: &[u16]| {
        let options = Options { numbers: numbers.to_vec(), ..Options::default() };
        let bytes = encode_with(&frames(), &options).unwrap();
        decode_stream::<u16>(&bytes).unwrap().channels.swap_remove(0).frame_numbers
    };
    assert_eq!(numbered(&[7, 9]), [7, 9]);
    assert_eq!(numbered(&[]), [1, 2]);
}

#[test]
fn a_wrong_payload_is_refused() {
    let mut bytes = encode(&frames()).unwrap();
    bytes[9] ^= 1;
    let error = decode::<u16>(&bytes).unwrap_err().to_string();
    assert!(error.contains("checksum") && error.contains("byte 4"), "{error}");
}

/// Samples of 20 and 24 bits as two of 10 and of 12, upper half first (CSI-2 v2.0).
#[test]
fn wide_samples_are_two_of_half_the_bits() {
    let stream = |bits, samples: &[u32]| {
        let plane = Plane { width: samples.len(), height: 1, data: samples.to_vec() };
        let facts = Facts { bits: Some(bits), ..Facts::default() };
        let frames = Frames { planes: vec![plane], facts };
        let bytes = encode(&frames).unwrap();
        assert_eq!(decode::<u32>(&bytes).unwrap(), frames);
        assert!(decode::<u16>(&bytes).is_err() && is_wide(&bytes));
        bytes
    };
    // A: 0xABCDE is 687 and 222 of 10 bits, B: 0x00003 is 0 and 3.
    let bytes = stream(20, &[0xABCDE, 3]);
    assert_eq!(bytes[4], 0x2F);
    assert_eq!(bytes[8..13], [0xAB, 222 >> 2, 0, 0, 0b11_00_10_11]);
    let bytes = stream(24, &[0xABCDEF]);
    assert_eq!(bytes[4], 0x27);
    assert_eq!(bytes[8..11], [0xAB, 0xDE, 0xFC]);
}

#[test]
fn channels_are_taken_apart() {
    let frames = frames();
    let (long, mut short) = (&frames.planes[0], frames.planes[0].clone());
    short.data.reverse();
    let sent = |plane, virtual_channel, late_rows| Sent {
        plane,
        bits: 10,
        virtual_channel,
        late_rows,
        embedded: vec![Embedded::of_frame(0.02, 1.0, 9).line(10)],
    };
    let both = [sent(long, 0, 0), sent(&short, 1, 2)];
    let mut bytes = encode_together(&both, 9, false).unwrap();
    let order: Vec<(u8, u8)> = Packets::new(&bytes)
        .map(|p| p.map(|p| (p.virtual_channel, p.data_type)).unwrap())
        .filter(|(_, data_type)| *data_type != data_type::EMBEDDED)
        .collect();
    let line = 0x2B;
    let expected = [
        (0, 0),
        (0, line),
        (0, line),
        (0, line),
        (0, 1),
        (1, 0),
        (1, line),
        (1, line),
        (1, line),
        (1, 1),
    ];
    assert_eq!(order, expected);
    bytes.extend(encode_together(&both, 10, true).unwrap());
    let stream = decode_stream::<u16>(&bytes).unwrap();
    let planes: Vec<_> = stream.channels.iter().map(|c| &c.frames.planes[..]).collect();
    assert_eq!(planes, [&[long.clone(), long.clone()][..], &[short.clone(), short.clone()]]);
    assert_eq!(stream.channels[1].frame_numbers, [9, 10]);
    assert_eq!(decode_channel::<u16>(&bytes, 1).unwrap().planes[1], short);
    let error = decode::<u16>(&bytes).unwrap_err().to_string();
    assert!(error.contains("virtual channels 0, 1") && error.contains("--virtual-channel"));
    let error = decode_channel::<u16>(&bytes, 2).unwrap_err().to_string();
    assert!(error.contains("there are frames on 0, 1"), "{error}");
    assert!(encode_together(&[sent(long, 0, 0), sent(&short, 0, 2)], 1, false).is_err());
}
