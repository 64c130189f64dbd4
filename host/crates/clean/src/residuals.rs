//! Residuals of a band: samples minus their pixel's median over time, after the level of each
//! frame was equalised.
//!
//! Levels are equalised first, of flats by a factor, of darks by an offset, for each position in
//! the colour filter pattern. Otherwise a frame that is brighter as a whole would shift the medians
//! that single samples are compared with.

use super::band::Band;
use super::scan::Scan;
use camrig_base::median::median;
use camrig_base::tails;
use camrig_captures::{CaptureSet, Role};
use rayon::prelude::*;

/// Residuals are clipped to this many standard deviations in the means of rows.
const CLIP: f64 = 4.0;
/// Variance of row means relative to white noise above which rows are equalised too: over hundreds
/// of rows and frames, noise alone scatters by a few per cent.
const MIN_ROW_EXCESS: f64 = 1.5;
/// A column's median variance relative to that of all columns above which the column has a variance
/// of its own: with 10 rows of 10 frames it scatters by 20 %. Noise along a column is not an event.
const MIN_COLUMN_EXCESS: f64 = 1.35;
/// Rows from which columns have a variance of their own.
const MIN_ROWS_FOR_COLUMNS: usize = 16;
/// Variance from rounding to whole DN, DN²: no sample is known better.
pub const ROUNDING_DN2: f64 = 1.0 / 12.0;

/// What equalises the levels of the frames of a stack.
pub struct FrameLevels {
    /// For each frame and position in the pattern.
    corrections: Vec<Vec<Equaliser>>,
    /// Columns and rows of the pattern.
    pattern: (usize, usize),
}

/// Sample × factor + offset.
#[derive(Clone, Copy)]
struct Equaliser {
    factor: f32,
    offset: f32,
}

impl FrameLevels {
    /// Of a stack whose level without light is `black`, DN.
    pub fn new(set: &CaptureSet, scan: &Scan, black: f64) -> Self {
        let cfa = set.cfa();
        let means = scan.site_levels();
        let flat = set.captures[scan.capture].role == Role::Flat;
        let of_site = |level: f64, mean: f64| {
            let factor = (mean - black) / (level - black);
            match flat && mean - black > 1.0 && (0.1..10.0).contains(&factor) {
                true => {
                    Equaliser { factor: factor as f32, offset: (black * (1.0 - factor)) as f32 }
                }
                false => Equaliser { factor: 1.0, offset: (mean - level) as f32 },
            }
        };
        let of_frame = |levels: &Vec<f64>| -> Vec<Equaliser> {
            levels.iter().zip(&means).map(|(&l, &m)| of_site(l, m)).collect()
        };
        Self {
            corrections: scan.frames.iter().map(|f| of_frame(&f.levels)).collect(),
            pattern: (cfa.width, cfa.height),
        }
    }

    fn site(&self, x: usize, y: usize) -> usize {
        y % self.pattern.1 * self.pattern.0 + x % self.pattern.0
    }
}

/// Residuals of a band with equalised frames.
pub struct Residuals {
    /// Columns.
    pub width: usize,
    /// Number of frames.
    pub frames: usize,
    /// Median over time of each pixel, DN.
    pub median: Vec<f32>,
    /// Samples minus their pixel's median, DN, pixel by pixel.
    pub values: Vec<f32>,
    /// Variance over time of each pixel, DN².
    pub variance: Vec<f32>,
    /// Robust typical variance of a pixel, DN².
    pub typical_variance: f64,
    /// Median of `median`, DN.
    pub level: f64,
}

impl Residuals {
    /// Of a band of a stack with these levels.
    pub fn new(band: &Band, levels: &FrameLevels) -> Self {
        let (width, n) = (band.width, band.frames);
        let pixels = band.pixels();
        let mut values = vec![0.0f32; pixels * n];
        let mut medians = vec![0.0f32; pixels];
        let rows = values.par_chunks_mut(width * n).zip(medians.par_chunks_mut(width));
        rows.zip(band.samples.par_chunks(width * n)).enumerate().for_each(|(y, row)| {
            let ((out, medians), samples) = row;
            let mut sorted = vec![0.0f32; n];
            let pixels = out.chunks_mut(n).zip(samples.chunks(n)).zip(medians);
            for (x, ((out, samples), median)) in pixels.enumerate() {
                let site = levels.site(x, band.first_row + y);
                for (i, (o, &v)) in out.iter_mut().zip(samples).enumerate() {
                    let Equaliser { factor, offset } = levels.corrections[i][site];
                    *o = f32::from(v) * factor + offset;
                }
                sorted.copy_from_slice(out);
                sorted.sort_unstable_by(f32::total_cmp);
                *median = 0.5 * (sorted[n / 2] + sorted[(n - 1) / 2]);
                out.iter_mut().for_each(|o| *o -= *median);
            }
        });
        let mut all = Self {
            width,
            frames: n,
            level: f64::from(median(&mut medians.clone(), f32::total_cmp)),
            median: medians,
            values,
            variance: vec![0.0; pixels],
            typical_variance: 0.0,
        };
        all.update_variances();
        if all.equalise_rows() {
            all.update_variances();
        }
        all
    }

