//! Files as other programs write them, unit by unit.

use super::*;
use crate::{Said, Taken};

/// A header of these cards, and data, both padded.
fn unit(cards: &[(&str, &str)], data: &[u8]) -> Vec<u8> {
    let mut text = String::new();
    for (key, value) in cards {
        text.push_str(&format!("{:<CARD$}", format!("{key:<8}= {value:>20} / comment")));
    }
    text.push_str(&format!("{:<CARD$}", "END"));
    let mut bytes = text.into_bytes();
    bytes.resize(bytes.len().next_multiple_of(BLOCK), b' ');
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(BLOCK), 0);
    bytes
}

/// A primary image of 3 x 2.
fn image(bitpix: &str, more: &[(&str, &str)], data: &[u8]) -> Vec<u8> {
    let mut cards = vec![
        ("SIMPLE", "T"),
        ("BITPIX", bitpix),
        ("NAXIS", "2"),
        ("NAXIS1", "3"),
        ("NAXIS2", "2"),
    ];
    cards.extend(more);
    unit(&cards, data)
}

const DN: [u16; 6] = [0, 7, 500, 4095, 40000, 65535];

fn read(bytes: &[u8]) -> (Vec<u16>, Facts) {
    let frames = decode(bytes).unwrap();
    assert_eq!((frames.width(), frames.height(), frames.planes.len()), (3, 2, 1));
    (frames.planes[0].data.clone(), frames.facts)
}

fn refused(bytes: &[u8]) -> String {
    decode(bytes).unwrap_err().to_string()
}

/// The keywords that Siril, N.I.N.A. and others read: pattern, order of rows, pitch and gain.
#[test]
fn keywords_of_camera_programs_are_written() {
    let frame = camrig_base::RawFrame {
        width: 3,
        height: 2,
        bits: 12,
        cfa: Cfa::parse("GBRG").unwrap(),
        black_level_dn: 64.0,
        white_level_dn: 4095,
        data: vec![64; 6],
    };
    let mut frames = Frames::from_raw(&frame);
    let info = crate::DngInfo { iso: Some(250), pitch_um: Some(1.12), ..Default::default() };
    frames.facts.dng = Some(info);
    let bytes = encode(&frames).unwrap();
    for card in [
        "BAYERPAT= 'GBRG    '",
        "ROWORDER= 'TOP-DOWN'",
        "XPIXSZ  =                 1.12 ",
        "YPIXSZ  =                 1.12 ",
        "GAIN    =                  2.5 ",
    ] {
        assert!(bytes.chunks(CARD).any(|found| found.starts_with(card.as_bytes())), "{card}");
    }
    let facts = decode(&bytes).unwrap().facts;
    assert_eq!(facts.taken.pitch_um, Some(Said::new(1.12, "FITS XPIXSZ")));
    assert!(facts.notes.is_empty(), "{:?}", facts.notes);
    frames.facts.cfa = Cfa::parse("mono").ok();
    let bytes = encode(&frames).unwrap();
    assert!(!bytes.chunks(CARD).any(|found| found.starts_with(b"BAYERPAT")));
}

#[test]
fn integers_and_floats_of_any_size_are_read() {
    for (bitpix, data) in [
        ("32", DN.map(|v| i32::from(v).to_be_bytes()).concat()),
        ("64", DN.map(|v| i64::from(v).to_be_bytes()).concat()),
        ("-32", DN.map(|v| f32::from(v).to_be_bytes()).concat()),
        ("-64", DN.map(|v| f64::from(v).to_be_bytes()).concat()),
    ] {
        assert_eq!(read(&image(bitpix, &[], &data)), (DN.to_vec(), Facts::default()), "{bitpix}");
    }
    let half = [0.5f32, 1.0, 2.0, 3.0, 4.0, 5.0].map(f32::to_be_bytes).concat();
    assert!(refused(&image("-32", &[], &half)).contains("0.5"));
    assert_eq!(read(&image("-32", &[("BSCALE", "2.0D0")], &half)).0, [1, 2, 4, 6, 8, 10]);
    let undefined = [9i32, 1, 2, 3, 4, 5].map(i32::to_be_bytes).concat();
    assert!(refused(&image("32", &[("BLANK", "9")], &undefined)).contains("undefined"));
    assert!(refused(&image("24", &[], &undefined)).contains("BITPIX"));
}

