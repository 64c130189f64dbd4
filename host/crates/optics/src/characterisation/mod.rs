//! A lens as tables over image height and wavelength, as a lens program exports them or
//! `camrig-lens` computes them. The engine renders through them; `disk` stores them in a
//! directory.
//!
//! # Conventions
//! - The lens is rotationally symmetric about the optical axis ([`plane`] is for any other). Every
//!   table is indexed by the **paraxial image height** h of the field point (EFL·tan θ for an
//!   object at infinity), mm, from 0.
//! - Distortion is stored forward: the *real* height at which the chief ray of **that wavelength**
//!   lands, so lateral colour is in it; a PSF is centred on that same chief ray, so lateral colour
//!   is **not** in the PSF.
//! - PSF sample (row i, column j) of an n x n grid lies at ((i − n/2)·spacing) along the radial
//!   direction, positive away from the axis, and ((j − n/2)·spacing) across it: the chief ray is
//!   at sample n/2 (integer division), for even and odd n. Each PSF sums to 1 over its window;
//!   what the window cut off is kept as a number in [`PsfGrid::captured`].
//! - Relative illumination is the irradiance of a uniform Lambertian scene at the field point over
//!   that on the axis (1 at h = 0). It already holds cos⁴, vignetting, pupil aberration and the
//!   effect of distortion on the solid angle: the engine applies it once, and no Jacobian.
//! - Between heights: monotone cubic; between wavelengths: linear. Outside the table: distortion
//!   goes on along its end slope, illumination and angle keep their end values, PSFs are those of
//!   the end; [`extent`] finds where a sensor or its light goes beyond.

mod directory;
mod disk;
mod example;
pub mod extent;
pub mod plane;
mod plane_disk;
pub mod tables;

use super::engine::psf::PsfField;
use super::engine::stations::Stations;
use super::engine::{Blur, Lens, OverField};
use super::interpolate::MonotoneCubic;
use camrig_base::Spectrum;
use camrig_base::{Error, Result};
use std::f64::consts::PI;

/// Largest real height of the axis, mm: a thousandth of a small pixel, for figures that were
/// computed.
const AXIS_MM: f64 = 1e-6;
/// Part by which the relative illumination on the axis may differ from 1.
const AXIS_RATIO: f64 = 0.02;

/// A lens as tables over paraxial image height and wavelength (module documentation: conventions).
#[derive(Clone, Debug, PartialEq)]
pub struct Characterisation {
    /// Name of the lens.
    pub name: String,
    /// Where the figures come from: program, file, method; free text.
    pub source: String,
    /// Effective focal length, mm.
    pub efl_mm: f64,
    /// Effective focal length over entrance-pupil diameter.
    pub f_number: f64,
    /// |m| of eq. 7; 0 for an object at infinity.
    pub magnification: f64,
    /// Exit-pupil over entrance-pupil diameter; 1 where unknown (as eq. 7 supposes).
    pub pupil_magnification: f64,
    /// Projected solid angle of the pupil seen from the image point on the axis, sr, where it was
    /// traced. It is that of real rays, through whatever obscures the pupil; of the f-number
    /// follows only that of a paraxial cone ([`Characterisation::projected_solid_angle_sr`]).
    pub axis_solid_angle_sr: Option<f64>,
    /// Real radius of the stop, mm, where known.
    pub stop_radius_mm: Option<f64>,
    /// Transmittance of the lens.
    pub transmittance: Spectrum,
    /// Wavelengths of the tables, nm, strictly rising.
    pub wavelengths_nm: Vec<f64>,
    /// Paraxial image heights of the tables, mm, strictly rising from 0.
    pub heights_mm: Vec<f64>,
    /// Real chief-ray height, mm; `[height][wavelength]`, row-major.
    pub real_height_mm: Vec<f64>,
    /// Irradiance over that on the axis; `[height][wavelength]`.
    pub relative_illumination: Vec<f64>,
    /// Chief-ray angle at the image, degrees; `[height][wavelength]`; `None` where unknown.
    pub chief_ray_angle_deg: Option<Vec<f64>>,
    /// Point-spread functions.
    pub psf: PsfGrid,
}

