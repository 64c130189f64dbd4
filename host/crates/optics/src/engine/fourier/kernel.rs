//! Kernels of optical transfer functions: what a pixel receives of the light of the cells around it.
//!
//! A band-limited PSF has no end, a kernel here has L x L cells. The kernel whose transform takes
//! given values H at the multiples of 1/(L·h), h the side of a cell, is
//!
//! K(x, y) = L⁻² Σ_jk H(j, k)·cos(2πjx/L)·cos(2πky/L), x and y counted from its centre.
//!
//! Its light is all of the light; what the PSF has beyond the support is folded back into it.
//!
//! - **The cell grid resolves the light**: H(f) = OTF(|f|)·A(fx)·A(fy) with A(f) = sinc(af)/sinc(hf),
//!   a the side of the photosensitive square, up to the cell grid's Nyquist frequency. The cell's own
//!   sinc is divided out, because the cells of a scene are averages already.
//! - **It does not**, as where the PSF is narrower than a cell, and that cut leaves more than
//!   [`MAX_NEGATIVE`] of the light negative: then the PSF is integrated over squares, at all
//!   frequencies that it has: H is summed over f + m/h for all m, with A(f) = sinc(hf), what cells
//!   receive of a point, of which s x s make a pixel; or A(f) = sinc(af)·sinc(hf) for photosensitive
//!   squares that do not consist of whole cells. No such entry is negative, and the sincs of cells,
//!   once or twice too many, are undone without making one so ([`sharpened`]).
//!
//! Either is right for the MTF of a pixel to 0.4 % up to its sampling frequency, for cells that keep
//! the default step error (lenses of λN = 0.4 to 4.4 µm on pixels of 1.4 to 30 µm).

use super::Geometry;
use crate::engine::Otf;
use crate::engine::sampling::{Layout, sinc};
use crate::engine::sharpen::{box_sums, sharpened};
use camrig_vector::vectorised;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Share of the light that a kernel may have below 0.
const MAX_NEGATIVE: f64 = 1e-5;

/// A kernel: a quadrant, from the centre outwards, row by row.
pub struct Kernel(Vec<Vec<f64>>);

impl Kernel {
    /// Of the rows of a quadrant, from the centre outwards.
    pub fn new(rows: Vec<Vec<f64>>) -> Self {
        Self(rows)
    }

    /// Of a transfer function that the cell grid resolves.
    pub fn of(otf: &Otf, geometry: &Geometry) -> Self {
        let (support, cell_mm) = (geometry.layout.support(), geometry.cell_mm());
        let step = 1.0 / (support as f64 * cell_mm);
        let passed = (otf.cutoff_per_mm / step).ceil() as usize;
        let terms = ((support - 1) / 2 + 1).min(passed).max(1);
        let aperture_mm = geometry.aperture_um * 1e-3;
        let gain = |f: f64| sinc(aperture_mm * f) / sinc(cell_mm * f);
        let value = |k: usize| {
            let [x, y] = [k / terms, k % terms].map(|i| i as f64 * step);
            gain(x) * gain(y) * (otf.at)(libm::hypot(x, y))
        };
        let samples: Vec<f64> = (0..terms * terms).map(value).collect();
        Self(quadrant(&samples, terms, support, support.is_multiple_of(2)))
    }

    /// Of the light that stays close, such that together with what goes `far` none of it is
    /// negative.
    pub fn of_core(
        core: &Otf,
        far: impl Fn(f64) -> f64 + Send + Sync,
        geometry: &Geometry,
    ) -> Self {
        let close = Self::of(core, geometry);
        let at = |f: f64| (core.at)(f) + far(f);
        let total_otf = Otf { at: Box::new(at), ..*core };
        let far = Self::of(&Otf { at: Box::new(&far), ..*core }, geometry);
        let mut total = Self::sum(&[(1.0, &close), (1.0, &far)]);
        if total.negative(geometry.layout) <= MAX_NEGATIVE {
            return close;
        }
        total = Self::integrated(&total_otf, geometry);
        Self::sum(&[(1.0, &total), (-1.0, &far)])
    }

    /// Σ weight · kernel, of kernels of one geometry.
    ///
    /// # Panics
    /// When there are none.
    pub fn sum(parts: &[(f64, &Self)]) -> Self {
        let n = parts[0].1.0.len();
        let row = |y: usize| {
            let mut sum = vec![0.0; n];
            for (weight, kernel) in parts {
                sum.iter_mut().zip(&kernel.0[y]).for_each(|(s, v)| *s += weight * v);
            }
            sum
        };
        Self((0..n).map(row).collect())
    }

    /// All its values, row by row.
    pub fn values(&self, geometry: &Geometry) -> Vec<f64> {
        whole(&self.0, geometry.layout.support())
    }

    /// The rows of the quadrant.
    pub fn rows(&self) -> &[Vec<f64>] {
        &self.0
    }

    /// All of its light.
    pub fn light(&self, layout: &Layout) -> f64 {
        self.total(layout, |v| v)
    }

    /// The light below 0.
    fn negative(&self, layout: &Layout) -> f64 {
        self.total(layout, |v| (-v).max(0.0))
    }

    /// The sum over all its values.
    fn total(&self, layout: &Layout, of: impl Fn(f64) -> f64) -> f64 {
        let twice = |i: usize| if i == 0 && layout.support() % 2 == 1 { 1.0 } else { 2.0 };
        let row = |(y, row): (usize, &Vec<f64>)| -> f64 {
            row.iter().enumerate().map(|(x, v)| twice(x) * twice(y) * of(*v)).sum()
        };
        self.0.iter().enumerate().map(row).sum()
    }

