//! A lens at one wavelength, ready to trace.

use super::paraxial::Paraxial;
use super::prescription::Object;
use super::trace::{Rays, Start, TrainSurface};

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
    /// Radius of the cone from the object in the plane that rays are aimed at, mm, where it stands
    /// for the stop ([`super::Prescription::telecentric`]).
    pub cone_mm: Option<f64>,
    /// Why the lens is not rotationally symmetric, if it is not.
    pub asymmetry: Option<String>,
}

impl Train {
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
