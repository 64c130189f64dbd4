//! Time inside the exposure: rows collect light in their own windows from scenes that move and
//! lamps that flicker.

use super::{camrig, camrig_ok, small_camera};
use std::f64::consts::TAU;
use std::io::Write;
use std::path::Path;

const WIDTH: usize = 64;
const HEIGHT: usize = 48;
const LINE_S: f64 = 1e-4;
const BLACK_DN: f64 = 1000.0;

/// A folder with a camera `c.toml` without noise but that of light, and `t.toml` with timing, too:
/// 130 lines of 0.1 ms.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let quiet = [
        ("relative_illumination", "\"none\""),
        ("full_well_e", "150000"),
        ("bits", "16"),
        ("black_level_dn", "1000"),
        ("read_e", "0.0"),
        ("read_e_post", "0.0"),
        ("prnu", "0.0"),
        ("dark_current_e_per_s", "0.0"),
        ("dsnu_e_per_s", "0.0"),
        ("row_fpn_e", "0.0"),
    ];
    let text = small_camera(WIDTH as u32, HEIGHT as u32, &quiet);
    let timing = "\n[sensor.timing]\nline_time_us = 100\nframe_length_lines = 130\n";
    std::fs::write(dir.path().join("c.toml"), &text).unwrap();
    std::fs::write(dir.path().join("t.toml"), text + timing).unwrap();
    dir
}

/// Signal above black of frames on standard output, row by row.
fn frames(bytes: &[u8]) -> Vec<Vec<Vec<f64>>> {
    assert_eq!(bytes.len() % (2 * WIDTH * HEIGHT), 0);
    let signal = |b: &[u8]| {
        let dn = u16::from_le_bytes([b[0], b[1]]);
        assert!(dn < 60_000, "saturated");
        f64::from(dn) - BLACK_DN
    };
    let row = |row: &[u8]| row.chunks(2).map(signal).collect();
    let frame = |frame: &[u8]| frame.chunks(2 * WIDTH).map(row).collect();
    bytes.chunks(2 * WIDTH * HEIGHT).map(frame).collect()
}

fn simulated(dir: &Path, arguments: &str) -> Vec<Vec<Vec<f64>>> {
    frames(&camrig_ok(dir, &format!("simulate {arguments} -o - --to SGRBG16")).stdout)
}

fn mean(row: &[f64]) -> f64 {
    row.iter().sum::<f64>() / row.len() as f64
}

/// A cube of three bands with a bar around the column `centre`: a Gaussian of 2.4 pixels, which the
/// samples of each colour show without aliasing.
fn bar(path: &Path, centre: f64) {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (48, 64, 3), }";
    let header = format!("{header:117}\n");
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    for _ in 0..HEIGHT {
        for x in 0..WIDTH {
            let away = (x as f64 + 0.5 - centre) / 2.4;
            let value = 0.9 * (-0.5 * away * away).exp() as f32;
            bytes.extend([value; 3].iter().flat_map(|v| v.to_le_bytes()));
        }
    }
    std::fs::File::create(path).unwrap().write_all(&bytes).unwrap();
}

/// Where a row's light is, and how far it is spread: its mean and variance over the columns near
/// it. Farther away are the tails of diffraction alone, whose variance grows with what is counted.
fn spread(row: &[f64]) -> [f64; 2] {
    const NEAR: f64 = 16.0;
    let moment = |middle: f64, reach: f64, f: &dyn Fn(f64) -> f64| -> f64 {
        let columns = row.iter().enumerate().map(|(x, v)| (x as f64 + 0.5, v));
        let near = columns.filter(|(x, _)| (x - middle).abs() < reach);
        let [sum, all] = near.fold([0.0; 2], |[sum, all], (x, v)| [sum + v * f(x), all + v]);
        sum / all
    };
    let middle = moment(0.0, f64::INFINITY, &|x| x);
    let centre = moment(middle, NEAR, &|x| x);
    [centre, moment(centre, NEAR, &|x| (x - centre).powi(2))]
}

