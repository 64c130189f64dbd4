//! Tables and listings of lens programs: their units, wavelengths and fields are read, and must
//! agree with each other.

use camrig_base::{Error, Result};
use camrig_glass::text;
use camrig_lens_files::import::{import, listing};
use camrig_optics::Characterisation;
use camrig_testing::shared;
use std::path::{Path, PathBuf};

fn message(result: Result<impl std::fmt::Debug>) -> String {
    result.unwrap_err().to_string()
}

#[test]
fn listings_of_distortion_and_illumination() {
    let text = "Listing of Grid Distortion Data\n\n   i    j  X-Field Y-Field R-Field Predicted X \
                Predicted Y Real X Real Y Distortion\n\
                -1 -1 -5 -5 7 -1.0 -1.0 -0.9 -0.9 -10.0%\n 0 0 0 0 0 0 0 0 0 0.0%\n \
                1 0 5 0 5 1.0 0.0 0.95 0.0 -5.0%\n\
                Maximum distortion: -10 %\n";
    let pairs = listing::grid_distortion(text).unwrap();
    assert_eq!(pairs.len(), 3);
    assert!((pairs[1][1] - 0.95).abs() < 1e-12 && (pairs[2][0] - 2f64.sqrt()).abs() < 1e-12);
    let text = "Relative Illumination\nWavelength: 0.55\nField values are in degrees.\n \
                Field Rel. Ill. Effective F/#\n 0.0 1.0 2.0\n 10.0 0.9 2.1\n";
    assert_eq!(listing::relative_illumination(text).unwrap(), [[0.0, 1.0], [10.0, 0.9]]);
}

/// A manifest with tables of one wavelength, and what its PSFs are.
fn small(illumination: &str, psf: &str) -> Result<Characterisation> {
    of_files(&[("i.csv", illumination)], psf)
}

/// A manifest of the named files and what its PSFs are; files that are not named are right.
fn of_files(named: &[(&str, &str)], psf: &str) -> Result<Characterisation> {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("d.csv", "height_mm,550\n0,0\n1,0.98\n2,1.9\n");
    write("i.csv", "height_mm,550\n0,1\n2,0.8\n");
    write("p.csv", "0,1,0\n1,4,1\n0,1,0\n");
    let text = format!(
        "format = \"camrig-lens-import/1\"\nname = \"small\"\nefl_mm = 4.0\nf_number = 2.0\n\
         distortion = [\"d.csv\"]\nrelative_illumination = [\"i.csv\"]\n{psf}"
    );
    write("lens.toml", &text);
    named.iter().for_each(|(name, text)| write(name, text));
    import(&folder.path().join("lens.toml"))
}

const AXIS: &str =
    "[[psf]]\nheight_mm = 0.0\nwavelength_nm = 550\nspacing_um = 1.0\nfile = \"p.csv\"\n";

#[test]
fn tables_in_another_unit_are_refused_or_converted() {
    let refused = |name: &str, text: &str| message(of_files(&[(name, text)], AXIS));
    let error = refused("i.csv", "height_mm,550\n0,100\n2,80\n");
    assert!(error.contains("100 on the axis") && error.contains("divide"), "{error}");
    let error = refused("d.csv", "field_deg,550\n0,0\n5,0.98\n10,1.9\n");
    assert!(error.contains("field_deg") && error.contains("height_mm"), "{error}");
    let error = refused("d.csv", "height_mm,0.55\n0,0\n1,0.98\n2,1.9\n");
    assert!(error.contains("0.55 nm") && error.contains("in nm"), "{error}");
    let error = refused("d.csv", "height_mm,550\n0,0\n1,980\n2,1900\n");
    assert!(error.contains("980 mm at the paraxial height 1 mm"), "{error}");
    let um = "height_um,550\n0,0\n1000,0.98\n2000,1.9\n";
    assert_eq!(of_files(&[("d.csv", um)], AXIS).unwrap().heights_mm, [0.0, 1.0, 2.0]);
    let commas = "height_mm;550\n0;0\n1,0;0,98\n2,0;1,9\n";
    let lens = of_files(&[("d.csv", commas)], AXIS).unwrap();
    assert_eq!(lens.real_height_mm, [0.0, 0.98, 1.9]);
    let angles = format!("chief_ray_angle = [\"a.csv\"]\n{AXIS}");
    let error = message(of_files(&[("a.csv", "height_mm,550\n0,0\n2,1000\n")], &angles));
    assert!(error.contains("to the axis") && error.contains("radians"), "{error}");
}

