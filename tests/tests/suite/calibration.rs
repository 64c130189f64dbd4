//! The closed loop: our own camera takes a spectral scene at several exposures, and calibration
//! recovers the response curve, the light and the reflectances.

use super::{camera, camrig, camrig_ok, shared, small_camera};
use camrig::calibrate::response::Response;
use camrig::camera::Camera;
use camrig::scene::chart::colorchecker;
use camrig::scene_files::numpy::read_plane;
use std::path::Path;

const SIZE: (u32, u32) = (752, 480);
/// Width of the card of the chart in frame widths (the default of the chart).
const CARD: f64 = 0.8;

/// A small MT9T012 whose pixels do not depend on their place, with `effects` appended.
fn camera_file(effects: &str) -> String {
    let mut text = small_camera(
        SIZE.0,
        SIZE.1,
        &[
            ("relative_illumination", "\"none\""),
            ("bits", "12"),
            ("qe", "\"qe.csv\""),
            ("ir_cut", "\"ir-cut.csv\""),
        ],
    );
    text.push_str(effects);
    text
}

/// A folder with the camera `c.toml`, its quantum efficiency, and a plan of 8 frames per exposure
/// of `scene` with darks beside them.
fn folder(effects: &str, scene: &str, light: &str, exposures: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    write("c.toml", &camera_file(effects));
    let qe = camrig::camera::presets::file("mt9m131-qe.csv").expect("the preset's table");
    write("qe.csv", qe);
    write("ir-cut.csv", camrig::camera::presets::file("ir-cut-690.csv").expect("its filter"));
    let stack = |id: &str, rest: &str| {
        format!("[[stack]]\nid = \"{id}\"\nframes = 8\nexposure_s = {exposures}\n{rest}\n")
    };
    let seen =
        format!("role = \"chart\"\nsaturates = true\nscene = {{ scene = \"{scene}\" }}\n{light}");
    let plan = format!(
        "format = \"plan/1\"\n{}{}",
        stack("seen", &seen),
        stack("dark", "role = \"dark\"")
    );
    write("plan.toml", &plan);
    dir
}

const D65: &str = "light = { illuminant = \"D65\", lux = 300.0 }";
const DOUBLING: &str = "[0.004, 0.008, 0.016, 0.032, 0.064, 0.128, 0.256]";

fn responses(dir: &Path) -> Vec<Response> {
    let text = std::fs::read_to_string(dir.join("response/response.toml")).unwrap();
    let file: toml::Table = toml::from_str(&text).unwrap();
    file["response"].clone().try_into().unwrap()
}

/// A linear camera, and one that bends by 3 % and so saturates at 97 % of the converter's range,
/// above the 95 % that count as saturated. The reference is the stage of sensor-core and its
/// inverse in closed form. The curve of every channel must be within 1 % over its whole range,
/// with the scale set at half of it.
#[test]
fn response_of_a_known_camera_is_within_1_percent() {
    let full_well_e = camera(&small_camera(8, 8, &[])).sensor.full_well_e;
    let bent = "\n[[effect]]\nkind = \"nonlinearity\"\nloss = 0.03\nexponent = 1.0\n";
    for (effects, fraction) in [("", 0.0), (bent, 0.03)] {
        let dir = folder(effects, "colorchecker", D65, DOUBLING);
        camrig_ok(dir.path(), "capture --camera c.toml --plan plan.toml -o captures");
        camrig_ok(dir.path(), "scene response captures -o response");
        let full_scale_dn = 4095.0; // of full well, eq. 11
        // y = e (1 − a e/W): e = W (1 − √(1 − 4 a y/W)) / (2a).
        let electrons = |dn: f64| {
            let y = dn / full_scale_dn * full_well_e;
            match fraction {
                0.0 => y,
                a => full_well_e * (1.0 - (1.0 - 4.0 * a * y / full_well_e).sqrt()) / (2.0 * a),
            }
        };
        for r in responses(dir.path()) {
            let [least, most] = r.range_dn;
            assert!(most / least > 50.0, "{}: {least} to {most} DN", r.channel);
            let points: Vec<f64> =
                (0..=60).map(|i| least * (most / least).powf(f64::from(i) / 60.0)).collect();
            let ratio: Vec<f64> =
                points.iter().map(|&dn| r.linear_dn(dn) / electrons(dn)).collect();
            let (low, high) =
                ratio.iter().fold((f64::MAX, 0.0f64), |(a, b), &v| (a.min(v), b.max(v)));
            // The scale is free, hence within ± 1 % of the middle.
            let worst = (high / low).sqrt() - 1.0;
            println!("bent by {fraction}: {} within {:.2} %", r.channel, 100.0 * worst);
            assert!(worst < 0.01, "{} {fraction}: {:.2} %", r.channel, 100.0 * worst);
        }
    }
}

