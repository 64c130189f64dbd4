//! Sequences: brackets, two exposures in a frame, moving scenes, streams, and their reports.

use super::{camrig, camrig_ok, small_camera};
use std::path::Path;

/// A camera without noise, fall-off and fixed pattern, so that frames differ only as requested.
fn folder(width: u32, height: u32) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let quiet = [
        ("read_e", "0.0"),
        ("read_e_post", "0.0"),
        ("prnu", "0.0"),
        ("row_fpn_e", "0.0"),
        ("dark_current_e_per_s", "0.0"),
        ("dsnu_e_per_s", "0.0"),
        ("relative_illumination", "\"none\""),
    ];
    std::fs::write(dir.path().join("c.toml"), small_camera(width, height, &quiet)).unwrap();
    dir
}

fn read(path: &Path) -> camrig::formats::Frames {
    camrig::formats::read(path).unwrap()
}

/// Mean above black, proportional to e⁻, and its standard error from shot noise and rounding.
fn mean(data: &[u16]) -> (f64, f64) {
    const DN_PER_E: f64 = 1023.0 / 6500.0;
    let n = data.len() as f64;
    let mean = data.iter().map(|&v| f64::from(v)).sum::<f64>() / n - 42.0;
    (mean, ((mean * DN_PER_E + 1.0 / 12.0) / n).sqrt())
}

fn assert_ratio(a: (f64, f64), b: (f64, f64), expected: f64) {
    let ratio = a.0 / b.0;
    let error = ratio * (a.1 / a.0).hypot(b.1 / b.0);
    assert!((ratio - expected).abs() < 4.0 * error, "{ratio} ± {error}, expected {expected}");
}

#[test]
fn a_bracket_steps_the_exposure() {
    let dir = folder(96, 64);
    camrig_ok(
        dir.path(),
        "simulate --camera c.toml --scene uniform:0.3 --exposure 8ms --bracket -2,0,1 -o set",
    );
    let frames: Vec<_> =
        (0..3).map(|i| read(&dir.path().join(format!("set/{i:04}.dng")))).collect();
    let exposures: Vec<f64> =
        frames.iter().map(|f| f.facts.dng.as_ref().unwrap().exposure_s.unwrap()).collect();
    assert!(exposures.iter().zip([0.002, 0.008, 0.016]).all(|(a, b)| (a / b - 1.0).abs() < 1e-6));
    let [dark, middle, bright] = [0, 1, 2].map(|i| mean(&frames[i].planes[0].data));
    assert_ratio(middle, dark, 4.0);
    assert_ratio(bright, middle, 2.0);
}

#[test]
fn long_and_short_exposures_share_a_frame() {
    let dir = folder(96, 64);
    let command = "simulate --camera c.toml --scene uniform:0.3 --exposure 16ms";
    camrig_ok(dir.path(), &format!("{command} --hdr rows:8 -o rows.npy"));
    camrig_ok(dir.path(), &format!("{command} --hdr staggered:8:4 -o staggered.npy"));
    camrig_ok(dir.path(), &format!("{command} -o plain.npy"));
    let rows = read(&dir.path().join("rows.npy")).planes.remove(0);
    let of = |plane: &camrig::Plane<u16>, wanted: &dyn Fn(usize) -> bool| -> Vec<u16> {
        (0..plane.height).filter(|y| wanted(*y)).flat_map(|y| plane.row(y).to_vec()).collect()
    };
    let long = of(&rows, &|y| y % 4 < 2);
    let short = of(&rows, &|y| y % 4 >= 2);
    assert_ratio(mean(&long), mean(&short), 8.0);
    // Long rows equal those of the plain frame: the same pixels with the same exposure.
    let plain = read(&dir.path().join("plain.npy")).planes.remove(0);
    assert!(long == of(&plain, &|y| y % 4 < 2));
    let staggered = read(&dir.path().join("staggered.npy")).planes.remove(0);
    assert_eq!((staggered.width, staggered.height), (96, 128));
    let long = of(&staggered, &|y| y % 2 == 0);
    let short = of(&staggered, &|y| y % 2 == 1 && y >= 8);
    assert_ratio(mean(&long), mean(&short), 8.0);
    assert!(of(&staggered, &|y| y % 2 == 1 && y < 8).iter().all(|&dn| dn == 42));
    let refused = camrig(dir.path(), &format!("{command} --hdr staggered:8:3 -o odd.npy"));
    assert_eq!(refused.status.code(), Some(2));
}

