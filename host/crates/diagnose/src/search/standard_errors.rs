//! The final parameters of dark and flat frames, with their standard errors, by simulation.
//!
//! Replicates of both halves are simulated by the final model, and the estimators of the parameters
//! are applied to each as if it had been measured: the scatter of the estimates is the standard
//! error (parametric bootstrap, Efron & Tibshirani 1993, chapter 6), whatever the effect does to
//! the scatter of the statistics it is read from. Measurement and prediction scatter independently,
//! hence a factor √(1 + 1/replicates), and √(1 + 2/replicates) for the mean of both halves. A
//! scatter from few replicates is itself uncertain: the standard error given is half the width of
//! the 90 % interval of Student's t over 1.645. Effects estimated from targets have standard errors
//! by least squares.

use super::chance::FIRST_SEED;
use super::estimate::{propose, propose_from_replicate, without_added};
use super::evaluation::{Evaluation, Model, RUNS};
use crate::candidates::proposal::{Proposal, with_all};
use crate::measured::{Half, Measured};
use crate::model::prediction::Prediction;
use crate::numerics::tails;
use camrig_base::Result;
use camrig_camera::AnyEffect;
use camrig_linear::moments;
use rayon::prelude::*;

/// Replicates of both halves that are estimated from: their scatter is known to 27 %, which
/// Student's t takes into account.
const ERROR_RUNS: u64 = 8;
/// Fewest estimates for a standard error: half of the replicates must show the effect.
const MIN_ESTIMATES: usize = ERROR_RUNS as usize / 2;
/// Standard errors of one half by which the halves' estimates may differ and be averaged: five of
/// their difference, which is √2 wider.
const MAX_DIFFERENCE: f64 = 5.0 * std::f64::consts::SQRT_2;
/// Relative difference up to which values without a standard error, such as frequencies, are the
/// same. Chosen: rounding is far smaller, and aliases of a frequency are far further apart.
const SAME_VALUE: f64 = 0.01;
/// Half width of the 90 % interval of a normal distribution, standard deviations.
const Z_90: f64 = 1.645;

/// The model with the final parameters of its effects of dark and flat frames, with standard
/// errors. Where the halves are alike, each parameter is the mean of the estimates from both; the
/// model was judged with those from the frames to fit alone.
pub(super) fn settle_parameters(measured: &Measured, mut model: Evaluation) -> Result<Evaluation> {
    if model.named.iter().all(|p| p.of_targets || p.by_evidence) {
        return Ok(model);
    }
    let Evaluation { camera, fit, holdout, named, .. } = &model;
    let wanted = |kind: &str| named.iter().any(|p| p.kind == kind && !p.of_targets);
    let mut halves = vec![(&measured.fit, fit)];
    if measured.can_confirm && measured.halves_are_alike(camera) {
        halves.push((&measured.holdout, holdout));
    }
    let of_second = halves.get(1).map_or_else(Vec::new, |&(half, prediction)| {
        let model = Model { camera, prediction, named };
        propose(half, model, &wanted, f64::NEG_INFINITY)
    });
    // Estimates from each half of each replicate of the sensor.
    let anew: Vec<Vec<Vec<Proposal>>> = (FIRST_SEED..FIRST_SEED + ERROR_RUNS)
        .into_par_iter()
        .map(|seed| {
            let of = |&(half, prediction): &(&Half, &Prediction)| {
                let model = Model { camera, prediction, named };
                propose_from_replicate(half, model, &wanted, seed)
            };
            halves.iter().map(of).collect()
        })
        .collect::<Result<_>>()?;
    let kinds: Vec<&str> = named.iter().map(|p| p.kind).collect();
    for named in model.named.iter_mut().filter(|p| !(p.of_targets || p.by_evidence)) {
        let alike = |p: &&Proposal| p.kind == named.kind && p.has_parameters_of(named);
        let first: Vec<Vec<f64>> =
            anew.iter().filter_map(|h| h[0].iter().find(alike)).map(values).collect();
        let both: Vec<Vec<f64>> = anew
            .iter()
            .filter_map(|h| Some((h[0].iter().find(alike)?, h.get(1)?.iter().find(alike)?)))
            .map(|(a, b)| std::iter::zip(values(a), values(b)).map(|(a, b)| (a + b) / 2.0))
            .map(Iterator::collect)
            .collect();
        let second = of_second.iter().find(alike).cloned();
        // The prediction from RUNS replicates has an error too, which alike halves share.
        set_errors(named, &first, 1.0 / RUNS as f64);
        let alone = kinds.iter().filter(|k| **k == named.kind).count() == 1;
        if let Some(mean) = second.filter(|_| alone).and_then(|s| mean_of_halves(named, &s))
            && both.len() >= MIN_ESTIMATES
        {
            *named = mean;
            set_errors(named, &both, 2.0 / RUNS as f64);
        }
    }
    model.camera = with_all(&without_added(&model), &model.named);
    Ok(model)
}

