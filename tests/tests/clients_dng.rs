//! Real programs read our files: every sample, the levels, the pattern, the metadata, the colours.

use camrig::RawFrame;
use camrig::camera::Cfa;
use camrig::formats::opcodes::{GainMap, Opcode};
use camrig::formats::pixel_format::Layout;
use camrig::formats::{ColorMatrix, DngInfo, Format, Frames, PixelFormat, decode, dng};
use camrig_tests::{client, run};
use std::path::PathBuf;

const WIDTH: usize = 64;
const HEIGHT: usize = 48;
const BAYER: [&str; 4] = ["RGGB", "GRBG", "GBRG", "BGGR"];

/// Pseudo-random DN over the whole range.
fn frame(bits: u32, cfa: &str) -> RawFrame {
    let top = ((1u32 << bits) - 1) as u16;
    let samples = (0..WIDTH * HEIGHT).map(|i| (i.wrapping_mul(2654435761) >> 7) as u16 & top);
    RawFrame {
        width: WIDTH,
        height: HEIGHT,
        bits,
        cfa: Cfa::parse(cfa).unwrap(),
        black_level_dn: f64::from(top / 16),
        white_level_dn: top - top / 64,
        data: samples.collect(),
    }
}

fn info() -> DngInfo {
    DngInfo {
        model: "client test".into(),
        description: "seed 1, frame 0".into(),
        exposure_s: Some(0.02),
        iso: Some(200),
        f_number: Some(2.8),
        focal_length_mm: Some(3.6),
        color_matrices: vec![
            ColorMatrix::of_a([[1.1, -0.3, -0.05], [-0.4, 1.2, 0.2], [-0.1, 0.25, 0.7]]),
            ColorMatrix::of_d65([[0.9, -0.2, -0.1], [-0.5, 1.3, 0.2], [-0.1, 0.3, 0.6]]),
        ],
        as_shot_neutral: Some([0.5, 1.0, 0.625]),
        noise_profile: vec![(1e-4, 2e-7), (1.1e-4, 2e-7), (1e-4, 3e-7)],
        ..DngInfo::default()
    }
}

