//! Figures over the image: functions of the height alone for a lens that is symmetric about its
//! axis, else of the place.

use super::RadialCurve;

/// A function of a place on the image, mm right of and below the optical axis.
pub type PlaneFunction<'a, T> = Box<dyn Fn(f64, f64) -> T + Send + Sync + 'a>;

/// A figure over the image.
pub enum OverField<'a, T> {
    /// Of a lens that is rotationally symmetric: a function of the distance from the axis, mm. A
    /// place is given as its own distance, in the same direction.
    Radial(RadialCurve<'a>),
    /// Of any other lens.
    Plane(PlaneFunction<'a, T>),
}

impl OverField<'_, f64> {
    /// The value at a place, mm right of and below the optical axis.
    #[must_use]
    pub fn at(&self, x_mm: f64, y_mm: f64) -> f64 {
        match self {
            Self::Radial(curve) => curve(libm::hypot(x_mm, y_mm)),
            Self::Plane(function) => function(x_mm, y_mm),
        }
    }
}

impl OverField<'_, (f64, f64)> {
    /// The place that belongs to a place, both mm right of and below the optical axis.
    #[must_use]
    pub fn at(&self, x_mm: f64, y_mm: f64) -> (f64, f64) {
        match self {
            Self::Radial(curve) => scaled(x_mm, y_mm, curve),
            Self::Plane(function) => function(x_mm, y_mm),
        }
    }
}

/// The place in the same direction whose distance is `curve` of this one's.
pub fn scaled(x_mm: f64, y_mm: f64, curve: impl Fn(f64) -> f64) -> (f64, f64) {
    let height = libm::hypot(x_mm, y_mm);
    if height == 0.0 {
        return (0.0, 0.0);
    }
    let ratio = curve(height) / height;
    (x_mm * ratio, y_mm * ratio)
}
