//! A lens that is not rotationally symmetric, as tables over the plane of the image.
//!
//! # Conventions
//! - Places are mm right of and below the origin of the image plane in the **upright picture**, as
//!   on a frame of the sensor. Tables are indexed by the **ideal place** of the field point: the
//!   principal distance times the tangents of the angles before the lens.
//! - Distortion is stored forward: the real place at which the chief ray of *that wavelength*
//!   lands; a PSF is centred on that same chief ray, its columns rise to the right and its rows
//!   downwards.
//! - Relative illumination is the irradiance of a uniform Lambertian scene over that in the middle
//!   of the field, where the field angles are 0.
//! - Between places: bicubic, PSFs bilinear; between wavelengths: linear. Outside the table:
//!   distortion goes on along its end slopes, illumination and PSFs keep their values at the edge;
//!   [`super::extent`] finds where a sensor or its light goes beyond.

use super::{Between, axis, bracket, positive, table};
use crate::bicubic::BicubicTable;
use crate::engine::psf::PsfField;
use crate::engine::stations::{Lattice, Stations};
use crate::engine::{Blur, Lens, OverField};
use camrig_base::Spectrum;
use camrig_base::{Error, Result};
use std::f64::consts::PI;

/// A lens as tables over the plane of the image (module documentation: conventions). Tables are
/// `[y][x][wavelength]`, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaneCharacterisation {
    /// Name of the lens.
    pub name: String,
    /// Where the figures come from: program, file, method; free text.
    pub source: String,
    /// Ideal image height over the tangent of the angle before the lens, mm.
    pub principal_distance_mm: f64,
    /// Image-side f-number in the middle of the field, as eq. 7 has it.
    pub working_f_number: f64,
    /// Transmittance of the lens.
    pub transmittance: Spectrum,
    /// Wavelengths, nm, strictly rising.
    pub wavelengths_nm: Vec<f64>,
    /// Ideal places of the columns, mm right of the origin, strictly rising.
    pub x_mm: Vec<f64>,
    /// Ideal places of the rows, mm below the origin, strictly rising.
    pub y_mm: Vec<f64>,
    /// Real places of chief rays, mm right of the origin.
    pub real_x_mm: Vec<f64>,
    /// Real places of chief rays, mm below the origin.
    pub real_y_mm: Vec<f64>,
    /// Irradiance over that in the middle of the field.
    pub relative_illumination: Vec<f64>,
    /// Samples per side of a PSF, n.
    pub psf_size: usize,
    /// Distance of PSF samples, µm.
    pub psf_spacing_um: f64,
    /// `[y][x][wavelength][row][column]`, each n x n block of unit sum.
    pub psf: Vec<f32>,
    /// Fraction of each PSF's energy inside its window.
    pub captured: Vec<f64>,
    /// Error of PSFs between the places, where it was measured.
    pub between: Option<Between>,
}

/// Real over ideal places at one wavelength, and back.
#[derive(Clone, Debug)]
struct Places {
    real: [BicubicTable; 2],
}

impl Places {
    fn real(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.real[0].at(x, y), self.real[1].at(x, y)]
    }

    /// The ideal place of a real one, by Newton's method.
    fn ideal(&self, real: [f64; 2]) -> [f64; 2] {
        // mm: for the differences that stand for slopes; where the search ends; its bound, of
        // which a few are used, since steps double the digits.
        const STEP: f64 = 1e-5;
        const ENOUGH: f64 = 1e-12;
        const ROUNDS: usize = 30;
        let mut place = real;
        for _ in 0..ROUNDS {
            let here = self.real(place);
            let off = [here[0] - real[0], here[1] - real[1]];
            let slope = |k: usize| {
                let beside = |by: f64| {
                    let mut other = place;
                    other[k] += by;
                    self.real(other)
                };
                let (ahead, behind) = (beside(STEP), beside(-STEP));
                [0, 1].map(|i| (ahead[i] - behind[i]) / (2.0 * STEP))
            };
            let ([a, c], [b, d]) = (slope(0), slope(1));
            let determinant = a * d - b * c;
            place[0] -= (d * off[0] - b * off[1]) / determinant;
            place[1] -= (a * off[1] - c * off[0]) / determinant;
            if off[0].abs().max(off[1].abs()) < ENOUGH {
                break;
            }
        }
        place
    }
}

