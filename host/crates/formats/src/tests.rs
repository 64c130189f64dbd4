//! Round trips of every format, and damage to every format.

use super::opcodes::{GainMap, Opcode};
use super::*;
use camrig_base::Cfa;
use proptest::prelude::*;

/// A frame of pseudo-random DN that uses the whole range.
fn frame(width: usize, height: usize, bits: u32, cfa: &str) -> RawFrame {
    let top = full_scale(bits);
    let dn = |i: usize| (i.wrapping_mul(2654435761) >> 7) as u16 & top;
    RawFrame {
        width,
        height,
        bits,
        cfa: Cfa::parse(cfa).unwrap(),
        black_level_dn: f64::from(top / 16),
        white_level_dn: top - top / 64,
        data: (0..width * height).map(dn).collect(),
    }
}

fn info() -> DngInfo {
    DngInfo {
        make: "camrig".into(),
        model: "test".into(),
        description: "seed 1, frame 0".into(),
        datetime: Some("2009:01:01 00:00:00".into()),
        exposure_s: Some(0.02),
        iso: Some(200),
        f_number: Some(2.8),
        focal_length_mm: Some(3.6),
        pitch_um: None,
        color_matrices: vec![
            ColorMatrix::of_a([[1.1, -0.3, -0.05], [-0.4, 1.2, 0.2], [-0.1, 0.25, 0.7]]),
            ColorMatrix::of_d65([[0.9, -0.2, -0.1], [-0.5, 1.3, 0.2], [-0.1, 0.3, 0.6]]),
        ],
        as_shot_neutral: Some([0.5, 1.0, 0.625]),
        noise_profile: vec![(1e-4, 2e-7), (1.1e-4, 2e-7), (1e-4, 3e-7)],
        black_levels_dn: vec![60.0, 61.0, 62.0, 63.5],
        carried: [(50730, vec![-1.5]), (50727, vec![1.0, 1.0, 1.25])].into(),
        linearization: Vec::new(),
        opcode_list1: vec![Opcode::FixBadPixelsList {
            bayer_phase: 1,
            points: vec![(3, 4), (0, 11)],
        }],
        opcode_list2: vec![Opcode::GainMap(GainMap {
            area: [0, 1, 12, 10],
            pitch: [2, 2],
            points: [2, 3],
            spacing: [1.0, 0.5],
            origin: [0.0, 0.0],
            gains: vec![2.0, 1.5, 2.0, 2.25, 1.0, 2.25],
        })],
    }
}

const FORMATS: [Format; 7] =
    [Format::Dng, Format::Tiff, Format::Npy, Format::Pgm, Format::Png, Format::Fits, Format::Csi2];

/// Exposure and gain go with the frame into every format that has a place for them, and come back
/// with the name of that place.
#[test]
fn how_a_frame_was_taken_comes_back() {
    let info = DngInfo { exposure_s: Some(0.02), iso: Some(250), ..DngInfo::default() };
    let mut frames = Frames::from_raw(&frame(12, 10, 12, "RGGB"));
    frames.facts.dng = Some(info);
    let note = "camrig's note in the file";
    for (format, by) in [
        (Format::Dng, "EXIF ExposureTime"),
        (Format::Tiff, note),
        (Format::Pgm, note),
        (Format::Png, note),
        (Format::Fits, "FITS EXPTIME"),
    ] {
        let taken = decode(&format.encode(&frames).unwrap()).unwrap().facts.taken;
        assert!(taken.noted, "{format}");
        assert_eq!(taken.exposure_s, Some(Said::new(0.02, by)), "{format}");
        assert_eq!(taken.analog_gain.map(|said| said.value), Some(2.5), "{format}");
    }
}

#[test]
fn samples_come_back_from_every_format() {
    for bits in [8, 10, 12, 14, 16] {
        for cfa in ["RGGB", "GRBG", "GBRG", "BGGR", "mono"] {
            let frames = Frames::from_raw(&frame(12, 10, bits, cfa));
            for format in FORMATS {
                let bytes = format.encode(&frames).unwrap();
                assert_eq!(Format::sniff(&bytes), Some(format.clone()));
                let back = decode(&bytes).unwrap();
                assert_eq!(back.planes, frames.planes, "{format:?} {bits} {cfa}");
                let carries_all = !matches!(format, Format::Npy | Format::Csi2);
                if carries_all {
                    let taken = Taken::default();
                    let told = Facts { dng: None, taken, ..back.facts.clone() };
                    assert_eq!(told, frames.facts, "{format:?} {bits} {cfa}");
                }
                assert_eq!(bytes, format.encode(&frames).unwrap(), "same input, same bytes");
            }
            use pixel_format::Layout;
            for layout in [Layout::Words, Layout::WordsBig, Layout::Mipi] {
                if layout != Layout::Words && matches!(bits, 8 | 16) {
                    continue;
                }
                let pixels = PixelFormat { cfa: Cfa::parse(cfa).unwrap(), bits, layout };
                assert_eq!(PixelFormat::parse(&pixels.to_string()).unwrap(), pixels);
                let bytes = pixels.encode(&frames, None).unwrap();
                let back = pixels.decode(&bytes, 12, 10, None).unwrap();
                assert_eq!(back.planes, frames.planes, "{pixels}");
                assert_eq!(back.facts.cfa, frames.facts.cfa);
            }
        }
    }
}