    /// Of any transfer function of a PSF, integrated over squares.
    fn integrated(otf: &Otf, geometry: &Geometry) -> Self {
        let (support, s) = (geometry.layout.support(), geometry.layout.oversample);
        let (cell_mm, aperture_mm) = (geometry.cell_mm(), geometry.aperture_um * 1e-3);
        let whole = (aperture_mm / cell_mm - s as f64).abs() < 1e-9;
        let values = match whole {
            // Cells about places a whole number of cells from the centre.
            true => {
                let n = support + s - 1;
                let light = folded(otf, cell_mm, |f| sinc(cell_mm * f), n, false);
                box_sums(&sharpened(&light, n), n, s)
            }
            false => {
                let gain = |f: f64| sinc(aperture_mm * f) * sinc(cell_mm * f);
                let even = support.is_multiple_of(2);
                let light = folded(otf, cell_mm, gain, support, even);
                sharpened(&sharpened(&light, support), support)
            }
        };
        let total = values.iter().sum::<f64>() / (otf.at)(0.0);
        let half = support.div_ceil(2);
        let rows = values.chunks_exact(support).skip(support - half);
        let quarter = |row: &[f64]| row[support - half..].iter().map(|v| v / total).collect();
        Self(rows.map(quarter).collect())
    }
}

impl Geometry<'_> {
    fn cell_mm(&self) -> f64 {
        self.pitch_um * 1e-3 / self.layout.oversample as f64
    }
}

/// The `n` x `n` values at the places of cells of the function whose transform is OTF(|f|)·gain(fx)
/// ·gain(fy), about a centre that lies on a cell or, with `between`, between two.
fn folded(
    otf: &Otf,
    cell_mm: f64,
    gain: impl Fn(f64) -> f64,
    n: usize,
    between: bool,
) -> Vec<f64> {
    // The OTF of light within the support has no detail finer than 2 steps.
    const FINE: f64 = 16.0;
    let step = 1.0 / (n as f64 * cell_mm);
    let orders = (otf.cutoff_per_mm / (step * n as f64) + 0.5).ceil() as isize;
    let table: Vec<f64> = (0..=(otf.cutoff_per_mm / step * FINE) as usize + 1)
        .map(|k| k as f64 * step / FINE)
        .map(|f| if f < otf.cutoff_per_mm { (otf.at)(f) } else { 0.0 })
        .collect();
    let at = |index: f64| {
        let k = index as usize;
        let pair = (table.get(k), table.get(k + 1));
        pair.0.zip(pair.1).map_or(0.0, |(a, b)| a + (index - k as f64) * (b - a))
    };
    let terms = (n - 1) / 2 + 1;
    // Of a frequency, its images and their gains.
    let images = |k: usize| -> Vec<(f64, f64)> {
        let image = |m: isize| {
            let index = k as f64 + (m * n as isize) as f64;
            let sign = if between && m % 2 != 0 { -1.0 } else { 1.0 };
            (index, sign * gain(index * step))
        };
        (-orders..=orders).map(image).collect()
    };
    let images: Vec<Vec<(f64, f64)>> = (0..terms).map(images).collect();
    let value = |k: usize| -> f64 {
        let (down, across) = (&images[k / terms], &images[k % terms]);
        let of_row = |&(y, gain_y): &(f64, f64)| -> f64 {
            let sum = across.iter().map(|&(x, gain_x)| gain_x * at(FINE * libm::hypot(x, y)));
            gain_y * sum.sum::<f64>()
        };
        down.iter().map(of_row).sum()
    };
    let samples: Vec<f64> = (0..terms * terms).into_par_iter().map(value).collect();
    let all = whole(&quadrant(&samples, terms, n, between), n);
    all.into_iter().map(|v| v.max(0.0)).collect()
}

/// All `n` x `n` values of a quadrant.
fn whole(quadrant: &[Vec<f64>], n: usize) -> Vec<f64> {
    let from_centre = |i: usize| if i < n / 2 { (n - 1) / 2 - i } else { i - n / 2 };
    (0..n * n).map(|k| quadrant[from_centre(k / n)][from_centre(k % n)]).collect()
}

/// A quadrant of the kernel of `support` cells whose transform has these `terms` x `terms` samples,
/// from the centre outwards, row by row; with `between`, the centre lies between two cells.
fn quadrant(samples: &[f64], terms: usize, support: usize, between: bool) -> Vec<Vec<f64>> {
    let half = support.div_ceil(2);
    // Places in half cells.
    let turn = |n: usize| libm::cos(TAU * (n % (2 * support)) as f64 / (2 * support) as f64);
    let turns: Vec<f64> = (0..2 * support).map(turn).collect();
    let cosines: Vec<Vec<f64>> = (0..terms)
        .map(|j| {
            let weight = if j == 0 { 1.0 } else { 2.0 } / support as f64;
            let place = |i: usize| 2 * i + usize::from(between);
            (0..half).map(|i| weight * turns[j * place(i) % (2 * support)]).collect()
        })
        .collect();
    let by_row: Vec<Vec<f64>> =
        samples.par_chunks(terms).map(|row| combined(row, &cosines)).collect();
    let column = |i: usize| -> Vec<f64> { cosines.iter().map(|of_term| of_term[i]).collect() };
    (0..half).into_par_iter().map(|i| combined(&column(i), &by_row)).collect()
}

/// Σ weight · row.
#[vectorised]
fn combined(weights: &[f64], rows: &[Vec<f64>]) -> Vec<f64> {
    let mut sum = vec![0.0f64; rows[0].len()];
    for (weight, row) in weights.iter().zip(rows) {
        sum.iter_mut().zip(row).for_each(|(sum, v)| *sum += weight * v);
    }
    sum
}
