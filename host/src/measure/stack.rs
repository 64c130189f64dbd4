//! Moments of a stack of frames: per pixel over time, and over the pixels of a channel.
//!
//! Frames are streamed once. What is kept per pixel are integer sums of the samples and of their
//! squares, so the moments are exact and do not depend on batches or threads.

use super::spatial::{PlaneMoments, SpatialVariance};
use crate::camera::Cfa;
use crate::captures::{Capture, CaptureSet};
use crate::{Error, Plane, Result};
use rayon::prelude::*;

/// One position of the colour filter pattern: the pixels at `(x0 + i step_x, y0 + j step_y)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Site {
    /// First column.
    pub x0: usize,
    /// First row.
    pub y0: usize,
    /// Columns from one pixel to the next.
    pub step_x: usize,
    /// Rows from one pixel to the next.
    pub step_y: usize,
    /// Channel number (see [`Cfa`]).
    pub channel: usize,
}

impl Site {
    /// The sites of a pattern, row-major.
    pub fn all(cfa: &Cfa) -> Vec<Site> {
        let mut sites = Vec::with_capacity(cfa.width * cfa.height);
        for y0 in 0..cfa.height {
            for x0 in 0..cfa.width {
                let channel = cfa.channel(x0, y0);
                sites.push(Site { x0, y0, step_x: cfa.width, step_y: cfa.height, channel });
            }
        }
        sites
    }

    /// Columns of the site's plane in a frame `width` wide.
    pub fn columns(&self, width: usize) -> usize {
        (width + self.step_x - 1 - self.x0) / self.step_x
    }

    /// Rows of the site's plane in a frame `height` high.
    pub fn rows(&self, height: usize) -> usize {
        (height + self.step_y - 1 - self.y0) / self.step_y
    }
}

/// Sums over the frames of a stack.
#[derive(Clone, Debug)]
pub struct Stack {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Number of frames.
    pub frames: usize,
    /// Positions of the colour filter pattern.
    pub sites: Vec<Site>,
    /// Per pixel, sum of the samples.
    pub sum: Vec<u32>,
    sum_sq: Vec<u64>,
    /// Per site, sum of the samples of each frame.
    frame_sums: Vec<Vec<u64>>,
    /// Per site, samples at 0 DN and at or above the white level.
    zeros: Vec<u64>,
    whites: Vec<u64>,
}

/// Largest number of frames whose 16-bit samples fit a `u32` sum.
const MOST_FRAMES: usize = u16::MAX as usize;

impl Stack {
    /// Streams all frames of `capture`.
    ///
    /// # Errors
    /// What [`CaptureSet::for_each_batch`] refuses, and a frame smaller than the filter pattern.
    pub fn read(set: &CaptureSet, capture: &Capture) -> Result<Self> {
        let (width, height) = (set.sensor.width, set.sensor.height);
        let cfa = set.cfa();
        if width < 2 * cfa.width || height < 2 * cfa.height {
            return Err(Error::input(format!("frames of {width} x {height} are too small"))
                .help("measuring needs at least two periods of the filter pattern each way"));
        }
        let sites = Site::all(&cfa);
        let mut stack = Self {
            width,
            height,
            frames: 0,
            sum: vec![0; width * height],
            sum_sq: vec![0; width * height],
            frame_sums: vec![Vec::new(); sites.len()],
            zeros: vec![0; sites.len()],
            whites: vec![0; sites.len()],
            sites,
        };
        let white = set.sensor.white_level_dn;
        set.for_each_batch(capture, |batch| stack.add(batch, white))?;
        Ok(stack)
    }

    fn add(&mut self, batch: &[Plane<u16>], white: u16) -> Result<()> {
        if self.frames + batch.len() > MOST_FRAMES {
            return Err(Error::input(format!("more than {MOST_FRAMES} frames in one capture")));
        }
        self.frames += batch.len();
        let (step_x, step_y) = (self.sites[0].step_x, self.sites[0].step_y);
        let width = self.width;
        let tallies: Vec<Vec<Tally>> = self
            .sum
            .par_chunks_mut(width)
            .zip(self.sum_sq.par_chunks_mut(width))
            .enumerate()
            .map(|(y, (sum, sum_sq))| {
                let mut tallies = Vec::with_capacity(batch.len() * step_x);
                for frame in batch {
                    let row = frame.row(y);
                    accumulate(row, sum, sum_sq);
                    tallies.extend((0..step_x).map(|x0| Tally::of(row, x0, step_x, white)));
                }
                tallies
            })
            .collect();
        for (index, sums) in self.frame_sums.iter_mut().enumerate() {
            let (y0, x0) = (index / step_x, index % step_x);
            for f in 0..batch.len() {
                let mut total = Tally::default();
                for row in tallies.iter().skip(y0).step_by(step_y) {
                    total.add(row[f * step_x + x0]);
                }
                sums.push(total.sum);
                self.zeros[index] += total.zeros;
                self.whites[index] += total.whites;
            }
        }
        Ok(())
    }

