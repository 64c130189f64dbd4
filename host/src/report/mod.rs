//! What people look at: self-contained pages.

pub mod lens;
pub mod curves;
pub mod page;
pub mod plot;
