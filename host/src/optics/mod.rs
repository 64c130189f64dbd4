//! Lens descriptions and the engine that turns scene radiance into sensor irradiance.

pub mod characterisation;
pub mod interpolate;
pub mod lens;

pub use characterisation::{Characterisation, PsfGrid};
