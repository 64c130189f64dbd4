//! Forms of other programs, there and back.

use super::imported::number;
use super::*;
use camrig_camera::Camera;
use camrig_camera::draft::{Draft, Request};
use camrig_sensor_core::effects::Effect;

/// The camera that a file's values make.
fn camera(found: Imported) -> Camera {
    let keys = ["sensor.width=64", "sensor.height=48", "sensor.pitch_um=2", "sensor.cfa=mono"];
    let given = keys.iter().chain(&["sensor.noise.prnu=0.008"]).map(|k| k.parse().unwrap());
    let bits = found.known.iter().any(|k| k.change.key == "sensor.bits");
    let bits = (!bits).then(|| "sensor.bits=12".parse().unwrap());
    let request =
        Request { given: given.chain(bits).collect(), known: found.known, ..Request::default() };
    let folder = tempfile::tempdir().unwrap();
    let mut draft = Draft::of(&request).unwrap();
    draft.made.extend(found.tables);
    let path = folder.path().join("c.toml");
    std::fs::write(&path, draft.text()).unwrap();
    for (name, table) in draft.tables() {
        std::fs::write(folder.path().join(name), table).unwrap();
    }
    Camera::load(path.to_str().unwrap()).unwrap()
}

fn beside() -> Beside {
    let name = "c".to_string();
    let (size, full_well_e) = (Some([64.0, 48.0]), Some(11_000.0));
    let black_level_dn = Some(64.0);
    let (bits, prnu) = (Some(12), Some(0.008));
    Beside { name, bits, prnu, size, full_well_e, black_level_dn, ..Beside::default() }
}

fn from_text(text: &str) -> Imported {
    read_text(text, &beside()).unwrap()
}

/// Two profiles give gain, read noise and its part behind the gain stage to the last digits;
/// one gives all but the latter.
#[test]
fn profiles_come_back() {
    let (range, k, read, post) = (4031.0, 4095.0 / 11_000.0, 5.0f64, 4.2f64);
    let profile = |gain: f64| {
        let r2 = read * read - post * post + (post / gain).powi(2);
        let k = k * gain;
        let offset = (r2 * k * k + 1.0 / 12.0) / (range * range);
        Profile { gain, shot: k / range, offset, black_level_dn: 64.0, white_level_dn: 4095.0 }
    };
    let two = camera(from_text(&to_table(&[profile(1.0), profile(8.0)])));
    let sensor = &two.sensor;
    assert!((sensor.full_well_e / 11_000.0 - 1.0).abs() < 1e-6, "{}", sensor.full_well_e);
    assert!((sensor.noise.read_e / read - 1.0).abs() < 1e-6);
    assert!((sensor.noise.read_e_post / post - 1.0).abs() < 1e-6);
    assert_eq!((sensor.bits, sensor.black_level_dn), (12, 64.0));
    let found = from_text(&to_table(&[profile(1.0)]));
    assert!(found.notes[0].contains("one gain"));
    let one = camera(found);
    assert!((one.sensor.noise.read_e / read - 1.0).abs() < 1e-6);
}

/// Figures of ELD's Sony A7S2 at K = 1.1388 DN/e⁻ (golden/twin): standard deviation 3.9755 DN,
/// rows 0.5927 DN; the lines come back.
#[test]
fn lines_over_the_gain_come_back() {
    let text = r#"{"Kmin": -1.6, "Kmax": 0.7, "wp": 16383, "bl": 512, "lam": -0.12,
        "sigTLk": 0.75, "sigTLb": 0.2, "sigTLsig": 0.03,
        "sigRk": 0.65, "sigRb": -0.6, "sigRsig": 0.02}"#;
    let found = from_text(text);
    assert!(found.notes[0].contains("3 %"), "{:?}", found.notes);
    let camera = camera(found);
    let back = to_lines(&camera, libm::exp(0.7 + 1.6)).unwrap();
    let given: Json = serde_json::from_str(text).unwrap();
    for key in ["Kmin", "Kmax", "wp", "bl", "lam", "sigTLk", "sigTLb", "sigRk", "sigRb"] {
        let (got, wanted) = (number(&back[key]).unwrap(), number(&given[key]).unwrap());
        assert!((got - wanted).abs() < 1e-5 * wanted.abs().max(1.0), "{key}: {got} {wanted}");
    }
    // A Gaussian read noise on a line, of ELD's own form.
    let text = r#"{"Kmin": [0.2], "Kmax": 3.0, "G_shape": [], "wp": 16383,
        "Profile-1": {"g_scale": {"slope": [[0.68]], "bias": 0.95, "sigma": 0.0}}}"#;
    let camera = self::camera(from_text(text));
    for k in [0.2f64, 0.9, 3.0] {
        let got = camera.sensor.at_gain(k / 0.2).read_variance_e2.sqrt();
        let wanted = libm::exp(0.68 * libm::log(k) + 0.95) / k;
        assert!((got / wanted - 1.0).abs() < 1e-5, "{k}: {got} {wanted}");
    }
}

