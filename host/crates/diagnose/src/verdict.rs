//! What is said of a search: `diagnosis.json`.

use super::candidates::{self, Proposal};
use super::prediction::Key;
use super::search::Outcome;
use super::session::{Session, State};
use super::statistics::{Place, Scale, What};
use super::whereabouts::whereabouts;
use super::{measures, model, words};
use serde_json::{Value, json};

/// The verdict in one word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing was missing.
    Agrees,
    /// What was found explains the captures.
    Explained,
    /// What was found helps, but something is left.
    PartlyExplained,
    /// Nothing in the catalogue helps.
    Unexplained,
}

impl Verdict {
    /// As it stands in `diagnosis.json`.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Agrees => "agrees",
            Verdict::Explained => "explained",
            Verdict::PartlyExplained => "partly-explained",
            Verdict::Unexplained => "unexplained",
        }
    }
}

/// Judges an outcome: the right model passes by its held-out gap, and leaves no statistic unexplained.
pub fn judge(session: &Session, outcome: &Outcome) -> Verdict {
    let passes = passes(session, &outcome.after, outcome.gaps.1);
    match (outcome.steps.is_empty(), passes) {
        (true, true) => Verdict::Agrees,
        (true, false) => Verdict::Unexplained,
        (false, true) if session.can_confirm => Verdict::Explained,
        (false, _) => Verdict::PartlyExplained,
    }
}

/// Whether a model passes for the right one.
pub fn passes(session: &Session, state: &State, gap: f64) -> bool {
    gap <= state.limit() && session.unexplained(state).is_empty()
}

/// What came nearest in the catalogue, for people: why it is no name.
pub fn nearest(found: &Value) -> Option<String> {
    let kinds: Vec<&str> = found["nearest"].as_array()?.iter().filter_map(Value::as_str).collect();
    (!kinds.is_empty()).then(|| {
        format!("nearest in the catalogue, but leaving too much to be named: {}", kinds.join(", "))
    })
}

fn number(v: f64) -> Value {
    serde_json::Number::from_f64(v).map_or(Value::Null, Value::Number)
}

/// The parameters of a proposal.
fn parameters(p: &Proposal) -> Value {
    p.parameters
        .iter()
        .map(|(key, e)| {
            ((*key).to_string(), json!({ "value": number(e.value), "std_error": number(e.se) }))
        })
        .collect::<serde_json::Map<_, _>>()
        .into()
}

/// A statistic left unexplained.
fn leftover(session: &Session, state: &State, key: Key, z: f64) -> Value {
    let measured = session.fit.values.get(&key).map(|s| s.value);
    let predicted = state.fit.of.get(&key).map(|p| p.value);
    let statistic = words::name(&state.camera, key);
    let place = words::place(&session.fit.design, key);
    json!({
        "statistic": statistic,
        "where": place,
        "z": number((z * 100.0).round() / 100.0),
        "measured": measured.map(number),
        "predicted": predicted.map(number),
        "description": describe(session, state, key, z, measured, predicted),
    })
}

