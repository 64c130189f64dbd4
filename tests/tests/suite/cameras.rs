//! Built-in sensors, and camera files that are made from a data sheet.

use super::{camrig, camrig_ok, shared};
use camrig::camera::{Camera, presets};
use camrig::render::{CubeHeader, IrradianceCube, SimulatedSensor};
use camrig::scene::Bands;
use camrig::validate::datasheet::Datasheet;
use std::path::Path;

/// Every fact that is not derived here is a line of the list with its sources.
#[test]
fn facts_on_sensors_are_those_of_the_list() {
    let Some(list) = shared("data/sensors/library/sensors.csv") else { return };
    let list = std::fs::read_to_string(list).unwrap();
    let known: std::collections::HashSet<&str> = list.lines().collect();
    let facts = presets::file("sensors.csv").unwrap();
    let facts = facts.lines().filter(|line| !line.starts_with('#') && !line.contains(",derived,"));
    let unknown: Vec<&str> = facts.filter(|line| !known.contains(line)).collect();
    assert!(unknown.is_empty(), "{unknown:#?}");
}

#[test]
fn the_page_of_the_sensors_is_up_to_date() {
    let page = camrig_ok(Path::new("."), "presets --markdown").stdout;
    let kept = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/sensors.md"));
    assert!(
        page == std::fs::read(kept).unwrap_or_default(),
        "it has changed: camrig presets --markdown > docs/sensors.md"
    );
}

/// Even light on the pixels of every preset: the mean in each channel is black + K (photons x QE +
/// dark current), within 5 standard errors (shot, read and pixel noise of 48 x 48 pixels; rows
/// share their offset) and the f32 of the chain.
#[test]
fn every_preset_gives_the_mean_of_its_parameters() {
    const SIDE: usize = 48;
    let bands = Bands::VISIBLE;
    let alone = |camera: Camera| match &camera.sensor.hdr {
        None => vec![camera],
        Some(hdr) => (0..hdr.captures.len()).map(|i| camera.of_capture(i).unwrap()).collect(),
    };
    let cameras = presets::names().into_iter().flat_map(|name| alone(Camera::load(name).unwrap()));
    for mut camera in cameras {
        let name = camera.name.clone();
        (camera.sensor.width, camera.sensor.height) = (SIDE as u32, SIDE as u32);
        let header = CubeHeader::new((SIDE, SIDE), &bands, "");
        let s = &camera.sensor;
        let exposure_s = 0.01;
        let responses: Vec<f64> = s.response(&bands).iter().map(|r| r.iter().sum()).collect();
        let most = responses.iter().fold(0.0f64, |m, &r| m.max(r));
        let level = 0.4 * s.saturation_e(1.0) / (most * exposure_s);
        let cube = IrradianceCube::uniform(header, &vec![level as f32; bands.count]).unwrap();
        let sensor = SimulatedSensor::new(&camera, &cube.header).unwrap();
        let settings = camera.settings(0, exposure_s, None);
        let frame = sensor.frame(&cube, &settings).unwrap();
        let dn_per_e = s.dn_per_e(1.0);
        for (channel, response) in responses.iter().enumerate() {
            let at = |p: &usize| s.cfa.channel(p % SIDE, p / SIDE) == channel;
            let pixels: Vec<usize> = (0..SIDE * SIDE).filter(at).collect();
            let n = pixels.len() as f64;
            let mean = pixels.iter().map(|&p| f64::from(frame.data[p])).sum::<f64>() / n;
            let light = response * level * exposure_s;
            let dark = s.noise.dark_current_e_per_s * exposure_s;
            let expected = s.black_level_dn + dn_per_e * (light + dark);
            let variance = light
                + dark
                + s.noise.read_e.powi(2)
                + (s.noise.prnu * light).powi(2)
                + (s.noise.dsnu_e_per_s * exposure_s).powi(2);
            let of_rows = s.noise.row_fpn_e.powi(2) / (SIDE as f64 / s.cfa.height as f64);
            let error = dn_per_e * (variance / n + of_rows).sqrt();
            let arithmetic = 1e-4 * dn_per_e * light;
            assert!(
                (mean - expected).abs() < 5.0 * error + arithmetic,
                "{name}, channel {channel}: {mean} for {expected} +- {error}"
            );
        }
    }
}

