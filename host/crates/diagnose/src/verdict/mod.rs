//! What is said of a search: the verdict, the report, the sentences for people, and the improved
//! camera file.

mod ambiguity;
mod compile;
mod describe;
pub mod improved;
mod measures;
mod whereabouts;
pub mod words;

pub use ambiguity::next_plan;
pub use compile::{comparison, judge, report};