/// A file in a temporary folder, which is removed with the guard.
fn file(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// Every pattern with every bit depth.
fn variants() -> impl Iterator<Item = RawFrame> {
    [10, 12, 14, 16].into_iter().flat_map(|bits| BAYER.map(|cfa| frame(bits, cfa)))
}

/// All codes of 12 bits, companded as AMD's Vitis `hdr_decompand` and TI's ISPs expect it, with its
/// published inverse, of which 16 bits are kept.
fn companded() -> (RawFrame, DngInfo) {
    let linear = |c: u32| match c {
        0..512 => 4 * c,
        512..1408 => 16 * (c - 384),
        1408..2176 => 64 * (c - 1152),
        _ => 512 * (c - 2048),
    };
    let raw = RawFrame { height: 64, data: (0..4096).collect(), ..frame(12, "RGGB") };
    let linearization = (0..4096).map(|c| (linear(c) >> 4) as u16).collect();
    let black_levels_dn = vec![10.5; 4];
    (raw, DngInfo { linearization, black_levels_dn, ..info() })
}

#[test]
fn dcraw_libraw_and_our_reader_undo_a_curve() {
    let (raw, info) = companded();
    let (_folder, path) = file("a.dng", &dng::encode(&raw, &info).unwrap());
    let own = decode(&std::fs::read(&path).unwrap()).unwrap();
    assert_eq!(own.planes[0].data, info.linearization);
    let white = info.linearization[usize::from(raw.white_level_dn)];
    let facts = &own.facts;
    assert_eq!(
        (facts.bits, facts.black_level_dn, facts.white_level_dn),
        (Some(16), Some(10.5), Some(white))
    );
    if let Some(dcraw) = client("dcraw") {
        let pgm = run(&dcraw, &[&"-D", &"-4", &"-c", &path]);
        assert_eq!(decode(&pgm).unwrap().planes[0].data, info.linearization);
    }
    if let Some(python) = client("rawpy") {
        let script = "import rawpy, sys; raw = rawpy.imread(sys.argv[1]).raw_image_visible; \
                      sys.stdout.buffer.write(raw.astype('<u2').tobytes())";
        let bytes = run(&python, &[&"-c", &script, &path]);
        let samples: Vec<u16> =
            bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
        assert_eq!(samples, info.linearization);
    }
}

/// Adobe's own SDK opens every file without a warning but that of the missing border, for which a
/// raw frame has no samples, and reads samples, pattern and baseline exposure.
#[test]
fn the_dng_sdk_reads_every_sample_without_a_warning() {
    let Some(python) = client("dngpy") else { return };
    const SCRIPT: &str = "
import sys, json, dngpy
out = []
for path in sys.argv[1:]:
    d = dngpy.Dng(path)
    out.append({'data': d.raw_pixels.ravel().tolist(), 'pattern': d.get_bayer_pattern(),
        'exposure': d.get_baseline_exposure(), 'model': d.metadata.model})
print('JSON', json.dumps(out))";
    let one_light = DngInfo { color_matrices: info().color_matrices.split_off(1), ..info() };
    let lifted = DngInfo { carried: [(50730, vec![-1.5])].into(), ..one_light };
    let per_cell = DngInfo { black_levels_dn: vec![56.0, 61.5, 72.0, 63.0], ..info() };
    let raws: Vec<RawFrame> = variants().chain([frame(12, "mono")]).collect();
    let folder = tempfile::tempdir().unwrap();
    let mut paths = Vec::new();
    for (i, raw) in raws.iter().enumerate() {
        let info = match (raw.cfa.is_mono(), i % 3) {
            (true, _) => DngInfo { noise_profile: vec![(1e-4, 2e-7)], ..info() },
            (_, 0) => info(),
            (_, 1) => lifted.clone(),
            _ => per_cell.clone(),
        };
        paths.push(folder.path().join(format!("{i}.dng")));
        std::fs::write(&paths[i], dng::encode(raw, &info).unwrap()).unwrap();
    }
    // What the SDK has to say, it says on either stream.
    let run = std::process::Command::new(&python).args(["-c", SCRIPT]).args(&paths).output();
    let run = run.unwrap();
    let [told, errors] = [&run.stdout, &run.stderr].map(|t| String::from_utf8_lossy(t));
    let (said, found) = told.split_once("JSON ").unwrap_or_else(|| panic!("{told}{errors}"));
    let lines = said.lines().chain(errors.lines()).filter(|line| !line.trim().is_empty());
    let unexpected: Vec<&str> =
        lines.filter(|line| !line.contains("Too little padding")).collect();
    assert_eq!(unexpected, [""; 0]);
    let found: Vec<serde_json::Value> =
        serde_json::from_str(found.lines().next().unwrap()).unwrap();
    assert_eq!(found.len(), raws.len());
    for (i, (raw, found)) in raws.iter().zip(&found).enumerate() {
        let data: Vec<u16> = serde_json::from_value(found["data"].clone()).unwrap();
        assert_eq!(data, raw.data, "{} {}", raw.bits, raw.cfa);
        assert_eq!(found["model"], "client test");
        if !raw.cfa.is_mono() {
            assert_eq!(found["pattern"], raw.cfa.to_string());
            let exposure = if i % 3 == 1 { -1.5 } else { 0.0 };
            assert_eq!(found["exposure"], exposure);
        }
    }
}

#[test]
fn dcraw_reads_every_sample() {
    let Some(dcraw) = client("dcraw") else { return };
    for raw in variants().chain([frame(12, "mono")]) {
        let (_folder, path) = file("a.dng", &dng::encode(&raw, &info()).unwrap());
        let pgm = run(&dcraw, &[&"-D", &"-4", &"-c", &path]);
        assert_eq!(decode(&pgm).unwrap().planes[0].data, raw.data, "{} {}", raw.bits, raw.cfa);
        if !raw.cfa.is_mono() {
            let said = String::from_utf8(run(&dcraw, &[&"-i", &"-v", &path])).unwrap();
            let pattern = format!(
                "Filter pattern: {}/{}",
                &raw.cfa.to_string()[..2],
                &raw.cfa.to_string()[2..]
            );
            for expected in
                [&pattern[..], "ISO speed: 200", "Shutter: 1/50.0 sec", "Aperture: f/2.8"]
            {
                assert!(said.contains(expected), "{expected:?} not in:\n{said}");
            }
        }
    }
}

#[test]
fn libraw_reads_every_sample_level_and_pattern() {
    let Some(python) = client("rawpy") else { return };
    const SCRIPT: &str = "
import sys, json, rawpy
out = []
for path in sys.argv[1:]:
    with rawpy.imread(path) as r:
        cell = r.raw_pattern
        pattern = None if cell is None else ''.join('RGBG'[i] for i in cell.ravel())
        out.append({'data': r.raw_image.ravel().tolist(), 'black': r.black_level_per_channel,
            'white': r.white_level, 'pattern': pattern, 'wb': r.camera_whitebalance})
print(json.dumps(out))";
    let raws: Vec<RawFrame> = variants().collect();
    let per_cell = DngInfo { black_levels_dn: vec![56.0, 61.0, 72.0, 63.0], ..info() };
    let folder = tempfile::tempdir().unwrap();
    let mut arguments: Vec<PathBuf> = Vec::new();
    for (i, raw) in raws.iter().enumerate() {
        let info = if i == 0 { &per_cell } else { &info() };
        arguments.push(folder.path().join(format!("{i}.dng")));
        std::fs::write(&arguments[i], dng::encode(raw, info).unwrap()).unwrap();
    }
    let mut all: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&"-c", &SCRIPT];
    all.extend(arguments.iter().map(|a| a as &dyn AsRef<std::ffi::OsStr>));
    let said: serde_json::Value = serde_json::from_slice(&run(&python, &all)).unwrap();
    for (i, (raw, said)) in raws.iter().zip(said.as_array().unwrap()).enumerate() {
        assert_eq!(said["data"], serde_json::json!(raw.data));
        assert_eq!(said["white"], raw.white_level_dn);
        assert_eq!(said["pattern"], raw.cfa.to_string());
        // LibRaw's order is R, G of red rows, B, G of blue rows.
        let black = raw.black_level_dn as u32;
        let expected = if i == 0 { [56, 61, 63, 72] } else { [black; 4] };
        assert_eq!(said["black"], serde_json::json!(expected), "RGGB cells");
        let wb: Vec<f64> = serde_json::from_value(said["wb"].clone()).unwrap();
        for (found, expected) in wb.iter().zip([2.0, 1.0, 1.6]) {
            assert!((found / wb[1] - expected).abs() < 1e-6, "{wb:?}");
        }
    }
}