/// Unsigned words whose writer left out BZERO, and signed ones with some noise below zero.
#[test]
fn words_without_bzero_are_unsigned_where_they_fall_far_below_zero() {
    let (samples, facts) = read(&image("16", &[], &DN.map(u16::to_be_bytes).concat()));
    assert_eq!(samples, DN);
    assert!(facts.notes[0].contains("unsigned"), "{:?}", facts.notes);
    let noise = [-3i16, 0, 2, 5, -1, 8].map(i16::to_be_bytes).concat();
    assert!(refused(&image("16", &[], &noise)).contains("-3"));
}

#[test]
fn the_first_image_is_read_wherever_it_stands() {
    let data = DN.map(|v| (v ^ 0x8000).to_be_bytes()).concat();
    let empty = unit(&[("SIMPLE", "T"), ("BITPIX", "8"), ("NAXIS", "0")], &[]);
    let extension = |kind: &str| {
        unit(
            &[
                ("XTENSION", kind),
                ("BITPIX", "16"),
                ("NAXIS", "2"),
                ("NAXIS1", "3"),
                ("NAXIS2", "2"),
                ("PCOUNT", "0"),
                ("GCOUNT", "1"),
                ("BZERO", "32768"),
            ],
            &data,
        )
    };
    let (table, image) = (extension("'BINTABLE'"), extension("'IMAGE   '"));
    let (samples, facts) = read(&[&empty[..], &table, &image].concat());
    assert_eq!((samples, facts.notes), (DN.to_vec(), vec![]));
    let (samples, facts) = read(&[&empty[..], &image, &image].concat());
    assert_eq!(samples, DN);
    assert!(facts.notes[0].contains("1 more image"), "{:?}", facts.notes);
    assert!(refused(&empty).contains("without an image"));
    assert!(refused(&[&empty[..], &table].concat()).contains("without an image"));
}

/// What a compressed image leaves in an empty primary header holds for the image.
#[test]
fn keywords_of_an_empty_primary_header_are_taken_over() {
    let primary = unit(
        &[
            ("SIMPLE", "T"),
            ("BITPIX", "8"),
            ("NAXIS", "0"),
            ("BAYERPAT", "'GRBG    '"),
            ("ROWORDER", "'BOTTOM-UP'"),
            ("EXPTIME", "0.5"),
        ],
        &[],
    );
    let read_with = |more: &[(&str, &str)]| {
        let mut cards = vec![("XTENSION", "'IMAGE   '"), ("BITPIX", "16"), ("NAXIS", "2")];
        cards.extend([("NAXIS1", "3"), ("NAXIS2", "2"), ("PCOUNT", "0"), ("GCOUNT", "1")]);
        cards.extend(more);
        let data = [1i16, 2, 3, 4, 5, 6].map(i16::to_be_bytes).concat();
        let (samples, facts) = read(&[&primary[..], &unit(&cards, &data)].concat());
        let exposure_s = facts.taken.exposure_s.map(|said| said.value);
        (samples, facts.cfa.map(|c| c.to_string()), exposure_s, facts.notes.join("; "))
    };
    let told = |name: &str| Some(name.to_string());
    let (samples, cfa, exposure_s, notes) = read_with(&[]);
    assert_eq!((samples, cfa, exposure_s), (vec![4, 5, 6, 1, 2, 3], told("GRBG"), Some(0.5)));
    assert!(notes.contains("BAYERPAT, ROWORDER, EXPTIME: from the file's primary"), "{notes}");
    // The extension's own prevail, also by another name.
    let own = [("COLORTYP", "'RGGB    '"), ("ROWORDER", "'TOP-DOWN'"), ("EXPOSURE", "2.0")];
    let stored = vec![1, 2, 3, 4, 5, 6];
    assert_eq!(read_with(&own), (stored.clone(), told("RGGB"), Some(2.0), String::new()));
    assert_eq!(read_with(&[("INHERIT", "F")]), (stored, None, None, String::new()));
}

