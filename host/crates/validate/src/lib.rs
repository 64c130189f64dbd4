//! Validates a camera model: its simulated frames are measured like real ones, compared with
//! captured frames, and described by a data sheet.
//!
//! - [`paper`] has the scenes, light levels (lx), exposures (s) and figures of section VI of Chen
//!   et al. 2009: MTF (cycles per pixel), standard deviation of the luminance per ColorChecker
//!   patch (DN), green along a row (DN), defects per million pixels.
//! - [`comparison`] compares a model, captured frames and an improved model in these figures.
//! - [`datasheet`] measures a camera file as a laboratory measures a camera: EMVA 1288 (electrons,
//!   DN, per cent), quantum efficiency (electrons per photon), MTF, positional crosstalk.
//!
//! ```
//! use camrig_validate::camera::Camera;
//! use camrig_validate::datasheet::Datasheet;
//!
//! // The EMVA 1288 figures of a preset, on a small piece of its sensor.
//! let mut camera = Camera::load("mt9v024")?;
//! camera.sensor.noise.read_e = 30.0;
//! let sheet = Datasheet::measure(&camera, (64, 48))?;
//! let green = &sheet.emva.channels[1].figures;
//! let dark_noise_e = green.temporal_dark_noise_e.expect("above the noise of rounding");
//! assert!((dark_noise_e.value / 30.0 - 1.0).abs() < 0.1);
//! # Ok::<(), camrig_validate::base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub use camrig_base as base;
pub use camrig_camera as camera;

pub mod comparison;
pub mod datasheet;
pub mod paper;