/// A bar that moves by itself at 800 pixels a second, 2000 pictures a second: in 10 ms it is
/// blurred over 8 pixels, from row to row it is 0.08 pixels further, and its light is all there.
#[test]
fn a_bar_that_moves_is_blurred_by_v_t_and_skewed_by_v_t_line() {
    let dir = folder();
    let dir = dir.path();
    std::fs::create_dir(dir.join("seq")).unwrap();
    for k in 0..40 {
        bar(&dir.join(format!("seq/{k:02}.npy")), 23.0 + 0.4 * f64::from(k));
    }
    let options = "quantity=reflectance,start_nm=500,step_nm=50 --lux 2000 --exposure 10ms \
                   --set lens.f_number=1.4";
    let still = simulated(dir, &format!("--camera c.toml --scene seq/00.npy:{options}"));
    let moving = format!("--scene seq:{options} --scene-rate 2000 --fps 30");
    let exposed = simulated(dir, &format!("--camera t.toml {moving}"));
    assert_eq!(exposed.len(), 1, "the sequence lasts 20 ms");
    let of = |frame: &[Vec<f64>]| -> Vec<[f64; 2]> { frame.iter().map(|r| spread(r)).collect() };
    let (before, after) = (of(&still[0]), of(&exposed[0]));
    let mean_of =
        |of: &[[f64; 2]], i: usize| of.iter().map(|s| s[i]).sum::<f64>() / of.len() as f64;
    // A box of length v T adds its variance, (v T)²/12.
    let blur = (12.0 * (mean_of(&after, 1) - mean_of(&before, 1))).sqrt();
    assert!((blur / 8.0 - 1.0).abs() < 0.01, "{blur}");
    let middle = (HEIGHT as f64 - 1.0) / 2.0;
    let lever = |y: usize| y as f64 - middle;
    let slope = after.iter().enumerate().map(|(y, s)| lever(y) * s[0]).sum::<f64>()
        / (0..HEIGHT).map(|y| lever(y).powi(2)).sum::<f64>();
    assert!((slope / (800.0 * LINE_S) - 1.0).abs() < 0.01, "{slope}");
    // The first row opens when the first picture is shown.
    let first = before[0][0] + 800.0 * 0.005;
    assert!((mean_of(&after, 0) - slope * middle - first).abs() < 0.02, "{first}");
    let light = |frame: &[Vec<f64>]| frame.iter().map(|row| mean(row)).sum::<f64>();
    assert!((light(&exposed[0]) / light(&still[0]) - 1.0).abs() < 1e-3);
    // From the bottom up it leans the other way; a global shutter keeps it upright.
    for (key, lean) in [("direction=up", -1.0), ("shutter=global", 0.0)] {
        let other = format!("--camera t.toml --set sensor.timing.{key} {moving}");
        let rows = of(&simulated(dir, &other)[0]);
        let ends = rows[HEIGHT - 1][0] - rows[0][0];
        let expected = lean * 800.0 * LINE_S * (HEIGHT as f64 - 1.0);
        assert!((ends - expected).abs() < 0.05, "{key}: {ends}");
    }
    // The same on a rig; and the whole scene moved by --motion is the same bar.
    let arguments = format!("--camera t.toml {moving} --frames 2 --loop -o - --to SGRBG16");
    let here = camrig_ok(dir, &format!("simulate {arguments}")).stdout;
    // Status 1: frames that are late on a busy machine.
    let rig = camrig(dir, &format!("rig stream emulator: {arguments}"));
    assert!(matches!(rig.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&rig.stderr));
    let rig = rig.stdout;
    assert!(here == rig && here.len() == 2 * 2 * WIDTH * HEIGHT);
    let motion = "--fps 50 --motion 16,0 --frames 1";
    let rows =
        of(&simulated(dir, &format!("--camera t.toml --scene seq/00.npy:{options} {motion}"))[0]);
    for y in [0, 20, 47] {
        assert!((rows[y][0] - after[y][0]).abs() < 0.05, "{y}: {:?} {:?}", rows[y], after[y]);
        assert!(
            (rows[y][1] / after[y][1] - 1.0).abs() < 0.02,
            "{y}: {:?} {:?}",
            rows[y],
            after[y]
        );
    }
}

/// Mean of 1 + m cos(2π f t) over a window.
fn mains(open: f64, exposure: f64, hz: f64, depth: f64) -> f64 {
    let x = 0.5 * TAU * hz * exposure;
    1.0 + depth * x.sin() / x * (TAU * hz * (open + 0.5 * exposure)).cos()
}

