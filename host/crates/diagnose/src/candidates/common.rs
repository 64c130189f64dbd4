//! What several estimators share: the present value of a parameter, a standard deviation from an
//! excess of variance, a count of outliers and its prediction, and the growth of dark current
//! with temperature.

use super::proposal::{Proposal, deviation};
use crate::evidence::Evidence;
use crate::model::effects::current;
use crate::numerics::tails;
use crate::statistics::statistic::{Place, What};
use camrig_base::Value;
use camrig_camera::{Camera, Noise};

/// Range of a likelihood search over a standard deviation: ln σ either side of the estimate by
/// moments, a factor of 4.5. Wide enough for a moment estimate that a few outlying frames pulled,
/// narrow enough for the grid of [`lowest`](crate::numerics::minimise::lowest) to find the
/// minimum.
pub(super) const LN_SIGMA_REACH: f64 = 1.5;

/// Replicates whose mean is a model's prediction.
const REPLICATES: f64 = 16.0;

/// The value that the model has of a parameter, in the parameter's unit; of several effects of the
/// kind that of the first. `None` where it has no such effect.
pub(super) fn present(camera: &Camera, kind: &str, key: &str) -> Option<f64> {
    let effect = current(camera, kind)?;
    let at = effect.entry().parameters.iter().position(|p| p.key == key)?;
    effect.values().get(at).copied().map(f64::from)
}

/// A proposal of the standard deviation σ = √(σ₀² + `excess`), with σ₀ (`present`) what the model
/// has and `excess` in its unit squared; as strong as the excess is significant.
pub(super) fn of_excess(
    kind: &'static str,
    key: &'static str,
    present: f64,
    excess: Value,
) -> Option<Proposal> {
    Proposal::of(kind, excess.z().abs(), [(key, deviation(present, excess)?)])
}

/// A count of outliers, and the model's prediction of it.
pub(super) struct Count {
    /// Measured.
    pub(super) seen: f64,
    /// Mean over the model's replicates.
    pub(super) expected: f64,
    /// Normal deviate of the measured count.
    pub(super) z: f64,
}

impl Count {
    pub(super) fn new(seen: f64, expected: f64) -> Self {
        Self { seen, expected, z: tails::count(seen, expected * REPLICATES, REPLICATES) }
    }

    /// Of a statistic that is a count. `None` where it was not taken.
    pub(super) fn of(e: &Evidence<'_>, place: Place, what: What) -> Option<Self> {
        Some(Self::new(e.measured(place, what)?, e.predicted(place, what)?))
    }
}

/// Dark current at a temperature over that at the reference temperature, 2^((T − T_ref)/T_d).
pub(super) fn dark_growth(noise: &Noise, temperature_c: f64) -> f64 {
    libm::exp2((temperature_c - noise.temperature_ref_c) / noise.dark_doubling_c)
}

/// Number of the sensor's channels, as statistics are numbered by them.
pub(super) fn channel_count(e: &Evidence<'_>) -> u8 {
    e.camera.sensor.channel_names.len() as u8
}
