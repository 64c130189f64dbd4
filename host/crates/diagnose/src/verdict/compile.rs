//! The report of a search, and that of a comparison.

use super::ambiguity::tie_breaker;
use super::describe::describe;
use super::measures::measures;
use super::words;
use crate::candidates::proposal::Proposal;
use crate::finding::Form;
use crate::report::{
    Ambiguity, Compared, Comparison, FORMAT, Parameter, Report, RunnerUp, Status, Step,
    Unexplained, Verdict,
};
use crate::search::forward;
use crate::search::run::Outcome;
use crate::search::session::{Session, State};
use crate::statistics::statistic::{Key, Place, What};
use camrig_base::numbers::counted;
use camrig_clean::Kind;
use std::collections::BTreeMap;

/// Other candidates of a step that are reported, at most.
const RUNNERS_UP: usize = 5;
/// The kind whose amount depends on the temperature as much as on itself.
const DARK_CURRENT: &str = "dark-current";
/// Unexplained statistics that are reported, at most.
const UNEXPLAINED: usize = 12;

/// Judges an outcome by whether the model passes for the right one.
pub fn judge(session: &Session, outcome: &Outcome) -> Verdict {
    let passes = session.accepts(&outcome.after, outcome.gaps.1);
    match (outcome.steps.is_empty() && outcome.shapes.is_empty(), passes) {
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
    let confounded = |kind: &str| {
        outcome.confounded.iter().any(|(taken, _)| taken == kind)
            || (kind == DARK_CURRENT && unknown_temperature(session))
    };
    let start_up_alone = outcome.shapes.iter().all(|s| s.form == Form::FrameCurve);
    let status = |kind: &str| match confounded(kind) {
        // A shape has no cause: it may hold part of what is named beside it, or the reverse. No
        // effect of the catalogue runs over the frames as a start-up does.
        false if verdict == Verdict::Explained && start_up_alone => Status::Confirmed,
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
        notes: (session.notes.iter().cloned())
            .chain(temperature(session, outcome))
            .chain(below_quantisation(session, &outcome.after))
            .collect(),
        nuisances: session.findings.clone(),
        statistics: outcome.after.fit.of.len(),
        steps: steps(session, outcome, &status),
        unexplained: unexplained.map(|(key, z)| left(session, &outcome.after, key, z)).collect(),
        verdict,
    }
}

/// Whether a dark current that was found may be a temperature that was not given.
fn unknown_temperature(session: &Session) -> bool {
    session.findings.iter().any(|f| f.kind == Kind::Temperature)
}

/// Both readings of an odd dark current where the temperature is not known.
fn temperature(session: &Session, outcome: &Outcome) -> Option<String> {
    let found = outcome.after.named.iter().find(|p| p.kind == DARK_CURRENT)?;
    if !unknown_temperature(session) {
        return None;
    }
    let rate = found.parameters.iter().find(|(key, _)| *key == "mean_e_per_s")?.1.value;
    let (sensor, noise) = (&outcome.before.camera.sensor, &outcome.before.camera.sensor.noise);
    let kelvins = noise.dark_doubling_c * libm::log2(rate / noise.dark_current_e_per_s);
    kelvins.is_finite().then(|| {
        format!(
            "the temperature is not given, and dark current and temperature cannot be told apart: \
             {rate:.3} e⁻/s at {} °C if the sensor was at the camera file's {} °C, or the camera \
             file's {} e⁻/s if it was at {:.1} °C",
            noise.temperature_ref_c,
            sensor.temperature_c,
            noise.dark_current_e_per_s,
            sensor.temperature_c + kelvins,
        )
    })
}

/// What is said where samples of the captures change that never do in the model.
fn below_quantisation(session: &Session, state: &State) -> Option<String> {
    let keys = state.fit.never_changes(&session.fit.values);
    let mut places: Vec<String> =
        keys.iter().map(|k| words::place(&session.fit.design, *k)).collect();
    places.dedup();
    (!keys.is_empty()).then(|| {
        format!(
            "the model's read noise is below quantisation: its samples never change in {}, those \
             of the captures do, in {} that no standard deviation can be given for; \
             read_e is larger than the camera file's, or brighter darks are needed to tell",
            places.join(", "),
            counted(keys.len(), "statistic"),
        )
    })
}

fn ambiguity(a: &str, b: &str) -> Ambiguity {
    Ambiguity {
        effects: [a.into(), b.into()],
        tie_breaker: format!("{}; plan in next-captures.toml", tie_breaker(a, b)),
    }
}

/// What was proposed, and the effects that were named beside it.
fn steps(session: &Session, outcome: &Outcome, status: &dyn Fn(&str) -> Status) -> Vec<Step> {
    // All shapes together: those of one sensor are found at once.
    let gaps = (outcome.gaps.0, outcome.gap_with_shapes);
    let proposed = outcome.shapes.iter().map(|shape| shape.step(gaps));
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
        shown: None,
        status,
        place: format!(
            "{}: {} ({before:+.1} → {after:+.1} standard deviations)",
            words::place(&session.holdout.design, key),
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
    let held_out = |k: &Key| holdout.get(&session.held_out(*k)?).copied();
    let both = |k: &Key| (fit.get(k).unwrap_or(&0.0) + held_out(k).unwrap_or(0.0)).abs();
    let mut keys: Vec<Key> = fit.keys().copied().collect();
    keys.sort_by(|a, b| both(b).total_cmp(&both(a)));
    let compared = keys.into_iter().map(|key| Compared {
        measured: finite(session.fit.values.get(&key).map(|s| s.value)),
        predicted: finite(state.fit.of.get(&key).map(|p| p.value)),
        statistic: words::name(&state.camera, key),
        place: words::place(&session.fit.design, key),
        z_fit: finite(fit.get(&key).copied()),
        z_held_out: finite(held_out(&key)),
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
