//! `camrig lens`, and lenses in cameras.

use super::bad_input::refuses;
use super::{camrig, camrig_ok, shared, small_camera};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

const SINGLET: &str = r#"format = "camrig-prescription/1"
wavelengths_nm = [486.1, 587.6, 656.3]
fields_deg = [0.0, 10.0]
[aperture]
f_number = 5.0
[[surface]]
radius_mm = 10.0
thickness_mm = 2.0
glass = "N-BK7"
stop = true
[[surface]]
radius_mm = -30.0
thickness_mm = 14.0
"#;

const ZMX: &str = "VERS 140124\nMODE SEQ\nUNIT MM\nENPD 2.0\nFTYP 0\nXFLN 0 0\nYFLN 0 10\n\
    WAVM 1 0.5876 1\nPWAV 1\n\
    SURF 0\n  TYPE STANDARD\n  CURV 0\n  DISZ INFINITY\n\
    SURF 1\n  STOP\n  TYPE STANDARD\n  CURV 0.1\n  DISZ 2\n  GLAS N-BK7 0 0\n\
    SURF 2\n  TYPE STANDARD\n  CURV -0.03\n  DISZ 14\n\
    SURF 3\n  TYPE STANDARD\n  CURV 0\n  DISZ 0\n";

const SEQ: &str = "RDM\nLEN\nEPD 2.0\nWL 587.6\nREF 1\nYAN 0 10\nSO 0 1e13\n\
    S 10 2 NBK7_SCHOTT\nSTO\nS -30 14\nSI 0 0\nGO\n";

/// A Huygens listing of a round spot; `change` alters each row.
fn listing(change: impl Fn(usize, &mut Vec<f64>)) -> String {
    let mut text = String::from(
        "Listing of Huygens PSF Data\n\nFile : a.zmx\nTitle: one\n\n0.5500 um at 0.00 deg.\n\
         Data spacing is 0.500 um.\nData area is 8.000 by 8.000 um.\nStrehl ratio: 0.9\n\
         Pupil grid size: 32 by 32\nImage grid size: 16 by 16\nCenter point is: 9, 9\n\
         Values are relative intensity.\n\n",
    );
    for i in 0..16 {
        let distance = |j: usize| (i as f64 - 8.0).powi(2) + (j as f64 - 8.0).powi(2);
        let mut row = (0..16).map(|j| (-distance(j) / 8.0).exp()).collect();
        change(i, &mut row);
        let row: Vec<String> = row.iter().map(|v| format!("{v:E}")).collect();
        text += &(row.join("\t") + "\n");
    }
    text
}

/// A folder with prescriptions, PSF listings and the tables of a manifest.
pub(super) fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    write("good.toml", SINGLET);
    write("good.zmx", ZMX);
    write("good.seq", SEQ);
    write("psf.txt", &listing(|_, _| ()));
    write("height.csv", "height_mm,550\n0,0\n1,0.99\n");
    write("light.csv", "height_mm,550\n0,1\n1,0.9\n");
    write("manifest.toml", &manifest(&[(0.0, 550.0, "psf.txt"), (1.0, 550.0, "psf.txt")]));
    dir
}

fn manifest(psfs: &[(f64, f64, &str)]) -> String {
    let head = "format = \"camrig-lens-import/1\"\nname = \"m\"\nefl_mm = 4.0\nf_number = 2.0\n\
        distortion = [\"height.csv\"]\nrelative_illumination = [\"light.csv\"]\n";
    let block = |(height, nm, file): &(f64, f64, &str)| {
        format!("[[psf]]\nheight_mm = {height:?}\nwavelength_nm = {nm:?}\nfile = \"{file}\"\n")
    };
    head.to_owned() + &psfs.iter().map(block).collect::<String>()
}

fn json(dir: &Path, arguments: &str) -> Value {
    serde_json::from_slice(&camrig_ok(dir, arguments).stdout).expect("one JSON object")
}

