//! A lens at one wavelength, ready to trace.

use super::paraxial::Paraxial;
use super::prescription::{Clip, Object, Shape};
use super::trace::{Rays, Start, TrainSurface};
use std::borrow::Cow;

/// The ellipse that vignetting factors leave of the pupil at a field of a rotationally symmetric
/// lens, in radii of the pupil. The chief ray comes from below the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldPupil {
    /// Field angle, degrees.
    pub field_deg: f64,
    /// Its half widths across the plane of the axis and the field (x), and in it (y).
    pub half: [f64; 2],
    /// Its centre in that plane.
    pub centre: f64,
}

/// The lens at one wavelength.
#[derive(Clone, Debug)]
pub struct Train {
    /// The wavelength, nm.
    pub nm: f64,
    /// Its surfaces.
    pub surfaces: Vec<TrainSurface>,
    /// Index of the stop.
    pub stop: usize,
    /// Radius of the stop, mm.
    pub stop_radius_mm: f64,
    /// Paraxial figures at this wavelength.
    pub paraxial: Paraxial,
    /// The object.
    pub object: Object,
    /// Paraxial entrance pupil at the *reference* wavelength: where beams are aimed from.
    pub entrance_z_mm: f64,
    /// Diameter of that pupil, mm.
    pub entrance_pupil_mm: f64,
    /// Whether the pupil is at infinity; what replaces it: [`Paraxial::telecentric`].
    pub telecentric: bool,
    /// What vignetting factors leave of the pupil at fields, which rise; empty where there are
    /// none.
    pub vignetted: Vec<FieldPupil>,
    /// Radius of the cone from the object in the plane that rays are aimed at, mm, where it stands
    /// for the stop ([`super::Prescription::telecentric`]).
    pub cone_mm: Option<f64>,
    /// Why the lens is not rotationally symmetric, if it is not.
    pub asymmetry: Option<String>,
}

impl Train {
    /// The surfaces as the light of a field meets them: the stop is an ellipse where vignetting
    /// factors say so, linear in the field between those of the file.
    pub(super) fn surfaces_for(&self, field_deg: f64) -> Cow<'_, [TrainSurface]> {
        let (Some(first), Some(last)) = (self.vignetted.first(), self.vignetted.last()) else {
            return Cow::Borrowed(&self.surfaces);
        };
        let field = field_deg.abs();
        let pair = self.vignetted.windows(2).find(|pair| pair[1].field_deg > field);
        let (low, high) = pair.map_or((last, last), |pair| (&pair[0], &pair[1]));
        let (low, high) = if field < first.field_deg { (first, first) } else { (low, high) };
        let width = high.field_deg - low.field_deg;
        let part = if width > 0.0 { (field - low.field_deg) / width } else { 0.0 };
        let between = |a: f64, b: f64| self.stop_radius_mm * (a + part * (b - a));
        let half = [0, 1].map(|k| between(low.half[k], high.half[k]));
        // The stop may be an upside-down image of the pupil.
        let upwards = field_deg.signum() * self.paraxial.entrance_magnification.signum();
        let centre = [0.0, upwards * between(low.centre, high.centre)];
        let mut surfaces = self.surfaces.clone();
        if let Some(stop) = surfaces[self.stop].prescribed.clips.last_mut() {
            *stop = Clip::opening(Shape::Ellipse, half).placed(1.0, centre);
        }
        Cow::Owned(surfaces)
    }

    /// The ray, where it meets the stop.
    pub(super) fn at_stop(&self, start: &Start) -> Rays<1> {
        let mut ray = Rays::nowhere();
        ray.launch(0, start);
        for surface in &self.surfaces[..self.stop] {
            surface.meet(&mut ray);
            surface.bend(&mut ray);
        }
        self.surfaces[self.stop].meet(&mut ray);
        ray
    }
}
