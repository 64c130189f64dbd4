//! What the flags of a `.zmx` file say, and what of it is refused.

use super::*;
use crate::{Conditions, System, characterise};

/// A plano-convex lens, curvature 0.025, of N-BK7 (n_d 1.51680), with words replaced.
fn lens(changes: &[(&str, &str)]) -> Result<Prescription> {
    let mut text = "MODE SEQ\nUNIT MM\nENPD 6\nGCAT SCHOTT\nFTYP 0 0 2 1 0 0 0\nXFLN 0 0\n\
                    YFLN 0 4\nWAVM 1 0.5875618 1\nWAVM 2 0.92 1\nPWAV 1\nSURF 0\n  DISZ INFINITY\n\
                    SURF 1\n  STOP\n  CURV 0.025\n  DISZ 4\n  GLAS N-BK7 0 0 0 0 0 0 0 0 0 0\n\
                    SURF 2\n  DISZ 75\nSURF 3\n  DISZ 0\n"
        .to_owned();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    read(&text, &Catalogue::default())
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