#[test]
fn shapes_beyond_that_of_a_camera_file_keep_their_deviation() {
    let text = r#"{"Kmin": 0.0, "Kmax": 2.0, "wp": 16383, "lam": -0.26,
        "sigTLk": 0.9, "sigTLb": -0.6}"#;
    let found = from_text(text);
    assert!(found.notes[0].contains("-0.26"), "{:?}", found.notes);
    let camera = camera(found);
    let [Effect::HeavyTailedReadNoise(e)] = camera.effects[..] else { panic!() };
    let wanted = libm::exp(-0.6) * tukey_sd(-0.26).unwrap();
    assert!((f64::from(e.sigma_e) / wanted - 1.0).abs() < 1e-5);
    assert!(tukey_sd(-0.5).is_err());
    // The logistic law, and the uniform one between -1 and 1.
    assert!((tukey_sd(1e-5).unwrap() - tukey_sd(2e-4).unwrap()).abs() < 1e-3);
    assert!((tukey_sd(1.0).unwrap() - 3f64.sqrt().recip()).abs() < 1e-9);
}

#[test]
fn tuning_files_come_back() {
    let text = r#"{"version": 2.0, "target": "bcm2835", "algorithms": [
        {"rpi.black_level": {"black_level": 4096}},
        {"rpi.noise": {"reference_constant": 0, "reference_slope": 3.67}}]}"#;
    let camera = camera(from_text(text));
    assert_eq!(camera.sensor.black_level_dn, 256.0);
    let full = camera.sensor.full_well_e;
    assert!((full / 4866.0 - 1.0).abs() < 0.3 && full > 4866.0, "{full}");
    let back = to_tuning(&camera);
    let noise = &back["algorithms"][1]["rpi.noise"]["reference_slope"];
    assert!((noise.as_f64().unwrap() / 3.67 - 1.0).abs() < 1e-4, "{noise}");
    assert_eq!(back["algorithms"][0]["rpi.black_level"]["black_level"], 4096.0);
}

/// Profiles on no law have a table of gains, with the figures of each.
#[test]
fn profiles_with_a_step_have_a_table() {
    let profile = |(gain, read_e, black): (f64, f64, f64)| {
        let (range, k) = (4095.0 - black, 4095.0 / 11_000.0 * gain);
        let offset = (read_e * read_e * k * k + 1.0 / 12.0) / (range * range);
        Profile { gain, shot: k / range, offset, black_level_dn: black, white_level_dn: 4095.0 }
    };
    let places = [(1.0, 6.0, 64.0), (2.0, 4.2, 64.0), (4.0, 2.2, 68.0), (8.0, 1.5, 72.0)];
    let found = from_text(&to_table(&places.map(profile)));
    assert_eq!(found.notes.len(), 2, "{:?}", found.notes);
    let sensor = camera(found).sensor;
    for (gain, read_e, black) in places {
        let at = sensor.at_gain(gain);
        assert!((at.read_variance_e2.sqrt() / read_e - 1.0).abs() < 1e-5);
        assert!((at.dn_per_e * 11_000.0 / 4095.0 / gain - 1.0).abs() < 1e-5);
        assert_eq!(at.black_level_dn, black);
    }
    assert!(read_text("gain,shot\n1,2\n", &beside()).is_err());
}

/// darktable's noise is that of demosaiced pictures: with a third of the variance, the full well
/// gives the sensor's own.
#[test]
fn profiles_of_darktable_come_back() {
    let (range, k, read, post) = (4031.0f64, 4095.0 / 11_000.0, 5.0f64, 4.2f64);
    let profile = |gain: f64| {
        let r2 = read * read - post * post + (post / gain).powi(2);
        let offset = r2 * (k * gain / range).powi(2) + 1.0 / (12.0 * range * range);
        Profile {
            gain,
            shot: k * gain / range / 3.0,
            offset: offset / 3.0,
            black_level_dn: 64.0,
            white_level_dn: 4095.0,
        }
    };
    let json = to_darktable(&[1.0, 2.0, 8.0].map(profile), "A 1");
    let found = from_text(&json.to_string());
    assert!(found.notes[0].contains("0.333"), "{:?}", found.notes);
    let sensor = camera(found).sensor;
    assert!((sensor.full_well_e / 11_000.0 - 1.0).abs() < 1e-6);
    assert!((sensor.noise.read_e / read - 1.0).abs() < 1e-6);
    assert!((sensor.noise.read_e_post / post - 1.0).abs() < 1e-6);
    let wrong = |change: &dyn Fn(&mut Beside)| {
        let mut beside = beside();
        change(&mut beside);
        read_text(&json.to_string(), &beside).err().unwrap().to_string()
    };
    assert!(wrong(&|b| b.full_well_e = None).contains("demosaiced"));
    assert!(wrong(&|b| b.model = Some("B".into())).contains("0 of the 1 models"));
}

