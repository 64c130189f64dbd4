//! The loops over a stack's samples, made for vector units: frames into sums, sums into moments.
//!
//! A strip is a few rows of all the frames, small enough that its sums stay in a core's cache while the frames go by.
//! Every loop runs along columns, so that one piece of code serves every colour filter pattern: what belongs to one
//! site is picked from the columns' sums at the end. Samples are summed as integers, exactly.

use multiversion::multiversion;

/// Pixels of a strip: with sums and four frames' samples, 320 KiB.
const STRIP_PIXELS: usize = 16 * 1024;

/// Columns whose sums stay in the innermost cache.
const TILE: usize = 512;

/// Largest sample of which four squares fit 32 bits.
pub const FOUR_SQUARES: u16 = 0x7fff;

/// Rows of a strip: whole periods of the filter pattern.
pub fn rows(width: usize, step_y: usize) -> usize {
    (STRIP_PIXELS / width / step_y).max(1) * step_y
}

/// Adds one to four frames' samples to the sums and sums of squares per pixel. Samples above [`FOUR_SQUARES`] come one
/// frame at a time.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
pub fn add(frames: &[&[u16]], sum: &mut [u32], sum_sq: &mut [u64]) {
    match *frames {
        [a] => add_frames([a], sum, sum_sq),
        [a, b] => add_frames([a, b], sum, sum_sq),
        [a, b, c] => add_frames([a, b, c], sum, sum_sq),
        [a, b, c, d] => add_frames([a, b, c, d], sum, sum_sq),
        _ => unreachable!("one to four frames"),
    }
}

#[inline(always)]
fn add_frames<const N: usize>(frames: [&[u16]; N], sum: &mut [u32], sum_sq: &mut [u64]) {
    let n = sum.len();
    let (frames, sum_sq) = (frames.map(|f| &f[..n]), &mut sum_sq[..n]);
    for i in 0..n {
        let (mut s, mut q) = (0u32, 0u32);
        for f in &frames {
            let v = u32::from(f[i]);
            s += v;
            q += v * v;
        }
        sum[i] += s;
        sum_sq[i] += u64::from(q);
    }
}

/// Adds the samples of rows to the sums of their columns, apart for each of the pattern's `step_y` rows. Returns the
/// smallest and the largest sample.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
pub fn sum_columns(samples: &[u16], width: usize, step_y: usize, sums: &mut [u32]) -> (u16, u16) {
    let (mut low, mut high) = (u16::MAX, 0);
    for (y, row) in samples.chunks_exact(width).enumerate() {
        let sums = &mut sums[y % step_y * width..][..width];
        for (s, &v) in sums.iter_mut().zip(row) {
            *s += u32::from(v);
            low = low.min(v);
            high = high.max(v);
        }
    }
    (low, high)
}

/// Counts the samples from `low` to `high` per column, as [`sum_columns`] sums them.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
pub fn count_columns(
    samples: &[u16],
    width: usize,
    step_y: usize,
    (low, high): (u16, u16),
    counts: &mut [u32],
) {
    for (y, row) in samples.chunks_exact(width).enumerate() {
        let counts = &mut counts[y % step_y * width..][..width];
        for (c, &v) in counts.iter_mut().zip(row) {
            *c += u32::from((v >= low) & (v <= high));
        }
    }
}

/// A multiple of every width that a filter pattern may have.
const LANES: usize = 24;

/// Rows of columns' sums as sums of the pattern's sites, row by row.
pub fn to_sites<T: Copy + Into<f64>>(columns: &[T], width: usize, step_x: usize) -> Vec<f64> {
    let mut out = Vec::with_capacity(columns.len() / width * step_x);
    for row in columns.chunks_exact(width) {
        let lanes = sum_lanes(row);
        out.extend((0..step_x).map(|x0| lanes.iter().skip(x0).step_by(step_x).sum::<f64>()));
    }
    out
}

/// Sums of every [`LANES`]th value. Integers to 2⁵³ add exactly.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn sum_lanes<T: Copy + Into<f64>>(row: &[T]) -> [f64; LANES] {
    let mut lanes = [0.0; LANES];
    let (whole, rest) = row.as_chunks::<LANES>();
    for chunk in whole {
        for (lane, &v) in lanes.iter_mut().zip(chunk) {
            *lane += v.into();
        }
    }
    for (lane, &v) in lanes.iter_mut().zip(rest) {
        *lane += v.into();
    }
    lanes
}

/// What a strip's sums over frames tell of its pixels. Columns and sites as in [`to_sites`].
pub struct StripMoments {
    /// Per row, per site of the row: sum of the sums.
    pub rows: Vec<f64>,
    /// Per column: sum of the sums.
    pub columns: Vec<f64>,
    /// Per site, mean of the sums.
    pub means: Vec<f64>,
    /// Per site, sum of the squared deviations from that mean.
    pub squares: Vec<f64>,
    /// Per site, sum of the pseudo-variances `L Σy² - (Σy)²`.
    pub variances: Vec<f64>,
    /// Per site, sum of their squares.
    pub variances_sq: Vec<f64>,
}

