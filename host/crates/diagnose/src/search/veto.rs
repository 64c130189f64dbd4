//! An effect that adds noise where none was measured is not the one that is missing, however much
//! it improves elsewhere.
//!
//! The deviance hardly shows this: on the scale on which a mean of few squares is nearly normal,
//! zero is only two to four standard deviations below any expectation for two to five frames. The
//! exact distribution of such a mean does.

use super::evaluation::Evaluation;
use crate::measured::Measured;
use crate::model::prediction::Predicted;
use crate::numerics::tails;
use crate::statistics::statistic::{Key, Place, Scale, Statistic, What};

/// Normal deviate below which too little was measured: one in thirty thousand by chance.
const CONTRADICTED: f64 = -4.0;
/// Normal deviate above which a statistic was as expected before.
const AS_EXPECTED: f64 = -2.0;
/// Fraction of what an effect adds that must have been measured.
const MIN_SHARE: f64 = 0.5;

/// Noise that random effects can only increase: that common to frames, rows or columns relative to
/// that of pixels, and the number of noisy pixels.
const ONLY_RISE: [What; 4] =
    [What::FrameVariance, What::RowVariance, What::ColumnVariance, What::NoisyPixels];

/// Whether noise contradicts what was added to a model: with it the model has far more than was
/// measured in some stack, or in several together, and did not before.
pub(super) fn contradicts(measured: &Measured, before: &Evaluation, after: &Evaluation) -> bool {
    ONLY_RISE.iter().any(|&what| {
        let stacks = (0..measured.fit.design.conditions.len()).map(Place::Stack);
        let short: Vec<Short> =
            stacks.filter_map(|place| Short::of(measured, before, after, (place, what))).collect();
        let all = short.iter().copied().reduce(Short::with);
        short.into_iter().chain(all).any(Short::contradicts)
    })
}

/// How far a statistic is below two models if it has less than half of what the second adds: sums
/// of normal deviates, and their number.
#[derive(Clone, Copy)]
struct Short {
    before: f64,
    after: f64,
    count: f64,
}

impl Short {
    /// Of a statistic in the halves that have such a stack; `None` where one shows what was added.
    fn of(measured: &Measured, before: &Evaluation, after: &Evaluation, key: Key) -> Option<Self> {
        let halves = [
            (&measured.fit, &before.fit, &after.fit),
            (&measured.holdout, &before.holdout, &after.holdout),
        ];
        let mut sum: Option<Self> = None;
        let keys = [Some(key), measured.held_out(key).filter(|_| measured.can_confirm)];
        for ((half, before, after), key) in halves.iter().zip(keys) {
            let Some(key) = key else { continue };
            let (s, b, a) = (half.values.get(&key)?, before.of.get(&key)?, after.of.get(&key)?);
            let added = a.value - b.value;
            if added <= 0.0 || s.value - b.value > MIN_SHARE * added {
                return None;
            }
            let own = Self { before: too_little(s, b), after: too_little(s, a), count: 1.0 };
            sum = Some(sum.map_or(own, |sum| sum.with(own)));
        }
        sum
    }

    fn with(self, other: Self) -> Self {
        Self {
            before: self.before + other.before,
            after: self.after + other.after,
            count: self.count + other.count,
        }
    }

    fn contradicts(self) -> bool {
        let root = self.count.sqrt();
        self.after < CONTRADICTED * root && self.before > AS_EXPECTED * root
    }
}

/// Normal deviate of a measurement: far below 0 where it is improbably small for a model.
fn too_little(measured: &Statistic, model: &Predicted) -> f64 {
    if model.scale == Scale::Count {
        return model.count(measured.value);
    }
    // A mean of squares over that of the replicates is Fisher's F.
    let dof = model.dof();
    let ratio = (measured.value / model.value).max(f64::MIN_POSITIVE);
    let chance = tails::fisher_upper(1.0 / ratio, model.runs() * dof, dof);
    -tails::normal_quantile(libm::log(chance.max(f64::MIN_POSITIVE)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::prediction::Prediction;
    use crate::statistics::statistic::by_key;
    use rand_distr::{ChiSquared, Distribution};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// Five frames, whose means a model scatters a thousand times as much as pixels do. P(χ²₄ < x)
    /// is x²/8 of a small x: of a fiftieth of its mean, 0.08, it is 8·10⁻⁴, a deviate of −3.16,
    /// and of a thousandth of it −4.6. The scatter of the replicates is known to 4 %.
    #[test]
    fn hardly_any_scatter_of_few_frames_is_far_below_much() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        let law = ChiSquared::new(4.0).unwrap();
        let of = |value| {
            let (place, what) = (Place::Stack(0), What::FrameVariance);
            Statistic { place, what, value, sd: 0.24, scale: Scale::CubeRoot }
        };
        let replicates: Vec<_> =
            (0..400).map(|_| by_key(vec![of(1000.0 * law.sample(&mut rng) / 4.0)])).collect();
        let model = Prediction::new(&replicates).of[&(Place::Stack(0), What::FrameVariance)];
        let z = |times: f64| too_little(&of(1000.0 * times), &model);
        assert!((z(0.02) + 3.16).abs() < 0.3, "{}", z(0.02));
        assert!(z(1e-3) < -4.0 && z(0.5) > -1.0, "{} {}", z(1e-3), z(0.5));
    }
}
