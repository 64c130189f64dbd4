//! An effect that makes some statistic worse beyond chance is not the one that is missing, however
//! much it improves elsewhere: one rule over the means of sites, the variances of rows and frames,
//! and the quantiles of the pixels' means and variances and of the codes, of every stack.

use super::evaluation::Evaluation;
use crate::measured::{Half, Measured};
use crate::model::prediction::{Predicted, Prediction};
use crate::statistics::statistic::{Statistic, What};

/// Standard deviations beyond which a statistic is not chance: the largest of 154 statistics of 926
/// simulated sets with nothing hidden was 7.0, of one in a hundred 5.0.
const BEYOND_CHANCE: f64 = 7.5;
/// Harm that an effect may do to a statistic of one stack, over the most that it improves the same
/// statistic of another. Chosen: what is off by another cause, by a hundredth of a dark current
/// say, may be further off with the right effect; a wrong one does about as much harm as good.
const MAX_HARM: f64 = 0.1;

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
    let all = half.values.iter().filter(|(key, _)| key.1.only_bars()).filter_map(|(key, s)| {
        let allowed = half.allowance.get(key).copied().unwrap_or(0.0);
        Some((key.1, Off::new(s, allowed, before.of.get(key)?, after.of.get(key)?)))
    });
    let all: Vec<(What, Off)> = all.collect();
    let most_good = |what: What| {
        let same = all.iter().filter(|(other, _)| *other == what);
        same.map(|(_, off)| off.before - off.after).fold(0.0, f64::max)
    };
    all.iter().any(|(what, off)| off.is_worse() && off.harm() > MAX_HARM * most_good(*what))
}

/// How far a statistic of a stack is from two models, on its scale.
struct Off {
    before: f64,
    after: f64,
    /// What the means of the models' replicates scatter, and what the set-up leaves open.
    chance: f64,
    /// From the second model, standard deviations.
    deviation: f64,
}

impl Off {
    /// The standard deviation is the larger one of both models: by its own each, a large deviation
    /// that stays as it was would grow by the scatter of the standard deviations.
    fn new(measured: &Statistic, allowed: f64, before: &Predicted, after: &Predicted) -> Self {
        let of_means = (1.0 / before.runs + 1.0 / after.runs).sqrt();
        let off = |model: &Predicted| (after.scale.of(measured.value) - model.scaled).abs();
        Self {
            before: off(before),
            after: off(after),
            chance: BEYOND_CHANCE * of_means * before.sd.max(after.sd) + allowed,
            deviation: after.deviation(measured, allowed).abs(),
        }
    }

    fn harm(&self) -> f64 {
        self.after - self.before - self.chance
    }

    /// Whether it is beyond chance from the second model, and further from it than from the first.
    fn is_worse(&self) -> bool {
        self.deviation > BEYOND_CHANCE && self.harm() > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::statistic::{Place, Scale, by_key};

    fn statistic(value: f64) -> Statistic {
        let (place, what) = (Place::Stack(0), What::SiteMean(0));
        Statistic { place, what, value, sd: 1.0, scale: Scale::Linear }
    }

    fn model(value: f64) -> Predicted {
        let replicates = vec![by_key(vec![statistic(value)]); 16];
        Prediction::new(&replicates).of[&(Place::Stack(0), What::SiteMean(0))]
    }

    /// The means of sixteen replicates each differ by 0.35 standard deviations of 1: by 2.7 at
    /// most.
    #[test]
    fn what_is_further_off_beyond_chance_is_worse() {
        let off = |allowed, before, after| {
            Off::new(&statistic(0.0), allowed, &model(before), &model(after))
        };
        assert!(off(0.0, 0.0, 8.0).is_worse() && off(0.0, -20.0, 23.0).is_worse());
        // Within chance; as far off as before but for chance; nearer.
        assert!(!off(0.0, 0.0, 7.5).is_worse() && !off(0.0, -20.0, 22.5).is_worse());
        assert!(!off(0.0, 20.0, 9.0).is_worse());
        // What the set-up leaves open counts as chance.
        assert!(!off(2.0, 0.0, 9.0).is_worse());
    }
}
