//! Taking sets of captures with a simulated camera or a rig: a plan is a list of [`plan::Shot`]s.
//!
//! [`plan`] defines which stacks to take: exposures in s, gains, temperatures in °C, narrow-band
//! light in nm and W m⁻² or as a fraction of saturation, scenes with an illuminant and lx.
//! [`take`] takes them and writes a capture set (`captures.toml` and raw frames in DN, see
//! [`camrig_captures`]). [`mod@bench`] simulates the bench of the crosstalk experiment of Chen et
//! al. 2009: parallel light through filters on a sensor that is turned.
//!
//! # Example
//! ```
//! use camrig_camera::Camera;
//! use camrig_capture::{plan, take};
//! use camrig_captures::CaptureSet;
//!
//! let camera = Camera::load("mt9v024")?.with_size(32, 24)?;
//! let shots = plan::parse(
//!     r#"
//!     format = "plan/1"
//!     [[stack]]
//!     id = "dark"
//!     role = "dark"
//!     frames = 2
//!     exposure_s = 0.01
//!     [[stack]]
//!     id = "flat"
//!     role = "flat"
//!     frames = 2
//!     exposure_s = 0.01
//!     fill = [0.25, 0.5]
//!     light = { wavelength_nm = 550.0 }
//!     "#,
//! )?;
//! let folder = tempfile::tempdir().unwrap();
//! let set = folder.path().join("set");
//! take::take(&camera, &shots, &set, &take::TakeOptions::default(), || ())?;
//! let set = CaptureSet::load(&set)?;
//! let ids: Vec<&str> = set.captures.iter().map(|c| c.id.as_str()).collect();
//! assert_eq!(ids, ["dark", "flat-00", "flat-01"]);
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod bench;
pub mod plan;
pub mod take;
