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

mod decimals;
pub mod iset;
pub mod listing;
pub mod manifest;
#[cfg(test)]
mod tests;

use camrig_base::{Error, Result};
use camrig_glass::text;
use camrig_optics::Characterisation;
use camrig_optics::interpolate::MonotoneCubic;
use listing::PsfListing;
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
    let check = |lens: &Characterisation| lens.validate().and_then(|()| check_units(lens));
    lens.psf.normalise().and_then(|()| check(&lens)).map_err(|e| e.at(source.display()))?;
    Ok(lens)
}

/// Refuses tables in another unit than theirs.
fn check_units(lens: &Characterisation) -> Result<()> {
    // A lens that is meant for its paraxial heights keeps well within this of them near the axis.
    const MAX_DISTORTED: f64 = 20.0;
    let columns = lens.wavelengths_nm.len();
    let angles = lens.chief_ray_angle_deg.iter().flatten();
    if let Some(degrees) = angles.copied().find(|angle| angle.abs() >= 90.0) {
        return Err(Error::input(format!("a chief ray at {degrees}° to the axis"))
            .at("chief_ray_angle")
            .help(
                "angles in the files of a set are in radians, in tables of a manifest in degrees",
            ));
    }
    let height = lens.heights_mm[1];
    let real = &lens.real_height_mm[columns..2 * columns];
    if let Some(mm) =
        real.iter().find(|mm| !(height / MAX_DISTORTED..height * MAX_DISTORTED).contains(*mm))
    {
        return Err(Error::input(format!(
            "a real height of {mm} mm at the paraxial height {height} mm"
        ))
        .at("distortion")
        .help("both are in mm"));
    }
    Ok(())
}

/// A table over height and wavelength.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Table {
    /// Heights, mm, strictly rising.
    pub heights: Vec<f64>,
    /// Wavelengths, nm; a wavelength of 0 means all.
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

/// Largest difference of a listing's wavelength from that of the parameters, nm: listings print
/// four decimals of a micrometre, and parameter files may round to whole nanometres.
pub(super) const WAVELENGTH_TOLERANCE_NM: f64 = 0.5;
/// Largest relative difference of the sample distance: listings print few digits.
const SPACING_TOLERANCE: f64 = 0.02;

/// Checks that a listing is the one that the parameters announce.
pub(super) fn check(listing: &PsfListing, nm: f64, spacing_um: f64) -> Result<()> {
    if let Some(own) = listing.wavelength_nm
        && (own - nm).abs() > WAVELENGTH_TOLERANCE_NM
    {
        return Err(Error::input(format!("a PSF of {own} nm where {nm} nm is expected"))
            .help("the files do not belong together, or their numbers are mixed up"));
    }
    if let Some(own) = listing.spacing_um
        && (own - spacing_um).abs() > SPACING_TOLERANCE * spacing_um
    {
        return Err(Error::input(format!(
            "PSF samples {own} µm apart where {spacing_um} µm are expected"
        ))
        .help("the files do not belong together"));
    }
    Ok(())
}

/// Part of a height by which the image position in a listing may differ from the table of
/// distortion, and the same for the axis in mm: listings are of the chief ray, or the centroid.
const PLACE_TOLERANCE: f64 = 0.02;
/// Millimetres in the units that a lens program works in, none of which its listing names.
const LENS_UNITS_MM: [f64; 4] = [1.0, 10.0, 25.4, 1000.0];

/// Checks that the image position of a listing is where the lens has the height of its entry, mm.
pub(super) fn check_place(listing: &PsfListing, real_mm: Option<f64>) -> Result<()> {
    let (Some([x, y]), Some(real)) = (listing.image, real_mm) else { return Ok(()) };
    let own = libm::hypot(x, y);
    let near = |mm: f64| (mm - real).abs() <= PLACE_TOLERANCE * real.max(1.0);
    if LENS_UNITS_MM.iter().any(|unit| near(own * unit)) {
        return Ok(());
    }
    Err(Error::input(format!(
        "a PSF {own} mm from the axis, where the lens has the height of its entry at {real} mm"
    ))
    .help("the files do not belong together, or their fields are mixed up"))
}
