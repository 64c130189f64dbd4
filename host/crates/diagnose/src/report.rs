//! The report of a diagnosis: `diagnosis.json` as types.
//!
//! Fields are in the order of the file's keys, which is alphabetical. A number that is not finite,
//! or that was not determined, is `null` in the file.

use camrig_base::numbers::with_error;
pub use camrig_clean::Finding;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Name and version of the format.
pub const FORMAT: &str = "diagnosis/1";

/// The result of a diagnosis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Pairs of effects that the captures cannot distinguish.
    pub ambiguous: Vec<Ambiguity>,
    /// Effects by their own statistics, whatever else is left.
    #[serde(default)]
    pub evidence: Vec<Evidence>,
    /// The gap by families of statistics, so that none hides the others.
    #[serde(default)]
    pub families: Vec<FamilyGap>,
    /// [`FORMAT`].
    pub format: String,
    /// Held-out gap of the improved model.
    #[serde(with = "number")]
    pub gap_after: f64,
    /// Held-out gap of the model as given.
    #[serde(with = "number")]
    pub gap_before: f64,
    /// Held-out gap up to which a model passes for the right one.
    #[serde(with = "number")]
    pub gap_limit: f64,
    /// The measures of Chen et al. 2009, section VI.
    pub measures: Measures,
    /// Effects that came nearest, but leave too much unexplained, or do harm elsewhere, to be
    /// named.
    pub nearest: Vec<String>,
    /// Notes on the captures.
    pub notes: Vec<String>,
    /// What was found in the captures that is not the sensor's steady behaviour, and how it was
    /// treated.
    #[serde(default)]
    pub nuisances: Vec<Finding>,
    /// Number of statistics.
    pub statistics: usize,
    /// The effects that were found, in order.
    pub steps: Vec<Step>,
    /// The effect that was named first, where another in its place explains more.
    pub superseded: Option<String>,
    /// Statistics that the improved model leaves unexplained, the furthest first.
    pub unexplained: Vec<Unexplained>,
    /// The verdict.
    pub verdict: Verdict,
}

/// How far a model is from the captures in statistics of one family.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FamilyGap {
    /// Its name in words.
    pub family: String,
    /// Mean square deviation over that of replicates of the model, improved.
    #[serde(with = "number")]
    pub gap_after: f64,
    /// The same of the model as given.
    #[serde(with = "number")]
    pub gap_before: f64,
    /// Number of statistics.
    pub statistics: usize,
    /// The statistic that is furthest from the improved model, in its unit.
    pub worst: String,
}

/// An effect by the statistic that shows it, of dark and flat stacks of one gain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// How much of it is in the captures.
    pub amounts: Vec<Amount>,
    /// The statistic that shows it; of what cannot be decided, why.
    pub description: String,
    /// Captures less model as given, standard errors.
    #[serde(with = "number")]
    pub deviation: f64,
    /// Captures less improved model, standard errors.
    #[serde(with = "number")]
    pub deviation_after: f64,
    /// Its name: that of the catalogue, where it is in the catalogue.
    pub effect: String,
    /// Chance that one of all tests deviates by so much where nothing is hidden.
    #[serde(with = "number")]
    pub false_alarm: f64,
    /// What the evidence says.
    pub status: EvidenceStatus,
}

/// What the evidence says of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EvidenceStatus {
    /// It is there.
    Named,
    /// It is there, and the captures show a part of what it is.
    InPart,
    /// Its statistic deviates, and the effects that were named explain that.
    Explained,
    /// The captures cannot decide.
    NotDecidable,
    /// Its statistic is as the model predicts.
    Absent,
}

impl EvidenceStatus {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Named => "named",
            Self::InPart => "named in part",
            Self::Explained => "explained by others",
            Self::NotDecidable => "not decidable",
            Self::Absent => "absent",
        }
    }
}

/// An amount in the captures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Amount {
    /// What it is.
    pub name: String,
    /// Its standard error.
    #[serde(with = "number")]
    pub std_error: f64,
    /// Its unit.
    pub unit: String,
    /// Its value.
    #[serde(with = "number")]
    pub value: f64,
}

impl Evidence {
    /// Whether it names its effect.
    pub fn is_named(&self) -> bool {
        matches!(self.status, EvidenceStatus::Named | EvidenceStatus::InPart)
    }

