//! What people look at: self-contained pages.

pub mod page;
