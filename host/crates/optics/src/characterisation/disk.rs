//! The directory form of a characterisation.
//!
//! | file | holds |
//! |---|---|
//! | `lens.toml` | `format = "camrig-lens/1"`, names, paraxial figures, axes (below) |
//! | `distortion.npy` | f64 `[heights][wavelengths]`: real chief-ray height, mm |
//! | `relative_illumination.npy` | f64 `[heights][wavelengths]` |
//! | `chief_ray_angle.npy` | f64 `[heights][wavelengths]`, degrees; optional |
//! | `psf.npy` | f32 `[psf heights][psf wavelengths][n][n]`, unit sums |
//!
//! ```toml
//! format = "camrig-lens/1"
//! name = "phone80"
//! source = "traced from phone80.zmx by camrig 0.1"
//! efl_mm = 5.165
//! f_number = 2.37
//! magnification = 0.0
//! pupil_magnification = 1.0                # optional, default 1
//! axis_solid_angle_sr = 0.135              # optional, default π/(1 + 4 N²), N the working one
//! stop_radius_mm = 0.95                    # optional
//! wavelengths_nm = [400.0, 550.0, 700.0]
//! heights_mm = [0.0, 1.0, 2.0]
//! transmittance = [[400.0, 0.9], [700.0, 0.92]]   # wavelength nm, value; default 1
//! [psf]
//! spacing_um = 0.25
//! wavelengths_nm = [400.0, 550.0, 700.0]
//! heights_mm = [0.0, 2.0]
//! captured = [0.99, 0.99, 0.98, 0.97, 0.96, 0.95] # optional, [height][wavelength]
//! [psf.between]                            # optional: measured error of PSFs between heights
//! misplaced_mean = 0.004                   # share of the light, mean over the field
//! misplaced_largest = 0.009
//! pixel_um = 1.4                           # after integration over pixels of this side
//! ```

