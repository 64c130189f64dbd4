//! Capture sets: raw frames, measured or simulated, with the conditions under which they were
//! taken.
//!
//! A [`CaptureSet`] is a directory with frames and a manifest, `captures.toml`: the only form in
//! which the program reads measured data, and what `camrig capture` writes. [`CaptureSet::load`]
//! reads and checks the manifest; [`CaptureSet::for_each_batch`] reads the frames a few at a time,
//! so that the memory used does not depend on the length of a stack.
//!
//! Samples are DN; exposures are in s, temperatures in °C, irradiance in W m⁻² on the sensor,
//! wavelengths in nm, illuminance in lx on the scene.
//!
//! | in reading order | |
//! |---|---|
//! | `set`, `capture` | the set; a capture with its light, scene and settings |
//! | `manifest` | `captures.toml`: its format, its checks, writing it |
//! | `frames`, `held` | reading frames, in bounded memory; frames that are in memory |
//! | `contradictions` | where files disagree with the manifest |
//! | [`draft`] | a manifest from the files of a folder |
//!
//! ```
//! use camrig_captures::base::Plane;
//! use camrig_captures::formats::{Facts, Format, Frames};
//! use camrig_captures::{CaptureSet, Role};
//!
//! let folder = std::env::temp_dir().join(format!("camrig-captures-{}", std::process::id()));
//! std::fs::create_dir_all(&folder)?;
//! let planes = vec![Plane::filled(8, 6, 42u16), Plane::filled(8, 6, 44u16)];
//! let facts = Facts { bits: Some(10), ..Facts::default() };
//! let bytes = Format::Npy.encode(&Frames { planes, facts })?;
//! std::fs::write(folder.join("dark.npy"), bytes)?;
//! let manifest = r#"
//!     format = "captures/1"
//!     [sensor]
//!     width = 8
//!     height = 6
//!     bits = 10
//!     cfa = "RGGB"
//!     white_level_dn = 1023
//!     [[capture]]
//!     id = "dark"
//!     role = "dark"
//!     files = "dark.npy"
//!     exposure_s = 0.01
//!     analog_gain = 1.0
//! "#;
//! std::fs::write(folder.join("captures.toml"), manifest)?;
//!
//! let set = CaptureSet::load(&folder)?;
//! let dark = set.with_role(Role::Dark).next().expect("a dark stack");
//! let (mut sum, mut samples) = (0.0, 0.0);
//! let frames = set.for_each_batch(dark, |batch| {
//!     for value in batch.iter().flat_map(|frame| &frame.data) {
//!         sum += f64::from(*value);
//!         samples += 1.0;
//!     }
//!     Ok(())
//! })?;
//! assert_eq!((frames, sum / samples), (2, 43.0));
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod capture;
mod contradictions;
pub mod draft;
mod frames;
mod held;
pub mod manifest;
mod set;

pub use camrig_base as base;
pub use camrig_formats as formats;
pub use capture::{Capture, CapturedScene, Light, Role, Rotation, Scan, Split, Uniformity};
pub use frames::{Batches, StoredFrame, open, open_with_facts};
pub use held::Held;
pub use manifest::DraftStack;
pub use set::{CaptureSet, SensorFacts, Window};
