//! Messages about wrong camera files.

use super::{Camera, Folder, LensKind, RelativeIllumination};
use camrig_base::Bands;

const GOOD: &str = include_str!("../presets/mt9t012.toml");

fn told(text: &str) -> String {
    match Camera::parse(text, "test", &Folder::BuiltIn) {
        Ok(_) => "loads".to_string(),
        Err(e) => e.to_string(),
    }
}

#[test]
fn wrong_keys_and_values_are_named_with_line_and_remedy() {
    assert_eq!(told(GOOD), "loads");
    for (from, to, expected) in [
        ("pitch_um = 2.2", "pitch_mm = 0.0022", "\"pitch_mm\""),
        ("read_e = 4.0", "read_noise_e = 4.0", "did you mean"),
        ("read_e = 4.0", "read_e = -4.0", "line"),
        ("bits = 10", "bits = 20", "8 to 16"),
        ("width = 2048", "width = 0", "1 to 32768"),
        ("cfa = \"GRBG\"", "cfa = \"GRBX\"", "RCCC"),
        ("cfa = \"GRBG\"", "cfa = \"gbr\"", "use RGGB"),
        ("f_number = 2.8", "", "f_number"),
        ("transmittance = 0.92", "transmittance = 92", "0 to 1"),
        ("kind = \"diffraction-limited\"", "kind = \"perfect\"", "diffraction-limited"),
        ("f_number = 2.8", "f_number = 2.8\nfile = \"x.zmx\"", "means nothing"),
        ("qe = \"mt9m131-qe.csv\"", "qe = \"none.csv\"", "none.csv"),
        ("read_e_post = 2.5", "read_e_post = 5.0", "0 to 4"),
        ("black_level_dn = 42", "black_level_dn = 2000", "0 to 1022"),
    ] {
        assert!(GOOD.contains(from), "{from}");
        let message = told(&GOOD.replace(from, to));
        assert!(message.contains(expected), "{from} -> {to}: {message}");
    }
}

#[test]
fn all_mistakes_are_named_in_one_message() {
    let text = GOOD.replace("read_e = 4.0", "read_e = -4.0").replace("bits = 10", "bits = 20");
    let text = text.replace("f_number = 2.8", "f_number = 0.1");
    let message = told(&format!("{text}\n[[effect]]\nkind = \"row-temporal-nose\"\n"));
    assert!(message.starts_with("4 things to put right"), "{message}");
    for word in ["read_e = -4", "bits = 20", "f_number = 0.1", "row-temporal-nose"] {
        assert!(message.lines().any(|l| l.contains(word) && l.contains("line")), "{message}");
    }
}

#[test]
fn every_effect_says_its_closed_form() {
    for kind in crate::EffectKind::all() {
        assert!(kind.closed_form().ends_with('.'), "{}: {:?}", kind.kind, kind.closed_form());
    }
}

/// Dark patterns grow with temperature by the sensor's law unless they have one of their own.
#[test]
fn dark_patterns_grow_as_the_dark_current() {
    let text = GOOD.replace("dark_doubling_c = 7.0", "dark_doubling_c = 5.5");
    let text = text.replace("temperature_ref_c = 25.0", "temperature_ref_c = 40");
    let hot = "\n[[effect]]\nkind = \"hot-pixels\"\nfraction = 0.01\nmean_e_per_s = 10\n";
    let values = |more: &str| {
        let text = format!("{text}{hot}{more}");
        Camera::parse(&text, "test", &Folder::BuiltIn).unwrap().effects[0].values()
    };
    assert_eq!(values("")[2..], [5.5, 40.0]);
    assert_eq!(values("doubling_c = 8")[2..], [8.0, 40.0]);
}

#[test]
fn wrong_effects_are_named() {
    for (effect, expected) in [
        ("kind = \"row-temporal-nois\"\nsigma_e = 1", "did you mean \"row-temporal-noise\""),
        ("kind = \"row-temporal-noise\"\nsigma = 1", "unknown key \"sigma\""),
        ("kind = \"row-temporal-noise\"", "missing"),
        ("kind = \"row-temporal-noise\"\nsigma_e = -1", "sigma_e = -1"),
        ("kind = \"row-temporal-noise\"\nsigma_e = \"1\"", "no number"),
        ("sigma_e = 1", "\"kind\" is missing"),
    ] {
        let message = told(&format!("{GOOD}\n[[effect]]\n{effect}\n"));
        assert!(message.contains(expected), "{effect}: {message}");
        assert!(message.contains("[[effect]] at line"), "{message}");
    }
}

