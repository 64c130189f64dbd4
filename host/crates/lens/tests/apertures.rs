//! Apertures and obscurations that are not circular, against their solid angle in closed form.

use camrig_lens::prescription::{Clip, Shape};
use camrig_lens::{Catalogue, Conditions, Prescription, System, field, seq, zmx};
use std::f64::consts::{PI, TAU};

/// Half of the beam's width, mm.
const HALF_MM: f64 = 2.5;

/// A lens without spherical aberration, f = 10 mm, behind a plane with these apertures.
fn lens(apertures: &str) -> Prescription {
    let text = format!(
        "UNIT MM\nENPD {}\nFTYP 0 0 1 1\nXFLN 0\nYFLN 0\nWAVM 1 0.55 1\nPWAV 1\nSURF 0\n  \
         DISZ INFINITY\nSURF 1\n  DISZ 1\n{apertures}SURF 2\n  STOP\n  DISZ 3\n  \
         GLAS ___BLANK 1 0 1.5 0 0 0\nSURF 3\n  CURV -0.2\n  CONI -2.25\n  DISZ 10\nSURF 4\n  \
         DISZ 0\n",
        2.0 * HALF_MM
    );
    zmx::read(&text, &Catalogue::default()).unwrap()
}

fn solid_angle(lens: Prescription) -> camrig_base::Result<f64> {
    let system = System::new(lens, Conditions::default())?;
    let map = field::Map::of(&system)?;
    Ok(field::points(&system, &map, &[[0.0; 2]], &[550.0])?[0].projected_solid_angle_sr)
}

/// ∮ ½ sin² θ dφ over the outline `radius(φ)` of what light passes: the hyperboloid sends a ray of
/// height h to the focus, 10 mm behind its vertex.
fn of_outline(radius: impl Fn(f64) -> f64) -> f64 {
    const STEPS: usize = 100_000;
    let sine_squared = |h: f64| {
        let sag = -0.2 * h * h / (1.0 + (1.0 + 1.25 * 0.04 * h * h).sqrt());
        let slope = h / (10.0 - sag);
        slope * slope / (1.0 + slope * slope)
    };
    let angle = |i: usize| TAU * (i as f64 + 0.5) / STEPS as f64;
    (0..STEPS).map(|i| sine_squared(radius(angle(i)))).sum::<f64>() * PI / STEPS as f64
}

/// Distance to the side of a rectangle about (x, y), half as wide as (a, b).
fn rectangle([a, b]: [f64; 2], [x, y]: [f64; 2]) -> impl Fn(f64) -> f64 {
    move |angle: f64| {
        let (sine, cosine) = angle.sin_cos();
        let to_side =
            |half: f64, centre: f64, way: f64| (half + centre * way.signum()) / way.abs();
        to_side(a, x, cosine).min(to_side(b, y, sine))
    }
}

fn ellipse([a, b]: [f64; 2]) -> impl Fn(f64) -> f64 {
    move |angle: f64| ((angle.cos() / a).powi(2) + (angle.sin() / b).powi(2)).sqrt().recip()
}

#[test]
fn rectangles_and_ellipses_pass_their_solid_angle() {
    let beam = of_outline(|_| HALF_MM);
    let cases = [
        ("  SQAP 1.6 0.9 0\n", of_outline(rectangle([1.6, 0.9], [0.0; 2]))),
        ("  SQAP 1.2 0.9 0\n  OBDC 0.3 -0.5\n", of_outline(rectangle([1.2, 0.9], [0.3, -0.5]))),
        ("  ELAP 0.7 2.1 0\n", of_outline(ellipse([0.7, 2.1]))),
        // Wider than the beam in y: the narrower of both decides.
        ("  SQAP 1.6 4 0\n", of_outline(|p| rectangle([1.6, 4.0], [0.0; 2])(p).min(HALF_MM))),
        ("  SQOB 1.5 0.5 0\n", beam - of_outline(rectangle([1.5, 0.5], [0.0; 2]))),
        ("  ELOB 0.5 1.5 0\n", beam - of_outline(ellipse([0.5, 1.5]))),
        (
            "  ELOB 0.5 0.7 0\n  SQAP 2 1.4 0\n",
            of_outline(|p| rectangle([2.0, 1.4], [0.0; 2])(p).min(HALF_MM))
                - of_outline(ellipse([0.5, 0.7])),
        ),
    ];
    for (apertures, expected) in cases {
        let lens = lens(apertures);
        assert!(lens.asymmetry().unwrap().contains("surface 1 has a"), "{apertures}");
        // 512 azimuths: 2.5e-5 of a circle, some 1e-4 where corners fall between them.
        let found = solid_angle(lens).unwrap();
        assert!((found / expected - 1.0).abs() < 3e-4, "{apertures}: {found}, not {expected}");
    }
}

/// What light passes behind an obstacle beside the middle cannot be told from an outline.
#[test]
fn an_obstacle_beside_the_middle_of_the_pupil_is_refused() {
    for obstacle in ["  OBSC 0 0.3 0\n  OBDC 1.5 0\n", "  SQOB 0.3 0.3 0\n  OBDC 0 1\n"] {
        let error = solid_angle(lens(obstacle)).unwrap_err().to_string();
        assert!(error.contains("does not cover the middle of the pupil"), "{error}");
    }
    assert!(solid_angle(lens("  OBSC 0 0.3 0\n  OBDC 0.2 0\n")).is_ok());
}

#[test]
fn code_v_and_zemax_files_say_the_same_apertures() {
    let told = |apertures: &str| {
        let text = format!(
            "RDM\nEPD 5\nWL 550\nYAN 0\nSO 0 1e13\nS 0 1\n{apertures}S 0 3 1.5:60\nSTO\nS -5 10\n\
             SI 0 0\nGO\n"
        );
        Ok::<_, camrig_base::Error>(
            seq::read(&text, &Catalogue::default())?.surfaces[0].clips.clone(),
        )
    };
    for (code_v, zemax) in [
        ("REX 1.2; REY 0.9\nADX 0.3; ADY -0.5\n", "  SQAP 1.2 0.9 0\n  OBDC 0.3 -0.5\n"),
        ("ELX CLR L'A' 0.7\nELY CLR L'A' 2.1\n", "  ELAP 0.7 2.1 0\n"),
        ("REX OBS L'B' 1.5\nREY OBS L'B' 0.5\n", "  SQOB 1.5 0.5 0\n"),
        ("ELX OBS 0.5\nELY OBS 1.5\n", "  ELOB 0.5 1.5 0\n"),
        ("REX EDG 3\nREY EDG 2\n", ""),
    ] {
        assert_eq!(told(code_v).unwrap(), lens(zemax).surfaces[0].clips, "{code_v}");
    }
    let clip = Clip::opening(Shape::Rectangle, [2.0, 1.0]);
    assert!(clip.excess(1.9, 0.9) < 0.0 && clip.excess(1.9, 1.1) > 0.0);
    for (wrong, words) in [
        ("REY 2\n", "REY without the width in x"),
        ("REX 2\n", "widths in x and y"),
        ("REX 2\nELY 2\n", "ELY without"),
        ("REX 2\nREY 0\n", "widths in x and y"),
        ("REX 2 3\nREY 1\n", "not understood"),
    ] {
        let error = told(wrong).unwrap_err().to_string();
        assert!(error.contains(words), "{wrong}: {error}");
    }
}
