//! Significance of an effect: its estimator is applied to replicates of a model without it.

use super::estimate::{propose, propose_from_replicate};
use super::evaluation::{Model, RUNS};
use crate::candidates::proposal::Proposal;
use crate::measured::{Half, SEED};
use crate::model::prediction::Prediction;
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_linear::moments;
use rayon::prelude::*;

/// First seed of replicates that estimators are applied to, after those of the prediction, which
/// must be independent.
pub(super) const FIRST_SEED: u64 = SEED + 1000;
const _: () = assert!(SEED + RUNS <= FIRST_SEED);
/// Replicates without the effect. Eight determine the mean and the scatter well enough for a
/// deviate of 4, in half the time of a model's own replicates.
const CHANCE_RUNS: u64 = 8;
/// Replicates that suffice for a strong effect.
const FIRST_RUNS: u64 = CHANCE_RUNS / 2;
/// Largest ratio of the true scatter to that of the first replicates: √(3/0.0243), as χ² with 3
/// degrees of freedom is below 0.0243 once in a thousand.
const MAX_SCATTER: f64 = 11.1;
/// Mean of the absolute value of a standard normal deviate: √(2/π).
const HALF_NORMAL_MEAN: f64 = 0.797_884_6;
/// Its standard deviation: √(1 − 2/π).
const HALF_NORMAL_SD: f64 = 0.602_810_3;

/// Whether the significance of an effect that a model lacks is at least `least`. Where a few
/// replicates show it even with the largest scatter that they allow, no more are simulated: a
/// sequential test (Wald 1945).
pub(super) fn stands_out(
    half: &Half,
    effect: &Proposal,
    camera: &Camera,
    named: &[Proposal],
    least: f64,
) -> Result<bool> {
    let significance = |runs, scatter| significance(half, effect, (camera, named), runs, scatter);
    Ok(significance(FIRST_RUNS, MAX_SCATTER)? > least || significance(CHANCE_RUNS, 1.0)? >= least)
}

/// Significance of an effect that a model lacks, as a normal deviate: the distance of its strength
/// from those that its estimator finds in so many replicates of that model, whose true scatter is
/// taken as `scatter` times that observed. An effect that differs from sensor to sensor changes
/// many statistics together, as if there were more evidence, and the best of many frequencies is
/// never near zero.
fn significance(
    half: &Half,
    effect: &Proposal,
    (camera, named): (&Camera, &[Proposal]),
    runs: u64,
    scatter: f64,
) -> Result<f64> {
    let all = half.replicates(camera, runs)?;
    let prediction = &Prediction::new(&all);
    let model = Model { camera, prediction, named };
    let wanted = |kind: &str| kind == effect.kind;
    let strength = |proposals: Vec<Proposal>| {
        proposals.into_iter().find(|p| p.has_parameters_of(effect)).map_or(0.0, |p| p.strength)
    };
    let measured = strength(propose(half, model, &wanted, f64::NEG_INFINITY));
    let chance: Vec<f64> = (FIRST_SEED..FIRST_SEED + runs)
        .into_par_iter()
        .map(|seed| Ok(strength(propose_from_replicate(half, model, &wanted, seed)?)))
        .collect::<Result<_>>()?;
    Ok(beyond_chance(measured, &chance, scatter))
}

/// The normal deviate whose absolute value is as far from those of other normal deviates as a
/// strength is from those due to chance. The mean and scatter of these are taken as no smaller than
/// those of normal deviates, and the scatter as so many `times` that.
fn beyond_chance(strength: f64, chance: &[f64], times: f64) -> f64 {
    let (mean, variance) = moments(chance);
    let (mean, sd) = (mean.max(HALF_NORMAL_MEAN), times * variance.sqrt().max(HALF_NORMAL_SD));
    HALF_NORMAL_MEAN + HALF_NORMAL_SD * (strength - mean) / sd
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_strength_stands_out_from_what_chance_gives() {
        // Strengths smaller than those of normal deviates count as theirs.
        assert!((beyond_chance(5.0, &[0.0; 8], 1.0) - 5.0).abs() < 1e-12);
        // Scatter ten times as large: a tenth of the distance.
        let tenth = HALF_NORMAL_MEAN + (5.0 - HALF_NORMAL_MEAN) / 10.0;
        assert!((beyond_chance(5.0, &[0.0; 8], 10.0) - tenth).abs() < 1e-12);
        // Twice as large ones: half the significance.
        let twice: Vec<f64> = [-1.0, 1.0]
            .iter()
            .cycle()
            .take(1000)
            .map(|side| 2.0 * (HALF_NORMAL_MEAN + side * HALF_NORMAL_SD))
            .collect();
        assert!((beyond_chance(8.0, &twice, 1.0) - 4.0).abs() < 2e-3);
        // The best of many is never near zero, and 8 is far from about 4.1.
        let best: Vec<f64> = twice.iter().map(|s| 4.0 + s / 20.0).collect();
        assert!(beyond_chance(8.0, &best, 1.0) > 4.0 && beyond_chance(4.2, &best, 1.0) < 1.0);
    }
}