#[test]
fn tifffile_reads_dng_and_tiff() {
    let Some(python) = client("tifffile") else { return };
    const SCRIPT: &str = "
import sys, tifffile
with tifffile.TiffFile(sys.argv[1]) as t:
    first = t.pages[0]
    page = first.pages[0] if first.is_subifd is False and first.subifds else first
    sys.stdout.buffer.write(page.asarray().astype('<u2').tobytes())";
    let raw = frame(12, "GRBG");
    let expected: Vec<u8> = raw.data.iter().flat_map(|dn| dn.to_le_bytes()).collect();
    let frames = Frames::from_raw(&raw);
    for (name, bytes) in [
        ("a.dng", dng::encode(&raw, &info()).unwrap()),
        ("a.tiff", Format::Tiff.encode(&frames).unwrap()),
    ] {
        let (_folder, path) = file(name, &bytes);
        assert!(run(&python, &[&"-c", &SCRIPT, &path]) == expected, "{name}");
    }
}

#[test]
fn numpy_and_astropy_read_stacks() {
    let mut frames = Frames::from_raw(&frame(16, "RGGB"));
    let mut second = frames.planes[0].clone();
    second.data.reverse();
    frames.planes.push(second);
    let expected: Vec<u8> =
        frames.planes.iter().flat_map(|p| &p.data).flat_map(|dn| dn.to_le_bytes()).collect();
    let scripts = [
        ("numpy", "a.npy", Format::Npy, "import sys, numpy; a = numpy.load(sys.argv[1])"),
        (
            "astropy",
            "a.fits",
            Format::Fits,
            "import sys, astropy.io.fits as f; a = f.getdata(sys.argv[1])",
        ),
    ];
    for (module, name, format, load) in scripts {
        let Some(python) = client(module) else { continue };
        let (_folder, path) = file(name, &format.encode(&frames).unwrap());
        let script = format!(
            "{load}\nassert a.shape == (2, {HEIGHT}, {WIDTH}), a.shape\n\
             sys.stdout.buffer.write(a.astype('<u2').tobytes())"
        );
        assert!(run(&python, &[&"-c", &script, &path]) == expected, "{module}");
    }
}