/// The fall-off of cos⁴ comes back from gains, of a sensor of 64 x 48 pixels of 2 µm behind 0.2 mm.
#[test]
fn the_fall_off_of_a_tuning_file_comes_back() {
    let found = from_text(
        r#"{"target": "bcm2835", "algorithms": [{"rpi.black_level": {"black_level": 4096}}]}"#,
    );
    let mut truth = camera(found);
    if let camrig_camera::LensKind::DiffractionLimited { focal_length_mm, .. } =
        &mut truth.lens.kind
    {
        *focal_length_mm = 0.2;
    }
    let text = to_tuning(&truth).to_string();
    let found = from_text(&text);
    let tangent = 0.08 / 0.2f64;
    for line in found.tables[0].1.lines().skip(1) {
        let (field, ratio) = line.split_once(',').unwrap();
        let [field, ratio]: [f64; 2] = [field, ratio].map(|v| v.parse().unwrap());
        let wanted = (1.0 + (tangent * field).powi(2)).powi(2).recip();
        assert!((ratio / wanted - 1.0).abs() < 1e-3, "{field}: {ratio} for {wanted}");
    }
    assert!(found.notes[0].contains("0.74"), "{:?}", found.notes);
    let again = to_tuning(&camera(found));
    let of = |json: &Json| json["algorithms"][2]["rpi.alsc"]["luminance_lut"].clone();
    let (again, text) = (of(&again), of(&serde_json::from_str(&text).unwrap()));
    for (a, b) in again.as_array().unwrap().iter().zip(text.as_array().unwrap()) {
        assert!((a.as_f64().unwrap() / b.as_f64().unwrap() - 1.0).abs() < 2e-3);
    }
    let other = text_of_grid(100);
    assert!(read_text(&other, &beside()).err().unwrap().to_string().contains("100 numbers"));
}

fn text_of_grid(count: usize) -> String {
    let gains = vec![1.0; count];
    serde_json::json!({
        "target": "pisp", "algorithms": [{ "rpi.alsc": { "luminance_lut": gains } }],
    })
    .to_string()
}

/// What is in a file tells its form: of none, of two and of Python's objects are refused.
#[test]
fn files_of_no_form_are_refused() {
    for (text, told) in [
        ("hello", "no noise model"),
        ("{}", "no noise model"),
        (r#"{"Kmin": 1, "Kmax": 2, "wp": 4095}"#, "no noise model"),
        (r#"{"Profile-1": {}, "sigGsk": 1}"#, "several forms"),
        (r#"{"Profile-1": {}, "Kmin": -1, "Kmax": 2, "wp": 4095}"#, "range of the system gain"),
    ] {
        let error = read_text(text, &beside()).err().unwrap().to_string();
        assert!(error.contains(told), "{text}: {error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("SonyA7S2_params.npy");
    let mut bytes = camrig_base::npy::header("|O", "()");
    bytes.extend(b"\x80\x02cnumpy.core.multiarray\n_reconstruct\n");
    std::fs::write(&path, bytes).unwrap();
    let error = read(&[path], &beside()).err().unwrap().to_string();
    assert!(error.contains("pickle"), "{error}");
}

/// ELD's own file has a shape for each gain, and two profiles of one camera.
#[test]
fn what_is_left_out_of_a_file_of_eld_is_said() {
    let line = r#"{"slope": 0.46, "bias": 0.57, "sigma": 0.0}"#;
    let text = format!(
        r#"{{"Kmin": 0.1, "Kmax": 6.0, "G_shape": [0.11, -0.05, -0.14], "color_bias": [[0, 1]],
            "Profile-1": {{"G_scale": {line}}}, "Profile-2": {{"G_scale": {line}}}}}"#
    );
    let found = from_text(&text);
    let notes = found.notes.join("; ");
    assert!(notes.contains("from -0.140 to 0.110"), "{notes}");
    assert!(notes.contains("Profile-2") && notes.contains("color_bias"), "{notes}");
}
