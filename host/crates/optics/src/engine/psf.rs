//! From point-spread functions to kernels on the cell grid.

use super::sharpen::{box_sums, sharpened};
use super::stations::Stations;
use std::f64::consts::TAU;

/// The PSFs of a lens at one wavelength over the field: each n x n of unit sum, chief ray at sample
/// n/2.
pub struct PsfField {
    /// Where they are known, and how they lie.
    pub stations: Stations,
    /// Samples per side, n.
    pub size: usize,
    /// Distance of samples, µm.
    pub spacing_um: f64,
    /// One PSF per station, row-major.
    pub psfs: Vec<Vec<f32>>,
}

/// The grid that kernels are sampled on.
///
/// A kernel entry is the part of a cell's light that the photosensitive square of a pixel
/// receives, per area of the square and times the cell's. The pixel's centre lies (i − before +
/// (s−1)/2) cells from the cell's centre.
///
/// The cell holds an *average* of the scene, which the pixel's integral would blur a second time.
/// Averages are turned into point values (`sharpened`), so that no entry is negative and no light
/// is made or lost, however narrow the PSF. Where the whole pixel is photosensitive, an entry is a sum over the pixel's s x s cells, so that
/// pixels together receive all of a cell's light wherever it lies in its pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KernelGrid {
    /// Entries per side.
    pub size: usize,
    /// Index of offset 0 in cells, a multiple of s.
    pub before: usize,
    /// Cells per pixel, s.
    pub oversample: usize,
    /// Side of a cell, µm.
    pub cell_um: f64,
    /// Side of the photosensitive square, µm.
    pub aperture_um: f64,
}

/// Fraction of a PSF's light that a kernel may leave out at its rim; it is normalised afterwards.
/// A kernel's side, and with it the cost of a blur, grows with every decade less.
pub const TAIL: f64 = 1e-4;

/// The direction in which the rows of a PSF rise on the sensor where it is not turned.
pub const UPRIGHT: (f64, f64) = (0.0, 1.0);

impl KernelGrid {
    /// The smallest grid that holds PSFs of radius `radius_um`.
    #[must_use]
    pub fn new(oversample: usize, pitch_um: f64, aperture_um: f64, radius_um: f64) -> Self {
        let cell_um = pitch_um / oversample as f64;
        let reach = ((radius_um + 0.5 * aperture_um) / cell_um).ceil() as usize + 2;
        let before = (reach + oversample - 1).next_multiple_of(oversample);
        Self { size: before + reach + 1, before, oversample, cell_um, aperture_um }
    }
}

impl PsfField {
    /// Radius around the chief ray outside which no PSF has more than `tail` of its light, µm.
    #[must_use]
    pub fn radius_um(&self, tail: f64) -> f64 {
        let centre = (self.size / 2) as f64;
        let largest = self.psfs.iter().map(|psf| {
            // Light by distance in samples, from outside inwards.
            let mut rings = vec![0.0f64; self.size * 2];
            for (k, &v) in psf.iter().enumerate() {
                let (i, j) = ((k / self.size) as f64 - centre, (k % self.size) as f64 - centre);
                rings[libm::hypot(i, j).ceil() as usize] += f64::from(v);
            }
            let mut outside = 0.0;
            let ring = rings.iter().rposition(|light| {
                outside += light;
                outside > tail
            });
            ring.unwrap_or(0)
        });
        (largest.max().unwrap_or(0) as f64 + 0.5) * self.spacing_um
    }

    /// The larger of the radial and tangential MTF in the middle of the field, over frequency in
    /// cycles/mm.
    pub fn axial_mtf(&self) -> impl Fn(f64) -> f64 + use<> {
        // Line-spread functions: sums along and across.
        let mut lines = [vec![0.0f64; self.size], vec![0.0f64; self.size]];
        for (k, &v) in self.psfs[self.stations.middle()].iter().enumerate() {
            lines[0][k / self.size] += f64::from(v);
            lines[1][k % self.size] += f64::from(v);
        }
        let spacing_mm = self.spacing_um * 1e-3;
        move |per_mm| {
            let step = TAU * per_mm * spacing_mm;
            let modulus = |line: &Vec<f64>| {
                let (mut re, mut im) = (0.0, 0.0);
                for (i, v) in line.iter().enumerate() {
                    let (s, c) = libm::sincos(step * i as f64);
                    re += v * c;
                    im += v * s;
                }
                libm::hypot(re, im)
            };
            modulus(&lines[0]).max(modulus(&lines[1]))
        }
    }

