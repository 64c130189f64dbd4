//! What chance makes of an effect: its estimator put to replicates of a model without it.

use super::session::{Frames, Half, Model, SEED, Session};
use crate::candidates::proposal::Proposal;
use crate::model::prediction::Prediction;
use crate::model::replicate;
use crate::statistics::battery::battery;
use crate::statistics::maps::maps;
use crate::statistics::statistic::by_key;
use camrig_base::Result;
use camrig_camera::Camera;
use rayon::prelude::*;

/// First seed of replicates that are estimated from. It lies beyond those of the prediction, which
/// must not be judged by itself.
pub(super) const FIRST_SEED: u64 = SEED + 1000;
const _: () = assert!(SEED + super::session::RUNS <= FIRST_SEED);
/// Replicates that show what chance gives. Eight tell the mean and the scatter well enough for
/// a deviate of 4, at half of the time of a model's own replicates.
const CHANCE_RUNS: u64 = 8;
/// Replicates that are enough for an effect far beyond chance.
const FIRST_RUNS: u64 = CHANCE_RUNS / 2;
/// How many times the scatter that the first replicates show the true one may be: √(3/0.0243), as
/// χ² with 3 degrees of freedom is below 0.0243 once in a thousand.
const MAX_SCATTER: f64 = 11.1;
/// Mean and standard deviation of the absolute value of a standard normal deviate: √(2/π) and
/// √(1 − 2/π).
const HALF_NORMAL: (f64, f64) = (0.797_884_6, 0.602_810_3);

/// Whether the significance of an effect that a model lacks is beyond `least`. Where it is by a
/// few replicates, whatever the scatter that these few allow, no more are made: a sequential test
/// (Wald 1945).
pub(super) fn stands_out(
    session: &Session,
    effect: &Proposal,
    camera: &Camera,
    named: &[Proposal],
    least: f64,
) -> Result<bool> {
    let significance =
        |runs, scatter| significance(session, effect, (camera, named), runs, scatter);
    Ok(significance(FIRST_RUNS, MAX_SCATTER)? > least || significance(CHANCE_RUNS, 1.0)? >= least)
}

/// Significance of an effect that a model lacks, as a normal deviate, where chance scatters
/// `scatter` times as much as so many replicates show: how far its strength is from
/// what its estimator makes of replicates of that model. An effect that differs from sensor to
/// sensor moves many statistics together, as if there were more evidence, and the best of many
/// frequencies is never near zero.
fn significance(
    session: &Session,
    effect: &Proposal,
    (camera, named): (&Camera, &[Proposal]),
    runs: u64,
    scatter: f64,
) -> Result<f64> {
    let all = session.replicates(camera, &session.fit, runs)?;
    let prediction = &Prediction::new(&all);
    let model = Model { camera, prediction, named };
    let wanted = |kind: &str| kind == effect.kind;
    let strength = |proposals: Vec<Proposal>| {
        proposals.into_iter().find(|p| p.has_parameters_of(effect)).map_or(0.0, |p| p.strength)
    };
    let measured =
        strength(session.propose(session.fit.frames(), model, &wanted, f64::NEG_INFINITY));
    let chance: Vec<f64> = (FIRST_SEED..FIRST_SEED + runs)
        .into_par_iter()
        .map(|seed| Ok(strength(estimate_replicate(session, &session.fit, model, &wanted, seed)?)))
        .collect::<Result<_>>()?;
    Ok(beyond_chance(measured, &chance, scatter))
}

/// What the estimators of the kinds `wanted` make of a replicate of a model, taken as a half was.
pub(super) fn estimate_replicate(
    session: &Session,
    half: &Half,
    model: Model<'_>,
    wanted: &(dyn Fn(&str) -> bool + Sync),
    seed: u64,
) -> Result<Vec<Proposal>> {
    let (camera, design) = (model.camera, &half.design);
    let planes = wanted("periodic-pattern-noise");
    let stacks = replicate::simulate(camera, design, seed, planes)?;
    let values = by_key(battery(camera, design, &stacks));
    let maps = maps(camera, design, &stacks);
    let frames = Frames { values: &values, stacks: &stacks, maps: &maps, ..half.frames() };
    Ok(session.propose(frames, model, &wanted, f64::NEG_INFINITY))
}

/// The normal deviate whose absolute value is as far from those of other normal deviates as a
/// strength is from those that chance gives, whose mean and scatter are taken as no smaller than
/// theirs, and the scatter as so many `times` that.
fn beyond_chance(strength: f64, chance: &[f64], times: f64) -> f64 {
    let n = chance.len() as f64;
    let mean = chance.iter().sum::<f64>() / n;
    let sd = (chance.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let (mean, sd) = (mean.max(HALF_NORMAL.0), times * sd.max(HALF_NORMAL.1));
    HALF_NORMAL.0 + HALF_NORMAL.1 * (strength - mean) / sd
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_strength_stands_out_from_what_chance_gives() {
        // Strengths smaller than those of normal deviates count as theirs.
        assert!((beyond_chance(5.0, &[0.0; 8], 1.0) - 5.0).abs() < 1e-12);
        // Scatter ten times as large: a tenth of the distance.
        let tenth = HALF_NORMAL.0 + (5.0 - HALF_NORMAL.0) / 10.0;
        assert!((beyond_chance(5.0, &[0.0; 8], 10.0) - tenth).abs() < 1e-12);
        // Twice as large ones: half the significance.
        let twice: Vec<f64> = [-1.0, 1.0]
            .iter()
            .cycle()
            .take(1000)
            .map(|side| 2.0 * (HALF_NORMAL.0 + side * HALF_NORMAL.1))
            .collect();
        assert!((beyond_chance(8.0, &twice, 1.0) - 4.0).abs() < 2e-3);
        // The best of many is never near zero, and 8 is far from about 4.1.
        let best: Vec<f64> = twice.iter().map(|s| 4.0 + s / 20.0).collect();
        assert!(beyond_chance(8.0, &best, 1.0) > 4.0 && beyond_chance(4.2, &best, 1.0) < 1.0);
    }
}
