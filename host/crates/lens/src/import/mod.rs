//! Characterisations from the files of lens programs.
//!
//! - [`iset`]: ISETCam ray-trace sets, `ISETPARMS.TXT` with `_DI_`, `_RI_`, `_CRA_` and `_PSF_`
//!   files, as the Zemax and CODE V macros of ISETCam write them.
//! - [`manifest`]: a manifest (`.toml`) that names tables (CSV, NPY), Zemax listings and CODE V
//!   PSFs.
//!
//! PSFs are normalised to unit sum, whatever their normalisation in the file (Strehl ratio, 1 or
//! 100 at the peak), and turned so that rows rise away from the axis with the chief ray at sample
//! n/2.

pub mod iset;
pub mod listing;
pub mod manifest;
#[cfg(test)]
mod tests;

use camrig_base::{Error, Result};
use camrig_glass::text;
use camrig_optics::Characterisation;
use camrig_optics::interpolate::MonotoneCubic;
use std::path::Path;

/// Imports a lens: an ISETCam set (its directory or its `ISETPARMS.TXT`) or a manifest (`.toml`).
///
/// # Errors
/// A source that is neither, and what is wrong in its files, with their lines.
pub fn import(source: &Path) -> Result<Characterisation> {
    let is_manifest = source.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let mut lens = if is_manifest {
        manifest::read(source)?
    } else {
        iset::read(&iset::parameter_file(source)?)?
    };
    lens.psf.normalise().and_then(|()| lens.validate()).map_err(|e| e.at(source.display()))?;
    Ok(lens)
}

/// A table over height and wavelength.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Table {
    /// Heights, mm, strictly rising.
    pub heights: Vec<f64>,
    /// Wavelengths, nm; a wavelength of 0 stands for all.
    pub wavelengths: Vec<f64>,
    /// `[height][wavelength]`.
    pub values: Vec<f64>,
}

/// Part of a height by which a table may end before another: listings print few digits of the
/// field, and give it in degrees where others give heights.
const HEIGHT_ROUNDING: f64 = 0.01;

impl Table {
    /// The table at other heights and wavelengths: monotone cubic in height; heights and
    /// wavelengths must be there.
    pub fn onto(&self, heights: &[f64], wavelengths: &[f64]) -> Result<Vec<f64>> {
        let last = |list: &[f64]| list.last().copied().unwrap_or(0.0);
        let (own, wanted) = (last(&self.heights), last(heights));
        if wanted > own * (1.0 + HEIGHT_ROUNDING) {
            return Err(Error::input(format!(
                "the table ends at the height {own} mm, and that of the distortion at {wanted} mm"
            ))
            .help("give it as far out, or cut the distortion there"));
        }
        let columns = self.wavelengths.len();
        let curve = |nm: f64| {
            let same = |w: &&f64| (**w - nm).abs() < 0.5 || **w == 0.0;
            let column = self.wavelengths.iter().position(|w| same(&w)).ok_or_else(|| {
                Error::input(format!("no values for {nm} nm")).help(format!(
                    "the table has {:?} nm; give the missing wavelength or leave it out \
                     everywhere",
                    self.wavelengths
                ))
            })?;
            let values = self.values.iter().skip(column).step_by(columns).copied().collect();
            Ok(MonotoneCubic::new(self.heights.clone(), values))
        };
        let curves: Result<Vec<MonotoneCubic>> = wavelengths.iter().map(|&nm| curve(nm)).collect();
        let curves = curves?;
        Ok(heights.iter().flat_map(|&h| curves.iter().map(move |c| c.at(h))).collect())
    }
}

/// Rows of numbers: words separated by blanks, tabs, commas or semicolons; lines that start with
/// `#` or `%` are comments. Every row has the same length.
pub(super) fn rows_of_numbers(text: &str) -> Result<Vec<Vec<f64>>> {
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with(['#', '%']) {
            continue;
        }
        let words = words(line);
        let row = text::numbers("value", &words).map_err(|e| e.at(format!("line {}", i + 1)))?;
        if let Some(first) = rows.first()
            && first.len() != row.len()
        {
            return Err(Error::input(format!("{} values instead of {}", row.len(), first.len()))
                .at(format!("line {}", i + 1))
                .help("every row has the same number of values; is the file cut short?"));
        }
        rows.push(row);
    }
    if rows.is_empty() {
        return Err(Error::input("no numbers").help("the file is empty or of another kind"));
    }
    Ok(rows)
}

pub(super) fn words(line: &str) -> Vec<&str> {
    line.split([' ', '\t', ',', ';']).filter(|w| !w.is_empty()).collect()
}
