//! Real lenses: a sequential ray tracer.
//!
//! A prescription (surfaces, glasses, stop, fields) is traced with exact rays to the figures and
//! point-spread functions over field and wavelength that the optics engine renders through, a
//! [`camrig_optics::Characterisation`]. Lengths are in mm (PSF spacings in µm), wavelengths in nm,
//! angles in degrees, optical path differences in waves.
//!
//! ```
//! use camrig_lens::prescription::toml;
//! use camrig_lens::{Catalogue, Conditions, System, characterise};
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
//! let system = System::new(lens, Conditions::default())?;
//! println!("focal length {:.2} mm at f/{:.1}", system.paraxial.efl_mm, system.f_number());
//! assert!((system.paraxial.efl_mm - 49.04).abs() < 0.01);
//!
//! let points = characterise::field_points(&system, &[0.0, 10.0], &[587.6])?;
//! println!("rms spot radius on the axis {:.1} µm", 1e3 * points[0].spot_rms_mm);
//! println!("chief ray at 10° lands at {:.3} mm", points[1].chief_ray_height_mm);
//! # Ok::<(), camrig_base::Error>(())
//! ```
//!
//! The stages, each a module: [`prescription`] → [`System`] (paraxial figures, stop) →
//! [`train::Train`] (one wavelength) → [`pupil::Beam`] (one field point, chief ray) →
//! [`pupil::Outline`] (the part of the pupil that the apertures pass) → [`samples::PupilSamples`]
//! (traced rays) → [`psf`]. [`mod@characterise`] runs them over field and wavelength.
//!
//! # Conventions
//! - Lenses are sequential: spheres, conics, even and odd polynomials, Forbes aspheres, ideal thin
//!   lenses, mirrors; no gradient-index media. Plane folds are undone. Biconics, toroids, tilts and
//!   decentres make a lens that is not rotationally symmetric; its figures at field points (x, y)
//!   are those of [`mod@field`], and its characterisation is over the plane of the image
//!   ([`field::characterise`]).
//! - Stop: its real radius is the paraxial image of the entrance pupil in the stop at the
//!   reference wavelength ([`System::stop_radius_mm`]). It is the same for all fields and
//!   wavelengths, and is stored.
//! - Chief ray: the real ray through the centre of the stop, aimed anew for each field and
//!   wavelength.
//! - Field angle: that of the chief ray at the paraxial entrance pupil. For a finite object it
//!   names the object point at (distance to the pupil)·tan θ off the axis.
//! - Distortion: real chief-ray height over EFL·tan θ (finite object: |m|·object height), with EFL
//!   and m paraxial at the reference wavelength. A defocused sensor therefore shows some
//!   distortion even at small fields.
//! - Relative illumination: projected solid angle of the clipped pupil as seen from the image
//!   point over that on the axis, at the same wavelength. It includes cos⁴, vignetting and pupil
//!   aberration.
//! - Light on the axis, with which relative illumination is multiplied in a characterisation over
//!   heights: the projected solid angle of the exit pupil seen from the sensor, which is that of
//!   the light's cone where the sensor is in focus.
//! - PSF: centred on the chief ray of its own wavelength (lateral colour is part of the
//!   distortion), on the image plane, as irradiance per area; each plane wave has the amplitude
//!   √(dE/dL dM).
//! - Optical path difference: to the chief ray, on the sphere around its image point through the
//!   place where it meets the plane of the paraxial exit pupil.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod best_focus;
pub mod characterise;
pub mod field;
mod fold;
pub mod heights;
pub mod ideal;
pub mod paraxial;
mod prepare;
pub mod psf;
pub mod pupil;
mod rays;
mod real_height;
pub mod samples;
pub mod section;
pub mod system;
pub mod tolerance;
pub mod trace;
pub mod train;
mod vergence;

pub use camrig_prescription as prescription;
pub use prescription::{Catalogue, Conditions, Focus, Glass, Prescription, forbes};
pub use system::System;