#[test]
fn lenses_of_every_format_are_read() {
    let dir = folder();
    let dir = dir.path();
    // The lensmaker's equation for a thick lens, with n of N-BK7 at 587.6 nm.
    let (n, r1, r2, d) = (1.5168_f64, 10.0, -30.0, 2.0);
    let power = (n - 1.0) * (1.0 / r1 - 1.0 / r2 + (n - 1.0) * d / (n * r1 * r2));
    let info = json(dir, "lens info good.toml --json");
    assert!((info["efl_mm"].as_f64().unwrap() * power - 1.0).abs() < 1e-5, "{info}");
    let other = |file: &str| json(dir, &format!("lens info {file} --json"))["efl_mm"].as_f64();
    // CURV −0.03 of the Zemax file is another radius than that of the other formats.
    assert!(other("good.seq").is_some() && other("good.zmx").unwrap() < 17.0);
    camrig_ok(dir, "lens import manifest.toml -o imported");
    let imported = json(dir, "lens info imported --json");
    assert_eq!(imported["psf_heights_mm"], serde_json::json!([0.0, 1.0]));
}

/// A decentred lens has figures at field points (x, y) and a characterisation over the plane,
/// through which pictures are made; what needs a round lens refuses it and says why. Thin-lens
/// optics: the front surface, of power 0.5/50 and 0.5 mm above the axis, bends the chief ray of (0,
/// 0) upwards, to 0.25 mm at 50 mm; no ray of x = 0 leaves the plane of y and z.
#[test]
fn a_decentred_lens_has_a_two_dimensional_field_and_pictures() {
    let dir = folder();
    let dir = dir.path();
    let lens = "RDM\nEPD 2.0\nWL 587.5618\nYAN 0 5\nXAN 0 -3\nSO 0 1e13\nS 0 1\nSTO\n\
                S 50 1e-6 500.500\nYDE 0.5\nDAR\nS -50 50\nSI 0 0\nGO\n";
    std::fs::write(dir.join("decentred.seq"), lens).unwrap();
    let trace = json(dir, "lens trace decentred.seq --fields 0:0,0,-3:5,3:5 --json");
    let points = trace["points"].as_array().unwrap();
    let number = |i: usize, key: &str| points[i][key].as_f64().unwrap();
    assert!((number(0, "chief_ray_y_mm") - 0.25).abs() < 1e-4, "{trace}");
    assert_eq!(points[0], points[1]);
    assert!(number(0, "chief_ray_x_mm").abs() < 1e-12);
    assert!((number(2, "chief_ray_x_mm") + number(3, "chief_ray_x_mm")).abs() < 1e-9);
    // The file's own fields, and the same in the listing.
    let own = json(dir, "lens trace decentred.seq --json");
    assert_eq!(own["points"][1], points[2]);
    let info = json(dir, "lens info decentred.seq --json");
    assert_eq!(info["rotationally_symmetric"], false);
    assert_eq!(info["fields_deg"], serde_json::json!([[0.0, 0.0], [-3.0, 5.0]]));
    let why = ["not rotationally symmetric", "surface 2 is tilted or decentred"];
    refuses(dir, "lens plot decentred.seq -o plots", &why);
    let waves = "--wavelengths 550 --psf-size 32 --psf-tolerance 0.05";
    let written =
        camrig_ok(dir, &format!("lens trace decentred.seq --max-field 4 {waves} -o out"));
    assert!(String::from_utf8_lossy(&written.stderr).contains("places"), "{written:?}");
    let out = json(dir, "lens info out --json");
    let axis = |key: &str| {
        let values = out[key].as_array().unwrap();
        [values[0].as_f64().unwrap(), values[values.len() - 1].as_f64().unwrap()]
    };
    // Two surfaces of power 0.01: 50 mm. The frame is about the image's origin, so that the place
    // of the field point (0, 0) is 0.25 mm above the frame's middle there, below it in the picture.
    assert!((out["principal_distance_mm"].as_f64().unwrap() - 50.0).abs() < 0.01, "{out}");
    let ([left, right], [top, bottom]) = (axis("x_mm"), axis("y_mm"));
    assert!((left + right).abs() < 1e-4 && (top + bottom + 0.5).abs() < 0.01, "{out}");
    refuses(dir, "lens plot out -o plots", &why[..1]);
    camera_with(
        dir,
        "kind = \"characterised\"
data = \"out\"",
    );
    let command = "simulate --camera ./camera.toml --scene uniform:0.5 --exposure 5ms -o picture";
    camrig_ok(dir, &format!("{command}.npy"));
    refuses(dir, &format!("{command}.mcap"), &why[..1]);
    refuses(dir, "lens trace decentred.seq --fields 1:x", &["two as x:y"]);
}