    /// Mean over the frames at a pixel, DN.
    pub fn mean_at(&self, x: usize, y: usize) -> f64 {
        f64::from(self.sum[y * self.width + x]) / self.frames as f64
    }

    /// Temporal variance at a pixel (unbiased), DN²; 0 for one frame.
    pub fn variance_at(&self, x: usize, y: usize) -> f64 {
        let i = y * self.width + x;
        pixel_variance(self.frames, self.sum[i], self.sum_sq[i])
    }

    /// Moments of the pixels of one site.
    pub fn moments(&self, site: usize) -> Moments {
        let s = self.sites[site];
        let l = self.frames as f64;
        let plane = PlaneMoments::of(s, self.width, self.height, |at| f64::from(self.sum[at]) / l);
        let rows: Vec<(f64, f64)> = (0..plane.rows)
            .into_par_iter()
            .map(|j| {
                let start = (s.y0 + j * s.step_y) * self.width;
                let mut sums = (0.0, 0.0);
                for at in (start + s.x0..start + self.width).step_by(s.step_x) {
                    let variance = pixel_variance(self.frames, self.sum[at], self.sum_sq[at]);
                    sums.0 += variance;
                    sums.1 += variance * variance;
                }
                sums
            })
            .collect();
        let variance_sum: f64 = rows.iter().map(|r| r.0).sum();
        let square_sum: f64 = rows.iter().map(|r| r.1).sum();
        let n = plane.pixels();
        let frame_means: Vec<f64> =
            self.frame_sums[site].iter().map(|&sum| sum as f64 / n).collect();
        let drift = variance(&frame_means);
        Moments {
            plane,
            sites: 1,
            frames: self.frames,
            drift,
            temporal: (variance_sum / n - drift).max(0.0),
            // E[s⁴] = σ⁴ (L + 1)/(L - 1) for a Gaussian pixel, and var(s²) = 2 σ⁴/(L - 1).
            temporal_error: (2.0 / (l + 1.0) * square_sum).sqrt() / n,
            zeros: self.zeros[site] as f64 / (n * l),
            whites: self.whites[site] as f64 / (n * l),
        }
    }

    /// Moments of every site of a channel, taken together (see [`Moments::pool`]).
    pub fn channel_moments(&self, channel: usize) -> Moments {
        let of: Vec<Moments> = (0..self.sites.len())
            .filter(|&i| self.sites[i].channel == channel)
            .map(|i| self.moments(i))
            .collect();
        Moments::pool(&of)
    }
}

#[derive(Clone, Copy, Default)]
struct Tally {
    sum: u64,
    zeros: u64,
    whites: u64,
}

impl Tally {
    fn of(row: &[u16], x0: usize, step: usize, white: u16) -> Self {
        let mut out = Self::default();
        for &v in row.iter().skip(x0).step_by(step) {
            out.sum += u64::from(v);
            out.zeros += u64::from(v == 0);
            out.whites += u64::from(v >= white);
        }
        out
    }

    fn add(&mut self, other: Self) {
        self.sum += other.sum;
        self.zeros += other.zeros;
        self.whites += other.whites;
    }
}

fn accumulate(row: &[u16], sum: &mut [u32], sum_sq: &mut [u64]) {
    for ((&v, s), q) in row.iter().zip(sum).zip(sum_sq) {
        let v = u32::from(v);
        *s += v;
        *q += u64::from(v * v);
    }
}

/// Unbiased variance of `frames` samples with these sums, exact until the last division.
fn pixel_variance(frames: usize, sum: u32, sum_sq: u64) -> f64 {
    if frames < 2 {
        return 0.0;
    }
    let (l, sum) = (frames as u64, u64::from(sum));
    // L Σy² ≥ (Σy)² always; both are below 2^64 for at most 65535 frames of 16 bits.
    (l * sum_sq - sum * sum) as f64 / (l * (l - 1)) as f64
}

