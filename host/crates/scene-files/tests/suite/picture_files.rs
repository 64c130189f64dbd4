//! Pictures of every kind as scenes.

use camrig_light::colour::smoothest::{Domain, Smoothest, white};
use camrig_light::colour::space::{REC2020, Space};
use camrig_light::colour::transfer::Transfer;
use camrig_light::photometry::observer;
use camrig_scene::cube::Cube;
use camrig_scene::level::check_absolute;
use camrig_scene::{Quantity, Scene};
use camrig_scene_files::open_file;
use exr::prelude::*;
use png::chunk::ChunkType;
use std::fs::File;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use tiff::encoder::{Rational, TiffEncoder, colortype};
use tiff::tags::Tag;

/// Patch 1 of the ColorChecker, and its linear light.
const CODES: [u8; 3] = [122, 82, 64];
const LINEAR: [f64; 3] = [0.194_618, 0.084_376, 0.051_269];

fn opened(path: &Path, options: &str) -> Cube {
    open_file(&format!("{}:{options}", path.display())).unwrap()
}

fn refused(path: &Path, options: &str) -> String {
    open_file(&format!("{}:{options}", path.display())).err().unwrap().to_string()
}

/// Linear sRGB of a pixel of the scene; of a radiance per cd/m².
fn colour(cube: &Cube, x: usize, y: usize) -> [f64; 3] {
    let (domain, unit) = match cube.quantity() {
        Quantity::Reflectance => (Domain::Reflectance, [1.0; 31]),
        Quantity::Radiance => (Domain::Emission, white().unwrap()),
    };
    let values = std::array::from_fn(|b| f64::from(cube.band(b).unwrap().at(x, y)) / unit[b]);
    Smoothest::new(domain).unwrap().colour(&values)
}

fn near(found: [f64; 3], expected: [f64; 3], tolerance: f64) {
    for c in 0..3 {
        assert!((found[c] - expected[c]).abs() < tolerance, "{found:?}, not {expected:?}");
    }
}

fn said(cube: &Cube) -> String {
    cube.understood().iter().cloned().chain(cube.notes()).collect::<Vec<_>>().join("\n")
}

/// A PNG of 2 x 1 pixels.
fn png(path: &Path, kind: png::ColorType, bits: png::BitDepth, data: &[u8]) {
    png_with(path, kind, bits, data, &[], |_| ());
}

fn png_with(
    path: &Path,
    kind: png::ColorType,
    bits: png::BitDepth,
    data: &[u8],
    chunks: &[(ChunkType, &[u8])],
    more: impl FnOnce(&mut png::Info<'static>),
) {
    let mut info = png::Info::with_size(2, 1);
    (info.color_type, info.bit_depth) = (kind, bits);
    more(&mut info);
    let encoder = png::Encoder::with_info(File::create(path).unwrap(), info).unwrap();
    let mut writer = encoder.write_header().unwrap();
    chunks.iter().for_each(|(kind, data)| writer.write_chunk(*kind, data).unwrap());
    writer.write_image_data(data).unwrap();
}

fn place(name: &str) -> (TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    (dir, path)
}

#[test]
fn png_of_every_kind_is_read() {
    use png::{BitDepth, ColorType};
    let (_dir, path) = place("photo.png");
    let two = |p: &[u8]| [p, p].concat();
    png(&path, ColorType::Rgb, BitDepth::Eight, &two(&CODES));
    let cube = opened(&path, "");
    assert_eq!((cube.size(), cube.quantity()), ((2, 1), Quantity::Reflectance));
    near(colour(&cube, 1, 0), LINEAR, 2e-5);
    assert!(said(&cube).contains("sRGB is assumed"), "{}", said(&cube));
    assert!(said(&cube).contains("ColorChecker"), "{}", said(&cube));

    let wide: Vec<u8> = CODES.iter().flat_map(|&c| (u16::from(c) * 257).to_be_bytes()).collect();
    png(&path, ColorType::Rgb, BitDepth::Sixteen, &two(&wide));
    near(colour(&opened(&path, ""), 0, 0), LINEAR, 2e-5);
    png(&path, ColorType::Rgba, BitDepth::Eight, &two(&[122, 82, 64, 9]));
    let cube = opened(&path, "");
    near(colour(&cube, 0, 0), LINEAR, 2e-5);
    assert!(said(&cube).contains("alpha"), "{}", said(&cube));
    let palette = |info: &mut png::Info<'static>| {
        info.palette = Some(vec![0, 0, 0, 122, 82, 64].into());
    };
    png_with(&path, ColorType::Indexed, BitDepth::One, &[0b0100_0000], &[], palette);
    let cube = opened(&path, "");
    near(colour(&cube, 1, 0), LINEAR, 2e-5);
    assert!(cube.band(9).unwrap().data[0] < 1e-5);
    for (bits, data) in [(BitDepth::Eight, vec![118, 255]), (BitDepth::Four, vec![0x7f])] {
        png(&path, ColorType::Grayscale, bits, &data);
        let grey = if data.len() == 2 { 0.181_164 } else { 0.184_475 };
        let cube = opened(&path, "");
        for band in [0, 12, 30] {
            // Greys are flat to 0.4 % of themselves, white is.
            let plane = cube.band(band).unwrap();
            assert!((f64::from(plane.data[0]) / grey - 1.0).abs() < 4e-3, "{plane:?}");
            assert_eq!(plane.data[1], 1.0);
        }
    }
}

