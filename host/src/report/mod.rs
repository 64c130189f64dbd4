//! What people look at: self-contained pages.

pub mod curves;
pub mod diagnosis;
pub mod datasheet;
pub mod emva;
pub mod lens;
pub mod page;
pub mod paper;
pub mod plot;
