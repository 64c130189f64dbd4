//! Lens descriptions and the engine that turns scene radiance into sensor irradiance.

pub mod characterisation;
pub mod diffraction;
pub mod engine;
pub mod fft;
pub mod interpolate;
pub mod lens;

pub use characterisation::{Characterisation, PsfGrid};
pub use diffraction::{Departures, Diffraction, Illumination};
pub use engine::{Blur, Border, Lens, NodeReport, Options, Report, SensorGrid, irradiance};