    /// The PSF at a real image height: linear between tabulated heights, the last one beyond.
    fn at(&self, heights_mm: &[f64], height_mm: f64) -> Vec<f32> {
        let after = heights_mm.partition_point(|&h| h <= height_mm);
        if after == 0 || after == heights_mm.len() {
            return self.psfs[after.saturating_sub(1)].clone();
        }
        let (h0, h1) = (heights_mm[after - 1], heights_mm[after]);
        let t = ((height_mm - h0) / (h1 - h0)) as f32;
        self.psfs[after - 1].iter().zip(&self.psfs[after]).map(|(a, b)| a + t * (b - a)).collect()
    }

    /// The kernel for light whose chief ray lands at (x, y) mm from the optical axis, x right and
    /// y down. Sums to 1.
    #[must_use]
    pub fn kernel(&self, x_mm: f64, y_mm: f64, grid: &KernelGrid) -> Vec<f32> {
        self.displaced((x_mm, y_mm), (0.0, 0.0), grid)
    }

    /// The kernel of a cell at a place, mm right of and below the optical axis, whose chief ray
    /// lands `shift_mm` from there: lateral colour against the mapping that brought the cell
    /// there. Sums to 1.
    #[must_use]
    pub fn displaced(
        &self,
        (x_mm, y_mm): (f64, f64),
        shift_mm: (f64, f64),
        grid: &KernelGrid,
    ) -> Vec<f32> {
        let (x, y) = (x_mm + shift_mm.0, y_mm + shift_mm.1);
        let shift_um = (shift_mm.0 * 1e3, shift_mm.1 * 1e3);
        match &self.stations {
            Stations::Heights(heights_mm) => {
                let height = libm::hypot(x, y);
                // On the axis "radial" is down, as in the tables.
                let radial = if height > 0.0 { (x / height, y / height) } else { UPRIGHT };
                self.sharp(&self.at(heights_mm, height), radial, shift_um, grid)
            }
            Stations::Lattice(lattice) => {
                self.sharp(&lattice.blend(&self.psfs, x, y), UPRIGHT, shift_um, grid)
            }
        }
    }

    /// The kernel of a PSF whose rows rise along the unit vector `radial`.
    ///
    /// Every PSF sample counts as a square of its spacing, kept parallel to the grid (a square's
    /// second moments do not depend on its rotation), and is integrated exactly over the pixel's
    /// square.
    #[must_use]
    pub fn projected(&self, psf: &[f32], radial: (f64, f64), grid: &KernelGrid) -> Vec<f32> {
        self.sharp(psf, radial, (0.0, 0.0), grid)
    }

    /// As [`PsfField::projected`], of light that lands `shift_um` right of and below where it is.
    fn sharp(
        &self,
        psf: &[f32],
        radial: (f64, f64),
        shift_um: (f64, f64),
        grid: &KernelGrid,
    ) -> Vec<f32> {
        let cells = grid.cells();
        let light = sharpened(&self.integrated(psf, radial, shift_um, &cells), cells.size);
        let sums = box_sums(&light, cells.size, cells.size - grid.size + 1);
        let total: f64 = sums.iter().sum();
        sums.iter().map(|v| (v / total) as f32).collect()
    }

    /// The light of every PSF sample, `shift_um` right of and below where it is, in the pixel
    /// squares of all kernel indices.
    fn integrated(
        &self,
        psf: &[f32],
        radial: (f64, f64),
        shift_um: (f64, f64),
        grid: &KernelGrid,
    ) -> Vec<f64> {
        // The number of squares that a sample reaches along one axis; a loop of known length is
        // twice as fast.
        match grid.reached(self.spacing_um) {
            2 => self.integrated_over(2, psf, (radial, shift_um), grid),
            3 => self.integrated_over(3, psf, (radial, shift_um), grid),
            4 => self.integrated_over(4, psf, (radial, shift_um), grid),
            5 => self.integrated_over(5, psf, (radial, shift_um), grid),
            more => self.integrated_over(more, psf, (radial, shift_um), grid),
        }
    }

