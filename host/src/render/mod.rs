//! Rendering: scene + camera → irradiance cube → raw frames.
//!
//! The optics stage writes an [`IrradianceCube`] once; [`Exposure`] turns it into frames, so that another
//! light level, exposure, gain, frame number or sensor seed never runs the optics again.

mod expose;
mod irradiance;

pub use expose::{Arithmetic, Exposure};
pub use irradiance::{CubeHeader, IrradianceCube, IrradianceWriter};
