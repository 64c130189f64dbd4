//! The result of a search: the verdict, the report with its sentences, and the improved camera
//! file.

mod ambiguity;
mod compile;
mod describe;
mod families;
pub mod improved;
mod measures;
mod whereabouts;
pub mod words;

pub use ambiguity::next_plan;
pub use compile::{comparison, report};