/// The distortion of a lens of 10 mm in a listing.
fn grid(unit: &str, wavelength: &str, scale: f64) -> String {
    let row =
        |y: f64| format!(" 0 {} 0 5 5 0 {} 0 {} -1%\n", y * 9.0, y * scale, 0.99 * y * scale);
    let rows: String = [0.0, 1.0, 2.0].map(row).concat();
    format!(
        "Listing of Grid Distortion Data\n{unit}\n{wavelength}\n   i    j  X-Field Y-Field R-Field \
         Predicted X Predicted Y Real X Real Y Distortion\n{rows}"
    )
}

#[test]
fn listings_of_tables_have_a_unit_and_a_wavelength() {
    for (unit, scale) in [("", 1.0), ("Units are Millimeters.", 1.0), ("Units are Inches.", 25.4)]
    {
        let listing = grid(unit, "", 1.0 / scale);
        let pairs = listing::grid_distortion(&listing).unwrap();
        assert!((pairs[2][0] - 2.0).abs() < 1e-12 && (pairs[2][1] - 1.98).abs() < 1e-12);
    }
    assert!(message(listing::grid_distortion(&grid("Units are Feet.", "", 1.0))).contains("feet"));
    let decimal_commas = grid("", "", 1.0).replace("0.99", "0,99").replace("1.98", "1,98");
    assert_eq!(listing::grid_distortion(&decimal_commas).unwrap()[1], [1.0, 0.99]);

    let two = |first: &str, second: &str| {
        let text = "[[psf]]\nheight_mm = 0.0\nwavelength_nm = 450\nspacing_um = 1.0\n\
                    file = \"p.csv\"\n[[psf]]\nheight_mm = 0.0\nwavelength_nm = 650\n\
                    spacing_um = 1.0\nfile = \"p.csv\"\n";
        let rows = |end: f64| format!("Rel. Ill.\n 0.0 1.0 2.0\n 2.5 {end} 2.1\n");
        let head = |nm: &str, end: f64| format!("Relative Illumination\n{nm}\n{}", rows(end));
        let files = [
            ("d.csv", "height_mm,450,650\n0,0,0\n1,0.98,0.98\n2,1.9,1.9\n"),
            ("a.txt", &head(first, 0.9)),
            ("b.txt", &head(second, 0.7)),
        ];
        let folder = tempfile::tempdir().unwrap();
        let write =
            |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        files.iter().for_each(|(name, text)| write(name, text));
        write("p.csv", "0,1,0\n1,4,1\n0,1,0\n");
        write(
            "lens.toml",
            &format!(
                "format = \"camrig-lens-import/1\"\nname = \"two\"\nefl_mm = 4.0\nf_number = 2.0\n\
             distortion = [\"d.csv\"]\nrelative_illumination = [\"a.txt\", \"b.txt\"]\n{text}"
            ),
        );
        import(&folder.path().join("lens.toml"))
    };
    let lens = two("Wavelength: 0.6500 µm", "Wavelength: 0.4500 µm").unwrap();
    // At 2 mm of 2.5: 450 nm falls to 0.7, 650 nm to 0.9.
    let [blue, red] = lens.relative_illumination[4..] else { panic!() };
    assert!((blue - 0.76).abs() < 0.01 && (red - 0.92).abs() < 0.01, "{blue} {red}");
    let error = message(two("", ""));
    assert!(error.contains("does not say its wavelength"), "{error}");
}

/// A Huygens listing of a spot three samples along x and one along y, of the field printed.
fn spot(at: &str, centre: &str) -> String {
    let size = 9_i32;
    let value = |row: i32, column: i32| {
        let (x, y) = (f64::from(column - 4) / 3.0, f64::from(row - 4));
        // Brighter to the right, and above.
        (-0.5 * (x * x + y * y)).exp() * (1.0 + 0.1 * x - 0.05 * y)
    };
    let row =
        |row| (0..size).map(|c| format!("{:.6e} ", value(row, c))).collect::<String>() + "\n";
    let rows: String = (0..size).map(row).collect();
    format!(
        "Listing of Huygens PSF Data\n{at}\nData spacing is 1.0 µm.\nImage grid size: 9 by 9\n\
         Center point is: 5, 5\n{centre}\nValues are relative intensity.\n\n{rows}"
    )
}

