//! camrig: a camera-system simulator for hardware-in-the-loop benches of image signal processors.
//!
//! A facade: each module is a crate of its own, bottom up as in `ARCHITECTURE.md`, which has the data
//! flow with units. The command line ([`cli`]) and the live page of a rig ([`view`]) are here.

pub mod cli;
pub mod prelude;
pub mod view;

pub use camrig_base::{Error, ErrorKind, Plane, RawFrame, Result, alternatives, output, toml_text};
pub use camrig_batch as batch;
pub use camrig_calibrate as calibrate;
pub use camrig_camera as camera;
pub use camrig_capture as capture;
pub use camrig_captures as captures;
pub use camrig_diagnose as diagnose;
pub use camrig_exposure as exposure;
pub use camrig_formats as formats;
pub use camrig_lens as lens;
pub use camrig_measure as measure;
pub use camrig_optics as optics;
pub use camrig_render as render;
pub use camrig_report as report;
pub use camrig_rig as rig;
pub use camrig_scene as scene;
pub use camrig_validate as validate;