/// Writes `camera.toml`, the camera `mt9v024` (752 x 480 pixels of 6 µm) with another lens.
pub(super) fn camera_with(dir: &Path, lens: &str) {
    let camera = camrig::camera::presets::file("mt9v024.toml").unwrap();
    let (head, rest) = camera.split_once("[lens]").unwrap();
    let rest = rest.split_once("[sensor]").unwrap().1;
    let camera = format!("{head}[lens]\n{lens}\n\n[sensor]{rest}");
    std::fs::write(dir.join("camera.toml"), camera).unwrap();
    for name in ["mt9v024-qe.csv", "ir-cut-690.csv"] {
        let text = camrig_ok(dir, &format!("presets {name}")).stdout;
        std::fs::write(dir.join(name), text).unwrap();
    }
}

#[test]
fn a_sensor_beyond_the_tables_of_a_lens_is_told() {
    let dir = folder();
    let dir = dir.path();
    // To an image height of 1 mm at 550 nm; the sensor's corner lies at 2.7 mm.
    camrig_ok(dir, "lens import manifest.toml -o imported");
    camera_with(dir, "kind = \"characterised\"\ndata = \"imported\"");
    let command = "simulate --camera ./camera.toml --scene uniform:0.5 --exposure 5ms --no-cache";
    let made = camrig_ok(dir, &format!("{command} -o picture.npy --json"));
    let told: Value = serde_json::from_slice(&made.stdout).unwrap();
    let notes: Vec<&str> =
        told["notes"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    let stderr = String::from_utf8_lossy(&made.stderr);
    for words in
        ["imported: distortion, relative illumination and PSFs end at 1.000 mm", "550 nm alone"]
    {
        assert!(notes.iter().any(|note| note.contains(words)), "{notes:?}");
        assert!(stderr.contains(words), "{stderr}");
    }
    // A circle of 0.99 mm (the distortion is 1 %) in a frame of 4.512 mm x 2.88 mm.
    let beyond = 100.0 * (1.0 - std::f64::consts::PI * 0.99 * 0.99 / (4.512 * 2.88));
    let note = notes.iter().find(|note| note.contains("% of the frame")).unwrap();
    let (before, _) = note.split_once(" % of the frame").unwrap();
    let share: f64 = before.rsplit(' ').next().unwrap().parse().unwrap();
    assert!((share - beyond).abs() <= 1.0, "{beyond}: {note}");
    refuses(
        dir,
        "lens info imported --sensor-shift 0.1",
        &["--sensor-shift for a lens directory"],
    );
}

/// Each command that makes pictures through a lens tells where its tables end: in the same words,
/// once on the terminal, and in `--json`.
#[test]
fn every_command_tells_where_the_tables_of_a_lens_end() {
    let dir = folder();
    let dir = dir.path();
    camrig_ok(dir, "lens import manifest.toml -o imported");
    camera_with(dir, "kind = \"characterised\"\ndata = \"imported\"");
    // 96 x 64 pixels of 30 µm: to 1.73 mm from the axis.
    let camera = std::fs::read_to_string(dir.join("camera.toml")).unwrap();
    let small = [("width = 752", "width = 96"), ("height = 480", "height = 64")];
    let camera = small.iter().fold(camera, |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    });
    std::fs::write(dir.join("camera.toml"), camera.replace("pitch_um = 6.0", "pitch_um = 30.0"))
        .unwrap();
    let scene = "--camera ./camera.toml --scene uniform:0.5";
    let mut told: Option<Vec<String>> = None;
    for command in [
        format!("simulate {scene} --exposure 5ms --no-cache -o a.npy --save-irradiance a.irr"),
        "expose --camera ./camera.toml --irradiance a.irr --exposure 5ms -o b.npy".into(),
        format!("rig stream emulator: {scene} --exposure 5ms --frames 1"),
        "rig stream emulator: --camera ./camera.toml --irradiance a.irr --exposure 5ms \
         --frames 1"
            .into(),
        "isp --camera ./camera.toml --exposure 1ms".into(),
    ] {
        let made = camrig_ok(dir, &format!("{command} --json"));
        let object: Value = serde_json::from_slice(&made.stdout).unwrap();
        let stderr = String::from_utf8_lossy(&made.stderr);
        let notes: Vec<String> = object["notes"]
            .as_array()
            .unwrap_or_else(|| panic!("{command}: {object}"))
            .iter()
            .filter_map(|note| Some(note.as_str()?.to_owned()))
            .filter(|note| note.contains("imported: "))
            .collect();
        let words = ["and PSFs end at 1.000 mm", "550 nm alone"];
        assert_eq!(notes.len(), words.len(), "{command}: {notes:?}");
        for (note, words) in notes.iter().zip(words) {
            assert!(note.contains(words), "{command}: {note}");
            let line = format!("note: {note}\n");
            assert_eq!(stderr.matches(&line).count(), 1, "{command}: {stderr}");
        }
        assert_eq!(told.get_or_insert_with(|| notes.clone()), &notes, "{command}");
    }
}

