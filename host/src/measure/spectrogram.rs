//! Spectrograms and histograms of a mean frame (EMVA 1288 R4, sections 8.3 to 8.5).

use super::stack::Site;
use crate::{Error, Result};
use rayon::prelude::*;
use realfft::RealFftPlanner;
use serde::Serialize;

/// Mean power spectra of a plane along rows and columns; frequencies from 0 to 0.5 cycles per
/// sample of the plane in equal steps. The units are those of the plane, squared; white noise of
/// variance σ² has a flat spectrum at σ².
#[derive(Clone, Debug, Serialize)]
pub struct Spectrogram {
    /// Along rows, averaged over rows.
    pub horizontal: Vec<f64>,
    /// Along columns, averaged over columns.
    pub vertical: Vec<f64>,
}

/// Values of one site as a plane of its own, row-major.
pub struct SitePlane {
    /// Columns.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Values.
    pub data: Vec<f64>,
}

/// Lines that one task transforms or reads.
const BLOCK: usize = 16;

impl SitePlane {
    /// The values of `site` of a frame `width` x `height`.
    pub fn of(
        site: Site,
        width: usize,
        height: usize,
        value: impl Fn(usize, usize) -> f64 + Sync,
    ) -> Self {
        let (columns, rows) = (site.columns(width), site.rows(height));
        let mut data = vec![0.0; columns * rows];
        data.par_chunks_mut(BLOCK * columns).enumerate().for_each(|(block, part)| {
            for (j, row) in part.chunks_mut(columns).enumerate() {
                let y = site.y0 + (block * BLOCK + j) * site.step_y;
                for (i, v) in row.iter_mut().enumerate() {
                    *v = value(site.x0 + i * site.step_x, y);
                }
            }
        });
        Self { columns, rows, data }
    }

    /// Mean of the values.
    pub fn mean(&self) -> f64 {
        let rows = self.data.par_chunks(self.columns).map(|row| row.iter().sum::<f64>());
        rows.collect::<Vec<_>>().iter().sum::<f64>() / self.data.len() as f64
    }

    /// Spectra along rows and columns, the plane's mean taken out.
    ///
    /// # Errors
    /// None but what the transform refuses.
    pub fn spectrogram(&self) -> Result<Spectrogram> {
        let mean = self.mean();
        let columns = self.columns;
        Ok(Spectrogram {
            horizontal: mean_power(self.rows, columns, mean, |first, lines| {
                lines.copy_from_slice(&self.data[first * columns..][..lines.len()]);
            })?,
            // Columns side by side, so that whole cache lines are used.
            vertical: mean_power(columns, self.rows, mean, |first, lines| {
                let count = lines.len() / self.rows;
                for (y, row) in self.data.chunks_exact(columns).enumerate() {
                    for (i, &v) in row[first..first + count].iter().enumerate() {
                        lines[i * self.rows + y] = v;
                    }
                }
            })?,
        })
    }

    /// What is left of the plane without its mean over 5 x 5 samples (the standard's high-pass);
    /// two samples are lost at every border.
    #[must_use]
    pub fn high_pass(&self) -> Vec<f64> {
        let (columns, inner) = (self.columns, self.columns.saturating_sub(4));
        let mut out = vec![0.0; inner * self.rows.saturating_sub(4)];
        if inner > 0 {
            out.par_chunks_mut(inner).enumerate().for_each(|(y, out)| {
                let rows = |k: usize| &self.data[(y + k) * columns..][..columns];
                let (a, b, c, d, e) = (rows(0), rows(1), rows(2), rows(3), rows(4));
                let sums: Vec<f64> =
                    (0..columns).map(|x| a[x] + b[x] + c[x] + d[x] + e[x]).collect();
                for (x, out) in out.iter_mut().enumerate() {
                    *out = c[x + 2] - sums[x..x + 5].iter().sum::<f64>() / 25.0;
                }
            });
        }
        out
    }
}

/// Mean power spectrum of lines of `length` samples, less their common `mean`. `fill` writes lines from the given one
/// on; blocks of them are transformed in parallel and added in order.
fn mean_power(
    lines: usize,
    length: usize,
    mean: f64,
    fill: impl Fn(usize, &mut [f64]) + Sync,
) -> Result<Vec<f64>> {
    let plan = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    let worker = || (vec![0.0; BLOCK * length], plan.make_output_vec(), plan.make_scratch_vec());
    let blocks: Vec<Vec<f64>> = (0..lines.div_ceil(BLOCK))
        .into_par_iter()
        .map_init(worker, |(values, out, scratch), block| {
            let first = block * BLOCK;
            let values = &mut values[..BLOCK.min(lines - first) * length];
            fill(first, values);
            let mut power = vec![0.0; length / 2 + 1];
            for line in values.chunks_exact_mut(length) {
                line.iter_mut().for_each(|v| *v -= mean);
                plan.process_with_scratch(line, out, scratch)
                    .map_err(|e| Error::input(format!("Fourier transform: {e}")))?;
                power.iter_mut().zip(&*out).for_each(|(p, v)| *p += v.norm_sqr());
            }
            Ok(power)
        })
        .collect::<Result<_>>()?;
    let mut power = vec![0.0; length / 2 + 1];
    for block in &blocks {
        power.iter_mut().zip(block).for_each(|(p, v)| *p += v / (length * lines) as f64);
    }
    Ok(power)
}