/// A data sheet, measured on simulated captures of a few pixels, says what was put in, within 5
/// standard errors: system gain, read noise (the dark noise at no exposure) where rounding does not
/// hide it, and the efficiency at 550 nm, behind the infrared cut filter, of
/// the channel that sees it best.
#[test]
fn data_sheets_say_what_is_known_of_the_sensors() {
    for name in ["imx586", "imx477", "ar0231", "imx415", "gsense400bsi"] {
        let camera = Camera::load(name).unwrap();
        let sheet = Datasheet::measure(&camera, (48, 32)).unwrap();
        let s = &camera.sensor;
        let filter = s.ir_cut.as_ref().map_or(1.0, |filter| filter.at(550.0));
        let at_550 = |c: &usize| s.qe[*c].at(550.0) * filter;
        let c = (0..s.qe.len()).max_by(|a, b| at_550(a).total_cmp(&at_550(b))).unwrap();
        let near = |what: &str, found: camrig::measure::Value, known: f64| {
            let off = (found.value - known).abs();
            assert!(off < 5.0 * found.std_error, "{name}: {what} {found:?} for {known}");
        };
        let gain = f64::from((1u32 << s.bits) - 1) / s.full_well_e;
        let figures = &sheet.emva.channels[c].figures;
        near("K", figures.overall_system_gain.unwrap(), gain);
        let read_e = s.noise.read_e;
        match figures.temporal_dark_noise_e {
            Some(found) => near("read noise", found, read_e),
            None => assert!(gain * read_e < 0.5, "{name}: {} DN are not measured", gain * read_e),
        }
        let green = sheet.efficiency.iter().find(|e| e.wavelength_nm == 550.0).unwrap();
        let values = &green.channels;
        near("efficiency", values[c], at_550(&c));
    }
}

/// What a new user types: a file for the IMX219, which simulates without a word.
#[test]
fn a_camera_file_like_a_sensor_simulates_without_a_word() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let told = camrig_ok(dir, "camera new --like imx219 --f-number 2.4 -o my-camera.toml").stderr;
    let told = String::from_utf8(told).unwrap();
    for file in ["my-camera.toml", "imx219-relative-qe.csv", "ir-cut-690.csv"] {
        assert!(told.contains(file) && dir.join(file).exists(), "{told}");
    }
    assert!(told.contains("are typical: ") && told.contains("fill_factor = 1"), "{told}");
    let text = std::fs::read_to_string(dir.join("my-camera.toml")).unwrap();
    assert!(text.contains("f_number = 2.4") && text.contains("# given"), "{text}");
    let small = "--set sensor.width=64 --set sensor.height=48 --no-cache";
    let simulate = format!(
        "simulate --camera ./my-camera.toml {small} --scene uniform:0.2 --exposure 10ms -o a.dng"
    );
    let said = String::from_utf8(camrig_ok(dir, &simulate).stderr).unwrap();
    for word in ["note", "warning", "error"] {
        assert!(!said.contains(word), "{said}");
    }
    // A second camera with the same tables; the file itself is not replaced unasked.
    camrig_ok(dir, "camera new --sensor imx219 -o other.toml");
    let again = camrig(dir, "camera new --like imx477 -o my-camera.toml");
    let told = String::from_utf8_lossy(&again.stderr).into_owned();
    assert!(again.status.code() == Some(2) && told.contains("--force"), "{told}");
    assert!(!dir.join("mobile-qe.csv").exists(), "half of the files was written");
    assert_eq!(std::fs::read_to_string(dir.join("my-camera.toml")).unwrap(), text);
}

/// The figures of a data sheet as flags; points of the efficiency become a table.
#[test]
fn a_camera_file_from_a_data_sheet_has_its_figures() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    camrig_ok(
        dir,
        "camera new -o mono.toml --pixels 2464x2056 --pitch-um 3.45 --bits 12 --cfa mono \
         --full-well-e 10400 --read-noise-e 2.1 --qe 450:0.56,529:0.64,650:0.5 \
         --set sensor.noise.prnu=0.005",
    );
    let camera = Camera::load(dir.join("mono.toml").to_str().unwrap()).unwrap().sensor;
    assert_eq!((camera.width, camera.height, camera.bits), (2464, 2056, 12));
    assert_eq!(
        (camera.full_well_e, camera.noise.read_e, camera.noise.prnu),
        (10400.0, 2.1, 0.005)
    );
    assert_eq!([450.0, 529.0, 650.0].map(|nm| camera.qe[0].at(nm)), [0.56, 0.64, 0.5]);
    let rggb = "camera new -o rggb.toml --pixels 3280x2464 --pitch-um 1.12 --bits 10 --cfa RGGB";
    camrig_ok(dir, rggb);
    let camera = Camera::load(dir.join("rggb.toml").to_str().unwrap()).unwrap().sensor;
    assert_eq!((camera.pitch_um, camera.cfa.to_string()), (1.12, "RGGB".to_string()));
    let wrong =
        camrig(dir, "camera new -o x.toml --pixels 3280 --bits ten --qe 1:2 --set sensor.x=1");
    let told = String::from_utf8_lossy(&wrong.stderr).into_owned();
    assert_eq!(wrong.status.code(), Some(2), "{told}");
    for words in [
        "sensor.height in pixels, usually 480 to 6000",
        "sensor.pitch_um in µm, usually 0.6 to 2 in phones",
        "sensor.cfa, usually RGGB",
        "sensor.bits = \"ten\"",
        "\"1:2\" is no point",
        "\"sensor.x\" is no key",
        "--pitch-um",
    ] {
        assert!(told.contains(words), "{words}: {told}");
    }
    assert!(!dir.join("x.toml").exists());
    let bare = camrig(dir, "camera new -o mine --like imx219");
    assert!(String::from_utf8_lossy(&bare.stderr).contains("FILE.toml"));
}

