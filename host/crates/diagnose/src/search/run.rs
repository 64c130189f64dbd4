//! The whole search: forward selection and backward elimination, once, and again where an effect
//! taken early may have displaced better ones; then the parameters with their standard errors.

use super::backward::{self, REESTIMATED_EFFECTS};
use super::estimate::fitted;
use super::evaluation::{Evaluation, RUNS, RUNS_ON_THE_WAY};
use super::forward::{self, Rivals, Selection, Step};
use super::standard_errors::settle_parameters;
use super::trial::Trial;
use crate::candidates::proposal::{Proposal, with_all};
use crate::finding::Finding;
use crate::measured::Measured;
use camrig_base::Result;
use camrig_camera::Camera;

/// Fraction of the winner's evidence from which a rival of its round may explain more together with
/// effects that were added later.
const CLOSE_RIVAL: f64 = 0.5;

/// What is known before a search.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    /// Effects that stand out by their own evidence.
    pub seeds: &'a [Proposal],
    /// Kinds left out of the catalogue.
    pub without: &'a [String],
}

/// What the search found.
#[derive(Clone)]
pub struct Outcome {
    /// The model at the start.
    pub before: Evaluation,
    /// The model at the end. Its predictions were made with the parameters estimated from the
    /// frames to fit; the parameters of its effects are the final ones, from all frames.
    pub after: Evaluation,
    /// Effects in the order in which they were found.
    pub steps: Vec<Step>,
    /// Kinds that came nearest, but do harm elsewhere or leave too much unexplained to be named.
    pub nearest: Vec<String>,
    /// Kinds that the captures cannot distinguish, of which one was named.
    pub confounded: Vec<Rivals>,
    /// The kind that was named first, where a search that begins without it explains more.
    pub superseded: Option<String>,
    /// What no effect of the catalogue describes: subtracted from what was measured before the
    /// search, and simulated by the model at the end.
    pub shapes: Vec<Finding>,
    /// Held-out gap of the model at the start with those alone; NaN where there are none.
    pub gap_with_shapes: f64,
}

/// Searches for the effects that the camera lacks. `trying` receives what is being tried.
///
/// # Errors
/// A model that cannot be simulated.
pub fn run(
    measured: &Measured,
    camera: &Camera,
    known: &Known<'_>,
    trying: &(dyn Fn(&str) + Sync),
) -> Result<Outcome> {
    trying("replicates of the model");
    let before = Evaluation::new(measured, camera.clone(), Vec::new(), RUNS)?;
    run_from(measured, before, known, trying)
}

/// The same from a model that was simulated before.
///
/// # Errors
/// Those of [`run`].
pub fn run_from(
    measured: &Measured,
    before: Evaluation,
    known: &Known<'_>,
    trying: &(dyn Fn(&str) + Sync),
) -> Result<Outcome> {
    // Processing by a camera is not an effect of its sensor.
    let Known { seeds, without } = *known;
    let known = |kind: &str| !measured.processed && !without.iter().any(|w| w == kind);
    trying("effects by their own evidence");
    let seeds: Vec<Proposal> = seeds.iter().filter(|p| known(p.kind)).cloned().collect();
    let seeded = forward::seeded(measured, &before, seeds)?;
    let search = |start: &Selection, wanted: &dyn Fn(&str, usize) -> bool| {
        once(measured, &before, start.clone(), wanted, trying)
    };
    let mut start = seeded;
    let mut found = search(&start, &|kind, _| known(kind))?;
    // What stands out by itself may be part of an effect that has no evidence of its own, as a glow
    // is dark current too.
    if !start.steps.is_empty() && !found.after.passes() {
        let empty = Selection::empty(before.clone());
        let other = search(&empty, &|kind, _| known(kind))?;
        if other.after.deviance() < found.after.deviance() {
            (start, found) = (empty, other);
        }
    }
    // An effect added early may approximate two that are better together: the search with it as a
    // later one only.
    if let Some((dominated, at)) = dominated(measured, &before.camera, &found)? {
        let later = |kind: &str, names: usize| known(kind) && (kind != dominated || names > at);
        let other = search(&start, &later)?;
        if other.after.deviance() < found.after.deviance() {
            found = Outcome { superseded: Some(dominated), ..other };
        }
    }
    trying("standard errors");
    found.after = settle_parameters(measured, found.after)?;
    for step in &mut found.steps {
        let kind = step.trial.proposal.kind;
        if let Some(p) = found.after.named.iter().find(|p| p.kind == kind) {
            step.trial.proposal = p.clone();
        }
    }
    Ok(found)
}

/// Forward selection and backward elimination, once. `wanted` is whether a kind may be added to so
/// many named ones.
fn once(
    measured: &Measured,
    before: &Evaluation,
    start: Selection,
    wanted: &dyn Fn(&str, usize) -> bool,
    trying: &(dyn Fn(&str) + Sync),
) -> Result<Outcome> {
    let selection = forward::select(measured, start, wanted, trying)?;
    let left = backward::eliminate(measured, before, selection)?;
    Ok(Outcome {
        before: before.clone(),
        after: left.model,
        steps: left.steps,
        nearest: left.nearest,
        confounded: left.confounded,
        superseded: None,
        shapes: Vec::new(),
        gap_with_shapes: f64::NAN,
    })
}

/// An effect that is dominated by a close rival of its round: instead of it, together with those
/// added later, the rival explains more. Also how many effects were added before it.
fn dominated(
    measured: &Measured,
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
        // Both with as many replicates: more of them make every deviation larger.
        let other = fitted(measured, with_rival, named, RUNS_ON_THE_WAY)?;
        let own_model = found.after.by(measured, RUNS_ON_THE_WAY)?;
        if other.deviance() < own_model.deviance() {
            return Ok(Some((own.to_string(), at)));
        }
    }
    Ok(None)
}
