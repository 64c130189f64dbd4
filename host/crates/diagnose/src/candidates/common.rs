//! What several estimators share: the present value of a parameter, a standard deviation from an
//! excess of variance, a count of outliers and its prediction, and the growth of dark current
//! with temperature.

use super::proposal::{Proposal, deviation};
use crate::data::design::Condition;
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

/// Power of the analogue gain to which an offset is proportional: of the pixels' and of the
/// converter's, as a black clamp gives it.
const BEFORE_GAIN: f64 = 0.0;
const BEHIND_GAIN: f64 = -1.0;

/// Where an offset is added, by the gain that it has in e⁻.
#[derive(Clone, Copy)]
pub(super) struct Added {
    kind: &'static str,
    exponent: f64,
}

impl Added {
    /// The proposals of a kind: before the gain and, where the stacks have several gains, behind
    /// it.
    pub(super) fn each(
        kind: &'static str,
        e: &Evidence<'_>,
        of: impl Fn(Self) -> Option<Proposal>,
    ) -> Vec<Proposal> {
        let mut gains = e.design.conditions.iter().map(|c| c.stack.analog_gain);
        let first = gains.next();
        let several = gains.any(|gain| Some(gain) != first);
        let exponents = if several { &[BEFORE_GAIN, BEHIND_GAIN][..] } else { &[BEFORE_GAIN] };
        exponents.iter().filter_map(|&exponent| of(Self { kind, exponent })).collect()
    }

    /// DN of an electron of the effect in a stack.
    pub(super) fn unit(self, e: &Evidence<'_>, c: &Condition) -> f64 {
        e.gain(c) * libm::pow(c.stack.analog_gain, self.exponent)
    }

    /// The standard deviation that the model has of it, e⁻.
    pub(super) fn present(self, e: &Evidence<'_>) -> f64 {
        let of = |key| present(e.camera, self.kind, key);
        let own = of("gain_exponent").unwrap_or(BEFORE_GAIN) == self.exponent;
        of("sigma_e").filter(|_| own).unwrap_or(0.0)
    }

    /// σ² from a variance that is the same in every stack, in the squares of the effect's
    /// electrons: what the stacks have more than the model, and what the model has by whichever
    /// law. `what` is a ratio to the variance of the mean of `across` pixels.
    pub(super) fn variance(self, e: &Evidence<'_>, what: What, across: f64) -> Option<Value> {
        let stacks = e.design.conditions.iter().enumerate();
        Value::combine(stacks.filter_map(|(i, c)| {
            let more = e.component(i, what, across)?;
            let all = more.value + present_dn(e, self.kind, c).powi(2);
            Some(Value::new(all, more.std_error).scaled(self.unit(e, c).powi(2).recip()))
        }))
    }

    /// Distance of such a variance from what the model has by this law, standard errors.
    pub(super) fn strength(self, e: &Evidence<'_>, variance: Value) -> f64 {
        let more = variance.value - self.present(e).powi(2);
        (more / variance.std_error).abs()
    }

    /// Its proposal.
    pub(super) fn proposal(
        self,
        strength: f64,
        mut law: Vec<(&'static str, Value)>,
    ) -> Option<Proposal> {
        if self.exponent != BEFORE_GAIN {
            law.push(("gain_exponent", Value::chosen(self.exponent)));
        }
        Proposal::of(self.kind, strength, law)
    }
}

/// The standard deviation that the model has of an offset in a stack, DN.
pub(super) fn present_dn(e: &Evidence<'_>, kind: &'static str, c: &Condition) -> f64 {
    let of = |key| present(e.camera, kind, key);
    let exponent = of("gain_exponent").unwrap_or(BEFORE_GAIN);
    Added { kind, exponent }.unit(e, c) * of("sigma_e").unwrap_or(0.0)
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
