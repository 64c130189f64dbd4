//! What the flags of a `.zmx` file say, and what of it is refused.

use super::*;
use crate::{Conditions, System, characterise};

/// A plano-convex lens, curvature 0.025, of N-BK7 (n_d 1.51680), with words replaced.
fn lens(changes: &[(&str, &str)]) -> Result<Prescription> {
    read(&lens_text(changes), &Catalogue::default())
}

fn lens_text(changes: &[(&str, &str)]) -> String {
    let mut text = "MODE SEQ\nUNIT MM\nENPD 6\nGCAT SCHOTT\nFTYP 0 0 2 1 0 0 0\nXFLN 0 0\n\
                    YFLN 0 4\nWAVM 1 0.5875618 1\nWAVM 2 0.92 1\nPWAV 1\nSURF 0\n  DISZ INFINITY\n\
                    SURF 1\n  STOP\n  CURV 0.025\n  DISZ 4\n  GLAS N-BK7 0 0 0 0 0 0 0 0 0 0\n\
                    SURF 2\n  DISZ 75\nSURF 3\n  DISZ 0\n"
        .to_owned();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    text
}

fn system(changes: &[(&str, &str)]) -> System {
    System::new(lens(changes).unwrap(), Conditions::default()).unwrap()
}

#[test]
fn flags_that_change_the_system_are_refused() {
    for (from, to, word) in [
        ("FTYP 0 0 2 1 0 0 0", "FTYP 0 1 2 1 0 0 0", "telecentric"),
        ("FTYP 0 0 2 1 0 0 0", "FTYP 0 0 2 1 0 0 1", "afocal"),
        ("FTYP 0 0", "FTYP 5 0", "fields of kind 5"),
        ("ENPD 6", "OBNA 0.1 1", "cone angle"),
        ("ENPD 6", "FNUM 5 2", "FNUM 5 2"),
    ] {
        let error = lens(&[(from, to)]).unwrap_err().to_string();
        assert!(error.contains(word), "{to}: {error}");
    }
}

#[test]
fn fields_of_every_kind() {
    let angles = |kind: &str| {
        let kind = format!("FTYP {kind} 0");
        system(&[("FTYP 0 0", &kind), ("XFLN 0 0", "XFLN 0 3")]).fields_deg().unwrap()[1]
    };
    // acos(cos 3° cos 4°), and the direction with tangents tan 3°, tan 4°.
    assert!((angles("4") - 4.998_537).abs() < 1e-6);
    assert!((angles("0") - 4.994_169).abs() < 1e-6, "{}", angles("0"));
}

/// The image curves back so much that the search from the paraxial field loses its ray.
#[test]
fn a_real_image_height_near_the_largest() {
    let system = system(&[
        ("ENPD 6", "FNUM 9 0"),
        ("FTYP 0 0", "FTYP 3 0"),
        ("YFLN 0 4", "YFLN 0 12.8"),
        (
            "  CURV 0.025\n  DISZ 4\n  GLAS N-BK7 0 0 0 0 0 0 0 0 0 0\nSURF 2\n  DISZ 75\nSURF 3",
            "  DISZ 12\nSURF 2\n  DISZ 6\n  GLAS N-BK7\nSURF 3\n  CURV -0.08\n  DISZ 22\nSURF 4",
        ),
    ]);
    let fields = system.fields_deg().unwrap();
    let points = characterise::field_points(&system, &fields, &[587.5618]).unwrap();
    assert!((points[1].chief_ray_height_mm - 12.8).abs() < 1e-9, "{}", points[1].field_deg);
}

#[test]
fn glasses_with_offsets_and_partial_dispersions() {
    let plain = "GLAS N-BK7 0 0 0 0 0 0 0 0 0 0";
    let moved = system(&[(plain, "GLAS N-BK7 4 0 1.5168 64.17 0 0 0 0 0.01 -0.5")]);
    assert!((moved.paraxial.efl_mm - 40.0 / 0.5268).abs() < 1e-3);
    assert!(moved.prescription.notes[0].contains("offsets"));
    let model = |dpgf| {
        system(&[
            (plain, &format!("GLAS ___BLANK 1 0 1.713 53.83 {dpgf} 0 0 0 0 0")[..]),
            ("0.5875618", "0.4358343"),
        ])
    };
    let (without, with) = (model("0").paraxial.efl_mm, model("-0.0083").paraxial.efl_mm);
    // N-LAK8 by Schott's coefficients: 54.8368.
    assert!((with - 54.8368).abs() < 2e-3 && with - without > 5e-3, "{with} {without}");
}