#[test]
fn stacks_come_back_in_order() {
    let mut frames = Frames::from_raw(&frame(8, 6, 12, "RGGB"));
    for shift in 1..4 {
        let mut plane = frames.planes[0].clone();
        plane.data.rotate_left(shift);
        frames.planes.push(plane);
    }
    for format in [Format::Tiff, Format::Npy, Format::Pgm, Format::Fits, Format::Csi2] {
        let back = decode(&format.encode(&frames).unwrap()).unwrap();
        assert_eq!(back.planes, frames.planes, "{format:?}");
    }
    for format in [Format::Dng, Format::Png] {
        let error = format.encode(&frames).unwrap_err().to_string();
        assert!(error.contains("4 frames"), "{error}");
    }
}

#[test]
fn dng_metadata_come_back() {
    let raw = frame(12, 10, 12, "GRBG");
    let back = decode(&dng::encode(&raw, &info()).unwrap()).unwrap();
    let told = back.facts.dng.unwrap();
    assert_eq!(told, info());
    assert_eq!(back.facts.black_level_dn, Some((60.0 + 61.0 + 62.0 + 63.5) / 4.0));
}

#[test]
fn dng_of_other_patterns_comes_back() {
    for (cfa, codes) in [
        ("RRGG/RRGG/GGBB/GGBB", &[0, 0, 1, 1, 0, 0, 1, 1, 1, 1, 2, 2, 1, 1, 2, 2][..]),
        ("RG/GW", &[0, 1, 1, 6]),
        ("RC/CC", &[0, 6, 6, 6]),
        ("RC/CB", &[0, 6, 6, 2]),
        ("CY/GM", &[3, 5, 1, 4]),
        ("BGRG/GIGI/RGBG/GIGI", &[2, 1, 0, 1, 1, 6, 1, 6, 0, 1, 2, 1, 1, 6, 1, 6]),
        ("RGBW/RGBW", &[0, 1, 2, 6, 0, 1, 2, 6]),
    ] {
        let raw = frame(12, 12, 10, cfa);
        let bytes = dng::encode(&raw, &DngInfo::default()).unwrap();
        assert!(bytes.windows(codes.len()).any(|w| w == codes), "{cfa}");
        assert_eq!(decode(&bytes).unwrap().raw(0).unwrap(), raw, "{cfa}");
        // Formats whose note alone carries the pattern.
        for format in [Format::Tiff, Format::Pgm, Format::Png, Format::Fits] {
            let bytes = format.encode(&Frames::from_raw(&raw)).unwrap();
            assert_eq!(decode(&bytes).unwrap().raw(0).unwrap(), raw, "{cfa} {format:?}");
        }
    }
    let large = frame(12, 12, 10, "GBGRGR/RGRBGB/GBGRGR/RGRBGB/BGBGRG/RGRGBG");
    let back = decode(&dng::encode(&large, &DngInfo::default()).unwrap()).unwrap();
    assert_eq!(back.raw(0).unwrap(), large);
}

/// Tags of a DNG: number, type, count, value or offset.
type Tags = Vec<(u16, u16, u32, u32)>;

