//! What every crate of camrig shares: errors, planes of values, raw frames with their colour filter
//! pattern, spectra, and output files that appear whole or not at all.

pub mod alternatives;
mod cfa;
pub mod choice;
mod error;
mod frame;
pub mod median;
pub mod output;
mod plane;
pub mod platform;
mod spectrum;
pub mod table;
pub mod toml_text;

pub use cfa::Cfa;
pub use error::{Error, ErrorKind, Result};
pub use frame::RawFrame;
pub use plane::Plane;
pub use spectrum::{Bands, Spectrum};