/// On-time of pulses over their mean in a window, by counting a hundred thousand moments.
fn pulses(open: f64, exposure: f64, hz: f64, duty: f64) -> f64 {
    let count = 100_000;
    let on = |i: i32| (hz * (open + exposure * (f64::from(i) + 0.5) / 1e5)).rem_euclid(1.0) < duty;
    (0..count).filter(|i| on(*i)).count() as f64 / f64::from(count) / duty
}

/// Rows' means over those in steady light are those of the lamp over their windows: 64 pixels of
/// some 30 000 electrons leave 0.1 % of noise.
fn assert_rows(frame: &[Vec<f64>], steady: &[Vec<f64>], expected: impl Fn(usize) -> f64) {
    for (y, (row, steady)) in frame.iter().zip(steady).enumerate() {
        let (found, expected) = (mean(row) / mean(steady), expected(y));
        let noise = 0.006 * expected.max(1.0);
        assert!((found - expected).abs() < noise, "row {y}: {found}, not {expected}");
    }
}

const UNIFORM: &str = "--camera t.toml --scene uniform:0.5 --lux 20000";

#[test]
fn lamps_light_each_row_for_its_own_window() {
    let dir = folder();
    let dir = dir.path();
    let of = |exposure: &str, more: &str| {
        simulated(dir, &format!("{UNIFORM} --exposure {exposure} --frames 3 {more}"))
    };
    let steady = of("4ms", "");
    let lamp = of("4ms", "--lamp mains:hz=120,depth=0.6");
    for (k, (lamp, steady)) in lamp.iter().zip(&steady).enumerate() {
        let open = |y: usize| k as f64 * 130.0 * LINE_S + y as f64 * LINE_S;
        assert_rows(lamp, steady, |y| mains(open(y), 4e-3, 120.0, 0.6));
    }
    // At 25 frames/s and from the bottom up, half of the light.
    let half = "--fps 25 --set sensor.timing.direction=up --lamp pulse:hz=90,duty=0.1,share=0.5";
    let lamp = of("4ms", half);
    for (k, (lamp, steady)) in lamp.iter().zip(&steady).enumerate() {
        let open = |y: usize| k as f64 / 25.0 + (HEIGHT - 1 - y) as f64 * LINE_S;
        let pulse = |y| pulses(open(y), 4e-3, 90.0, 0.1);
        assert_rows(lamp, steady, |y| 0.5 + 0.5 * pulse(y));
    }
    // A whole period shows nothing of it, and a short exposure leaves most rows dark.
    let dim = UNIFORM.replace("20000", "8000");
    let whole = |more: &str| simulated(dir, &format!("{dim} --exposure 10ms {more}"));
    let (period, steady) = (whole("--lamp mains:hz=100,depth=1"), whole(""));
    assert_rows(&period[0], &steady[0], |_| 1.0);
    let short = of("0.4ms", "--lamp pulse:hz=90,duty=0.1");
    let dark = short.iter().flatten().filter(|row| row.iter().all(|v| *v == 0.0)).count();
    let expected = (0..3 * HEIGHT)
        .filter(|i| {
            let open = (i / HEIGHT) as f64 * 130.0 * LINE_S + (i % HEIGHT) as f64 * LINE_S;
            pulses(open, 0.4e-3, 90.0, 0.1) == 0.0
        })
        .count();
    assert_eq!(dark, expected);
    assert!(dark > HEIGHT);
}

/// A lamp on the right half alone: its columns pulse, the others stay as they are.
#[test]
fn a_lamp_on_a_region_lights_nothing_else() {
    let dir = folder();
    let dir = dir.path();
    let of = |more: &str| simulated(dir, &format!("{UNIFORM} --exposure 4ms {more}"));
    let lamp = of("--lamp pulse:hz=90,duty=0.1,region=0.5,0,0.5,1");
    let steady = of("");
    let half = |frame: &[Vec<f64>], right: bool| -> Vec<Vec<f64>> {
        // Without the columns that the lens's blur lights from both halves.
        let columns = if right { 38..WIDTH } else { 0..26 };
        frame.iter().map(|row| row[columns.clone()].to_vec()).collect()
    };
    assert_rows(&half(&lamp[0], false), &half(&steady[0], false), |_| 1.0);
    assert_rows(&half(&lamp[0], true), &half(&steady[0], true), |y| {
        pulses(y as f64 * LINE_S, 4e-3, 90.0, 0.1)
    });
}

