//! Real lenses: prescriptions and the programs' files that hold them, and our sequential ray tracer.

pub mod characterise;
pub mod glass;
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
pub mod zmx;

#[cfg(test)]
mod tests;

pub use glass::{Catalogue, Glass};
pub use prescription::Prescription;
pub use system::{Conditions, System};

use crate::{Error, Result};
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