#[test]
fn what_a_png_says_of_its_colours_is_heeded() {
    use png::{BitDepth, ColorType, chunk};
    let (_dir, path) = place("photo.png");
    let data = [128, 128, 128, 255, 255, 255];
    let write = |chunks: &[(ChunkType, &[u8])], profile: Option<&[u8]>| {
        png_with(&path, ColorType::Rgb, BitDepth::Eight, &data, chunks, |info| {
            info.icc_profile = profile.map(|p| p.to_vec().into());
        });
    };
    let close = |options: &str, expected: f64, words: &str| {
        let cube = opened(&path, options);
        let (found, said) = (colour(&cube, 0, 0)[1], said(&cube));
        assert!((found - expected).abs() < 2e-5 && said.contains(words), "{found}: {said}");
    };
    let code = 128.0 / 255.0;
    let (srgb, power) = (0.215_861, |g: f64| f64::powf(code, g));
    write(&[(chunk::sRGB, &[0])], None);
    close("", srgb, "chunk sRGB");
    write(&[(chunk::gAMA, &50_000u32.to_be_bytes())], None);
    close("", power(2.0), "gAMA");
    close("primaries=linear-srgb", code, "linear Rec. 709");
    close("primaries=srgb,transfer=1.8", power(1.8), "power 1.8");
    // Rec. 2020 with linear samples; then with the curve of PQ.
    write(&[(chunk::cICP, &[9, 8, 0, 1])], None);
    close("", code, "cICP");
    write(&[(chunk::cICP, &[9, 16, 0, 1])], None);
    assert!(refused(&path, "").contains("primaries="));
    // The range of video, whatever its colours are said to be.
    write(&[(chunk::cICP, &[1, 13, 0, 0])], None);
    assert!(refused(&path, "primaries=srgb").contains("limited range"));
    write(&[], Some(&moxcms::ColorProfile::new_display_p3().encode().unwrap()));
    close("", srgb, "ICC profile");
    write(&[], Some(&[1; 200]));
    close("", srgb, "an ICC profile that cannot be read: sRGB is assumed");
}

/// A chunk of a PNG, with its CRC.
fn chunk(file: &mut Vec<u8>, kind: &[u8; 4], data: &[u8]) {
    let body = [kind, data].concat();
    file.extend((data.len() as u32).to_be_bytes());
    file.extend(&body);
    file.extend(crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&body).to_be_bytes());
}