impl PlaneCharacterisation {
    /// Checks every length and value.
    ///
    /// # Errors
    /// The first value that breaks the conventions, with what would be right.
    pub fn validate(&self) -> Result<()> {
        axis("wavelengths_nm", &self.wavelengths_nm, None)?;
        for (name, values) in [("x_mm", &self.x_mm), ("y_mm", &self.y_mm)] {
            axis(name, values, None)?;
            if values.len() < 2 {
                return Err(Error::input(format!("{name} has one value"))
                    .help("give at least two columns and two rows of places"));
            }
        }
        positive("principal_distance_mm", self.principal_distance_mm)?;
        positive("working_f_number", self.working_f_number)?;
        positive("psf.spacing_um", self.psf_spacing_um)?;
        if let Some((nm, v)) = self.transmittance.samples().find(|(_, v)| !(0.0..=1.0).contains(v))
        {
            return Err(Error::input(format!("transmittance {v} at {nm} nm"))
                .help("a transmittance lies in 0..=1"));
        }
        let cells = self.x_mm.len() * self.y_mm.len() * self.wavelengths_nm.len();
        table("distortion x", &self.real_x_mm, cells)?;
        table("distortion y", &self.real_y_mm, cells)?;
        table("relative_illumination", &self.relative_illumination, cells)?;
        table("psf.captured", &self.captured, cells)?;
        if let Some(v) = self.relative_illumination.iter().find(|v| **v < 0.0) {
            return Err(Error::input(format!("relative illumination {v}"))
                .help("it is a ratio to the irradiance in the middle, not negative"));
        }
        self.validate_folds()?;
        self.validate_psfs(cells)
    }

    /// The image must not fold: every cell keeps its orientation at each of its corners.
    fn validate_folds(&self) -> Result<()> {
        let (across, columns) = (self.x_mm.len(), self.wavelengths_nm.len());
        for (w, nm) in self.wavelengths_nm.iter().enumerate() {
            let at = |i: usize, j: usize| {
                let k = (j * across + i) * columns + w;
                [self.real_x_mm[k], self.real_y_mm[k]]
            };
            for (i, j) in (1..self.y_mm.len()).flat_map(|j| (1..across).map(move |i| (i, j))) {
                let corners = [at(i - 1, j - 1), at(i, j - 1), at(i, j), at(i - 1, j)];
                let turns = (0..4).map(|k| {
                    let [a, b, c] = [0, 1, 2].map(|n| corners[(k + n) % 4]);
                    (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
                });
                if turns.fold(f64::INFINITY, f64::min) <= 0.0 {
                    return Err(Error::input(format!(
                        "real places fold about the ideal place ({}, {}) mm, {nm} nm",
                        self.x_mm[i], self.y_mm[j]
                    ))
                    .at("distortion")
                    .help("distortion that folds the image cannot be inverted; use less of it"));
                }
            }
        }
        Ok(())
    }

    fn validate_psfs(&self, cells: usize) -> Result<()> {
        let n2 = self.psf_size.checked_mul(self.psf_size).filter(|&n2| n2 > 0);
        let Some(n2) = n2.filter(|n2| n2.checked_mul(cells) == Some(self.psf.len())) else {
            return Err(Error::input(format!(
                "{} PSF samples for {cells} PSFs of {} x {}",
                self.psf.len(),
                self.psf_size,
                self.psf_size
            ))
            .help("give one square PSF per place and wavelength"));
        };
        for (k, block) in self.psf.chunks_exact(n2).enumerate() {
            let sum: f64 = block.iter().map(|&v| f64::from(v)).sum();
            if block.iter().any(|v| !v.is_finite() || *v < 0.0) || (sum - 1.0).abs() > 1e-5 {
                let node = k / self.wavelengths_nm.len();
                let (x, y) = (node % self.x_mm.len(), node / self.x_mm.len());
                return Err(Error::input(format!("PSF with sum {sum}, or with negative samples"))
                    .at(format!(
                        "PSF at ({}, {}) mm, {} nm",
                        self.x_mm[x],
                        self.y_mm[y],
                        self.wavelengths_nm[k % self.wavelengths_nm.len()]
                    ))
                    .help("samples are not negative and sum to 1 over the window"));
            }
        }
        Ok(())
    }

    /// A table at one wavelength, over ideal places.
    fn at_wavelength(&self, table: &[f64], nm: f64) -> BicubicTable {
        let (i, t) = bracket(&self.wavelengths_nm, nm);
        let between =
            |row: &[f64]| if t == 0.0 { row[i] } else { row[i] + t * (row[i + 1] - row[i]) };
        let values: Vec<f64> =
            table.chunks_exact(self.wavelengths_nm.len()).map(between).collect();
        BicubicTable::new(self.x_mm.clone(), self.y_mm.clone(), &values)
    }

    fn places(&self, nm: f64) -> Places {
        let table = |values: &[f64]| self.at_wavelength(values, nm);
        Places { real: [table(&self.real_x_mm), table(&self.real_y_mm)] }
    }

    /// Real place, mm right of and below the origin, of an ideal one at a wavelength.
    #[must_use]
    pub fn real_place(&self, nm: f64, ideal_mm: [f64; 2]) -> [f64; 2] {
        self.places(nm).real(ideal_mm)
    }

    /// The PSFs of all places at a wavelength.
    fn psfs(&self, nm: f64) -> Vec<Vec<f32>> {
        let n2 = self.psf_size * self.psf_size;
        let (i, t) = bracket(&self.wavelengths_nm, nm);
        self.psf
            .chunks_exact(n2 * self.wavelengths_nm.len())
            .map(|place| {
                let psf = |w: usize| &place[w * n2..][..n2];
                if t == 0.0 {
                    return psf(i).to_vec();
                }
                psf(i).iter().zip(psf(i + 1)).map(|(&a, &b)| a + t as f32 * (b - a)).collect()
            })
            .collect()
    }
}

impl Lens for PlaneCharacterisation {
    fn steradians(&self, nm: f64) -> f64 {
        PI * self.transmittance.at(nm) / (1.0 + 4.0 * self.working_f_number.powi(2))
    }

