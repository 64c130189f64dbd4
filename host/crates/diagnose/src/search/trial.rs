//! A trial of one candidate: the model is simulated with it and compared with both halves.

use super::estimate::propose;
use super::evaluation::{Evaluation, Model, gap};
use crate::candidates::proposal::Proposal;
use crate::measured::{Half, Measured};
use crate::model::prediction::{Prediction, bounded};
use camrig_base::Result;
use camrig_camera::Camera;

/// Replicates of a candidate, with the random numbers of the model's first ones. Four pairs show
/// the mean of a difference and its scatter; differences that may be due to chance are shrunk.
pub(super) const TRIAL_RUNS: u64 = 4;
/// Fall of the deviance on the frames to fit from which a candidate is significant: half of
/// [`EVIDENCE_IN_ALL`].
pub(super) const EVIDENCE_TO_FIT: f64 = 14.0;
/// Fall of the deviance on the held-out frames that confirms a candidate: 1.7 standard deviations
/// of a single statistic, in the right direction.
const EVIDENCE_HELD_OUT: f64 = 3.0;
/// Fall of the deviance on both together: 5.3² for 5.3 standard deviations of a single statistic.
pub const EVIDENCE_IN_ALL: f64 = 28.0;
/// Fraction that a candidate must remove of the deviance of the statistics that it changes, or else
/// of the whole held-out gap. Chosen: while other effects are missing, the right one leaves much of
/// it, a wrong one nearly all. Gross deviations count by their logarithm in the first: hot pixels
/// that reduced a gap from 2100 to 258 removed 0.16 of it.
const MIN_EXPLAINED: f64 = 0.3;
/// Estimates of a candidate that was tried, each from the model with the one before; the best is
/// kept.
const MAX_ESTIMATES: usize = 3;
/// Standard errors by which an estimate must change to be tried again.
const MIN_CHANGE: f64 = 1.0;

/// A candidate that was simulated.
#[derive(Clone, Debug)]
pub struct Trial {
    /// What was put into the model.
    pub proposal: Proposal,
    /// Fall of the deviance of the frames to fit.
    pub evidence: f64,
    /// Fall of the deviance of the held-out frames.
    pub confirmed: f64,
    /// Held-out gap with it.
    pub gap: f64,
    /// Fraction that it removes of the deviance of the statistics that it changes.
    pub explains: f64,
}

impl Trial {
    /// Whether the candidate is significant for a model with a held-out gap of `before`.
    pub(super) fn is_significant(&self, before: f64) -> bool {
        // The two halves of a target share the sensor's pattern: one alone must show what
        // elsewhere both show together.
        let to_fit = match self.proposal.of_targets {
            true => EVIDENCE_IN_ALL,
            false => EVIDENCE_TO_FIT,
        };
        self.evidence > to_fit
            && self.confirmed > EVIDENCE_HELD_OUT
            && self.evidence + self.confirmed > EVIDENCE_IN_ALL
            && (self.explains > MIN_EXPLAINED || self.gap < (1.0 - MIN_EXPLAINED) * before)
    }
}

/// Simulates a proposal on top of a model, in `runs` replicates, and scores it. Returns also what
/// the model with it predicts for the frames to fit, and its camera.
pub(super) fn try_out(
    measured: &Measured,
    model: &Evaluation,
    proposal: &Proposal,
    runs: u64,
) -> Result<(Trial, Prediction, Camera)> {
    let camera = proposal.applied(&model.camera);
    let before = &model.replicates[..runs as usize];
    let after = measured.fit.replicates(&camera, runs)?;
    let fit = model.fit.moved(before, &after);
    let holdout = model.holdout.moved(before, &after);
    let trial = Trial {
        proposal: proposal.clone(),
        evidence: model.deviances[0] - measured.fit.deviance(&fit),
        confirmed: model.deviances[1] - measured.holdout.deviance(&holdout),
        gap: gap(&measured.holdout.deviations(&holdout), model.norm),
        explains: explained(&[
            (&measured.fit, &model.fit, &fit),
            (&measured.holdout, &model.holdout, &holdout),
        ]),
    };
    Ok((trial, fit, camera))
}

/// Tries a proposal, and again with its parameters estimated again from the model with it.
pub(super) fn settle(
    measured: &Measured,
    start: &Evaluation,
    proposal: &Proposal,
) -> Result<Trial> {
    let (mut best, mut prediction, mut camera) = try_out(measured, start, proposal, TRIAL_RUNS)?;
    for _ in 0..MAX_ESTIMATES {
        let own = |kind: &str| kind == proposal.kind;
        let model = Model { camera: &camera, prediction: &prediction, named: &start.named };
        let again = propose(&measured.fit, model, &own, MIN_CHANGE)
            .into_iter()
            .find(|p| !p.beside && p.has_parameters_of(&best.proposal));
        let Some(next) = again.filter(|p| p.strength > MIN_CHANGE) else { break };
        let (trial, p, c) = try_out(measured, start, &best.proposal.updated(next), TRIAL_RUNS)?;
        (prediction, camera) = (p, c);
        if trial.evidence > best.evidence {
            best = trial;
        }
    }
    Ok(best)
}

/// Fraction removed of the deviance of the statistics that a change affects; 1 where it affects
/// none significantly. Halves with the prediction before and after.
fn explained(halves: &[(&Half, &Prediction, &Prediction)]) -> f64 {
    let (mut had, mut left) = (0.0, 0.0);
    for (half, before, after) in halves {
        let z_after = half.deviations(after);
        for (key, z) in half.deviations(before) {
            let (Some(a), Some(b)) = (before.of.get(&key), after.of.get(&key)) else { continue };
            if b.differs(a)
                && let Some(z_after) = z_after.get(&key)
            {
                had += bounded(z);
                left += bounded(*z_after);
            }
        }
    }
    if had > 0.0 { 1.0 - left / had } else { 1.0 }
}