#[test]
fn a_field_on_the_x_axis_is_turned_so_that_rows_are_radial() {
    let oriented = |at: &str, centre: &str| {
        let listing = listing::psf(&spot(at, centre))?;
        Ok::<_, Error>(listing.oriented(listing.runs_outwards()).1)
    };
    let along = |psf: &[f64], rows: bool| {
        let weight = |k: usize| ((if rows { k / 9 } else { k % 9 }) as f64 - 4.0, psf[k]);
        let sums = (0..81)
            .map(weight)
            .fold([0.0; 3], |s, (x, v)| [s[0] + v, s[1] + v * x, s[2] + v * x * x]);
        [sums[1] / sums[0], sums[2] / sums[0]]
    };
    for (side, x) in [(1.0, "6.0000"), (-1.0, "-6.0000")] {
        let psf = oriented(&format!("0.5500 µm at {x}, 0.0000 (deg)."), "").unwrap();
        let (radial, across) = (along(&psf, true), along(&psf, false));
        assert!(radial[1] > 3.0 * across[1], "{radial:?} {across:?}");
        // The brighter side lies at +x: outwards of a field at +x.
        assert!(radial[0] * side > 0.05, "{side}: {radial:?}");
    }
    let own = oriented("0.5500 µm at 6.0000, 0.0000 (deg).", "Center coordinates: -1.2, 0 mm");
    assert!(along(&own.unwrap(), true)[0] < -0.05);
    let y = oriented("0.5500 µm at 0.0000, 6.0000 (deg).", "").unwrap();
    assert!(along(&y, false)[1] > 3.0 * along(&y, true)[1]);
    let error = message(oriented("0.5500 µm at 4.0000, 6.0000 (deg).", ""));
    assert!(error.contains("off both axes"), "{error}");
    // On the axis a trace's rounding errors say nothing.
    let axis = "Center coordinates: 3.0E-017, -2.0E-016 Millimeters";
    assert!(oriented("0.5500 µm at 0.0000, 0.0000 (deg).", axis).is_ok());
}

#[test]
fn a_psf_of_another_field_or_of_several_wavelengths_is_refused() {
    let at = |place: &str, wavelengths: &str| {
        let psf = format!("{AXIS}[[psf]]\nheight_mm = 1.0\nfile = \"s.txt\"\n");
        let axis = spot("0.5500 µm at 0.0000 mm.", "");
        let text = spot(&format!("{wavelengths} µm at 6.0000 (deg)."), place);
        let psf = psf.replace("p.csv", "a.txt");
        of_files(&[("a.txt", &axis), ("s.txt", &text)], &psf)
    };
    let [right, inches] = ["0.98", "0.0385827"].map(|y| format!("Center coordinates: 0, {y}"));
    assert!(at(&right, "0.5500").is_ok() && at(&inches, "0.5500").is_ok());
    assert!(at(&right, "0.5500 to 0.5500").is_ok());
    let error = message(at("Center coordinates: 0, 1.9", "0.5500"));
    assert!(error.contains("1.9 mm from the axis") && error.contains("0.98 mm"), "{error}");
    let error = message(at(&right, "0.4861 to 0.6563"));
    assert!(error.contains("0.4861 to 0.6563") && error.contains("each wavelength"), "{error}");
}

#[test]
fn tables_and_psfs_that_contradict_each_other_are_refused() {
    let psf = AXIS;
    let whole = "height_mm,550\n0,1\n2,0.8\n";
    let lens = small(whole, psf).unwrap();
    assert_eq!(lens.heights_mm, [0.0, 1.0, 2.0]);
    assert!((lens.relative_illumination[2] - 0.8).abs() < 1e-12);
    // On its last slope the illumination would be 0.6 at 2 mm.
    let error = message(small("height_mm,550\n0,1\n1,0.8\n", psf));
    assert!(error.contains("ends at the height 1 mm"), "{error}");
    let error = message(small(whole, &psf.repeat(2)));
    assert!(error.contains("two PSFs of height 0 mm and 550 nm"), "{error}");
}

/// A listing Zemax wrote in 2005 (Latin-1), beside the numbers another program read from it.
#[test]
fn a_real_huygens_listing_comes_in() {
    let Some(dir) = shared("data/lenses/lens_asphere2mm_zemax") else { return };
    let text = text::read_text(&dir.join("AsphereF=2mm_PSF_21_3.dat")).unwrap();
    let psf = listing::psf(&text).unwrap();
    assert_eq!(psf.shape, [128, 128]);
    assert_eq!(psf.centre, [64, 64]);
    assert_eq!(
        (psf.wavelength_nm, psf.field, psf.spacing_um),
        (Some(550.0), Some([0.0, -27.38]), Some(0.25))
    );
    let cut: String = text.lines().take(90).map(|l| format!("{l}\n")).collect();
    let error = message(listing::psf(&cut));
    assert!(
        error.contains("rows of values instead of 128") && error.contains("line 90"),
        "{error}"
    );
    let error = message(listing::psf(&text.replacen("3.206E-004", "-3.206E-004", 1)));
    assert!(error.contains("negative") && error.contains("line"), "{error}");
}