#[test]
fn the_configuration_that_is_taken_is_said() {
    let lens = lens(&[("PWAV 1", "PWAV 1\nMNUM 3 2")]).unwrap();
    assert!(lens.notes[0].contains("configuration 2 of 3"), "{:?}", lens.notes);
    for one in ["PWAV 1\nMNUM 1 1", "PWAV 1\nMNUM 1"] {
        assert!(self::lens(&[("PWAV 1", one)]).unwrap().notes.is_empty());
    }
}

/// Thickness 75 of the last space and the curvature of the lens per configuration.
const SET: &str = "PWAV 1\nMNUM 2 1\n\
    LTTL 0 1 0 0 0 0 1 1 1 0 0 \"far\" 0\nLTTL 0 2 0 0 0 0 1 1 1 0 0 \"near by\" 0\n\
    THIC 2 1 75 0 0 0 1 1 1 0 0 \"\" 0\nTHIC 2 2 80 0 0 0 1 1 1 0 0 \"\" 0\n\
    CRVT 1 1 0.025 0 0 0 1 1 1 0 0 \"\" 0\nCRVT 1 2 0.02 0 0 0 1 1 1 0 0 \"\" 0\n";

#[test]
fn a_configuration_is_chosen_by_number_or_title() {
    let text = |more: &str| lens_text(&[("PWAV 1", &format!("{SET}{more}")[..])]);
    let read = |more: &str, name| read_configuration(&text(more), &Catalogue::default(), name);
    let active = read("", None).unwrap();
    assert_eq!(active, read("", Some("far")).unwrap());
    for name in ["2", "Near By"] {
        let lens = read("", Some(name)).unwrap();
        let (last, first) = (&lens.surfaces[1], &lens.surfaces[0]);
        assert_eq!((last.thickness, first.curvature), (80.0, 0.02));
        let note = &lens.notes[0];
        assert!(note.contains("configuration 2 of 2") && note.contains("THIC 2 = 80"), "{note}");
        assert!(!note.contains("LTTL"), "{note}");
    }
    for (more, name, words) in [
        ("", "3", "1 \"far\", 2 \"near by\""),
        ("APER 0 1 6 0 0 0\nAPER 0 2 3 0 0 0\n", "2", "APER 0"),
        ("GLSS 1 2 0 0 0 0 1 1 1 0 0 \"N-SF11\" 0\n", "2", "GLSS 1"),
    ] {
        let error = read(more, Some(name)).unwrap_err().to_string();
        assert!(error.contains(words), "{more}: {error}");
    }
    // The same value in both is no difference; one that says nothing about the second is.
    assert!(read("APER 0 1 6 0 0 0\nAPER 0 2 6 0 0 0\n", Some("2")).is_ok());
    let bare = lens_text(&[("PWAV 1", "PWAV 1\nMNUM 2 1")]);
    let error = read_configuration(&bare, &Catalogue::default(), Some("2")).unwrap_err();
    assert!(error.to_string().contains("no values for it"), "{error}");
}

#[test]
fn a_solve_keeps_another_configuration_from_being_set() {
    let solved = |line: &str| {
        let text = lens_text(&[("PWAV 1", SET), ("  DISZ 75", &format!("  DISZ 75\n{line}")[..])]);
        [None, Some("2")].map(|name| read_configuration(&text, &Catalogue::default(), name))
    };
    let [active, other] = solved("  MAZH 0 0");
    assert!(active.is_ok());
    let error = other.unwrap_err().to_string();
    assert!(error.contains("MAZH") && error.contains("line 28"), "{error}");
    assert!(solved("  COMM rear")[1].is_ok());
    assert!(solved("  CURV 0 4 0 0 0")[1].is_err());
}

/// B270 is tabulated from 436 to 656 nm.
#[test]
fn wavelengths_without_data_are_left_out_and_said() {
    let system =
        system(&[("N-BK7", "B270"), ("PWAV 1", "PWAV 2"), ("FTYP 0 0 2 1", "FTYP 0 0 2 2")]);
    let lens = &system.prescription;
    assert_eq!((&lens.wavelengths_nm[..], lens.reference_nm), (&[587.5618][..], 587.5618));
    assert!(lens.notes[0].contains("920 nm is left out"), "{:?}", lens.notes);
    assert!(lens.notes[1].contains("reference wavelength is 587.5618"), "{:?}", lens.notes);
    let only = self::lens(&[("N-BK7", "B270"), ("0.5875618", "0.92")]).unwrap();
    let error = System::new(only, Conditions::default()).unwrap_err().to_string();
    assert!(error.contains("920 nm is outside"), "{error}");
}
