//! The stacks of a capture set, their conditions, and which half they belong to.

mod alternate;
pub mod channels;
pub mod codes;
pub mod curve;
pub mod design;
pub mod variation;