use super::directory::{
    DISK_FORMAT, clear, head, read_npy, read_table, write_directory, write_head, write_npy,
};
use super::{Between, Characterisation, PsfGrid};
use camrig_base::Spectrum;
use camrig_base::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Axes of its tables.
const AXES: &str = "[heights, wavelengths]";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LensToml {
    format: String,
    name: String,
    source: String,
    efl_mm: f64,
    f_number: f64,
    magnification: f64,
    #[serde(default = "one")]
    pupil_magnification: f64,
    axis_solid_angle_sr: Option<f64>,
    stop_radius_mm: Option<f64>,
    wavelengths_nm: Vec<f64>,
    heights_mm: Vec<f64>,
    #[serde(default = "clear")]
    transmittance: Vec<[f64; 2]>,
    psf: PsfToml,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PsfToml {
    spacing_um: f64,
    wavelengths_nm: Vec<f64>,
    heights_mm: Vec<f64>,
    captured: Option<Vec<f64>>,
    between: Option<Between>,
}

fn one() -> f64 {
    1.0
}

impl Characterisation {
    /// Reads a lens directory.
    ///
    /// # Errors
    /// A missing or malformed file, shapes that disagree with `lens.toml`, values that break the
    /// conventions.
    pub fn read(dir: &Path) -> Result<Self> {
        let path = dir.join("lens.toml");
        let head: LensToml = head(dir, DISK_FORMAT)?;
        let tables = [head.heights_mm.len(), head.wavelengths_nm.len()];
        let angle_path = dir.join("chief_ray_angle.npy");
        let psf_shape = [head.psf.heights_mm.len(), head.psf.wavelengths_nm.len()];
        let (size, data) = read_psf(&dir.join("psf.npy"), psf_shape)?;
        let (nm, value) = head.transmittance.iter().map(|p| (p[0], p[1])).unzip();
        let lens = Self {
            name: head.name,
            source: head.source,
            efl_mm: head.efl_mm,
            f_number: head.f_number,
            magnification: head.magnification,
            pupil_magnification: head.pupil_magnification,
            axis_solid_angle_sr: head.axis_solid_angle_sr,
            stop_radius_mm: head.stop_radius_mm,
            transmittance: Spectrum::new(nm, value)
                .map_err(|e| e.at("transmittance").at(path.display()))?,
            real_height_mm: read_table(&dir.join("distortion.npy"), &tables, AXES)?,
            relative_illumination: read_table(
                &dir.join("relative_illumination.npy"),
                &tables,
                AXES,
            )?,
            chief_ray_angle_deg: match angle_path.exists() {
                true => Some(read_table(&angle_path, &tables, AXES)?),
                false => None,
            },
            wavelengths_nm: head.wavelengths_nm,
            heights_mm: head.heights_mm,
            psf: PsfGrid {
                heights_mm: head.psf.heights_mm,
                wavelengths_nm: head.psf.wavelengths_nm,
                size,
                spacing_um: head.psf.spacing_um,
                data,
                captured: head.psf.captured,
                between: head.psf.between,
            },
        };
        lens.validate().map_err(|e| e.at(dir.display()))?;
        Ok(lens)
    }

    /// Writes a lens directory, whole or not at all; an existing one only with `force`.
    ///
    /// # Errors
    /// Invalid data, an existing directory, or a failure to write.
    pub fn write(&self, dir: &Path, force: bool) -> Result<()> {
        self.validate()?;
        write_directory(dir, force, |dir| self.write_files(dir))
    }

    fn write_files(&self, dir: &Path) -> Result<()> {
        let head = LensToml {
            format: DISK_FORMAT.into(),
            name: self.name.clone(),
            source: self.source.clone(),
            efl_mm: self.efl_mm,
            f_number: self.f_number,
            magnification: self.magnification,
            pupil_magnification: self.pupil_magnification,
            axis_solid_angle_sr: self.axis_solid_angle_sr,
            stop_radius_mm: self.stop_radius_mm,
            wavelengths_nm: self.wavelengths_nm.clone(),
            heights_mm: self.heights_mm.clone(),
            transmittance: self.transmittance.samples().map(|(nm, v)| [nm, v]).collect(),
            psf: PsfToml {
                spacing_um: self.psf.spacing_um,
                wavelengths_nm: self.psf.wavelengths_nm.clone(),
                heights_mm: self.psf.heights_mm.clone(),
                captured: self.psf.captured.clone(),
                between: self.psf.between,
            },
        };
        write_head(dir, &head)?;
        let tables = [self.heights_mm.len() as u64, self.wavelengths_nm.len() as u64];
        write_npy(&dir.join("distortion.npy"), &tables, &self.real_height_mm)?;
        write_npy(&dir.join("relative_illumination.npy"), &tables, &self.relative_illumination)?;
        if let Some(angle) = &self.chief_ray_angle_deg {
            write_npy(&dir.join("chief_ray_angle.npy"), &tables, angle)?;
        }
        let (p, n) = (&self.psf, self.psf.size as u64);
        let shape = [p.heights_mm.len() as u64, p.wavelengths_nm.len() as u64, n, n];
        write_npy(&dir.join("psf.npy"), &shape, &p.data)
    }
}

fn read_psf(path: &Path, expected: [usize; 2]) -> Result<(usize, Vec<f32>)> {
    let (shape, values) = read_npy(path)?;
    match shape[..] {
        [h, w, n, m] if n == m && [h, w] == expected => Ok((n, values)),
        _ => Err(Error::input(format!("array of shape {shape:?}")).at(path.display()).help(
            format!(
                "lens.toml announces [heights, wavelengths, n, n] with {expected:?} square PSFs"
            ),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comes_back_as_it_was_written_and_is_replaced_only_by_force() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("lens");
        let lens = Characterisation::example(8, 0.25);
        lens.write(&path, false).unwrap();
        assert_eq!(Characterisation::read(&path).unwrap(), lens);
        assert!(lens.write(&path, false).unwrap_err().to_string().contains("replace it"));
        lens.write(&path, true).unwrap();
    }

    #[test]
    fn truncated_or_disagreeing_files_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("lens");
        Characterisation::example(8, 0.25).write(&path, false).unwrap();
        let psf = path.join("psf.npy");
        let bytes = std::fs::read(&psf).unwrap();
        std::fs::write(&psf, &bytes[..bytes.len() / 2]).unwrap();
        let error = Characterisation::read(&path).unwrap_err().to_string();
        assert!(error.contains("psf.npy") && error.contains("truncated"), "{error}");
        std::fs::write(&psf, &bytes).unwrap();
        let toml = path.join("lens.toml");
        let text = std::fs::read_to_string(&toml).unwrap();
        std::fs::write(&toml, text.replace("efl_mm", "elf_mm")).unwrap();
        let error = Characterisation::read(&path).unwrap_err().to_string();
        assert!(error.contains("elf_mm") && error.contains("lens.toml"), "{error}");
    }
}
