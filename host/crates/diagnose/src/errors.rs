//! The last word on parameters, their standard errors and what chance gives, by simulation.
//!
//! The final model makes replicates of both halves, and the estimators that gave the parameters are put to each
//! as if it had been measured: the scatter of what they give is their standard error (parametric bootstrap, Efron &
//! Tibshirani 1993, chapter 6), whatever the effect does to the scatter of the statistics it is read from. Measurement
//! and prediction scatter apart, hence √(1 + 1/replicates), for the mean of halves √(1 + 2/replicates). A scatter known from
//! few replicates is uncertain itself: a standard error is half the width of the 90 % interval of Student's t over 1.645.
//! Edges, dots and charts give errors of their own, by least squares.

use super::maps::maps;
use super::prediction::{Prediction, by_key};
use super::search::same_shape;
use super::session::{Frames, Half, RUNS, SEED, Session, State};
use super::statistics::battery;
use super::{candidates::Proposal, replicate, tails};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_sensor_core::effects::Effect;
use rayon::prelude::*;

/// First of the seeds: none that made the prediction.
const FIRST: u64 = SEED + 1000;
/// Estimates without which there is no standard error.
const LEAST: usize = RUNS as usize / 2;
/// Standard errors of the one half by which the halves' estimates may be apart: five of their difference.
const MOST_APART: f64 = 5.0 * std::f64::consts::SQRT_2;
/// Relative difference of values that have no standard error, as frequencies, that are still the same.
const ROUGHLY: f64 = 0.01;
/// Standard deviations from the middle to the end of a normal law's interval of 90 %.
const Z_90: f64 = 1.645;
/// Mean and standard deviation of the absolute value of a standard normal deviate: √(2/π) and √(1 − 2/π).
const HALF_NORMAL: (f64, f64) = (0.797_884_6, 0.602_810_3);
/// Replicates that show what chance gives.
const CHANCES: u64 = 8;

impl Session {
    /// The last word on the parameters that dark and flat frames show, with the standard errors that simulation finds. Where
    /// the halves are alike it is the mean of what they give: judged were the parameters of the frames to fit alone.
    pub(super) fn settle_parameters(&self, state: &mut State) -> Result<()> {
        if state.named.iter().all(|p| p.of_looks) {
            return Ok(());
        }
        let State { camera, fit, holdout, named, .. } = &*state;
        let wanted = |kind: &str| named.iter().any(|p| p.kind == kind && !p.of_looks);
        let mut halves = vec![(&self.fit, fit)];
        if self.can_confirm && self.halves_are_alike() {
            halves.push((&self.holdout, holdout));
        }
        let judges = halves.get(1).map_or_else(Vec::new, |(half, model)| {
            self.propose(half.frames(), camera, model, named, &wanted, f64::NEG_INFINITY)
        });
        // Of each replicate of the sensor, what each half gives.
        let anew: Vec<Vec<Vec<Proposal>>> = (FIRST..FIRST + RUNS)
            .into_par_iter()
            .map(|seed| {
                let of = |(half, model): &(&Half, &Prediction)| {
                    self.estimate_anew(half, camera, model, named, &wanted, seed)
                };
                halves.iter().map(of).collect()
            })
            .collect::<Result<_>>()?;
        let kinds: Vec<&str> = named.iter().map(|p| p.kind).collect();
        for named in state.named.iter_mut().filter(|p| !p.of_looks) {
            let alike = |p: &&Proposal| p.kind == named.kind && same_shape(p, named);
            let first: Vec<Vec<f64>> =
                anew.iter().filter_map(|h| h[0].iter().find(alike)).map(values).collect();
            let both: Vec<Vec<f64>> = anew
                .iter()
                .filter_map(|h| Some((h[0].iter().find(alike)?, h.get(1)?.iter().find(alike)?)))
                .map(|(a, b)| std::iter::zip(values(a), values(b)).map(|(a, b)| (a + b) / 2.0))
                .map(Iterator::collect)
                .collect();
            let second = judges.iter().find(alike).cloned();
            // The prediction, of RUNS replicates, scatters too; of halves that are alike it is the same.
            set_errors(named, &first, 1.0 / RUNS as f64);
            let alone = kinds.iter().filter(|k| **k == named.kind).count() == 1;
            if let Some(mean) = second.filter(|_| alone).and_then(|s| mean_of_halves(named, &s))
                && both.len() >= LEAST
            {
                *named = mean;
                set_errors(named, &both, 2.0 / RUNS as f64);
            }
        }
        let base = self.base(state);
        state.camera = state.named.iter().fold(base, |c, p| p.applied(&c));
        Ok(())
    }

