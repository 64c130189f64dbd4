//! The report of a search, and that of a comparison.

use super::ambiguity::tie_breaker;
use super::describe::describe;
use super::families::families;
use super::measures::measures;
use super::words;
use crate::finding::Finding;
use crate::measured::Measured;
use crate::report::{
    Ambiguity, Compared, Comparison, EMPIRICAL, Evidence, FORMAT, Form, Parameter, Report,
    RunnerUp, Status, Step, Unexplained, Verdict,
};
use crate::search::forward::{self, Moved, Rivals};
use crate::search::{Evaluation, Outcome};
use crate::statistics::statistic::{Key, Place, What};
use camrig_base::Value;
use camrig_base::numbers::counted;
use camrig_clean::Kind;
use std::collections::BTreeMap;

/// Other candidates of a step that are reported, at most.
const RUNNERS_UP: usize = 5;
/// The kind whose amount cannot be distinguished from a temperature.
const DARK_CURRENT: &str = "dark-current";
/// Unexplained statistics that are reported, at most.
const UNEXPLAINED: usize = 12;

/// Judges an outcome by whether the model passes for the right one.
fn judge(measured: &Measured, outcome: &Outcome) -> Verdict {
    let nothing_found = outcome.steps.is_empty() && outcome.shapes.is_empty();
    match (nothing_found, outcome.after.passes()) {
        (true, true) => Verdict::Agrees,
        (true, false) => Verdict::Unexplained,
        (false, true) if measured.can_confirm => Verdict::Explained,
        (false, _) => Verdict::PartlyExplained,
    }
}

/// The report of an outcome.
pub fn report(measured: &Measured, outcome: &Outcome, evidence: Vec<Evidence>) -> Report {
    let verdict = judge(measured, outcome);
    // The model with an effect that has a rival passes, but the model with the rival may pass too.
    let confounded = |kind: &str| {
        outcome.confounded.iter().any(|pair| pair.taken == kind)
            || (kind == DARK_CURRENT && unknown_temperature(measured))
    };
    let start_up_alone = outcome.shapes.iter().all(|s| s.form == Form::FrameCurve);
    let status = |kind: &str| match confounded(kind) {
        // A shape has no known cause: it may include part of an effect that is named with it, or
        // the reverse. No effect of the catalogue varies over the frames as a start-up does.
        false if verdict == Verdict::Explained && start_up_alone => Status::Confirmed,
        _ => Status::Tentative,
    };
    let unexplained = outcome.after.unexplained.iter().take(UNEXPLAINED);
    Report {
        ambiguous: outcome.confounded.iter().map(ambiguity).collect(),
        evidence,
        families: families(measured, outcome),
        format: FORMAT.into(),
        gap_after: outcome.after.gap,
        gap_before: outcome.before.gap,
        gap_limit: outcome.after.limit(),
        measures: measures(measured, outcome),
        nearest: outcome.nearest.clone(),
        notes: (measured.notes.iter().cloned())
            .chain(temperature(measured, outcome))
            .chain(below_quantisation(measured, &outcome.after))
            .collect(),
        nuisances: measured.findings.clone(),
        statistics: outcome.after.fit.of.keys().filter(|key| !key.1.only_bars()).count(),
        steps: steps(measured, outcome, &status),
        superseded: outcome.superseded.clone(),
        unexplained: unexplained.map(|d| left(measured, &outcome.after, d.key, d.z)).collect(),
        verdict,
    }
}

/// Whether a dark current that was found may be due to a temperature that was not given.
fn unknown_temperature(measured: &Measured) -> bool {
    measured.findings.iter().any(|f| f.kind == Kind::Temperature)
}

/// The note on a dark current that was found where the temperature is not known.
fn temperature(measured: &Measured, outcome: &Outcome) -> Option<String> {
    let found = outcome.after.named.iter().find(|p| p.kind == DARK_CURRENT)?;
    if !unknown_temperature(measured) {
        return None;
    }
    let rate = found.parameters.iter().find(|(key, _)| *key == "mean_e_per_s")?.1.value;
    let (sensor, noise) = (&outcome.before.camera.sensor, &outcome.before.camera.sensor.noise);
    let kelvins = noise.dark_doubling_c * libm::log2(rate / noise.dark_current_e_per_s);
    kelvins.is_finite().then(|| {
        format!(
            "the temperature is not given, and dark current and temperature cannot be distinguished: \
             {rate:.3} e⁻/s at {} °C if the sensor was at the camera file's {} °C, or the camera \
             file's {} e⁻/s if it was at {:.1} °C",
            noise.temperature_ref_c,
            sensor.temperature_c,
            noise.dark_current_e_per_s,
            sensor.temperature_c + kelvins,
        )
    })
}