/// Every value of a preset has a grade, and a source unless it is typical or derived from facts.
#[test]
fn explanations_give_the_source_of_every_value() {
    for name in ["imx477", "imx174", "gsense400bsi", "mt9v024", "mobile"] {
        let output = camrig_ok(Path::new("."), &format!("explain {name} --json")).stdout;
        let told: serde_json::Value = serde_json::from_slice(&output).unwrap();
        let values = told["values"].as_array().unwrap();
        let file: toml::Table =
            toml::from_str(presets::file(&format!("{name}.toml")).unwrap()).unwrap();
        let count = |table: &toml::Value| {
            table.as_table().unwrap().values().filter(|value| !value.is_table()).count()
        };
        let in_file =
            count(&file["lens"]) + count(&file["sensor"]) + count(&file["sensor"]["noise"]);
        assert_eq!(values.len(), in_file, "{name}");
        for value in values {
            let (grade, source) = (value["grade"].as_str().unwrap(), value["source"].as_str());
            assert!(grade == "typical" || !source.unwrap().is_empty(), "{name}: {value}");
        }
    }
    let told = camrig_ok(Path::new("."), "explain sensor.full_well_e").stdout;
    let told = String::from_utf8(told).unwrap();
    assert!(told.lines().any(|l| l.contains("imx477") && l.contains("measured")), "{told}");
    let file = String::from_utf8(camrig_ok(Path::new("."), "presets imx477").stdout).unwrap();
    assert!(file.lines().any(|l| l.starts_with("read_e = 3.0") && l.contains("# measured [")));
}

/// A key that no camera file has is refused by name wherever a camera is taken, before any work;
/// one that it has changes what the command does.
#[test]
fn every_command_that_takes_a_camera_takes_changes_to_its_file() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    for command in [
        "simulate --camera mt9v024 --scene ramp --exposure 1ms -o x.npy",
        "expose --camera mt9v024 --irradiance x.irr --exposure 1ms -o x.npy",
        "isp --camera mt9v024 --exposure 1ms",
        "capture --camera mt9v024 --plan ptc -o set",
        "crosstalk bench --camera mt9v024 -o bench",
        "rig stream emulator: --camera mt9v024 --scene ramp --exposure 1ms",
        "rig view emulator: --camera mt9v024 --scene ramp",
        "datasheet mt9v024 -o sheets",
        "compare mt9v024 set",
        "diagnose mt9v024 set -o diagnosis",
        "validate paper --model mt9v024",
    ] {
        let run = camrig(dir, &format!("{command} --set sensor.noise.reed_e=1"));
        let said = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(2), "{command}: {said}");
        assert!(said.contains("reed_e") && run.stdout.is_empty(), "{command}: {said}");
    }
    let black = "--set sensor.black_level_dn=77";
    camrig_ok(dir, &format!("capture --camera mt9v024 --plan ptc --size 48,32 -o set {black}"));
    let set = std::fs::read_to_string(dir.join("set/captures.toml")).unwrap();
    assert!(set.contains("black_level_dn = 77"), "{set}");
    // The model has what the captures were taken with, or has not.
    let compared = |changes: &str| camrig(dir, &format!("compare mt9v024 set {changes}")).status;
    assert_eq!(compared(black).code(), Some(0));
    assert_eq!(compared("").code(), Some(1));
}

