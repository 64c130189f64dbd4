//! Shapes that no effect of the catalogue has: a camera that has them gives the same bytes by every
//! way, and what a diagnosis proposes runs and closes the gap.

use super::{camrig, camrig_ok, small_camera};
use serde_json::Value;
use std::path::Path;

/// Empirical effects of every domain with their tables.
const EFFECTS: &str = "
[[effect]]
kind = \"empirical\"
domain = \"gain\"
shape = \"wave\"
amount = 0.02
table = \"wave.toml\"
[[effect]]
kind = \"empirical\"
domain = \"dark\"
shape = \"distribution\"
amount_e_per_s = 300.0
table = \"law.toml\"
[[effect]]
kind = \"empirical\"
domain = \"offset\"
shape = \"seam\"
amount_e = 4.0
table = \"seam.toml\"
[[effect]]
kind = \"empirical\"
domain = \"temporal\"
shape = \"row-profile\"
amount_e = 6.0
table = \"profile.toml\"
[[effect]]
kind = \"empirical\"
domain = \"temporal\"
shape = \"correlation\"
amount_e = 3.0
table = \"noise.toml\"
[[effect]]
kind = \"empirical\"
domain = \"response\"
shape = \"signal-curve\"
table = \"curve.toml\"
[[effect]]
kind = \"empirical\"
domain = \"offset\"
shape = \"frame-curve\"
amount_e = 9.0
table = \"start.toml\"
";
const TABLES: [(&str, &str); 7] = [
    ("wave.toml", "[[wave]]\ncycles_per_column = 0.11\ncycles_per_row = 0.27\namplitude = 1.0\n"),
    ("law.toml", "deviates = [-3.0, 0.0, 3.0]\nvalues = [0.0, 1.0, 8.0]\n"),
    (
        "seam.toml",
        "[[seam]]\nfirst_column = 40\nstep = 1.0\n[[seam]]\nfirst_row = 20\nstep = -0.5\n",
    ),
    ("profile.toml", "at = [0.0, 20.0]\nvalues = [1.0, 0.0]\n"),
    ("noise.toml", "along = \"columns\"\nlength = 9.0\n"),
    ("curve.toml", "signal_e = [2000.0, 2000.0]\nchange_e = [0.0, 20.0]\nnoise_e = [0.0, 12.0]\n"),
    ("start.toml", "at = [0.0, 3.0]\nvalues = [1.0, 0.0]\n"),
];

/// A folder with a base model and a camera that has empirical effects beside it.
fn folder(effects: &str, tables: &[(&str, &str)]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let base = small_camera(112, 80, &[("cfa", "\"mono\""), ("read_e_post", "0.0")]);
    std::fs::write(dir.path().join("base.toml"), &base).unwrap();
    std::fs::write(dir.path().join("true.toml"), format!("{base}{effects}")).unwrap();
    for (name, text) in tables {
        std::fs::write(dir.path().join(name), text).unwrap();
    }
    dir
}

#[test]
fn files_threads_and_rigs_give_the_same_bytes() {
    let dir = folder(EFFECTS, &TABLES);
    let dir = dir.path();
    let light = "--scene ramp --lux 3000 --exposure 20ms --frame-seed 3";
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    camrig_ok(dir, &format!("simulate --camera base.toml {light} -o base.npy"));
    for arithmetic in ["f32", "fixed"] {
        let simulate = format!("simulate --camera true.toml {light} --arith {arithmetic}");
        camrig_ok(dir, &format!("{simulate} -o a.npy --force"));
        camrig_ok(dir, &format!("{simulate} --rig emulator: -o b.npy --force"));
        assert_eq!(read("a.npy"), read("b.npy"), "{arithmetic}: by the rig");
        assert_ne!(read("a.npy"), read("base.npy"), "{arithmetic}: the effects act");
    }
    let take = "capture --camera true.toml --plan diagnosis --frame-seed 5";
    camrig_ok(dir, &format!("{take} -o captures"));
    camrig_ok(dir, &format!("{take} --rig emulator: -o rig"));
    for stack in ["dark-long", "flat-02"] {
        let read = |set: &str| std::fs::read(dir.join(set).join(stack).join("0001.npy")).unwrap();
        assert_eq!(read("rig"), read("captures"), "{stack}");
    }
    // The model that took them agrees with them.
    camrig_ok(dir, "compare true.toml captures");
    assert_eq!(camrig(dir, "compare base.toml captures").status.code(), Some(1));
}

fn diagnosis(dir: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(dir.join("diagnosis.json")).unwrap()).unwrap()
}

