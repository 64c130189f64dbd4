//! A shape that no effect of the catalogue describes: what it is, how much and where, as figures
//! and in words. [`crate::shapes`] finds it.

use crate::report::{Dependence, Domain, Form, Shown};
use camrig_base::Value;

/// A shape that was found.
#[derive(Clone, Debug)]
pub struct Finding {
    /// The quantity of the sensor that it affects.
    pub domain: Domain,
    /// Its shape.
    pub form: Form,
    /// How its amount depends on the conditions.
    pub dependence: Dependence,
    /// Figures by key, with the unit at its end.
    pub parameters: Vec<(&'static str, Value)>,
    /// Twice the gain in log-likelihood of the frames to fit and of the held-out frames.
    pub evidence: [f64; 2],
    /// In words, with units.
    pub description: String,
    /// Its plot, once the improved model was simulated.
    pub shown: Option<Shown>,
}

impl Finding {
    /// A shape in a quantity, whose amount depends on the conditions as that quantity does.
    pub(crate) fn new(domain: Domain, form: Form, evidence: [f64; 2]) -> Self {
        let on = |quantity| f64::from(u8::from(domain == quantity));
        let dependence = Dependence { exposure: on(Domain::Dark), signal: on(Domain::Gain) };
        let (parameters, description) = (Vec::new(), String::new());
        Self { domain, form, dependence, parameters, evidence, description, shown: None }
    }
}

/// A value with its standard error, to two digits of the error.
pub fn number(e: Value) -> String {
    let digits = match libm::log10(e.std_error).floor() {
        power if power.is_finite() => (1.0 - power).clamp(0.0, 12.0) as usize,
        _ => 3,
    };
    match e.std_error.is_finite() {
        true => format!("{:.digits$} ± {:.digits$}", e.value, e.std_error),
        false => format!("{:.digits$}", e.value),
    }
}