/// A sentence that a person can act on.
fn describe(
    session: &Session,
    state: &State,
    key: Key,
    z: f64,
    measured: Option<f64>,
    predicted: Option<f64>,
) -> String {
    let (Some(m), Some(p)) = (measured, predicted) else { return String::new() };
    let statistic = words::name(&state.camera, key);
    let place = words::place(&session.fit.design, key);
    let more = if z > 0.0 { "more" } else { "less" };
    let condition = |i: usize| session.fit.design.conditions.get(i);
    let gain = |i| condition(i).map_or(1.0, |c| model::dn_per_e(&state.camera, c.analog_gain));
    let size = match (key.0, key.1) {
        (Place::Stack(i), What::Mean(_)) => {
            let k = gain(i);
            format!(
                "{:.3} DN ({:.2} e⁻) {more} than the model's {p:.2} DN",
                (m - p).abs(),
                (m - p).abs() / k
            )
        }
        (Place::Stack(_), What::Ratio(_)) => {
            format!("{m:.6}, {:.4} % {more} than the model's {p:.6}", 100.0 * (m / p - 1.0).abs())
        }
        (Place::Stack(i), What::Variance(_)) => {
            let k = gain(i);
            let root = (m - p).abs().sqrt();
            format!("{root:.3} DN ({:.2} e⁻) rms {more} noise than the model", root / k)
        }
        (
            Place::Stack(i),
            What::RowVariance | What::ColumnVariance | What::FrameVariance | What::BlockVariance,
        ) => {
            let exposure = condition(i).map_or(0.0, |c| c.exposure_s);
            format!("{m:.3} times what white noise gives, the model {p:.3}, at {exposure} s")
        }
        (Place::Look(i), What::Of(figure)) if figure.is_level() => {
            let gain = session.fit.design.looks.get(i).map_or(1.0, |l| l.analog_gain);
            let k = model::dn_per_e(&state.camera, gain);
            format!(
                "{:.3} DN ({:.2} e⁻) {more} than the model's {p:.2} DN",
                (m - p).abs(),
                (m - p).abs() / k
            )
        }
        _ => match state.fit.of.get(&key).map(|x| x.scale) {
            Some(Scale::Log) => format!(
                "{m:.4e}, {:.1} % {more} than the model's {p:.4e}",
                100.0 * (m / p - 1.0).abs()
            ),
            _ => format!("{m:.4}, the model {p:.4}"),
        },
    };
    let mut sentence = format!("{statistic} in {place}: {size} ({z:+.1} standard deviations)");
    if let Some(more) = whereabouts(session, key) {
        sentence = format!("{sentence}; {more}");
    }
    sentence
}

/// `diagnosis.json`.
pub fn report(session: &Session, outcome: &Outcome) -> Value {
    let verdict = judge(session, outcome);
    // The model of a name with a rival passes, but so may the rival's.
    let rivalled = |kind: &str| outcome.twins.iter().any(|(taken, _)| taken == kind);
    let confirmed = |kind: &str| verdict == Verdict::Explained && !rivalled(kind);
    let steps: Vec<Value> = outcome
        .steps
        .iter()
        .map(|s| {
            let (key, z, after) =
                s.gave_away.first().copied().unwrap_or(((Place::Set, What::Roughness), 0.0, 0.0));
            let where_ = format!(
                "{}: {} ({z:+.1} → {after:+.1} standard deviations)",
                words::place(&session.fit.design, key),
                words::name(&outcome.after.camera, key)
            );
            json!({
                "effect": s.trial.proposal.kind,
                "status": if confirmed(s.trial.proposal.kind) { "confirmed" } else { "tentative" },
                "parameters": parameters(&s.trial.proposal),
                "gap_before": number(s.gap_before),
                "gap_after": number(s.gap_after),
                "evidence": number(s.trial.evidence),
                "evidence_held_out": number(s.trial.confirmed),
                "explains": number(s.trial.explains),
                "where": where_,
                "runners_up": s.others.iter().take(5).map(|o| json!({
                    "effect": o.proposal.kind,
                    "gap_after": number(o.gap),
                    "evidence": number(o.evidence),
                })).collect::<Vec<_>>(),
            })
        })
        .collect();
    let unexplained: Vec<Value> = session
        .unexplained(&outcome.after)
        .into_iter()
        .take(12)
        .map(|(key, z)| leftover(session, &outcome.after, key, z))
        .collect();
    json!({
        "format": "diagnosis/1",
        "verdict": verdict.word(),
        "gap_before": number(outcome.gaps.0),
        "gap_after": number(outcome.gaps.1),
        "gap_limit": number(outcome.after.limit()),
        "statistics": outcome.after.fit.of.len(),
        "steps": steps,
        "ambiguous": outcome.twins.iter().map(|(a, b)| json!({
            "effects": [a, b],
            "tie_breaker": format!("{}; plan in next-captures.toml", tie_breaker(a, b)),
        })).collect::<Vec<_>>(),
        "unexplained": unexplained,
        "nearest": outcome.nearest,
        "doubted": outcome.doubted,
        "measures": measures::measures(session, outcome),
        "notes": session.notes,
    })
}

