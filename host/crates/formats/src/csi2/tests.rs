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
    let kinds: Vec<u8> = Packets::new(&bytes).map(|p| p.packet.unwrap().data_type).collect();
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
    assert_eq!(channel.frame_numbers, [1, 2]);
    assert!(stream.faults.len() == 1 && stream.faults[0].is_corrected());
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

/// Frames of 6 rows of 8 samples of 10 bits, packets of 16 bytes; the second frame is damaged.
/// The samples are zero, the hardest case for finding packets again: zeros are sound Frame Starts.
fn damaged(damages: &[Damage], line_packets: bool) -> (Stream, Vec<String>) {
    let plane = Plane { width: 8, height: 6, data: vec![0u16; 48] };
    let facts = Facts { bits: Some(10), ..Facts::default() };
    let frames = Frames { planes: vec![plane; 3], facts };
    let options =
        Options { line_packets, embedded: vec![vec![vec![0; 10]]; 3], ..Options::default() };
    let bytes = encode_with(&frames, &options).unwrap();
    let (before, rest) = bytes.split_at(bytes.len() / 3);
    let (second, after) = rest.split_at(before.len());
    let bytes = [before, &damage(second, damages).unwrap(), after].concat();
    let stream = decode_damaged::<u16>(&bytes).unwrap();
    let strict = decode_stream::<u16>(&bytes).map_err(|e| e.to_string());
    let is_whole = stream.faults.iter().all(Damaged::is_corrected);
    assert_eq!(strict.is_ok(), is_whole, "{strict:?}");
    let said = stream.faults.iter().map(|fault| {
        let said = fault.to_string();
        assert!(is_whole || strict.as_ref().is_err_and(|e| e.contains(&said)), "{strict:?}");
        let (place, what) = said.split_once(": ").unwrap();
        format!("{}: {what}", place.split(" (").next().unwrap())
    });
    let said = said.collect();
    (stream, said)
}

#[test]
fn every_damage_is_named_with_its_frame_and_row() {
    for row in [0, 3, 5] {
        let at = |what: &str| vec![format!("frame 1, row {row}: {what}")];
        for lines in [false, true] {
            let said = |damage| damaged(&[damage], lines).1;
            let header = "one wrong bit in a header, corrected";
            assert_eq!(said(Damage::HeaderBit(row)), at(header));
            let header = "more than one wrong bit in a header, 16 bytes lost";
            assert_eq!(said(Damage::HeaderBits(row)), at(header));
            assert_eq!(said(Damage::Checksum(row)), at("the checksum does not hold"));
            assert_eq!(said(Damage::Short(row)), at("a line of 5 bytes, not 10"));
            let count = "the word count 26 is wrong: packets go on after 16 bytes, which are lost";
            assert_eq!(said(Damage::WordCount(row)), at(count));
            assert_eq!(said(Damage::DataType(row)), at("a line of data type 0x2c, not 0x2b"));
            let none = match lines {
                true => at("no packet between Line Start and Line End"),
                false => vec!["frame 1: 5 lines, not 6".to_string()],
            };
            assert_eq!(said(Damage::NoPacket(row)), none);
            let strayed = "virtual channel 1, frame 0, row 0: image lines without a Frame Start";
            let strayed = vec![strayed.to_string(), none[0].clone()];
            let mut found = said(Damage::VirtualChannel(row));
            found.sort_by_key(|said| !said.starts_with("virtual"));
            assert_eq!(found, strayed);
        }
    }
    for lines in [false, true] {
        let said = |damage| damaged(&[damage], lines).1;
        assert_eq!(
            said(Damage::NoFrameStart),
            ["frame 1, row 0: image lines without a Frame Start"]
        );
        assert_eq!(said(Damage::NoFrameEnd), ["frame 1: no Frame End"]);
    }
    let all = [Damage::HeaderBits(1), Damage::Checksum(2), Damage::Short(4), Damage::NoFrameEnd];
    assert_eq!(damaged(&all, true).1.len(), 4);
}

/// What is received of a damaged frame stands where it was sent; a line that is lost is zero.
#[test]
fn damaged_frames_are_read_around_what_is_lost() {
    let mut frames = frames();
    frames.planes.truncate(1);
    let options = Options { line_packets: true, ..Options::default() };
    let bytes = encode_with(&frames, &options).unwrap();
    let whole = &frames.planes[0];
    for lost in [Damage::HeaderBits(1), Damage::NoPacket(1), Damage::Short(1)] {
        let bytes = damage(&bytes, &[lost]).unwrap();
        let found = decode_damaged::<u16>(&bytes).unwrap().only().unwrap();
        let plane = &found.planes[0];
        assert_eq!(
            [plane.row(0), plane.row(1), plane.row(2)],
            [whole.row(0), &[0; 8], whole.row(2)]
        );
    }
    let kept = decode_damaged::<u16>(&damage(&bytes, &[Damage::Checksum(1)]).unwrap()).unwrap();
    let kept = kept.only().unwrap();
    let differing = kept.planes[0].data.iter().zip(&whole.data).filter(|(a, b)| a != b);
    assert_eq!(differing.count(), 1);
}

#[test]
fn a_stream_that_ends_early_is_told() {
    let bytes = encode(&frames()).unwrap();
    let said = |length: usize| decode_stream::<u16>(&bytes[..length]).unwrap_err().to_string();
    let missing = "the stream is truncated, 11 bytes of a packet are missing";
    assert!(said(bytes.len() - 15).contains(missing), "{}", said(bytes.len() - 15));
    assert!(said(bytes.len() - 4).contains("frame 1 (byte 108): no Frame End"));
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
        .map(|p| p.packet.map(|p| (p.virtual_channel, p.data_type)).unwrap())
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
    assert_eq!(decode_stream::<u16>(&bytes).unwrap().channel(1).unwrap().planes[1], short);
    let error = decode::<u16>(&bytes).unwrap_err().to_string();
    assert!(error.contains("virtual channels 0, 1") && error.contains("--virtual-channel"));
    let error = decode_stream::<u16>(&bytes).unwrap().channel(2).unwrap_err().to_string();
    assert!(error.contains("there are frames on 0, 1"), "{error}");
    assert!(encode_together(&[sent(long, 0, 0), sent(&short, 0, 2)], 1, false).is_err());
}
