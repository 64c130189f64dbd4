//! Names of every tradition, and packings against bytes from their documents.

use super::*;

fn named(name: &str) -> String {
    PixelFormat::parse(name).map_or_else(|e| e.to_string(), |f| format!("{f} {:?}", f.layout))
}

#[test]
fn names_of_every_tradition_are_known() {
    for (name, expected) in [
        ("SRGGB10", "SRGGB10 Words"),
        ("SRGGB10P", "SRGGB10P Mipi"),
        ("pRAA", "SRGGB10P Mipi"),
        ("pGAA", "SGBRG10P Mipi"),
        ("pgAA", "SGRBG10P Mipi"),
        ("RG12", "SRGGB12 Words"),
        ("BYR2", "SBGGR16 Words"),
        ("SGRBG12_CSI2P", "SGRBG12P Mipi"),
        ("R10_CSI2P", "Y10P Mipi"),
        ("R16", "Y16 Words"),
        ("Y16-BE", "Y16_BE WordsBig"),
        ("SRGGB12_BE", "SRGGB12_BE WordsBig"),
        ("BayerRG12p", "BayerRG12p LowestFirst"),
        ("BayerGB10", "SGBRG10 Words"),
        ("Mono12p", "Mono12p LowestFirst"),
        ("Mono12Packed", "Mono12Packed GigE"),
        ("BayerBG10Packed", "BayerBG10Packed GigE"),
        ("Mono8", "Y8 Words"),
        ("bayer_grbg16le", "SGRBG16 Words"),
        ("bayer_bggr8", "SBGGR8 Words"),
        ("gray12be", "Y12_BE WordsBig"),
        ("GREY", "Y8 Words"),
    ] {
        assert_eq!(named(name), expected, "{name}");
    }
    for name in ["RGGB", "SRGGB", "SRGGB9", "SRGGB8P", "Mono16p", "gray12", "P", "_BE", "Mono"] {
        assert!(named(name).contains("pixel format"), "{name}: {}", named(name));
    }
}

#[test]
fn file_names_say_format_and_size() {
    let of = |name: &str| match PixelFormat::from_file_name(Path::new(name)) {
        Ok((pixels, size)) => format!("{pixels} {size:?}"),
        Err(e) => e.to_string(),
    };
    assert_eq!(of("a_64x48_SRGGB10_CSI2P.raw"), "SRGGB10P Some((64, 48))");
    assert_eq!(of("SGRBG12_640x480_frame_7.bin"), "SGRBG12 Some((640, 480))");
    assert_eq!(of("a_BayerRG12p_64x48.RAW"), "BayerRG12p Some((64, 48))");
    assert!(of("a_64x48_SRGGB10_IPU3.raw").contains("SRGGB10_IPU3"));
    assert!(of("a_64x48_RGGB.raw").contains("no pixel format"));
    // The same said twice, and factors that are no sizes.
    assert_eq!(of("SRGGB10P_64x48_64x48_pRAA.raw"), "SRGGB10P Some((64, 48))");
    assert_eq!(of("8x_64x48_SRGGB12_x2.raw"), "SRGGB12 Some((64, 48))");
    for (name, said) in [
        ("a_64x48_SRGGB12_2x2.raw", "two sizes"),
        ("a_64x48_SRGGB12_2x2.raw", "64x48 and 2x2"),
        ("SRGGB12_64x48_Y8.raw", "two pixel formats"),
        ("SRGGB12_64x48_R10.raw", "SRGGB12 and R10"),
        ("Y8_64x48_SRGGB10_CSI2P.raw", "Y8 and SRGGB10_CSI2P"),
    ] {
        assert!(of(name).contains(said) && of(name).contains("--from"), "{}", of(name));
    }
    assert!(PixelFormat::is_headerless(Path::new("a.RAW")));
    assert!(PixelFormat::is_headerless(Path::new("a.Bin")));
}

/// Two pixels, 0xABC and 0x123: PFNC 2.4 `Mono12p`, GigE Vision `Mono12Packed`, and four of 10
/// bits in both.
#[test]
fn packings_of_machine_vision() {
    for (name, samples, bytes) in [
        ("Mono12p", &[0xABC, 0x123][..], &[0xBC, 0x3A, 0x12][..]),
        ("Mono12Packed", &[0xABC, 0x123], &[0xAB, 0x3C, 0x12]),
        ("Mono10p", &[0x3FF, 0, 0x155, 0x2AA], &[0xFF, 0x03, 0x50, 0x95, 0xAA]),
        ("Mono10Packed", &[0x3FD, 0x002], &[0xFF, 0x21, 0x00]),
    ] {
        let pixels = PixelFormat::parse(name).unwrap();
        let back = pixels.decode(bytes, samples.len(), 1, None).unwrap();
        assert_eq!(back.planes[0].data, samples, "{name}");
        assert_eq!(pixels.encode(&back, None).unwrap(), bytes, "{name}");
        let error = pixels.decode(bytes, 1, 1, None).unwrap_err().to_string();
        assert!(error.contains("1 pixels, packed"), "{error}");
    }
}

