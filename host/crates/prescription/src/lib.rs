//! Lens prescriptions: surfaces, glasses, stop, fields and wavelengths, and how a lens is used.
//!
//! A [`Prescription`] is data, checked; `camrig-lens` traces rays through it. [`mod@toml`] reads
//! one that is written by hand, `camrig-lens-files` those of other programs. A [`Setup`] names a
//! file with the glasses and [`Conditions`] of its use, as a camera file does.
//!
//! ```
//! use camrig_prescription::{Catalogue, toml};
//!
//! let singlet = r#"
//!     format = "camrig-prescription/1"
//!     wavelengths_nm = [486.1, 587.6, 656.3]
//!     fields_deg = [0.0, 10.0]
//!     [aperture]
//!     f_number = 8.0
//!     [[surface]]
//!     radius_mm = 50.0
//!     thickness_mm = 4.0
//!     glass = "N-BK7"
//!     stop = true
//!     [[surface]]
//!     radius_mm = -50.0
//!     thickness_mm = 47.3
//! "#;
//! let lens = toml::read(singlet, &Catalogue::default())?;
//! assert_eq!(lens.surfaces[0].curvature, 0.02);
//! assert_eq!(lens.asymmetry(), None);
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod forbes;
mod model;
mod pose;
mod setup;
pub mod toml;

pub use camrig_glass::{Catalogue, Glass};
pub use model::{
    Aperture, Clip, FieldKind, Fields, Form, Medium, Object, Prescription, Shape, Surface,
};
pub use pose::Pose;
pub use setup::{Conditions, Focus, Setup};
