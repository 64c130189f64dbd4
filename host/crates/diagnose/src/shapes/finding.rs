//! What a shape is, how much and where, as figures and in words.

use crate::evidence::Estimated;
use crate::report::{Dependence, Domain, EMPIRICAL, Form, Parameter, Status, Step};

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
            status: Status::Proposed,
            place: self.description.clone(),
        }
    }
}

/// A value with its standard error, to two digits of the error.
pub(super) fn number(e: Estimated) -> String {
    let digits = match e.se.log10().floor() {
        power if power.is_finite() => (1.0 - power).clamp(0.0, 12.0) as usize,
        _ => 3,
    };
    match e.se.is_finite() {
        true => format!("{:.digits$} ± {:.digits$}", e.value, e.se),
        false => format!("{:.digits$}", e.value),
    }
}
