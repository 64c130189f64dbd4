//! Standard errors of parameters and what chance gives, by simulation.
//!
//! The final model makes replicates of the frames to fit, and the estimators that gave the parameters are put to each
//! as if it had been measured: the scatter of what they give is their standard error (parametric bootstrap, Efron &
//! Tibshirani 1993, chapter 6), whatever the effect does to the scatter of the statistics it is read from. Measurement
//! and prediction scatter apart, hence √(1 + 1/replicates). Edges, dots and charts give errors of their own, by least
//! squares.

use super::maps::maps;
use super::prediction::{Prediction, Values, by_key};
use super::search::same_shape;
use super::session::{Frames, RUNS, SEED, Session, State};
use super::statistics::battery;
use super::{candidates::Proposal, replicate};
use crate::Result;
use crate::camera::Camera;
use rayon::prelude::*;

/// First of the seeds: none that made the prediction.
const FIRST: u64 = SEED + 1000;
/// Estimates without which there is no standard error.
const LEAST: usize = RUNS as usize / 2;
/// Replicates that show what chance gives.
const CHANCES: u64 = 8;

impl Session {
    /// Gives the named effects of dark and flat frames the standard errors that simulation finds.
    pub(super) fn simulate_errors(&self, state: &mut State) -> Result<()> {
        if state.named.iter().all(|p| p.of_looks) {
            return Ok(());
        }
        let State { camera, fit, named, .. } = &*state;
        let wanted = |kind: &str| named.iter().any(|p| p.kind == kind && !p.of_looks);
        let estimates: Vec<Vec<Proposal>> = (FIRST..FIRST + RUNS)
            .into_par_iter()
            .map(|seed| self.estimate_anew(camera, fit, named, &wanted, seed))
            .collect::<Result<_>>()?;
        for named in state.named.iter_mut().filter(|p| !p.of_looks) {
            let found: Vec<&Proposal> = estimates
                .iter()
                .filter_map(|all| all.iter().find(|p| p.kind == named.kind && same_shape(p, named)))
                .collect();
            if found.len() < LEAST {
                continue;
            }
            for (i, (key, parameter)) in named.parameters.iter_mut().enumerate() {
                let n = found.len() as f64;
                let values = || found.iter().map(|p| p.parameters[i].1.value);
                let mean = values().sum::<f64>() / n;
                let variance = values().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
                // What an estimator holds fast has no scatter, and of frequencies any alias may come back.
                if variance > 0.0 && !key.starts_with("cycles_per_") {
                    parameter.se = (variance * (1.0 + 1.0 / RUNS as f64)).sqrt();
                }
            }
        }
        Ok(())
    }

    /// Significance of an effect that a model lacks, in units of what its estimator makes of replicates of that model: effects
    /// that are another on each sensor move many statistics together, as if there were more. `replicates` are some of the model.
    pub(super) fn stands_out(
        &self,
        effect: &Proposal,
        camera: &Camera,
        replicates: &[Values],
        named: &[Proposal],
    ) -> Result<f64> {
        let all = self.replicates(camera, &self.fit.design, CHANCES, Some(replicates))?;
        let model = &Prediction::new(&all);
        let wanted = |kind: &str| kind == effect.kind;
        let strength = |proposals: Vec<Proposal>| {
            proposals.into_iter().find(|p| same_shape(p, effect)).map_or(0.0, |p| p.strength)
        };
        let measured = strength(self.propose(self.frames(), camera, model, named, &wanted, 0.0));
        let squares: Vec<f64> = (FIRST..FIRST + CHANCES)
            .into_par_iter()
            .map(|seed| {
                let anew = self.estimate_anew(camera, model, named, &wanted, seed)?;
                Ok(strength(anew).powi(2))
            })
            .collect::<Result<_>>()?;
        Ok(measured / (squares.iter().sum::<f64>() / squares.len() as f64).sqrt().max(1.0))
    }

    /// What estimators make of a replicate of a model.
    fn estimate_anew(
        &self,
        camera: &Camera,
        model: &Prediction,
        named: &[Proposal],
        wanted: &(dyn Fn(&str) -> bool + Sync),
        seed: u64,
    ) -> Result<Vec<Proposal>> {
        let design = &self.fit.design;
        let waves = wanted("periodic-pattern-noise");
        let stacks = replicate::simulate(camera, design, seed, waves)?;
        let values = by_key(battery(camera, design, &stacks));
        let maps = maps(camera, design, &stacks);
        let frames = Frames { values: &values, stacks: &stacks, maps: &maps };
        Ok(self.propose(frames, camera, model, named, &wanted, 0.0))
    }
}
