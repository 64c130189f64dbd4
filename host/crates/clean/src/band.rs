//! Some rows of all frames of a stack, and their residuals once frames and rows are level.
//!
//! Frames are made level first: of flats by a factor, of darks by an offset, for each place in the
//! colour filter pattern. Otherwise a frame that is brighter as a whole would bend the medians
//! over time that single samples are compared with.

use super::scan::Scan;
use camrig_base::Result;
use camrig_base::median::median;
use camrig_base::tails;
use camrig_captures::{Capture, CaptureSet, Role};
use rayon::prelude::*;
use std::ops::Range;

/// Samples of a band, at most: 64 MiB, and twice as much for their residuals.
const MAX_SAMPLES: usize = 1 << 25;
/// Residuals count at most so many standard deviations in means of rows.
const CLIP: f64 = 4.0;
/// Variance of row means over that of white noise from which rows are made level too: over
/// hundreds of rows and frames noise alone scatters by some per cent.
const ROWS_STAND_OUT: f64 = 1.5;
/// A column's median variance over that of all from which it is its own: with 10 rows of 10 frames
/// it scatters by 20 %. Noise that falls along rows is not an event of a column.
const COLUMN_STANDS_OUT: f64 = 1.35;
/// Rows without which columns have no variance of their own.
const ROWS_FOR_COLUMNS: usize = 16;
/// Variance that rounding to whole DN leaves, DN²: no sample is known better.
pub const ROUNDING_DN2: f64 = 1.0 / 12.0;

/// Rows of all frames, pixel by pixel: the frames of a pixel lie together.
pub struct Band {
    /// Columns.
    pub width: usize,
    /// The first row.
    pub first_row: usize,
    /// Frames.
    pub frames: usize,
    /// DN.
    pub samples: Vec<u16>,
}

impl Band {
    /// Of rows of each frame, one after another.
    pub fn of(width: usize, first_row: usize, rows: &[Vec<u16>]) -> Self {
        let (frames, pixels) = (rows.len(), rows.first().map_or(0, Vec::len));
        let mut samples = vec![0; frames * pixels];
        for (i, frame) in rows.iter().enumerate() {
            let slots = samples.iter_mut().skip(i).step_by(frames);
            slots.zip(frame).for_each(|(s, &v)| *s = v);
        }
        Self { width, first_row, frames, samples }
    }

    /// Reads rows of a stack.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub fn read(set: &CaptureSet, capture: &Capture, rows: &Range<usize>) -> Result<Self> {
        let width = set.sensor.width;
        let mut kept = Vec::new();
        set.for_each_batch(capture, |planes| {
            kept.extend(
                planes.iter().map(|p| p.data[rows.start * width..rows.end * width].to_vec()),
            );
            Ok(())
        })?;
        Ok(Self::of(width, rows.start, &kept))
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.samples.len() / self.frames.max(1)
    }
}

/// The rows of frames of this size in bands, each whole periods of the filter pattern.
pub fn bands(width: usize, height: usize, frames: usize, period: usize) -> Vec<Range<usize>> {
    let most = (MAX_SAMPLES / (width * frames.max(1))).max(1);
    let rows = (most / period).max(1) * period;
    (0..height).step_by(rows).map(|y| y..(y + rows).min(height)).collect()
}

/// How the frames of a stack differ in level, and how that is taken off.
pub struct Levels {
    /// For each frame and place in the pattern: factor and offset that make it level.
    of: Vec<Vec<(f32, f32)>>,
    /// Columns and rows of the pattern.
    pattern: (usize, usize),
}

impl Levels {
    /// Of a stack in which no light gives `black` DN.
    pub fn new(set: &CaptureSet, scan: &Scan, black: f64) -> Self {
        let cfa = set.cfa();
        let means = scan.site_levels();
        let flat = set.captures[scan.capture].role == Role::Flat;
        let of_site = |level: f64, mean: f64| {
            let factor = (mean - black) / (level - black);
            match flat && mean - black > 1.0 && (0.1..10.0).contains(&factor) {
                true => (factor as f32, (black * (1.0 - factor)) as f32),
                false => (1.0, (mean - level) as f32),
            }
        };
        let of_frame = |levels: &Vec<f64>| -> Vec<(f32, f32)> {
            levels.iter().zip(&means).map(|(&l, &m)| of_site(l, m)).collect()
        };
        Self {
            of: scan.frames.iter().map(|f| of_frame(&f.levels)).collect(),
            pattern: (cfa.width, cfa.height),
        }
    }

    fn site(&self, x: usize, y: usize) -> usize {
        y % self.pattern.1 * self.pattern.0 + x % self.pattern.0
    }
}

/// A band with its frames level.
pub struct Residuals {
    /// Columns.
    pub width: usize,
    /// Frames.
    pub frames: usize,
    /// Median over time of each pixel, DN.
    pub median: Vec<f32>,
    /// Samples less their pixel's median, DN, pixel by pixel.
    pub values: Vec<f32>,
    /// Variance over time of each pixel, DN².
    pub variance: Vec<f32>,
    /// Variance of the pixel in the middle, DN².
    pub typical: f64,
    /// Median of `median`, DN.
    pub level: f64,
}