/// Point-spread functions over their own heights and wavelengths (often fewer than the tables').
#[derive(Clone, Debug, PartialEq)]
pub struct PsfGrid {
    /// Paraxial image heights, mm, strictly rising from 0.
    pub heights_mm: Vec<f64>,
    /// Wavelengths, nm, strictly rising.
    pub wavelengths_nm: Vec<f64>,
    /// Samples per side, n.
    pub size: usize,
    /// Distance of samples, µm.
    pub spacing_um: f64,
    /// `[height][wavelength][row][column]`, each n x n block of unit sum; rows rise away from the
    /// axis.
    pub data: Vec<f32>,
    /// Fraction of the PSF's energy inside its window, `[height][wavelength]`; `None` where
    /// unknown.
    pub captured: Option<Vec<f64>>,
    /// Error of PSFs between the heights, where it was measured.
    pub between: Option<Between>,
}

/// How far PSFs blended between two heights are from the traced ones.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Between {
    /// Light that blending misplaces halfway between heights, as a fraction: mean over the field's
    /// area.
    pub misplaced_mean: f64,
    /// The same at the worst place.
    pub misplaced_largest: f64,
    /// Side of the pixels over which PSFs were compared, µm.
    pub pixel_um: f64,
}

impl PsfGrid {
    /// The PSF of height index `height` and wavelength index `wavelength`, row-major.
    #[must_use]
    pub fn psf(&self, height: usize, wavelength: usize) -> &[f32] {
        let n2 = self.size * self.size;
        let at = (height * self.wavelengths_nm.len() + wavelength) * n2;
        &self.data[at..at + n2]
    }

    /// The PSFs of all heights at a wavelength: linear between tabulated wavelengths.
    #[must_use]
    pub fn at_wavelength(&self, nm: f64) -> Vec<Vec<f32>> {
        let (i, t) = bracket(&self.wavelengths_nm, nm);
        (0..self.heights_mm.len())
            .map(|h| {
                if t == 0.0 {
                    return self.psf(h, i).to_vec();
                }
                let (a, b, t) = (self.psf(h, i), self.psf(h, i + 1), t as f32);
                a.iter().zip(b).map(|(&a, &b)| a + t * (b - a)).collect()
            })
            .collect()
    }

    /// Scales every PSF to unit sum, as exporters write them relative to peak or Strehl ratio.
    ///
    /// # Errors
    /// A PSF with negative or non-finite samples, or one without any light.
    pub fn normalise(&mut self) -> Result<()> {
        let (n2, columns) = (self.size * self.size, self.wavelengths_nm.len());
        for (k, block) in self.data.chunks_exact_mut(n2.max(1)).enumerate() {
            let place = format!(
                "PSF at {} mm, {} nm",
                self.heights_mm[k / columns],
                self.wavelengths_nm[k % columns]
            );
            if let Some(v) = block.iter().find(|v| !v.is_finite() || **v < 0.0) {
                return Err(Error::input(format!("PSF sample {v}"))
                    .at(place)
                    .help("samples are relative intensities, finite and not negative"));
            }
            let sum: f64 = block.iter().map(|&v| f64::from(v)).sum();
            if sum <= 0.0 {
                return Err(Error::input("every sample is 0").at(place).help("drop this PSF"));
            }
            block.iter_mut().for_each(|v| *v = (f64::from(*v) / sum) as f32);
        }
        Ok(())
    }
}