#[test]
fn exiftool_and_exiv2_have_nothing_to_complain_of() {
    let raw = frame(12, "GRBG");
    let corrected = DngInfo { opcode_list1: bad_pixels(), opcode_list2: gain_maps(), ..info() };
    for info in [DngInfo::default(), info(), corrected] {
        let (_folder, path) = file("a.dng", &dng::encode(&raw, &info).unwrap());
        if let Some(exiftool) = client("exiftool") {
            let said =
                run(&exiftool, &[&"-validate", &"-warning", &"-error", &"-a", &"-s3", &path]);
            assert_eq!(String::from_utf8(said).unwrap().trim(), "OK");
            if info.iso.is_some() {
                let said = run(&exiftool, &[&"-json", &"-n", &path]);
                let said: serde_json::Value = serde_json::from_slice(&said).unwrap();
                let expected = [
                    ("ExposureTime", 0.02),
                    ("ISO", 200.0),
                    ("FNumber", 2.8),
                    ("FocalLength", 3.6),
                    ("CalibrationIlluminant1", 17.0),
                    ("CalibrationIlluminant2", 21.0),
                    ("WhiteLevel", f64::from(raw.white_level_dn)),
                ];
                for (tag, value) in expected {
                    assert_eq!(said[0][tag].as_f64(), Some(value), "{tag}");
                }
                assert_eq!(said[0]["ColorMatrix2"], "0.9 -0.2 -0.1 -0.5 1.3 0.2 -0.1 0.3 0.6");
            }
        }
        if let Some(exiv2) = client("exiv2") {
            let said = String::from_utf8(run(&exiv2, &[&"-pa", &path])).unwrap();
            for tag in
                ["Exif.SubImage1.CFAPattern", "Exif.SubImage1.BlackLevel", "Exif.Image.DNGVersion"]
            {
                assert!(said.contains(tag), "{tag}");
            }
        }
    }
}

