//! The sensor stage over irradiance: cubes of spectral irradiance on the sensor grid, and the
//! chain of `camrig-sensor-core` compiled once for the vector instructions of this machine.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod displacement;
pub mod hdr;
mod irradiance;
pub mod parallel;
pub mod rows;
mod sensor;
mod weighted;

pub use displacement::displacement;
pub use irradiance::{Chunk, CubeHeader, IrradianceCube, IrradianceWriter};
pub use sensor::{Arithmetic, FrameOptions, SimulatedSensor, Traps};
pub use weighted::weighted;
