//! An effect that adds noise, and adds it where there is none, is not the one that is missing:
//! what it closes elsewhere does not outweigh that.
//!
//! A deviance hardly shows it. Few frames have few squares, whose mean is far below its expectation
//! by chance now and then: on the scale on which it is nearly normal, nothing at all measured where
//! an effect puts a thousand times the noise is three standard deviations. The exact law of so
//! small a mean tells.

use super::session::{Session, State};
use crate::model::prediction::Predicted;
use crate::numerics::tails;
use crate::statistics::statistic::{Key, Place, Scale, Statistic, What};

/// Normal deviate, both halves together, below which too little was measured: chance gives one in
/// thirty thousand.
const CONTRADICTED: f64 = -4.0;
/// The same, above which a statistic was as expected before.
const AS_EXPECTED: f64 = -2.0;
/// Share of what an effect adds that must be there.
const LEAST_SHARE: f64 = 0.5;

/// Whether a statistic of noise contradicts what was added to a model: by it the model has far more
/// noise there than was measured, and had not before.
pub(super) fn contradicts(session: &Session, before: &State, after: &State) -> bool {
    after.fit.of.keys().any(|key| only_rises(*key) && contradicted(session, before, after, *key))
}

/// Whether random effects only raise a statistic: noise that frames, rows or columns share beside
/// that of pixels, and how many pixels are noisier than others.
fn only_rises((place, what): Key) -> bool {
    use What::{ColumnVariance, FrameVariance, NoisyPixels, RowVariance};
    matches!(place, Place::Stack(_))
        && matches!(what, FrameVariance | RowVariance | ColumnVariance | NoisyPixels)
}

fn contradicted(session: &Session, before: &State, after: &State, key: Key) -> bool {
    let halves = [
        (&session.fit, &before.fit, &after.fit),
        (&session.holdout, &before.holdout, &after.holdout),
    ];
    let (mut was, mut is, mut n) = (0.0, 0.0, 0.0);
    for (half, before, after) in &halves[..1 + usize::from(session.can_confirm)] {
        let (Some(s), Some(b), Some(a)) =
            (half.values.get(&key), before.of.get(&key), after.of.get(&key))
        else {
            return false;
        };
        let added = a.value - b.value;
        if added <= 0.0 || s.value - b.value > LEAST_SHARE * added {
            return false;
        }
        was += too_little(s, b);
        is += too_little(s, a);
        n += 1.0;
    }
    let root = f64::sqrt(n);
    is < CONTRADICTED * root && was > AS_EXPECTED * root
}

/// Normal deviate of a measurement: far below 0 where a model hardly ever has so little.
fn too_little(measured: &Statistic, model: &Predicted) -> f64 {
    // Relative standard deviation of the statistic itself.
    let relative = match model.scale {
        Scale::Count => return model.count(measured.value),
        Scale::CubeRoot => 3.0 * model.sd / model.scaled,
        Scale::Log => model.sd,
        Scale::Linear => model.sd / model.value,
    };
    // A mean of squares over that of the replicates is Fisher's F.
    let dof = 2.0 / (relative * relative);
    let ratio = (measured.value / model.value).max(f64::MIN_POSITIVE);
    let chance = tails::fisher_upper(1.0 / ratio, model.runs() * dof, dof);
    -tails::deviate(chance.max(f64::MIN_POSITIVE).ln())
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
    /// and of a thousandth of it −5.
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
        let model = &Prediction::new(&replicates).of[&(Place::Stack(0), What::FrameVariance)];
        let z = |times: f64| too_little(&of(1000.0 * times), model);
        assert!((z(0.02) + 3.16).abs() < 0.3, "{}", z(0.02));
        assert!(z(1e-3) < -4.0 && z(0.5) > -1.0, "{} {}", z(1e-3), z(0.5));
        // What is nearly normal of it says much less.
        assert!((model.scale.of(1.0) - model.scaled) / model.sd > -4.0);
    }
}
