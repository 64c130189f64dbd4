//! The directory form of a characterisation over the plane.
//!
//! | file | holds |
//! |---|---|
//! | `lens.toml` | `format = "camrig-lens/2"`, names, figures, axes (below) |
//! | `distortion_x.npy` | f64 `[rows][columns][wavelengths]`: real places of chief rays, mm right |
//! | `distortion_y.npy` | the same downwards |
//! | `relative_illumination.npy` | f64 `[rows][columns][wavelengths]` |
//! | `captured.npy` | f64 `[rows][columns][wavelengths]`: light inside each PSF's window |
//! | `psf.npy` | f32 `[rows][columns][wavelengths][n][n]`, unit sums |
//!
//! ```toml
//! format = "camrig-lens/2"
//! name = "freeform"
//! source = "traced by camrig 0.1"
//! principal_distance_mm = 5.165
//! working_f_number = 2.37
//! wavelengths_nm = [400.0, 550.0, 700.0]
//! x_mm = [-2.0, -1.0, 0.0, 1.0, 2.0]       # ideal places of the columns, right of the origin
//! y_mm = [-1.5, 0.0, 1.5]                  # of the rows, below it
//! transmittance = [[400.0, 0.9], [700.0, 0.92]]   # wavelength nm, value; default 1
//! psf_spacing_um = 0.25
//! [between]                                # optional: measured error of PSFs between the places
//! misplaced_mean = 0.004                   # share of the light, mean over the field
//! misplaced_largest = 0.009
//! pixel_um = 1.4                           # after integration over pixels of this side
//! ```

use super::Between;
use super::directory::{
    PLANE_FORMAT, clear, head, read_npy, read_table, write_directory, write_head, write_npy,
};
use super::plane::PlaneCharacterisation;
use camrig_base::Spectrum;
use camrig_base::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaneToml {
    format: String,
    name: String,
    source: String,
    principal_distance_mm: f64,
    working_f_number: f64,
    wavelengths_nm: Vec<f64>,
    x_mm: Vec<f64>,
    y_mm: Vec<f64>,
    #[serde(default = "clear")]
    transmittance: Vec<[f64; 2]>,
    psf_spacing_um: f64,
    between: Option<Between>,
}

impl PlaneCharacterisation {
    /// Reads a lens directory.
    ///
    /// # Errors
    /// A missing or malformed file, shapes that disagree with `lens.toml`, values that break the
    /// conventions.
    pub fn read(dir: &Path) -> Result<Self> {
        let head: PlaneToml = head(dir, PLANE_FORMAT)?;
        let shape = [head.y_mm.len(), head.x_mm.len(), head.wavelengths_nm.len()];
        let table =
            |name: &str| read_table(&dir.join(name), &shape, "[rows, columns, wavelengths]");
        let (psf_size, psf) = read_psf(&dir.join("psf.npy"), shape)?;
        let (nm, value) = head.transmittance.iter().map(|p| (p[0], p[1])).unzip();
        let lens = Self {
            name: head.name,
            source: head.source,
            principal_distance_mm: head.principal_distance_mm,
            working_f_number: head.working_f_number,
            transmittance: Spectrum::new(nm, value)
                .map_err(|e| e.at("transmittance").at(dir.join("lens.toml").display()))?,
            real_x_mm: table("distortion_x.npy")?,
            real_y_mm: table("distortion_y.npy")?,
            relative_illumination: table("relative_illumination.npy")?,
            captured: table("captured.npy")?,
            wavelengths_nm: head.wavelengths_nm,
            x_mm: head.x_mm,
            y_mm: head.y_mm,
            psf_size,
            psf_spacing_um: head.psf_spacing_um,
            psf,
            between: head.between,
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
        let head = PlaneToml {
            format: PLANE_FORMAT.into(),
            name: self.name.clone(),
            source: self.source.clone(),
            principal_distance_mm: self.principal_distance_mm,
            working_f_number: self.working_f_number,
            wavelengths_nm: self.wavelengths_nm.clone(),
            x_mm: self.x_mm.clone(),
            y_mm: self.y_mm.clone(),
            transmittance: self.transmittance.samples().map(|(nm, v)| [nm, v]).collect(),
            psf_spacing_um: self.psf_spacing_um,
            between: self.between,
        };
        write_head(dir, &head)?;
        let shape = [self.y_mm.len(), self.x_mm.len(), self.wavelengths_nm.len()];
        let [rows, columns, waves] = shape.map(|n| n as u64);
        for (name, values) in [
            ("distortion_x.npy", &self.real_x_mm),
            ("distortion_y.npy", &self.real_y_mm),
            ("relative_illumination.npy", &self.relative_illumination),
            ("captured.npy", &self.captured),
        ] {
            write_npy(&dir.join(name), &[rows, columns, waves], values)?;
        }
        let n = self.psf_size as u64;
        write_npy(&dir.join("psf.npy"), &[rows, columns, waves, n, n], &self.psf)
    }
}

fn read_psf(path: &Path, expected: [usize; 3]) -> Result<(usize, Vec<f32>)> {
    let (shape, values) = read_npy(path)?;
    match shape[..] {
        [r, c, w, n, m] if n == m && [r, c, w] == expected => Ok((n, values)),
        _ => Err(Error::input(format!("array of shape {shape:?}")).at(path.display()).help(
            format!(
                "lens.toml announces [rows, columns, wavelengths, n, n] with {expected:?} square \
                 PSFs"
            ),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Characterisation, LensTables};

    #[test]
    fn comes_back_as_it_was_written_and_is_told_from_the_other_kind() {
        let dir = tempfile::tempdir().unwrap();
        let (path, other) = (dir.path().join("plane"), dir.path().join("heights"));
        let (heights, plane) = crate::characterisation::plane::tests::twice(5, 3);
        plane.write(&path, false).unwrap();
        heights.write(&other, false).unwrap();
        assert_eq!(PlaneCharacterisation::read(&path).unwrap(), plane);
        assert!(matches!(LensTables::read(&path).unwrap(), LensTables::Plane(p) if p == plane));
        let read = LensTables::read(&other).unwrap();
        assert!(matches!(read, LensTables::Heights(h) if h == heights));
        let error = Characterisation::read(&path).unwrap_err();
        assert_eq!(error.code(), Some(camrig_base::ErrorCode::AsymmetricLens), "{error}");
        let psf = path.join("psf.npy");
        let bytes = std::fs::read(&psf).unwrap();
        std::fs::write(&psf, &bytes[..bytes.len() / 2]).unwrap();
        let error = LensTables::read(&path).unwrap_err().to_string();
        assert!(error.contains("psf.npy") && error.contains("truncated"), "{error}");
    }
}