#[test]
fn patterns_of_camera_programs_are_read() {
    let data = [1i16, 2, 3, 4, 5, 6].map(i16::to_be_bytes).concat();
    let pattern = |more: &[(&str, &str)]| {
        let (samples, facts) = read(&image("16", more, &data));
        (samples, facts.cfa.map(|c| c.to_string()), facts.notes.join("; "))
    };
    let stored = vec![1, 2, 3, 4, 5, 6];
    let told = |name: &str| Some(name.to_string());
    let (rggb, top) = (("BAYERPAT", "'RGGB    '"), ("ROWORDER", "'TOP-DOWN'"));
    assert_eq!(pattern(&[rggb, top]), (stored.clone(), told("RGGB"), String::new()));
    let (samples, cfa, note) = pattern(&[rggb]);
    assert_eq!((samples, cfa), (stored.clone(), told("RGGB")));
    assert!(note.contains("no ROWORDER"), "{note}");
    let shifted = [rggb, top, ("XBAYROFF", "1"), ("YBAYROFF", "0")];
    assert_eq!(pattern(&shifted), (stored.clone(), told("GRBG"), String::new()));
    let down = [rggb, top, ("XBAYROFF", "0"), ("YBAYROFF", "-1.0")];
    assert_eq!(pattern(&down), (stored.clone(), told("GBRG"), String::new()));
    let (samples, cfa, note) = pattern(&[rggb, ("ROWORDER", "'BOTTOM-UP'")]);
    assert_eq!((samples, cfa), (vec![4, 5, 6, 1, 2, 3], told("RGGB")));
    assert!(note.contains("turned"), "{note}");
    let (_, cfa, note) = pattern(&[("BAYERPAT", "'TRUE'")]);
    assert!(cfa.is_none() && note.contains("TRUE"), "{note}");
    let (_, cfa, note) = pattern(&[rggb, ("YBAYROFF", "1"), ("ROWORDER", "'BOTTOM-UP'")]);
    assert!(cfa.is_none() && note.contains("YBAYROFF"), "{note}");
}

/// Axes of one value say nothing; planes of colours are no frames.
#[test]
fn further_axes_are_read_or_refused() {
    let of = |sizes: &[&str], more: &[(&str, &str)]| {
        let axes = sizes.len().to_string();
        let keys: Vec<String> = (1..=sizes.len()).map(|axis| format!("NAXIS{axis}")).collect();
        let mut cards = vec![("SIMPLE", "T"), ("BITPIX", "8"), ("NAXIS", axes.as_str())];
        cards.extend(keys.iter().map(String::as_str).zip(sizes.iter().copied()));
        cards.extend(more);
        let frames =
            decode(&unit(&cards, &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 0, 0, 0, 0, 0, 0]));
        frames.map(|f| [f.width(), f.height(), f.planes.len()]).map_err(|e| e.to_string())
    };
    assert_eq!(of(&["3", "2", "1", "1"], &[]), Ok([3, 2, 1]));
    assert_eq!(of(&["3", "2", "2", "1", "1"], &[]), Ok([3, 2, 2]));
    let error = of(&["3", "2", "1", "2"], &[]).unwrap_err();
    assert!(error.contains("NAXIS4"), "{error}");
    assert_eq!(of(&["3", "2", "3"], &[]), Ok([3, 2, 3]));
    assert_eq!(of(&["3", "2", "2"], &[("COLORTYP", "'RGB'")]), Ok([3, 2, 2]));
    for (sizes, key) in
        [(["3", "2", "3"], "CTYPE3"), (["3", "2", "3"], "COLORTYP"), (["3", "2", "2"], "CTYPE1")]
    {
        let error = of(&sizes, &[(key, "'rgb     '")]).unwrap_err();
        assert!(error.contains("colour planes") && error.contains(key), "{error}");
    }
}

