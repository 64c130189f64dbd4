//! The search: which effects of the catalogue, put into the model, make it agree with the
//! captures?
//!
//! [`session`] holds what was measured and simulates models. [`forward`] adds the candidate that
//! explains most until none earns its place, unless a statistic of noise contradicts it (`veto`);
//! [`backward`] removes what is not needed or does not fit. [`mod@run`] is the whole of it: both,
//! alternatives where an early effect may have displaced a better one, and at the end standard
//! errors.

pub mod backward;
mod chance;
mod consistency;
pub mod forward;
mod refit;
pub mod run;
pub mod session;
mod standard_errors;
pub mod trial;
mod veto;

pub use run::{Outcome, run, run_from};
pub use session::{Session, State};
pub use trial::EVIDENCE_IN_ALL;
