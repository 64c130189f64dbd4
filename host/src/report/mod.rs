//! What people look at: self-contained pages.

pub mod curves;
pub mod page;
