//! Lenses by their setup.

use super::{prescription, system};
use camrig_prescription::{Glass, Setup};

const LENS: &str = "RDM; EPD 2; DIM M; WL 550; YAN 0; SO 0 1e13; S 10 2 OWN; S -10 9; SI 0 0";
/// n = 1.5 by formula 2.
const AGF: &str = "CC own\nNM OWN 2 500600 1.5 60 0 1 0\nCD 1.25 0 0 0 0 0\nLD 0.4 0.7\n";

#[test]
fn glasses_come_from_catalogues_elsewhere_and_from_the_setup() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["lens", "glass", "none"] {
        std::fs::create_dir(at(name)).unwrap();
    }
    std::fs::write(at("lens/lens.seq"), LENS).unwrap();
    std::fs::write(at("glass/melts.AGF"), AGF).unwrap();
    let plain = Setup { file: at("lens/lens.seq"), ..Setup::default() };
    assert!(system(&plain).unwrap_err().to_string().contains("no glass called \"OWN\""));
    let with =
        |catalogue: &str| system(&Setup { catalogues: vec![at(catalogue)], ..plain.clone() });
    // Thick lens, n 1.5, radii 10 and -10, 2 mm thick: 1/f = 0.5 (0.2 - 0.5·2/(1.5·100)).
    for catalogue in ["glass", "glass/melts.AGF"] {
        let efl = with(catalogue).unwrap().paraxial.efl_mm;
        assert!((efl - 300.0 / 29.0).abs() < 1e-9, "{efl}");
    }
    assert!(with("none").unwrap_err().to_string().contains("no glass catalogue"));
    assert!(with("nowhere").unwrap_err().to_string().contains("nowhere"));
    let glasses = vec![Glass::named("OWN=1.5:200").unwrap()];
    let own = prescription(&Setup { glasses, catalogues: vec![at("glass")], ..plain });
    assert_eq!(own.unwrap().surfaces.len(), 2);
}

#[test]
fn a_file_with_one_configuration_has_no_second() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("lens.seq");
    std::fs::write(&file, LENS.replace("OWN", "NBK7")).unwrap();
    let with = |name: &str| Setup {
        file: file.clone(),
        configuration: Some(name.into()),
        ..Setup::default()
    };
    assert!(system(&with("1")).is_ok());
    assert!(system(&with("2")).unwrap_err().to_string().contains("configuration \"2\""));
}