#[test]
fn what_is_proposed_runs_and_closes_the_gap() {
    let effects = "[[effect]]\nkind = \"empirical\"\ndomain = \"temporal\"\n\
        shape = \"row-profile\"\namount_e = 9.0\ntable = \"profile.toml\"\n";
    let profile = "at = [0.0, 5.0, 10.0, 20.0, 30.0, 60.0]\n\
        values = [1.0, 0.607, 0.368, 0.135, 0.05, 0.002]\n";
    let dir = folder(effects, &[("profile.toml", profile)]);
    let dir = dir.path();
    camrig_ok(dir, "capture --camera true.toml --plan diagnosis --frame-seed 5 -o captures");
    camrig(dir, "diagnose base.toml captures -o d");
    let found = diagnosis(&dir.join("d"));
    let gap = |key: &str| found[key].as_f64().unwrap();
    assert!(gap("gap_before") > 3.0 && gap("gap_after") < 1.5, "{found}");
    let step = &found["steps"][0];
    assert_eq!(step["effect"], "empirical");
    assert_eq!((&step["status"], &step["domain"]), (&"proposed".into(), &"temporal".into()));
    assert_eq!(step["shape"], "row-profile");
    let value = |key: &str| step["parameters"][key]["value"].as_f64().unwrap();
    assert!((value("sigma_e") - 9.0).abs() < 0.5, "{step}");
    assert!((value("length_columns") - 10.0).abs() < 1.5, "{step}");
    // The profile falls in the frames and in the improved model, not in the one given.
    let shown = |key: &str, i: usize| step["shown"][key][i].as_f64().unwrap();
    let last = step["shown"]["at"].as_array().unwrap().len() - 1;
    for key in ["measured", "model_after"] {
        assert!(shown(key, 0) > 1.5 * shown(key, last), "{step}");
    }
    assert!(shown("model_before", 0) < 1.1 * shown("model_before", last), "{step}");
    // The file that holds it is a camera like any other.
    let improved = std::fs::read_to_string(dir.join("d/camera-improved.toml")).unwrap();
    assert!(improved.contains("kind = \"empirical\""), "{improved}");
    assert!(dir.join("d/empirical-1.toml").exists());
    let take = "capture --camera d/camera-improved.toml --plan diagnosis --frame-seed 6";
    camrig_ok(dir, &format!("{take} -o again"));
    let light = "--scene ramp --lux 300 --exposure 10ms";
    for (rig, out) in [("", "a.npy"), ("--rig emulator:", "b.npy")] {
        camrig_ok(
            dir,
            &format!("simulate --camera d/camera-improved.toml {light} {rig} -o {out}"),
        );
    }
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert_eq!(read("a.npy"), read("b.npy"));
}

#[test]
fn a_start_up_is_proposed_and_a_camera_that_has_it_is_judged_with_it() {
    let effects = "[[effect]]\nkind = \"empirical\"\ndomain = \"offset\"\n\
        shape = \"frame-curve\"\namount_e = 12.0\ntable = \"start.toml\"\n";
    // e^(−i/2.5), to a thousandth.
    let (at, values): (Vec<f64>, Vec<f64>) =
        (0..18).map(f64::from).map(|i| (i, (-i / 2.5).exp())).unzip();
    let table = format!("at = {at:?}\nvalues = {values:?}\n");
    let dir = folder(effects, &[("start.toml", &table)]);
    let dir = dir.path();
    camrig_ok(dir, "capture --camera true.toml --plan diagnosis --frame-seed 70000 -o captures");
    camrig(dir, "diagnose base.toml captures -o d");
    let found = diagnosis(&dir.join("d"));
    let gap = |key: &str| found[key].as_f64().unwrap();
    assert!(gap("gap_before") > 1.5 && gap("gap_after") < 1.3, "{found}");
    assert_eq!(found["nuisances"][0]["kind"], "start-up");
    let [step] = &found["steps"].as_array().unwrap()[..] else { panic!("{found}") };
    assert_eq!((&step["domain"], &step["shape"]), (&"offset".into(), &"frame-curve".into()));
    let value = |key: &str| step["parameters"][key]["value"].as_f64().unwrap();
    assert!((value("amplitude_e") - 12.0).abs() < 0.3, "{step}");
    assert!((value("length_frames") - 2.5).abs() < 0.15, "{step}");
    // The file that holds it agrees, and so does the camera that took the frames.
    for camera in ["d/camera-improved.toml", "true.toml"] {
        camrig_ok(dir, &format!("compare {camera} captures"));
    }
}