/// A Raspberry Pi 5's compression under the names of V4L2 and libcamera; nothing writes it.
#[test]
fn raw_of_a_raspberry_pi_5_is_read() {
    let word = 0x7921_d6b9u32.to_le_bytes();
    let bytes = [word, word].concat();
    for (name, cfa) in [
        ("PC1R", "RGGB"),
        ("GBRG_PISP_COMP1", "GBRG"),
        ("PC1g", "GBRG"),
        ("mono_pisp_comp1", "mono"),
    ] {
        let pixels = PixelFormat::parse(name).unwrap();
        assert_eq!(PixelFormat::parse(&pixels.to_string()).unwrap(), pixels);
        let back = pixels.decode(&bytes, 7, 1, None).unwrap();
        assert_eq!(back.planes[0].data[4..], [29568, 29568, 29312]);
        assert_eq!(back.facts.cfa, Cfa::parse(cfa).ok());
        assert!(back.facts.notes[0].contains("with loss"));
        assert!(pixels.encode(&back, None).is_err());
    }
    let named = PixelFormat::from_file_name(Path::new("a_64x8_BGGR_PISP_COMP1.raw")).unwrap();
    assert_eq!((named.0.to_string().as_str(), named.1), ("BGGR_PISP_COMP1", Some((64, 8))));
}

/// Rows of 4 bytes in rows of 6: what is written is read.
#[test]
fn rows_are_padded_on_output() {
    let data = vec![1, 2, 3, 4];
    let planes = vec![Plane { width: 2, height: 2, data }];
    let frames = Frames { planes, facts: Facts::default() };
    let words = PixelFormat::parse("Y12").unwrap();
    let bytes = words.encode(&frames, Some(6)).unwrap();
    assert_eq!(bytes, [1, 0, 2, 0, 0, 0, 3, 0, 4, 0, 0, 0]);
    assert_eq!(words.decode(&bytes, 2, 2, Some(6)).unwrap().planes, frames.planes);
    assert!(words.encode(&frames, Some(3)).unwrap_err().to_string().contains("takes 4"));
    assert!(words.encode(&frames, Some(usize::MAX)).is_err());
}

/// A pattern without a name goes out as words without colour filters, with a note; a Bayer pattern
/// has names of its own.
#[test]
fn patterns_without_a_name_are_left_out_and_told() {
    let mut frames = Frames {
        planes: vec![Plane { width: 4, height: 1, data: vec![1, 2, 3, 0xFFF] }],
        facts: Facts::default(),
    };
    let words = PixelFormat::parse("Y12").unwrap();
    for cfa in ["RRGG/RRGG/GGBB/GGBB", "RC/CC", "BGRG/GIGI/RGBG/GIGI"] {
        frames.facts.cfa = Some(Cfa::parse(cfa).unwrap());
        assert_eq!(words.encode(&frames, None).unwrap(), [1, 0, 2, 0, 3, 0, 0xFF, 0x0F], "{cfa}");
        assert!(words.leaves_out(&frames.facts).unwrap().contains("pattern"));
        assert!(PixelFormat::parse("SRGGB12").unwrap().encode(&frames, None).is_err());
    }
    frames.facts.cfa = Some(Cfa::parse("RGGB").unwrap());
    assert!(words.encode(&frames, None).is_err());
    frames.facts.cfa = Some(Cfa::parse("mono").unwrap());
    assert_eq!(words.leaves_out(&frames.facts), None);
}

/// Files that are not whole frames: rows of 5 bytes of which the file has 8 each, with and without
/// the stride; a file cut off within its first frame.
#[test]
fn padded_rows_are_asked_for() {
    let pixels = PixelFormat::parse("SRGGB10P").unwrap();
    let refused =
        |bytes: &[u8], stride| pixels.decode(bytes, 4, 6, stride).unwrap_err().to_string();
    for frames in [1, 3] {
        let bytes = vec![0; frames * 6 * 8];
        let error = refused(&bytes, None);
        assert!(error.contains("frames of 30 bytes") && error.contains("to 8 bytes"), "{error}");
        assert_eq!(pixels.decode(&bytes, 4, 6, Some(8)).unwrap().planes.len(), frames);
    }
    let error = refused(&[0; 61], None);
    assert!(error.contains("61 bytes") && !error.contains("padded"), "{error}");
    assert!(refused(&[0; 50], Some(8)).contains("frames of 48 bytes"));
    assert!(refused(&[0; 29], None).contains("30 bytes needed, 29 there"));
}