/// What was understood and assumed of a lens of many surfaces fits on a screen; the surfaces come
/// if they are asked for, or if there is room.
#[test]
fn info_of_a_lens_of_many_surfaces_fits_on_a_screen() {
    let dir = folder();
    let dir = dir.path();
    let plate = "[[surface]]\nthickness_mm = 0.01\n";
    std::fs::write(dir.join("long.toml"), SINGLET.to_owned() + &plate.repeat(40)).unwrap();
    let text = |command: &str| {
        String::from_utf8(camrig_ok(dir, &format!("lens info {command}")).stdout).unwrap()
    };
    let (info, all) = (text("long.toml"), text("long.toml --surfaces"));
    assert!(info.lines().count() <= 24 && all.lines().count() > 42, "{info}");
    assert!(info.ends_with("42 surfaces: --surfaces lists them\n"), "{info}");
    assert!(all.starts_with(info.split("42 surfaces").next().unwrap()), "{all}");
    assert!(all.contains("N-BK7") && text("good.toml").contains("N-BK7"), "{all}");
}

#[test]
fn drawings_are_whole_svg_files() {
    let dir = folder();
    let dir = dir.path();
    camrig_ok(dir, "lens import manifest.toml -o imported");
    let of_rays =
        ["distortion", "illumination", "chief-ray-angle", "mtf", "psf", "spot-1", "spot-3"];
    let of_tables = ["distortion", "illumination", "mtf", "psf"];
    for (what, out, expected) in [
        ("good.toml", "a", &of_rays[..]),
        ("good.zmx", "b", &of_rays),
        ("imported", "c", &of_tables),
    ] {
        camrig_ok(dir, &format!("lens plot {what} -o {out}"));
        let page = std::fs::read_to_string(dir.join(out).join("lens.html")).unwrap();
        assert!(page.contains("MTF against frequency"), "{what}");
        assert_eq!(page.contains("Prescription"), what != "imported", "{what}");
        for name in expected {
            let text = std::fs::read_to_string(dir.join(out).join(format!("{name}.svg"))).unwrap();
            assert!(
                text.starts_with("<svg") && text.trim_end().ends_with("</svg>"),
                "{what} {name}"
            );
            // A PSF is a picture in base64, in which any letters may occur.
            let words = !text.contains("NaN") && !text.contains("inf");
            assert!(words || *name == "psf", "{what} {name}");
        }
    }
    refuses(dir, "lens plot good.toml -o a", &["exists", "--force"]);
    camrig_ok(dir, "lens plot good.toml -o a --force");
    refuses(dir, "lens plot good.toml -o d --max-field 89.99", &["field"]);
    refuses(dir, "lens plot nothing -o d", &["nothing", ".zmx"]);
}

#[test]
fn impossible_prescriptions_are_refused() {
    let dir = folder();
    let dir = dir.path();
    let broken = |name: &str, text: String, says: &[&str]| {
        std::fs::write(dir.join(name), text).unwrap();
        let says: Vec<&str> = says.iter().copied().chain([name]).collect();
        refuses(dir, &format!("lens trace {name}"), &says);
    };
    broken(
        "a.toml",
        SINGLET.replace("N-BK7", "N-BK77"),
        &["N-BK77", "line 6", "N-BK7,", "--glass"],
    );
    broken("a.zmx", ZMX.replace("N-BK7", "N-BK77"), &["N-BK77", "line 19", "--glass"]);
    broken("a.seq", SEQ.replace("NBK7_SCHOTT", "NBK77_SCHOTT"), &["NBK77", "line 8", "--glass"]);
    // A stop of 1.5 mm before a ball of 0.5 mm.
    let ball = SINGLET
        .replace("= 10.0\nthick", "= 0.5\nthick")
        .replace("f_number = 5.0", "stop_radius_mm = 1.5");
    broken("ball.toml", ball, &["surface 1", "misses it", "aperture is larger"]);
    // Total reflection at the back surface.
    let steep = SINGLET.replace("-30.0", "-1.2").replace("f_number = 5.0", "stop_radius_mm = 1.1");
    broken("steep.toml", steep, &["surface 2", "totally reflected"]);
    // A field without light is left out; the others are traced.
    std::fs::write(dir.join("wide.toml"), SINGLET.replace("10.0]", "89.0]")).unwrap();
    let traced = camrig_ok(dir, "lens trace wide.toml");
    let told = String::from_utf8_lossy(&traced.stderr).into_owned();
    assert!(told.contains("the field 89° is left out"), "{told}");
    // Files that end too early.
    broken(
        "b.zmx",
        ZMX.split("SURF 3").next().unwrap().into(),
        &["surface 2", "line 20", "cut short"],
    );
    broken("b.seq", SEQ.split("SI ").next().unwrap().into(), &["SI", "ends before"]);
    broken("b.toml", SINGLET[..SINGLET.len() - 30].into(), &["line"]);
}