    /// Computes the variances from the residuals.
    fn update_variances(&mut self) {
        let n = self.frames;
        let dof = (n as f64 - 1.0).max(1.0);
        let of_pixel = |r: &[f32]| (r.iter().map(|r| f64::from(r * r)).sum::<f64>() / dof) as f32;
        self.variance = self.values.par_chunks(n).map(of_pixel).collect();
        let middle = f64::from(median(&mut self.variance.clone(), f32::total_cmp));
        let middle = middle / tails::median_of_squares(dof);
        // Where most pixels never change, the mean of all but the noisiest per cent is more
        // informative than the median.
        let mut sorted = self.variance.clone();
        let most = sorted.len() - 1 - sorted.len() / 100;
        sorted.select_nth_unstable_by(most, f32::total_cmp);
        let mean = sorted[..most.max(1)].iter().map(|&v| f64::from(v)).sum::<f64>();
        let mean = mean / most.max(1) as f64;
        let coarse = middle < ROUNDING_DN2;
        let typical = if coarse { middle.max(mean) } else { middle };
        self.typical_variance = typical.max(ROUNDING_DN2);
    }

    /// Subtracts the mean of each row of each frame where rows share noise. Returns whether it did.
    fn equalise_rows(&mut self) -> bool {
        let (width, n) = (self.width, self.frames);
        let limit = (CLIP * self.typical_variance.sqrt()) as f32;
        let means: Vec<Vec<f32>> = self
            .values
            .par_chunks(width * n)
            .map(|row| {
                let mut sums = vec![0.0f32; n];
                for pixel in row.chunks(n) {
                    sums.iter_mut().zip(pixel).for_each(|(s, r)| *s += r.clamp(-limit, limit));
                }
                sums.into_iter().map(|s| s / width as f32).collect()
            })
            .collect();
        let squares = means.iter().flatten().map(|m| f64::from(m * m)).sum::<f64>();
        let variance = squares / (means.len() * n).max(1) as f64;
        let shared = variance * width as f64 > MIN_ROW_EXCESS * self.typical_variance;
        if shared {
            self.values.par_chunks_mut(width * n).zip(&means).for_each(|(row, means)| {
                for pixel in row.chunks_mut(n) {
                    pixel.iter_mut().zip(means).for_each(|(r, m)| *r -= m);
                }
            });
        }
        shared
    }

    /// Expected variance of each pixel, DN²: the typical one, plus the shot noise of its signal
    /// above the typical level with `dn_per_e` DN per electron, scaled by the column's factor where
    /// columns differ in noise.
    pub fn expected_variance(&self, dn_per_e: f64) -> Vec<f32> {
        let columns = self.column_factors();
        self.median
            .iter()
            .enumerate()
            .map(|(p, &m)| {
                let shot = dn_per_e * (f64::from(m) - self.level);
                let v = self.typical_variance + shot.max(-0.5 * self.typical_variance);
                (v * columns[p % self.width]).max(ROUNDING_DN2) as f32
            })
            .collect()
    }

    /// Variance of each column relative to the typical one, 1 where the excess is insignificant.
    fn column_factors(&self) -> Vec<f64> {
        let rows = self.median.len() / self.width;
        if rows < MIN_ROWS_FOR_COLUMNS {
            return vec![1.0; self.width];
        }
        let dof = (self.frames as f64 - 1.0).max(1.0);
        let scale = self.typical_variance * tails::median_of_squares(dof);
        (0..self.width)
            .map(|x| {
                let mut column: Vec<f32> =
                    self.variance.iter().skip(x).step_by(self.width).copied().collect();
                let factor = f64::from(median(&mut column, f32::total_cmp)) / scale;
                if factor > MIN_COLUMN_EXCESS { factor } else { 1.0 }
            })
            .collect()
    }

    /// Mean over pixels of the variance, the noisiest clipped, DN².
    pub fn mean_variance(&self) -> f64 {
        let limit = 8.0 * self.typical_variance;
        let sum: f64 = self.variance.iter().map(|&v| f64::from(v).min(limit)).sum();
        sum / self.variance.len().max(1) as f64
    }
}
