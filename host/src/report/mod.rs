//! What people look at: self-contained pages.

pub mod curves;
pub mod datasheet;
pub mod diagnosis;
pub mod emva;
pub mod lens;
pub mod page;
pub mod paper;
pub mod plot;
