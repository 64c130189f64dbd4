//! Backward elimination: removes named effects that the others make redundant.

use super::chance::stands_out;
use super::estimate::{estimates, fitted, propose, refit};
use super::evaluation::{Evaluation, Model, RUNS, RUNS_ON_THE_WAY};
use super::forward::{Rivals, Selection, Step};
use super::trial::{EVIDENCE_IN_ALL, TRIAL_RUNS};
use crate::candidates::proposal::{MIN_STRENGTH, with_all};
use crate::measured::Measured;
use camrig_base::Result;
use camrig_camera::Camera;

/// So few effects must explain everything, unless they have evidence of their own: a sensor with
/// many effects leaves a little of each, while one or two that leave much are only similar to an
/// effect outside the catalogue. From hidden sets with such effects (`docs/diagnosis.md`).
const FEW_EFFECTS: usize = 2;
/// Up to so many effects, each is left out once with the others estimated again, which costs
/// sixteen replicates each.
const REESTIMATED_EFFECTS: usize = 4;
/// Increase of the deviance of both halves below which an effect is redundant: half of what makes a
/// candidate significant.
const REDUNDANT: f64 = EVIDENCE_IN_ALL / 2.0;
/// Standard errors by which another effect's parameter must change to explain what a removed one
/// did.
const TAKES_OVER: f64 = 2.0;
/// Fraction of the held-out gap that named effects must close where statistics stay unexplained.
const MIN_CLOSED: f64 = 0.75;
/// Held-out gap up to which few effects fit: deviations of twice those due to chance.
const MAX_GAP_OF_FEW: f64 = 4.0;

/// What is left after elimination.
pub(super) struct Elimination {
    /// The model.
    pub model: Evaluation,
    /// Effects that are kept, in the order in which they were found.
    pub steps: Vec<Step>,
    /// Kinds that the captures cannot distinguish, of which the one taken is kept.
    pub confounded: Vec<Rivals>,
    /// Kinds that came nearest, but do harm elsewhere or leave too much unexplained to be named.
    pub nearest: Vec<String>,
}

/// Removes effects that are not needed. `before` is the model at the start.
pub(super) fn eliminate(
    measured: &Measured,
    before: &Evaluation,
    selection: Selection,
) -> Result<Elimination> {
    let Selection { model, mut steps, mut confounded, barred: mut nearest } = selection;
    let mut model = model.by(measured, RUNS)?;
    let base = &before.camera;
    // A single effect estimated from targets was tried on its likelihood alone.
    if steps.len() > 1 || steps.iter().any(|s| !s.trial.proposal.of_targets) {
        model = drop_unneeded(measured, base, model, &mut steps)?;
    }
    if model.named.iter().any(|p| p.of_targets) {
        // Derivatives at the present model.
        measured.fit.optics.slopes.forget();
        model = refit(measured, model)?;
    }
    if !steps.is_empty() && is_misfit(before, &model, steps.len()) {
        let (kept, misfits): (Vec<Step>, Vec<Step>) =
            steps.into_iter().partition(|s| s.trial.proposal.by_evidence);
        steps = kept;
        nearest.extend(misfits.into_iter().map(|s| s.trial.proposal.kind.to_string()));
        model.named.retain(|p| p.by_evidence);
        model = match model.named.is_empty() {
            true => before.clone(),
            false => fitted(measured, with_all(base, &model.named), model.named, RUNS)?,
        };
    }
    // Neither an effect that was removed nor a rival that is also named is ambiguous.
    let named = |kind: &String| steps.iter().any(|s| s.trial.proposal.kind == kind);
    confounded.retain(|pair| named(&pair.taken) && !named(&pair.rival));
    nearest.retain(|kind| !named(kind));
    Ok(Elimination { model, steps, confounded, nearest })
}

/// Whether so many effects leave so much unexplained that the data do not support those without
/// evidence of their own.
fn is_misfit(before: &Evaluation, after: &Evaluation, names: usize) -> bool {
    let closed = (before.gap - after.gap) / (before.gap - 1.0).max(1e-9);
    let misfit = closed < MIN_CLOSED || names <= FEW_EFFECTS && after.gap > MAX_GAP_OF_FEW;
    misfit && !after.unexplained.is_empty()
}

/// Removes effects without which both halves are about as likely, or whose estimates are not
/// significant against replicates without them; the first named first.
fn drop_unneeded(
    measured: &Measured,
    base: &Camera,
    mut model: Evaluation,
    steps: &mut Vec<Step>,
) -> Result<Evaluation> {
    let mut i = 0;
    while i < model.named.len() {
        match without(measured, base, &model, i)? {
            Some(without) => {
                let left_out = model.named[i].kind;
                let own = |s: &Step| s.trial.proposal.kind == left_out;
                if let Some(at) = steps.iter().position(own) {
                    steps.remove(at);
                }
                model = without;
            }
            None => i += 1,
        }
    }
    Ok(model)
}

/// The model without its named effect `i` and with the others estimated again, if the effect is
/// redundant.
fn without(
    measured: &Measured,
    base: &Camera,
    model: &Evaluation,
    i: usize,
) -> Result<Option<Evaluation>> {
    let mut named = model.named.clone();
    let left_out = named.remove(i);
    let camera = with_all(base, &named);
    let before = &model.replicates[..TRIAL_RUNS as usize];
    let after = measured.fit.replicates(&camera, TRIAL_RUNS)?;
    let fit = model.fit.moved(before, &after);
    let holdout = model.holdout.moved(before, &after);
    let missed = (measured.fit.deviance(&fit) - model.deviances[0])
        + (measured.holdout.deviance(&holdout) - model.deviances[1]);
    let unneeded = missed < REDUNDANT
        || !(left_out.of_targets
            || left_out.by_evidence
            || stands_out(&measured.fit, &left_out, &camera, &named, MIN_STRENGTH)?);
    if unneeded {
        return Ok(Some(fitted(measured, camera, named, RUNS)?));
    }
    // Others may explain what it seems to explain, once they are estimated without it.
    let few = model.named.len() <= REESTIMATED_EFFECTS && !left_out.of_targets;
    if few && would_move(measured, Model { camera: &camera, prediction: &fit, named: &named }) {
        let without = fitted(measured, camera, named, RUNS_ON_THE_WAY)?;
        // Both with as many replicates: more of them make every deviation larger.
        let with = model.by(measured, RUNS_ON_THE_WAY)?;
        let missed = without.deviance() - with.deviance();
        return (missed < REDUNDANT).then(|| without.by(measured, RUNS)).transpose();
    }
    Ok(None)
}

/// Whether the frames to fit would change the parameters of some of a model's effects.
fn would_move(measured: &Measured, model: Model<'_>) -> bool {
    let wanted = |kind: &str| model.named.iter().any(|p| p.kind == kind);
    let anew = propose(&measured.fit, model, &wanted, 0.0);
    model.named.iter().any(|p| {
        anew.iter().find(|a| estimates(a, p)).is_some_and(|a| {
            std::iter::zip(&a.parameters, &p.parameters)
                .any(|((_, a), (_, p))| (a.value - p.value).abs() > TAKES_OVER * a.std_error)
        })
    })
}