    #[inline(always)]
    fn integrated_over(
        &self,
        reached: usize,
        psf: &[f32],
        ((rx, ry), shift_um): ((f64, f64), (f64, f64)),
        grid: &KernelGrid,
    ) -> Vec<f64> {
        // The unit vector across.
        let (tx, ty) = (ry, -rx);
        let (centre, side, n) = ((self.size / 2) as f64, self.spacing_um, grid.size);
        // Below the rounding of f32 sums.
        const NEGLIGIBLE: f32 = 1e-8;
        let negligible = psf.iter().fold(0.0f32, |m, &v| m.max(v)) * NEGLIGIBLE;
        // Two squares overlap along an axis by the sum of their halves less their distance, at
        // most by the smaller.
        let (reach, most) = (0.5 * (side + grid.aperture_um), side.min(grid.aperture_um) / side);
        let share = |index: f64, place: f64| {
            let distance = (grid.offset_um(0) + index * grid.cell_um - place).abs();
            ((reach - distance) / side).clamp(0.0, most)
        };
        let first = |place: f64| ((place - reach - grid.offset_um(0)) / grid.cell_um).ceil();
        // A rim of `reached` entries takes what falls outside.
        let wide = n + 2 * reached;
        let mut sums = vec![0.0f64; wide * wide];
        let (mut across, mut down) = (vec![0.0f64; reached], vec![0.0f64; reached]);
        let inside = -(reached as f64)..=n as f64;
        for (i, row) in psf.chunks_exact(self.size).enumerate() {
            let along = (i as f64 - centre) * side;
            for (j, &value) in row.iter().enumerate() {
                if value <= negligible {
                    continue;
                }
                let beside = (j as f64 - centre) * side;
                let x = along * rx + beside * tx + shift_um.0;
                let y = along * ry + beside * ty + shift_um.1;
                let (left, top) = (first(x), first(y));
                if !inside.contains(&left) || !inside.contains(&top) {
                    continue;
                }
                for k in 0..reached {
                    across[k] = f64::from(value) * share(left + k as f64, x);
                    down[k] = share(top + k as f64, y);
                }
                let corner = (top as isize + reached as isize) as usize * wide
                    + (left as isize + reached as isize) as usize;
                for k in 0..reached {
                    let target = &mut sums[corner + k * wide..][..reached];
                    for l in 0..reached {
                        target[l] += down[k] * across[l];
                    }
                }
            }
        }
        let rows = sums.chunks_exact(wide).skip(reached).take(n);
        rows.flat_map(|row| &row[reached..reached + n]).copied().collect()
    }
}

impl KernelGrid {
    /// The grid whose entries, summed over squares, are this one's: the cells of a pixel that is
    /// photosensitive all over, or this grid.
    fn cells(&self) -> Self {
        let Self { size, oversample, cell_um, .. } = *self;
        match (self.aperture_um / cell_um - oversample as f64).abs() < 1e-9 {
            true => {
                Self { size: size + oversample - 1, oversample: 1, aperture_um: cell_um, ..*self }
            }
            false => *self,
        }
    }

    /// Offset of the pixel centre for a kernel index, µm.
    fn offset_um(&self, index: usize) -> f64 {
        (index as f64 - self.before as f64 + (self.oversample as f64 - 1.0) / 2.0) * self.cell_um
    }