/// Regions are places of a still scene, and a place is lit by one of them.
#[test]
fn regions_of_what_moves_and_regions_that_overlap_are_refused() {
    let dir = folder();
    let dir = dir.path();
    std::fs::write(dir.join("v.y4m"), "YUV4MPEG2 W1 H1 F25:1 Cmono\nFRAME\n9").unwrap();
    let left = "--lamp pulse:hz=90,duty=0.1,region=0,0,0.5,1";
    let overlaps = format!("{left} --lamp pulse:hz=60,duty=0.1,region=0.4,0,0.5,1");
    for (scene, lamps, words) in [
        ("v.y4m", left, "a region of a sequence"),
        ("ramp --motion 1,0", left, "a region of a moving scene"),
        ("ramp", overlaps.as_str(), "overlap"),
    ] {
        let run = format!("simulate --camera t.toml --scene {scene} --exposure 4ms {lamps} -o x");
        let run = camrig(dir, &run);
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(2), "{scene}: {said}");
        assert!(said.contains(words) && !dir.join("x").exists(), "{scene}: {said}");
    }
}

/// Exposures that registers change while a stream runs: each frame's rows are lit for the exposure
/// that its start tells.
#[test]
fn rows_are_lit_for_the_exposure_that_the_registers_have() {
    let dir = folder();
    let dir = dir.path();
    let script = "format = \"rig-script/1\"\n[[write]]\nbefore_frame = 0\nexposure_s = 0.002\n\
                  [[write]]\nbefore_frame = 2\nexposure_s = 0.005\n";
    std::fs::write(dir.join("s.toml"), script).unwrap();
    let lamp = "--lamp mains:hz=100,depth=0.5";
    let stream = format!("rig stream emulator: {UNIFORM} {lamp} --script s.toml --frames 6");
    let run = camrig_ok(dir, &format!("{stream} -o x.csi2 --json"));
    let figures: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    assert_eq!(figures["exposure_missed"], 0);
    let exposures: Vec<f64> =
        (0..6).map(|k| figures["settings"][k]["exposure_s"].as_f64().unwrap()).collect();
    let near = |a: f64, b: f64| (a - b).abs() < 1e-8;
    assert!(exposures[..3].iter().all(|e| near(*e, 0.002)), "{exposures:?}");
    assert!(exposures[3..].iter().all(|e| near(*e, 0.005)), "{exposures:?}");
    let raw = camrig::formats::read(&dir.join("x.csi2")).unwrap();
    let steady = simulated(dir, &format!("{UNIFORM} --exposure 2ms"));
    for (k, (plane, exposure)) in raw.planes.iter().zip(exposures).enumerate() {
        let row = |row: &[u16]| row.iter().map(|dn| f64::from(*dn) - BLACK_DN).collect();
        let frame: Vec<Vec<f64>> = plane.data.chunks(WIDTH).map(row).collect();
        let close = |y: usize| 0.002 + k as f64 * 130.0 * LINE_S + y as f64 * LINE_S;
        assert_rows(&frame, &steady[0], |y| {
            exposure / 0.002 * mains(close(y) - exposure, exposure, 100.0, 0.5)
        });
    }
}

/// What stands still keeps its bytes, and what makes no sense is said.
#[test]
fn timing_changes_nothing_of_a_still_scene_and_is_needed_for_light_in_time() {
    let dir = folder();
    let dir = dir.path();
    let still = "--scene dots --exposure 4ms --frames 2 -o - --to SGRBG16";
    let without = camrig_ok(dir, &format!("simulate --camera c.toml {still}")).stdout;
    let with = camrig_ok(dir, &format!("simulate --camera t.toml {still}")).stdout;
    assert!(without == with);
    for (arguments, words) in [
        ("--camera c.toml --lamp mains:hz=100,depth=0.3", "without timing"),
        ("--camera t.toml --lamp mains:hz=100", "mains:hz=100,depth=0.3"),
        ("--camera t.toml --lamp pulse:hz=90,duty=0.1 --hdr rows:4", "--hdr"),
        ("--camera t.toml --motion 1,0 --rolling 0.5", "--rolling"),
        ("--camera t.toml --lamp mains:hz=100,depth=0.3 --fps 1000", "frames/s"),
        ("--camera t.toml --lamp mains:hz=100,depth=0.3 --fps 100 --exposure 20ms", "exposure"),
        ("--camera t.toml --fps 20 --exposure 200ms", "200 ms is longer than a frame at 20 fr"),
        ("--camera c.toml --fps 20 --bracket 0,3 --exposure 10ms", "80 ms is longer than a frame"),
        ("--camera t.toml --set sensor.timing.frame_length_lines=40", "40 lines"),
        ("--camera t.toml --set sensor.timing.shutter=slow", "rolling"),
    ] {
        let exposure = if arguments.contains("--exposure") { "" } else { "--exposure 4ms" };
        let run = camrig(dir, &format!("simulate --scene ramp {exposure} {arguments} -o x"));
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(2), "{arguments}: {said}");
        assert!(said.contains(words), "{arguments}: {said}");
        assert!(!dir.join("x").exists(), "{arguments}");
    }
}