#[test]
fn optical_effects_are_kept_apart_from_the_sensor() {
    let text = format!(
        "{GOOD}\n[[effect]]\nkind = \"defocus\"\nshift_um = 12\n\n[[effect]]\nkind = \
         \"row-temporal-noise\"\nsigma_e = 1\n\n[[effect]]\nkind = \"distortion\"\nk1 = 0.01\n"
    );
    let plain = Camera::parse(GOOD, "test", &Folder::BuiltIn).unwrap();
    let camera = Camera::parse(&text, "test", &Folder::BuiltIn).unwrap();
    let kinds: Vec<_> = camera.optical_effects.iter().map(|e| e.entry().kind).collect();
    assert_eq!(kinds, ["defocus", "distortion"]);
    assert_eq!(camera.optical_effects[1].values(), [0.01, 0.0, 1.0]);
    assert_eq!(camera.chain().len(), plain.chain().len() + 1);
    for (effect, expected) in [
        ("kind = \"defocus\"", "\"shift_um\" of \"defocus\" is missing"),
        ("kind = \"defocus\"\nshift_um = 2000", "-1000 to 1000"),
        ("kind = \"veiling-glar\"\nfraction = 0.1", "did you mean \"veiling-glare\""),
        (
            "kind = \"companding\"\nknee_1 = 0.5\nslope_1 = 0.5\nknee_2 = 0.4",
            "knee_2 = 0.4 is below knee_1 = 0.5",
        ),
        (
            "kind = \"requantised\"\nstep_0_dn = 2\nfrom_1_dn = 500\nfrom_2_dn = 400",
            "from_2_dn = 400 is below from_1_dn = 500",
        ),
    ] {
        let message = told(&format!("{GOOD}\n[[effect]]\n{effect}\n"));
        assert!(message.contains(expected), "{effect}: {message}");
    }
}

#[test]
fn a_table_of_relative_illumination_is_read_or_told() {
    let folder = tempfile::tempdir().unwrap();
    let qe = super::presets::file("mt9m131-qe.csv").unwrap();
    std::fs::write(folder.path().join("mt9m131-qe.csv"), qe).unwrap();
    let load = |table: &str| {
        std::fs::write(folder.path().join("shading.csv"), table).unwrap();
        let text = GOOD.replace("\"cos4\"", "\"shading.csv\"").replace("ir_cut", "#ir_cut");
        Camera::parse(&text, "test", &Folder::Directory(folder.path()))
    };
    let camera = load("field,ratio\n0,1\n0.5,0.8\n1,0.4\n").unwrap();
    let LensKind::DiffractionLimited {
        relative_illumination: RelativeIllumination::Table(table),
        ..
    } = &camera.lens.kind
    else {
        panic!("{:?}", camera.lens.kind);
    };
    assert_eq!(*table, [(0.0, 1.0), (0.5, 0.8), (1.0, 0.4)]);
    for (table, expected) in [
        ("field,ratio\n0,1\n", "fewer than two lines"),
        ("field,ratio\n0,1\n1,2\n", "ratios to the axis lie in 0 to 1.5"),
        ("field,ratio\n0.5,1\n0.2,0.9\n", "fields rise from 0"),
        ("field,ratio\n0,one\n1,0.9\n", "not a table of field,ratio"),
        ("field,ratio\n0,1\n0.8,0.7\n", "the fields run from 0 to 0.8"),
    ] {
        let error = load(table).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains("shading.csv"), "{error}");
    }
}

