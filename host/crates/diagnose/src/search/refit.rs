//! All named effects estimated anew, with all of them in the model.

use super::session::{Session, State};
use crate::candidates::proposal::{Proposal, with_all};
use camrig_base::Result;
use camrig_camera::Camera;

/// Rounds of estimates of several names, which depend on each other; a single name was settled
/// when it was tried.
const ROUNDS: usize = 2;
/// Standard errors by which a parameter must differ for its estimate to be taken.
const MIN_CHANGE: f64 = 1.0;

/// Estimates every named effect again with all of them in the model, as long as that makes the
/// frames to fit likelier. Other models get as many replicates as this one has.
pub(super) fn refit(session: &Session, mut state: State) -> Result<State> {
    for _ in 0..if state.named.len() > 1 { ROUNDS } else { 1 } {
        let is_named = |kind: &str| state.named.iter().any(|p| p.kind == kind);
        let all = session.propose(session.fit.frames(), state.model(), &is_named, MIN_CHANGE);
        let mut named = state.named.clone();
        let mut moved = false;
        for p in &mut named {
            if let Some(next) = all.iter().find(|a| estimates(a, p)) {
                // Each name gets its own new values; those that it would revise are named too.
                *p = Proposal { revised: Default::default(), ..p.updated(next.clone()) };
                moved = true;
            }
        }
        if !moved {
            break;
        }
        let camera = with_all(&without_added(&state), &named);
        let next = session.state(camera, named, state.runs())?;
        if session.fit.deviance(&next.fit) >= session.fit.deviance(&state.fit) {
            break;
        }
        state = next;
    }
    Ok(state)
}

/// Whether a proposal is an estimate of a named effect.
pub(super) fn estimates(proposal: &Proposal, named: &Proposal) -> bool {
    proposal.kind == named.kind && !proposal.beside && proposal.has_parameters_of(named)
}

/// The camera of a state without the effects that stand beside others of their kind, so that the
/// named ones can be put in again: all others replace those of their kind.
pub(super) fn without_added(state: &State) -> Camera {
    let mut camera = state.camera.clone();
    for p in state.named.iter().filter(|p| p.beside) {
        for effect in &p.effects {
            if let Some(at) = camera.effects.iter().position(|x| x == effect) {
                camera.effects.remove(at);
            }
        }
    }
    camera
}