/// The note where samples of the captures change that never do in the model.
fn below_quantisation(measured: &Measured, model: &Evaluation) -> Option<String> {
    let keys = model.fit.never_changes(&measured.fit.values);
    let mut places: Vec<String> =
        keys.iter().map(|k| words::place(&measured.fit.design, *k)).collect();
    places.dedup();
    (!keys.is_empty()).then(|| {
        format!(
            "the model's read noise is below quantisation: its samples never change in {}, those \
             of the captures do, in {} that no standard deviation can be given for; \
             read_e is larger than the camera file's, or brighter darks are needed to determine it",
            places.join(", "),
            counted(keys.len(), "statistic"),
        )
    })
}

fn ambiguity(Rivals { taken, rival }: &Rivals) -> Ambiguity {
    Ambiguity {
        effects: [taken.clone(), rival.clone()],
        tie_breaker: format!("{}; plan in next-captures.toml", tie_breaker(taken, rival)),
    }
}

/// The shapes that were found, and the effects that were named.
fn steps(measured: &Measured, outcome: &Outcome, status: &dyn Fn(&str) -> Status) -> Vec<Step> {
    let proposed = outcome.shapes.iter().map(|shape| proposed(outcome, shape));
    let named = outcome.steps.iter();
    proposed
        .chain(named.map(|s| step(measured, outcome, s, status(s.trial.proposal.kind))))
        .collect()
}

/// A shape as a step. The gaps are those of all shapes together, which were found at once.
fn proposed(outcome: &Outcome, shape: &Finding) -> Step {
    Step {
        dependence: Some(shape.dependence),
        description: Some(shape.description.clone()),
        domain: Some(shape.domain),
        effect: EMPIRICAL.into(),
        evidence: shape.evidence[0],
        evidence_held_out: shape.evidence[1],
        // Compared with residuals of the maps and moments it was found in, not of statistics.
        explains: f64::NAN,
        gap_after: outcome.gap_with_shapes,
        gap_before: outcome.before.gap,
        parameters: parameters(&shape.parameters),
        runners_up: Vec::new(),
        shape: Some(shape.form),
        shown: shape.shown.clone(),
        status: Status::Proposed,
        place: shape.description.clone(),
    }
}

fn step(measured: &Measured, outcome: &Outcome, step: &forward::Step, status: Status) -> Step {
    let nothing = Moved { key: (Place::Set, What::Roughness), before: 0.0, after: 0.0 };
    let Moved { key, before, after } = step.moved.first().copied().unwrap_or(nothing);
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
        parameters: parameters(&step.trial.proposal.parameters),
        runners_up: runners_up.collect(),
        shape: None,
        shown: None,
        status,
        place: format!(
            "{}: {} ({before:+.1} → {after:+.1} standard deviations)",
            words::place(&measured.holdout.design, key),
            words::name(&outcome.after.camera, key)
        ),
    }
}

fn parameters(all: &[(&'static str, Value)]) -> BTreeMap<String, Parameter> {
    let all = all.iter().map(|(key, e)| {
        let std_error = finite(Some(e.std_error));
        ((*key).to_string(), Parameter { std_error, value: e.value })
    });
    all.collect()
}

/// A statistic left unexplained.
fn left(measured: &Measured, model: &Evaluation, key: Key, z: f64) -> Unexplained {
    Unexplained {
        description: describe(measured, model, key, z),
        measured: finite(measured.fit.values.get(&key).map(|s| s.value)),
        predicted: finite(model.fit.of.get(&key).map(|p| p.value)),
        statistic: words::name(&model.camera, key),
        place: words::place(&measured.fit.design, key),
        z: (z * 100.0).round() / 100.0,
    }
}

/// How far a model is from the captures.
pub fn comparison(measured: &Measured, model: &Evaluation) -> Comparison {
    let [fit, holdout] = &model.deviations;
    let held_out = |k: &Key| holdout.get(&measured.held_out(*k)?).copied();
    let both = |k: &Key| (fit.get(k).unwrap_or(&0.0) + held_out(k).unwrap_or(0.0)).abs();
    let mut keys: Vec<Key> = fit.keys().copied().collect();
    keys.sort_by(|a, b| both(b).total_cmp(&both(a)));
    let compared = keys.into_iter().map(|key| Compared {
        measured: finite(measured.fit.values.get(&key).map(|s| s.value)),
        predicted: finite(model.fit.of.get(&key).map(|p| p.value)),
        statistic: words::name(&model.camera, key),
        place: words::place(&measured.fit.design, key),
        z_fit: finite(fit.get(&key).copied()),
        z_held_out: finite(held_out(&key)),
    });
    Comparison {
        agrees: model.passes(),
        gap: model.gap,
        gap_limit: model.limit(),
        statistics: compared.collect(),
    }
}

/// A number, unless it is not finite.
fn finite(value: Option<f64>) -> Option<f64> {
    value.filter(|v| v.is_finite())
}