/// The paper's section VI in short, on a seventh of the pixels: with the causes in the model, what is
/// left of the differences is within the bars, MTF50 to 2 %; the scatter of patches of so few pixels
/// is not judged.
#[test]
fn the_papers_differences_vanish_with_their_causes() {
    let size = "--set sensor.width=768 --set sensor.height=576";
    let run = camrig(Path::new("."), &format!("validate paper {size} --json"));
    let told: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    let (before, after) = (&told["before"], &told["after"]);
    assert!(before["mtf50_percent"].as_f64().unwrap() < -5.0, "{before}");
    assert!(after["mtf50_percent"].as_f64().unwrap().abs() < 2.0, "{after}");
    for figure in ["MTF50", "brightness", "displacement", "defects"] {
        let failures = told["failures"].as_array().unwrap();
        assert!(!failures.iter().any(|f| f.as_str().unwrap().contains(figure)), "{failures:?}");
    }
}

/// Two DNGs of one camera, at ISO 100 and 800: their tags give gain, read noise and its part behind
/// the gain stage, with the noise of an effect.
#[test]
fn two_raw_files_tell_the_noise_of_their_camera() {
    let folder = tempfile::tempdir().unwrap();
    let size = "--set sensor.width=64 --set sensor.height=48 --set sensor.noise.read_e_post=1.5";
    for (gain, file) in [(1, "iso100.dng"), (8, "iso800.dng")] {
        camrig_ok(
            folder.path(),
            &format!(
                "simulate --camera mobile {size} --scene uniform:0.2 --exposure 4ms --gain {gain} \
                 -o {file}"
            ),
        );
    }
    camrig_ok(
        folder.path(),
        "camera new --pitch-um 1.12 --noise iso100.dng iso800.dng -o again.toml",
    );
    let again = Camera::load(folder.path().join("again.toml").to_str().unwrap()).unwrap().sensor;
    let truth = Camera::load("mobile").unwrap().sensor;
    let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-4, "{a} for {b}");
    near(again.full_well_e, truth.full_scale_e);
    near(again.noise.read_e, truth.noise.read_e);
    near(again.noise.read_e_post, 1.5);
    near(again.black_level_dn, truth.black_level_dn);
    assert_eq!((again.width, again.bits, again.cfa), (64, truth.bits, truth.cfa));
}

/// What another program's form cannot hold is said, with how far it is off, and for programs too:
/// the part of the read noise behind the gain stage bends what PMN has as a line, libcamera has
/// none. What a form holds is no note.
#[test]
fn what_a_form_cannot_hold_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let export = |form: &str, changes: &str| {
        let output = camrig(
            dir,
            &format!("camera export mobile {changes} --as {form} -o {form} --force --json"),
        );
        assert!(output.status.success(), "{output:?}");
        let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        (object, String::from_utf8(output.stderr).unwrap())
    };
    let post = "--set sensor.noise.read_e=5 --set sensor.noise.read_e_post=4.5";
    let (pmn, told) = export("pmn", post);
    let figure = &pmn["differs"][0];
    let [camera, form] = ["camera", "form"].map(|key| figure[key].as_f64().unwrap());
    assert!(figure["figure"].as_str().unwrap().contains("noise in the dark"), "{pmn}");
    assert!((form / camera - 1.0).abs() > 0.05, "{pmn}");
    assert!(told.contains("% off") && told.contains("nothing of sensor.noise.prnu"), "{told}");
    let (libcamera, told) = export("libcamera", post);
    let camera = libcamera["differs"][0]["camera"].as_f64().unwrap();
    assert!(camera > 2.0 && told.contains("noise in the dark"), "{told}");
    for form in ["profile", "darktable"] {
        let (same, told) = export(form, post);
        assert_eq!(same["differs"], serde_json::json!([]), "{form}: {told}");
        assert!(told.contains("nothing of"), "{told}");
    }
    // A step of the conversion gain between two of the gains is not in their profiles.
    camrig_ok(dir, "camera new --like imx219 -o step.toml");
    let text = std::fs::read(dir.join("step.toml")).unwrap();
    let step = "\n[sensor.gains]\nat = [1, 3, 3, 16]\nread_e = [5, 3, 2, 1]\n";
    std::fs::write(dir.join("step.toml"), [&text[..], step.as_bytes()].concat()).unwrap();
    let output = camrig(dir, "camera export ./step.toml --as profile -o step.csv");
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.contains("noise in the dark") && told.contains("% off"), "{told}");
}

/// A folder that is missing is said before the captures are read.
#[test]
fn a_fit_says_first_what_it_cannot_write() {
    let folder = tempfile::tempdir().unwrap();
    for outputs in ["-o missing/c.toml", "-o c.toml --report missing/c.html"] {
        let output = camrig(folder.path(), &format!("camera fit nothing {outputs}"));
        assert_eq!(output.status.code(), Some(2));
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(told.contains("the folder does not exist"), "{told}");
    }
}