/// Logarithmic histogram's data: values around zero, and how many pixels lie far out.
#[derive(Clone, Debug, Serialize)]
pub struct Histogram {
    /// Left end of the first bin.
    pub start: f64,
    /// Width of a bin.
    pub step: f64,
    /// Counts.
    pub counts: Vec<u64>,
    /// Standard deviation from the quartiles: what a Gaussian core has.
    pub core_sigma: f64,
    /// Values more than five core standard deviations from the median.
    pub outliers: u64,
    /// Values in all.
    pub values: u64,
}

/// Parts of a bin that values are sorted into, to find quartiles without sorting them all.
const FINE: usize = 16;

impl Histogram {
    /// Of at most 256 bins.
    pub fn of(values: &[f64]) -> Self {
        if values.is_empty() {
            let counts = Vec::new();
            return Self { start: 0.0, step: 0.0, counts, core_sigma: 0.0, outliers: 0, values: 0 };
        }
        // Whole pieces, so that the loops vectorise.
        let pieces = || values.par_chunks(1 << 14);
        let (low, high) = pieces()
            .map(|piece| {
                let both = |(l, h): (f64, f64), &v: &f64| (l.min(v), h.max(v));
                piece.iter().fold((f64::INFINITY, f64::NEG_INFINITY), both)
            })
            .reduce(|| (f64::INFINITY, f64::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        let (step, bins) = if high > low { ((high - low) / 255.0, 256) } else { (1.0, 1) };
        let place = |v: f64| ((v - low) / step * FINE as f64) as usize;
        let fine = pieces()
            .fold(
                || vec![0u64; bins * FINE],
                |mut counts, piece| {
                    piece.iter().for_each(|&v| counts[place(v)] += 1);
                    counts
                },
            )
            .reduce(
                || vec![0; bins * FINE],
                |mut a, b| {
                    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                    a
                },
            );
        // Where the quartiles lie: part, and rank within it.
        let ranks = [0.25, 0.5, 0.75].map(|q| {
            let mut rank = ((values.len() - 1) as f64 * q) as u64;
            let mut part = 0;
            while rank >= fine[part] {
                rank -= fine[part];
                part += 1;
            }
            (part, rank as usize)
        });
        let near: Vec<f64> = pieces()
            .flat_map_iter(|piece| {
                let wanted = |v: &f64| {
                    let part = place(*v);
                    ranks.iter().any(|r| r.0 == part)
                };
                piece.iter().copied().filter(wanted)
            })
            .collect();
        let [lower, median, upper] = ranks.map(|(part, rank)| {
            let mut here: Vec<f64> = near.iter().copied().filter(|&v| place(v) == part).collect();
            *here.select_nth_unstable_by(rank, f64::total_cmp).1
        });
        // A Gaussian's quartiles lie 0.6745 standard deviations from its median.
        let core_sigma = (upper - lower) / (2.0 * 0.674_489_75);
        let far = |v: &f64| u64::from((v - median).abs() > 5.0 * core_sigma && core_sigma > 0.0);
        Self {
            start: low,
            step,
            outliers: pieces().map(|piece| piece.iter().map(far).sum::<u64>()).sum(),
            core_sigma,
            values: values.len() as u64,
            counts: fine.chunks(FINE).map(|parts| parts.iter().sum()).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against a sort, with a far value that stretches the bins.
    #[test]
    fn histogram_of_known_values() {
        let mut values: Vec<f64> =
            (0..10_007u64).map(|i| (i * 7919 % 10_007) as f64 / 100.0).collect();
        values.push(5000.0);
        let h = Histogram::of(&values);
        let mut sorted = values.clone();
        sorted.sort_by(f64::total_cmp);
        let at = |q: f64| sorted[((sorted.len() - 1) as f64 * q) as usize];
        assert_eq!(h.core_sigma, (at(0.75) - at(0.25)) / (2.0 * 0.674_489_75));
        assert_eq!((h.outliers, h.values, h.counts.len()), (1, 10_008, 256));
        assert_eq!(h.counts.iter().sum::<u64>(), 10_008);
        let below = values.iter().filter(|v| ((**v - h.start) / h.step) as usize == 2).count();
        assert_eq!((h.counts[2], h.counts[254..].iter().sum()), (below as u64, 1));
        assert_eq!(Histogram::of(&[3.0; 9]).counts, [9]);
    }

    /// Rows of one cosine, all of its power at its frequency; the same along columns is the plane's mean only.
    #[test]
    fn spectra_and_high_pass_of_a_cosine() {
        let (columns, rows) = (40, 37);
        let wave =
            |x: usize| 3.0 + 2.0 * (2.0 * std::f64::consts::PI * 5.0 * x as f64 / 40.0).cos();
        let site = Site { x0: 0, y0: 0, step_x: 1, step_y: 1, channel: 0 };
        let plane = SitePlane::of(site, columns, rows, |x, _| wave(x));
        let s = plane.spectrogram().unwrap();
        // |FFT|² / N of an amplitude 2 is 4 N / 4.
        assert!((s.horizontal[5] - 40.0).abs() < 1e-9, "{}", s.horizontal[5]);
        assert!((s.horizontal.iter().sum::<f64>() - 40.0).abs() < 1e-9);
        // Along columns every line is constant: 2 cos, whose mean square over x is 2, at frequency 0.
        assert!((s.vertical[0] - 2.0 * 37.0).abs() < 1e-9, "{}", s.vertical[0]);
        assert!(s.vertical[1..].iter().all(|p| p.abs() < 1e-9));
        let high = plane.high_pass();
        assert_eq!(high.len(), 36 * 33);
        let mean = |x: usize| (x - 2..=x + 2).map(wave).sum::<f64>() / 5.0;
        assert!((high[36 * 4 + 7] - (wave(9) - mean(9))).abs() < 1e-12);
    }
}