#[test]
fn palettes_that_are_no_list_of_colours_are_refused() {
    let (_dir, path) = place("palette.png");
    // Filter and value of the one pixel, as a deflate block that is stored.
    let pixel = [&[0x78, 0x01, 0x01, 2, 0, 0xfd, 0xff, 0, 0][..], &[0, 2, 0, 1]].concat();
    let write = |palette: usize| {
        let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
        chunk(&mut file, b"IHDR", &[0, 0, 0, 1, 0, 0, 0, 1, 8, 3, 0, 0, 0]);
        chunk(&mut file, b"PLTE", &vec![77; palette]);
        chunk(&mut file, b"IDAT", &pixel);
        chunk(&mut file, b"IEND", b"");
        std::fs::write(&path, file).unwrap();
    };
    for bytes in [3, 6, 768] {
        write(bytes);
        assert_eq!(opened(&path, "").size(), (1, 1), "{bytes}");
    }
    for bytes in [1, 5, 554, 771] {
        write(bytes);
        let error = refused(&path, "");
        assert!(error.contains("PLTE") || error.contains("PNG"), "{bytes}: {error}");
    }
}

#[test]
fn jpeg_is_read_turned_and_refused_for_print() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let cube = opened(&data.join("colour.jpg"), "");
    assert_eq!(cube.size(), (16, 8));
    // A code of rounding in YCbCr.
    near(colour(&cube, 3, 3), LINEAR, 4e-3);
    let message = refused(&data.join("cmyk.jpg"), "");
    assert!(message.contains("four inks"), "{message}");

    let (_dir, path) = place("turned.jpeg");
    let whole = std::fs::read(data.join("colour.jpg")).unwrap();
    let exif = b"\xff\xe1\x00\x22Exif\0\0II\x2a\0\x08\0\0\0\x01\0\
        \x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    let turned = [&whole[..2], exif, &whole[2..]].concat();
    std::fs::write(&path, turned).unwrap();
    assert_eq!(opened(&path, "").size(), (8, 16));
    std::fs::write(&path, &whole[..whole.len() - 20]).unwrap();
    assert!(refused(&path, "").contains("JPEG"));
}

/// Pixels twice as wide as high, said by each kind of file in its own way, as ffmpeg writes frames
/// of anamorphic video; a resolution that is the same in both directions says nothing.
#[test]
fn pixels_that_are_not_square_are_refused() {
    use png::{BitDepth, ColorType, chunk};
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let jpeg = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/colour.jpg");
    let jpeg = std::fs::read(jpeg).unwrap();
    let jfif = |x: u8, y: u8| {
        let app0 = [&b"\xff\xe0\0\x10JFIF\0\x01\x02\0"[..], &[0, x, 0, y, 0, 0]].concat();
        // In place of its own header, which is of the same length.
        [&jpeg[..2], &app0, &jpeg[20..]].concat()
    };
    for (across, square) in [(72u8, true), (36, false)] {
        let dims = [0, 0, 0, across, 0, 0, 0, 72, 0];
        let grey = (ColorType::Grayscale, BitDepth::Eight);
        png_with(&at("a.png"), grey.0, grey.1, &[9, 9], &[(chunk::pHYs, &dims)], |_| ());
        std::fs::write(at("a.jpg"), jfif(across, 72)).unwrap();
        let mut tiff = TiffEncoder::new(File::create(at("a.tif")).unwrap()).unwrap();
        let mut image = tiff.new_image::<colortype::Gray8>(1, 1).unwrap();
        image.x_resolution(Rational { n: across.into(), d: 1 });
        image.y_resolution(Rational { n: 72, d: 1 });
        image.write_data(&[9]).unwrap();
        exr(&at("a.exr"), &["Y"], &[[0.2; 2]], |image| {
            image.attributes.pixel_aspect = 72.0 / f32::from(across);
        });
        for name in ["a.png", "a.jpg", "a.tif", "a.exr"] {
            match square {
                true => drop(opened(&at(name), "as=reflectance")),
                false => {
                    let said = refused(&at(name), "");
                    assert!(said.contains("pixels 2.0000 times as wide"), "{name}: {said}");
                }
            }
        }
    }
}