impl Characterisation {
    /// Checks every length and value; readers and importers call it before handing one out.
    ///
    /// # Errors
    /// The first value that breaks the conventions, with what would be right.
    pub fn validate(&self) -> Result<()> {
        let cells = self.heights_mm.len() * self.wavelengths_nm.len();
        axis("heights_mm", &self.heights_mm, Some(0.0))?;
        axis("wavelengths_nm", &self.wavelengths_nm, None)?;
        axis("psf.heights_mm", &self.psf.heights_mm, Some(0.0))?;
        axis("psf.wavelengths_nm", &self.psf.wavelengths_nm, None)?;
        positive("efl_mm", self.efl_mm)?;
        positive("f_number", self.f_number)?;
        positive("pupil_magnification", self.pupil_magnification)?;
        positive("psf.spacing_um", self.psf.spacing_um)?;
        if let Some(sr) = self.axis_solid_angle_sr.filter(|sr| !(*sr > 0.0 && *sr <= PI)) {
            return Err(Error::input(format!("axis_solid_angle_sr {sr}"))
                .help("projected solid angles lie between 0 and π sr"));
        }
        if !(self.magnification.is_finite() && self.magnification >= 0.0) {
            return Err(Error::input(format!("magnification {}", self.magnification))
                .help("give |m|, 0 for an object at infinity"));
        }
        if let Some((nm, v)) = self.transmittance.samples().find(|(_, v)| !(0.0..=1.0).contains(v))
        {
            return Err(Error::input(format!("transmittance {v} at {nm} nm"))
                .help("a transmittance lies in 0..=1"));
        }
        table("real_height_mm", &self.real_height_mm, cells)?;
        table("relative_illumination", &self.relative_illumination, cells)?;
        if let Some(angle) = &self.chief_ray_angle_deg {
            table("chief_ray_angle_deg", angle, cells)?;
        }
        if let Some(v) = self.relative_illumination.iter().find(|v| **v < 0.0) {
            return Err(Error::input(format!("relative illumination {v}"))
                .help("it is a ratio to the irradiance on the axis, not negative"));
        }
        let axis_ratios = &self.relative_illumination[..self.wavelengths_nm.len()];
        if let Some(v) = axis_ratios.iter().find(|v| (**v - 1.0).abs() > AXIS_RATIO) {
            return Err(Error::input(format!("relative illumination {v} on the axis")).help(
                "it is a ratio to the irradiance on the axis, 1 there: divide by that value",
            ));
        }
        if self.heights_mm.len() < 2 {
            return Err(Error::input("heights_mm has the axis alone").help(
                "give distortion and relative illumination at one more height at least; PSFs may \
                 be of the axis alone",
            ));
        }
        let columns = self.wavelengths_nm.len();
        if let Some(mm) = self.real_height_mm[..columns].iter().find(|v| v.abs() > AXIS_MM) {
            return Err(Error::input(format!("real height {mm} mm on the axis"))
                .at("distortion")
                .help("a lens over image height is symmetric about its axis: 0 stays 0"));
        }
        for (w, nm) in self.wavelengths_nm.iter().enumerate() {
            for h in 1..self.heights_mm.len() {
                let (below, here) = (
                    self.real_height_mm[(h - 1) * columns + w],
                    self.real_height_mm[h * columns + w],
                );
                if here <= below {
                    return Err(Error::input(format!(
                        "real height falls from {below} mm to {here} mm at paraxial height {} mm, \
                         {nm} nm",
                        self.heights_mm[h]
                    ))
                    .at("distortion")
                    .help(
                        "distortion that folds the image cannot be inverted; cut the table \
                         before it",
                    ));
                }
            }
        }
        self.validate_psf()
    }

    fn validate_psf(&self) -> Result<()> {
        let psf = &self.psf;
        let blocks = psf.heights_mm.len() * psf.wavelengths_nm.len();
        let expected = psf.size.checked_mul(psf.size).and_then(|n2| n2.checked_mul(blocks));
        if psf.size == 0 || expected != Some(psf.data.len()) {
            return Err(Error::input(format!(
                "{} PSF samples for {blocks} PSFs of {} x {}",
                psf.data.len(),
                psf.size,
                psf.size
            ))
            .help("give one square PSF per height and wavelength"));
        }
        if psf.captured.as_ref().is_some_and(|c| c.len() != blocks) {
            return Err(Error::input("psf.captured has another length than the PSF grid"));
        }
        let columns = psf.wavelengths_nm.len();
        for k in 0..blocks {
            let block = psf.psf(k / columns, k % columns);
            let sum: f64 = block.iter().map(|&v| f64::from(v)).sum();
            // f32 samples: a sum of n² values rounded to 2⁻²⁴ each stays within 1e-5 of 1.
            if block.iter().any(|v| !v.is_finite() || *v < 0.0) || (sum - 1.0).abs() > 1e-5 {
                return Err(Error::input(format!("PSF with sum {sum}, or with negative samples"))
                    .at(format!(
                        "PSF at {} mm, {} nm",
                        psf.heights_mm[k / columns],
                        psf.wavelengths_nm[k % columns]
                    ))
                    .help("samples are not negative and sum to 1 over the window"));
            }
        }
        Ok(())
    }