impl StripMoments {
    /// Of sums over `frames` frames of rows `width` wide. `work` is room that is used again.
    pub fn of(
        frames: usize,
        (width, step_x, step_y): (usize, usize, usize),
        sum: &[u32],
        sum_sq: &[u64],
        work: &mut Vec<f64>,
    ) -> Self {
        let period = step_y * width;
        let mut of_columns = vec![0.0; period];
        work.clear();
        work.resize(4 * period, 0.0);
        let (reference, work) = work.split_at_mut(period);
        let (squares, work) = work.split_at_mut(period);
        let (variances, variances_sq) = work.split_at_mut(period);
        // Deviations from the strip's first period keep their squares small.
        for (i, r) in reference.iter_mut().enumerate() {
            *r = f64::from(sum[(i / width * width + i % width % step_x) % sum.len()]);
        }
        for start in (0..width).step_by(TILE) {
            let length = TILE.min(width - start);
            for (y, at) in (start..sum.len()).step_by(width).enumerate() {
                let from = y % step_y * width + start;
                let tile = from..from + length;
                let pixels = at..at + length;
                add_moments(
                    frames as f64,
                    (&sum[pixels.clone()], &sum_sq[pixels], &reference[tile.clone()]),
                    [
                        &mut of_columns[tile.clone()],
                        &mut squares[tile.clone()],
                        &mut variances[tile.clone()],
                        &mut variances_sq[tile],
                    ],
                );
            }
        }
        let height = sum.len() / width;
        let count = |site: usize| {
            let (x0, y0) = (site % step_x, site / step_x);
            ((width - x0).div_ceil(step_x) * height.saturating_sub(y0).div_ceil(step_y)) as f64
        };
        let totals = to_sites(&of_columns, width, step_x);
        let mut squares = to_sites(squares, width, step_x);
        let mut means = Vec::with_capacity(totals.len());
        for (site, square) in squares.iter_mut().enumerate() {
            let first = reference[site / step_x * width + site % step_x];
            let n = count(site).max(1.0);
            let mean = totals[site] / n;
            *square = (*square - n * (mean - first) * (mean - first)).max(0.0);
            means.push(mean);
        }
        Self {
            rows: sum.chunks_exact(width).flat_map(|row| to_sites(row, width, step_x)).collect(),
            columns: of_columns,
            means,
            squares,
            variances: to_sites(variances, width, step_x),
            variances_sq: to_sites(variances_sq, width, step_x),
        }
    }
}

/// Adds pixels' sums, squared deviations from the reference, pseudo-variances and squares of these to their columns'.
#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn add_moments(
    frames: f64,
    (sum, sum_sq, reference): (&[u32], &[u64], &[f64]),
    [totals, squares, variances, variances_sq]: [&mut [f64]; 4],
) {
    let n = sum.len();
    let (sum_sq, reference, totals, squares, variances, variances_sq) = (
        &sum_sq[..n],
        &reference[..n],
        &mut totals[..n],
        &mut squares[..n],
        &mut variances[..n],
        &mut variances_sq[..n],
    );
    for i in 0..n {
        let (s, q) = (f64::from(sum[i]), sum_sq[i] as f64);
        let d = s - reference[i];
        // Exact below 2⁵³: the largest sample times the frames is below 9e7.
        let v = frames * q - s * s;
        totals[i] += s;
        squares[i] += d * d;
        variances[i] += v;
        variances_sq[i] += v * v;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against sums written down straight, on a pattern of 2 x 3 and a width that no vector divides.
    #[test]
    fn moments_of_a_strip() {
        let (width, height, step_x, step_y) = (515, 7, 2, 3);
        let frame = |k: u32| -> Vec<u16> {
            let noise = |i: u32| (i.wrapping_mul(2_654_435_761).wrapping_add(k * 97) >> 20) as u16;
            (0..(width * height) as u32).map(noise).collect()
        };
        let frames: Vec<Vec<u16>> = (0..3).map(frame).collect();
        let (mut sum, mut sum_sq) = (vec![0; width * height], vec![0; width * height]);
        add(&[&frames[0], &frames[1]], &mut sum, &mut sum_sq);
        add(&[&frames[2]], &mut sum, &mut sum_sq);
        let m = StripMoments::of(3, (width, step_x, step_y), &sum, &sum_sq, &mut Vec::new());
        let mut columns = vec![0; step_y * width];
        let range = sum_columns(&frames[1], width, step_y, &mut columns);
        let mut some = vec![0; step_y * width];
        count_columns(&frames[1], width, step_y, (100, 1000), &mut some);
        let (totals, some) = (to_sites(&columns, width, step_x), to_sites(&some, width, step_x));
        for site in 0..step_x * step_y {
            let (x0, y0) = (site % step_x, site / step_x);
            let at: Vec<usize> = (y0..height)
                .step_by(step_y)
                .flat_map(|y| (x0..width).step_by(step_x).map(move |x| y * width + x))
                .collect();
            let n = at.len() as f64;
            let means: Vec<f64> = at.iter().map(|&i| f64::from(sum[i])).collect();
            let mean = means.iter().sum::<f64>() / n;
            let square: f64 = means.iter().map(|v| (v - mean).powi(2)).sum();
            assert!((m.means[site] - mean).abs() < 1e-9 * mean);
            assert!((m.squares[site] / square - 1.0).abs() < 1e-12);
            let variance = |&i: &usize| {
                let y = frames.iter().map(|f| f64::from(f[i]));
                3.0 * y.clone().map(|v| v * v).sum::<f64>() - y.sum::<f64>().powi(2)
            };
            assert_eq!(m.variances[site], at.iter().map(variance).sum::<f64>());
            let all: Vec<u16> = at.iter().map(|&i| frames[1][i]).collect();
            assert_eq!(totals[site], all.iter().map(|&v| f64::from(v)).sum::<f64>());
            let inside = all.iter().filter(|v| (100..=1000).contains(*v)).count();
            assert_eq!(some[site], inside as f64);
        }
        let (low, high) = (frames[1].iter().min(), frames[1].iter().max());
        assert_eq!((Some(&range.0), Some(&range.1)), (low, high));
        let row: f64 = (0..width).step_by(2).map(|x| f64::from(sum[4 * width + x])).sum();
        assert_eq!(m.rows[4 * step_x], row);
    }
}