/// 26 lamps over 100 dB. They are small, because diffraction alone spreads a hundred-thousandth of
/// a large one over the whole frame. The merged frame is compared in absolute terms (electrons per
/// second times DN per electron) with the irradiance of the optics stage, within 2 % at every
/// lamp.
#[test]
fn radiance_over_100_db_is_within_2_percent() {
    const LAMPS: usize = 26;
    let exposures = "[2e-5, 8e-5, 3.2e-4, 1.28e-3, 5.12e-3, 2.048e-2, 8.192e-2, 0.32768]";
    let scene = "lamps.npy:quantity=radiance,start_nm=500,step_nm=50";
    let dir = folder("", scene, "", exposures);
    // A cell of the scene is some ten pixels wide; a lamp has 2 x 2 of them.
    let (rows, columns, bands) = (48, 75, 3);
    let place = |lamp: usize| (5 + lamp % 7 * 10, 5 + lamp / 7 * 11);
    let mut radiance = vec![1e-6f32; rows * columns];
    for lamp in 0..LAMPS {
        let (x, y) = place(lamp);
        for (x, y) in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)] {
            radiance[y * columns + x] = 4.0 * 10f32.powf(-(lamp as f32) / 4.8);
        }
    }
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    let header = format!(
        "{{'descr': '<f4', 'fortran_order': False, 'shape': ({rows}, {columns}, {bands}), }}"
    );
    bytes.extend(118u16.to_le_bytes());
    bytes.extend(format!("{header:<117}\n").bytes());
    radiance.iter().for_each(|v| (0..bands).for_each(|_| bytes.extend(v.to_le_bytes())));
    std::fs::write(dir.path().join("lamps.npy"), bytes).unwrap();
    camrig_ok(dir.path(), "capture --camera c.toml --plan plan.toml -o captures");
    camrig_ok(dir.path(), "scene hdr captures -o merged");
    camrig_ok(
        dir.path(),
        &format!(
            "simulate --camera c.toml --scene {scene} --exposure 1ms -o a.npy \
            --save-irradiance a.irr"
        ),
    );
    let merged = read_plane(&dir.path().join("merged/radiance.npy")).unwrap();
    let camera = Camera::load(dir.path().join("c.toml").to_str().unwrap()).unwrap();
    let cube = camrig::render::IrradianceCube::open(&dir.path().join("a.irr")).unwrap();
    let of = cube.header.spectral_bands();
    let response = camera.sensor.response(&of);
    let dn_per_e = 4095.0 / camera.sensor.full_well_e;
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let mut electrons_per_s = vec![0.0; width * height];
    for band in 0..of.count {
        let rows = cube.chunk(band, 0, height).unwrap();
        for y in 0..height {
            let mut line = vec![0.0f32; width];
            camrig_sensor_core::spectral::decode(rows.row(width, y), &mut line);
            for x in 0..width {
                let channel = camera.sensor.cfa.channel(x, y);
                electrons_per_s[y * width + x] += f64::from(line[x]) * response[channel][band];
            }
        }
    }
    let (mut least, mut most) = (f64::MAX, 0.0f64);
    let cell = width as f64 / columns as f64;
    for lamp in 0..LAMPS {
        let (x, y) = place(lamp);
        let x = ((x + 1) as f64 * cell) as usize;
        let y = (height as f64 / 2.0 + (y as f64 + 1.0 - rows as f64 / 2.0) * cell) as usize;
        let (mut got, mut expected) = (0.0, 0.0);
        for y in y - 5..y + 5 {
            for x in x - 5..x + 5 {
                got += f64::from(merged.at(x, y));
                expected += electrons_per_s[y * width + x] * dn_per_e;
            }
        }
        println!("lamp {lamp}: {:.2} % off", 100.0 * (got / expected - 1.0));
        assert!((got / expected - 1.0).abs() < 0.02, "lamp {lamp}: {got} where {expected} was");
        (least, most) = (least.min(expected), most.max(expected));
    }
    assert!(20.0 * (most / least).log10() > 100.0, "{:.1} dB", 20.0 * (most / least).log10());
}