/// A little-endian DNG of RGGB pixels with its raw in the first directory: `data` begins at 8.
fn by_hand(width: u32, height: u32, data: &[u8], more: Tags) -> Vec<u8> {
    let mut tags: Tags = vec![
        (256, 4, 1, width),
        (257, 4, 1, height),
        (258, 3, 1, 16),
        (262, 3, 1, 32803),
        (277, 3, 1, 1),
        (33421, 3, 2, 2 << 16 | 2),
        (33422, 1, 4, 0x0201_0100),
        (50706, 1, 4, 0x0000_0401),
    ];
    tags.retain(|tag| more.iter().all(|other| other.0 != tag.0));
    tags.extend(more);
    tags.sort();
    let mut bytes = b"II*\0".to_vec();
    bytes.extend((8 + data.len() as u32).to_le_bytes());
    bytes.extend(data);
    bytes.extend((tags.len() as u16).to_le_bytes());
    for (tag, kind, count, value) in tags {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(count.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend([0; 4]);
    bytes
}

fn plain_strip(white: u32) -> Tags {
    vec![(259, 3, 1, 1), (273, 4, 1, 8), (278, 4, 1, 2), (279, 4, 1, 16), (50717, 4, 1, white)]
}

#[test]
fn samples_above_the_white_level_are_kept() {
    let samples = [0u16, 5, 2000, 2050, 7, 1999, 2001, 1];
    let data: Vec<u8> = samples.iter().flat_map(|v| v.to_le_bytes()).collect();
    let frames = decode(&by_hand(4, 2, &data, plain_strip(2000))).unwrap();
    let raw = frames.raw(0).unwrap();
    assert_eq!((raw.bits, raw.white_level_dn, &raw.data[..]), (12, 2000, &samples[..]));
    let again = decode(&Format::Dng.encode(&frames).unwrap()).unwrap();
    assert_eq!(again.raw(0).unwrap(), raw);
}

#[test]
fn what_a_dng_reader_does_not_apply_is_said_or_refused() {
    let mut tags = plain_strip(4000);
    tags.push((262, 3, 1, 34892));
    tags.push((50716, 10, 2, 8)); // BlackLevelDeltaV: the samples as fractions, 10/1 and 20/1
    let data = [10u16, 0, 1, 0, 20, 0, 1, 0].map(u16::to_le_bytes).concat();
    let frames = decode(&by_hand(4, 2, &data, tags)).unwrap();
    assert_eq!(frames.facts.black_level_dn, Some(15.0));
    let note = &frames.facts.notes[0];
    assert!(note.contains("by up to 5 DN") && note.contains("BlackLevelDeltaV"), "{note}");
    for (tag, said) in [
        ((50716, 10, 1, 8), "1 deltas for 2 rows"),
        ((50715, 10, 2, 8), "2 deltas for 4 columns"),
        ((50711, 3, 1, 2), "CFALayout"),
        ((259, 3, 1, 34892), "lossy"),
        ((266, 3, 1, 2), "FillOrder 2"),
        ((50974, 3, 2, 2 << 16 | 1), "SubTileBlockSize 2"),
        ((50975, 4, 1, 2), "RowInterleaveFactor 2"),
        ((52547, 4, 1, 2), "ColumnInterleaveFactor 2"),
    ] {
        let mut tags = plain_strip(4000);
        tags.retain(|t| t.0 != tag.0);
        tags.push(tag);
        let error = decode(&by_hand(4, 2, &data, tags)).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
}

/// Levels that repeat otherwise than the pattern are read where that makes no difference: 3 x 1,
/// 4 x 1, 1 x 4 and 2 x 2 over a pattern of 2 x 2, and over one sample per pixel.
#[test]
fn black_levels_go_by_the_cells_of_the_pattern() {
    let of = |[rows, columns]: [u32; 2], levels: [u16; 4], linear: bool| {
        let mut tags = plain_strip(4000);
        tags.push((50713, 3, 2, columns << 16 | rows));
        tags.push((50714, 3, rows * columns, 8));
        let data = levels.into_iter().chain([0; 4]).flat_map(u16::to_le_bytes);
        let mut file = by_hand(4, 2, &data.collect::<Vec<_>>(), tags);
        if linear {
            let at = file.windows(4).position(|w| w == [6, 1, 3, 0]).unwrap(); // tag 262
            file[at + 8..at + 10].copy_from_slice(&34892u16.to_le_bytes());
        }
        decode(&file).map(|f| (f.facts.black_level_dn, f.facts.dng.unwrap().black_levels_dn))
    };
    let each = vec![5.0, 6.0, 7.0, 8.0];
    assert_eq!(of([2, 2], [5, 6, 7, 8], false).unwrap(), (Some(6.5), each));
    assert_eq!(of([4, 1], [5, 6, 5, 6], false).unwrap(), (Some(5.5), vec![5.0, 5.0, 6.0, 6.0]));
    assert_eq!(of([1, 4], [5, 6, 5, 6], false).unwrap(), (Some(5.5), vec![5.0, 6.0, 5.0, 6.0]));
    assert_eq!(of([3, 1], [5, 5, 5, 0], false).unwrap(), (Some(5.0), vec![]));
    assert_eq!(of([2, 2], [5, 5, 5, 5], true).unwrap(), (Some(5.0), vec![]));
    for (sides, levels, linear) in [
        ([3, 1], [5, 6, 7, 0], false),
        ([4, 1], [5, 6, 7, 6], false),
        ([1, 4], [5, 6, 5, 7], false),
        ([2, 2], [5, 6, 5, 6], true),
    ] {
        let error = of(sides, levels, linear).unwrap_err().to_string();
        assert!(error.contains("differ within the cells"), "{sides:?} {levels:?}: {error}");
    }
}

/// Signed integers are plain numbers; negative levels are none.
#[test]
fn black_levels_of_signed_types_are_read() {
    for (kind, value, negative) in [(6, 64, 0xC0), (8, 64, 0xFFC0), (9, 64, 0xFFFF_FFC0)] {
        let of = |value| {
            let mut tags = plain_strip(4000);
            tags.push((50714, kind, 1, value));
            decode(&by_hand(4, 2, &[0; 16], tags))
        };
        assert_eq!(of(value).unwrap().facts.black_level_dn, Some(64.0), "type {kind}");
        let error = of(negative).unwrap_err().to_string();
        assert!(error.contains("-64") && error.contains("BlackLevel"), "{error}");
    }
}

/// Bad pixels of list 1 have their places in the stored image, gain maps of list 2 theirs in the
/// active area; notes say what is not kept, and an orientation.
#[test]
fn corrections_go_with_the_crop_and_others_are_told() {
    let word = |v: u32| v.to_be_bytes();
    let opcode = |id: u32, body: &[u32]| {
        let head = [id, 0x0103_0000, 0, 4 * body.len() as u32];
        head.iter().chain(body).flat_map(|v| word(*v)).collect::<Vec<u8>>()
    };
    // Points (1, 2), (0, 0) and (2, 3), and a rectangle.
    let bad = opcode(5, &[0, 3, 1, 1, 2, 0, 0, 2, 3, 0, 0, 1, 1]);
    let first = [&word(2)[..], &bad, &opcode(7, &[0])].concat();
    let third = [&word(2)[..], &opcode(1, &[]), &opcode(77, &[])].concat();
    let area = [1u32, 2, 3, 4].map(u32::to_le_bytes).concat();
    let samples: Vec<u8> = (0..12u16).flat_map(u16::to_le_bytes).collect();
    let place = |parts: &[&[u8]]| 8 + parts.iter().map(|p| p.len()).sum::<usize>() as u32;
    let mut tags = plain_strip(4000);
    tags.retain(|t| ![278, 279].contains(&t.0));
    tags.extend([(278, 4, 1, 3), (279, 4, 1, 24), (274, 3, 1, 3)]);
    tags.push((50829, 4, 4, place(&[&samples])));
    tags.push((51008, 7, first.len() as u32, place(&[&samples, &area])));
    tags.push((51022, 7, third.len() as u32, place(&[&samples, &area, &first])));
    let facts = |tags: Tags| {
        let data = [&samples[..], &area, &first, &third].concat();
        decode(&by_hand(4, 3, &data, tags)).unwrap().facts
    };
    let whole = facts(tags.iter().copied().filter(|t| t.0 != 50829).collect());
    let points = |bayer_phase, points| vec![Opcode::FixBadPixelsList { bayer_phase, points }];
    let kept = whole.dng.unwrap().opcode_list1;
    assert_eq!(kept, points(0, vec![(1, 2), (0, 0), (2, 3)]));
    let cropped = facts(tags);
    // Rows from 1 on: the phase is that of a green pixel next to blue ones.
    assert_eq!(cropped.dng.unwrap().opcode_list1, points(2, vec![(0, 0), (1, 1)]));
    // A gain map's grid is of the whole image.
    let gains = info().opcode_list2.remove(0);
    assert_eq!((gains.clone().cropped([0, 0, 1, 1]), gains.cropped([1, 2, 3, 4])), (None, None));
    let notes = cropped.notes.join("; ");
    for said in [
        "1 rectangle(s) of FixBadPixelsList of OpcodeList1, MapTable of OpcodeList1, \
         WarpRectilinear of OpcodeList3, opcode 77 of OpcodeList3",
        "turned by 180 degrees (Orientation 3)",
    ] {
        assert!(notes.contains(said), "{notes}");
    }
}

/// Levels that are no numbers are refused; those above what samples hold have a note.
#[test]
fn levels_that_cannot_be_are_refused_or_told() {
    // The fraction 0/0, and 4095/1, stand among the samples.
    let data: Vec<u8> = [0u16, 0, 0, 0, 4095, 0, 1, 0].map(u16::to_le_bytes).concat();
    let with = |tag: (u16, u16, u32, u32)| {
        let mut tags = plain_strip(4000);
        tags.retain(|t| t.0 != tag.0);
        tags.push(tag);
        decode(&by_hand(4, 2, &data, tags))
    };
    for (tag, name) in [(50714, "BlackLevel"), (50717, "WhiteLevel"), (50716, "BlackLevelDeltaV")]
    {
        let error = with((tag, 5, 1, 8)).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("no finite"), "{error}");
    }
    let fraction = with((50717, 5, 1, 16)).unwrap().facts;
    assert_eq!((fraction.white_level_dn, fraction.notes), (Some(4095), vec![]));
    let high = with((50717, 4, 1, 70000)).unwrap().facts;
    assert_eq!(high.white_level_dn, Some(65535));
    assert!(high.notes[0].contains("70000"), "{:?}", high.notes);
    let several = with((50717, 3, 2, 4000 << 16 | 4095)).unwrap().facts;
    assert_eq!(several.white_level_dn, Some(4095));
    assert!(several.notes[0].contains("4000"), "{:?}", several.notes);
}

/// Raw files in the makers' own formats are named, with what makes a DNG of them.
#[test]
fn raw_of_makers_is_named() {
    let mut nef = by_hand(4, 2, &[b"NIKON\0\0\0", &[0; 8][..]].concat(), plain_strip(4000));
    let version = nef.windows(4).position(|w| w == [0x12, 0xc6, 1, 0]).unwrap();
    nef[version..version + 2].copy_from_slice(&[0x11, 0xc6]); // no DNGVersion
    let tag = |nef: &mut Vec<u8>, old: u16, new: [u16; 2], count: u32, value: u32| {
        let at = nef.windows(2).rposition(|w| w == old.to_le_bytes()).unwrap();
        nef[at..at + 2].copy_from_slice(&new[0].to_le_bytes());
        nef[at + 2..at + 4].copy_from_slice(&new[1].to_le_bytes());
        nef[at + 4..at + 8].copy_from_slice(&count.to_le_bytes());
        nef[at + 8..at + 12].copy_from_slice(&value.to_le_bytes());
    };
    tag(&mut nef, 33421, [271, 2], 6, 8); // Make
    tag(&mut nef, 33422, [330, 4], 1, 8); // SubIFDs
    for (bytes, name) in [
        (nef, "NEF, Nikon"),
        (b"II*\0\x10\0\0\0CR\x02\0........".to_vec(), "CR2, Canon"),
        (b"\0\0\0\x18ftypcrx \0\0\0\x01".to_vec(), "CR3, Canon"),
        (b"FUJIFILMCCD-RAW 0201".to_vec(), "RAF, Fujifilm"),
        (b"IIU\0\x08\0\0\0".to_vec(), "RW2, Panasonic"),
    ] {
        let error = decode(&bytes).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("DNG Converter"), "{name}: {error}");
    }
}

/// DNG 1.4: the black level of a pixel is BlackLevel plus the deltas of its column and its row.
/// Deltas that are the same within each cell of the pattern are levels of the cells.
#[test]
fn deltas_of_the_black_level_count() {
    // Fractions over 1 in the samples' place: 30, 40, 30, 40 of columns, 5, 7 of rows.
    let (columns, rows) = ([30u16, 40, 30, 40], [5u16, 7]);
    let fractions = columns.iter().chain(&rows).flat_map(|n| [*n, 0, 1, 0]);
    let data: Vec<u8> = fractions.flat_map(u16::to_le_bytes).collect();
    let mut tags = plain_strip(4000);
    tags.extend([(50714, 3, 1, 100), (50715, 10, 4, 8), (50716, 10, 2, 40)]);
    let facts = decode(&by_hand(4, 2, &data, tags)).unwrap().facts;
    let levels = [135.0, 145.0, 137.0, 147.0];
    assert_eq!(facts.dng.unwrap().black_levels_dn, levels);
    assert_eq!((facts.black_level_dn, facts.notes), (Some(141.0), vec![]));
}

/// dcraw, LibRaw and RawSpeed cut the fractions of BlackLevel and add the mean of the deltas: they
/// come to the nearest whole level, where the fraction alone would cost up to 1 DN.
#[test]
fn readers_that_cut_fractions_come_to_the_nearest_black_level() {
    for dn in [63.9, 64.25, 0.3, 1023.999] {
        let mut raw = frame(12, 10, 12, "RGGB");
        raw.black_level_dn = dn;
        let bytes = dng::encode(&raw, &DngInfo::default()).unwrap();
        assert_eq!(decode(&bytes).unwrap().facts.black_level_dn, Some(dn));
        // The one field of four fractions that are alike, and the one of a row's.
        let cut = |tag: u16, count: u32| -> Vec<f64> {
            let head: Vec<u8> = [tag.to_le_bytes(), [if tag == 50714 { 5 } else { 10 }, 0]]
                .concat()
                .into_iter()
                .chain(count.to_le_bytes())
                .collect();
            let at = bytes.windows(8).position(|w| w == head).unwrap() + 8;
            let word = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
            let fractions = word(at) as usize;
            (0..count as usize)
                .map(|i| fractions + 8 * i)
                .map(|at| f64::from(word(at)) / f64::from(word(at + 4)))
                .collect()
        };
        let delta = cut(50716, 10).iter().sum::<f64>() / 10.0;
        for level in cut(50714, 4) {
            assert_eq!(level.trunc() + (delta + 0.5).trunc(), dn.round(), "{dn}");
            assert!((level + delta - dn).abs() < 1e-6, "{level} {delta}");
        }
    }
}

/// TIFF/EP has ExposureTime and ISO in the main directory; DNG allows one matrix, for any light.
#[test]
fn small_writers_put_exposure_and_one_matrix_into_the_main_directory() {
    let data = [1u16, 0, 100, 0, 0, 0, 0, 0].map(u16::to_le_bytes).concat();
    let mut tags = plain_strip(4000);
    tags.extend([(33434, 5, 1, 8), (34855, 3, 1, 200)]);
    let facts = decode(&by_hand(4, 2, &data, tags)).unwrap().facts;
    assert_eq!(facts.taken.exposure_s, Some(Said::new(0.01, "EXIF ExposureTime")));
    assert_eq!(facts.taken.analog_gain.map(|said| said.value), Some(2.0));
    assert_eq!(facts.dng.map(|info| (info.exposure_s, info.iso)), Some((Some(0.01), Some(200))));

    let matrix = ColorMatrix { illuminant: 20, ..info().color_matrices[0] };
    let carried = [(50729, vec![0.3125, 0.3375]), (50730, vec![-1.5])].into();
    let one = DngInfo { color_matrices: vec![matrix], carried, ..DngInfo::default() };
    let back = decode(&dng::encode(&frame(12, 10, 12, "RGGB"), &one).unwrap()).unwrap();
    assert_eq!(back.facts.dng, Some(one));
}

/// Signed samples are read where none is negative; floats are not DN.
#[test]
fn dng_samples_of_other_formats_are_read_or_refused() {
    let of = |samples: [i16; 8], format: u32| {
        let mut tags = plain_strip(4000);
        tags.push((339, 3, 1, format));
        decode(&by_hand(4, 2, &samples.map(i16::to_le_bytes).concat(), tags))
    };
    let samples = [0, 5, 32767, 2050, 7, 1999, 2001, 1];
    assert_eq!(of(samples, 2).unwrap().planes[0].data, samples.map(|v| v as u16));
    let error = of([0, 5, -9, 0, 0, 0, 0, 0], 2).unwrap_err().to_string();
    assert!(error.contains("value -9"), "{error}");
    for (format, said) in [(3, "floating point"), (6, "SampleFormat 6")] {
        let error = of(samples, format).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
}

/// A DNG of raw images of 2 x 1: value of their first sample, NewSubFileType and whether the image
/// is in a SubIFD of the directory before, which is the case for none or all.
fn several(images: &[(u16, u32)], inner: bool) -> Vec<u8> {
    // Directories of a fixed size, one behind another; samples are in the field of a strip of one
    // row, which is read where it stands.
    const FIELDS: u32 = 11;
    let place = |index: u32| 8 + index * (2 + FIELDS * 12 + 4 + 4);
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    for (index, &(sample, kind)) in (0u32..).zip(images) {
        let next = if index as usize + 1 < images.len() { place(index + 1) } else { 0 };
        let (chained, contained) = if inner { (0, next) } else { (next, 0) };
        let mut tags: Tags = vec![
            (254, 4, 1, kind),
            (256, 4, 1, 2),
            (257, 4, 1, 1),
            (258, 3, 1, 16),
            (262, 3, 1, 32803),
            (273, 4, 1, place(index) + 2 + FIELDS * 12 + 4),
            (277, 3, 1, 1),
            (33421, 3, 2, 2 << 16 | 2),
            (33422, 1, 4, 0x0201_0100),
            (50706, 1, 4, 0x0000_0401),
        ];
        // A field of no meaning keeps the size where there is no SubIFD.
        tags.push(if contained > 0 { (330, 4, 1, contained) } else { (315, 4, 1, 0) });
        tags.sort();
        bytes.extend((tags.len() as u16).to_le_bytes());
        for (tag, kind, count, value) in tags {
            bytes.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
            bytes.extend([count.to_le_bytes(), value.to_le_bytes()].concat());
        }
        bytes.extend(chained.to_le_bytes());
        bytes.extend([sample.to_le_bytes(), 1u16.to_le_bytes()].concat());
    }
    bytes
}

/// The main image before others, else the first of one size, in SubIFDs and in the chain; the
/// others are told.
#[test]
fn one_of_several_raw_images_is_read_and_the_others_are_told() {
    for (images, inner, expected) in [
        (&[(7, 0), (8, 0)][..], true, 7),
        (&[(7, 0), (8, 0), (9, 0)], false, 7),
        (&[(7, 1), (8, 0)], true, 8),
        (&[(7, 1), (8, 0)], false, 8),
        (&[(7, 16), (8, 1)], false, 7),
    ] {
        let frames = decode(&several(images, inner)).unwrap();
        assert_eq!(frames.planes[0].data, [expected, 1], "{images:?} {inner}");
        let notes = frames.facts.notes.join("; ");
        let read = images.iter().position(|i| i.0 == expected).unwrap();
        let (number, kind) = (read + 1, images[read].1);
        let said = format!("raw images number {number} (2 x 1, NewSubFileType {kind}) is read");
        assert!(notes.contains(&said), "{notes}");
    }
    let mut circle = several(&[(7, 0), (8, 0)], false);
    let last = circle.len() - 8;
    circle[last] = 8;
    let notes = decode(&circle).unwrap().facts.notes.join("; ");
    assert!(notes.contains("comes back") && notes.contains("not number 2"), "{notes}");
}

/// A BigTIFF with the raw in its only directory, packed; both byte orders are one code.
#[test]
fn a_dng_within_a_bigtiff_is_read() {
    let tags: [(u16, u16, u64, u64); 10] = [
        (256, 4, 1, 3),
        (257, 4, 1, 2),
        (258, 3, 1, 12),
        (262, 3, 1, 32803),
        (273, 16, 1, 16),
        (277, 3, 1, 1),
        (33421, 3, 2, 2 << 16 | 2),
        (33422, 1, 4, 0x0201_0100),
        (50706, 1, 4, 0x0000_0701),
        // Eight bytes stand in the field: 64/1.
        (50714, 5, 1, 1 << 32 | 64),
    ];
    let mut bytes = b"II+\0\x08\0\0\0".to_vec();
    bytes.extend(26u64.to_le_bytes());
    bytes.extend([0x12, 0x34, 0x56, 0x78, 0x90, 0xAB, 0xCD, 0xEF, 0x01, 0x20]);
    bytes.extend((tags.len() as u64).to_le_bytes());
    for (tag, kind, count, value) in tags {
        bytes.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
        bytes.extend([count.to_le_bytes(), value.to_le_bytes()].concat());
    }
    bytes.extend([0; 8]);
    assert_eq!(Format::sniff(&bytes), Some(Format::Dng));
    let raw = decode(&bytes).unwrap().raw(0).unwrap();
    assert_eq!(raw.data, [0x123, 0x456, 0x789, 0xABC, 0xDEF, 0x012]);
    assert_eq!((raw.cfa.to_string(), raw.black_level_dn, raw.bits), ("RGGB".into(), 64.0, 12));
    for length in 0..bytes.len() - 8 {
        assert!(decode(&bytes[..length]).is_err(), "{length}");
    }
}

/// Lossless JPEG in one strip, in two tiles, and in a strip of two rows as one.
#[test]
fn lossless_jpeg_fills_strips_and_tiles_row_by_row() {
    let samples: Vec<u16> = (0..32u16).map(|i| i * 97 % 4096).collect();
    let of = |columns: std::ops::Range<usize>| -> Vec<u16> {
        samples.chunks(8).flat_map(|row| row[columns.clone()].to_vec()).collect()
    };
    let plain = ljpeg::encode(&samples, (4, 4, 2), (12, 1), 0);
    let folded = ljpeg::encode(&samples, (8, 2, 2), (12, 6), 0);
    for strip in [plain, folded] {
        let tags = vec![
            (259, 3, 1, 7),
            (273, 4, 1, 8),
            (278, 4, 1, 4),
            (279, 4, 1, strip.len() as u32),
            (50717, 4, 1, 4095),
        ];
        let frames = decode(&by_hand(8, 4, &strip, tags)).unwrap();
        assert_eq!(frames.planes[0].data, samples);
    }
    let tiles = [0..4, 4..8].map(|c| ljpeg::encode(&of(c), (4, 4, 1), (12, 7), 0));
    let lengths: Vec<u32> = tiles.iter().map(|t| t.len() as u32).collect();
    // The tiles' lengths and offsets lie before them.
    let mut data: Vec<u8> = lengths.iter().flat_map(|v| v.to_le_bytes()).collect();
    data.extend([24, 24 + lengths[0]].iter().flat_map(|v| v.to_le_bytes()));
    data.extend(tiles.concat());
    let tags = vec![
        (259, 3, 1, 7),
        (322, 4, 1, 4),
        (323, 4, 1, 4),
        (324, 4, 2, 16),
        (325, 4, 2, 8),
        (50717, 4, 1, 4095),
    ];
    let file = by_hand(8, 4, &data, tags);
    assert_eq!(decode(&file).unwrap().planes[0].data, samples);
    // The four bytes at the end, the place of the next directory, are not read.
    for length in 0..file.len() - 4 {
        assert!(decode(&file[..length]).is_err(), "{length}");
    }
}

/// Rows of 10 in a tile 9 wide, and a corner tile whose rows end where the image does.
#[test]
fn lossless_jpeg_of_rows_that_do_not_fit_is_refused() {
    for (size, tile, jpeg) in [((9, 9), (9, 10), (5, 9, 2)), ((4, 2), (8, 4), (2, 4, 2))] {
        let samples = vec![100; jpeg.0 * jpeg.1 * jpeg.2];
        let data = ljpeg::encode(&samples, jpeg, (12, 1), 0);
        let tags = vec![
            (259, 3, 1, 7),
            (322, 4, 1, tile.0),
            (323, 4, 1, tile.1),
            (324, 4, 1, 8),
            (325, 4, 1, data.len() as u32),
        ];
        let error = decode(&by_hand(size.0, size.1, &data, tags)).unwrap_err().to_string();
        let rows = format!("rows of {} samples for rows of {}", jpeg.0 * jpeg.2, tile.0);
        assert!(error.contains(&rows) && error.contains("tile 0"), "{error}");
    }
}

#[test]
fn a_white_level_that_is_full_scale_below_the_values_is_told() {
    let samples = [0u16, 16_000, 1, 2, 3, 4, 5, 6];
    let jpeg = ljpeg::encode(&samples, (2, 2, 2), (14, 1), 0);
    let strip = |compression, bits, data: &[u8]| -> Tags {
        let length = data.len() as u32;
        let strip = [(273, 4, 1, 8), (278, 4, 1, 2), (279, 4, 1, length)];
        [(258, 3, 1, bits), (259, 3, 1, compression)].into_iter().chain(strip).collect()
    };
    // A linearization table of 0 and 4095 for samples of 8 bits.
    let plain = [0u8; 8];
    let table = |most: u32| [strip(1, 8, &plain), vec![(50712, 3, 2, most << 16)]].concat();
    for (data, tags, white, told) in [
        (&jpeg[..], strip(7, 12, &jpeg), 4095, "up to 16000"),
        (&jpeg[..], strip(7, 14, &jpeg), 16_383, ""),
        (&plain[..], table(4095), 255, "up to 4095"),
        (&plain[..], table(255), 255, ""),
    ] {
        let facts = decode(&by_hand(4, 2, data, tags)).unwrap().facts;
        assert_eq!(facts.white_level_dn, Some(white));
        let notes = facts.notes.join("; ");
        assert_eq!(notes.contains("no white level"), !told.is_empty(), "{notes}");
        assert!(notes.contains(told), "{notes}");
    }
}

#[test]
fn frames_within_gzip_are_read_and_bombs_refused() {
    use std::io::Write;
    let pack = |bytes: &[u8]| {
        let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        gz.write_all(bytes).unwrap();
        gz.finish().unwrap()
    };
    let frames = Frames::from_raw(&frame(6, 4, 12, "RGGB"));
    let plain = Format::Fits.encode(&frames).unwrap();
    let packed = pack(&plain);
    assert_eq!(decode(&packed).unwrap(), decode(&plain).unwrap());
    for length in 3..packed.len() {
        assert!(decode(&packed[..length]).is_err(), "{length}");
    }
    let error = gzip::inflate(&pack(&[0; 100_000]), 99_999).unwrap_err();
    assert!(error.to_string().contains("more than 99999"), "{error}");
}

/// A packed big-endian DNG with its raw in the first directory, written by hand.
#[test]
fn packed_big_endian_dng_is_read() {
    let samples: [u16; 6] = [0x123, 0x456, 0x789, 0xABC, 0xDEF, 0x012];
    let strips = [0x12, 0x34, 0x56, 0x78, 0x90, 0xAB, 0xCD, 0xEF, 0x01, 0x20];
    let tags: [(u16, u16, u32, u32); 12] = [
        (256, 4, 1, 3),
        (257, 4, 1, 2),
        (258, 3, 1, 12 << 16),
        (259, 3, 1, 1 << 16),
        (262, 3, 1, 32803 << 16),
        (273, 4, 1, 8 + 2 + 12 * 12 + 4),
        (277, 3, 1, 1 << 16),
        (278, 4, 1, 2),
        (33421, 3, 2, 2 << 16 | 2),
        (33422, 1, 4, 0x0201_0100),
        (50706, 1, 4, 0x0104_0000),
        (50717, 4, 1, 4000),
    ];
    let mut bytes = b"MM\0*\0\0\0\x08".to_vec();
    bytes.extend((tags.len() as u16).to_be_bytes());
    for (tag, kind, count, value) in tags {
        bytes.extend(tag.to_be_bytes());
        bytes.extend(kind.to_be_bytes());
        bytes.extend(count.to_be_bytes());
        bytes.extend(value.to_be_bytes());
    }
    bytes.extend([0; 4]);
    bytes.extend(strips);
    let back = decode(&bytes).unwrap().raw(0).unwrap();
    assert_eq!(back.data, samples);
    assert_eq!((back.cfa.to_string(), back.white_level_dn, back.bits), ("BGGR".into(), 4000, 12));
}

#[test]
fn out_of_range_samples_are_refused_by_writers() {
    let mut frames = Frames::from_raw(&frame(4, 4, 10, "RGGB"));
    frames.planes[0].data[5] = 1024;
    for format in FORMATS.into_iter().filter(|f| !matches!(f, Format::Npy | Format::Fits)) {
        let error = format.encode(&frames).unwrap_err().to_string();
        assert!(error.contains("1024") && error.contains("10 bits"), "{format:?}: {error}");
    }
}

#[test]
fn every_truncation_is_an_error() {
    let frames = Frames::from_raw(&frame(8, 8, 12, "RGGB"));
    for format in FORMATS {
        let bytes = format.encode(&frames).unwrap();
        // FITS pads its last block with zeros, which are not needed to read it.
        let needed = if format == Format::Fits { 2880 + 128 } else { bytes.len() };
        for length in 0..needed {
            let cut = decode(&bytes[..length]);
            // A DNG keeps reading without the thumbnail that it does not need, a PNG without its
            // closing chunk: then the samples must be whole.
            if let Ok(cut) = cut {
                assert_eq!(cut.planes, frames.planes, "{format:?} cut to {length}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// Any damage is read or refused, without a panic and without huge allocations.
    #[test]
    fn damaged_files_never_panic(
        which in 0usize..7,
        edits in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        header_only in any::<bool>(),
    ) {
        let raw = frame(12, 10, 12, "GRBG");
        let frames = Frames::from_raw(&raw);
        let mut bytes = match &FORMATS[which] {
            Format::Dng => dng::encode(&raw, &info()).unwrap(),
            format => format.encode(&frames).unwrap(),
        };
        let reach = if header_only { bytes.len().min(96) } else { bytes.len() };
        for (place, value) in edits {
            bytes[place.index(reach)] = value;
        }
        let _ = decode(&bytes);
    }

    #[test]
    fn random_bytes_never_panic(
        magic in prop::sample::select(vec![
            &b"II*\0"[..], b"MM\0*", b"P2\n", b"P7\n", b"\x1f\x8b\x08\0",
            b"\x93NUMPY\x01\0", b"\x93NUMPY\x02\0", b"P5\n", b"SIMPLE  =",
            b"\x89PNG\r\n\x1a\n", b"II+\0\x08\0\0\0", b"\0\x01\0\x1a",
        ]),
        rest in proptest::collection::vec(any::<u8>(), 0..300),
    ) {
        let mut bytes = magic.to_vec();
        bytes.extend(rest);
        let _ = decode(&bytes);
        let _ = csi2::decode_stream::<u16>(&bytes);
        let _ = opcodes::decode(&bytes, &mut Vec::new());
        let _ = opcodes::names(&bytes);
    }

    #[test]
    fn any_frame_comes_back(
        width in 1usize..20, height in 1usize..20, bits in 1u32..=16, seed in any::<u64>(),
        format in prop::sample::select(vec![
            Format::Dng, Format::Tiff, Format::Npy, Format::Pgm, Format::Png, Format::Fits,
        ]),
    ) {
        let mut raw = frame(width, height, bits, "BGGR");
        raw.data.iter_mut().for_each(|dn| *dn = (*dn ^ seed as u16) & full_scale(bits));
        raw.white_level_dn = full_scale(bits);
        let back = decode(&format.encode(&Frames::from_raw(&raw)).unwrap()).unwrap();
        prop_assert_eq!(&back.planes[0].data, &raw.data);
    }
}
