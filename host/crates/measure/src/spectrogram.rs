//! Spectrograms and histograms of a mean frame (EMVA 1288 R4, sections 8.3 to 8.5).

use super::site::Site;
use camrig_base::{Error, Result};
use camrig_fourier::plans::{Complex, real_forward};
use camrig_vector::vectorised;
use rayon::prelude::*;
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

/// Values of one site as a plane, row by row, less their mean. Without the mean, f32 resolves 1e-7
/// of the deviations.
pub struct SitePlane {
    /// Number of columns.
    pub columns: usize,
    /// Number of rows.
    pub rows: usize,
    /// Mean of the values, DN.
    pub mean: f64,
    /// The values less their mean, DN.
    pub data: Vec<f32>,
}

/// Lines per parallel task.
const BLOCK: usize = 16;

/// Rows that are transposed together: no more than the ways of a cache, as rows of a power of two
/// share its sets.
const TILE: usize = 8;

impl SitePlane {
    /// The values of `site` in a frame of `width` x `height` pixels, which is the sum of the
    /// integer frames of `terms`, each times its factor. `room` is memory for reuse.
    pub fn of(
        site: Site,
        (width, height): (usize, usize),
        terms: &[(&[u32], f64)],
        room: Vec<f32>,
    ) -> Self {
        let (columns, rows) = (site.columns(width), site.rows(height));
        // The site's pixels of a row, and those between.
        let line = |j: usize| {
            let row = (site.y0 + j * site.step_y) * width;
            row + site.x0..row + width
        };
        let total = |frame: &[u32]| {
            (0..rows).into_par_iter().map(|j| total(&frame[line(j)], site.step_x)).sum::<u64>()
        };
        let sum: f64 = terms.iter().map(|&(frame, factor)| total(frame) as f64 * factor).sum();
        let mean = sum / (columns * rows) as f64;
        let mut data = room;
        data.resize(columns * rows, 0.0);
        data.par_chunks_mut(columns).enumerate().for_each_init(
            || vec![0.0; columns],
            |values, (j, out)| {
                values.fill(-mean);
                for &(frame, factor) in terms {
                    add_scaled(&frame[line(j)], site.step_x, factor, values);
                }
                narrow(values, out);
            },
        );
        Self { columns, rows, mean, data }
    }

    /// Spectra along rows and columns of the plane less its mean.
    ///
    /// # Errors
    /// None in practice: the Fourier transform's own.
    pub fn spectrogram(&self) -> Result<Spectrogram> {
        let columns = self.columns;
        Ok(Spectrogram {
            horizontal: mean_power(self.rows, columns, |first, lines| {
                lines.copy_from_slice(&self.data[first * columns..][..lines.len()]);
            })?,
            // Several columns and a few rows at a time, so that reading and writing use whole
            // cache lines.
            vertical: mean_power(columns, self.rows, |first, lines| {
                for (tile, rows) in self.data.chunks(TILE * columns).enumerate() {
                    for (i, line) in lines.chunks_exact_mut(self.rows).enumerate() {
                        let line = &mut line[tile * TILE..];
                        for (v, row) in line.iter_mut().zip(rows.chunks_exact(columns)) {
                            *v = row[first + i];
                        }
                    }
                }
            })?,
        })
    }

    /// The plane less its mean over 5 x 5 samples (the standard's high-pass filter), without the
    /// two samples at every border; DN, row by row.
    #[must_use]
    pub fn high_pass(&self) -> Vec<f32> {
        let (columns, inner) = (self.columns, self.columns.saturating_sub(4));
        let mut out = vec![0.0; inner * self.rows.saturating_sub(4)];
        if inner > 0 {
            let sums = || vec![0.0; columns];
            out.par_chunks_mut(inner).enumerate().for_each_init(sums, |sums, (y, out)| {
                let rows = std::array::from_fn(|k| &self.data[(y + k) * columns..][..columns]);
                without_mean(rows, sums, out);
            });
        }
        out
    }
}

/// Sum of every `step`th value.
fn total(values: &[u32], step: usize) -> u64 {
    values.iter().step_by(step).map(|&v| u64::from(v)).sum()
}

/// Adds every `step`th value of `sums`, times a factor.
#[vectorised]
fn add_scaled(sums: &[u32], step: usize, factor: f64, out: &mut [f64]) {
    if step == 1 {
        out.iter_mut().zip(sums).for_each(|(o, &s)| *o += factor * f64::from(s));
    } else {
        out.iter_mut()
            .zip(sums.iter().step_by(step))
            .for_each(|(o, &s)| *o += factor * f64::from(s));
    }
}

