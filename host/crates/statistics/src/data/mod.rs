//! What is diagnosed: the stacks of a capture set, how they were taken, and which half they belong
//! to.

mod alternate;
pub mod channels;
pub mod codes;
pub mod course;
pub mod design;
