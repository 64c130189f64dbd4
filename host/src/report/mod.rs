//! What people look at: self-contained pages.

pub mod lens;
pub mod page;
pub mod plot;