#[test]
fn tiff_of_integers_and_floats_is_read() {
    let (_dir, path) = place("picture.tif");
    let encoder = || TiffEncoder::new(File::create(&path).unwrap()).unwrap();
    let wide = CODES.map(|c| u16::from(c) * 257);
    encoder().write_image::<colortype::RGB16>(1, 1, &wide).unwrap();
    near(colour(&opened(&path, ""), 0, 0), LINEAR, 2e-5);
    let most = CODES.map(|c| u32::from(c) * 0x0101_0101);
    encoder().write_image::<colortype::RGB32>(1, 1, &most).unwrap();
    near(colour(&opened(&path, ""), 0, 0), LINEAR, 2e-5);
    let floats = LINEAR.map(|v| v as f32);
    encoder().write_image::<colortype::RGB32Float>(1, 1, &floats).unwrap();
    let cube = opened(&path, "");
    assert_eq!(cube.quantity(), Quantity::Radiance);
    near(colour(&cube, 0, 0), LINEAR, 1e-5);
    let cube = opened(&path, "as=reflectance");
    assert_eq!(cube.quantity(), Quantity::Reflectance);
    near(colour(&cube, 0, 0), LINEAR, 2e-5);
    encoder().write_image::<colortype::Gray8>(1, 1, &[118]).unwrap();
    near(colour(&opened(&path, ""), 0, 0), [0.181_164; 3], 2e-5);
    // Chromaticities of Rec. 2020 and D65, as rationals, with the curve of sRGB.
    let mut tiff = encoder();
    let mut image = tiff.new_image::<colortype::RGB16>(1, 1).unwrap();
    let list = |all: &[f64]| -> Vec<_> {
        let rational = |v: &f64| Rational { n: (1e4 * v).round() as u32, d: 10_000 };
        all.iter().map(rational).collect()
    };
    let white = list(&REC2020[3]);
    image.encoder().write_tag(Tag::Unknown(318), &white[..]).unwrap();
    let primaries = list(&REC2020[..3].concat());
    image.encoder().write_tag(Tag::Unknown(319), &primaries[..]).unwrap();
    image.write_data(&wide).unwrap();
    let cube = opened(&path, "");
    let rec2020 = Space::of("", &REC2020, Transfer::Srgb).unwrap();
    let expected = rec2020.linear_srgb_of(LINEAR);
    near(colour(&cube, 0, 0), expected, 2e-5);
    assert!(expected[0] > 1.1 * LINEAR[0], "{expected:?}");
    assert!(said(&cube).contains("its tags of primaries"), "{}", said(&cube));
    encoder().write_image::<colortype::CMYK8>(1, 1, &[1, 2, 3, 4]).unwrap();
    assert!(refused(&path, "").contains("CMYK"));
}

fn exr(
    path: &Path,
    names: &[&str],
    pixels: &[[f32; 2]],
    more: impl Fn(&mut Image<Layer<AnyChannels<FlatSamples>>>),
) {
    let channels = names.iter().zip(pixels);
    let channels: Vec<_> =
        channels.map(|(n, v)| AnyChannel::new(*n, FlatSamples::F32(v.to_vec()))).collect();
    let channels = AnyChannels::sort(channels.into());
    let attributes = LayerAttributes::named("render");
    let mut image =
        Image::from_layer(Layer::new((2, 1), attributes, Encoding::UNCOMPRESSED, channels));
    more(&mut image);
    image.write().to_file(path).unwrap();
}