#[vectorised]
fn narrow(values: &[f64], out: &mut [f32]) {
    out.iter_mut().zip(values).for_each(|(out, &v)| *out = v as f32);
}

/// The middle one of five rows less the means over 5 x 5. `sums` is memory for a row.
#[vectorised]
fn without_mean([a, b, c, d, e]: [&[f32]; 5], sums: &mut [f32], out: &mut [f32]) {
    let n = c.len();
    let (a, b, d, e, sums) = (&a[..n], &b[..n], &d[..n], &e[..n], &mut sums[..n]);
    for x in 0..n {
        sums[x] = a[x] + b[x] + c[x] + d[x] + e[x];
    }
    for (x, out) in out.iter_mut().enumerate() {
        let around: &[f32; 5] = sums[x..].first_chunk().expect("two samples more on either side");
        *out = c[x + 2] - around.iter().sum::<f32>() / 25.0;
    }
}

/// Mean power spectrum of lines of `length` samples. `fill` writes lines from an index on;
/// blocks of them are transformed in parallel and added in order.
fn mean_power(
    lines: usize,
    length: usize,
    fill: impl Fn(usize, &mut [f32]) + Sync,
) -> Result<Vec<f64>> {
    let plan = real_forward(length);
    let worker = || (vec![0.0; BLOCK * length], plan.make_output_vec(), plan.make_scratch_vec());
    let blocks: Vec<Vec<f64>> = (0..lines.div_ceil(BLOCK))
        .into_par_iter()
        .map_init(worker, |(values, out, scratch), block| {
            let first = block * BLOCK;
            let values = &mut values[..BLOCK.min(lines - first) * length];
            fill(first, values);
            let mut power = vec![0.0; length / 2 + 1];
            for line in values.chunks_exact_mut(length) {
                plan.process_with_scratch(line, out, scratch)
                    .map_err(|e| Error::internal(format!("Fourier transform: {e}")))?;
                add_power(out, &mut power);
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

#[vectorised]
fn add_power(spectrum: &[Complex<f32>], power: &mut [f64]) {
    power.iter_mut().zip(spectrum).for_each(|(p, v)| *p += f64::from(v.norm_sqr()));
}

/// Histogram of deviations from the mean, for a logarithmic plot, with the number of outliers.
#[derive(Clone, Debug, Serialize)]
pub struct Histogram {
    /// Left end of the first bin, DN.
    pub start: f64,
    /// Width of a bin, DN.
    pub step: f64,
    /// Number of values in each bin.
    pub counts: Vec<u64>,
    /// Standard deviation of the Gaussian core, from the quartiles, DN.
    pub core_sigma: f64,
    /// Number of values more than five core standard deviations from the median.
    pub outliers: u64,
    /// Number of values.
    pub values: u64,
}

/// Most bins of the histogram (EMVA 1288 R4, section 8.5, requires 256).
const BINS: usize = 256;

/// Core standard deviations from the median beyond which a value counts as an outlier: a Gaussian
/// has one in 1.7 million there.
const OUTLIER: f32 = 5.0;

/// Parts of a bin, for finding quartiles without sorting all values.
const FINE: usize = 16;

/// Values that loops process side by side.
const SIDE: usize = 64;

/// Values per parallel task: a multiple of [`SIDE`].
const PIECE: usize = 1 << 15;

impl Histogram {
    /// The histogram of values in DN, in at most 256 bins. `resolution` is the step on which the
    /// values lie, DN (1/N for means of N frames), or 0 where they are continuous: bins are whole
    /// multiples of it, with the values in their middle, so that all bins hold equally many steps.
    pub fn of(values: &[f32], resolution: f64) -> Self {
        if values.is_empty() {
            let counts = Vec::new();
            return Self {
                start: 0.0,
                step: 0.0,
                counts,
                core_sigma: 0.0,
                outliers: 0,
                values: 0,
            };
        }
        let pieces = || values.par_chunks(PIECE);
        let (low, high) = (pieces().map(range))
            .reduce(|| (f32::INFINITY, f32::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        let (start, step, bins) = bins_of(f64::from(low), f64::from(high), resolution);
        let scale = Scale { start, per_part: FINE as f64 / step };
        let none = || vec![0; bins * FINE];
        let count = |mut counts: Vec<u32>, piece: &[f32]| {
            count(piece, scale, &mut counts);
            counts
        };
        let fine =
            pieces().fold(none, count).map(|counts| counts.into_iter().map(u64::from).collect());
        let add = |mut a: Vec<u64>, b: Vec<u64>| {
            a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
            a
        };
        let fine = fine.reduce(|| vec![0; bins * FINE], add);
        // The parts that contain the quartiles, and their ranks within them.
        let ranks = [0.25, 0.5, 0.75].map(|q| {
            let mut rank = ((values.len() - 1) as f64 * q) as u64;
            let mut part = 0;
            while rank >= fine[part] {
                rank -= fine[part];
                part += 1;
            }
            (part as u16, rank as usize)
        });
        let parts = ranks.map(|r| r.0);
        let near: Vec<f32> =
            pieces().flat_map_iter(|piece| of_parts(piece, scale, parts)).collect();
        let [lower, median, upper] = ranks.map(|(part, rank)| {
            let here = near.iter().copied().filter(|&v| scale.part(v) == part);
            let mut here: Vec<f32> = here.collect();
            *here.select_nth_unstable_by(rank, f32::total_cmp).1
        });
        // A Gaussian's quartiles lie 0.6745 standard deviations from its median.
        let core_sigma = (f64::from(upper) - f64::from(lower)) / (2.0 * 0.674_489_75);
        let far = |piece: &[f32]| beyond(piece, median, OUTLIER * core_sigma as f32);
        Self {
            start,
            step,
            outliers: if core_sigma > 0.0 { pieces().map(far).sum() } else { 0 },
            core_sigma,
            values: values.len() as u64,
            counts: fine.chunks(FINE).map(|parts| parts.iter().sum()).collect(),
        }
    }
}

/// Start, width and number of the bins for values of a range, DN.
fn bins_of(low: f64, high: f64, resolution: f64) -> (f64, f64, usize) {
    let span = high - low;
    if span <= 0.0 {
        return (low, 1.0, 1);
    }
    let step = span / (BINS - 1) as f64;
    if resolution <= 0.0 {
        return (low, step, BINS);
    }
    let start = low - 0.5 * resolution;
    let step = resolution * (step / resolution).ceil();
    (start, step, ((high - start) / step) as usize + 1)
}

/// Position of the parts of the bins.
#[derive(Clone, Copy)]
struct Scale {
    start: f64,
    per_part: f64,
}

impl Scale {
    /// The part that a value belongs to: at most 256 x [`FINE`].
    #[inline(always)]
    fn part(self, value: f32) -> u16 {
        ((f64::from(value) - self.start) * self.per_part) as i32 as u16
    }
}

/// Smallest and largest.
#[vectorised]
fn range(values: &[f32]) -> (f32, f32) {
    let (mut low, mut high) = ([f32::INFINITY; SIDE], [f32::NEG_INFINITY; SIDE]);
    for chunk in values.chunks(SIDE) {
        for ((low, high), &v) in low.iter_mut().zip(&mut high).zip(chunk) {
            *low = if v < *low { v } else { *low };
            *high = if v > *high { v } else { *high };
        }
    }
    let low = low.into_iter().fold(f32::INFINITY, f32::min);
    (low, high.into_iter().fold(f32::NEG_INFINITY, f32::max))
}

/// Counts values per part.
#[vectorised]
fn count(values: &[f32], scale: Scale, counts: &mut [u32]) {
    let mut parts = [0; SIDE];
    for chunk in values.chunks(SIDE) {
        parts.iter_mut().zip(chunk).for_each(|(part, &v)| *part = scale.part(v));
        parts[..chunk.len()].iter().for_each(|&part| counts[usize::from(part)] += 1);
    }
}

/// The values of three parts.
#[vectorised]
fn of_parts(values: &[f32], scale: Scale, [a, b, c]: [u16; 3]) -> Vec<f32> {
    let mut found = Vec::new();
    for chunk in values.chunks(SIDE) {
        let mut wanted = [false; SIDE];
        for (wanted, &v) in wanted.iter_mut().zip(chunk) {
            let part = scale.part(v);
            *wanted = (part == a) | (part == b) | (part == c);
        }
        if wanted.contains(&true) {
            // Without a branch per value, which a processor could not predict.
            let (mut kept, mut n) = ([0.0; SIDE], 0);
            for (&v, wanted) in chunk.iter().zip(wanted) {
                kept[n] = v;
                n += usize::from(wanted);
            }
            found.extend_from_slice(&kept[..n]);
        }
    }
    found
}

/// Values that lie farther than `reach` from the middle.
#[vectorised]
fn beyond(values: &[f32], middle: f32, reach: f32) -> u64 {
    values.iter().map(|v| u32::from((v - middle).abs() > reach)).sum::<u32>().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against a sort, with a far value that stretches the bins.
    #[test]
    fn histogram_of_known_values() {
        let mut values: Vec<f32> =
            (0..10_007u64).map(|i| (i * 7919 % 10_007) as f32 / 100.0).collect();
        values.push(5000.0);
        let h = Histogram::of(&values, 0.0);
        let mut sorted = values.clone();
        sorted.sort_by(f32::total_cmp);
        let at = |q: f64| f64::from(sorted[((sorted.len() - 1) as f64 * q) as usize]);
        assert_eq!(h.core_sigma, (at(0.75) - at(0.25)) / (2.0 * 0.674_489_75));
        assert_eq!((h.outliers, h.values, h.counts.len()), (1, 10_008, 256));
        assert_eq!(h.counts.iter().sum::<u64>(), 10_008);
        let bin = |v: f32| ((f64::from(v) - h.start) / h.step) as usize;
        let below = values.iter().filter(|v| bin(**v) == 2).count();
        assert_eq!((h.counts[2], h.counts[254..].iter().sum()), (below as u64, 1));
        assert_eq!(Histogram::of(&[3.0; 9], 0.0).counts, [9]);
    }

    /// Means of eight frames, less their mean: a ramp over the steps of 1/8 DN fills every bin but
    /// the last alike, however many steps a bin has.
    #[test]
    fn bins_hold_whole_steps_of_what_the_values_resolve() {
        for (steps, per_bin) in [(200u32, 1), (255, 1), (256, 1), (300, 2), (3000, 12)] {
            let value = |i: u32| (f64::from(i) / 8.0 - 91.733) as f32;
            let values: Vec<f32> = (0..steps).flat_map(|i| [value(i); 3]).collect();
            let h = Histogram::of(&values, 0.125);
            assert_eq!(h.step, 0.125 * f64::from(per_bin), "{steps}");
            assert!(h.counts.len() <= BINS);
            let (last, whole) = h.counts.split_last().unwrap();
            assert!(whole.iter().all(|&n| n == 3 * u64::from(per_bin)), "{steps}: {whole:?}");
            let rest = (steps - 1) % per_bin + 1;
            assert_eq!(*last, 3 * u64::from(rest), "{steps}");
        }
    }

    /// Rows of one cosine, all of its power at its frequency; the same along columns is the
    /// plane's mean only. The plane is every other column of a difference of two frames.
    #[test]
    fn spectra_and_high_pass_of_a_cosine() {
        let (columns, rows) = (40, 37);
        let wave =
            |x: usize| 3.0 + 2.0 * (2.0 * std::f64::consts::PI * 5.0 * x as f64 / 40.0).cos();
        // Whole units of 1e-6, and what 32 bits hold of values up to 2.
        let (unit, rounding) = (1e-6, 2e-6);
        let frame = |value: &dyn Fn(usize) -> f64| -> Vec<u32> {
            let row = (0..2 * columns).map(|x| (value(x) / unit).round() as u32);
            row.cycle().take(2 * columns * rows).collect()
        };
        let light = frame(&|x| if x % 2 == 1 { 2.0 * wave(x / 2) } else { 9.0 });
        let dark = frame(&|x| if x % 2 == 1 { wave(x / 2) } else { 7.0 });
        let site = Site { x0: 1, y0: 0, step_x: 2, step_y: 1, channel: 0 };
        let terms = [(&light[..], unit), (&dark[..], -unit)];
        let plane = SitePlane::of(site, (2 * columns, rows), &terms, Vec::new());
        assert!((plane.mean - 3.0).abs() < unit, "{}", plane.mean);
        let s = plane.spectrogram().unwrap();
        // |FFT|² / N of an amplitude 2 is 4 N / 4; an error ε of the values adds at most
        // 2 sqrt(N P) ε.
        let tolerance = |power: f64| 2.0 * (40.0 * power).sqrt() * rounding + 1e-9;
        assert!((s.horizontal[5] - 40.0).abs() < tolerance(40.0), "{}", s.horizontal[5]);
        assert!((s.horizontal.iter().sum::<f64>() - 40.0).abs() < tolerance(40.0));
        // Along columns every line is constant: 2 cos, whose mean square over x is 2, at frequency
        // 0.
        assert!((s.vertical[0] - 2.0 * 37.0).abs() < tolerance(74.0), "{}", s.vertical[0]);
        assert!(s.vertical[1..].iter().all(|p| p.abs() < tolerance(0.0)));
        let high = plane.high_pass();
        assert_eq!(high.len(), 36 * 33);
        let mean = |x: usize| (x - 2..=x + 2).map(wave).sum::<f64>() / 5.0;
        let expected = wave(9) - mean(9);
        assert!((f64::from(high[36 * 4 + 7]) - expected).abs() < 2.0 * rounding);
    }
}
