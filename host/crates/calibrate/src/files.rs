//! The small TOML files that calibration writes next to its frames: `response.toml`, `hdr.toml`.

use crate::exposures::Series;
use crate::hdr::{Flag, Merged};
use crate::response::Response;
use camrig_base::{Cfa, Error, Result, toml_text};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// `response.toml`: the response curve of each channel.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResponseFile {
    format: String,
    /// The curves.
    pub response: Vec<Response>,
}

impl ResponseFile {
    /// The file of these curves.
    #[must_use]
    pub fn new(response: Vec<Response>) -> Self {
        Self { format: "response/1".into(), response }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// A file that is missing or wrong.
    pub fn read(path: &Path) -> Result<Self> {
        toml_text::read_file(path)
    }

    /// The file's text.
    ///
    /// # Errors
    /// None that is not a fault of camrig.
    pub fn text(&self) -> Result<String> {
        to_toml("response.toml", self)
    }
}

/// `hdr.toml`: what a merged frame was made from, and how well.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HdrFile {
    format: String,
    /// The colour filter pattern.
    pub cfa: String,
    /// What the exposures have in common.
    pub view: String,
    /// Ids of the captures merged.
    pub exposures: Vec<String>,
    /// Shift of each exposure that was corrected, pixels to the right and down.
    pub shifts: Vec<[i64; 2]>,
    /// Noise: variance per signal, DN² per DN.
    pub noise_gain_dn: f64,
    /// Noise: variance without light, DN².
    pub noise_read_dn2: f64,
    /// Largest signal over the noise floor, dB.
    pub dynamic_range_db: f64,
    /// Share of the pixels that show movement.
    pub moved_fraction: f64,
    /// Share of the pixels that are saturated in every exposure.
    pub saturated_fraction: f64,
    /// cd/m² per DN/s of green, where a reading was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub luminance_per_dn_s: Option<f64>,
}

impl HdrFile {
    /// Notes on a merged series.
    #[must_use]
    pub fn of(
        merged: &Merged,
        series: &Series,
        cfa: &Cfa,
        luminance_per_dn_s: Option<f64>,
    ) -> Self {
        let fraction = |flag: Flag| {
            let count = merged.flags.data.iter().filter(|&&f| f == flag as u8).count();
            count as f64 / merged.flags.data.len() as f64
        };
        Self {
            format: "hdr/1".into(),
            cfa: cfa.to_string(),
            view: series.name.clone(),
            exposures: series.exposures.iter().map(|e| e.id.clone()).collect(),
            shifts: merged.shifts.iter().map(|s| s.map(|v| v as i64)).collect(),
            noise_gain_dn: merged.noise.gain_dn,
            noise_read_dn2: merged.noise.read_dn2,
            dynamic_range_db: merged.dynamic_range_db,
            moved_fraction: fraction(Flag::Moved),
            saturated_fraction: fraction(Flag::Saturated),
            luminance_per_dn_s,
        }
    }

    /// Reads the file of a directory of a merged frame.
    ///
    /// # Errors
    /// A file that is missing or wrong.
    pub fn read(directory: &Path) -> Result<Self> {
        toml_text::read_file(&directory.join("hdr.toml"))
    }

    /// The file's text.
    ///
    /// # Errors
    /// None that is not a fault of camrig.
    pub fn text(&self) -> Result<String> {
        to_toml("hdr.toml", self)
    }
}

fn to_toml(name: &str, file: &impl Serialize) -> Result<String> {
    toml::to_string(file).map_err(|e| Error::internal(format!("{name}: {e}")))
}
