//! Collects the statistics of one place.

use super::statistic::{Place, Scale, Statistic, What};

/// The statistics of one place; those that are not finite are omitted.
pub(super) struct Collected {
    place: Place,
    pub(super) statistics: Vec<Statistic>,
}

impl Collected {
    pub(super) fn at(place: Place) -> Self {
        Self { place, statistics: Vec::new() }
    }

    /// Adds a statistic: its value in its own unit, its standard deviation on its scale.
    pub(super) fn add(&mut self, what: What, value: f64, sd: f64, scale: Scale) {
        if value.is_finite() && sd.is_finite() {
            self.statistics.push(Statistic { place: self.place, what, value, sd, scale });
        }
    }
}

/// Standard deviation of the cube root of a mean of squares with `dof` degrees of freedom; the cube
/// root is nearly normal (Wilson & Hilferty 1931).
pub(super) fn cube_root_sd(value: f64, dof: f64) -> f64 {
    libm::cbrt(value.max(0.0)) * (2.0 / (9.0 * dof)).sqrt()
}
