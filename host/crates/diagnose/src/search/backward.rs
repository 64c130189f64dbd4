//! Backward elimination: removes named effects that are not needed beside the others, and those
//! that leave gross deviations in what they should explain.

use super::chance::stands_out;
use super::forward::{Selection, Step};
use super::refit::{estimates, refit};
use super::session::{Half, Model, RUNS, RUNS_ON_THE_WAY, Session, State};
use super::trial::{EVIDENCE_IN_ALL, TRIAL_RUNS};
use crate::candidates::proposal::{MIN_STRENGTH, Proposal, with_all};
use crate::model::prediction::{Prediction, bounded};
use crate::statistics::statistic::{Key, Place, What};
use camrig_base::Result;
use camrig_camera::Camera;
use std::f64::consts::FRAC_1_SQRT_2;

/// Up to so many names must explain everything: a sensor with many effects leaves something of
/// each, while one or two names that leave much are the nearest in the catalogue to something
/// outside it. On hidden sets with effects outside the catalogue (`docs/diagnosis.md`).
pub(super) const FEW_EFFECTS: usize = 2;
/// Up to so many names, each is left out once with the others estimated anew, which costs sixteen
/// replicates each.
pub(super) const REESTIMATED_EFFECTS: usize = 4;
/// Rise of the deviance of both halves below which an effect is not missed: half of what earns a
/// place.
const MISSED: f64 = EVIDENCE_IN_ALL / 2.0;
/// Standard errors by which another effect's parameter must change to take over what one
/// explained.
const TAKES_OVER: f64 = 2.0;
/// Deviation, standard deviations of both halves together, that is gross: no chance and no detail
/// of a law, but another effect.
const GROSS_DEVIATION: f64 = 10.0;
/// Share of an effect's evidence that gross deviations in the statistics it moves may have.
const GROSS_SHARE: f64 = 0.1;
/// Share of the held-out gap that named effects must close where something is left.
const MIN_CLOSED: f64 = 0.75;
/// Held-out gap above which few names do not fit: deviations of twice what chance gives.
const LARGEST_GAP_OF_FEW: f64 = 4.0;

/// What is left after elimination.
pub(super) struct Elimination {
    /// The model.
    pub state: State,
    /// Effects that stay, in the order in which they were found.
    pub steps: Vec<Step>,
    /// Pairs of kinds that the captures cannot tell apart, of which the first stays.
    pub confounded: Vec<(String, String)>,
    /// Kinds that came nearest, but leave too much to be named.
    pub nearest: Vec<String>,
}

/// Removes effects that are not needed, and those that do not fit. `before` is the model at the
/// start.
pub(super) fn eliminate(
    session: &Session,
    before: &State,
    selection: Selection,
) -> Result<Elimination> {
    let Selection { state, mut steps, mut confounded } = selection;
    let mut state = state.by(session, RUNS)?;
    let base = &before.camera;
    // A single effect that targets gave was tried on its likelihood alone.
    if steps.len() > 1 || steps.iter().any(|s| !s.trial.proposal.of_targets) {
        state = drop_unneeded(session, base, state, &mut steps)?;
    }
    if state.named.iter().any(|p| p.of_targets) {
        // Derivatives at the model that the search has come to.
        session.forget_slopes();
        state = refit(session, state)?;
    }
    let mut nearest = Vec::new();
    state = drop_misfits(session, base, state, &mut steps, &mut nearest)?;
    if !steps.is_empty() && is_misfit(session, before, &state, steps.len()) {
        nearest.extend(steps.drain(..).map(|s| s.trial.proposal.kind.to_string()));
        state = before.clone();
    }
    // Neither an effect that was removed nor a rival that is named too leaves a question.
    let named = |kind: &String| steps.iter().any(|s| s.trial.proposal.kind == kind);
    confounded.retain(|(taken, rival)| named(taken) && !named(rival));
    Ok(Elimination { state, steps, confounded, nearest })
}

/// Whether so many names leave so much that the data do not support them.
fn is_misfit(session: &Session, before: &State, after: &State, names: usize) -> bool {
    let (gap_before, gap_after) = (session.gap(before), session.gap(after));
    let closed = (gap_before - gap_after) / (gap_before - 1.0).max(1e-9);
    let misfit = closed < MIN_CLOSED || names <= FEW_EFFECTS && gap_after > LARGEST_GAP_OF_FEW;
    misfit && !session.unexplained(after).is_empty()
}

/// Removes effects without which both halves are about as likely, or that do not stand out from
/// what chance makes of their estimator; the first named first.
fn drop_unneeded(
    session: &Session,
    base: &Camera,
    mut state: State,
    steps: &mut Vec<Step>,
) -> Result<State> {
    let mut i = 0;
    while i < state.named.len() {
        match without(session, base, &state, i)? {
            Some(without) => {
                let left_out = state.named[i].kind;
                let own = |s: &Step| s.trial.proposal.kind == left_out;
                if let Some(at) = steps.iter().position(own) {
                    steps.remove(at);
                }
                state = without;
            }
            None => i += 1,
        }
    }
    Ok(state)
}