#[test]
fn renders_are_radiance_with_a_scale_and_a_white() {
    let (_dir, path) = place("render.exr");
    let rgb = [[0.2, 8.0], [0.1, 4.0], [0.05, 2.0]];
    exr(&path, &["R", "G", "B"], &rgb, |_| ());
    let cube = opened(&path, "");
    near(colour(&cube, 0, 0), [0.2, 0.1, 0.05], 1e-5);
    near(colour(&cube, 1, 0), [8.0, 4.0, 2.0], 1e-3);
    let y = |s: f64| s * (0.2126 * 0.2 + 0.7152 * 0.1 + 0.0722 * 0.05);
    // The 99th percentile of two pixels is the lower one, whose Y is below 1.
    let white = cube.white().unwrap();
    assert_eq!((white.luminance, white.absolute), (1.0, false));
    let patch = opened(&path, "white=1,0,1,1");
    let white = patch.white().unwrap();
    assert!((white.luminance / y(40.0) - 1.0).abs() < 1e-3, "{white:?}");
    assert!(refused(&path, "white=1,0,2,1").contains("column, row"));
    assert!(check_absolute(&cube).unwrap_err().to_string().contains("scale"));
    let scaled = opened(&path, "scale=250");
    assert!(check_absolute(&scaled).is_ok());
    // 683 Σ L V Δλ by the bands.
    let [_, v, _] = observer();
    let luminance: f64 = (0..31)
        .map(|b| {
            let nm = camrig_scene::Bands::VISIBLE.nm(b);
            6830.0 * f64::from(scaled.band(b).unwrap().data[1]) * v.at(nm)
        })
        .sum();
    assert!((luminance / (250.0 * y(40.0)) - 1.0).abs() < 1e-4, "{luminance}");

    exr(&path, &["R", "G", "B", "A"], &[rgb[0], rgb[1], rgb[2], [1.0; 2]], |image| {
        image.layer_data.attributes.white_luminance = Some(80.0);
        image.attributes.chromaticities = Some(attribute::Chromaticities {
            red: Vec2(0.713, 0.293),
            green: Vec2(0.165, 0.830),
            blue: Vec2(0.128, 0.044),
            white: Vec2(0.32168, 0.33767),
        });
    });
    let cube = opened(&path, "");
    assert_eq!(cube.white().unwrap().luminance, 80.0);
    let aces = colour(&cube, 0, 0).map(|v| v / 80.0);
    near(aces, [0.2747, 0.0875, 0.0400], 2e-4);
    near(colour(&opened(&path, "primaries=acescg"), 0, 0).map(|v| v / 80.0), aces, 1e-6);
    assert!(said(&cube).contains("not used: A"), "{}", said(&cube));

    exr(&path, &["X", "Y", "Z"], &[[0.95047; 2], [1.0; 2], [1.08883; 2]], |_| ());
    near(colour(&opened(&path, ""), 0, 0), [1.0; 3], 5e-4);
    exr(&path, &["Y", "RY", "BY"], &rgb, |_| ());
    assert!(refused(&path, "").contains("RY"));
}

/// Two pixels in a display window of four by three, one of them beyond its right edge.
#[test]
fn a_render_is_seen_through_its_display_window() {
    let (_dir, path) = place("crop.exr");
    exr(&path, &["Y"], &[[0.2, 0.7]], |image| {
        image.attributes.display_window = IntegerBounds::new((10, 20), (4, 3));
        image.layer_data.attributes.layer_position = Vec2(13, 21);
    });
    let cube = opened(&path, "as=reflectance");
    assert_eq!(cube.size(), (4, 3));
    let plane = cube.band(12).unwrap();
    let lit: Vec<usize> = (0..12).filter(|i| plane.data[*i] != 0.0).collect();
    assert_eq!(lit, [7], "{plane:?}");
    assert!((plane.data[7] / 0.2 - 1.0).abs() < 4e-3, "{plane:?}");
    let words = "2 x 1 from column 3, row 1 on, are not those of its display window of 4 x 3";
    assert!(said(&cube).contains(words), "{}", said(&cube));
    exr(&path, &["Y"], &[[0.2, 0.7]], |image| {
        image.attributes.display_window = IntegerBounds::new((0, 0), (30_000, 30_000));
    });
    assert!(refused(&path, "").contains("30000 x 30000 pixels"), "{}", refused(&path, ""));
}

