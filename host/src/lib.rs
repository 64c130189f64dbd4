//! camrig: a camera-system simulator for hardware-in-the-loop benches of image signal processors.
//!
//! Layers, top to bottom; each uses only those below it:
//! `cli` (one file per command) → `report`, `diagnose`, `validate` → `measure` → `render` (scene + camera →
//! irradiance → raw) → `optics`, `scene`, `camera`, `formats` → `sensor-core` (the sensor, in rows).
//! See `ARCHITECTURE.md` for the data flow with units.

pub mod alternatives;
pub mod batch;
pub mod camera;
pub mod captures;
pub mod cli;
pub mod diagnose;
pub mod error;
pub mod formats;
pub mod frame;
pub mod measure;
mod median;
pub mod optics;
pub mod plane;
pub mod render;
pub mod report;
pub mod rig;
pub mod scene;
pub mod toml_text;
pub mod validate;
pub mod view;

pub use error::{Error, Result};
pub use frame::RawFrame;
pub use plane::Plane;