#[test]
fn impossible_psf_exports_are_refused() {
    let dir = folder();
    let dir = dir.path();
    let write = |name: &str, text: &str| std::fs::write(dir.join(name), text).unwrap();
    let good = listing(|_, _| ());
    write("cut.txt", &good[..good.len() * 2 / 3]);
    write(
        "negative.txt",
        &listing(|i, row| {
            if i == 3 {
                row[4] = -0.1
            }
        }),
    );
    write("dark.txt", &listing(|_, row| row.fill(0.0)));
    let refused = |psfs: &[(f64, f64, &str)], says: &[&str]| {
        write("m.toml", &manifest(psfs));
        refuses(dir, "lens import m.toml -o out", says);
        assert!(!dir.join("out").exists());
    };
    let axis = (0.0, 550.0, "psf.txt");
    refused(&[axis, (1.0, 550.0, "cut.txt")], &["cut.txt", "cut short"]);
    refused(
        &[axis, (1.0, 550.0, "negative.txt")],
        &["negative PSF value", "negative.txt", "line 18"],
    );
    refused(&[axis, (1.0, 550.0, "dark.txt")], &["m.toml", "1 mm", "550 nm", "every sample is 0"]);
    refused(&[axis, (1.0, 600.0, "psf.txt")], &["a PSF of 550 nm where 600 nm is expected"]);
    write("600.txt", &good.replace("0.5500 um", "0.6000 um"));
    refused(&[axis, (1.0, 600.0, "600.txt")], &["600 nm", "every height"]);
    let spaced = manifest(&[axis]) + "spacing_um = 0.25\n";
    write("m.toml", &spaced);
    let says = ["psf.txt", "samples 0.5 µm apart where 0.25 µm are expected"];
    refuses(dir, "lens import m.toml -o out", &says);
    refused(&[axis, (1.0, 550.0, "absent.txt")], &["absent.txt"]);
    write("light.csv", "height_mm,550\n0,1\n1,-0.9\n");
    refused(&[axis, (1.0, 550.0, "psf.txt")], &["m.toml", "relative illumination -0.9"]);
}

#[test]
fn heights_are_added_until_the_tolerance_is_met() {
    let dir = folder();
    let dir = dir.path();
    let trace = "lens trace good.toml --wavelengths 550 --psf-size 64 --heights 5 -o";
    let told = |output: std::process::Output| String::from_utf8(output.stderr).unwrap();
    let coarse = told(camrig_ok(dir, &format!("{trace} coarse --psf-tolerance 0.9")));
    assert!(coarse.contains("5 heights") && coarse.contains("misplaces"), "{coarse}");
    camrig_ok(dir, &format!("{trace} fine --psf-tolerance 0.02"));
    let info = |what: &str| json(dir, &format!("lens info {what} --json"));
    let (coarse, fine) = (info("coarse"), info("fine"));
    let mean = |info: &Value| info["psf_between"]["misplaced_mean"].as_f64().unwrap();
    assert!(mean(&coarse) > 0.02 && mean(&fine) <= 0.02, "{coarse} {fine}");
    assert!(fine["heights_mm"].as_array().unwrap().len() > 5);
    let never = told(camrig_ok(dir, &format!("{trace} never --psf-tolerance 1e-9")));
    assert!(never.contains("warning") && never.contains("--psf-tolerance"), "{never}");
    for bad in ["0", "-1", "x", "nan"] {
        refuses(
            dir,
            &format!("{trace} bad --psf-tolerance={bad}"),
            &["--psf-tolerance", "above zero"],
        );
    }
}