    /// Image-side f-number N(1+|m|/P) with pupil magnification P.
    #[must_use]
    pub fn working_f_number(&self) -> f64 {
        self.f_number * (1.0 + self.magnification / self.pupil_magnification)
    }

    /// Projected solid angle of the pupil seen from the image point on the axis, sr: irradiance
    /// over the radiance of an even scene. Where it was not traced it is that of a cone whose slope
    /// is the paraxial one, tan θ = 1/(2 N_w): π/(1 + 4 N_w²). A lens that obeys the sine condition
    /// has sin θ there, π/(4 N_w²), which is 1 % more at f/5 and 8 % at f/1.8; an obscured one
    /// less.
    #[must_use]
    pub fn projected_solid_angle_sr(&self) -> f64 {
        let paraxial = || PI / (1.0 + 4.0 * self.working_f_number().powi(2));
        self.axis_solid_angle_sr.unwrap_or_else(paraxial)
    }

    /// Real height (mm) over paraxial height (mm) at a wavelength: the forward distortion curve.
    /// Its `inverse` takes a place on the sensor to where the ideal lens would have put the light.
    #[must_use]
    pub fn distortion(&self, nm: f64) -> MonotoneCubic {
        MonotoneCubic::new(self.heights_mm.clone(), self.column(&self.real_height_mm, nm))
    }

    /// Relative illumination over paraxial height (mm) at a wavelength.
    #[must_use]
    pub fn illumination(&self, nm: f64) -> MonotoneCubic {
        MonotoneCubic::new(self.heights_mm.clone(), self.column(&self.relative_illumination, nm))
    }

    /// Chief-ray angle (degrees) over paraxial height (mm) at a wavelength, where known.
    #[must_use]
    pub fn chief_ray_angle(&self, nm: f64) -> Option<MonotoneCubic> {
        let table = self.chief_ray_angle_deg.as_ref()?;
        Some(MonotoneCubic::new(self.heights_mm.clone(), self.column(table, nm)))
    }

    /// A `[height][wavelength]` table at one wavelength.
    fn column(&self, table: &[f64], nm: f64) -> Vec<f64> {
        let columns = self.wavelengths_nm.len();
        let (i, t) = bracket(&self.wavelengths_nm, nm);
        table
            .chunks_exact(columns)
            .map(|row| if t == 0.0 { row[i] } else { row[i] + t * (row[i + 1] - row[i]) })
            .collect()
    }
}

impl Lens for Characterisation {
    fn steradians(&self, nm: f64) -> f64 {
        self.transmittance.at(nm) * self.projected_solid_angle_sr()
    }

    fn illumination(&self, nm: f64) -> Option<OverField<'_, f64>> {
        let (distortion, ratio) = (self.distortion(nm), self.illumination(nm));
        let last = self.heights_mm[self.heights_mm.len() - 1];
        let at = move |real| ratio.at(distortion.inverse(real).min(last));
        Some(OverField::Radial(Box::new(at)))
    }

    fn ideal_place(&self, nm: f64) -> Option<OverField<'_, (f64, f64)>> {
        let distortion = self.distortion(nm);
        Some(OverField::Radial(Box::new(move |real| distortion.inverse(real))))
    }

    fn principal_distance_mm(&self) -> f64 {
        self.efl_mm * (1.0 + self.magnification / self.pupil_magnification)
    }

    fn blur(&self, nm: f64) -> Blur<'_> {
        let distortion = self.distortion(nm);
        Blur::Field {
            psfs: PsfField {
                stations: Stations::Heights(
                    self.psf.heights_mm.iter().map(|&h| distortion.at(h)).collect(),
                ),
                size: self.psf.size,
                spacing_um: self.psf.spacing_um,
                psfs: self.psf.at_wavelength(nm),
            },
            cutoff_per_mm: 1e6 / (nm * self.working_f_number()),
        }
    }
}