impl Residuals {
    /// Of a band of a stack with these levels.
    pub fn new(band: &Band, levels: &Levels) -> Self {
        let (width, n) = (band.width, band.frames);
        let pixels = band.pixels();
        let mut values = vec![0.0f32; pixels * n];
        let mut middle = vec![0.0f32; pixels];
        let rows = values.par_chunks_mut(width * n).zip(middle.par_chunks_mut(width));
        rows.zip(band.samples.par_chunks(width * n)).enumerate().for_each(|(y, row)| {
            let ((out, middle), samples) = row;
            let mut sorted = vec![0.0f32; n];
            let pixels = out.chunks_mut(n).zip(samples.chunks(n)).zip(middle);
            for (x, ((out, samples), middle)) in pixels.enumerate() {
                let site = levels.site(x, band.first_row + y);
                for (i, (o, &v)) in out.iter_mut().zip(samples).enumerate() {
                    let (factor, offset) = levels.of[i][site];
                    *o = f32::from(v) * factor + offset;
                }
                sorted.copy_from_slice(out);
                sorted.sort_unstable_by(f32::total_cmp);
                *middle = 0.5 * (sorted[n / 2] + sorted[(n - 1) / 2]);
                out.iter_mut().for_each(|o| *o -= *middle);
            }
        });
        let mut all = Self {
            width,
            frames: n,
            level: f64::from(median(&mut middle.clone(), f32::total_cmp)),
            median: middle,
            values,
            variance: vec![0.0; pixels],
            typical: 0.0,
        };
        all.measure();
        if all.level_rows() {
            all.measure();
        }
        all
    }

    /// Variances from the residuals.
    fn measure(&mut self) {
        let n = self.frames;
        let dof = (n as f64 - 1.0).max(1.0);
        let of_pixel = |r: &[f32]| (r.iter().map(|r| f64::from(r * r)).sum::<f64>() / dof) as f32;
        self.variance = self.values.par_chunks(n).map(of_pixel).collect();
        let middle = f64::from(median(&mut self.variance.clone(), f32::total_cmp));
        let middle = middle / tails::median_of_squares(dof);
        // Where most pixels never change, the mean of all but the noisiest per cent tells more.
        let mut sorted = self.variance.clone();
        let most = sorted.len() - 1 - sorted.len() / 100;
        sorted.select_nth_unstable_by(most, f32::total_cmp);
        let mean = sorted[..most.max(1)].iter().map(|&v| f64::from(v)).sum::<f64>();
        let mean = mean / most.max(1) as f64;
        let coarse = middle < ROUNDING_DN2;
        self.typical = if coarse { middle.max(mean) } else { middle }.max(ROUNDING_DN2);
    }

    /// Takes each row's own offset off where rows share noise; says whether it did.
    fn level_rows(&mut self) -> bool {
        let (width, n) = (self.width, self.frames);
        let limit = (CLIP * self.typical.sqrt()) as f32;
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
        let stands_out = variance * width as f64 > ROWS_STAND_OUT * self.typical;
        if stands_out {
            self.values.par_chunks_mut(width * n).zip(&means).for_each(|(row, means)| {
                for pixel in row.chunks_mut(n) {
                    pixel.iter_mut().zip(means).for_each(|(r, m)| *r -= m);
                }
            });
        }
        stands_out
    }

    /// The variance that each pixel's level gives it, DN²: shot noise with `dn_per_e` DN per
    /// electron above the typical pixel's, and where columns differ in their noise, the column's.
    pub fn expected(&self, dn_per_e: f64) -> Vec<f32> {
        let columns = self.columns();
        self.median
            .iter()
            .enumerate()
            .map(|(p, &m)| {
                let shot = dn_per_e * (f64::from(m) - self.level);
                let v = self.typical + shot.max(-0.5 * self.typical);
                (v * columns[p % self.width]).max(ROUNDING_DN2) as f32
            })
            .collect()
    }

    /// Factor of each column's variance over the typical one where it stands out.
    fn columns(&self) -> Vec<f64> {
        let rows = self.median.len() / self.width;
        if rows < ROWS_FOR_COLUMNS {
            return vec![1.0; self.width];
        }
        let scale = self.typical * tails::median_of_squares((self.frames as f64 - 1.0).max(1.0));
        (0..self.width)
            .map(|x| {
                let mut column: Vec<f32> =
                    self.variance.iter().skip(x).step_by(self.width).copied().collect();
                let factor = f64::from(median(&mut column, f32::total_cmp)) / scale;
                if factor > COLUMN_STANDS_OUT { factor } else { 1.0 }
            })
            .collect()
    }

    /// Mean over pixels of the variance, the noisiest clipped, DN².
    pub fn mean_variance(&self) -> f64 {
        let limit = 8.0 * self.typical;
        let sum: f64 = self.variance.iter().map(|&v| f64::from(v).min(limit)).sum();
        sum / self.variance.len().max(1) as f64
    }
}