#[test]
fn simulate_reports_the_error_of_interpolated_psfs() {
    let dir = folder();
    let dir = dir.path();
    camrig_ok(
        dir,
        "lens trace good.toml --wavelengths 550 --psf-size 64 --heights 5 --psf-tolerance 0.9 \
        -o lens",
    );
    let camera = |kind: &str, data: &str| {
        let text = small_camera(40, 30, &[("pitch_um", "40.0")]);
        let from = text.find("[lens]").expect("a lens");
        let to = from + 1 + text[from + 1..].find("\n[").expect("another table");
        let lens = format!("[lens]\nkind = \"{kind}\"\n{data}\n");
        std::fs::write(dir.join("c.toml"), text[..from].to_owned() + &lens + &text[to..]).unwrap();
    };
    let simulate = "simulate --camera ./c.toml --scene uniform:0.5 --exposure 5us --no-cache \
        --json --force -o out.npy --report page.html";
    let optics = |arguments: &str| {
        let output = camrig_ok(dir, arguments);
        let object: Value = serde_json::from_slice(&output.stdout).unwrap();
        (object["optics"]["psf"].clone(), String::from_utf8(output.stderr).unwrap())
    };
    camera("characterised", "data = \"lens\"");
    let (psf, told) = optics(&format!("{simulate} --psf-tolerance 0.5"));
    assert!(
        psf["nodes"]["mean"].as_f64().is_some() && psf["heights"]["largest"].as_f64().is_some(),
        "{psf}"
    );
    assert!(!told.contains("misplace"), "{told}");
    let page = std::fs::read_to_string(dir.join("page.html")).unwrap();
    assert!(page.contains("PSFs between field points of the lens data"), "the page tells it too");
    let (_, told) = optics(&format!("{simulate} --psf-tolerance 1e-7"));
    assert!(told.contains("warning") && told.contains("misplace"), "{told}");
    // Stopped down, because a PSF near the diffraction limit is quickly traced.
    std::fs::write(dir.join("slow.toml"), SINGLET.replace("= 5.0", "= 16.0")).unwrap();
    camera("prescription", "file = \"slow.toml\"");
    let (psf, told) = optics(&format!("{simulate} --psf-tolerance 0.05"));
    assert!(psf["heights"]["mean"].as_f64().unwrap() <= 0.05, "{psf}");
    assert!(!told.contains("misplace"), "{told}");
}

#[test]
fn a_program_built_without_graphics_processors_says_so() {
    let dir = folder();
    let simulate = "simulate --camera mobile --scene uniform:0.5 --exposure 5ms -o a.npy --device";
    let wanted = ["device gpu", "--device cpu"];
    refuses(dir.path(), &format!("{simulate} gpu"), &wanted);
    refuses(dir.path(), &format!("{simulate} tpu"), &["cpu", "gpu", "auto"]);
}

/// A prescription is traced once: not again for a result in the cache, nor for another scene. The
/// picture does not depend on where its lens came from.
#[test]
fn a_lens_is_traced_once() {
    let dir = folder();
    let dir = dir.path();
    std::fs::write(dir.join("slow.toml"), SINGLET.replace("= 5.0", "= 16.0")).unwrap();
    let text = small_camera(40, 30, &[("pitch_um", "40.0")]);
    let from = text.find("[lens]").expect("a lens");
    let to = from + 1 + text[from + 1..].find("\n[").expect("another table");
    let lens = "[lens]\nkind = \"prescription\"\nfile = \"slow.toml\"\n";
    std::fs::write(dir.join("c.toml"), text[..from].to_owned() + lens + &text[to..]).unwrap();
    let run = |name: &str, arguments: &str| {
        let command = format!(
            "simulate --camera ./c.toml --exposure 5us --psf-tolerance 0.05 --json -o {name}.npy \
            {arguments}"
        );
        let output = Command::new(env!("CARGO_BIN_EXE_camrig-under-test"))
            .current_dir(dir)
            .args(command.split_whitespace())
            .env("XDG_CACHE_HOME", dir.join("cache"))
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let object: Value = serde_json::from_slice(&output.stdout).unwrap();
        let told = |key: &str| object["optics"][key].as_bool().unwrap();
        (
            told("cached"),
            told("lens_traced"),
            std::fs::read(dir.join(format!("{name}.npy"))).unwrap(),
        )
    };
    let (checks, edge) = ("--scene checkerboard", "--scene slanted-edge");
    let first = run("first", checks);
    assert_eq!((first.0, first.1), (false, true));
    // The cube is in the cache, so the lens is not even read.
    let second = run("second", checks);
    assert_eq!((second.0, second.1), (true, false));
    assert_eq!(first.2, second.2);
    let other = run("other", edge);
    assert_eq!((other.0, other.1), (false, false));
    let anew = run("anew", &format!("{edge} --no-cache"));
    assert_eq!((anew.0, anew.1), (false, true));
    assert_eq!(other.2, anew.2);
    // Another sensor position is another lens; a damaged one is traced again.
    let shifted = "[[effect]]\nkind = \"defocus\"\nshift_um = 5.0\n";
    let camera = std::fs::read_to_string(dir.join("c.toml")).unwrap();
    std::fs::write(dir.join("c.toml"), camera.clone() + shifted).unwrap();
    assert!(run("shifted", edge).1);
    std::fs::write(dir.join("c.toml"), camera).unwrap();
    let kept = std::fs::read_dir(dir.join("cache/camrig/optics")).unwrap();
    for path in kept.map(|entry| entry.unwrap().path()).filter(|p| p.is_dir()) {
        std::fs::write(path.join("psf.npy"), b"?").unwrap();
    }
    assert!(run("mended", "--scene dots").1);
    assert!(!run("kept", "--scene uniform:0.3").1);
}

