//! Lenses in files: prescriptions of other programs for `camrig-lens` to trace, and
//! characterisations that those programs computed.
//!
//! [`prescription`] and [`system`] read what a [`Setup`] names: `.zmx` of OpticStudio ([`zmx`]),
//! `.seq` of CODE V ([`seq`]) or the TOML of `camrig-prescription`. [`import`] reads ISETCam
//! ray-trace sets, tables and listings; scripts in `contrib/lens-programs` make lens programs write
//! them.
//!
//! # Example
//! A singlet of which the camera is focused at half a metre:
//! ```
//! use camrig_prescription::{Conditions, Focus, Setup};
//!
//! let folder = tempfile::tempdir()?;
//! let file = folder.path().join("singlet.seq");
//! std::fs::write(
//!     &file,
//!     "RDM; DIM M; EPD 5; WL 587.6; YAN 0; SO 0 1e13; S 50 4 NBK7_SCHOTT; S -50 47.3; SI 0 0",
//! )?;
//! let conditions = Conditions { focus: Focus::At(500.0), ..Conditions::default() };
//! let setup = Setup { file, conditions, ..Setup::default() };
//! let lens = camrig_lens_files::system(&setup)?;
//! assert!((lens.paraxial.efl_mm - 49.04).abs() < 0.01);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod import;
pub mod seq;
pub mod zmx;

#[cfg(test)]
mod setup_tests;
#[cfg(test)]
mod tests;

use camrig_base::{Error, Result};
use camrig_glass::files;
use camrig_glass::text::read_text;
use camrig_lens::System;
use camrig_prescription::{Catalogue, Prescription, Setup, toml};
use std::path::Path;

/// The lens as the file of `setup` has it.
///
/// # Errors
/// A file or catalogue that cannot be read, what is wrong in it, a configuration that it does
/// not have.
pub fn prescription(setup: &Setup) -> Result<Prescription> {
    let mut glasses = Catalogue::default();
    for (name, glass) in &setup.glasses {
        glasses.insert(name, glass.clone());
    }
    for file in setup.catalogue_files()? {
        files::add(&mut glasses, &file)?;
    }
    read_configuration(&setup.file, &glasses, setup.configuration.as_deref())
}

/// The lens ready to trace.
///
/// # Errors
/// Those of [`prescription`] and [`System::new`].
pub fn system(setup: &Setup) -> Result<System> {
    System::new(prescription(setup)?, setup.conditions).map_err(|e| e.at(setup.file.display()))
}

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