/// An upright edge that moves 6 pixels per frame is 6 pixels further on in each frame, and leans
/// by the part of the period in which rows are read.
#[test]
fn a_moving_edge_is_where_it_must_be_and_leans_with_the_shutter() {
    let dir = folder(96, 64);
    let command = "simulate --camera c.toml --scene slanted-edge:angle=0.001 --exposure 8ms \
                   --frames 3 --motion 6,0";
    camrig_ok(dir.path(), &format!("{command} -o global"));
    camrig_ok(dir.path(), &format!("{command} --rolling 0.5 -o rolling"));
    // Place where the green rows cross the middle between dark and bright, to a fraction of a
    // pixel.
    let edge = |name: &str, frame: usize, rows: std::ops::Range<usize>| -> f64 {
        let plane = read(&dir.path().join(format!("{name}/{frame:04}.dng"))).planes.remove(0);
        let count = rows.len() as f64;
        let profile: Vec<f64> = (0..48)
            .map(|i| {
                // GRBG: green on even columns of even rows, odd columns of odd rows.
                rows.clone().map(|y| f64::from(plane.at(2 * i + y % 2, y))).sum::<f64>() / count
            })
            .collect();
        let (low, high) = (profile[2], profile[45]);
        let middle = 0.5 * (low + high);
        let rises = high > low;
        let i = (2..45)
            .find(|&i| (profile[i] < middle) == rises && (profile[i + 1] >= middle) == rises)
            .expect("an edge");
        2.0 * (i as f64 + (middle - profile[i]) / (profile[i + 1] - profile[i]))
    };
    // Tolerance of linear interpolation, between samples 2 pixels apart, of an edge about 2 pixels
    // wide: a third of a pixel.
    let start = edge("global", 0, 0..64);
    for frame in 1..3 {
        let moved = edge("global", frame, 0..64) - start;
        assert!((moved - 6.0 * frame as f64).abs() < 0.4, "frame {frame}: {moved}");
    }
    let lean = edge("rolling", 1, 48..64) - edge("rolling", 1, 0..16);
    // Between the middles of the two bands of rows lie 48 of 64 rows.
    assert!((lean - 6.0 * 0.5 * 48.0 / 64.0).abs() < 0.4, "{lean}");
}

#[test]
fn frames_stream_to_standard_output() {
    let dir = folder(64, 48);
    let command = "simulate --camera c.toml --scene ramp --exposure 8ms --frames 3";
    let pipe = camrig_ok(dir.path(), &format!("{command} -o - --to SGRBG10"));
    camrig_ok(dir.path(), &format!("{command} -o set"));
    assert_eq!(pipe.stdout.len(), 3 * 64 * 48 * 2);
    let dn: Vec<u16> =
        pipe.stdout.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
    for (i, frame) in dn.chunks(64 * 48).enumerate() {
        let file = read(&dir.path().join(format!("set/{i:04}.dng")));
        assert!(file.planes[0].data == frame, "frame {i}");
    }
    for name in ["many.npy", "many.tiff", "many.fits"] {
        camrig_ok(dir.path(), &format!("{command} -o {name}"));
        let many = read(&dir.path().join(name));
        assert!(many.planes.iter().map(|p| &p.data[..]).eq(dn.chunks(64 * 48)), "{name}");
    }
    let refused = camrig(dir.path(), &format!("{command} -o -"));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--to"));
}

#[test]
fn a_report_is_one_file_with_all_that_made_the_frames() {
    let dir = folder(64, 48);
    camrig_ok(
        dir.path(),
        "simulate --camera c.toml --scene colorchecker --lux 250 --exposure 8ms --frames 2 -o set \
         --report page.html",
    );
    let page = std::fs::read_to_string(dir.path().join("page.html")).unwrap();
    for part in [
        "data:image/png;base64,",
        "<svg",
        "full_well_e = 6500",
        "sensor seed",
        "250 lx",
        concat!("camrig ", env!("CARGO_PKG_VERSION")),
    ] {
        assert!(page.contains(part), "{part}");
    }
    let outside = page.replace("http://www.w3.org/2000/svg", "");
    assert!(!outside.contains("http") && !outside.contains(" src=\"/"), "self-contained");
    assert!(!page.contains(dir.path().to_str().unwrap()), "no path of this machine");
}

#[test]
fn pictures_without_noise_are_alike_on_the_host_and_on_a_rig() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("c.toml"), small_camera(64, 48, &[])).unwrap();
    let scene = "--camera c.toml --scene ramp --lux 300 --exposure 10ms";
    let taken = |options: &str, file: &str| {
        let text = camrig_ok(dir, &format!("simulate {scene} {options} -o {file} --json")).stdout;
        let said: serde_json::Value = serde_json::from_slice(&text).unwrap();
        (std::fs::read(dir.join(file)).unwrap(), said["noise"].clone())
    };
    let (first, said) = taken("--noise none", "first.pgm");
    assert_eq!(said, "none");
    assert_eq!(first, taken("--noise none --frame-seed 7", "second.pgm").0);
    let (shot, said) = taken("--noise shot", "shot.pgm");
    assert_eq!(said, "shot");
    assert_ne!(shot, taken("--noise shot --frame-seed 7", "other.pgm").0);
    let (all, said) = taken("", "all.pgm");
    assert!(all != shot && said == "all");
    // The rig's program gives the same bytes.
    let rig = taken("--noise none --rig emulator:", "rig.pgm").0;
    assert_eq!(rig, first);
}
