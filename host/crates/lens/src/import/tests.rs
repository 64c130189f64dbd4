//! Importers against real exports, and against what they must refuse.

use super::super::tests::{golden_psfs, shared};
use super::*;
use std::path::PathBuf;

fn message(result: Result<impl std::fmt::Debug>) -> String {
    result.unwrap_err().to_string()
}

/// Both golden sets (UTF-16 and Latin-1) give the oracle's own figures and PSFs, the right way up.
#[test]
fn golden_iset_sets_come_in() {
    let Some(dir) = shared("golden/lenses") else { return };
    for name in ["double_gauss", "phone80"] {
        let lens = import(&dir.join(format!("iset_{name}"))).unwrap();
        let oracle: serde_json::Value = serde_json::from_str(
            &std::fs::read_to_string(dir.join(format!("oracle_{name}.json"))).unwrap(),
        )
        .unwrap();
        assert_eq!(lens.wavelengths_nm, [400.0, 450.0, 500.0, 550.0, 600.0, 650.0, 700.0]);
        assert_eq!((lens.heights_mm.len(), lens.psf.heights_mm.len(), lens.psf.size), (5, 3, 128));
        // The last of five heights is the last of the oracle's eleven fields; printed to 7 digits.
        for w in 0..7 {
            let at = |key: &str| oracle[key][10][w].as_f64().unwrap();
            assert!((lens.real_height_mm[4 * 7 + w] / at("chief_y_mm") - 1.0).abs() < 1e-6);
            let angle = lens.chief_ray_angle_deg.as_ref().unwrap()[4 * 7 + w];
            assert!((angle - at("cra_deg")).abs() < 1e-4);
            assert!((lens.relative_illumination[4 * 7 + w] - at("rel_illum")).abs() < 1e-6);
        }
        // Heights 1 and 5 are fields 0 and 10; wavelengths 2, 4, 7. The files were written from
        // another sampling of the pupil: up to 3 % of the peak apart; a shift by a row makes 18 %
        // and more.
        let golden = golden_psfs(&dir.join(format!("oracle_{name}_psf.npz")));
        for (h, field) in [(0, 0), (2, 10)] {
            for (w, wave) in [(0, 1), (1, 3), (2, 6)] {
                let theirs = &golden[(field * 7 + wave) * 128 * 128..][..128 * 128];
                let peak = theirs.iter().copied().fold(0.0, f64::max);
                for (a, b) in lens.psf.psf(h, w).iter().zip(theirs) {
                    assert!((f64::from(*a) - b).abs() < 0.05 * peak, "{name} {field} {wave}");
                }
            }
        }
    }
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