#[test]
fn keywords_of_camera_programs_say_how_frames_were_taken() {
    let cards = [
        ("IMAGETYP", "'Dark Frame'"),
        ("EXPTIME", "6.0E+01"),
        ("CCD-TEMP", "-9.8"),
        ("XPIXSZ", "4.63"),
        ("GAIN", "120"),
    ];
    let taken = decode(&image("16", &cards, &[0; 12])).unwrap().facts.taken;
    assert_eq!(taken.exposure_s, Some(Said::new(60.0, "FITS EXPTIME")));
    assert_eq!(taken.temperature_c, Some(Said::new(-9.8, "FITS CCD-TEMP")));
    assert_eq!(taken.pitch_um, Some(Said::new(4.63, "FITS XPIXSZ")));
    assert_eq!(taken.kind, Some(Said::new("Dark Frame".into(), "FITS IMAGETYP")));
    // In units of the camera's own: nothing that could be taken for a factor.
    assert_eq!((taken.analog_gain, taken.remarks), (None, vec!["GAIN = 120".to_string()]));
}

/// A note longer than a card loses nothing, but what does not fit a card of its own.
#[test]
fn long_notes_are_not_cut() {
    let large = "GBGRGR/RGRBGB/GBGRGR/RGRBGB/BGBGRG/RGRGBG";
    let largest = ["RGBWRGBW"; 8].join("/");
    for (cfa, kept) in [(large, true), (&*largest, false)] {
        let facts = Facts {
            bits: Some(12),
            cfa: Cfa::parse(cfa).ok(),
            black_level_dn: Some(64.125),
            white_level_dn: Some(4095),
            ..Facts::default()
        };
        let planes = vec![Plane::filled(12, 12, 5u16)];
        let bytes = encode(&Frames { planes, facts: facts.clone() }).unwrap();
        let expected = Facts { cfa: facts.cfa.clone().filter(|_| kept), ..facts };
        let found = decode(&bytes).unwrap().facts;
        assert_eq!(Facts { taken: Taken::default(), ..found }, expected);
    }
}

/// Bits, the first one highest.
#[derive(Default)]
struct Writer(Vec<bool>);

impl Writer {
    fn put(&mut self, value: u64, count: u32) {
        self.0.extend((0..count).rev().map(|i| value >> i & 1 == 1));
    }

    fn bytes(self) -> Vec<u8> {
        let byte =
            |b: &[bool]| b.iter().enumerate().fold(0, |v, (i, &b)| v | u8::from(b) << (7 - i));
        self.0.chunks(8).map(byte).collect()
    }
}

/// Rice coding of 16 bits with the same number of low bits in each block of four; `None`: stored
/// as they are.
fn rice_coded(values: &[i16], low: Option<u32>) -> Vec<u8> {
    let mut w = Writer::default();
    let mut last = values[0];
    w.put(values[0] as u16 as u64, 16);
    for block in values.chunks(4) {
        let all_equal = block.iter().all(|v| *v == last);
        w.put(if all_equal { 0 } else { low.map_or(15, |n| u64::from(n) + 1) }, 4);
        for &v in block {
            let difference = v.wrapping_sub(last);
            let folded = u64::from(((difference << 1) ^ (difference >> 15)) as u16);
            last = v;
            match low {
                _ if all_equal => {}
                None => w.put(folded, 16),
                Some(n) => {
                    (0..folded >> n).for_each(|_| w.put(0, 1));
                    w.put(1, 1);
                    w.put(folded & ((1 << n) - 1), n);
                }
            }
        }
    }
    w.bytes()
}

#[test]
fn rice_coding_comes_back() {
    let values = [5i16, 5, 5, 5, 9, -3, 100, 42, 41, 7, 7];
    for low in [None, Some(0), Some(3), Some(13)] {
        let coded = rice_coded(&values, low);
        let back = rice::decode(&coded, values.len(), 4, 16).unwrap();
        assert_eq!(back, values.map(i64::from), "{low:?}");
        assert!(rice::decode(&coded[..coded.len() - 1], values.len(), 4, 16).is_err());
    }
    let extremes = [i16::MIN, i16::MAX, i16::MIN, -1, 0];
    let back = rice::decode(&rice_coded(&extremes, None), 5, 4, 16).unwrap();
    assert_eq!(back, extremes.map(i64::from));
}