/// Index i and fraction t with x = axis[i] + t·(axis[i+1] − axis[i]); the ends hold outside.
fn bracket(axis: &[f64], x: f64) -> (usize, f64) {
    let after = axis.partition_point(|&v| v <= x);
    if after == 0 {
        return (0, 0.0);
    }
    if after == axis.len() {
        return (after - 1, 0.0);
    }
    (after - 1, (x - axis[after - 1]) / (axis[after] - axis[after - 1]))
}

fn axis(name: &str, values: &[f64], first: Option<f64>) -> Result<()> {
    if values.is_empty() || first.is_some_and(|f| values[0] != f) {
        let start = values.first().map_or("nothing".into(), f64::to_string);
        return Err(Error::input(format!("{name} starts with {start}"))
            .help("give at least one sample; heights start at 0, the axis"));
    }
    if let Some(v) = values.iter().find(|v| !v.is_finite()) {
        return Err(Error::input(format!("{name} holds {v}")).help("finite numbers only"));
    }
    if let Some(w) = values.windows(2).find(|w| w[1] <= w[0]) {
        return Err(Error::input(format!("{name}: {} follows {}", w[1], w[0]))
            .help("samples rise strictly"));
    }
    Ok(())
}

fn positive(name: &str, value: f64) -> Result<()> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(Error::input(format!("{name} = {value}")).help("give a positive number"))
}

fn table(name: &str, values: &[f64], expected: usize) -> Result<()> {
    if values.len() != expected {
        return Err(Error::input(format!(
            "{name} has {} values instead of {expected}",
            values.len()
        ))
        .help("give one value per height and wavelength"));
    }
    match values.iter().find(|v| !v.is_finite()) {
        Some(v) => Err(Error::input(format!("{name} holds {v}")).help("finite numbers only")),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distortion_is_inverted_and_lateral_colour_sits_between_its_samples() {
        let lens = Characterisation::example(9, 0.5);
        for nm in [400.0, 475.0, 700.0] {
            let curve = lens.distortion(nm);
            for k in 0..=50 {
                let h = f64::from(k) * 0.01;
                assert!((curve.inverse(curve.at(h)) - h).abs() < 1e-10);
                let exact = h * (1.0 - 0.2 * h * h + 2e-5 * (nm - 550.0));
                assert!((curve.at(h) - exact).abs() < 1e-4, "{} instead of {exact}", curve.at(h));
            }
        }
    }

    #[test]
    fn bad_tables_are_refused() {
        let good = Characterisation::example(9, 0.5);
        good.validate().unwrap();
        let refused = |change: &dyn Fn(&mut Characterisation)| {
            let mut lens = good.clone();
            change(&mut lens);
            lens.validate().unwrap_err().to_string()
        };
        assert!(refused(&|l| l.heights_mm[0] = 0.01).contains("heights_mm"));
        assert!(refused(&|l| l.wavelengths_nm[1] = 400.0).contains("wavelengths_nm"));
        assert!(refused(&|l| l.real_height_mm[15] = 0.0).contains("falls"));
        assert!(refused(&|l| l.real_height_mm[1] = 1e-5).contains("on the axis"));
        let alone = |l: &mut Characterisation| {
            l.heights_mm.truncate(1);
            l.real_height_mm.truncate(3);
            l.relative_illumination.truncate(3);
            l.chief_ray_angle_deg = None;
        };
        assert!(refused(&alone).contains("the axis alone"));
        assert!(refused(&|l| l.psf.data[3] = -1e-3).contains("negative"));
        assert!(refused(&|l| l.psf.data.truncate(5)).contains("PSF samples"));
        assert!(refused(&|l| l.relative_illumination[2] = f64::NAN).contains("finite"));
    }
}
