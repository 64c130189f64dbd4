//! Cameras that are simulated and fitted again: figures against the truth, and the gap of the file.

use super::*;
use camrig_camera::Camera;
use camrig_camera::draft::{Grade, Request};
use camrig_capture::{plan, take};
use camrig_captures::Role;
use std::path::PathBuf;

/// A normal deviate: the sum of twelve uniform ones of a linear congruential generator.
pub(crate) fn normal(state: &mut u64) -> f64 {
    let mut uniform = || {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (*state >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..12).map(|_| uniform()).sum::<f64>() - 6.0
}

/// A camera by its keys, and effects in TOML.
fn camera(keys: &[&str], effects: &str) -> Camera {
    let common = ["sensor.pitch_um=3.0", "sensor.bits=12"];
    let given = common.iter().chain(keys).map(|text| text.parse().unwrap()).collect();
    let draft = Draft::of(&Request { name: "truth".into(), given, ..Request::default() }).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("truth.toml");
    std::fs::write(&path, draft.text() + effects).unwrap();
    for (name, table) in draft.tables() {
        std::fs::write(folder.path().join(name), table).unwrap();
    }
    Camera::load(path.to_str().unwrap()).unwrap()
}

struct Taken {
    folder: tempfile::TempDir,
    set: CaptureSet,
}

fn taken(camera: &Camera, plan_text: &str) -> Taken {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("plan.toml");
    std::fs::write(&file, format!("format = \"plan/1\"\n{plan_text}")).unwrap();
    let shots = plan::load(file.to_str().unwrap()).unwrap();
    let out = folder.path().join("set");
    take::take(camera, &shots, &out, &take::TakeOptions::default(), || ()).unwrap();
    Taken { set: CaptureSet::load(&out).unwrap(), folder }
}

impl Taken {
    /// The fitted file on disk, loaded.
    fn fitted(&self, options: &Options) -> (Fitted, Camera) {
        let fitted = fit(&self.set, options).unwrap();
        let path: PathBuf = self.folder.path().join("fitted.toml");
        std::fs::write(&path, fitted.draft.text()).unwrap();
        for (name, table) in fitted.draft.tables() {
            std::fs::write(self.folder.path().join(name), table).unwrap();
        }
        (fitted, Camera::load(path.to_str().unwrap()).unwrap())
    }

    /// How far the file is from passing: its gap over the limit.
    fn gap(&self, camera: &Camera) -> f64 {
        let options = camrig_diagnose::Options::default();
        let found = camrig_diagnose::compare(camera, self.set.clone(), &options).unwrap();
        for row in found.statistics.iter().take(6) {
            let of = [&row.place, &row.statistic];
            println!("{of:?} {:?} {:?} z {:?}", row.measured, row.predicted, row.z_fit);
        }
        println!("gap {} of {}", found.gap, found.gap_limit);
        found.gap / found.gap_limit
    }
}

/// Value and error of a path of the draft.
fn figure(fitted: &Fitted, path: &str) -> Value {
    let of = fitted.draft.entry(path).map(|e| (&e.value, &e.basis)).or_else(|| {
        let more = fitted.draft.more.iter().find(|known| known.change.key == path)?;
        Some((&more.change.value, &more.basis))
    });
    let (value, basis) = of.unwrap_or_else(|| panic!("no {path} in\n{}", fitted.draft.text()));
    assert_eq!(basis.grade, Grade::Measured, "{path}");
    Value::new(value.as_f64().unwrap(), basis.std_error.unwrap())
}

/// Within three errors, and errors within what is asked of the figure.
fn check(fitted: &Fitted, wrong: &mut Vec<String>, path: &str, truth: f64, part: f64) {
    let found = figure(fitted, path);
    let off = (found.value - truth) / found.std_error;
    println!("{path}: {} ± {} for {truth} ({off:+.1})", found.value, found.std_error);
    if off.abs() > 3.5 || (found.value / truth - 1.0).abs() > part {
        wrong.push(format!("{path}: {found:?} for {truth}"));
    }
}

/// A colour sensor.
const COLOUR: [&str; 10] = [
    "sensor.width=192",
    "sensor.height=128",
    "sensor.cfa=RGGB",
    "sensor.full_well_e=11000",
    "sensor.black_level_dn=64",
    "sensor.noise.read_e=5",
    "sensor.noise.prnu=0.008",
    "sensor.noise.dark_current_e_per_s=40",
    "sensor.noise.dsnu_e_per_s=15",
    "sensor.noise.row_fpn_e=0",
];

const COLOUR_PLAN: &str = "
[[stack]]
id = \"dark-short\"
role = \"dark\"
frames = 16
exposure_s = 0.005
analog_gain = [1, 2, 4, 8]
[[stack]]
id = \"dark-long\"
role = \"dark\"
frames = 16
exposure_s = 0.2
analog_gain = [1, 8]
[[stack]]
id = \"flat\"
role = \"flat\"
frames = 8
exposure_s = 0.005
analog_gain = [1, 2, 4, 8]
fill = [0.03, 0.08, 0.2, 0.4, 0.6, 0.8]
[stack.light]
wavelength_nm = 550
";

/// A colour sensor at four gains, with noise of rows, offsets of columns and a bent response: the
/// file passes for the right one.
#[test]
fn a_colour_sensor_comes_back_and_its_file_passes() {
    for seed in [11, 12] {
        let seed = format!("sensor.seed={seed}");
        let truth = camera(
            &[&COLOUR[..], &["sensor.qe_peak=0.7", "sensor.noise.read_e_post=4.2", &seed]]
                .concat(),
            "\n[[effect]]\nkind = \"row-temporal-noise\"\nsigma_e = 1.2\n\
             [[effect]]\nkind = \"column-offset-fpn\"\nsigma_e = 1.5\n\
             [[effect]]\nkind = \"nonlinearity\"\nloss = 0.02\nexponent = 1.0\n",
        );
        let taken = taken(&truth, COLOUR_PLAN);
        let (fitted, camera) = taken.fitted(&Options::default());
        println!("{:#?}", fitted.notes);
        let mut wrong = Vec::new();
        for (path, truth, part) in [
            ("sensor.full_well_e", 11_000.0, 0.003),
            ("sensor.noise.read_e", 5.0, 0.01),
            ("sensor.noise.read_e_post", 4.2, 0.01),
            ("sensor.noise.dark_current_e_per_s", 40.0, 0.01),
            ("sensor.noise.dsnu_e_per_s", 15.0, 0.03),
            ("sensor.noise.prnu", 0.008, 0.03),
            ("effect.row-temporal-noise.sigma_e", 1.2, 0.08),
            ("effect.column-offset-fpn.sigma_e", 1.5, 0.2),
            ("effect.nonlinearity.loss", 0.02, 0.03),
            ("effect.nonlinearity.exponent", 1.0, 0.01),
        ] {
            check(&fitted, &mut wrong, path, truth, part);
        }
        let kinds: Vec<&str> = camera.effects.iter().map(|e| e.entry().kind).collect();
        if kinds.len() != 3 {
            wrong.push(format!("effects {kinds:?}"));
        }
        let gap = taken.gap(&camera);
        if gap > 1.0 {
            wrong.push(format!("gap {gap} of its limit"));
        }
        assert!(wrong.is_empty(), "{wrong:#?}\n{}", fitted.draft.text());
    }
}

fn mono_plan(gains: &str) -> String {
    let stack = |id: &str, role: &str, frames: u32, exposure: f64, more: &str| {
        format!(
            "[[stack]]\nid = \"{id}\"\nrole = \"{role}\"\nframes = {frames}\n\
             exposure_s = {exposure}\nanalog_gain = {gains}\n{more}"
        )
    };
    let light = "fill = [0.02, 0.06, 0.15, 0.3, 0.5, 0.75]\nlight = { wavelength_nm = 550.0 }\n";
    stack("dark", "dark", 16, 0.004, "")
        + &stack("long", "dark", 16, 0.5, "")
        + &stack("flat", "flat", 8, 0.004, light)
}

/// A monochrome sensor with hot pixels and noise of rows: the dark current and its pattern are
/// those of the ordinary pixels, dark charge is no offset, and the file passes.
#[test]
fn hot_pixels_stand_apart_from_the_dark_current() {
    for (full, read, post, seed) in [(20_000, 6.0, 5.0, 21), (6_000, 2.2, 1.9, 22)] {
        let keys = [
            format!("sensor.full_well_e={full}"),
            format!("sensor.noise.read_e={read}"),
            format!("sensor.noise.read_e_post={post}"),
            format!("sensor.seed={seed}"),
        ];
        let mut keys: Vec<&str> = keys.iter().map(|k| &k[..]).collect();
        keys.extend([
            "sensor.width=160",
            "sensor.height=120",
            "sensor.cfa=mono",
            "sensor.black_level_dn=100",
            "sensor.qe_peak=0.6",
            "sensor.noise.prnu=0.006",
            "sensor.noise.dark_current_e_per_s=10",
            "sensor.noise.dsnu_e_per_s=4",
            "sensor.noise.row_fpn_e=0",
        ]);
        let truth = camera(
            &keys,
            "\n[[effect]]\nkind = \"row-temporal-noise\"\nsigma_e = 0.5\n\
             [[effect]]\nkind = \"hot-pixels\"\nfraction = 0.002\nmean_e_per_s = 1500.0\n",
        );
        let taken = taken(&truth, &mono_plan("[1, 2]"));
        let (fitted, camera) = taken.fitted(&Options::default());
        println!("{:#?}", fitted.notes);
        let mut wrong = Vec::new();
        for (path, truth, part) in [
            ("sensor.full_well_e", f64::from(full), 0.003),
            ("sensor.noise.read_e", read, 0.01),
            ("sensor.noise.read_e_post", post, 0.02),
            ("sensor.noise.dark_current_e_per_s", 10.0, 0.02),
            ("sensor.noise.dsnu_e_per_s", 4.0, 0.03),
            ("effect.hot-pixels.fraction", 0.002, 0.4),
            ("effect.hot-pixels.mean_e_per_s", 1500.0, 0.4),
            ("effect.row-temporal-noise.sigma_e", 0.5, 0.1),
        ] {
            check(&fitted, &mut wrong, path, truth, part);
        }
        if camera.effects.iter().any(|e| e.entry().kind == "pixel-offset-fpn") {
            wrong.push(format!("offsets of pixels in\n{}", fitted.draft.text()));
        }
        let green = camera.sensor.qe[0].at(550.0) / truth.sensor.qe[0].at(550.0);
        if (green - 1.0).abs() > 0.005 {
            wrong.push(format!("efficiency {green} of the truth"));
        }
        let gap = taken.gap(&camera);
        if gap > 1.0 {
            wrong.push(format!("gap {gap} of its limit"));
        }
        assert!(wrong.is_empty(), "{wrong:#?}\n{}", fitted.draft.text());
    }
}

/// A step of the conversion gain at 3.333 and a digital gain above 6.667, as the camera's table has
/// them: the file has the same table, and passes.
#[test]
fn steps_of_the_conversion_gain_and_digital_gains_are_found() {
    let truth = camera(
        &[
            "sensor.width=128",
            "sensor.height=96",
            "sensor.cfa=mono",
            "sensor.full_well_e=20000",
            "sensor.black_level_dn=100",
            "sensor.qe_peak=0.6",
            "sensor.noise.read_e=6",
            "sensor.noise.read_e_post=5",
            "sensor.noise.prnu=0.006",
            "sensor.noise.dark_current_e_per_s=10",
            "sensor.noise.dsnu_e_per_s=4",
            "sensor.noise.row_fpn_e=0",
            "sensor.seed=23",
        ],
        "\n[sensor.gains]\nat = [1, 2, 3.333, 3.333, 6.667]\n\
         read_e = [6.0, 4.153, 3.640, 2.2, 1.461]\ndigital_above = 6.667\n",
    );
    let taken = taken(&truth, &mono_plan("[1, 2, 3.333, 6.667, 13.334]"));
    let (fitted, camera) = taken.fitted(&Options::default());
    let gains = camera.sensor.gains.as_ref().unwrap();
    assert_eq!(gains.at, [1.0, 2.0, 3.333, 3.333, 6.667], "{:?}", fitted.notes);
    assert_eq!(gains.digital_above, Some(6.667));
    let truth = truth.sensor.gains.as_ref().unwrap().read_e.as_ref().unwrap();
    for (found, truth) in gains.read_e.as_ref().unwrap().iter().zip(truth) {
        assert!((found / truth - 1.0).abs() < 0.015, "{found} for {truth}");
    }
    let k = figure(&fitted, "sensor.full_well_e");
    assert!((k.value / 20_000.0 - 1.0).abs() < 0.003, "{k:?}");
    let gap = taken.gap(&camera);
    assert!(gap <= 1.0, "gap {gap} of its limit");
}

/// Cameras warm up: flats at other temperatures than the darks are used, darks are those of one.
#[test]
fn flats_of_any_temperature_are_used_with_the_darks_of_one() {
    let truth =
        Camera::load_with("mt9v024", [("sensor.width", 64), ("sensor.height", 48)]).unwrap();
    let taken = taken(&truth, &mono_plan("[1]"));
    let mut set = taken.set.clone();
    for (i, capture) in set.captures.iter_mut().enumerate() {
        capture.temperature_c = Some(if capture.role == Role::Dark { 31.0 } else { i as f64 });
    }
    let fitted = fit(&set, &Options::default()).unwrap();
    let full = figure(&fitted, "sensor.full_well_e").value;
    assert!((full / truth.sensor.full_well_e - 1.0).abs() < 0.02, "{full}");
}

#[test]
fn a_set_without_darks_is_refused() {
    let truth =
        Camera::load_with("mt9v024", [("sensor.width", 32), ("sensor.height", 32)]).unwrap();
    let plan = "[[stack]]\nid = \"flat\"\nrole = \"flat\"\nframes = 2\nexposure_s = 0.004\n\
                fill = [0.2, 0.5]\nlight = { wavelength_nm = 550.0 }\n";
    let error = fit(&taken(&truth, plan).set, &Options::default()).unwrap_err();
    assert!(error.to_string().contains("no dark captures"), "{error}");
}

/// A scene at five exposures instead of flats: gain within its error and within 1 %, read noise and
/// dark current as with flats.
#[test]
fn a_static_scene_tells_the_gain_without_flats() {
    let truth = camera(&COLOUR, "\n[[effect]]\nkind = \"row-temporal-noise\"\nsigma_e = 1.2\n");
    let dark = |id: &str, exposure: f64| {
        format!(
            "[[stack]]\nid = \"{id}\"\nrole = \"dark\"\nframes = 16\nexposure_s = {exposure}\n"
        )
    };
    let scene = |i: i32| {
        let exposure = 0.002 * libm::pow(2.0, f64::from(i));
        format!(
            "[[stack]]\nid = \"scene-{i}\"\nrole = \"scene\"\nframes = 4\nscene = {{ scene = \"colorchecker\" }}\n\
             exposure_s = {exposure}\nlight = {{ illuminant = \"D65\", lux = 200 }}\n"
        )
    };
    let scenes: String = (0..5).map(scene).collect();
    let taken = taken(&truth, &(dark("dark", 0.002) + &dark("long", 0.5) + &scenes));
    let (fitted, _) = taken.fitted(&Options::default());
    let mut wrong = Vec::new();
    for (path, truth, part) in [
        ("sensor.full_well_e", 11_000.0, 0.01),
        ("sensor.noise.read_e", 5.0, 0.015),
        ("sensor.noise.dark_current_e_per_s", 40.0, 0.02),
    ] {
        check(&fitted, &mut wrong, path, truth, part);
    }
    assert!(wrong.is_empty(), "{wrong:#?}\n{}", fitted.draft.text());
    assert!(fitted.notes.iter().any(|note| note.contains("no flats")), "{:?}", fitted.notes);
}

/// Darks alone: black level in DN, all figures in electrons open at once, with what they are in DN.
#[test]
fn darks_alone_leave_electrons_open() {
    let truth =
        Camera::load_with("mt9v024", [("sensor.width", 64), ("sensor.height", 48)]).unwrap();
    let plan = "[[stack]]\nid = \"dark\"\nrole = \"dark\"\nframes = 16\nexposure_s = 0.004\n\
                [[stack]]\nid = \"long\"\nrole = \"dark\"\nframes = 16\nexposure_s = 0.5\n";
    let taken = taken(&truth, plan);
    let fitted = fit(&taken.set, &Options::default()).unwrap();
    let open = |path: &str| fitted.draft.entry(path).unwrap().value.as_str() == Some(OPEN);
    for path in ["full_well_e", "noise.read_e", "noise.dark_current_e_per_s", "noise.row_fpn_e"] {
        assert!(open(&format!("sensor.{path}")), "{path}\n{}", fitted.draft.text());
    }
    let black = figure(&fitted, "sensor.black_level_dn");
    assert!((black.value - truth.sensor.black_level_dn).abs() < 1.0, "{black:?}");
    let k = truth.sensor.at_gain(1.0).dn_per_e;
    let read = &fitted.draft.entry("sensor.noise.read_e").unwrap().basis.note;
    let dn: f64 = read.split(' ').next().unwrap().parse().unwrap();
    assert!((dn / (truth.sensor.noise.read_e * k) - 1.0).abs() < 0.05, "{read}");
    assert!(fitted.draft.camera(std::path::Path::new("")).is_err());
    let given = Options { dn_per_e: Some(k), ..Options::default() };
    let fitted = fit(&taken.set, &given).unwrap();
    let read = figure(&fitted, "sensor.noise.read_e");
    assert!((read.value / truth.sensor.noise.read_e - 1.0).abs() < 0.05, "{read:?}");
}

/// What has an estimate is in the file: pixels that blink with correlated double sampling, response
/// that neighbours share, rows of opposite sign, a wave, channels of columns, wrong bits.
#[test]
fn all_that_stands_out_is_in_the_file() {
    let truth = camera(
        &[
            "sensor.width=256",
            "sensor.height=192",
            "sensor.cfa=mono",
            "sensor.full_well_e=10000",
            "sensor.black_level_dn=64",
            "sensor.noise.read_e=4",
            "sensor.noise.prnu=0.003",
            "sensor.noise.dark_current_e_per_s=0",
            "sensor.noise.dsnu_e_per_s=0",
            "sensor.noise.row_fpn_e=0",
            "sensor.seed=31",
        ],
        "\n[[effect]]\nkind = \"random-telegraph-noise\"\nfraction = 0.03\namplitude_e = 8.0\n\
         renewal = 1.0\nbetween_samples = 0.6\n\
         [[effect]]\nkind = \"prnu-correlated\"\nsigma = 0.004\n\
         [[effect]]\nkind = \"row-temporal-noise\"\nsigma_e = 0.5\nopposite_e = 0.7\n\
         [[effect]]\nkind = \"periodic-pattern-noise\"\namplitude_e = 0.6\n\
         cycles_per_column = 0.31\ncycles_per_row = 0.17\n\
         [[effect]]\nkind = \"readout-channel-mismatch\"\nchannels = 4\ngain = 0.002\n\
         [[effect]]\nkind = \"adc-nonlinearity\"\nbit_0_lsb = 0.06\nbit_2_lsb = -0.08\n",
    );
    let taken = taken(&truth, &mono_plan("[1]"));
    let (fitted, camera) = taken.fitted(&Options::default());
    println!("{}", fitted.draft.text());
    let mut wrong = Vec::new();
    for (path, truth, part) in [
        ("effect.random-telegraph-noise.fraction", 0.03, 0.3),
        ("effect.random-telegraph-noise.amplitude_e", 8.0, 0.2),
        ("sensor.noise.prnu", 0.003, 0.1),
        ("effect.prnu-correlated.sigma", 0.004, 0.05),
        ("effect.row-temporal-noise.sigma_e", 0.5, 0.1),
        ("effect.row-temporal-noise.opposite_e", 0.7, 0.1),
        ("effect.periodic-pattern-noise.amplitude_e", 0.6, 0.2),
        ("effect.adc-nonlinearity.bit_0_lsb", 0.06, 0.1),
        ("effect.adc-nonlinearity.bit_2_lsb", -0.08, 0.1),
    ] {
        check(&fitted, &mut wrong, path, truth, part);
    }
    let channels = figure(&fitted, "effect.readout-channel-mismatch.gain");
    if channels.z() < 10.0 {
        wrong.push(format!("channels {channels:?}"));
    }
    let gap = taken.gap(&camera);
    if gap > 1.0 {
        wrong.push(format!("gap {gap} of its limit"));
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// 1/f noise of rows beside white noise of rows: both, and no wave.
#[test]
fn noise_of_rows_that_falls_with_frequency_is_in_the_file() {
    let truth = camera(
        &[
            "sensor.width=192",
            "sensor.height=128",
            "sensor.cfa=RGGB",
            "sensor.full_well_e=10000",
            "sensor.black_level_dn=64",
            "sensor.noise.read_e=4",
            "sensor.noise.read_e_post=3",
            "sensor.noise.prnu=0.006",
            "sensor.noise.dark_current_e_per_s=0",
            "sensor.noise.dsnu_e_per_s=0",
            "sensor.noise.row_fpn_e=0",
            "sensor.seed=41",
        ],
        "\n[[effect]]\nkind = \"row-temporal-noise\"\nsigma_e = 0.9\n\
         [[effect]]\nkind = \"row-correlated-noise\"\nsigma_e = 1.0\nexponent = 1.0\n",
    );
    let taken = taken(&truth, &mono_plan("[1, 4]"));
    let (fitted, camera) = taken.fitted(&Options::default());
    let mut wrong = Vec::new();
    for (path, truth, part) in [
        ("effect.row-temporal-noise.sigma_e", 0.9, 0.1),
        ("effect.row-correlated-noise.sigma_e", 1.0, 0.1),
        ("effect.row-correlated-noise.exponent", 1.0, 0.2),
        ("sensor.noise.read_e", 4.0, 0.01),
    ] {
        check(&fitted, &mut wrong, path, truth, part);
    }
    let kinds: Vec<&str> = camera.effects.iter().map(|e| e.entry().kind).collect();
    if kinds.len() != 2 {
        wrong.push(format!("effects {kinds:?}"));
    }
    let gap = taken.gap(&camera);
    if gap > 1.0 {
        wrong.push(format!("gap {gap} of its limit"));
    }
    assert!(wrong.is_empty(), "{wrong:#?}\n{}", fitted.draft.text());
}

/// Pixels that blink far are no hot ones.
#[test]
fn strong_telegraph_noise_makes_no_hot_pixels() {
    let truth = camera(
        &[
            "sensor.width=160",
            "sensor.height=128",
            "sensor.cfa=mono",
            "sensor.full_well_e=10000",
            "sensor.black_level_dn=100",
            "sensor.noise.read_e=2",
            "sensor.noise.dark_current_e_per_s=2",
            "sensor.noise.dsnu_e_per_s=0.5",
            "sensor.noise.row_fpn_e=0",
        ],
        "\n[[effect]]\nkind = \"random-telegraph-noise\"\nfraction = 0.05\namplitude_e = 20.0\n\
         renewal = 1.0\n",
    );
    let (fitted, camera) = taken(&truth, &mono_plan("[1]")).fitted(&Options::default());
    let kinds: Vec<&str> = camera.effects.iter().map(|e| e.entry().kind).collect();
    assert!(kinds.contains(&"random-telegraph-noise"), "{}", fitted.draft.text());
    assert!(!kinds.contains(&"hot-pixels"), "{}", fitted.draft.text());
}