/// Reflectances of the patches from merged frames against the painted ones. The error of each
/// patch is printed, and none is larger than the error when the patch is left out of the training,
/// with a quarter added for noise and rounding.
#[test]
fn reflectances_of_a_known_scene_are_within_their_stated_errors() {
    let dir = folder("", "colorchecker", D65, DOUBLING);
    camrig_ok(dir.path(), "capture --camera c.toml --plan plan.toml -o captures");
    camrig_ok(dir.path(), "scene hdr captures -o merged");
    let place = |index: usize| colorchecker::patch(index, CARD).map(|v| v * f64::from(SIZE.0));
    let middle = (f64::from(SIZE.0) / 2.0, f64::from(SIZE.1) / 2.0);
    let (first, last) = (place(0), place(23));
    let chart = format!(
        "{},{},{},{}",
        middle.0 + first[0],
        middle.1 + first[1],
        last[0] + last[2] - first[0],
        last[1] + last[2] - first[1]
    );
    let output = camrig_ok(
        dir.path(),
        &format!(
            "scene spectral merged --camera c.toml --illuminant D65 --chart {chart} -o scene \
            --json"
        ),
    );
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    // Error from the noise of the sensor in 24 means of 8 frames, and from blur at the edges of
    // patches.
    assert!(told["chart_residual"].as_f64().unwrap() < 0.005, "{told}");
    let left_out = &told["leave_one_out"]["rmse_per_patch"];
    let cube = camrig::scene_files::open_file(dir.path().join("scene").to_str().unwrap()).unwrap();
    let table = colorchecker::reflectances();
    let bands = camrig::scene::Scene::bands(&cube);
    let planes: Vec<_> = (0..bands.count).map(|b| cube.band(b).unwrap()).collect();
    for index in 0..24 {
        let [left, top, edge] = place(index);
        // A cell of the pattern is a pixel of the scene.
        let (x, y) = ((middle.0 + left + edge / 2.0) / 2.0, (middle.1 + top + edge / 2.0) / 2.0);
        let truth = table.spectrum(index).unwrap().in_bands(&bands);
        let mut square = 0.0;
        for (plane, truth) in planes.iter().zip(&truth) {
            let cells = (0..64).map(|i| plane.at(x as usize - 4 + i % 8, y as usize - 4 + i / 8));
            let mean = cells.map(f64::from).sum::<f64>() / 64.0;
            square += (mean - truth).powi(2);
        }
        let rmse = (square / bands.count as f64).sqrt();
        let bound = 1.25 * left_out[index].as_f64().unwrap();
        println!("patch {:2}: rmse {rmse:.4}, left out {:.4}", index + 1, bound / 1.25);
        assert!(rmse < bound, "patch {}: {rmse} beyond {bound}", index + 1);
    }
    println!(
        "left out {}, pseudo-inverse {}",
        told["leave_one_out"]["rmse"], told["pseudo_inverse"]["rmse"]
    );
    let (ours, plain) = (&told["leave_one_out"]["rmse"], &told["pseudo_inverse"]["rmse"]);
    assert!(ours.as_f64().unwrap() * 1.5 < plain.as_f64().unwrap(), "{ours} {plain}");
}

