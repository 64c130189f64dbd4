//! The input of an estimator: measured statistics and those that the present model predicts, the
//! moments and maps they come from, and simulated derivatives of the figures of targets.

mod estimated;
mod side_by_side;
mod slopes;

pub use estimated::{Estimated, pooled, slope};
pub use side_by_side::Evidence;
pub use slopes::{Slope, Slopes};
