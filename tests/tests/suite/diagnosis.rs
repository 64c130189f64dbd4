//! The diagnosis as a user runs it: on captures of the model itself, of a sensor with hidden
//! effects made by this program and by another one, and on captures that contradict their
//! manifest.

use super::{camrig, camrig_ok, small_camera};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

const EFFECTS: &str = "\n[[effect]]\nkind = \"row-temporal-noise\"\nsigma_e = 0.4\n\
    [[effect]]\nkind = \"column-offset-fpn\"\nsigma_e = 0.5\n";

/// A folder with the base model, the same sensor with effects, and a plan.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let base = small_camera(128, 128, &[("cfa", "\"mono\""), ("read_e_post", "0.0")]);
    std::fs::write(dir.path().join("base.toml"), &base).unwrap();
    std::fs::write(dir.path().join("true.toml"), format!("{base}{EFFECTS}")).unwrap();
    dir
}

fn take(dir: &Path, camera: &str, out: &str) {
    camrig_ok(dir, &format!("capture --camera {camera} --plan diagnosis --frame-seed 5 -o {out}"));
}

fn diagnosis(dir: &Path) -> Value {
    let text = std::fs::read_to_string(dir.join("diagnosis.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

fn names(diagnosis: &Value) -> Vec<&str> {
    let steps = diagnosis["steps"].as_array().unwrap();
    let mut names: Vec<&str> = steps.iter().map(|s| s["effect"].as_str().unwrap()).collect();
    names.sort_unstable();
    names
}

/// What lies behind the gain is seen by several gains alone: a model with a typical value of it
/// gets both parts of the read noise from them, in electrons, whatever the start.
#[test]
fn read_noise_before_and_behind_the_gain_are_found_together() {
    const PLAN: &str = "format = \"plan/1\"\n\
        [[stack]]\nid = \"dark\"\nrole = \"dark\"\nframes = 16\nexposure_s = 0.005\n\
        analog_gain = [1, 2, 4, 8]\n\
        [[stack]]\nid = \"flat\"\nrole = \"flat\"\nframes = 8\nexposure_s = 0.005\n\
        analog_gain = [1, 8]\nfill = [0.1, 0.4]\nlight = { wavelength_nm = 550 }\n";
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("plan.toml"), PLAN).unwrap();
    let camera = |post| {
        small_camera(
            128,
            96,
            &[("cfa", "\"mono\""), ("read_e", "5.0"), ("read_e_post", post), ("row_fpn_e", "0.0")],
        )
    };
    for (name, post) in [("true", "4.2"), ("low", "3.0"), ("high", "4.9")] {
        std::fs::write(dir.join(format!("{name}.toml")), camera(post)).unwrap();
    }
    camrig_ok(dir, "capture --camera true.toml --plan plan.toml --frame-seed 5 -o captures");
    for start in ["low", "high"] {
        camrig_ok(dir, &format!("diagnose {start}.toml captures -o {start}"));
        let found = diagnosis(&dir.join(start));
        assert_eq!(names(&found), ["read-noise"]);
        let parameters = &found["steps"][0]["parameters"];
        for (key, truth) in [("read_e", 5.0), ("read_e_post", 4.2)] {
            let [value, se] =
                ["value", "std_error"].map(|part| parameters[key][part].as_f64().unwrap());
            // The variance of n samples is known to √(2/n): 0.2 % of the noise from one gain.
            assert!(
                (value - truth).abs() < 4.0 * se && se < 0.01 * truth,
                "{start}: {parameters}"
            );
        }
    }
}

#[test]
fn captures_of_the_model_agree_and_hidden_effects_are_named_and_added() {
    let dir = folder();
    let dir = dir.path();
    take(dir, "base.toml", "same");
    camrig_ok(dir, "compare base.toml same");
    let json: Value =
        serde_json::from_slice(&camrig_ok(dir, "diagnose base.toml same -o d0 --json").stdout)
            .unwrap();
    assert_eq!(json["verdict"], "agrees");
    assert_eq!(json, diagnosis(&dir.join("d0")));

    take(dir, "true.toml", "captures");
    let far = camrig(dir, "compare base.toml captures");
    assert_eq!(far.status.code(), Some(1), "effects are seen");
    camrig_ok(dir, "diagnose base.toml captures -o d1");
    let found = diagnosis(&dir.join("d1"));
    assert_eq!(found["verdict"], "explained");
    assert_eq!(names(&found), ["column-offset-fpn", "row-temporal-noise"]);
    let gap = |key: &str| found[key].as_f64().unwrap();
    assert!(gap("gap_before") > 2.5 && gap("gap_after") <= 1.27, "{found}");
    for step in found["steps"].as_array().unwrap() {
        assert_eq!(step["status"], "confirmed");
        let sigma = &step["parameters"]["sigma_e"];
        let truth = if step["effect"] == "row-temporal-noise" { 0.4 } else { 0.5 };
        let (value, se) = (sigma["value"].as_f64().unwrap(), sigma["std_error"].as_f64().unwrap());
        // Four standard errors; the stated error of a fixed pattern is that of its 128 columns.
        assert!((value - truth).abs() < 4.0 * se, "{step}");
    }
    // The improved camera file renders, and a second diagnosis finds nothing missing.
    camrig_ok(
        dir,
        "simulate --camera d1/camera-improved.toml --scene ramp --lux 300 --exposure 10ms \
        -o a.dng",
    );
    camrig_ok(dir, "compare d1/camera-improved.toml captures");
    let page = std::fs::read_to_string(dir.join("d1/report.html")).unwrap();
    for expected in ["column-offset-fpn", "row-temporal-noise", "<svg", "Improved camera file"] {
        assert!(page.contains(expected), "{expected}");
    }

    // A rig takes the same captures, so a second run gives the same bytes from them.
    let rig = "capture --camera true.toml --plan diagnosis --frame-seed 5 --rig emulator: -o rig";
    camrig_ok(dir, rig);
    for stack in ["dark-long", "flat-02"] {
        let read = |set: &str| std::fs::read(dir.join(set).join(stack).join("0001.npy")).unwrap();
        assert_eq!(read("rig"), read("captures"), "{stack}");
    }
    camrig_ok(dir, "diagnose base.toml rig -o d2");
    for file in ["diagnosis.json", "camera-improved.toml"] {
        let read = |d: &str| std::fs::read(dir.join(d).join(file)).unwrap();
        assert_eq!(read("d1"), read("d2"), "{file} from a rig as from files");
    }

    // With its own entry left out of the catalogue, an effect does not get the name of another.
    let left = camrig(dir, "diagnose base.toml captures -o d3 --without row-temporal-noise");
    assert_eq!(left.status.code(), Some(1));
    let found = diagnosis(&dir.join("d3"));
    assert!(!names(&found).contains(&"row-temporal-noise"));
    assert!(found["steps"].as_array().unwrap().iter().all(|s| s["status"] == "tentative"));
    assert!(!found["unexplained"].as_array().unwrap().is_empty());

    contradictions(dir);
}

/// The same samples give the same figures, whether a region is read of larger frames or the
/// sensor had read out no more.
#[test]
fn a_region_is_compared_as_a_set_of_its_own() {
    let dir = folder();
    let dir = dir.path();
    take(dir, "true.toml", "whole");
    let roi =
        "capture --camera true.toml --plan diagnosis --frame-seed 5 --roi 32,16,80,64 -o part";
    camrig_ok(dir, roi);
    let of = |words: &str| {
        let run = camrig(dir, &format!("compare base.toml {words} --json --most 0"));
        assert_eq!(run.status.code(), Some(1), "{run:?}");
        (run.stdout, String::from_utf8(run.stderr).unwrap())
    };
    let (part, _) = of("part");
    let (region, said) = of("whole --region 32,16,80,64");
    let figures =
        |json: &[u8]| serde_json::from_slice::<Value>(json).unwrap()["statistics"].clone();
    assert_eq!(figures(&part), figures(&region));
    assert!(said.contains("region 32,16,80,64 of 128 x 128"), "{said}");
    let outside = camrig(dir, "compare base.toml whole --region 64,64,80,64");
    assert_eq!(outside.status.code(), Some(2));
    assert!(String::from_utf8(outside.stderr).unwrap().contains("--region"), "what to type");
}

/// A sensor whose noise in the dark is all in a stage, as an improved camera file may have it, and
/// its flats, the last of them saturated, with photons but no wavelength.
#[test]
fn a_saturated_flat_of_unknown_light_is_no_deviation_and_noise_in_a_stage_is_no_wrong_gain() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let quiet = [("cfa", "\"mono\""), ("read_e", "0.0"), ("read_e_post", "0.0")];
    let camera = small_camera(96, 64, &quiet);
    let stage = "\n[[effect]]\nkind = \"empirical\"\ndomain = \"temporal\"\n\
        shape = \"correlation\"\namount_e = 12.0\ntable = \"taps.toml\"\n";
    std::fs::write(dir.join("camera.toml"), camera + stage).unwrap();
    std::fs::write(dir.join("taps.toml"), "along = \"rows\"\ntaps = [1.0, -0.03]\n").unwrap();
    let flat =
        "role = \"flat\"\nframes = 4\nexposure_s = 0.005\nlight = { wavelength_nm = 550.0 }";
    let plan = format!(
        "format = \"plan/1\"\n[[stack]]\nid = \"dark\"\nrole = \"dark\"\nframes = 8\n\
         exposure_s = 0.01\n[[stack]]\nid = \"flat\"\n{flat}\n\
         fill = {{ from = 0.01, to = 0.8, count = 6 }}\n\
         [[stack]]\nid = \"bright\"\n{flat}\nfill = 1.2\nsaturates = true\n"
    );
    std::fs::write(dir.join("plan.toml"), plan).unwrap();
    camrig_ok(dir, "capture --camera camera.toml --plan plan.toml -o set");
    let manifest = dir.join("set/captures.toml");
    let text = std::fs::read_to_string(&manifest).unwrap();
    let photons = |l: &&str| !l.starts_with("wavelength_nm") && !l.starts_with("irradiance_w_m2");
    let without: Vec<&str> = text.lines().filter(photons).collect();
    std::fs::write(&manifest, without.join("\n")).unwrap();
    let compared = camrig_ok(dir, "compare camera.toml set");
    let notes = String::from_utf8_lossy(&compared.stderr);
    assert!(notes.contains("bright: saturated, and the manifest does not say"), "{notes}");
}

/// A colour camera of 256 x 192 pixels in a folder, and the same sensor of another seed with
/// effects.
fn colour_folder(effects: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let mut base = camrig::camera::presets::file("mt9t012.toml").unwrap().to_string();
    for (from, to) in [("width = 2048", "width = 256"), ("height = 1536", "height = 192")] {
        assert!(base.contains(from));
        base = base.replace(from, to);
    }
    for table in ["mt9m131-qe.csv", "ir-cut-690.csv"] {
        let text = camrig::camera::presets::file(table).unwrap();
        std::fs::write(dir.path().join(table), text).unwrap();
    }
    std::fs::write(dir.path().join("base.toml"), &base).unwrap();
    let hidden = format!("{}{effects}", base.replace("seed = 1", "seed = 23"));
    std::fs::write(dir.path().join("true.toml"), hidden).unwrap();
    camrig_ok(dir.path(), "capture --camera true.toml --plan optics --frame-seed 9000 -o set");
    dir
}

/// The four gaps that Chen et al. 2009 left open (focus, transmittance of the lens, object
/// distance, defects), with row noise in addition, in an edge, dots, charts at 300 lx and 10 lx,
/// darks and flats.
#[test]
#[ignore = "minutes: ci/full; shorter ones are above and in ci/digests"]
fn the_papers_gaps_are_found_together_and_its_measures_close() {
    let hidden = [
        ("defocus", "shift_um = 8.0"),
        ("lens-transmittance", "factor = 0.85"),
        ("distortion", "k1 = -0.02\nsize = 0.995"),
        ("hot-pixels", "fraction = 0.02\nmean_e_per_s = 106.0"),
        ("row-temporal-noise", "sigma_e = 1.5"),
        ("defective-pixels", "fraction = 0.0002"),
    ];
    let effects: String = hidden
        .iter()
        .map(|(kind, keys)| format!("\n[[effect]]\nkind = \"{kind}\"\n{keys}\n"))
        .collect();
    let dir = colour_folder(&effects);
    let dir = dir.path();
    // Status 0 or 1: all of it is named or most of it, because a single hot pixel in a patch may
    // remain.
    assert!(matches!(camrig(dir, "diagnose base.toml set -o d").status.code(), Some(0 | 1)));
    let found = diagnosis(&dir.join("d"));
    // Behind the blur of the defocus, the aperture and the transmittance explain the same; which of
    // them is named may be chance, and that is said.
    let pair = ["f-number", "lens-transmittance"];
    let ambiguous: Vec<Vec<&str>> = found["ambiguous"]
        .as_array()
        .unwrap()
        .iter()
        .map(|a| a["effects"].as_array().unwrap().iter().map(|e| e.as_str().unwrap()).collect())
        .collect();
    let is_told = ambiguous.iter().any(|a| *a == pair);
    let mut named = names(&found);
    if is_told {
        named.iter_mut().filter(|n| pair.contains(n)).for_each(|n| *n = "lens-transmittance");
        named.sort_unstable();
    }
    let mut expected: Vec<&str> = hidden.iter().map(|h| h.0).collect();
    expected.sort_unstable();
    assert_eq!(named, expected, "{found}");
    let figure = |key: &str| found[key].as_f64().unwrap();
    assert!(figure("gap_before") > 50.0 && figure("gap_after") < figure("gap_limit"), "{found}");
    let parameter = |kind: &str, key: &str| {
        let steps = found["steps"].as_array().unwrap();
        let step = steps.iter().find(|s| s["effect"] == kind).unwrap();
        let p = &step["parameters"][key];
        (p["value"].as_f64().unwrap(), p["std_error"].as_f64().unwrap())
    };
    for (kind, key, truth) in [
        ("defocus", "shift_um", 8.0),
        ("lens-transmittance", "factor", 0.85),
        ("distortion", "k1", -0.02),
        ("distortion", "size", 0.995),
    ] {
        if is_told && kind == "lens-transmittance" {
            continue;
        }
        let (value, se) = parameter(kind, key);
        println!("{kind} {key}: {value} ± {se}");
        assert!((value - truth).abs() < 4.0 * se, "{kind} {key}: {value} ± {se}, {truth}");
    }
    // In the measures of the paper, model and captures agree within the difference of two sensors
    // of one kind. That difference is large for so few pixels: the middle third of the edge has 64
    // rows, a patch has 72 samples, and some contain a hot pixel.
    let measures = &found["measures"];
    println!("{measures}");
    for m in measures["mtf_at_nyquist"].as_array().unwrap() {
        let of = |key: &str| m[key].as_f64().unwrap();
        assert!((of("measured") - of("after")).abs() < 4.0 * of("std_dev"), "{m}");
    }
    for m in measures["luminance_scatter"].as_array().unwrap() {
        for k in [0, 1] {
            let of = |key: &str| m[key][k].as_f64().unwrap();
            assert!(of("after") < 2.0 * of("expected"), "{m}");
            assert!(m["capture"] != "chart-300lx" || of("after") < of("before"), "{m}");
        }
    }
    for m in measures["row_profile"].as_array().unwrap() {
        assert!(m["after"].as_f64().unwrap() < 0.8 * m["before"].as_f64().unwrap(), "{m}");
    }
    // The improved camera file loads and has the effects as entries with the reported parameters.
    let improved = std::fs::read_to_string(dir.join("d/camera-improved.toml")).unwrap();
    let entries = improved.parse::<toml::Table>().unwrap();
    let entries = entries["effect"].as_array().unwrap();
    for step in found["steps"].as_array().unwrap() {
        let of = |e: &&toml::Value| e["kind"].as_str() == step["effect"].as_str();
        let entry = entries.iter().find(of).expect(&improved);
        for (key, told) in step["parameters"].as_object().unwrap() {
            let (told, kept) = (told["value"].as_f64().unwrap(), entry[key].as_float().unwrap());
            // Seven digits of f32.
            assert!((told - kept).abs() < 1e-6 * told.abs(), "{key}: {told}, {improved}");
        }
    }
    camrig_ok(
        dir,
        "simulate --camera d/camera-improved.toml --scene dots --lux 300 --exposure 40ms -o a.dng",
    );
    let page = std::fs::read_to_string(dir.join("d/report.html")).unwrap();
    assert!(page.contains("MTF at Nyquist") && page.contains("row profile"));
}

/// With nothing hidden in lens or sensor, no effect is named; with one effect of the optics alone,
/// that effect is.
#[test]
#[ignore = "minutes: ci/full; ci/digests has both with fewer pixels"]
fn optics_that_agree_are_left_alone_and_glare_is_named() {
    let same = colour_folder("");
    camrig_ok(same.path(), "diagnose base.toml set -o d");
    assert_eq!(diagnosis(&same.path().join("d"))["verdict"], "agrees");
    let glare = colour_folder("\n[[effect]]\nkind = \"veiling-glare\"\nfraction = 0.03\n");
    camrig_ok(glare.path(), "diagnose base.toml set -o d");
    let found = diagnosis(&glare.path().join("d"));
    assert_eq!(names(&found), ["veiling-glare"], "{found}");
    let fraction = &found["steps"][0]["parameters"]["fraction"];
    let (value, se) =
        (fraction["value"].as_f64().unwrap(), fraction["std_error"].as_f64().unwrap());
    assert!((value - 0.03).abs() < 4.0 * se, "{value} ± {se}");
}

/// Captures that contradict their manifest.
fn contradictions(dir: &Path) {
    let manifest = std::fs::read_to_string(dir.join("same/captures.toml")).unwrap();
    let refuses = |text: &str, says: &[&str]| {
        std::fs::write(dir.join("same/captures.toml"), text).unwrap();
        let output = camrig(dir, "diagnose base.toml same -o bad");
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{told}");
        for expected in says {
            assert!(told.contains(expected), "should say {expected:?}:\n{told}");
        }
        assert!(!dir.join("bad").exists(), "nothing half-written");
    };
    let mut table: toml::Table = toml::from_str(&manifest).unwrap();
    let entry = |table: &mut toml::Table, id: &str, change: &dyn Fn(&mut toml::Table)| {
        let captures = table["capture"].as_array_mut().unwrap();
        let found = captures.iter_mut().find(|c| c["id"].as_str() == Some(id)).unwrap();
        change(found.as_table_mut().unwrap());
    };
    entry(&mut table, "flat-03", &|c| {
        c.insert("exposure_s".into(), 0.02.into());
    });
    refuses(&table.to_string(), &["flat-03", "exposure"]);
    let mut table: toml::Table = toml::from_str(&manifest).unwrap();
    table["sensor"].as_table_mut().unwrap().insert("bits".into(), 14.into());
    table["sensor"].as_table_mut().unwrap().insert("white_level_dn".into(), 16_383.into());
    refuses(&table.to_string(), &["14 bits", "10 bits"]);
    // A stack that is another's, copied.
    let mut table: toml::Table = toml::from_str(&manifest).unwrap();
    let captures = table["capture"].as_array().unwrap();
    let other = captures.iter().find(|c| c["id"].as_str() == Some("flat-03")).unwrap();
    let files = other["files"].clone();
    entry(&mut table, "flat-04", &|c| {
        c.insert("files".into(), files.clone());
    });
    refuses(&table.to_string(), &["identical-frames", "flat-04", "copies"]);
    let output = camrig(dir, "captures check same");
    let told = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("identical-frames: flat-04"), "{told}");
    std::fs::write(dir.join("same/captures.toml"), &manifest).unwrap();
    let clean = camrig_ok(dir, "captures check same");
    assert!(String::from_utf8_lossy(&clean.stdout).contains("nothing found"));
    // Too few frames to fit to some and judge with others.
    camrig_ok(dir, "capture --camera base.toml --plan diagnosis --frames 1 -o few");
    let output = camrig(dir, "diagnose base.toml few -o bad");
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("at least four frames"), "{told}");
    let output = camrig(dir, "diagnose base.toml same -o bad --without row-noise");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("row-offset-fpn"));
}