/// Frames that cannot give a scene are refused with a reason.
#[test]
fn frames_that_cannot_give_a_scene_are_refused() {
    let dir = folder("", "colorchecker", D65, "[0.016, 0.032]");
    camrig_ok(dir.path(), "capture --camera c.toml --plan plan.toml --frames 2 -o captures");
    let refused = |arguments: &str, says: &[&str]| {
        let output = camrig(dir.path(), arguments);
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "camrig {arguments}\n{told}");
        for word in says {
            assert!(told.contains(word), "camrig {arguments}\nshould say {word:?}: {told}");
        }
        assert!(!dir.path().join("out").exists(), "half-written output");
    };
    refused("scene hdr captures --only seen-00 -o out", &["fewer than two exposures"]);
    refused("scene response captures --only seen-00 -o out", &["fewer than two exposures"]);
    refused("scene hdr captures --only seen-07 -o out", &["seen-07", "did you mean"]);
    camrig_ok(dir.path(), "scene hdr captures -o merged");
    let spectral = "scene spectral merged --camera c.toml -o out --chart";
    refused(&format!("{spectral} 0,0,200,120"), &["no ColorChecker"]);
    refused(&format!("{spectral} 0,0,1000,60"), &["752 x 480"]);
    refused("scene spectral merged --camera c.toml -o out --white 0,0,1,1", &["lies at"]);

    let manifest = std::fs::read_to_string(dir.path().join("captures/captures.toml")).unwrap();
    let rewrite =
        |text: String| std::fs::write(dir.path().join("captures/captures.toml"), text).unwrap();
    // The same frames, declared to have five times the exposure.
    rewrite(manifest.replacen("exposure_s = 0.032", "exposure_s = 0.16", 1));
    refused("scene hdr captures -o out", &["times the light", "exposure_s"]);
    rewrite(manifest.replacen("width = 752", "width = 750", 1));
    refused("scene hdr captures -o out", &["752 x 480", "750 x 480"]);
    rewrite(manifest);
    // Every patch is beyond full scale at both exposures.
    let bright =
        std::fs::read_to_string(dir.path().join("plan.toml")).unwrap().replace("300.0", "90000.0");
    std::fs::write(dir.path().join("plan.toml"), bright).unwrap();
    camrig_ok(dir.path(), "capture --camera c.toml --plan plan.toml --frames 2 -o full");
    refused("scene response full -o out", &["saturated"]);
}

/// Real data through the commands for them: seven exposures of a camera through a filter, and a
/// photograph with the spectra of a ColorChecker beside it.
#[test]
fn real_captures_give_a_curve_and_a_merged_frame() {
    let Some(path) = shared("data/captures/bllanos_narrowband_7x7") else { return };
    let dir = tempfile::tempdir().unwrap();
    let set = path.display();
    let ids: Vec<String> = ["25ms", "50ms", "100ms", "250ms", "500ms", "2000ms", "3916ms"]
        .iter()
        .map(|t| format!("dots-d1_550nm_{t}"))
        .collect();
    let only = ids.join(",");
    let output = camrig_ok(
        dir.path(),
        &format!("scene response {set} --only {only} --cfa GBRG -o response --json"),
    );
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    println!("{told}");
    let green = told["channels"]["g"]["residual_percent"].as_f64().unwrap();
    // The set's exposure times agree with each other to 2 %.
    assert!(green < 2.0, "{told}");
    let output = camrig_ok(
        dir.path(),
        &format!("scene hdr {set} --only {only} --cfa GBRG -o merged --json"),
    );
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    println!("{told}");
    // 8 bits (48 dB), and exposures whose times have a ratio of 157 (44 dB).
    assert!(told["dynamic_range_db"].as_f64().unwrap() > 70.0, "{told}");
    // Merged light against the longest exposure alone, where that is neither dark nor full and
    // nothing is flagged. Exposures agree to 2 %, and clipped blacks to 1 or 2 DN of the 60. (Dark
    // spots of 8-bit frames are often flagged, because their short exposures are clipped to 0.)
    let merged = read_plane(&dir.path().join("merged/radiance.npy")).unwrap();
    let flags = read_plane(&dir.path().join("merged/flags.npy")).unwrap();
    let captures = camrig::captures::CaptureSet::load(&path).unwrap();
    let series = camrig::calibrate::exposures::read(&captures, &ids).unwrap();
    let longest = series[0].exposures.last().unwrap();
    let mut ratios: Vec<f32> = (merged.data.iter().zip(&longest.signal.data).zip(&flags.data))
        .filter(|((_, dn), flag)| (60.0..230.0).contains(*dn) && **flag == 0.0)
        .map(|((light, dn), _)| light * longest.seconds as f32 / dn)
        .collect();
    ratios.sort_by(f32::total_cmp);
    if let Some(median) = ratios.get(ratios.len() / 2).filter(|_| ratios.len() > 100) {
        println!("{} pixels, median ratio {median:.4}", ratios.len());
        assert!((median - 1.0).abs() < 0.05, "{median}");
    }
}
