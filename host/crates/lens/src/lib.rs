//! Real lenses: prescriptions and their files, a sequential ray tracer, and importers for the
//! results of other lens programs.
//!
//! A prescription (surfaces, glasses, stop, fields) is traced with exact rays to the figures and
//! point-spread functions over field and wavelength that the optics engine renders through, a
//! [`camrig_optics::Characterisation`]. Lengths are in mm (PSF spacings in µm), wavelengths in nm,
//! angles in degrees, optical path differences in waves.
//!
//! ```
//! use camrig_lens::{Catalogue, Conditions, System, characterise, toml};
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
//! The stages, each a module: [`read_prescription`] → [`System`] (paraxial figures, stop) →
//! [`train::Train`] (one wavelength) → [`pupil::Beam`] (one field point, chief ray) →
//! [`pupil::Outline`] (the part of the pupil that the apertures pass) → [`samples::PupilSamples`]
//! (traced rays) → [`psf`]. [`mod@characterise`] runs them over field and wavelength; [`import`]
//! reads what other programs computed.
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
pub mod forbes;
pub mod frame;
pub mod heights;
pub mod ideal;
pub mod import;
pub mod paraxial;
pub mod prescription;
pub mod psf;
pub mod pupil;
mod real_height;
pub mod samples;
pub mod section;
pub mod seq;
mod setup;
pub mod system;
pub mod tolerance;
pub mod toml;
pub mod trace;
pub mod train;
pub mod zmx;

#[cfg(test)]
mod tests;

pub use camrig_glass::{Catalogue, Glass};
pub use prescription::Prescription;
pub use setup::Setup;
pub use system::{Conditions, System};

use camrig_base::{Error, Result};
use camrig_glass::files;
use camrig_glass::text::read_text;
use std::path::Path;

/// Reads a prescription: `.zmx` (Zemax), `.seq` (CODE V) or `.toml` ([`toml`]), by extension. Glass
/// catalogues (`.agf`) in its folder are known to it. [`Setup`] says more about how it is read.
///
/// # Errors
/// An unknown extension; what is wrong in the file, with its line.
pub fn read_prescription(path: &Path, glasses: &Catalogue) -> Result<Prescription> {
    read_configuration(path, glasses, None)
}

/// Reads a prescription in one of its configurations.
fn read_configuration(
    path: &Path,
    glasses: &Catalogue,
    configuration: Option<&str>,
) -> Result<Prescription> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let known = extension.as_deref().filter(|e| ["zmx", "seq", "toml"].contains(e));
    let extension = known.ok_or_else(|| {
        Error::unsupported(format!("{} is no lens prescription", path.display()))
            .help("known are .zmx (Zemax), .seq (CODE V) and .toml")
    })?;
    let glasses = files::beside(path, glasses)?;
    let text = read_text(path)?;
    let read = match extension {
        "zmx" => zmx::read_configuration(&text, &glasses, configuration),
        "seq" => seq::read_position(&text, &glasses, configuration),
        _ => only_configuration(configuration).and_then(|()| toml::read(&text, &glasses)),
    };
    let mut prescription = read.map_err(|e| e.at(path.display()))?;
    if prescription.name.is_empty() {
        let stem = path.file_stem().unwrap_or_default();
        prescription.name = stem.to_string_lossy().into_owned();
    }
    Ok(prescription)
}

/// Refuses a kind of lens that the tracer does not know.
fn refuse(what: &str) -> Result<()> {
    Err(Error::unsupported(format!("{what} cannot be traced")).help(
        "lenses that form an image by conics, polynomials, Forbes aspheres, biconics, toroids and \
         mirrors are traced, tilted and decentred too",
    ))
}

/// Refuses a configuration other than the first of a file that has one.
fn only_configuration(wanted: Option<&str>) -> Result<()> {
    match wanted {
        None | Some("1") => Ok(()),
        Some(name) => Err(Error::input(format!("no configuration \"{name}\""))
            .help("the file has one configuration; leave the choice out")),
    }
}