/// Sets made by the independent generator in `tests/hidden`.
#[test]
fn an_effect_hidden_by_another_program_is_found() {
    hidden_sets_are_diagnosed(&[(
        "coupled",
        "--effects charge-coupling --times 10 --draw 18",
        &["charge-coupling"],
    )]);
}

/// In the third set, two effects explain better what one random pattern would explain at once.
/// In the last, the mean of a shading and of defects is no quantum efficiency.
#[test]
#[ignore = "minutes: ci/full"]
fn effects_hidden_by_another_program_are_found() {
    hidden_sets_are_diagnosed(&[
        ("none", "--effects none --draw 17", &[]),
        ("hot", "--effects hot-pixels --times 10 --draw 19", &["hot-pixels"]),
        (
            "two",
            "--effects green-imbalance=0.0061,column-gain-fpn=0.00254 --cfa GRBG \
            --draw 3943319205",
            &["column-gain-fpn", "green-imbalance"],
        ),
        (
            "shaded",
            "--effects \
             defective-pixels=0.00194,green-imbalance=0.00375,relative-illumination=0.00688 \
             --cfa GRBG --draw 4123995186",
            &["defective-pixels", "green-imbalance", "relative-illumination"],
        ),
    ]);
}

/// Sets by name, the generator's arguments, and the effects to be named.
fn hidden_sets_are_diagnosed(sets: &[(&str, &str, &[&str])]) {
    let generator = Path::new(env!("CARGO_MANIFEST_DIR")).join("hidden/generate.py");
    let numpy = Command::new("python3").args(["-c", "import numpy"]).output();
    if !numpy.is_ok_and(|o| o.status.success()) {
        println!("SKIP: python3 has no numpy (hidden data)");
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    for (name, hidden, expected) in sets {
        let set = dir.path().join(name);
        let made = Command::new("python3")
            .arg(&generator)
            .arg(&set)
            .args(hidden.split_whitespace())
            .output()
            .unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        camrig_ok(dir.path(), &format!("diagnose {name}/camera.toml {name} -o d-{name}"));
        let found = diagnosis(&dir.path().join(format!("d-{name}")));
        assert_eq!(names(&found), *expected, "{found}");
        std::fs::remove_dir_all(&set).unwrap();
    }
}
