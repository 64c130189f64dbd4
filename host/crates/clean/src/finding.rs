//! What was found in a capture set, for people and programs.

use serde::{Deserialize, Serialize};

/// One thing in a capture set that is not the steady behaviour of its sensor.
///
/// Fields are in the order of their keys in JSON, which is alphabetical. Frames are counted from 0
/// within their stack, columns and rows from 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// How large it is, in `unit`; `None` where it is only there or not.
    #[serde(default)]
    pub amount: Option<f64>,
    /// Samples, pixels or frames that it concerns.
    pub count: usize,
    /// A sentence that a person can act on.
    pub description: String,
    /// What was done about it.
    pub done: Done,
    /// Frames that it concerns, where it is certain ones.
    #[serde(default)]
    pub frames: Vec<usize>,
    /// What it is.
    pub kind: Kind,
    /// Columns and rows that it concerns, at most [`MAX_PIXELS`].
    #[serde(default)]
    pub pixels: Vec<[usize; 2]>,
    /// Of what happens again and again: how often, for each stack.
    #[serde(default)]
    pub rate: Option<Rate>,
    /// Standard error of `amount`.
    #[serde(default)]
    pub std_error: Option<f64>,
    /// Unit of `amount`.
    pub unit: String,
    /// Ids of the captures, separated by commas.
    #[serde(rename = "where")]
    pub place: String,
}

/// Pixels that a finding lists, at most.
pub const MAX_PIXELS: usize = 100;

/// How often something happens: `per_frame` + `per_s` × exposure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rate {
    /// Part of each frame, whatever its exposure.
    pub per_frame: f64,
    /// Its standard error.
    pub per_frame_std_error: f64,
    /// Part in proportion to exposure, 1/s; `None` where all exposures are alike.
    pub per_s: Option<f64>,
    /// Its standard error.
    pub per_s_std_error: Option<f64>,
}

/// What a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Frames that are copies of others.
    IdenticalFrames,
    /// Samples that are all multiples of a step.
    CodeStep,
    /// A camera filtered or compressed the frames.
    ProcessedFrames,
    /// Events of single frames: cosmic rays, radioactivity.
    ParticleHits,
    /// Pixels that change once within a stack.
    DefectsAppear,
    /// A stack whose light or exposure is not what the manifest says.
    LightLabel,
    /// The lamp changes within stacks.
    LampDrift,
    /// The first frames of stacks differ.
    StartUp,
    /// Stacks of unknown temperature.
    Temperature,
}

impl Kind {
    /// The word in JSON.
    pub fn word(self) -> &'static str {
        match self {
            Kind::IdenticalFrames => "identical-frames",
            Kind::CodeStep => "code-step",
            Kind::ProcessedFrames => "processed-frames",
            Kind::ParticleHits => "particle-hits",
            Kind::DefectsAppear => "defects-appear",
            Kind::LightLabel => "light-label",
            Kind::LampDrift => "lamp-drift",
            Kind::StartUp => "start-up",
            Kind::Temperature => "temperature",
        }
    }
}

/// What was done about a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Done {
    /// The samples were left out.
    LeftOut,
    /// Frames or labels were corrected for it.
    TakenOff,
    /// The model has it too.
    Modelled,
    /// It was said, and nothing else.
    Said,
    /// Nothing can be judged with it.
    Refused,
}

impl Done {
    /// The word in JSON.
    pub fn word(self) -> &'static str {
        match self {
            Done::LeftOut => "left-out",
            Done::TakenOff => "taken-off",
            Done::Modelled => "modelled",
            Done::Said => "said",
            Done::Refused => "refused",
        }
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
            kind,
            pixels: Vec::new(),
            rate: None,
            std_error: None,
            unit: String::new(),
            place: place.into(),
        }
    }

    /// With an amount, its standard error and its unit.
    #[must_use]
    pub fn amount(mut self, value: f64, std_error: f64, unit: &str) -> Self {
        self.amount = Some(value).filter(|v| v.is_finite());
        self.std_error = Some(std_error).filter(|v| v.is_finite());
        self.unit = unit.into();
        self
    }

    /// With its sentence.
    #[must_use]
    pub fn says(mut self, description: impl Into<String>) -> Self {
        self.description = description.into();
        self
    }

    /// Its line for people: kind, place, sentence, and what was done.
    pub fn line(&self) -> String {
        let (kind, place) = (self.kind.word(), &self.place);
        format!("{kind}: {place}: {} ({})", self.description, self.done.word())
    }
}

/// A few names in a sentence: all of up to five, else the first three and how many more.
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
    fn json_has_the_words_and_sorted_keys_and_is_read_again() {
        let finding = Finding::new(Kind::LightLabel, "flat-3", Done::TakenOff)
            .amount(1.05, f64::NAN, "1")
            .says("too bright");
        let text = serde_json::to_string(&finding).unwrap();
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(text, serde_json::to_string(&value).unwrap());
        assert_eq!((&value["kind"], &value["done"]), (&"light-label".into(), &"taken-off".into()));
        assert_eq!(value["where"], "flat-3");
        assert!(value["std_error"].is_null());
        assert_eq!(serde_json::from_str::<Finding>(&text).unwrap(), finding);
        assert_eq!(finding.line(), "light-label: flat-3: too bright (taken-off)");
    }

    #[test]
    fn many_names_are_shortened() {
        assert_eq!(names(&["a", "b"]), "a, b");
        assert_eq!(names(&["a", "b", "c", "d", "e", "f", "g"]), "a, b, c and 4 more");
    }
}