/// A frame at white, shown by the commands as they are printed: an 8-bit picture of it is white
/// (within the rounding of ffmpeg's colour conversion), whatever the depth; at half of white it is
/// half as bright.
#[test]
fn ffmpeg_and_gstreamer_show_headerless_pixels_as_bright_as_they_are() {
    let (Some(_), folder) = (client("ffmpeg"), tempfile::tempdir().unwrap()) else { return };
    let sink = client("gst-launch-1.0").is_some();
    // Width 30: rows of 8 bits do not end on four bytes, which GStreamer expects of them.
    for (bits, cfa, width) in [
        (8, "RGGB", 32),
        (8, "GBRG", 30),
        (10, "GRBG", 32),
        (12, "BGGR", 30),
        (14, "RGGB", 32),
        (16, "RGGB", 32),
        (8, "mono", 30),
        (10, "mono", 32),
        (12, "mono", 30),
        (16, "mono", 32),
    ] {
        for share in [1, 2] {
            let white = ((1u32 << bits) - 1) as u16 / share;
            let raw = RawFrame {
                width,
                height: 24,
                bits,
                cfa: Cfa::parse(cfa).unwrap(),
                black_level_dn: 0.0,
                white_level_dn: ((1u32 << bits) - 1) as u16,
                data: vec![white; width * 24],
            };
            let pixels = PixelFormat { cfa: raw.cfa.clone(), bits, layout: Layout::Words };
            let path = folder.path().join(format!("a_{width}x24_{pixels}.raw"));
            std::fs::write(&path, pixels.encode(&Frames::from_raw(&raw), None).unwrap()).unwrap();
            let seen = folder.path().join("seen");
            for hint in pixels.hints(&path, width, 24) {
                let gstreamer = hint.contains("gst-launch-1.0");
                if !hint.contains("ffmpeg") && !gstreamer || gstreamer && !sink {
                    continue;
                }
                let to_grey = format!("-pix_fmt gray -f rawvideo -y {}", seen.display());
                let grey = "videoconvert ! video/x-raw,format=GRAY8,width=32,height=24";
                let convert =
                    format!("videoscale ! {grey} ! filesink location={}", seen.display());
                let bayer = if hint.contains("x-bayer") { "bayer2rgb ! " } else { "" };
                let line = hint
                    .replace("ffmpeg -f", "ffmpeg -v error -f")
                    .replace("out.png", &to_grey)
                    .replace("...", &format!("{bayer}{convert}"));
                let shell = client("sh").expect("a shell");
                run(&shell, &[&"-c", &line]);
                let picture = std::fs::read(&seen).unwrap();
                let middle = f64::from(picture[12 * picture.len() / 24 + 16]);
                let expected = 255.0 / f64::from(share);
                assert!((middle - expected).abs() <= 3.0, "{middle} for {expected}: {line}");
            }
        }
    }
}

/// A gain map for each phase of the pattern: 1 at the centre, 2 at the corners.
fn gain_maps() -> Vec<Opcode> {
    let phase = |top: u32, left: u32| {
        Opcode::GainMap(GainMap {
            area: [top, left, HEIGHT as u32, WIDTH as u32],
            pitch: [2, 2],
            points: [3, 3],
            spacing: [0.5, 0.5],
            origin: [0.0, 0.0],
            gains: vec![2.0, 1.5, 2.0, 1.5, 1.0, 1.5, 2.0, 1.5, 2.0],
        })
    };
    vec![phase(0, 0), phase(0, 1), phase(1, 0), phase(1, 1)]
}

fn bad_pixels() -> Vec<Opcode> {
    vec![Opcode::FixBadPixelsList { bayer_phase: 1, points: vec![(10, 20), (31, 41)] }]
}