    /// Significance of an effect that a model lacks: the normal deviate that is as far from the absolute values of others as
    /// its strength is from what its estimator makes of replicates of that model. Effects that are another on each sensor move
    /// many statistics together, as if there were more; the best of many frequencies is never near zero.
    pub(super) fn stands_out(
        &self,
        effect: &Proposal,
        camera: &Camera,
        named: &[Proposal],
    ) -> Result<f64> {
        let all = self.replicates(camera, &self.fit, CHANCES)?;
        let model = &Prediction::new(&all);
        let wanted = |kind: &str| kind == effect.kind;
        let strength = |proposals: Vec<Proposal>| {
            proposals.into_iter().find(|p| same_shape(p, effect)).map_or(0.0, |p| p.strength)
        };
        let measured = strength(self.propose(
            self.fit.frames(),
            camera,
            model,
            named,
            &wanted,
            f64::NEG_INFINITY,
        ));
        let chance: Vec<f64> = (FIRST..FIRST + CHANCES)
            .into_par_iter()
            .map(|seed| {
                Ok(strength(self.estimate_anew(&self.fit, camera, model, named, &wanted, seed)?))
            })
            .collect::<Result<_>>()?;
        Ok(beyond_chance(measured, &chance))
    }

    /// What estimators make of a replicate of a model, taken as a half was.
    fn estimate_anew(
        &self,
        half: &Half,
        camera: &Camera,
        model: &Prediction,
        named: &[Proposal],
        wanted: &(dyn Fn(&str) -> bool + Sync),
        seed: u64,
    ) -> Result<Vec<Proposal>> {
        let design = &half.design;
        let planes = wanted("periodic-pattern-noise");
        let stacks = replicate::simulate(camera, design, seed, planes)?;
        let values = by_key(battery(camera, design, &stacks));
        let maps = maps(camera, design, &stacks);
        let frames = Frames { values: &values, stacks: &stacks, maps: &maps, ..half.frames() };
        Ok(self.propose(frames, camera, model, named, &wanted, f64::NEG_INFINITY))
    }
}

