//! What people look at: self-contained pages.

pub mod curves;
pub mod diagnosis;
pub mod lens;
pub mod page;
pub mod plot;