/// Blanks and capitals in a label differ between versions of the program; the sign of the image
/// position, not that of the field, tells which way is up.
#[test]
fn labels_of_a_listing_with_any_blanks() {
    let text = |label: &str, y: &str| {
        format!(
            "Listing of Huygens PSF\n0.5500 µm at 6.0000 mm.\nData spacing is 0.4 µm.\n\
             Image grid size: 2 by 2\n{label} 0.0E+00, {y} Millimeters\n\
             Values are relative.\n0 1\n2 3\n"
        )
    };
    for label in ["Center coordinates:", "Center coordinates  :", "center  coordinates :"] {
        let psf = listing::psf(&text(label, "-1.2")).unwrap();
        assert_eq!(psf.image, Some([0.0, -1.2]), "{label}");
        assert!(psf.runs_outwards());
        assert!(!listing::psf(&text(label, "1.2")).unwrap().runs_outwards());
    }
    let usual = text("Center coordinates:", "1.2");
    for (from, to, words) in [
        ("0.4 µm.", "0.4 mrad.", "a data spacing in mrad"),
        ("0.4 µm.", "0.4 in.", "a data spacing in in"),
        ("6.0000 mm.", "6.0000 in.", "a field in in"),
    ] {
        let error = message(listing::psf(&usual.replace(from, to)));
        assert!(error.contains(words) && error.contains("line"), "{error}");
    }
    let error = message(listing::psf(&text("Center coordinates:", "?")));
    assert!(error.contains("image position") && error.contains("line 5"), "{error}");
}

/// The same lens through a manifest: tables in CSV, the PSF as its listing, on the axis by decree.
#[test]
fn a_manifest_of_csv_and_listing_comes_in() {
    let Some(dir) = shared("data/lenses/lens_asphere2mm_zemax") else { return };
    let folder = tempfile::tempdir().unwrap();
    let manifest = |psf: &str| {
        let text = format!(
            "format = \"camrig-lens-import/1\"\nname = \"asphere\"\nefl_mm = 2.0\nf_number = 4.0\n\
             distortion = [{:?}]\nrelative_illumination = [{:?}]\n{psf}",
            dir.join("distortion_real_height_mm.csv"),
            dir.join("relative_illumination.csv"),
        );
        let path = folder.path().join("lens.toml");
        std::fs::write(&path, text).unwrap();
        path
    };
    let file = dir.join("AsphereF=2mm_PSF_21_3.dat");
    let lens = import(&manifest(&format!("[[psf]]\nheight_mm = 0.0\nfile = {file:?}\n"))).unwrap();
    assert_eq!(lens.wavelengths_nm, [450.0, 500.0, 550.0, 600.0, 650.0]);
    assert!((lens.real_height_mm[5 + 2] - 0.05111456).abs() < 1e-9);
    assert_eq!(lens.psf.spacing_um, 0.25);
    let error = message(import(&manifest("psf = []\n")));
    assert!(error.contains("[[psf]]"), "{error}");
    let error = message(import(&manifest("colour = 3\n[[psf]]\nheight_mm = 0.0\nfile = \"x\"\n")));
    assert!(error.contains("colour") && error.contains("line"), "{error}");
}

/// Copies a golden set and breaks one of its files.
fn broken(change: impl Fn(&Path)) -> Option<String> {
    let from = shared("golden/lenses/iset_phone80")?;
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path: PathBuf = entry.unwrap().path();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(folder.path().join(path.file_name().unwrap()), bytes).unwrap();
    }
    change(folder.path());
    Some(message(import(folder.path())))
}

#[test]
fn broken_sets_say_what_is_missing() {
    let Some(error) = broken(|d| {
        std::fs::remove_file(d.join("phone80_2D_PSF_Fld3_Wave4.dat")).unwrap();
    }) else {
        return;
    };
    assert!(error.contains("550 nm") && error.contains("Fld3_Wave4"), "{error}");
    let truncate = |name: &'static str| {
        broken(move |d| {
            let path = d.join(name);
            let bytes = std::fs::read(&path).unwrap();
            std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        })
        .unwrap()
    };
    let error = truncate("phone80_DI_.dat");
    assert!(error.contains("instead of 35") && error.contains("phone80_DI_.dat"), "{error}");
    let error = truncate("phone80_2D_PSF_Fld5_Wave2.dat");
    assert!(error.contains("cut short") && error.contains("Fld5_Wave2"), "{error}");
    let error = truncate("ISETPARMS.TXT");
    assert!(error.contains("no value of"), "{error}");
}
