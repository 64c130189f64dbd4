//! One candidate tried: the model simulated with it, and how much likelier that makes both halves.

use super::session::{Half, Model, Session, State};
use crate::candidates::proposal::Proposal;
use crate::model::prediction::{Prediction, bounded};
use camrig_base::Result;
use camrig_camera::Camera;

/// Replicates of a candidate, with the random numbers of the model's first ones. Four pairs show
/// the mean of a difference and its scatter; what may be chance in it is shrunk.
pub(super) const TRIAL_RUNS: u64 = 4;
/// Fall of the deviance on the frames to fit from which a candidate earns its place: half of
/// [`EVIDENCE_IN_ALL`].
pub(super) const EVIDENCE_TO_FIT: f64 = 14.0;
/// Fall of the deviance on the held-out frames from which they agree: 1.7 standard deviations of
/// a single statistic, in the right direction.
const EVIDENCE_HELD_OUT: f64 = 3.0;
/// Fall of the deviance on both together: 5.3² for 5.3 standard deviations of a single statistic.
pub const EVIDENCE_IN_ALL: f64 = 28.0;
/// Share of the deviance of the statistics that a candidate moves which it must remove, or else of
/// all of the held-out gap. Chosen: the right effect beside others that are still missing leaves
/// much of it, another effect nearly all. Gross deviations count by their logarithm in the first:
/// hot pixels that took a gap from 2100 to 258 removed 0.16 of it.
const MIN_EXPLAINED: f64 = 0.3;
/// Estimates of a candidate that was tried, each from the model with the one before; they settle
/// by then, or the best serves.
const ESTIMATES: usize = 3;
/// Standard errors by which a candidate's parameters must differ from those tried to be tried
/// again.
const UNSETTLED: f64 = 1.0;

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
    /// Share of the deviance of the statistics that it moves which it removes.
    pub explains: f64,
}

impl Trial {
    /// Whether the candidate earns its place in a model with a held-out gap of `before`.
    pub(super) fn earns_place(&self, before: f64) -> bool {
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

/// Simulates a proposal on top of a model, in `runs` replicates, and scores it. Also gives what the
/// model with it predicts for the frames to fit, and its camera.
pub(super) fn try_out(
    session: &Session,
    state: &State,
    proposal: &Proposal,
    runs: u64,
) -> Result<(Trial, Prediction, Camera)> {
    let camera = proposal.applied(&state.camera);
    let before = &state.replicates[..runs as usize];
    let after = session.replicates(&camera, &session.fit, runs)?;
    let fit = state.fit.moved(before, &after);
    let holdout = state.holdout.moved(before, &after);
    let fall =
        |half: &Half, old: &Prediction, new: &Prediction| half.deviance(old) - half.deviance(new);
    let evidence = fall(&session.fit, &state.fit, &fit);
    let confirmed = fall(&session.holdout, &state.holdout, &holdout);
    let explains = explained(&[
        (&session.fit, &state.fit, &fit),
        (&session.holdout, &state.holdout, &holdout),
    ]);
    let gap = session.gap_of(&holdout, state.norm.0);
    Ok((Trial { proposal: proposal.clone(), evidence, confirmed, gap, explains }, fit, camera))
}

/// Tries a proposal, and again with its parameters estimated anew from the model with it.
pub(super) fn settle(session: &Session, state: &State, proposal: &Proposal) -> Result<Trial> {
    let (mut best, mut prediction, mut camera) = try_out(session, state, proposal, TRIAL_RUNS)?;
    for _ in 0..ESTIMATES {
        let own = |kind: &str| kind == proposal.kind;
        let model = Model { camera: &camera, prediction: &prediction, named: &state.named };
        let again = session
            .propose(session.fit.frames(), model, &own, UNSETTLED)
            .into_iter()
            .find(|p| !p.beside && p.has_parameters_of(&best.proposal));
        let Some(next) = again.filter(|p| p.strength > UNSETTLED) else { break };
        let (trial, p, c) = try_out(session, state, &best.proposal.updated(next), TRIAL_RUNS)?;
        (prediction, camera) = (p, c);
        if trial.evidence > best.evidence {
            best = trial;
        }
    }
    Ok(best)
}

/// Of the deviance of the statistics that a change moves, the share that it removes; 1 where it
/// moves none by much. Halves with the prediction before and after.
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