/// The normal deviate that is as far from the absolute values of others as a strength is from what chance gives, whose mean
/// and scatter are no smaller than theirs.
fn beyond_chance(strength: f64, chance: &[f64]) -> f64 {
    let n = chance.len() as f64;
    let mean = chance.iter().sum::<f64>() / n;
    let sd = (chance.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let (mean, sd) = (mean.max(HALF_NORMAL.0), sd.max(HALF_NORMAL.1));
    HALF_NORMAL.0 + HALF_NORMAL.1 * (strength - mean) / sd
}

/// The values of a proposal's parameters.
fn values(p: &Proposal) -> Vec<f64> {
    p.parameters.iter().map(|p| p.1.value).collect()
}

/// Standard errors from the scatter of estimates, as much larger in variance as `more` says.
fn set_errors(named: &mut Proposal, estimates: &[Vec<f64>], more: f64) {
    if estimates.len() < LEAST {
        return;
    }
    let n = estimates.len() as f64;
    let few = tails::student(Z_90, n - 1.0) / Z_90;
    for (i, (key, parameter)) in named.parameters.iter_mut().enumerate() {
        let mean = estimates.iter().map(|e| e[i]).sum::<f64>() / n;
        let variance = estimates.iter().map(|e| (e[i] - mean).powi(2)).sum::<f64>() / (n - 1.0);
        // What an estimator holds fast has no scatter, and of frequencies any alias may come back.
        if variance > 0.0 && !key.starts_with("cycles_per_") {
            parameter.se = (variance * (1.0 + more)).sqrt() * few;
        }
    }
}

/// The mean of two estimates of an effect, if they are two of the same: a frequency may be an alias, a direction another turn.
fn mean_of_halves(a: &Proposal, b: &Proposal) -> Option<Proposal> {
    let agree = std::iter::zip(&a.parameters, &b.parameters).all(|((_, a), (_, b))| {
        let known = if a.se.is_finite() { MOST_APART * a.se } else { ROUGHLY * a.value.abs() };
        (a.value - b.value).abs() <= known
    });
    if !agree {
        return None;
    }
    let mut mean = a.clone();
    for (x, y) in mean.parameters.iter_mut().zip(&b.parameters) {
        x.1.value = (x.1.value + y.1.value) / 2.0;
    }
    for (x, y) in mean.effects.iter_mut().zip(&b.effects) {
        let of = std::iter::zip(x.values(), y.values()).map(|(x, y)| (x + y) / 2.0);
        *x = Effect::new(x.entry().id, &of.collect::<Vec<_>>())?;
    }
    Some(mean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_sensor_core::effects::periodic_pattern_noise::PeriodicPatternNoise;

    fn wave(amplitude: f64, fx: f64) -> Proposal {
        let effect = PeriodicPatternNoise {
            amplitude_e: amplitude as f32,
            cycles_per_column: fx as f32,
            cycles_per_row: 0.0,
        };
        Proposal::new("periodic-pattern-noise", effect.into(), 10.0)
            .with("amplitude_e", amplitude, 0.1)
            .with("cycles_per_column", fx, f64::NAN)
    }

    #[test]
    fn halves_that_say_the_same_are_averaged_and_others_are_not() {
        let mean = mean_of_halves(&wave(1.0, 0.25), &wave(1.2, 0.2501)).unwrap();
        assert!((mean.parameters[0].1.value - 1.1).abs() < 1e-12);
        assert!((mean.effects[0].values()[0] - 1.1).abs() < 1e-6);
        // Another wave, or one by far too strong to be the same.
        assert!(mean_of_halves(&wave(1.0, 0.25), &wave(1.0, 0.45)).is_none());
        assert!(mean_of_halves(&wave(1.0, 0.25), &wave(2.0, 0.25)).is_none());
    }

    #[test]
    fn a_strength_stands_out_from_what_chance_gives() {
        // What is less than normal deviates give counts as theirs.
        assert!((beyond_chance(5.0, &[0.0; 8]) - 5.0).abs() < 1e-12);
        // Twice as large ones: half the significance.
        let twice: Vec<f64> = [-1.0, 1.0]
            .iter()
            .cycle()
            .take(1000)
            .map(|side| 2.0 * (HALF_NORMAL.0 + side * HALF_NORMAL.1))
            .collect();
        assert!((beyond_chance(8.0, &twice) - 4.0).abs() < 2e-3);
        // The best of many is never near zero, and 8 is far from about 4.1.
        let best: Vec<f64> = twice.iter().map(|s| 4.0 + s / 20.0).collect();
        assert!(beyond_chance(8.0, &best) > 4.0 && beyond_chance(4.2, &best) < 1.0);
    }

    #[test]
    fn the_scatter_of_estimates_is_the_standard_error() {
        let mut named = wave(1.0, 0.25);
        let estimates: Vec<Vec<f64>> = (0..16).map(|i| vec![f64::from(i % 2) * 0.2, 0.3]).collect();
        set_errors(&mut named, &estimates, 0.5);
        // Variance 16/15 0.1², half more; Student's t of 15 degrees of freedom; a frequency keeps none.
        let expected = (16.0 / 15.0 * 0.01 * 1.5f64).sqrt() * 1.753 / 1.645;
        assert!((named.parameters[0].1.se / expected - 1.0).abs() < 1e-3);
        assert!(named.parameters[1].1.se.is_nan());
        // Too few estimates say nothing.
        let before = named.parameters[0].1.se;
        set_errors(&mut named, &estimates[..LEAST - 1], 3.0);
        assert_eq!(named.parameters[0].1.se, before);
    }
}
