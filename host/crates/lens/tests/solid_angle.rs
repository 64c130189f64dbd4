//! How bright a traced lens is: the solid angle of its real rays on the axis, over heights and over
//! the plane alike.

use camrig_lens::characterise::{Plan, PsfMethod, characterise};
use camrig_lens::field::{self, PlanePlan};
use camrig_lens::{Catalogue, Conditions, System, zmx};
use camrig_optics::Lens;
use std::f64::consts::PI;

/// Distance from the last vertex to the focus, half of the aperture, and half of what obscures it,
/// mm.
const FOCUS_MM: f64 = 10.0;
const HALF_MM: f64 = 2.5;
const OBSCURED_MM: f64 = 1.0;

/// A plane and a hyperboloid of eccentricity n = 1.5, R = −5 mm, f/2: rays parallel to the axis
/// meet in the focus.
fn lens(obscuration: &str) -> System {
    let text = format!(
        "UNIT MM\nENPD {}\nFTYP 0 0 1 1\nXFLN 0\nYFLN 0\nWAVM 1 0.55 1\nPWAV 1\nSURF 0\n  \
         DISZ INFINITY\nSURF 1\n  STOP\n{obscuration}  DISZ 3\n  GLAS ___BLANK 1 0 1.5 0 0 0\n\
         SURF 2\n  CURV -0.2\n  CONI -2.25\n  DISZ {FOCUS_MM}\nSURF 3\n  DISZ 0\n",
        2.0 * HALF_MM
    );
    System::new(zmx::read(&text, &Catalogue::default()).unwrap(), Conditions::default()).unwrap()
}

/// sin² of the angle at which the ray of this height meets the axis: the hyperboloid's sag s makes
/// tan θ = h/(focus − s).
fn sine_squared(height_mm: f64) -> f64 {
    let c = -0.2;
    let root = (1.0 + 1.25 * c * c * height_mm * height_mm).sqrt();
    let slope = height_mm / (FOCUS_MM - c * height_mm * height_mm / (1.0 + root));
    slope * slope / (1.0 + slope * slope)
}

fn steradians(system: &System) -> [f64; 2] {
    let (wavelengths_nm, psf_spacing_um) = (vec![550.0], Some(1.0));
    let (psf_size, method) = (16, PsfMethod::Geometric);
    let plan = Plan {
        heights: 2,
        density: None,
        max_field_deg: 1.0,
        wavelengths_nm: wavelengths_nm.clone(),
        psf_size,
        psf_spacing_um,
        method,
    };
    let frame_mm = [0.2, 0.2];
    let over_plane =
        PlanePlan { frame_mm, density: None, wavelengths_nm, psf_size, psf_spacing_um, method };
    let heights = characterise(system, &plan, &|_, _| ()).unwrap();
    let plane = field::characterise(system, &over_plane, &|_, _| ()).unwrap();
    [heights.steradians(550.0), plane.steradians(550.0)]
}

#[test]
fn a_traced_lens_has_the_solid_angle_of_its_real_cone() {
    let real = PI * sine_squared(HALF_MM);
    let paraxial = PI / (1.0 + 4.0 * 4.0);
    assert!(real / paraxial < 0.95, "{real} {paraxial}");
    // The outline is a polygon of 255 sides over half a circle: 2.5e-5 too small.
    for found in steradians(&lens("")) {
        assert!((found / real - 1.0).abs() < 1e-4, "{found} instead of {real}");
    }
    let obscured = real - PI * sine_squared(OBSCURED_MM);
    for found in steradians(&lens(&format!("  OBSC 0 {OBSCURED_MM} 0\n"))) {
        assert!((found / obscured - 1.0).abs() < 1e-4, "{found} instead of {obscured}");
    }
}