    /// Its amounts in one line.
    pub fn amounts_in_words(&self) -> String {
        let of = |a: &Amount| {
            let unit = if a.unit == "1" { "" } else { &a.unit };
            let value = with_error(a.value, Some(a.std_error));
            format!("{} {value} {unit}", a.name).trim_end().to_owned()
        };
        self.amounts.iter().map(of).collect::<Vec<_>>().join(", ")
    }
}

/// The verdict in one word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Nothing is missing.
    Agrees,
    /// The effects that were found explain the captures.
    Explained,
    /// The effects that were found help, but something is left.
    PartlyExplained,
    /// No effect of the catalogue helps.
    Unexplained,
}

impl Verdict {
    /// The word in `diagnosis.json`.
    pub fn word(self) -> &'static str {
        match self {
            Verdict::Agrees => "agrees",
            Verdict::Explained => "explained",
            Verdict::PartlyExplained => "partly-explained",
            Verdict::Unexplained => "unexplained",
        }
    }

    /// Whether the model, improved or not, explains the captures.
    pub fn is_explained(self) -> bool {
        matches!(self, Verdict::Agrees | Verdict::Explained)
    }
}

/// Two effects that the captures cannot distinguish.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ambiguity {
    /// The one that was named, and its rival.
    pub effects: [String; 2],
    /// The captures that would distinguish them.
    pub tie_breaker: String,
}

/// One effect that was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Of what was proposed: exponents of its amount on exposure and signal; 0 where it does not
    /// depend on one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dependence: Option<Dependence>,
    /// Of what was proposed: what it is, how much and where, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
    /// Of what was proposed: what of the sensor it is in.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub domain: Option<Domain>,
    /// Its kind; [`EMPIRICAL`] of what was proposed.
    pub effect: String,
    /// Fall of the deviance of the frames to fit.
    #[serde(with = "number")]
    pub evidence: f64,
    /// Fall of the deviance of the held-out frames.
    #[serde(with = "number")]
    pub evidence_held_out: f64,
    /// Share of the deviance of the statistics it moves that it removes.
    #[serde(with = "number")]
    pub explains: f64,
    /// Held-out gap after it.
    #[serde(with = "number")]
    pub gap_after: f64,
    /// Held-out gap before it.
    #[serde(with = "number")]
    pub gap_before: f64,
    /// Its parameters by key, in the units of the catalogue.
    pub parameters: BTreeMap<String, Parameter>,
    /// The next best candidates of its round.
    pub runners_up: Vec<RunnerUp>,
    /// Of what was proposed: its shape.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<Form>,
    /// Of what was proposed: what it looks like, measured and in the models.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shown: Option<Shown>,
    /// Whether held-out frames agree.
    pub status: Status,
    /// The statistic that it moved most, with its deviation before and after.
    #[serde(rename = "where")]
    pub place: String,
}

/// A curve, or a coarse map, of what was proposed: in the frames to fit, and in frames simulated
/// by the model as given and by the improved one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Shown {
    /// Places along a curve, in the unit that `x` names; empty of a map.
    pub at: Vec<f64>,
    /// Columns of a map, whose values are row by row; none of a curve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<usize>,
    /// Values in the frames to fit; `null` where there is none.
    pub measured: Vec<Option<f64>>,
    /// The same of the improved model.
    pub model_after: Vec<Option<f64>>,
    /// The same of the model as given.
    pub model_before: Vec<Option<f64>>,
    /// What lies along the curve, with its unit.
    pub x: String,
    /// What is shown, with its unit.
    pub y: String,
}

/// Name in `diagnosis.json` of an effect that no catalogue has.
pub const EMPIRICAL: &str = "empirical";

/// What of the sensor a proposed effect is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Domain {
    /// What every frame has, e⁻.
    Offset,
    /// The response to light, relative.
    Gain,
    /// The rate of dark charge, e⁻/s.
    Dark,
    /// What is new in every frame, e⁻.
    Temporal,
    /// The signal over the light.
    Response,
}

/// The shape of a proposed effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Form {
    /// A step between two parts of the sensor.
    Seam,
    /// A plane wave.
    Wave,
    /// Common to a row, with a profile along it.
    RowProfile,
    /// Common to a column, with a profile along it.
    ColumnProfile,
    /// Common to a row, alike along it.
    RowFlat,
    /// Common to a column, alike along it.
    ColumnFlat,
    /// Follows itself from pixel to pixel.
    Correlation,
    /// A law over pixels.
    Distribution,
    /// A step of the response at a signal.
    SignalStep,
    /// The first frames after a start.
    FrameCurve,
}