/// The capture that tells two kinds apart.
fn tie_breaker(a: &str, b: &str) -> &'static str {
    let is = |x: &str, y: &str| (a == x && b == y) || (a == y && b == x);
    let any = |x: &str| a == x || b == x;
    if is("system-gain", "quantum-efficiency") || is("system-gain", "lens-transmittance") {
        "flats over the whole range: variance over mean gives the gain by itself"
    } else if any("optical-crosstalk") && any("defocus") {
        "narrow-band flats under a colour filter array, where crosstalk mixes the channels and defocus does not; \
         or the edge through focus, which moves the blur of defocus alone"
    } else if any("defocus") {
        "edges lying and standing, in the middle and in the corners, at two f-numbers"
    } else if any("decentre-tilt") || any("distortion") || any("lateral-colour") {
        "a grid of dots that fills the frame: radial displacement is the same all around the axis"
    } else if any("veiling-glare") || any("lens-transmittance") {
        "charts with black patches in a bright surround at two illuminances, and flats without the lens"
    } else if is("green-imbalance", "readout-channel-mismatch") {
        "flats by light of a known spectrum: mismatched columns move red against blue, unequal greens do not"
    } else if any("relative-illumination") || any("colour-shading") {
        "flats with and without the lens"
    } else if any("charge-coupling") || any("brighter-fatter") {
        "flats at five and more levels up to full well: the neighbours' correlation is constant or grows with the level"
    } else if any("read-noise-spread")
        || any("random-telegraph-noise")
        || any("heavy-tailed-read-noise")
    {
        "a dark stack of 100 frames and more: kurtosis and memory of the noisiest pixels"
    } else if any("row-correlated-noise") || any("row-temporal-noise") {
        "a dark stack of 64 frames and more: spectrum of row means"
    } else if any("hot-pixels")
        || any("amp-glow")
        || any("dark-current-gradient")
        || any("dark-current")
    {
        "dark stacks at four exposures up to 10 s and two temperatures"
    } else if any("nonlinearity") || any("full-well") || any("exposure-offset") {
        "flats at ten levels by light at one exposure, and at ten exposures in one light"
    } else {
        "twice as many frames of the captures at hand"
    }
}

/// The built-in plan that holds the captures which would tell more.
pub fn next_plan(outcome: &Outcome) -> &'static str {
    let of_looks = |kind: &String| candidates::shown_by_looks(kind);
    match outcome.twins.iter().any(|(a, b)| of_looks(a) || of_looks(b)) {
        true => "optics",
        false => "diagnosis",
    }
}

/// Every statistic of a comparison, the furthest first.
pub fn rows(session: &Session, found: &(State, f64)) -> Vec<Value> {
    let [fit, holdout] = session.deviations(&found.0);
    let both = |k: &Key| (fit.get(k).unwrap_or(&0.0) + holdout.get(k).unwrap_or(&0.0)).abs();
    let mut keys: Vec<Key> = fit.keys().copied().collect();
    keys.sort_by(|a, b| both(b).total_cmp(&both(a)));
    keys.into_iter()
        .map(|key| {
            json!({
                "statistic": words::name(&found.0.camera, key),
                "where": words::place(&session.fit.design, key),
                "z_fit": fit.get(&key).copied().map(number),
                "z_held_out": holdout.get(&key).copied().map(number),
                "measured": session.fit.values.get(&key).map(|s| number(s.value)),
                "predicted": found.0.fit.of.get(&key).map(|p| number(p.value)),
            })
        })
        .collect()
}