/// Figures of the reference lenses as the program prints them, within the tolerance of the other
/// programs that gave the references.
#[test]
fn printed_figures_agree_with_reference_programs() {
    for (lens, name) in [("double-gauss", "double_gauss"), ("phone-80deg", "phone80")] {
        let Some(oracle) = shared(&format!("golden/lenses/oracle_{name}.json")) else { return };
        let text = std::fs::read_to_string(oracle).unwrap().replace("NaN", "null");
        let oracle: Value = serde_json::from_str(&text).unwrap();
        let list = |key: &str| -> Vec<f64> {
            oracle[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
        };
        let comma =
            |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
        let (fields, waves) = (list("theta_deg"), list("wvl_nm"));
        let file =
            Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../host/lenses/{lens}.toml"));
        let stop = oracle["settings"]["stop_radius_mm"].as_f64().unwrap();
        let arguments = format!(
            "lens trace {} --fields {} --wavelengths {} --stop-radius {stop} --json",
            file.display(),
            comma(&fields),
            comma(&waves)
        );
        let traced = json(Path::new("."), &arguments);
        assert!((traced["stop_radius_mm"].as_f64().unwrap() - stop).abs() < 1e-9);
        for (k, point) in traced["points"].as_array().unwrap().iter().enumerate() {
            let (f, w) = (k / waves.len(), k % waves.len());
            for (ours, theirs, tolerance) in [
                ("chief_ray_height_mm", "chief_y_mm", 1e-6),
                ("cra_deg", "cra_deg", 1e-4),
                ("relative_illumination", "rel_illum", 1e-4),
            ] {
                let (a, b) =
                    (point[ours].as_f64().unwrap(), oracle[theirs][f][w].as_f64().unwrap());
                assert!(
                    (a - b).abs() < tolerance,
                    "{lens} {} {}: {ours} {a} {b}",
                    fields[f],
                    waves[w]
                );
            }
        }
    }
    assert!(!camrig(Path::new("."), "lens trace").status.success());
}

/// The script for OpticStudio, run against a stand-in for its interface that answers with a traced
/// lens: what it leaves comes back as that lens.
#[test]
fn the_script_for_opticstudio_exports_the_lens_that_it_is_given() {
    let python = Command::new("python3").args(["-c", "import tomllib"]).output();
    if !python.is_ok_and(|output| output.status.success()) {
        println!("SKIP: python3 with tomllib is not there (script for OpticStudio)");
        return;
    }
    let folder = folder();
    let dir = folder.path();
    let grid = "--heights 3 --max-field 10 --wavelengths 486.1,587.6,656.3 --psf-size 32";
    camrig_ok(
        dir,
        &format!("lens trace good.toml {grid} --psf-spacing 1.5 --psf-tolerance 1 -o traced"),
    );
    let contrib = concat!(env!("CARGO_MANIFEST_DIR"), "/../contrib/lens-programs/opticstudio.py");
    let mut script = std::fs::read_to_string(contrib).unwrap();
    for (setting, value) in [
        ("HEIGHTS = 21", "HEIGHTS = 3"),
        ("MAX_FIELD_DEG = 20.0", "MAX_FIELD_DEG = 10"),
        ("[400, 450, 500, 550, 600, 650, 700]", "[486.1, 587.6, 656.3]"),
        ("PSF_SIZE = 128", "PSF_SIZE = 32"),
        ("PSF_SPACING_UM = 0.5", "PSF_SPACING_UM = 1.5"),
    ] {
        assert_eq!(script.matches(setting).count(), 1, "{setting}");
        script = script.replace(setting, value);
    }
    std::fs::write(dir.join("export.py"), script).unwrap();
    let stand_in = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/suite/zosapi.py");
    let run = Command::new("python3")
        .arg(stand_in)
        .args(["export.py", "traced", "10", "exported"])
        .current_dir(dir)
        .output()
        .unwrap();
    let told = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{told}");
    assert!(String::from_utf8_lossy(&run.stdout).contains("vignetting factors"), "{told}");
    camrig_ok(dir, "lens import exported -o back");
    let read = |name: &str| camrig::optics::Characterisation::read(&dir.join(name)).unwrap();
    let (traced, back) = (read("traced"), read("back"));
    let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(near(&traced.heights_mm, &back.heights_mm));
    assert!(near(&traced.real_height_mm, &back.real_height_mm));
    assert!(near(&traced.relative_illumination, &back.relative_illumination));
    let angles =
        |lens: &camrig::optics::Characterisation| lens.chief_ray_angle_deg.clone().unwrap();
    assert!(near(&angles(&traced), &angles(&back)));
    assert_eq!(traced.psf.data.len(), back.psf.data.len());
    let peak = traced.psf.data.iter().copied().fold(0.0, f32::max);
    let worst = traced.psf.data.iter().zip(&back.psf.data);
    let worst = worst.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-4 * peak, "{worst} of {peak}");
}

