//! What is diagnosed: the stacks of a capture set, how they were taken, and which half they belong
//! to.

pub mod channels;
pub mod design;
