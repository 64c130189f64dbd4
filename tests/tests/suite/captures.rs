//! `camrig captures new`: a manifest from frames alone, of our own and of a real camera.

use super::{camrig, camrig_ok, shared, small_camera};
use serde_json::Value;
use std::path::Path;

fn json(dir: &Path, arguments: &str) -> Value {
    serde_json::from_slice(&camrig_ok(dir, arguments).stdout).expect("one JSON object")
}

fn told(output: &std::process::Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// System gain, 12 bits over 10000 e⁻.
const DN_PER_E: f64 = 4095.0 / 10_000.0;
const READ_NOISE_E: f64 = 6.0;

/// Darks and flats of a small camera as DNG files in folders, and as FITS stacks in one.
fn shoot(dir: &Path) {
    let changes = [
        ("cfa", "\"mono\""),
        ("bits", "12"),
        ("full_well_e", "10000"),
        ("black_level_dn", "100"),
        ("read_e", "6.0"),
    ];
    std::fs::write(dir.join("c.toml"), small_camera(64, 48, &changes)).unwrap();
    for folder in ["dng", "fits"] {
        std::fs::create_dir(dir.join(folder)).unwrap();
    }
    let mut seed = 0;
    let mut take = |kind: &str, scene: &str, ms: u32, frames: u32| {
        seed += 100;
        let what = format!(
            "simulate --camera c.toml --scene {scene} --lux 60 --exposure {ms}ms --frames {frames} \
             --frame-seed {seed}"
        );
        camrig_ok(dir, &format!("{what} -o dng/{kind}-{ms}"));
        camrig_ok(dir, &format!("{what} -o fits/{kind}_{ms}.fits"));
    };
    take("dark", "uniform:0", 2, 8);
    for ms in [2, 4, 8, 12, 16, 20] {
        take("flat", "uniform:0.8", ms, 4);
    }
}

/// The frames say everything but the temperature, which is given: the set is complete, `check`
/// finds nothing in it, and figures come out as the camera file has them, from both formats the
/// same.
#[test]
fn our_own_frames_become_a_set_that_measures_as_their_camera() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    shoot(dir);
    let mut figures = Vec::new();
    for set in ["dng", "fits"] {
        let made = camrig_ok(dir, &format!("captures new {set} --temperature-c 25"));
        let said = told(&made);
        assert!(said.contains("7 stacks of 32 frames"), "{said}");
        assert!(said.contains(&format!("next: camrig captures check {set}")), "{said}");
        assert!(said.contains(&format!("camrig measure ptc {set}")), "{said}");
        let again = camrig(dir, &format!("captures new {set}"));
        assert_eq!(again.status.code(), Some(2));
        assert!(told(&again).contains("--force"), "{}", told(&again));
        let checked = camrig(dir, &format!("captures check {set}"));
        assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stdout));
        let dark = json(dir, &format!("measure dark {set} --dn-per-e {DN_PER_E} --json"));
        let noise = &dark["read_noise_e"];
        let (value, error) =
            (noise["value"].as_f64().unwrap(), noise["std_error"].as_f64().unwrap());
        // Some 20 electrons per second of dark current add little to 36 e⁻² in 2 ms.
        assert!((value - READ_NOISE_E).abs() < 5.0 * error + 0.02, "{noise}");
        let ptc = json(dir, &format!("measure ptc {set} --json"));
        let gain = &ptc["system_gain_dn_per_e"];
        let (value, error) =
            (gain["value"].as_f64().unwrap(), gain["std_error"].as_f64().unwrap());
        assert!((value - DN_PER_E).abs() < 5.0 * error, "{gain}");
        figures.push((ptc, dark));
    }
    assert_eq!(figures[0].0["system_gain_dn_per_e"], figures[1].0["system_gain_dn_per_e"]);
    assert_eq!(figures[0].1["read_noise_e"], figures[1].1["read_noise_e"]);
}

/// A real camera's TIFF files, whose folders are named and say nothing of exposure and gain of the
/// flats: exactly these are left to fill in, and once they are, the figures are those of the
/// manifest that its maker wrote.
#[test]
fn a_real_camera_s_frames_need_what_they_do_not_say_and_no_more() {
    let Some(real) = shared("data/captures/imx541_alvium1800u2040m") else { return };
    let dir = tempfile::tempdir().unwrap();
    let set = dir.path().join("set");
    std::fs::create_dir(&set).unwrap();
    for entry in std::fs::read_dir(&real).unwrap().map(|e| e.unwrap().path()) {
        if entry.is_dir() {
            std::os::unix::fs::symlink(&entry, set.join(entry.file_name().unwrap())).unwrap();
        }
    }
    let said = told(&camrig_ok(dir.path(), "captures new set --bits 12 --black 10 --gain 1"));
    let unknown = said.lines().find(|line| line.starts_with("not in the files:")).unwrap();
    assert!(
        unknown.starts_with("not in the files: exposure_s of 11 captures. Replace"),
        "{unknown}"
    );
    let checked = camrig(dir.path(), "captures check set");
    assert_eq!(checked.status.code(), Some(2));
    let said = told(&checked);
    assert_eq!(said.matches("exposure_s is not known").count(), 11, "{said}");
    assert_eq!(said.matches("is not known").count(), 11, "{said}");

    // Filled in from the maker's manifest, in the order of its captures.
    let theirs = std::fs::read_to_string(real.join("captures.toml")).unwrap();
    let flats = theirs.split("[[capture]]").filter(|entry| entry.contains("role = \"flat\""));
    let mut ours = std::fs::read_to_string(set.join("captures.toml")).unwrap();
    for flat in flats {
        let line = flat.lines().find(|line| line.starts_with("exposure_s")).unwrap();
        ours = ours.replacen("exposure_s = \"?\"", line, 1);
    }
    std::fs::write(set.join("captures.toml"), ours).unwrap();
    let [ours, theirs] = ["set", real.to_str().unwrap()]
        .map(|set| json(dir.path(), &format!("measure ptc {set} --json")));
    // Names of the darks have four digits of their exposures, the maker's manifest six.
    for figure in ["system_gain_dn_per_e", "read_noise_e", "prnu"] {
        let [a, b] = [&ours, &theirs].map(|set| set[figure]["value"].as_f64().unwrap());
        assert!((a / b - 1.0).abs() < 1e-5, "{figure}: {a} {b}");
    }
}

#[test]
fn what_is_no_set_is_refused_and_nothing_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::create_dir(dir.join("empty")).unwrap();
    std::fs::write(dir.join("empty/readme.jpg"), "no frame").unwrap();
    for (arguments, says) in [
        ("captures new empty", "no frames"),
        ("captures new nowhere", "not a folder"),
        ("captures new empty --cfa XY9", "colour filter pattern"),
    ] {
        let output = camrig(dir, arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        assert!(told(&output).contains(says), "{arguments}: {}", told(&output));
    }
    assert!(!dir.join("empty/captures.toml").exists());
}
