//! Where the object is for each ideal lens of a train.

use super::prescription::{Form, Object};
use super::trace::TrainSurface;
use camrig_base::{Error, Result};

/// Sets the vergences of all ideal lenses in a train for an object there.
///
/// # Errors
/// An ideal lens in an image of the object: its path is not defined there.
pub(super) fn set_vergences(surfaces: &mut [TrainSurface], object: Object) -> Result<()> {
    let (mut height, mut slope) = match object {
        Object::Infinity => (1.0, 0.0),
        Object::Distance(d) => (d, surfaces.first().map_or(1.0, |s| s.before)),
    };
    let mut sign = 1.0;
    for (i, surface) in surfaces.iter_mut().enumerate() {
        if let Form::Ideal { focal_mm } = surface.prescribed.form {
            surface.vergence = slope / height;
            let vergence = surface.vergence;
            if !(vergence.is_finite() && (vergence * focal_mm).abs() < IN_IMAGE) {
                return Err(Error::unsupported("a paraxial surface lies in an image")
                    .at(format!("surface {}", i + 1))
                    .help("the optical path through it is not defined there; leave it out"));
            }
        }
        let before = sign * surface.before;
        if surface.is_mirror() {
            sign = -sign;
        }
        let after = sign * surface.after;
        slope -= height * surface.power(before, after)[1];
        height += slope * surface.prescribed.thickness / after;
    }
    Ok(())
}

/// Focal lengths over the object's distance from which on a lens counts as lying in an image.
const IN_IMAGE: f64 = 1e9;
