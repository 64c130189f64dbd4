//! The search: which effects of the catalogue, put into the model, make it agree with the
//! captures?
//!
//! [`evaluation`] simulates a model and compares it with what was measured; evaluations are values
//! that are compared. [`forward`] adds the candidate that explains most until none earns its place,
//! unless a statistic of noise contradicts it (`veto`); [`backward`] removes what is not needed or
//! does not fit; `exchange` puts rivals in the places of effects. [`mod@run`] is the whole of it,
//! and at the end standard errors.

pub mod backward;
mod chance;
mod estimate;
pub mod evaluation;
mod exchange;
pub mod forward;
pub mod run;
mod standard_errors;
pub mod trial;
mod veto;

pub use evaluation::Evaluation;
pub use run::{Known, Outcome, run, run_from};
pub use trial::EVIDENCE_IN_ALL;
