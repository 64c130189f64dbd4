//! The sums over a stack while it is read, and the moments that follow from them.

use super::moments::Moments;
use super::site::Site;
use super::spatial::PlaneMoments;
use super::strips::{self, StripMoments};
use camrig_base::{Error, Result};
use camrig_captures::{SensorFacts, StoredFrame};
use camrig_linear::moments;
use rayon::prelude::*;
use std::hash::{DefaultHasher, Hasher};

/// Largest number of frames whose 16-bit samples fit a `u32` sum.
const MAX_FRAMES: usize = u16::MAX as usize;

/// Sums over the frames of a stack.
pub struct Sums {
    width: usize,
    height: usize,
    sites: Vec<Site>,
    white: u16,
    /// Number of frames added.
    pub frames: usize,
    /// For each frame, a hash of its sums, equal for copies.
    pub marks: Vec<u64>,
    /// Sums of the pixels, where they are kept beyond a batch.
    sum: Vec<u32>,
    sum_sq: Vec<u64>,
    /// Sum of the samples of each frame, per site.
    frame_sums: Vec<Vec<f64>>,
    /// Numbers of samples at 0 DN, at or above the white level and above it, per site.
    zeros: Vec<f64>,
    whites: Vec<f64>,
    beyond_white: Vec<f64>,
    strips: Vec<StripMoments>,
}

/// Memory of one worker.
#[derive(Default)]
struct Scratch {
    samples: Vec<u16>,
    sum: Vec<u32>,
    sum_sq: Vec<u64>,
}

/// Sums of one frame over a strip, per site.
struct Tally {
    sums: Vec<f64>,
    zeros: Option<Vec<f64>>,
    whites: Option<Vec<f64>>,
    beyond_white: Option<Vec<f64>>,
    largest: u16,
}

impl Sums {
    /// Empty sums; samples from `white` on count as saturated.
    pub fn new(width: usize, height: usize, sites: Vec<Site>, white: u16) -> Self {
        Self {
            width,
            height,
            white,
            frames: 0,
            marks: Vec::new(),
            sum: Vec::new(),
            sum_sq: Vec::new(),
            frame_sums: vec![Vec::new(); sites.len()],
            zeros: vec![0.0; sites.len()],
            whites: vec![0.0; sites.len()],
            beyond_white: vec![0.0; sites.len()],
            strips: Vec::new(),
            sites,
        }
    }

    /// Width and height of the frames.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The pattern's columns and rows.
    fn steps(&self) -> (usize, usize) {
        (self.sites[0].step_x, self.sites[0].step_y)
    }

    /// Adds a batch, strips in parallel. `keep`: the pixels' sums are needed afterwards. `whole`:
    /// the batch is the whole stack, so that moments are computed while the sums are in the cache.
    pub fn add(
        &mut self,
        batch: &[StoredFrame],
        sensor: &SensorFacts,
        keep: bool,
        whole: bool,
    ) -> Result<()> {
        if self.frames + batch.len() > MAX_FRAMES {
            return Err(Error::limit(format!("more than {MAX_FRAMES} frames in one capture")));
        }
        let none_yet = self.frames == 0;
        self.frames += batch.len();
        let (step_x, step_y) = self.steps();
        let (width, white) = (self.width, self.white);
        // The operating system provides zeroed memory only when it is written.
        if keep && none_yet {
            self.sum = vec![0; width * self.height];
        }
        if !whole && none_yet {
            self.sum_sq = vec![0; width * self.height];
        }
        let rows = strips::rows(width, step_y);
        let count = self.height.div_ceil(rows);
        let (sums, sums_sq) = (
            chunks(&mut self.sum, rows * width, count),
            chunks(&mut self.sum_sq, rows * width, count),
        );
        let done: Vec<(Vec<Tally>, Option<StripMoments>)> = sums
            .into_par_iter()
            .zip(sums_sq)
            .enumerate()
            .map_init(Scratch::default, |scratch, (strip, (sum, sum_sq))| {
                let first = strip * rows;
                let pixels = rows.min(self.height - first) * width;
                let Scratch { samples, sum: own_sum, sum_sq: own_sum_sq } = scratch;
                let sum = own_unless_kept(sum, own_sum, pixels);
                let sum_sq = own_unless_kept(sum_sq, own_sum_sq, pixels);
                samples.resize(strips::TOGETHER * rows * width, 0);
                let shape = (width, step_x, step_y);
                let mut first_frames = none_yet;
                let mut tallies = Vec::with_capacity(batch.len());
                for frames in batch.chunks(strips::TOGETHER) {
                    let mut largest = 0;
                    for (frame, samples) in frames.iter().zip(samples.chunks_mut(pixels)) {
                        frame.read_rows(first, samples)?;
                        let tally = Tally::of(samples, shape, white);
                        largest = largest.max(tally.largest);
                        tallies.push(tally);
                    }
                    let read: Vec<&[u16]> = samples.chunks(pixels).take(frames.len()).collect();
                    let together = if largest > strips::SMALL_SQUARES { 1 } else { read.len() };
                    for frames in read.chunks(together) {
                        strips::add(frames, std::mem::take(&mut first_frames), sum, sum_sq);
                    }
                }
                let moments = whole.then(|| StripMoments::of(batch.len(), shape, sum, sum_sq));
                Ok((tallies, moments))
            })
            .collect::<Result<_>>()?;
        for (f, frame) in batch.iter().enumerate() {
            let of_strips = || done.iter().map(|d| &d.0[f]);
            let largest = of_strips().map(|t| t.largest).max().unwrap_or(0);
            frame.check_largest(sensor, largest)?;
            self.marks.push(mark(of_strips()));
            for site in 0..self.sites.len() {
                self.frame_sums[site].push(of_strips().map(|t| t.sums[site]).sum());
                let count = |c: &Option<Vec<f64>>| c.as_ref().map_or(0.0, |c| c[site]);
                self.zeros[site] += of_strips().map(|t| count(&t.zeros)).sum::<f64>();
                self.whites[site] += of_strips().map(|t| count(&t.whites)).sum::<f64>();
                self.beyond_white[site] +=
                    of_strips().map(|t| count(&t.beyond_white)).sum::<f64>();
            }
        }
        self.strips.extend(done.into_iter().filter_map(|d| d.1));
        Ok(())
    }

