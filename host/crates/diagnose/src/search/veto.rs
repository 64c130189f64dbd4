//! An effect that makes some statistic worse beyond chance is not the one that is missing, however
//! much it improves elsewhere: one rule over the means of sites, the variances of rows and frames,
//! and the quantiles of the pixels' means and variances and of the codes, of every stack.

use super::evaluation::Evaluation;
use crate::measured::{Half, Measured};
use crate::model::prediction::{Predicted, Prediction};
use crate::statistics::statistic::Statistic;

/// Standard deviations beyond which a statistic is not chance: the largest of 154 statistics of 926
/// simulated sets with nothing hidden was 7.0, of one in a hundred 5.0.
const BEYOND_CHANCE: f64 = 7.5;
/// How many times as far off as before a statistic is that an effect makes worse. What is off by
/// another cause may be a little further off with the right effect.
const TIMES_AS_FAR: f64 = 2.0;

/// Whether a model leaves some statistic of either half further from what was measured than the
/// model before did, beyond chance.
pub(super) fn bars(measured: &Measured, before: &Evaluation, after: &Evaluation) -> bool {
    let halves = [
        (&measured.fit, &before.fit, &after.fit),
        (&measured.holdout, &before.holdout, &after.holdout),
    ];
    halves.into_iter().any(|(half, before, after)| worsens(half, before, after))
}

fn worsens(half: &Half, before: &Prediction, after: &Prediction) -> bool {
    half.values.iter().filter(|(key, _)| key.1.only_bars()).any(|(key, statistic)| {
        let allowed = half.allowance.get(key).copied().unwrap_or(0.0);
        let models = before.of.get(key).zip(after.of.get(key));
        models.is_some_and(|(before, after)| is_worse(statistic, allowed, before, after))
    })
}

/// Whether a statistic is beyond chance from a model, and more than [`TIMES_AS_FAR`] as far from it
/// as from the one before, beyond what the means of the models' replicates scatter. The standard
/// deviation is the larger one of both models: by its own each, a large deviation that stays as it
/// was would grow by the scatter of the standard deviations.
fn is_worse(measured: &Statistic, allowed: f64, before: &Predicted, after: &Predicted) -> bool {
    let of_means = (1.0 / before.runs + 1.0 / after.runs).sqrt();
    let chance = BEYOND_CHANCE * of_means * before.sd.max(after.sd) + allowed;
    let off = |model: &Predicted| (after.scale.of(measured.value) - model.scaled).abs();
    after.deviation(measured, allowed).abs() > BEYOND_CHANCE
        && off(after) > TIMES_AS_FAR * off(before) + chance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::statistic::{Place, Scale, What, by_key};

    fn statistic(value: f64) -> Statistic {
        let (place, what) = (Place::Stack(0), What::SiteMean(0));
        Statistic { place, what, value, sd: 1.0, scale: Scale::Linear }
    }

    fn model(value: f64) -> Predicted {
        let replicates = vec![by_key(vec![statistic(value)]); 16];
        Prediction::new(&replicates).of[&(Place::Stack(0), What::SiteMean(0))]
    }

    /// The means of sixteen replicates each differ by 0.35 standard deviations of 1.
    #[test]
    fn what_is_much_further_off_beyond_chance_is_worse() {
        let worse = |before, after| is_worse(&statistic(0.0), 0.0, &model(before), &model(after));
        assert!(worse(0.0, 8.0) && worse(-4.0, 11.0) && worse(-20.0, 43.0));
        // Within chance; off by another cause; nearer.
        assert!(!worse(0.0, 7.5) && !worse(-20.0, 25.0) && !worse(20.0, 9.0));
        // What the set-up leaves open counts as chance.
        assert!(!is_worse(&statistic(0.0), 2.0, &model(0.0), &model(9.0)));
    }
}
