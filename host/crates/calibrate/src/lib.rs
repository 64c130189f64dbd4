//! Scenes from a real camera (Chen et al. 2009, section II).
//!
//! - [`exposures`] reads the exposures (s) of one view as mean frames, DN above black; [`ceiling`]
//!   finds where their signals end.
//! - [`response`] fits the camera's response curve, DN against the DN of a linear camera.
//! - [`hdr`] merges the exposures to one linear frame, DN/s, with its standard deviation.
//! - [`view`] takes a linear frame apart into channels and finds a ColorChecker in it.
//! - [`spectral`] estimates reflectance spectra (0 to 1 per band) from the channels,
//!   [`reflectance`] those of a whole view, with the light taken out.
//! - [`files`] are `response.toml` and `hdr.toml`.
//!
//! ```
//! use camrig_base::Bands;
//! use camrig_calibrate::spectral::{Channels, Estimator, NOISE};
//! use camrig_camera::Camera;
//! use camrig_light::Illuminant;
//! use camrig_scene::chart::colorchecker;
//!
//! // What three channels reveal about the first patch of a ColorChecker, dark skin.
//! let bands = Bands::VISIBLE;
//! let table = colorchecker::reflectances();
//! let patches: Vec<Vec<f64>> =
//!     (0..24).map(|i| Ok(table.spectrum(i)?.in_bands(&bands))).collect::<Result<_,
//!     camrig_base::Error>>()?;
//! let camera = Camera::load("mt9v024")?;
//! let light = Illuminant::parse("D65")?.in_bands(&bands);
//! let channels = Channels::new(&camera.sensor.response(&bands), &light)?;
//! let estimator = Estimator::regularised(&channels, &patches, 6, NOISE)?;
//! let estimate = estimator.estimate(&channels.see(&patches[0]));
//! let off = estimate.iter().zip(&patches[0]).map(|(e, p)| (e - p).abs()).fold(0.0, f64::max);
//! assert!(off < 0.1, "{off}");
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod align;
pub mod ceiling;
pub mod exposures;
pub mod files;
pub mod hdr;
pub mod reflectance;
pub mod response;
pub mod spectral;
pub mod view;