    /// Moments of every site, from all frames added so far.
    pub fn moments(&mut self) -> Vec<Moments> {
        if self.strips.is_empty() {
            let (step_x, step_y) = self.steps();
            let (width, frames) = (self.width, self.frames);
            let chunk = strips::rows(width, step_y) * width;
            self.strips = (self.sum.par_chunks(chunk).zip(self.sum_sq.par_chunks(chunk)))
                .map(|(s, q)| StripMoments::of(frames, (width, step_x, step_y), s, q))
                .collect();
        }
        (0..self.sites.len()).map(|site| self.moments_of(site)).collect()
    }

    /// Per site, mean of each frame, DN.
    pub fn frame_means(&self) -> Vec<Vec<f64>> {
        (self.sites.iter().zip(&self.frame_sums))
            .map(|(s, sums)| {
                let n = (s.rows(self.height) * s.columns(self.width)) as f64;
                sums.iter().map(|sum| sum / n).collect()
            })
            .collect()
    }

    /// Per pixel, sum of the samples, DN; empty where they were not kept.
    pub fn into_pixel_sums(self) -> Vec<u32> {
        self.sum
    }

    fn moments_of(&self, site: usize) -> Moments {
        let s = self.sites[site];
        let (step_x, l) = (s.step_x, self.frames as f64);
        let (rows, columns) = (s.rows(self.height), s.columns(self.width));
        let n = (rows * columns) as f64;
        let strips = &self.strips;
        let sum = |f: &dyn Fn(&StripMoments) -> f64| strips.iter().map(f).sum::<f64>();
        let row_sums = (strips.iter().flat_map(|m| &m.rows).skip(s.x0))
            .step_by(step_x)
            .skip(s.y0)
            .step_by(s.step_y);
        let row_sums: Vec<f64> = row_sums.copied().collect();
        let mean = row_sums.iter().sum::<f64>() / n;
        let mut column_sums = vec![0.0; columns];
        for strip in strips {
            let of_site = strip.columns[s.y0 * self.width + s.x0..].iter().step_by(step_x);
            column_sums.iter_mut().zip(of_site).for_each(|(sum, v)| *sum += v);
        }
        // Squared deviations from the strips' means, and of the strips' means from the total mean
        // (Chan, Golub and LeVeque 1983).
        let strip_rows = strips::rows(self.width, s.step_y);
        let between = strips.iter().enumerate().map(|(i, m)| {
            let height = strip_rows.min(self.height - i * strip_rows);
            (s.rows(height) * columns) as f64 * (m.means[site] - mean).powi(2)
        });
        let squares = sum(&|m: &StripMoments| m.squares[site]) + between.sum::<f64>();
        let of_lines = |sums: &[f64], length: usize| {
            let squares = sums.iter().map(|s| (s / length as f64 - mean).powi(2)).sum::<f64>();
            squares / (sums.len() as f64 * l * l)
        };
        let plane = PlaneMoments {
            rows,
            columns,
            mean: mean / l,
            measured: squares / (l * l * (n - 1.0).max(1.0)),
            of_rows: of_lines(&row_sums, columns),
            of_columns: of_lines(&column_sums, rows),
        };
        // Unbiased variance of a pixel: the pseudo-variance over L (L - 1).
        let scale = if self.frames < 2 { 0.0 } else { 1.0 / (l * (l - 1.0)) };
        let variance_sum = scale * sum(&|m: &StripMoments| m.variances[site]);
        let square_sum = scale * scale * sum(&|m: &StripMoments| m.variances_sq[site]);
        let frame_means: Vec<f64> = self.frame_sums[site].iter().map(|sum| sum / n).collect();
        let (_, drift) = moments(&frame_means);
        Moments {
            plane,
            sites: 1,
            frames: self.frames,
            drift,
            temporal: (variance_sum / n - drift).max(0.0),
            // E[s⁴] = σ⁴ (L + 1)/(L - 1) for a Gaussian pixel, and var(s²) = 2 σ⁴/(L - 1).
            temporal_error: (2.0 / (l + 1.0) * square_sum).sqrt() / n,
            zeros: self.zeros[site] / (n * l),
            whites: self.whites[site] / (n * l),
            beyond_white: self.beyond_white[site] / (n * l),
        }
    }
}

