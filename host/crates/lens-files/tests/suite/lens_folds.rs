//! Lenses that plane mirrors fold: traced straight, where nothing else turns them.

use camrig_lens::{Catalogue, Conditions, Prescription, System, characterise};
use camrig_lens_files::zmx;

const HEAD: &str = "MODE SEQ\nUNIT MM\nENPD 10\nFTYP 0\nXFLN 0\nYFLN 5\nWAVM 1 0.5876 1\n\
    PWAV 1\nSURF 0\n  DISZ INFINITY\n";

fn lens(surfaces: &[&str]) -> Prescription {
    let body: String =
        surfaces.iter().enumerate().map(|(i, s)| format!("SURF {}\n{s}", i + 1)).collect();
    zmx::read(&format!("{HEAD}{body}"), &Catalogue::default()).unwrap()
}

/// The prescription that is traced.
fn traced(lens: Prescription) -> Prescription {
    System::new(lens, Conditions::default()).unwrap().prescription
}

const FRONT: &str = "  STOP\n  CURV 0.02\n  DISZ 4\n  GLAS N-BK7 0 0\n";
const TILT: &str = "  TYPE COORDBRK\n  PARM 3 45\n  DISZ 0\n";

/// A singlet and a field lens: straight, and with a mirror at 45° between them.
#[test]
fn a_folded_lens_is_the_straight_one() {
    let straight = lens(&[
        FRONT,
        "  CURV -0.02\n  DISZ 40\n",
        "  CURV 0.01\n  DISZ 2\n  GLAS N-SF11 0 0\n",
        "  CURV 0\n  DISZ 5\n",
        "  DISZ 0\n",
    ]);
    let folded = lens(&[
        FRONT,
        "  CURV -0.02\n  DISZ 25\n",
        TILT,
        "  DISZ 0\n  GLAS MIRROR\n",
        "  TYPE COORDBRK\n  PARM 3 45\n  DISZ -15\n",
        "  CURV -0.01\n  DISZ -2\n  GLAS N-SF11 0 0\n",
        "  CURV 0\n  DISZ -5\n",
        "  DISZ 0\n",
    ]);
    assert!(folded.asymmetry().is_some());
    let lens = traced(folded);
    assert_eq!(lens.asymmetry(), None);
    let thickness: Vec<f64> = lens.surfaces.iter().map(|s| s.thickness).collect();
    for (a, b) in thickness.iter().zip([4.0, 40.0, 0.0, 0.0, 0.0, 2.0, 5.0]) {
        assert!((a - b).abs() < 1e-9, "{thickness:?}");
    }
    assert!(lens.notes.iter().any(|note| note.contains("folded 1 times")));
    let point = |lens: Prescription| {
        let system = System::new(lens, Conditions::default()).unwrap();
        characterise::field_points(&system, &[5.0], &[587.6]).unwrap()[0]
    };
    let (a, b) = (point(lens), point(straight));
    assert!((a.chief_ray_height_mm - b.chief_ray_height_mm).abs() < 1e-9);
    assert!((a.spot_rms_mm - b.spot_rms_mm).abs() < 1e-9);
    assert!((a.relative_illumination - b.relative_illumination).abs() < 1e-9);
}

/// A mirror that is curved, a fold that misses the next vertex, and a clipped fold stay.
#[test]
fn more_than_plane_folds_is_left_as_it_is() {
    let back = "  TYPE COORDBRK\n  PARM 3 45\n  DISZ -15\n";
    for (mirror, back) in [
        ("  CURV 0.001\n  DISZ 0\n  GLAS MIRROR\n", back),
        ("  DISZ 0\n  GLAS MIRROR\n  CLAP 0 9 0\n", back),
        ("  DISZ 0\n  GLAS MIRROR\n", "  TYPE COORDBRK\n  PARM 3 44\n  DISZ -15\n"),
        ("  DISZ 0\n  GLAS MIRROR\n", "  TYPE COORDBRK\n  PARM 2 0.1\n  PARM 3 45\n  DISZ -15\n"),
    ] {
        let rear = "  CURV -0.02\n  DISZ 25\n";
        let lens = lens(&[FRONT, rear, TILT, mirror, back, "  DISZ 0\n"]);
        assert_eq!(traced(lens.clone()).surfaces, lens.surfaces);
    }
}
