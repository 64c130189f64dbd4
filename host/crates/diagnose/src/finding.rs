//! What no effect of the catalogue describes: what it is, how much and where, as figures and in
//! words. `camrig-shapes` finds it.

use crate::evidence::Estimated;
use crate::report::{Parameter, Shown, Status, Step};
use serde::{Deserialize, Serialize};

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
    #[serde(with = "crate::report::number")]
    pub exposure: f64,
    /// On the signal.
    #[serde(with = "crate::report::number")]
    pub signal: f64,
}

/// A shape that was found.
#[derive(Clone, Debug)]
pub struct Finding {
    /// What of the sensor it is in.
    pub domain: Domain,
    /// Its shape.
    pub form: Form,
    /// How its amount depends on the conditions.
    pub dependence: Dependence,
    /// Figures by key, with the unit at its end.
    pub parameters: Vec<(&'static str, Estimated)>,
    /// Twice the gain in log-likelihood of the frames to fit and of the held-out frames.
    pub evidence: [f64; 2],
    /// In words, with units.
    pub description: String,
    /// What it looks like, once the improved model is there.
    pub shown: Option<Shown>,
}

impl Finding {
    /// As a step of the report, where the held-out gap went from the first to the second.
    pub fn step(&self, gaps: (f64, f64)) -> Step {
        let parameters = self.parameters.iter().map(|(key, e)| {
            let std_error = Some(e.se).filter(|se| se.is_finite());
            ((*key).to_string(), Parameter { std_error, value: e.value })
        });
        Step {
            dependence: Some(self.dependence),
            description: Some(self.description.clone()),
            domain: Some(self.domain),
            effect: EMPIRICAL.into(),
            evidence: self.evidence[0],
            evidence_held_out: self.evidence[1],
            // Set against what is left of the maps and moments it was found in, not of statistics.
            explains: f64::NAN,
            gap_after: gaps.1,
            gap_before: gaps.0,
            parameters: parameters.collect(),
            runners_up: Vec::new(),
            shape: Some(self.form),
            shown: self.shown.clone(),
            status: Status::Proposed,
            place: self.description.clone(),
        }
    }
}

/// A value with its standard error, to two digits of the error.
pub fn number(e: Estimated) -> String {
    let digits = match libm::log10(e.se).floor() {
        power if power.is_finite() => (1.0 - power).clamp(0.0, 12.0) as usize,
        _ => 3,
    };
    match e.se.is_finite() {
        true => format!("{:.digits$} ± {:.digits$}", e.value, e.se),
        false => format!("{:.digits$}", e.value),
    }
}