/// Stamps of a still scene's frames: by the rate, or by the lines of the timing, of which an
/// exposure may take more.
#[test]
fn stamps_are_those_of_the_frames_clock() {
    let dir = folder();
    let dir = dir.path();
    for (arguments, stamps_ms) in [
        ("--camera c.toml --fps 20", [50, 100]),
        ("--camera t.toml --fps 20", [50, 100]),
        ("--camera t.toml", [13, 26]),
        // 200 lines of exposure, then 130 lines of frame.
        ("--camera t.toml --bracket 1,0,0", [20, 33]),
    ] {
        let run = format!("simulate --scene ramp --exposure 10ms --frames 3 {arguments}");
        camrig_ok(dir, &format!("{run} -o x.mcap --force"));
        let bytes = std::fs::read(dir.join("x.mcap")).unwrap();
        for ms in stamps_ms {
            let stamp = u64::to_le_bytes(ms * 1_000_000);
            assert!(bytes.windows(8).any(|w| w == stamp), "{arguments}: {ms} ms");
        }
        let second = u64::to_le_bytes(1_000_000_000);
        assert!(!bytes.windows(8).any(|w| w == second), "{arguments}");
    }
}

/// Traps over the frames of a run, from frames without them: of a frame, the fraction f is caught,
/// and 1 − d of what they held is released. Where there is nothing to hold the charge of all pixels
/// from frame to frame, the camera is refused.
#[test]
fn traps_hold_charge_over_the_frames_of_a_run() {
    let dir = folder();
    let dir = dir.path();
    let (fraction, tau) = (0.25, 3.0f64);
    let text = std::fs::read_to_string(dir.join("c.toml")).unwrap();
    let traps = format!(
        "\n[[effect]]\nkind = \"persistence\"\nfraction = {fraction}\ntime_constant_frames = {tau}\n"
    );
    std::fs::write(dir.join("p.toml"), text + &traps).unwrap();
    let light = "--scene uniform:0.5 --lux 1000 --exposure 4ms --noise none";
    for option in ["--frames 6", "--frames 4 --bracket 2,-2", "--frames 3 --hdr staggered:4"] {
        // Twice the rows: the first of the one exposure and the first of the other.
        let staggered = option.contains("staggered");
        let (halves, exposures, to) = if staggered { (2, 2, "Y16") } else { (1, 1, "SGRBG16") };
        let [without, with] = ["c", "p"].map(|c| {
            let run = format!("simulate --camera {c}.toml {light} {option} -o - --to {to}");
            let frames = frames(&camrig_ok(dir, &run).stdout);
            let of_exposures = |f: &Vec<Vec<f64>>| f[..exposures].to_vec();
            let rows: Vec<Vec<f64>> =
                frames.iter().step_by(halves).flat_map(of_exposures).collect();
            rows
        });
        let mut held = 0.0;
        for (alone, shown) in without.iter().zip(&with).map(|(a, b)| (mean(a), mean(b))) {
            let kept = held * (-1.0 / tau).exp();
            let right = alone - fraction * alone + held - kept;
            held = kept + fraction * alone;
            // Both are rounded.
            assert!((shown - right).abs() <= 1.0, "{option}: {shown}, expected {right}");
        }
        assert!(held > 100.0, "{option}: {held}");
    }
    let refused = |arguments: &str, said: &str| {
        let output =
            camrig(dir, &format!("simulate --camera p.toml {light} {arguments} -o o.npy"));
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(said), "{told}");
    };
    refused("--rig emulator:", "no memory for the charge");
    refused("--hdr rows:4", "persistence of rows of two exposures");
}