/// The model without its named effect `i`, the others estimated anew, if the effect is not needed.
fn without(session: &Session, base: &Camera, state: &State, i: usize) -> Result<Option<State>> {
    let mut named = state.named.clone();
    let left_out = named.remove(i);
    let camera = with_all(base, &named);
    let before = &state.replicates[..TRIAL_RUNS as usize];
    let after = session.replicates(&camera, &session.fit, TRIAL_RUNS)?;
    let fit = state.fit.moved(before, &after);
    let holdout = state.holdout.moved(before, &after);
    let rise = |half: &Half, with: &Prediction, without: &Prediction| {
        half.deviance(without) - half.deviance(with)
    };
    let missed =
        rise(&session.fit, &state.fit, &fit) + rise(&session.holdout, &state.holdout, &holdout);
    let unneeded = missed < MISSED
        || !left_out.of_targets && !stands_out(session, &left_out, &camera, &named, MIN_STRENGTH)?;
    if unneeded {
        return Ok(Some(refit(session, session.state(camera, named, RUNS)?)?));
    }
    // Others may explain what it seems to explain, once they are estimated without it.
    let few = state.named.len() <= REESTIMATED_EFFECTS && !left_out.of_targets;
    if few && would_move(session, Model { camera: &camera, prediction: &fit, named: &named }) {
        let without = refit(session, session.state(camera, named, RUNS_ON_THE_WAY)?)?;
        // Both by as many replicates: more of them make every deviation larger.
        let with = state.by(session, RUNS_ON_THE_WAY)?;
        let missed = session.deviance(&without) - session.deviance(&with);
        return (missed < MISSED).then(|| without.by(session, RUNS)).transpose();
    }
    Ok(None)
}

/// Whether the frames to fit give some of a model's effects other parameters than it has.
fn would_move(session: &Session, model: Model<'_>) -> bool {
    let wanted = |kind: &str| model.named.iter().any(|p| p.kind == kind);
    let anew = session.propose(session.fit.frames(), model, &wanted, 0.0);
    model.named.iter().any(|p| {
        anew.iter().find(|a| estimates(a, p)).is_some_and(|a| {
            std::iter::zip(&a.parameters, &p.parameters)
                .any(|((_, a), (_, p))| (a.value - p.value).abs() > TAKES_OVER * a.se)
        })
    })
}

/// Removes effects that leave gross deviations in the very statistics, or the very map, that they
/// were found in: something else is there, and the effect was the nearest in the catalogue. Their
/// kinds go to `nearest`.
fn drop_misfits(
    session: &Session,
    base: &Camera,
    state: State,
    steps: &mut Vec<Step>,
    nearest: &mut Vec<String>,
) -> Result<State> {
    if steps.len() > FEW_EFFECTS {
        return Ok(state);
    }
    let gross = gross_deviations(session, &state);
    let before = steps.len();
    steps.retain(|step| {
        let near = |key: &Key| {
            let same_map = |k: &Key| k.0 == key.0 && matches!(k.0, Place::Map(_));
            step.touches.iter().any(|k| k == key || same_map(k))
        };
        let left: f64 = gross.iter().filter(|(k, _)| near(k)).map(|(_, z)| bounded(*z)).sum();
        let keep = left < GROSS_SHARE * step.trial.evidence;
        if !keep {
            nearest.push(step.trial.proposal.kind.to_string());
        }
        keep
    });
    if steps.len() == before {
        return Ok(state);
    }
    let named: Vec<Proposal> = state
        .named
        .iter()
        .filter(|p| steps.iter().any(|s| s.trial.proposal.kind == p.kind))
        .cloned()
        .collect();
    let camera = with_all(base, &named);
    refit(session, session.state(camera, named, RUNS)?)
}

/// Gross deviations that a model leaves in both halves.
fn gross_deviations(session: &Session, state: &State) -> Vec<(Key, f64)> {
    // The shape of a map's law beyond its width is reported, but takes no name back.
    let shape = |(place, what): &Key| {
        matches!((place, what), (Place::Map(_), What::Skewness | What::Kurtosis))
    };
    // A single pixel's outlier in one half is chance: few hot pixels have most of a stack's
    // scatter.
    let [fit, holdout] = session.deviations(state);
    let in_each = |key: &Key| {
        let halves = [fit.get(key), session.held_out(*key).and_then(|key| holdout.get(&key))];
        halves.into_iter().flatten().all(|z| z.abs() > GROSS_DEVIATION * FRAC_1_SQRT_2)
    };
    session
        .unexplained(state)
        .into_iter()
        .filter(|(key, z)| z.abs() > GROSS_DEVIATION && in_each(key) && !shape(key))
        .collect()
}
