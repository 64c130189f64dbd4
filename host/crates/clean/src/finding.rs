//! One finding about a capture set, for people and programs.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Something in a capture set that is not the steady behaviour of its sensor.
///
/// Fields are in the alphabetical order of their JSON keys. Frames are counted from 0 within their
/// stack, columns and rows from 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Finding {
    /// Its size, in `unit`; `None` where it has none.
    #[serde(default)]
    pub amount: Option<f64>,
    /// Number of samples, pixels or frames affected.
    pub count: usize,
    /// A sentence that a person can act on.
    pub description: String,
    /// What was done about it.
    pub done: Done,
    /// The frames affected, where it affects particular ones.
    #[serde(default)]
    pub frames: Vec<usize>,
    /// Where particles hit, at most [`MAX_PIXELS`].
    #[serde(default)]
    pub hits: Vec<Hit>,
    /// What it is.
    pub kind: Kind,
    /// Column and row of the pixels affected, at most [`MAX_PIXELS`].
    #[serde(default)]
    pub pixels: Vec<[usize; 2]>,
    /// How often it occurs, for findings that recur.
    #[serde(default)]
    pub rate: Option<Rate>,
    /// Standard error of `amount`.
    #[serde(default)]
    pub std_error: Option<f64>,
    /// Steps of requantised codes: where each begins and its size, DN; one between whole numbers
    /// is the mean of those that alternate.
    #[serde(default)]
    pub steps: Vec<[f64; 2]>,
    /// Whether requantised codes were cut, and not rounded, to those that are left.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub cut: bool,
    /// Unit of `amount`.
    pub unit: String,
    /// Ids of the captures, separated by commas.
    #[serde(rename = "where")]
    pub place: String,
}

/// A particle hit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Hit {
    /// Id of its capture.
    pub capture: String,
    /// Its charge over all pixels, DN.
    pub charge_dn: f64,
    /// Its frame.
    pub frame: usize,
    /// Column and row of its brightest pixel.
    pub pixel: [usize; 2],
}

/// Most pixels and hits that a finding lists.
pub const MAX_PIXELS: usize = 100;

/// Expected number of events in a frame: `per_frame` + `per_s` × exposure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Rate {
    /// Events per frame that do not depend on exposure.
    pub per_frame: f64,
    /// Its standard error.
    pub per_frame_std_error: f64,
    /// Events per second of exposure, 1/s; `None` where all exposures are equal.
    pub per_s: Option<f64>,
    /// Its standard error.
    pub per_s_std_error: Option<f64>,
}

/// What a finding is. Displayed as in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Kind {
    /// Frames that are copies of others.
    IdenticalFrames,
    /// Samples that are all multiples of a step.
    CodeStep,
    /// Samples on codes whose distance depends on the level.
    Requantised,
    /// Samples that pile up at a code below the white level of the manifest.
    TopCode,
    /// Frames that a camera filtered or compressed.
    ProcessedFrames,
    /// Frames whose rows from some row on are of another exposure.
    TornFrames,
    /// Events in single frames: cosmic rays, radioactivity.
    ParticleHits,
    /// Pixels that change once within a stack.
    DefectsAppear,
    /// A stack whose light or exposure differs from the manifest.
    LightLabel,
    /// A lamp that changes within stacks.
    LampDrift,
    /// The first frames of stacks differ from the rest.
    StartUp,
    /// Stacks of unknown temperature.
    Temperature,
}

/// What was done about a finding. Displayed as in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Done {
    /// The samples were excluded; estimates stand in for them.
    Excluded,
    /// Frames or labels were corrected for it.
    Corrected,
    /// The model must include it.
    Modelled,
    /// It was reported, and nothing else was done.
    Reported,
    /// The set cannot be used with it.
    Refused,
}

// serde can write a unit variant to a formatter, so the words exist once.
impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

impl fmt::Display for Done {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

impl Finding {
    /// A finding without figures.
    pub fn new(kind: Kind, place: impl Into<String>, done: Done) -> Self {
        Self {
            amount: None,
            count: 0,
            description: String::new(),
            done,
            frames: Vec::new(),
            hits: Vec::new(),
            kind,
            pixels: Vec::new(),
            rate: None,
            std_error: None,
            steps: Vec::new(),
            cut: false,
            unit: String::new(),
            place: place.into(),
        }
    }

    /// The same with the number of samples, pixels or frames affected.
    #[must_use]
    pub fn with_count(self, count: usize) -> Self {
        Self { count, ..self }
    }

    /// The same with an amount, its standard error and its unit; NaN stands for unknown.
    #[must_use]
    pub fn with_amount(mut self, value: f64, std_error: f64, unit: &str) -> Self {
        self.amount = Some(value).filter(|v| v.is_finite());
        self.std_error = Some(std_error).filter(|v| v.is_finite());
        self.unit = unit.into();
        self
    }

    /// The same with a description.
    #[must_use]
    pub fn with_description(mut self, description: impl Into<String>) -> Self {
        self.description = description.into();
        self
    }

    /// One line for people: kind, place, description, and what was done.
    pub fn line(&self) -> String {
        format!("{}: {}: {} ({})", self.kind, self.place, self.description, self.done)
    }
}

/// A list of names for a sentence: all of up to five, otherwise the first three and how many more.
pub(crate) fn names(ids: &[&str]) -> String {
    match ids.len() {
        0..=5 => ids.join(", "),
        n => format!("{} and {} more", ids[..3].join(", "), n - 3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn json_has_sorted_keys_and_the_displayed_words_and_is_read_back() {
        let finding = Finding::new(Kind::LightLabel, "flat-3", Done::Corrected)
            .with_amount(1.05, f64::NAN, "1")
            .with_description("too bright");
        let text = serde_json::to_string(&finding).unwrap();
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(text, serde_json::to_string(&value).unwrap());
        assert_eq!((&value["kind"], &value["done"]), (&"light-label".into(), &"corrected".into()));
        assert_eq!(value["where"], "flat-3");
        assert!(value["std_error"].is_null());
        assert_eq!(serde_json::from_str::<Finding>(&text).unwrap(), finding);
        assert_eq!(finding.line(), "light-label: flat-3: too bright (corrected)");
    }

    #[test]
    fn long_lists_of_names_are_shortened() {
        assert_eq!(names(&["a", "b"]), "a, b");
        assert_eq!(names(&["a", "b", "c", "d", "e", "f", "g"]), "a, b, c and 4 more");
    }
}
