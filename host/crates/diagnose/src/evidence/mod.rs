//! The input of an estimator: measured statistics and those that the present model predicts, the
//! moments and maps they come from, and simulated derivatives of the figures of targets.

mod side_by_side;
mod slopes;

pub use side_by_side::{Evidence, slope};
pub use slopes::{Slope, Slopes};