/// The figures of `lens tolerance`: the same bytes for a seed, and less contrast for larger
/// tolerances.
#[test]
fn tolerances_cost_contrast_and_a_seed_repeats_itself() {
    let folder = folder();
    let dir = folder.path();
    let run = |options: &str| {
        let arguments = format!(
            "lens tolerance good.toml --fields 0 --lenses 8 --frequency 20 --json {options}"
        );
        camrig_ok(dir, &arguments).stdout
    };
    let small = run("--decentre 0.01 --seed 3");
    assert_eq!(small, run("--decentre 0.01 --seed 3"));
    assert_ne!(small, run("--decentre 0.01 --seed 4"));
    let value = |bytes: &[u8]| serde_json::from_slice::<Value>(bytes).unwrap();
    let of =
        |report: &Value, key: &str| report["fields"][0]["sagittal"]["mtf"][key].as_f64().unwrap();
    let report = value(&small);
    assert!(of(&report, "p10") <= of(&report, "p90"));
    let dearest = report["sensitivities"][0]["mtf_loss"].as_f64().unwrap();
    assert!(dearest > 0.0, "{report}");
    refuses(dir, "lens tolerance good.toml --index 2", &["a tolerance of 2 of index"]);
}

/// The table of surfaces tells both half widths, and what is obscured.
#[test]
fn lens_info_lists_apertures_that_are_not_circular() {
    let dir = tempfile::tempdir().unwrap();
    let lens = "format = 'camrig-prescription/1'\nwavelengths_nm = [550.0]\nfields_deg = [0.0]\n\
                [aperture]\nentrance_pupil_mm = 5.0\n[[surface]]\nstop = true\nradius_mm = 50.0\n\
                thickness_mm = 3.0\nglass = 'N-BK7'\naperture_rectangle_mm = [1.6, 0.9]\n\
                obscuration_radius_mm = 0.2\n[[surface]]\nthickness_mm = 94.0\n\
                aperture_radius_mm = 4.0\n";
    std::fs::write(dir.path().join("lens.toml"), lens).unwrap();
    let listed = camrig_ok(dir.path(), "lens info lens.toml --surfaces").stdout;
    let listed = String::from_utf8(listed).unwrap();
    let line = |start: &str| listed.lines().find(|l| l.starts_with(start)).unwrap().to_owned();
    assert!(
        line("  1 ").contains("1.600 x 0.900") && line("  1 ").contains("obscured"),
        "{listed}"
    );
    assert!(line("  2 ").contains(" 4.00000 ") && !line("  2 ").contains("obscured"), "{listed}");
}
