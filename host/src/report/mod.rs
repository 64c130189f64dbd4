//! What people look at: self-contained pages.

pub mod diagnosis;
pub mod lens;
pub mod measurement;
pub mod page;
pub mod plot;
pub mod simulation;