/// The values of a proposal's parameters.
fn values(p: &Proposal) -> Vec<f64> {
    p.parameters.iter().map(|p| p.1.value).collect()
}

/// Sets standard errors from the scatter of estimates, with their variance increased by the
/// fraction `more`.
fn set_errors(named: &mut Proposal, estimates: &[Vec<f64>], more: f64) {
    if estimates.len() < MIN_ESTIMATES {
        return;
    }
    let n = estimates.len() as f64;
    let few = tails::student(Z_90, n - 1.0) / Z_90;
    for (i, (key, parameter)) in named.parameters.iter_mut().enumerate() {
        let (_, variance) = moments(&estimates.iter().map(|e| e[i]).collect::<Vec<_>>());
        // A parameter that the estimator fixes has no scatter, and any alias of a frequency may
        // come back.
        if variance > 0.0 && !key.starts_with("cycles_per_") {
            parameter.std_error = (variance * (1.0 + more)).sqrt() * few;
        }
    }
}

/// The mean of two estimates of an effect, if they agree: a frequency may be an alias, a direction
/// differ by a turn.
fn mean_of_halves(a: &Proposal, b: &Proposal) -> Option<Proposal> {
    let agree = std::iter::zip(&a.parameters, &b.parameters).all(|((_, a), (_, b))| {
        let known = if a.std_error.is_finite() {
            MAX_DIFFERENCE * a.std_error
        } else {
            SAME_VALUE * a.value.abs()
        };
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
        *x = AnyEffect::new(x.kind(), &of.collect::<Vec<_>>())?;
    }
    Some(mean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Value;
    use camrig_sensor_core::effects::periodic_pattern_noise::PeriodicPatternNoise;

    fn wave(amplitude: f64, fx: f64) -> Proposal {
        let effect = PeriodicPatternNoise {
            amplitude_e: amplitude as f32,
            cycles_per_column: fx as f32,
            cycles_per_row: 0.0,
            gain_exponent: 0.0,
        };
        Proposal::new("periodic-pattern-noise", effect.into(), 10.0)
            .with("amplitude_e", Value { value: amplitude, std_error: 0.1 })
            .with("cycles_per_column", Value::chosen(fx))
    }

    #[test]
    fn halves_that_say_the_same_are_averaged_and_others_are_not() {
        let mean = mean_of_halves(&wave(1.0, 0.25), &wave(1.2, 0.2501)).unwrap();
        assert!((mean.parameters[0].1.value - 1.1).abs() < 1e-12);
        assert!((mean.effects[0].values()[0] - 1.1).abs() < 1e-6);
        // Another wave, or one far too strong to be the same.
        assert!(mean_of_halves(&wave(1.0, 0.25), &wave(1.0, 0.45)).is_none());
        assert!(mean_of_halves(&wave(1.0, 0.25), &wave(2.0, 0.25)).is_none());
    }

    #[test]
    fn the_scatter_of_estimates_is_the_standard_error() {
        let mut named = wave(1.0, 0.25);
        let of = |i| vec![f64::from(i % 2) * 0.2, 0.3];
        let estimates: Vec<Vec<f64>> = (0..16).map(of).collect();
        set_errors(&mut named, &estimates, 0.5);
        // Variance 16/15 0.1², half more; Student's t of 15 degrees of freedom; a frequency keeps
        // none.
        let expected = (16.0 / 15.0 * 0.01 * 1.5f64).sqrt() * 1.753 / 1.645;
        assert!((named.parameters[0].1.std_error / expected - 1.0).abs() < 1e-3);
        assert!(named.parameters[1].1.std_error.is_nan());
        // Too few estimates change nothing.
        let before = named.parameters[0].1.std_error;
        set_errors(&mut named, &estimates[..MIN_ESTIMATES - 1], 3.0);
        assert_eq!(named.parameters[0].1.std_error, before);
    }
}