    /// Most kernel indices, along one axis, whose pixel squares touch a PSF sample of side
    /// `side_um`.
    fn reached(&self, side_um: f64) -> usize {
        ((side_um + self.aperture_um) / self.cell_um).floor() as usize + 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaussian PSFs of the given radial and tangential sigma (µm), shifted along the radius (µm).
    fn gaussian(size: usize, spacing_um: f64, radial: f64, across: f64, shift: f64) -> PsfField {
        let c = (size / 2) as f64;
        let psf: Vec<f64> = (0..size * size)
            .map(|k| {
                let y = (((k / size) as f64 - c) * spacing_um - shift) / radial;
                let x = ((k % size) as f64 - c) * spacing_um / across;
                (-0.5 * (x * x + y * y)).exp()
            })
            .collect();
        let sum: f64 = psf.iter().sum();
        let psf: Vec<f32> = psf.iter().map(|v| (v / sum) as f32).collect();
        let stations = Stations::Heights(vec![0.0, 10.0]);
        PsfField { stations, size, spacing_um, psfs: vec![psf.clone(), psf] }
    }

    /// Centroid (x, y) and variances of a kernel around it, µm and µm².
    fn moments(kernel: &[f32], grid: &KernelGrid) -> [f64; 5] {
        let n = grid.size;
        let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
            (0..n * n)
                .map(|k| f64::from(kernel[k]) * f(grid.offset_um(k % n), grid.offset_um(k / n)))
                .sum()
        };
        let (x, y) = (sum(&|x, _| x), sum(&|_, y| y));
        let (xx, yy) = (sum(&|u, _| (u - x).powi(2)), sum(&|_, v| (v - y).powi(2)));
        [x, y, xx, yy, sum(&|u, v| (u - x) * (v - y))]
    }

    #[test]
    fn kernels_keep_place_shape_and_aperture_whatever_the_rotation() {
        for (size, oversample, angle) in
            [(64, 2, 0.0f64), (65, 3, 0.7), (64, 3, 2.2), (65, 4, -1.9)]
        {
            let field = gaussian(size, 0.25, 1.6, 1.1, 0.8);
            let grid = KernelGrid::new(oversample, 2.2, 1.9, field.radius_um(1e-6));
            let (sin, cos) = angle.sin_cos();
            let kernel = field.kernel(cos, sin, &grid);
            // Variance: PSF's, sample square's, aperture's, less the cell average's that comes on
            // top.
            let extra = (0.25f64.powi(2) + 1.9f64.powi(2) - grid.cell_um.powi(2)) / 12.0;
            let (radial, across) = (1.6f64.powi(2), 1.1f64.powi(2));
            let expected = [
                0.8 * cos,
                0.8 * sin,
                radial * cos * cos + across * sin * sin + extra,
                radial * sin * sin + across * cos * cos + extra,
                (radial - across) * sin * cos,
            ];
            let found = moments(&kernel, &grid);
            // The window cuts 1e-6 of the light; sums over cells of half a sigma stand for
            // integrals.
            for (f, e) in found.iter().zip(expected) {
                assert!((f - e).abs() < 2e-3, "{found:?} instead of {expected:?}");
            }
            assert!((kernel.iter().map(|&v| f64::from(v)).sum::<f64>() - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn kernels_of_any_ratio_of_psf_to_pixel_are_not_negative_and_keep_all_light() {
        // Whole pixels: cells of every place within a pixel give the pixels together all of their
        // light. Others: as much on the average.
        for sigma in [0.05, 0.2, 0.4, 0.7, 1.1, 1.7, 2.9, 5.0, 11.0] {
            let field = gaussian(64, 0.25 * sigma, sigma, 0.8 * sigma, 0.3 * sigma);
            for (s, pitch) in [(1, 6.0), (2, 2.0), (3, 6.0), (4, 30.0), (5, 6.0), (12, 30.0)] {
                for fill in [1.0f64, 0.7] {
                    let radius = field.radius_um(TAIL);
                    let grid = KernelGrid::new(s, pitch, pitch * fill.sqrt(), radius);
                    let kernel = field.kernel(0.3, 0.9, &grid);
                    assert!(kernel.iter().all(|&v| v >= 0.0), "σ {sigma}, pitch {pitch}");
                    let sum = |place: Option<(usize, usize)>| -> f64 {
                        let all = kernel.iter().enumerate();
                        let here = all.filter(|(k, _)| {
                            let at = (k / grid.size % s, k % grid.size % s);
                            place.is_none_or(|place| place == at)
                        });
                        here.map(|(_, &v)| f64::from(v)).sum()
                    };
                    assert!((sum(None) - 1.0).abs() < 1e-5);
                    for k in (0..s * s).filter(|_| fill == 1.0) {
                        let share = sum(Some((k / s, k % s))) * (s * s) as f64;
                        // What the kernel's rim cuts, and f32.
                        assert!((share - 1.0).abs() < 1e-4, "σ {sigma}, s {s}: {share}");
                    }
                }
            }
        }
    }
}
