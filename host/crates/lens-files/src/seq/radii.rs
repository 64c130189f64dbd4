//! Radii or curvatures, where a file does not say (`RDM`): CODE V takes curvatures, and files made
//! elsewhere often mean radii.

use super::File;
use camrig_base::Result;
use camrig_lens::System;
use camrig_prescription::Conditions;
use camrig_prescription::{Aperture, Prescription};

/// A lens counts as focused where its paraxial image lies within this part of the last distance
/// from the image plane.
const IN_FOCUS: f64 = 0.2;
/// Lengths of a lens over its smallest radius that are likely; camera lenses have 1 to 20.
const LIKELY_LENGTH: f64 = 100.0;

/// Whether surfaces are given by radius, and what to say about it; `read` makes the prescription
/// with radii (true) or curvatures.
pub(super) fn decide(
    file: &File,
    read: impl Fn(bool) -> Result<Prescription>,
) -> (bool, &'static str) {
    if beam_misses(file) {
        return (
            true,
            "RDM is not given: taken as radii, since as curvatures the beam would miss",
        );
    }
    match (focuses(read(true)), focuses(read(false))) {
        (true, false) => {
            return (
                true,
                "RDM is not given: taken as radii, since as curvatures nothing is in focus",
            );
        }
        (false, false) if unlikely_curvatures(file) => {
            return (
                true,
                "RDM is not given: taken as radii, since as curvatures the surfaces are far \
                 smaller than the lens is long",
            );
        }
        _ => {}
    }
    (false, "RDM is not given: surfaces are taken by curvature, as CODE V does")
}

/// Whether spheres of these curvatures are smaller than the beam.
fn beam_misses(file: &File) -> bool {
    let Some(Aperture::EntrancePupil(beam)) = file.aperture else { return false };
    file.surfaces.iter().any(|s| s.bend.abs() * beam > 2.0)
}

fn focuses(prescription: Result<Prescription>) -> bool {
    let system = prescription.and_then(|p| System::new(p, Conditions::default()));
    system.is_ok_and(|system| {
        let last = system.prescription.surfaces.last().map_or(0.0, |s| s.thickness);
        (system.paraxial.image_distance_mm - last).abs() < IN_FOCUS * last.abs()
    })
}

/// Whether the lens is much longer than its radii as curvatures, and not as radii.
fn unlikely_curvatures(file: &File) -> bool {
    let length: f64 = file.surfaces.iter().map(|s| s.thickness.abs()).sum();
    let bends = || file.surfaces.iter().map(|s| s.bend.abs()).filter(|b| *b > 0.0);
    let (least, most) = (bends().fold(f64::INFINITY, f64::min), bends().fold(0.0, f64::max));
    length * most > LIKELY_LENGTH && length / least < LIKELY_LENGTH
}