/// The same efficiency, 0.6 up to 720 nm, as fractions and per cent, by letters and by names.
#[test]
fn tables_of_per_cent_and_of_named_colours_are_read_and_told() {
    let folder = tempfile::tempdir().unwrap();
    let load = |table: &str| {
        std::fs::write(folder.path().join("qe.csv"), table).unwrap();
        let text = GOOD.replace("mt9m131-qe.csv", "qe.csv").replace("ir_cut", "#ir_cut");
        Camera::parse(&text, "test", &Folder::Directory(folder.path())).unwrap()
    };
    let table = |header: &str, value: f64, first: f64| {
        let lines = (36..=72).map(|i| {
            let value = if i == 36 { first } else { value };
            format!("{},{value},{value},{value}\n", 10 * i)
        });
        format!("{header}\n{}", lines.collect::<String>())
    };
    let nir = Bands { start_nm: 400.0, step_nm: 10.0, count: 61 };
    for (text, remark) in [
        (table("wavelength_nm,r,g,b", 0.6, 0.0), None),
        (table("wavelength_nm,r,g,b", 60.0, 0.0), Some("per cent, as values go up to 60")),
        (table("nm,R (%),G (%),B (%)", 60.0, 0.0), Some("per cent, as its header says")),
        (table("Wavelength (nm),Red,Green,Blue", 0.6, -0.001), Some("3 slightly negative")),
    ] {
        let camera = load(&text);
        for curve in &camera.sensor.qe {
            assert_eq!(curve.at(360.0), 0.0, "{text}");
            assert!((curve.at(550.0) - 0.6).abs() < 1e-12, "{text}");
        }
        let notes = camera.notes(&Bands::VISIBLE);
        assert_eq!(notes.len(), usize::from(remark.is_some()), "{notes:?}");
        let notes = camera.notes(&nir).join("\n");
        assert!(notes.contains("qe.csv") && notes.contains("ends at 720 nm"), "{notes}");
        assert!(remark.is_none_or(|remark| notes.contains(remark)), "{notes}");
    }
}

#[test]
fn a_channel_that_two_columns_are_named_by_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let lines: String = (36..=72).map(|i| format!("{},0.1,0.5,0.5,0.5\n", 10 * i)).collect();
    let load = |header: &str| {
        std::fs::write(folder.path().join("qe.csv"), format!("{header}\n{lines}")).unwrap();
        let text = GOOD.replace("mt9m131-qe.csv", "qe.csv").replace("ir_cut", "#ir_cut");
        Camera::parse(&text, "test", &Folder::Directory(folder.path()))
    };
    let error = load("nm,r,r,g,b").unwrap_err().to_string();
    assert!(error.contains("2 (\"r\") and 3 (\"r\")"), "{error}");
    // What stands in brackets is a unit, and these are none of a quantum efficiency.
    let error = load("nm,r (min),r (typ),g,b").unwrap_err().to_string();
    assert!(error.contains("r (min)"), "{error}");
    let camera = load("nm,min,r,g,b").unwrap();
    assert_eq!(camera.sensor.qe[0].at(550.0), 0.5);
}

/// A table of relative values with its peak; few points of a data sheet; no conversion gain.
#[test]
fn data_sheets_with_few_figures_suffice() {
    let folder = tempfile::tempdir().unwrap();
    let load = |table: &str, keys: &str| {
        std::fs::write(folder.path().join("qe.csv"), table).unwrap();
        let text = GOOD.replace("\"mt9m131-qe.csv\"", &format!("\"qe.csv\"\n{keys}"));
        let text = text.replace("conversion_gain_uv_per_e = 75.0", "");
        let text = text.replace("\"GRBG\"", "\"mono\"").replace("ir_cut", "#ir_cut");
        Camera::parse(&text, "test", &Folder::Directory(folder.path()))
    };
    let coarse = "nm,mono\n380,0.1\n450,0.5\n550,1.0\n650,0.8\n720,0.3\n";
    let camera = load(coarse, "qe_peak = 0.6").unwrap();
    assert_eq!(camera.sensor.conversion_gain_uv_per_e, None);
    let at = [450.0, 500.0, 550.0].map(|nm| camera.sensor.qe[0].at(nm));
    assert!(at.iter().zip([0.3, 0.45, 0.6]).all(|(a, b)| (a - b).abs() < 1e-12), "{at:?}");
    let notes = camera.notes(&Bands::VISIBLE).join("\n");
    assert!(notes.contains("straight lines join its points, up to 100 nm apart"), "{notes}");
    let told = |table: &str, keys: &str| load(table, keys).unwrap_err().to_string();
    assert!(told("nm,mono\n380,0.1\n550,1\n720,0.3\n", "").contains("no values between"));
    assert!(told(coarse, "qe_peak = 1.5").contains("qe_peak = 1.5"));
    let number = GOOD.replace("\"mt9m131-qe.csv\"", "0.5\nqe_peak = 0.6");
    assert!(self::told(&number).contains("qe_peak beside a number"));
}