/// How the amount of a proposed effect depends on the conditions: exponents.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dependence {
    /// On the exposure.
    #[serde(with = "number")]
    pub exposure: f64,
    /// On the signal.
    #[serde(with = "number")]
    pub signal: f64,
}

/// Whether an effect is confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// The model with it explains the held-out frames, and no rival does.
    Confirmed,
    /// It helps, but something is left, or a rival explains as much.
    Tentative,
    /// No effect of the catalogue: a shape that was found in the frames, fitted, and seen again in
    /// the held-out ones.
    Proposed,
}

impl Status {
    /// The word in `diagnosis.json`.
    pub fn word(self) -> &'static str {
        match self {
            Status::Confirmed => "confirmed",
            Status::Tentative => "tentative",
            Status::Proposed => "proposed",
        }
    }
}

/// A parameter of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Its standard error; none where the value was chosen rather than fitted.
    pub std_error: Option<f64>,
    /// Its value.
    #[serde(with = "number")]
    pub value: f64,
}

/// A candidate that came next.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunnerUp {
    /// Its kind.
    pub effect: String,
    /// Fall of the deviance of the frames to fit.
    #[serde(with = "number")]
    pub evidence: f64,
    /// Held-out gap with it.
    #[serde(with = "number")]
    pub gap_after: f64,
}

/// A statistic left unexplained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unexplained {
    /// A sentence that a person can act on.
    pub description: String,
    /// Measured on the frames to fit, in the statistic's own unit.
    pub measured: Option<f64>,
    /// Predicted by the improved model.
    pub predicted: Option<f64>,
    /// Its name.
    pub statistic: String,
    /// Where it was taken.
    #[serde(rename = "where")]
    pub place: String,
    /// Deviation of both halves together, standard deviations, to two decimals.
    #[serde(with = "number")]
    pub z: f64,
}

/// The measures of Chen et al. 2009, section VI, on held-out frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measures {
    /// Of each ColorChecker.
    pub luminance_scatter: Vec<LuminanceScatter>,
    /// Of each edge and channel.
    pub mtf_at_nyquist: Vec<MtfAtNyquist>,
    /// Of each ColorChecker.
    pub row_profile: Vec<RowProfile>,
}

/// MTF at half a cycle per pixel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MtfAtNyquist {
    /// By the improved model.
    #[serde(with = "number")]
    pub after: f64,
    /// By the model as given.
    #[serde(with = "number")]
    pub before: f64,
    /// Id of the capture.
    pub capture: String,
    /// Name of the channel.
    pub channel: String,
    /// In the held-out frames.
    #[serde(with = "number")]
    pub measured: f64,
    /// Standard deviation of a measurement.
    #[serde(with = "number")]
    pub std_dev: f64,
}

/// Mean absolute difference between measured and predicted standard deviation of the luminance in
/// the patches of a ColorChecker, per cent: over all patches, and without the paper's four dark
/// ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LuminanceScatter {
    /// Of the improved model.
    #[serde(with = "numbers")]
    pub after: [f64; 2],
    /// Of the model as given.
    #[serde(with = "numbers")]
    pub before: [f64; 2],
    /// Id of the capture.
    pub capture: String,
    /// What another sensor that the improved model is right for would give.
    #[serde(with = "numbers")]
    pub expected: [f64; 2],
}

/// Root mean square difference between measured and predicted row, DN.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RowProfile {
    /// Of the improved model.
    #[serde(with = "number")]
    pub after: f64,
    /// Of the model as given.
    #[serde(with = "number")]
    pub before: f64,
    /// Id of the capture.
    pub capture: String,
}

/// How far a model is from captures, statistic by statistic.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// Whether the model passes for the right one.
    pub agrees: bool,
    /// Held-out gap.
    #[serde(with = "number")]
    pub gap: f64,
    /// Held-out gap up to which a model passes for the right one.
    #[serde(with = "number")]
    pub gap_limit: f64,
    /// Every statistic, the furthest first.
    pub statistics: Vec<Compared>,
}

