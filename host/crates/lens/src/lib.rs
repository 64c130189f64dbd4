//! Real lenses: prescriptions and the programs' files that hold them, our sequential ray tracer, and
//! importers of what other lens programs computed.
//!
//! [`read_prescription`] → [`System`] (paraxial figures, stop) → [`train::Train`] (one wavelength) →
//! [`pupil::Beam`] (one field point, chief ray) → [`pupil::Outline`] (what the apertures let through) →
//! [`samples::PupilSamples`] (traced rays) → [`psf`]; [`characterise`] runs them over field and
//! wavelength.
//!
//! # Conventions
//! - Rotationally symmetric sequential lenses: spheres, conics, even and odd polynomials, mirrors; no
//!   tilts, no gradient index. Lengths in mm, wavelengths in nm, angles in degrees.
//! - Stop: its real radius is the paraxial image of the entrance pupil in the stop at the reference
//!   wavelength ([`System::stop_radius_mm`]), the same for all fields and wavelengths; it is stored.
//! - Chief ray: the real ray through the centre of the stop, aimed per field and wavelength.
//! - Field angle: of the chief ray at the paraxial entrance pupil. For a finite object it names the
//!   object point (distance to the pupil)·tan θ off the axis.
//! - Distortion: real chief-ray height over EFL·tan θ (finite object: |m|·object height), EFL and m
//!   paraxial at the reference wavelength. A defocused sensor therefore shows some at small fields.
//! - Relative illumination: projected solid angle of the clipped pupil seen from the image point over that
//!   on the axis, at the same wavelength. cos⁴, vignetting and pupil aberration are all in it.
//! - PSF: centred on the chief ray of its own wavelength (lateral colour is in the distortion), on the
//!   image plane, irradiance per area; amplitude √(dE/dL dM) per plane wave.
//! - Optical path difference: to the chief ray, on the sphere around its image point through the place where it
//!   meets the paraxial exit pupil's plane.

pub mod characterise;
pub mod glass;
pub mod heights;
pub mod import;
pub mod paraxial;
pub mod prescription;
pub mod psf;
pub mod pupil;
pub mod samples;
pub mod seq;
pub mod system;
mod text;
pub mod toml;
pub mod trace;
pub mod train;
pub mod zmx;

#[cfg(test)]
mod tests;

pub use glass::{Catalogue, Glass};
pub use prescription::Prescription;
pub use system::{Conditions, System};

use camrig_base::{Error, Result};
use std::path::Path;

/// Reads a prescription: `.zmx` (Zemax), `.seq` (CODE V) or `.toml` ([`toml`]), by extension.
///
/// # Errors
/// An unknown extension; what is wrong in the file, with its line.
pub fn read_prescription(path: &Path, glasses: &Catalogue) -> Result<Prescription> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let reader = match extension.as_deref() {
        Some("zmx") => zmx::read,
        Some("seq") => seq::read,
        Some("toml") => toml::read,
        _ => {
            return Err(Error::input(format!("{} is no lens prescription", path.display()))
                .help("known are .zmx (Zemax), .seq (CODE V) and .toml"));
        }
    };
    let mut prescription =
        reader(&text::read_text(path)?, glasses).map_err(|e| e.at(path.display()))?;
    if prescription.name.is_empty() {
        let stem = path.file_stem().unwrap_or_default();
        prescription.name = stem.to_string_lossy().into_owned();
    }
    Ok(prescription)
}
