//! The whole search: forward selection and backward elimination; again from where a rival of an
//! effect explains more in its place; then the parameters with their standard errors.

use super::backward;
use super::evaluation::{Evaluation, RUNS};
use super::exchange::{Exchanges, exchanges};
use super::forward::{self, Found, Rivals, Selection, Step};
use super::standard_errors::settle_parameters;
use crate::candidates::gain::greens_look_like_columns;
use crate::candidates::proposal::Proposal;
use crate::finding::Finding;
use crate::measured::Measured;
use camrig_base::Result;
use camrig_camera::Camera;

/// Most exchanges of an effect for a rival of its round.
const MAX_EXCHANGES: usize = 3;

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
    /// The kind that was named first, where a rival in its place explains more.
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
    let search = |start: Selection| once(measured, &before, start, &known, trying);
    let has_seeds = !seeded.steps.is_empty();
    let mut found = search(seeded)?;
    // What stands out by itself may be part of an effect that has no evidence of its own, as a glow
    // is dark current too.
    if has_seeds && !found.after.passes() {
        let other = search(Selection::empty(before.clone()))?;
        if other.after.deviance() < found.after.deviance() {
            found = other;
        }
    }
    for _ in 0..MAX_EXCHANGES {
        let so_far =
            Found { model: &found.after, steps: &found.steps, confounded: &found.confounded };
        let Exchanges { best, as_good } = exchanges(measured, &before.camera, so_far)?;
        let other = match best {
            Some((start, displaced)) => Some((search(start)?, displaced)),
            None => None,
        };
        match other.filter(|(o, _)| o.after.deviance() < found.after.deviance()) {
            Some((other, displaced)) => {
                found = Outcome { superseded: Some(displaced), ..other };
            }
            None => {
                found.confounded.extend(as_good);
                break;
            }
        }
    }
    if greens_look_like_columns(&before.camera.sensor.cfa, &measured.fit.design)
        && found.after.named.iter().any(|p| p.kind == "green-imbalance")
    {
        let [taken, rival] = ["green-imbalance", "readout-channel-mismatch"].map(String::from);
        found.confounded.retain(|pair| pair.taken != taken || pair.rival != rival);
        found.confounded.push(Rivals { taken, rival });
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

/// Forward selection and backward elimination, once. `wanted` is whether a kind may be added.
fn once(
    measured: &Measured,
    before: &Evaluation,
    start: Selection,
    wanted: &dyn Fn(&str) -> bool,
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