/// One statistic of a comparison.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Compared {
    /// Measured on the frames to fit, in the statistic's own unit.
    pub measured: Option<f64>,
    /// Predicted for them.
    pub predicted: Option<f64>,
    /// Its name.
    pub statistic: String,
    /// Where it was taken.
    #[serde(rename = "where")]
    pub place: String,
    /// Deviation of the frames to fit, standard deviations.
    pub z_fit: Option<f64>,
    /// Deviation of the held-out frames, standard deviations.
    pub z_held_out: Option<f64>,
}

impl Ambiguity {
    /// Both effects as they stand in `diagnosis.json`.
    pub fn names(&self) -> String {
        serde_json::to_string(&self.effects).unwrap_or_default()
    }
}

impl Report {
    /// The text of `diagnosis.json`, without a line end.
    pub fn json(&self) -> String {
        // Strings and numbers alone: nothing in it can fail to be written.
        serde_json::to_string_pretty(self).unwrap_or_default()
    }

    /// Effects that came nearest, in a sentence; none where there are none.
    pub fn nearest_in_words(&self) -> Option<String> {
        (!self.nearest.is_empty()).then(|| {
            let kinds = self.nearest.join(", ");
            format!(
                "nearest in the catalogue, but leaving too much unexplained to be named: {kinds}"
            )
        })
    }
}

impl Comparison {
    /// As one JSON object, without a line end.
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_default()
    }
}

/// A number that is `null` where it is not finite.
pub(crate) mod number {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        value.is_finite().then_some(*value).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
    }
}

/// Two numbers that are `null` where they are not finite.
mod numbers {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(values: &[f64; 2], serializer: S) -> Result<S::Ok, S::Error> {
        values.map(|v| v.is_finite().then_some(v)).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; 2], D::Error> {
        let values = <[Option<f64>; 2]>::deserialize(deserializer)?;
        Ok(values.map(|v| v.unwrap_or(f64::NAN)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> Report {
        let value = Parameter { std_error: Some(0.01), value: 0.4 };
        let chosen = Parameter { std_error: None, value: 2.0 };
        let parameters =
            [("sigma_e", value), ("exponent", chosen)].map(|(key, p)| (key.to_string(), p));
        Report {
            ambiguous: vec![Ambiguity {
                effects: ["system-gain".into(), "quantum-efficiency".into()],
                tie_breaker: "flats".into(),
            }],
            evidence: Vec::new(),
            families: Vec::new(),
            format: FORMAT.into(),
            gap_after: 1.0,
            gap_before: 15.25,
            gap_limit: 1.27,
            measures: Measures {
                luminance_scatter: vec![LuminanceScatter {
                    after: [4.0, f64::NAN],
                    before: [7.5, 8.0],
                    capture: "chart".into(),
                    expected: [5.0, 5.0],
                }],
                mtf_at_nyquist: Vec::new(),
                row_profile: Vec::new(),
            },
            nearest: vec!["defocus".into()],
            notes: Vec::new(),
            nuisances: Vec::new(),
            statistics: 450,
            steps: vec![Step {
                dependence: None,
                description: None,
                domain: None,
                effect: "row-correlated-noise".into(),
                evidence: 100.0,
                evidence_held_out: 90.5,
                explains: f64::NAN,
                gap_after: 1.0,
                gap_before: 15.25,
                parameters: parameters.into(),
                runners_up: Vec::new(),
                shape: None,
                shown: None,
                status: Status::Confirmed,
                place: "capture dark".into(),
            }],
            superseded: None,
            unexplained: Vec::new(),
            verdict: Verdict::PartlyExplained,
        }
    }

    #[test]
    fn keys_are_sorted_and_numbers_that_are_not_finite_are_null() {
        let text = report().json();
        let sorted: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(text, serde_json::to_string_pretty(&sorted).unwrap());
        assert_eq!(sorted["verdict"], Verdict::PartlyExplained.word());
        assert_eq!(sorted["steps"][0]["status"], Status::Confirmed.word());
        assert!(sorted["steps"][0]["explains"].is_null());
        assert!(sorted["measures"]["luminance_scatter"][0]["after"][1].is_null());
    }

    #[test]
    fn what_was_written_is_read_again() {
        let text = report().json();
        let again: Report = serde_json::from_str(&text).unwrap();
        assert!(again.steps[0].explains.is_nan());
        assert_eq!(again.json(), text);
    }
}