/// An image of 3 x 2 in tiles of 2 x 2, compressed by `coded` from words, as table and heap.
fn tiled(kind: &str, coded: impl Fn(&[i16]) -> Vec<u8>) -> Vec<u8> {
    let word = |i: usize| (DN[i] ^ 0x8000) as i16;
    let tiles = [vec![word(0), word(1), word(3), word(4)], vec![word(2), word(5)]];
    let (mut table, mut heap) = (Vec::new(), Vec::new());
    for tile in &tiles {
        let bytes = coded(tile);
        table.extend((bytes.len() as u32).to_be_bytes());
        table.extend((heap.len() as u32).to_be_bytes());
        heap.extend(bytes);
    }
    let size = heap.len().to_string();
    let kind = format!("'{kind}'");
    let cards = [
        ("XTENSION", "'BINTABLE'"),
        ("BITPIX", "8"),
        ("NAXIS", "2"),
        ("NAXIS1", "8"),
        ("NAXIS2", "2"),
        ("PCOUNT", &size),
        ("GCOUNT", "1"),
        ("TFIELDS", "1"),
        ("TTYPE1", "'COMPRESSED_DATA'"),
        ("TFORM1", "'1PB(9)'"),
        ("ZIMAGE", "T"),
        ("ZBITPIX", "16"),
        ("ZNAXIS", "2"),
        ("ZNAXIS1", "3"),
        ("ZNAXIS2", "2"),
        ("ZTILE1", "2"),
        ("ZTILE2", "2"),
        ("ZCMPTYPE", &kind),
        ("ZNAME1", "'BLOCKSIZE'"),
        ("ZVAL1", "4"),
        ("ZNAME2", "'BYTEPIX'"),
        ("ZVAL2", "2"),
        ("BZERO", "32768"),
        ("BAYERPAT", "'GBRG'"),
    ];
    let empty = unit(&[("SIMPLE", "T"), ("BITPIX", "8"), ("NAXIS", "0")], &[]);
    [empty, unit(&cards, &[table, heap].concat())].concat()
}

fn gzipped(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gz.write_all(bytes).unwrap();
    gz.finish().unwrap()
}

#[test]
fn tile_compressed_images_are_read() {
    let words = |tile: &[i16]| tile.iter().flat_map(|v| v.to_be_bytes()).collect::<Vec<_>>();
    let shuffled = |tile: &[i16]| {
        let high = tile.iter().map(|v| v.to_be_bytes()[0]);
        high.chain(tile.iter().map(|v| v.to_be_bytes()[1])).collect::<Vec<_>>()
    };
    for file in [
        tiled("RICE_1", |tile| rice_coded(tile, Some(9))),
        tiled("GZIP_1", |tile| gzipped(&words(tile))),
        tiled("GZIP_2", |tile| gzipped(&shuffled(tile))),
        tiled("NOCOMPRESS", words),
    ] {
        let (samples, facts) = read(&file);
        assert_eq!((samples, facts.cfa), (DN.to_vec(), Cfa::parse("GBRG").ok()));
        for length in (2880..file.len()).step_by(40) {
            // Padding at the end is not needed.
            if let Ok(frames) = decode(&file[..length]) {
                assert_eq!(frames.planes[0].data, DN);
            }
        }
    }
    let other = tiled("HCOMPRESS_1", words);
    assert!(refused(&other).contains("HCOMPRESS_1"));
}

/// Sizes that the bytes cannot hold cost no memory.
#[test]
fn lying_sizes_are_refused() {
    let text = |file: &[u8], from: &str, to: &str| {
        let at = file.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
        let mut file = file.to_vec();
        file[at..at + from.len()].copy_from_slice(to.as_bytes());
        file
    };
    let file = tiled("RICE_1", |tile| rice_coded(tile, Some(9)));
    let huge = "ZNAXIS1 =           2000000000";
    assert!(decode(&text(&file, "ZNAXIS1 =                    3", huge)).is_err());
    let plain = image("16", &[], &DN.map(u16::to_be_bytes).concat());
    let huge = "NAXIS1  =  9000000000000000000";
    assert!(decode(&text(&plain, "NAXIS1  =                    3", huge)).is_err());
}
