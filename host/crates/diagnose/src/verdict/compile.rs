//! The report of a search, and that of a comparison.

use super::ambiguity::tie_breaker;
use super::describe::describe;
use super::measures::measures;
use super::words;
use crate::candidates::proposal::Proposal;
use crate::report::{
    Ambiguity, Compared, Comparison, FORMAT, Parameter, Report, RunnerUp, Status, Step,
    Unexplained, Verdict,
};
use crate::search::forward;
use crate::search::run::Outcome;
use crate::search::session::{Session, State};
use crate::statistics::statistic::{Key, Place, What};
use std::collections::BTreeMap;

/// Other candidates of a step that are reported, at most.
const RUNNERS_UP: usize = 5;
/// Unexplained statistics that are reported, at most.
const UNEXPLAINED: usize = 12;

/// Judges an outcome by whether the model passes for the right one.
pub fn judge(session: &Session, outcome: &Outcome) -> Verdict {
    let passes = session.accepts(&outcome.after, outcome.gaps.1);
    // A shape that was found is told, but is not in the model: the model does not explain it.
    if !outcome.shapes.is_empty() {
        return Verdict::PartlyExplained;
    }
    match (outcome.steps.is_empty(), passes) {
        (true, true) => Verdict::Agrees,
        (true, false) => Verdict::Unexplained,
        (false, true) if session.can_confirm => Verdict::Explained,
        (false, _) => Verdict::PartlyExplained,
    }
}

/// The report of an outcome.
pub fn report(session: &Session, outcome: &Outcome) -> Report {
    let verdict = judge(session, outcome);
    // The model with an effect that has a rival passes, but so may the model with the rival.
    let status = |kind: &str| match outcome.confounded.iter().any(|(taken, _)| taken == kind) {
        false if verdict == Verdict::Explained => Status::Confirmed,
        _ => Status::Tentative,
    };
    let unexplained = session.unexplained(&outcome.after).into_iter().take(UNEXPLAINED);
    Report {
        ambiguous: outcome.confounded.iter().map(|(a, b)| ambiguity(a, b)).collect(),
        doubted: outcome.superseded.clone(),
        format: FORMAT.into(),
        gap_after: outcome.gaps.1,
        gap_before: outcome.gaps.0,
        gap_limit: outcome.after.limit(),
        measures: measures(session, outcome),
        nearest: outcome.nearest.clone(),
        notes: session.notes.clone(),
        statistics: outcome.after.fit.of.len(),
        steps: steps(session, outcome, &status),
        unexplained: unexplained.map(|(key, z)| left(session, &outcome.after, key, z)).collect(),
        verdict,
    }
}

fn ambiguity(a: &str, b: &str) -> Ambiguity {
    Ambiguity {
        effects: [a.into(), b.into()],
        tie_breaker: format!("{}; plan in next-captures.toml", tie_breaker(a, b)),
    }
}

/// What was proposed, and the effects that were named beside it.
fn steps(session: &Session, outcome: &Outcome, status: &dyn Fn(&str) -> Status) -> Vec<Step> {
    // All shapes are taken out at once: the gap after them is that of the model as given.
    let taken_out = (outcome.gaps.0, session.gap(&outcome.before));
    let proposed = outcome.shapes.iter().map(|shape| shape.step(taken_out));
    let named = outcome.steps.iter();
    proposed
        .chain(named.map(|s| step(session, outcome, s, status(s.trial.proposal.kind))))
        .collect()
}

fn step(session: &Session, outcome: &Outcome, step: &forward::Step, status: Status) -> Step {
    let nothing = ((Place::Set, What::Roughness), 0.0, 0.0);
    let (key, before, after) = step.moved.first().copied().unwrap_or(nothing);
    let runners_up = step.others.iter().take(RUNNERS_UP).map(|o| RunnerUp {
        effect: o.proposal.kind.into(),
        evidence: o.evidence,
        gap_after: o.gap,
    });
    Step {
        dependence: None,
        description: None,
        domain: None,
        effect: step.trial.proposal.kind.into(),
        evidence: step.trial.evidence,
        evidence_held_out: step.trial.confirmed,
        explains: step.trial.explains,
        gap_after: step.gap_after,
        gap_before: step.gap_before,
        parameters: parameters(&step.trial.proposal),
        runners_up: runners_up.collect(),
        shape: None,
        status,
        place: format!(
            "{}: {} ({before:+.1} → {after:+.1} standard deviations)",
            words::place(&session.fit.design, key),
            words::name(&outcome.after.camera, key)
        ),
    }
}

fn parameters(p: &Proposal) -> BTreeMap<String, Parameter> {
    let all = p.parameters.iter().map(|(key, e)| {
        let std_error = finite(Some(e.se));
        ((*key).to_string(), Parameter { std_error, value: e.value })
    });
    all.collect()
}

/// A statistic left unexplained.
fn left(session: &Session, state: &State, key: Key, z: f64) -> Unexplained {
    Unexplained {
        description: describe(session, state, key, z),
        measured: finite(session.fit.values.get(&key).map(|s| s.value)),
        predicted: finite(state.fit.of.get(&key).map(|p| p.value)),
        statistic: words::name(&state.camera, key),
        place: words::place(&session.fit.design, key),
        z: (z * 100.0).round() / 100.0,
    }
}

/// How far a model is from the captures, with its held-out gap.
pub fn comparison(session: &Session, state: &State, gap: f64) -> Comparison {
    let [fit, holdout] = session.deviations(state);
    let both = |k: &Key| (fit.get(k).unwrap_or(&0.0) + holdout.get(k).unwrap_or(&0.0)).abs();
    let mut keys: Vec<Key> = fit.keys().copied().collect();
    keys.sort_by(|a, b| both(b).total_cmp(&both(a)));
    let compared = keys.into_iter().map(|key| Compared {
        measured: finite(session.fit.values.get(&key).map(|s| s.value)),
        predicted: finite(state.fit.of.get(&key).map(|p| p.value)),
        statistic: words::name(&state.camera, key),
        place: words::place(&session.fit.design, key),
        z_fit: finite(fit.get(&key).copied()),
        z_held_out: finite(holdout.get(&key).copied()),
    });
    Comparison {
        agrees: session.accepts(state, gap),
        gap,
        gap_limit: state.limit(),
        statistics: compared.collect(),
    }
}

/// A number, unless it is not finite.
fn finite(value: Option<f64>) -> Option<f64> {
    value.filter(|v| v.is_finite())
}