/// `count` pieces of a plane; of an empty plane, empty pieces.
fn chunks<T>(plane: &mut [T], length: usize, count: usize) -> Vec<&mut [T]> {
    if plane.is_empty() {
        return (0..count).map(|_| &mut [][..]).collect();
    }
    plane.chunks_mut(length).collect()
}

/// The strip's piece of a plane that is kept, otherwise the worker's own memory with arbitrary
/// content.
fn own_unless_kept<'a, T: Copy + Default>(
    kept: &'a mut [T],
    own: &'a mut Vec<T>,
    pixels: usize,
) -> &'a mut [T] {
    if !kept.is_empty() {
        return kept;
    }
    own.resize(pixels, T::default());
    own
}

impl Tally {
    fn of(samples: &[u16], shape: (usize, usize, usize), white: u16) -> Self {
        let strips::SiteSums { sums, low, high } = strips::sums(samples, shape);
        let counted = |low, high| strips::counts(samples, shape, (low, high));
        Self {
            sums,
            zeros: (low == 0).then(|| counted(0, 0)),
            whites: (high >= white).then(|| counted(white, u16::MAX)),
            beyond_white: (high > white).then(|| counted(white + 1, u16::MAX)),
            largest: high,
        }
    }
}

/// A hash of the sums of a frame's strips.
fn mark<'a>(strips: impl Iterator<Item = &'a Tally>) -> u64 {
    let mut hasher = DefaultHasher::new();
    for strip in strips {
        strip.sums.iter().for_each(|sum| hasher.write_u64(sum.to_bits()));
        hasher.write_u16(strip.largest);
    }
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of frames of 2 x 2, one file each.
    fn moments(frames: &[[u16; 4]]) -> Moments {
        let directory = tempfile::tempdir().unwrap();
        let mut files = Vec::new();
        for (k, f) in frames.iter().enumerate() {
            files.push(directory.path().join(format!("{k}.npy")));
            crate::synthetic::write_npy(&files[k], &[2, 2], f);
        }
        let site = Site { x0: 0, y0: 0, step_x: 1, step_y: 1, channel: 0 };
        let sensor = SensorFacts {
            width: 2,
            height: 2,
            bits: 16,
            cfa: None,
            black_level_dn: None,
            white_level_dn: 4095,
            pitch_um: None,
            window: None,
        };
        let open: Vec<StoredFrame> =
            files.iter().flat_map(|f| camrig_captures::open(f).unwrap()).collect();
        let mut whole = Sums::new(2, 2, vec![site], 4095);
        whole.add(&open, &sensor, true, true).unwrap();
        let whole = whole.moments()[0];
        // The same, one frame at a time.
        let mut single = Sums::new(2, 2, vec![site], 4095);
        open.iter()
            .for_each(|f| single.add(std::slice::from_ref(f), &sensor, true, false).unwrap());
        assert_eq!(single.moments()[0], whole);
        whole
    }

    #[test]
    fn two_frames_have_the_variance_of_the_standards_formula() {
        // Differences 2, -4, 1, 3: half their mean square is 3.75; means differ by 0.5.
        let m = moments(&[[10, 20, 30, 4095], [8, 24, 29, 4092]]);
        assert!((m.temporal - (3.75 - 0.125)).abs() < 1e-12, "{m:?}");
        assert!((m.drift - 0.125).abs() < 1e-12);
        assert!((m.mean() - (9.0 + 22.0 + 29.5 + 4093.5) / 4.0).abs() < 1e-12);
        assert_eq!((m.zeros, m.whites, m.beyond_white), (0.0, 0.125, 0.0));
    }

    #[test]
    fn largest_samples_do_not_overflow() {
        let m = moments(&[[65535; 4]; 9]);
        assert_eq!((m.mean(), m.temporal), (65535.0, 0.0));
        assert_eq!((m.whites, m.beyond_white), (1.0, 1.0));
    }
}
