//! The camera file and the checked values made of it.

mod cfa;
pub use cfa::Cfa;
