//! Light and colour. The principal type is [`Illuminant`]: a relative spectrum, by its CIE name,
//! its colour temperature or from a table.
//!
//! [`lamp`]s change with time; [`photometry`] is the CIE's, [`delta_e`] its colour difference, and
//! [`colour`] estimates spectra of colours. A [`LightLevel`] in lux or cd/m² makes it absolute:
//! [`photometry::white_radiance`] is what a perfect white diffuser sends back, W m⁻² sr⁻¹ nm⁻¹.
//!
//! # Example
//! The luminance of a perfect white under fluorescent light of 300 lx, cd/m²:
//! ```
//! use camrig_base::{Bands, Spectrum};
//! use camrig_light::photometry::{KM, white_radiance, xyz};
//! use camrig_light::{Illuminant, LightLevel};
//!
//! let light = Illuminant::parse("F7")?;
//! let white = white_radiance(&light, LightLevel::Lux(300.0), &Bands::VISIBLE)?;
//! let luminance = KM * xyz(&Spectrum::new(Bands::VISIBLE.centres().collect(), white)?)[1];
//! assert!((luminance * std::f64::consts::PI / 300.0 - 1.0).abs() < 0.01);
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod colour;
pub mod delta_e;
pub mod illuminant;
pub mod lamp;
pub mod photometry;

pub use illuminant::Illuminant;
pub use lamp::{Lamp, Lamps};
pub use photometry::LightLevel;
