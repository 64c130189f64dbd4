//! The whole search: forward selection and backward elimination, once, and again where an effect
//! taken early may have displaced better ones; then the parameters with their standard errors.

use super::backward::{self, FEW_EFFECTS, REESTIMATED_EFFECTS};
use super::forward::{self, Step};
use super::refit::refit;
use super::session::{RUNS, RUNS_ON_THE_WAY, Session, State};
use super::standard_errors::settle_parameters;
use super::trial::Trial;
use crate::candidates::proposal::with_all;
use crate::finding::Finding;
use camrig_base::Result;
use camrig_camera::Camera;

/// Share of the winner's evidence from which a rival of its round may explain more beside effects
/// that had not yet been taken.
const CLOSE_RIVAL: f64 = 0.5;

/// What the search found.
#[derive(Clone)]
pub struct Outcome {
    /// The model at the start.
    pub before: State,
    /// The model at the end. What it predicts is of the parameters that the frames to fit gave;
    /// those of its effects are the final ones, of all frames.
    pub after: State,
    /// Effects in the order in which they were found.
    pub steps: Vec<Step>,
    /// Held-out gap at the start and at the end.
    pub gaps: (f64, f64),
    /// Kinds that came nearest where none explains enough.
    pub nearest: Vec<String>,
    /// Kinds that the captures cannot tell apart: one that was named, and its rival.
    pub confounded: Vec<(String, String)>,
    /// The kind that was named at first, where the search that begins without it explains more.
    pub superseded: Option<String>,
    /// What no effect of the catalogue describes: taken out of what was measured before the names
    /// were given, and run by the model at the end.
    pub shapes: Vec<Finding>,
    /// Held-out gap of the model at the start with those alone; NaN where there are none.
    pub gap_with_shapes: f64,
}

/// Searches for the effects that the camera lacks. `without` names kinds left out of the
/// catalogue; `say` hears what is being tried.
///
/// # Errors
/// A model that cannot be simulated.
pub fn run(
    session: &Session,
    camera: &Camera,
    without: &[String],
    say: &(dyn Fn(&str) + Sync),
) -> Result<Outcome> {
    say("replicates of the model");
    let before = session.state(camera.clone(), Vec::new(), RUNS)?;
    run_from(session, before, without, say)
}

/// The same from a model that was simulated before.
///
/// # Errors
/// Those of [`run`].
pub fn run_from(
    session: &Session,
    before: State,
    without: &[String],
    say: &(dyn Fn(&str) + Sync),
) -> Result<Outcome> {
    // What a camera did to its frames is no effect of its sensor.
    let known = |kind: &str| !session.processed && !without.iter().any(|w| w == kind);
    let search = |wanted: &dyn Fn(&str, usize) -> bool| once(session, &before, wanted, say);
    let mut found = search(&|kind, _| known(kind))?;
    // An effect taken early may have stood for two that are better together: the search with it as
    // a later one only.
    if let Some((dominated, at)) = dominated(session, &before.camera, &found)? {
        let other = search(&|kind, names| known(kind) && (kind != dominated || names > at))?;
        if session.deviance(&other.after) < session.deviance(&found.after) {
            found = Outcome { superseded: Some(dominated), ..other };
        }
    }
    // One effect may take at once what two others explain better together, or what it explains
    // only beside another: the search without it, and with it as a later one only.
    if found.steps.len() <= FEW_EFFECTS && !session.accepts(&found.after, found.gaps.1) {
        let named = found.steps.iter().map(|s| s.trial.proposal.kind.to_string());
        let doubtful: Vec<String> = named.chain(found.nearest.iter().cloned()).collect();
        let ways = |kind: String| [(kind.clone(), usize::MAX), (kind, 1)];
        for (kind, from) in doubtful.into_iter().take(FEW_EFFECTS).flat_map(ways) {
            let other = search(&|k, names| known(k) && (k != kind || names >= from))?;
            if !other.steps.is_empty() && session.accepts(&other.after, other.gaps.1) {
                found = Outcome { superseded: Some(kind), ..other };
                break;
            }
        }
    }
    say("standard errors");
    settle_parameters(session, &mut found.after)?;
    for step in &mut found.steps {
        let kind = step.trial.proposal.kind;
        if let Some(p) = found.after.named.iter().find(|p| p.kind == kind) {
            step.trial.proposal = p.clone();
        }
    }
    Ok(found)
}

/// Forward selection and backward elimination, once. `wanted` tells whether a kind may be taken
/// beside so many names.
fn once(
    session: &Session,
    before: &State,
    wanted: &dyn Fn(&str, usize) -> bool,
    say: &(dyn Fn(&str) + Sync),
) -> Result<Outcome> {
    let selection = forward::select(session, before, wanted, say)?;
    let left = backward::eliminate(session, before, selection)?;
    Ok(Outcome {
        gaps: (session.gap(before), session.gap(&left.state)),
        before: before.clone(),
        after: left.state,
        steps: left.steps,
        nearest: left.nearest,
        confounded: left.confounded,
        superseded: None,
        shapes: Vec::new(),
        gap_with_shapes: f64::NAN,
    })
}

/// An effect that is dominated by a close rival of its round: in its place, beside those taken
/// later, the rival explains more. Also how many effects were taken before it.
fn dominated(
    session: &Session,
    camera: &Camera,
    found: &Outcome,
) -> Result<Option<(String, usize)>> {
    let steps = &found.steps;
    if steps.len() > REESTIMATED_EFFECTS {
        return Ok(None);
    }
    // The rivals of the last effect lost to it with all others in place.
    for (at, step) in steps.iter().enumerate().take(steps.len().saturating_sub(1)) {
        let own = step.trial.proposal.kind;
        let close = |t: &&Trial| {
            t.evidence > CLOSE_RIVAL * step.trial.evidence
                && !found.after.named.iter().any(|p| p.kind == t.proposal.kind)
        };
        let Some(rival) = step.others.iter().find(close) else { continue };
        let mut named = found.after.named.clone();
        named.retain(|p| p.kind != own);
        rival.proposal.clone().join(&mut named);
        let with_rival = with_all(camera, &named);
        // Both by as many replicates: more of them make every deviation larger.
        let other = refit(session, session.state(with_rival, named, RUNS_ON_THE_WAY)?)?;
        let own_model = found.after.by(session, RUNS_ON_THE_WAY)?;
        if session.deviance(&other) < session.deviance(&own_model) {
            return Ok(Some((own.to_string(), at)));
        }
    }
    Ok(None)
}