/// darktable applies the opcodes: a flat field divided by the gain map becomes flat, and dark
/// spots at the listed pixels vanish.
#[test]
fn darktable_executes_the_opcodes() {
    let Some(darktable) = client("darktable-cli") else { return };
    let mut raw = frame(12, "GRBG");
    let signal = |x: usize, y: usize| {
        // The interpolation of the map: bilinear between nodes at 0, 1/2 and 1 of the image.
        let across = |p: usize, n: usize| ((p as f64 + 0.5) / n as f64 * 2.0 - 1.0).abs();
        let (u, v) = (across(x, WIDTH), across(y, HEIGHT));
        1200.0 / (1.0 + 0.5 * (u + v))
    };
    raw.data = (0..WIDTH * HEIGHT)
        .map(|i| (raw.black_level_dn + signal(i % WIDTH, i / WIDTH)).round() as u16)
        .collect();
    for opcode in bad_pixels() {
        if let Opcode::FixBadPixelsList { points, .. } = opcode {
            for (row, column) in points {
                raw.data[row as usize * WIDTH + column as usize] = raw.black_level_dn as u16;
            }
        }
    }
    let neutral = DngInfo { as_shot_neutral: Some([1.0; 3]), ..info() };
    let develop = |info: &DngInfo| {
        let (folder, path) = file("a.dng", &dng::encode(&raw, info).unwrap());
        let out = folder.path().join("out.png");
        let home = folder.path().join("config");
        let command = [
            "--apply-custom-presets",
            "0",
            "--core",
            "--library",
            ":memory:",
            "--disable-opencl",
            "--configdir",
        ];
        let mut all: Vec<&dyn AsRef<std::ffi::OsStr>> = vec![&path, &out];
        all.extend(command.iter().map(|w| w as &dyn AsRef<std::ffi::OsStr>));
        all.extend([&home as &dyn AsRef<std::ffi::OsStr>, &"--cachedir", &home]);
        run(&darktable, &all);
        let (width, height, pixels) = camrig_tests::png_rgb(&out);
        assert_eq!((width, height), (WIDTH, HEIGHT));
        pixels.iter().map(|p| p[1]).collect::<Vec<_>>()
    };
    let plain = develop(&neutral);
    let fixed = develop(&DngInfo {
        opcode_list1: bad_pixels(),
        opcode_list2: gain_maps(),
        ..neutral.clone()
    });
    let at = |picture: &[f64], x: usize, y: usize| picture[y * WIDTH + x];
    let corner = |p: &[f64]| at(p, 2, 2) / at(p, WIDTH / 2, HEIGHT / 2);
    let spot = |p: &[f64]| at(p, 20, 10) / at(p, 26, 10);
    println!("corner/centre {:.3} -> {:.3}", corner(&plain), corner(&fixed));
    println!("spot/neighbour {:.3} -> {:.3}", spot(&plain), spot(&fixed));
    // In a picture of 8 bits with a tone curve, one level of about 200 is 0.5 %.
    assert!(corner(&plain) < 0.9 && (corner(&fixed) - 1.0).abs() < 0.02);
    assert!(spot(&plain) < 0.9 && (spot(&fixed) - 1.0).abs() < 0.02);
}

/// ffmpeg decodes a DNG to samples stretched from black..white to 0..65535.
#[test]
fn ffmpeg_reads_every_sample_and_level() {
    let Some(ffmpeg) = client("ffmpeg") else { return };
    for raw in BAYER.map(|cfa| frame(12, cfa)) {
        let (_folder, path) = file("a.dng", &dng::encode(&raw, &info()).unwrap());
        let samples = run(&ffmpeg, &[&"-v", &"error", &"-i", &path, &"-f", &"rawvideo", &"-"]);
        let found = samples.chunks_exact(2).map(|b| f64::from(u16::from_le_bytes([b[0], b[1]])));
        assert_eq!(samples.len(), 2 * raw.data.len());
        let scale = 65535.0 / (f64::from(raw.white_level_dn) - raw.black_level_dn);
        for (found, &dn) in found.zip(&raw.data) {
            let expected = ((f64::from(dn) - raw.black_level_dn) * scale).clamp(0.0, 65535.0);
            assert!((found - expected).abs() <= 1.0, "{dn}: {found}, {expected}");
        }
    }
}

#[test]
fn fitsverify_has_nothing_to_complain_of() {
    let Some(fitsverify) = client("fitsverify") else { return };
    let (_folder, path) =
        file("a.fits", &Format::Fits.encode(&Frames::from_raw(&frame(12, "RGGB"))).unwrap());
    let said = String::from_utf8(run(&fitsverify, &[&"-q", &path])).unwrap();
    assert!(said.starts_with("verification OK"), "{said}");
}