    fn illumination(&self, nm: f64) -> Option<OverField<'_, f64>> {
        let ratios = self.at_wavelength(&self.relative_illumination, nm);
        let places = self.places(nm);
        let inside = |v: f64, axis: &[f64]| v.clamp(axis[0], axis[axis.len() - 1]);
        Some(OverField::Plane(Box::new(move |x, y| {
            let [x, y] = places.ideal([x, y]);
            ratios.at(inside(x, &self.x_mm), inside(y, &self.y_mm)).max(0.0)
        })))
    }

    fn ideal_place(&self, nm: f64) -> Option<OverField<'_, (f64, f64)>> {
        let places = self.places(nm);
        Some(OverField::Plane(Box::new(move |x, y| {
            let [x, y] = places.ideal([x, y]);
            (x, y)
        })))
    }

    fn principal_distance_mm(&self) -> f64 {
        self.principal_distance_mm
    }

    fn blur(&self, nm: f64) -> Blur<'_> {
        let places = self.places(nm);
        Blur::Field {
            psfs: PsfField {
                stations: Stations::Lattice(Lattice {
                    x_mm: self.x_mm.clone(),
                    y_mm: self.y_mm.clone(),
                    ideal: Box::new(move |x, y| {
                        let [x, y] = places.ideal([x, y]);
                        (x, y)
                    }),
                }),
                size: self.psf_size,
                spacing_um: self.psf_spacing_um,
                psfs: self.psfs(nm),
            },
            cutoff_per_mm: 1e6 / (nm * self.working_f_number),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::reference::tests::engine;
    use crate::{Characterisation, Options, SensorGrid};

    /// Round Gaussian spots of `size`² samples, 0.5 µm apart, that widen with the height.
    fn spot(size: usize, height_mm: f64) -> Vec<f32> {
        let sigma = 1.5 + 3.0 * height_mm * height_mm;
        let value = |k: usize| {
            let place = |i: usize| (i as f64 - (size / 2) as f64) * 0.5 / sigma;
            libm::exp(-0.5 * (place(k / size).powi(2) + place(k % size).powi(2)))
        };
        let sum: f64 = (0..size * size).map(value).sum();
        (0..size * size).map(|k| (value(k) / sum) as f32).collect()
    }

    /// A lens over heights whose spots are round, and the same lens over the plane.
    pub(in super::super) fn twice(
        heights: usize,
        nodes: usize,
    ) -> (Characterisation, PlaneCharacterisation) {
        const SIZE: usize = 33;
        let radial = |h: f64| h * (1.0 - 0.2 * h * h);
        let ratio = |h: f64| 1.0 / (1.0 + h * h).powi(2);
        let mut lens = Characterisation::example(SIZE, 0.5);
        lens.wavelengths_nm = vec![550.0];
        lens.psf.wavelengths_nm = vec![550.0];
        lens.heights_mm = (0..heights).map(|i| 0.5 * i as f64 / (heights - 1) as f64).collect();
        lens.psf.heights_mm = lens.heights_mm.clone();
        lens.real_height_mm = lens.heights_mm.iter().map(|&h| radial(h)).collect();
        lens.relative_illumination = lens.heights_mm.iter().map(|&h| ratio(h)).collect();
        lens.chief_ray_angle_deg = None;
        lens.psf.data = lens.heights_mm.iter().flat_map(|&h| spot(SIZE, h)).collect();
        lens.validate().unwrap();
        let axis: Vec<f64> =
            (0..nodes).map(|i| 0.36 * (2.0 * i as f64 / (nodes - 1) as f64 - 1.0)).collect();
        let all: Vec<[f64; 2]> =
            axis.iter().flat_map(|&y| axis.iter().map(move |&x| [x, y])).collect();
        let height = |p: &[f64; 2]| p[0].hypot(p[1]);
        let shrink = |p: &[f64; 2]| 1.0 - 0.2 * height(p).powi(2);
        let plane = PlaneCharacterisation {
            name: "example".into(),
            source: "closed form".into(),
            principal_distance_mm: lens.principal_distance_mm(),
            working_f_number: lens.working_f_number(),
            transmittance: lens.transmittance.clone(),
            wavelengths_nm: vec![550.0],
            real_x_mm: all.iter().map(|p| p[0] * shrink(p)).collect(),
            real_y_mm: all.iter().map(|p| p[1] * shrink(p)).collect(),
            relative_illumination: all.iter().map(|p| ratio(height(p))).collect(),
            psf_size: SIZE,
            psf_spacing_um: 0.5,
            psf: all.iter().flat_map(|p| spot(SIZE, height(p))).collect(),
            captured: vec![1.0; all.len()],
            between: None,
            x_mm: axis.clone(),
            y_mm: axis,
        };
        plane.validate().unwrap();
        (lens, plane)
    }

    #[test]
    fn a_round_lens_gives_the_same_picture_over_heights_and_over_the_plane() {
        let (lens, plane) = twice(41, 33);
        let grid = SensorGrid { width: 64, height: 48, pitch_um: 8.0, fill_factor: 0.7 };
        let options = Options { misplaced_light: 1e-3, ..Options::default() };
        let (by_height, _) = engine(&lens, &grid, 2, &options);
        let (by_place, report) = engine(&plane, &grid, 2, &options);
        let peak = 2.0 * lens.steradians(550.0);
        let pairs = by_height.data.iter().zip(&by_place.data);
        let worst = pairs.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max) / peak;
        println!("largest difference {worst:.1e} of the brightest radiance");
        // Either may misplace 1e-3 of the light between its nodes.
        assert!(worst < 1e-3, "{worst}");
        let between = report.nodes.unwrap().heights.unwrap();
        assert!(between.mean > 0.0 && between.mean < 1e-2, "{between:?}");
    }

    #[test]
    fn ideal_places_undo_real_ones() {
        let (lens, plane) = twice(41, 33);
        let (by_height, by_place) =
            (lens.ideal_place(550.0).unwrap(), plane.ideal_place(550.0).unwrap());
        for (x, y) in [(0.0, 0.0), (0.1, -0.2), (-0.3, 0.25), (0.33, 0.33)] {
            let ((a, b), (c, d)) = (by_height.at(x, y), by_place.at(x, y));
            let [e, f] = plane.real_place(550.0, [c, d]);
            assert!((e - x).abs() < 1e-11 && (f - y).abs() < 1e-11, "({e}, {f}) not ({x}, {y})");
            assert!((a - c).abs() < 1e-5 && (b - d).abs() < 1e-5, "({a}, {b}), ({c}, {d})");
        }
    }

    #[test]
    fn bad_tables_are_refused() {
        let (_, good) = twice(41, 5);
        let refused = |change: &dyn Fn(&mut PlaneCharacterisation)| {
            let mut lens = good.clone();
            change(&mut lens);
            lens.validate().unwrap_err().to_string()
        };
        assert!(refused(&|l| l.real_x_mm[12] = 9.0).contains("fold"));
        assert!(refused(&|l| l.real_y_mm.truncate(3)).contains("distortion y"));
        assert!(refused(&|l| l.psf[3] = -1.0).contains("negative"));
        assert!(refused(&|l| l.x_mm[1] = -7.0).contains("x_mm"));
        assert!(refused(&|l| l.psf_size = usize::MAX).contains("PSF samples"));
    }
}