/// A camera file with an empirical effect, and its table, in a folder.
fn empirical(effect: &str, table: &str) -> camrig_base::Result<Camera> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("empirical-1.toml"), table).unwrap();
    let text = format!("{GOOD}\n[[effect]]\nkind = \"empirical\"\n{effect}\n");
    let text = text.replace("\"mt9m131-qe.csv\"", "0.5").replace("ir_cut", "#ir_cut");
    Camera::parse(&text, "test", &Folder::Directory(folder.path()))
}

/// Every shape with a table that it may have.
const SHAPES: [(&str, &str); 11] = [
    ("domain = \"temporal\"\nshape = \"row-flat\"\non_signal = 1.0\nsignal_e = 900.0", ""),
    ("domain = \"temporal\"\nshape = \"column-flat\"", ""),
    ("domain = \"temporal\"\nshape = \"row-profile\"", "at = [0.0, 9.5]\nvalues = [1.0, 0.0]\n"),
    ("domain = \"gain\"\nshape = \"column-profile\"", "at = [3.0]\nvalues = [0.1]\n"),
    (
        "domain = \"offset\"\nshape = \"seam\"",
        "[[seam]]\nfirst_column = 40\nfirst_row = 0\nstep = 1.0\n",
    ),
    (
        "domain = \"dark\"\nshape = \"wave\"",
        "[[wave]]\ncycles_per_column = 0.11\ncycles_per_row = -0.27\nphase_turns = 0.6\n\
         amplitude = 1.0\n",
    ),
    ("domain = \"gain\"\nshape = \"map\"", "[[term]]\ncolumns = [0.0, 0.1]\nrows = [1.0]\n"),
    (
        "domain = \"dark\"\nshape = \"distribution\"",
        "deviates = [-1.0, 1.0]\nvalues = [0.0, 2.0]\n",
    ),
    ("domain = \"temporal\"\nshape = \"correlation\"", "along = \"columns\"\nlength = 9.0\n"),
    (
        "domain = \"response\"\nshape = \"signal-curve\"",
        "signal_e = [10.0, 10.0]\nchange_e = [0.0, 5.0]\nnoise_e = [0.0, 2.0]\n",
    ),
    (
        "domain = \"offset\"\nshape = \"frame-curve\"\namount_e = 9.0",
        "at = [0.0, 5.0]\nvalues = [1.0, 0.0]\n",
    ),
];

#[test]
fn empirical_effects_are_read_run_and_written_as_they_were() {
    for (effect, table) in SHAPES {
        let with_table = match table {
            "" => effect.to_string(),
            _ => format!("{effect}\ntable = \"empirical-1.toml\""),
        };
        let camera = empirical(&with_table, table).unwrap();
        let config = camera.sensor_config(&Bands::VISIBLE).unwrap();
        let [own] = &camera.empirical[..] else { panic!("{effect}") };
        assert_eq!(config.table.len(), camera.table().len());
        assert_eq!(camera.empirical_of(&camera.effects[0]), Some(own));
        assert_eq!(own.table.text().unwrap(), table, "{effect}");
        let written = own.to_toml("empirical-1.toml");
        let written = written.replace("kind = \"empirical\"\n", "");
        let again = empirical(&written, table).unwrap();
        assert_eq!(&again.empirical, &camera.empirical, "{written}");
    }
}

#[test]
fn several_empirical_effects_share_the_sensors_table() {
    let effect =
        "domain = \"offset\"\nshape = \"seam\"\namount_e = 2\ntable = \"empirical-1.toml\"";
    let table = SHAPES[4].1;
    let two = format!("{effect}\n[[effect]]\nkind = \"empirical\"\n{effect}\namount_e = 3");
    let two = two.replacen("amount_e = 2\n", "", 2);
    let camera = empirical(&two, table).unwrap();
    assert_eq!(camera.table(), [3.0, 40.0, 0.0, 1.0, 3.0, 40.0, 0.0, 1.0]);
    let amounts = camera.effects.iter().map(|e| camera.empirical_of(e).unwrap().amount);
    assert_eq!(amounts.collect::<Vec<_>>(), [1.0, 3.0]);
    // Three tables of 240 knots of two numbers are more than a sensor holds.
    let knots: Vec<String> = (0..240).map(|i| format!("{i}.0")).collect();
    let table = format!("at = [{0}]\nvalues = [{0}]\n", knots.join(", "));
    let effect = effect.replace("seam", "row-profile");
    let more = format!("\n[[effect]]\nkind = \"empirical\"\n{effect}");
    assert!(empirical(&format!("{effect}{more}"), &table).is_ok());
    let told = empirical(&format!("{effect}{more}{more}"), &table).unwrap_err().to_string();
    assert!(told.contains("1443 numbers") && told.contains("1024"), "{told}");
}

