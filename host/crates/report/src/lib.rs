//! What people look at: self-contained pages.

pub mod datasheet;
pub mod diagnosis;
pub mod emva;
pub mod lens;
pub mod measurement;
pub mod page;
pub mod paper;
pub mod plot;
pub mod simulation;