fn variance(values: &[f64]) -> f64 {
    if values.len() < 2 {
        return 0.0;
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64
}

/// Temporal and spatial moments of the pixels of a site or channel, in DN and DN².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// The mean frame's moments over the pixels of one site (their mean over a channel's sites).
    pub plane: PlaneMoments,
    /// Sites taken together.
    pub sites: usize,
    /// Frames.
    pub frames: usize,
    /// Variance of the frames' means: temporal noise of the mean and drift of the light.
    pub drift: f64,
    /// Mean over pixels of the temporal variance, the frames' drift taken out (EMVA 1288 R4, eq. 18,
    /// for two frames: half the mean square difference less half the squared difference of the means;
    /// this is the same for any number of frames). 0 for one frame.
    pub temporal: f64,
    /// Standard error of `temporal` for Gaussian noise whose variance may differ over pixels.
    pub temporal_error: f64,
    /// Share of samples at 0 DN.
    pub zeros: f64,
    /// Share of samples at or above the white level.
    pub whites: f64,
}

impl Moments {
    /// Mean over pixels and frames, DN.
    pub fn mean(&self) -> f64 {
        self.plane.mean
    }

    /// Pixels.
    pub fn pixels(&self) -> f64 {
        self.plane.pixels() * self.sites as f64
    }

    /// Standard error of the mean from the noise of the frames: temporal noise, or the scatter of
    /// the frames' means where that is larger.
    pub fn mean_error(&self) -> f64 {
        let l = self.frames as f64;
        (self.temporal / (self.pixels() * l)).max(self.drift / l).sqrt()
    }

    /// Variance over pixels of the true pixel means: the temporal remainder taken out.
    pub fn spatial(&self) -> SpatialVariance {
        self.plane.split(self.temporal / self.frames as f64, self.sites)
    }

    /// Sites of one channel taken together: means of the sites' moments. Spatial variances are
    /// those within each site, so a difference between two greens is not non-uniformity.
    pub fn pool(sites: &[Moments]) -> Moments {
        let k = sites.len() as f64;
        let mean_of = |f: fn(&Moments) -> f64| sites.iter().map(f).sum::<f64>() / k;
        Moments {
            plane: PlaneMoments::pool(&sites.iter().map(|m| m.plane).collect::<Vec<_>>()),
            sites: sites.len(),
            frames: sites[0].frames,
            drift: mean_of(|m| m.drift),
            temporal: mean_of(|m| m.temporal),
            temporal_error: sites.iter().map(|m| m.temporal_error.powi(2)).sum::<f64>().sqrt() / k,
            zeros: mean_of(|m| m.zeros),
            whites: mean_of(|m| m.whites),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stack(frames: &[[u16; 4]]) -> Stack {
        let mut stack = Stack {
            width: 2,
            height: 2,
            frames: 0,
            sum: vec![0; 4],
            sum_sq: vec![0; 4],
            frame_sums: vec![Vec::new()],
            zeros: vec![0],
            whites: vec![0],
            sites: vec![Site { x0: 0, y0: 0, step_x: 1, step_y: 1, channel: 0 }],
        };
        for f in frames {
            let plane = Plane { width: 2, height: 2, data: f.to_vec() };
            stack.add(&[plane], 4095).unwrap();
        }
        stack
    }

    #[test]
    fn two_frames_give_the_standards_formula() {
        // Differences 2, -4, 1, 3: half their mean square is 3.75; means differ by 0.5.
        let m = stack(&[[10, 20, 30, 4095], [8, 24, 29, 4092]]).moments(0);
        assert!((m.temporal - (3.75 - 0.125)).abs() < 1e-12, "{m:?}");
        assert!((m.drift - 0.125).abs() < 1e-12);
        assert!((m.mean() - (9.0 + 22.0 + 29.5 + 4093.5) / 4.0).abs() < 1e-12);
        assert_eq!((m.zeros, m.whites), (0.0, 0.125));
    }

    #[test]
    fn largest_samples_do_not_overflow() {
        let m = stack(&[[65535; 4]; 9]).moments(0);
        assert_eq!((m.mean(), m.temporal), (65535.0, 0.0));
    }

    #[test]
    fn sites_cover_odd_frames() {
        let sites = Site::all(&Cfa::parse("GRBG").unwrap());
        let pixels: usize = sites.iter().map(|s| s.rows(5) * s.columns(7)).sum();
        assert_eq!(pixels, 35);
        assert_eq!(sites.iter().map(|s| s.channel).collect::<Vec<_>>(), [1, 0, 2, 1]);
    }
}