#[test]
fn radiance_pictures_are_divided_by_their_exposure() {
    let (_dir, path) = place("probe.hdr");
    let write = |lines: &str, pixel: [u8; 4]| {
        let mut bytes = format!("#?RADIANCE\n{lines}\n\n-Y 1 +X 2\n").into_bytes();
        bytes.extend([pixel, pixel].concat());
        std::fs::write(&path, bytes).unwrap();
    };
    // 64/256, 128/256 and 32/256 times 2.
    write("FORMAT=32-bit_rle_rgbe\nEXPOSURE=0.5\nEXPOSURE=0.5", [64, 128, 32, 129]);
    let cube = opened(&path, "");
    near(colour(&cube, 1, 0), [2.0, 4.0, 1.0], 1e-4);
    assert!(said(&cube).contains("EXPOSURE"), "{}", said(&cube));
    write("FORMAT=32-bit_rle_xyze", [122, 128, 139, 129]);
    // Half a step of 1/128, times 3.24 of the matrix.
    near(colour(&opened(&path, ""), 0, 0), [1.0; 3], 1.3e-2);
    write("EXPOSURE=dark", [1, 1, 1, 128]);
    assert!(refused(&path, "").contains("EXPOSURE=dark"));
    write("PRIMARIES=0.64 0.33 0.30 0.60 0.15 0.06 0.3127 0.3290", [64, 128, 32, 129]);
    near(colour(&opened(&path, ""), 0, 0), [0.5, 1.0, 0.25], 1e-4);
}

#[test]
fn numbers_that_are_no_light_are_refused_or_told() {
    let (_dir, path) = place("render.exr");
    exr(&path, &["R", "G", "B"], &[[0.2, f32::NAN], [0.1; 2], [0.1; 2]], |_| ());
    assert!(refused(&path, "").contains("column 1, row 0"));
    exr(&path, &["R", "G", "B"], &[[0.2, -0.2], [0.2, -0.2], [0.2, -0.2]], |_| ());
    let cube = opened(&path, "");
    assert!(said(&cube).contains("1 pixel of negative luminance"), "{}", said(&cube));
    assert_eq!(cube.band(4).unwrap().data[1], 0.0);
    exr(&path, &["R", "G", "B"], &[[-0.2; 2], [-0.2; 2], [-0.2; 2]], |_| ());
    assert!(refused(&path, "").contains("negative luminance"));
    // A green that no surface has, and a highlight.
    exr(&path, &["R", "G", "B"], &[[-0.9, 2.0], [1.0, 2.0], [-0.5, 2.0]], |_| ());
    let cube = opened(&path, "as=reflectance");
    assert!(said(&cube).contains("2 pixels (100.00 %)"), "{}", said(&cube));
    assert!(cube.band(15).unwrap().data.iter().all(|v| (0.0..=1.0).contains(v)));
    for options in ["as=photo", "primaries=rgb", "transfer=cineon", "quantity=radiance", "scale=0"]
    {
        refused(&path, options);
    }
    assert!(refused(&path, "as=reflectance,scale=2").contains("scale"));
}

/// Cutting and corrupting a file gives an error or other values, never a panic.
#[test]
fn damage_is_survived() {
    let dir = tempfile::tempdir().unwrap();
    let source = dir.path().join("whole.png");
    png(&source, png::ColorType::Rgb, png::BitDepth::Eight, &[1, 2, 3, 200, 100, 50]);
    let render = dir.path().join("whole.exr");
    exr(&render, &["R", "G", "B"], &[[0.2, 1.0]; 3], |_| ());
    let stack = dir.path().join("whole.tif");
    let mut encoder = TiffEncoder::new(File::create(&stack).unwrap()).unwrap();
    encoder.write_image::<colortype::RGB8>(1, 1, &CODES).unwrap();
    let probe = dir.path().join("whole.hdr");
    std::fs::write(&probe, b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n\x40\x80\x20\x81")
        .unwrap();
    let jpeg = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/colour.jpg");
    for file in [source, render, stack, probe, jpeg] {
        let whole = std::fs::read(&file).unwrap();
        let damaged = dir.path().join("damaged").with_extension(file.extension().unwrap());
        let attempt = |bytes: &[u8]| {
            std::fs::write(&damaged, bytes).unwrap();
            open_file(&damaged.display().to_string()).and_then(|cube| cube.band(0)).is_ok()
        };
        assert!(attempt(&whole) && !attempt(&whole[..whole.len() / 3]), "{}", file.display());
        for i in 0..whole.len() {
            attempt(&whole[..i]);
            let mut other = whole.clone();
            other[i] ^= 0x5a;
            attempt(&other);
        }
    }
}