#[test]
fn frame_curves_count_from_the_frame_with_which_the_sensor_starts() {
    let (effect, table) = SHAPES[SHAPES.len() - 1];
    let mut camera = empirical(&format!("{effect}\ntable = \"empirical-1.toml\""), table).unwrap();
    assert!(camera.changes_after_its_start());
    assert_eq!(camera.table(), [6.0, 0.0, 0.0, 0.0, 1.0, 5.0, 0.0]);
    camera.first_frame = 4_000_000_001;
    assert_eq!(camera.table()[1..3], [61_035.0, 10_241.0]);
}

#[test]
fn what_is_wrong_with_an_empirical_effect_is_said_at_once() {
    let told = |effect: &str, table: &str| match empirical(effect, table) {
        Ok(_) => panic!("{effect} loads"),
        Err(e) => e.to_string(),
    };
    let seam = "domain = \"offset\"\nshape = \"seam\"\ntable = \"empirical-1.toml\"\n";
    let message = told(
        &format!("{seam}amount = 0.1\non_signal = 1\ndoubling_c = 7\ndescripton = \"x\""),
        "[[seam]]\nstep = 1\nfirst_colum = 3",
    );
    for said in [
        "5 things to put right",
        "amount_e",
        "on_signal",
        "doubling_c",
        "description",
        "first_column",
    ] {
        assert!(message.contains(said), "{said}: {message}");
    }
    let of = |domain: &str, shape: &str| {
        format!("domain = \"{domain}\"\nshape = \"{shape}\"\ntable = \"empirical-1.toml\"")
    };
    let curve = "at = [0.0, 1.0]\nvalues = [1.0]";
    for (effect, table, expected) in [
        (of("ofset", "seam"), SHAPES[4].1, "did you mean \"offset\""),
        (of("temporal", "seam"), SHAPES[4].1, "no \"seam\""),
        (of("gain", "frame-curve"), "at = [0.0]\nvalues = [1.0]", "no \"frame-curve\""),
        (of("offset", "row-profile"), curve, "\"at\" has 2 numbers, \"values\" has 1"),
        (of("offset", "row-profile"), "at = [1.0, 0.0]\nvalues = [1.0, 1.0]", "falls"),
        (of("offset", "row-profile"), "at = [0.0]\nvalues = [inf]", "not finite"),
        (of("offset", "seam"), "seam = []", "no [[seam]]"),
        (of("temporal", "row-flat"), "", "means nothing for a flat shape"),
        (of("temporal", "correlation"), "along = \"rows\"", "both or neither"),
        (of("temporal", "correlation"), "along = \"rows\"\ntaps = [0.0]", "not all 0"),
        (of("temporal", "correlation"), "along = \"rows\"\nlength = 0", "length = 0"),
        (of("gain", "wave"), &SHAPES[5].1.replace("0.11", "0.7"), "-0.5 to 0.5"),
        (of("gain", "map"), "[[term]]\ncolumns = []\nrows = [1.0]", "1 to 64"),
        (of("dark", "distribution"), "deviates = [9.0]\nvalues = [1.0]", "beyond"),
        (
            of("response", "signal-curve"),
            "signal_e = [1.0]\nchange_e = [1.0]\nnoise_e = [-1.0]",
            "below 0",
        ),
        ("domain = \"offset\"\nshape = \"seam\"".into(), "", "\"table\" is missing"),
        (of("offset", "seam").replace("-1", "-2"), "", "empirical-2.toml"),
        (format!("{seam}amount_e = \"big\""), SHAPES[4].1, "no number"),
    ] {
        let message = told(&effect, table);
        assert!(message.contains(expected), "{effect}: {message}");
        assert!(message.contains("[[effect]] at line"), "{message}");
    }
    let message = told(seam, &format!("# {}\n{}", "x".repeat(300_000), SHAPES[4].1));
    assert!(message.contains("longer than"), "{message}");
}
