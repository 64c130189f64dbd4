//! The loops over the samples of a stack, written for vector units: frames to sums, sums to
//! moments.
//!
//! A strip is a few rows of all frames, small enough that its sums stay in a core's cache while
//! frames are read. Every loop runs along a row in lanes, whose number is a multiple of the width
//! of every colour filter pattern: one loop serves all patterns, and the sums of a site are
//! gathered from the lanes at the end. Samples are summed exactly, as integers.

use camrig_vector::vectorised;

/// Pixels of a strip: 640 KiB with sums and the samples of four frames, within a core's cache.
/// Longer pieces are read faster from a file.
const STRIP_PIXELS: usize = 32 * 1024;

/// Number of frames that are added in one pass over the sums.
pub const TOGETHER: usize = 4;

/// Largest sample for which the sum of [`TOGETHER`] squares fits 32 bits.
pub const SMALL_SQUARES: u16 = 0x7fff;

/// Pixels that loops process in parallel: a multiple of the width of every filter pattern.
const LANES: usize = 24;

/// Samples that loops process in parallel; they are narrower than sums.
const SAMPLE_LANES: usize = 4 * LANES;

/// Rows of a strip: whole periods of the filter pattern.
pub fn rows(width: usize, step_y: usize) -> usize {
    (STRIP_PIXELS / width / step_y).max(1) * step_y
}

/// Adds the samples of up to [`TOGETHER`] frames to the pixels' sums and sums of squares; the
/// `first` frames overwrite them. Frames with samples above [`SMALL_SQUARES`] have to be added one
/// at a time.
#[vectorised]
pub fn add(frames: &[&[u16]], first: bool, sum: &mut [u32], sum_sq: &mut [u64]) {
    match (frames, first) {
        (&[a], true) => add_frames::<1, true>([a], sum, sum_sq),
        (&[a], false) => add_frames::<1, false>([a], sum, sum_sq),
        (&[a, b], true) => add_frames::<2, true>([a, b], sum, sum_sq),
        (&[a, b], false) => add_frames::<2, false>([a, b], sum, sum_sq),
        (&[a, b, c], true) => add_frames::<3, true>([a, b, c], sum, sum_sq),
        (&[a, b, c], false) => add_frames::<3, false>([a, b, c], sum, sum_sq),
        (&[a, b, c, d], true) => add_frames::<4, true>([a, b, c, d], sum, sum_sq),
        (&[a, b, c, d], false) => add_frames::<4, false>([a, b, c, d], sum, sum_sq),
        _ => unreachable!("one to four frames"),
    }
}

#[inline(always)]
fn add_frames<const N: usize, const FIRST: bool>(
    frames: [&[u16]; N],
    sum: &mut [u32],
    sum_sq: &mut [u64],
) {
    let n = sum.len();
    let (frames, sum_sq) = (frames.map(|f| &f[..n]), &mut sum_sq[..n]);
    for i in 0..n {
        let (mut s, mut q) = (0u32, 0u32);
        for f in &frames {
            let v = u32::from(f[i]);
            s += v;
            q += v * v;
        }
        sum[i] = if FIRST { s } else { sum[i] + s };
        sum_sq[i] = if FIRST { u64::from(q) } else { sum_sq[i] + u64::from(q) };
    }
}

/// Sums or numbers of samples for each site of the pattern, row by row.
pub type PerSite = Vec<f64>;

/// Sums of the samples of some rows.
pub struct SiteSums {
    /// Sum of the samples of each site.
    pub sums: PerSite,
    /// Smallest sample.
    pub low: u16,
    /// Largest sample.
    pub high: u16,
}

/// Sums of the samples of some rows of frames `width` wide, with a pattern of `step_x` columns and
/// `step_y` rows.
pub fn sums(samples: &[u16], (width, step_x, step_y): (usize, usize, usize)) -> SiteSums {
    let mut lanes = vec![[0; SAMPLE_LANES]; step_y];
    let (low, high) = sum_lanes(samples, width, &mut lanes);
    let sums = lanes.iter().flat_map(|lanes| to_sites(lanes, step_x)).collect();
    SiteSums { sums, low, high }
}

/// Numbers of samples of some rows that lie from `low` to `high`.
pub fn counts(
    samples: &[u16],
    (width, step_x, step_y): (usize, usize, usize),
    (low, high): (u16, u16),
) -> PerSite {
    let mut lanes = vec![[0; SAMPLE_LANES]; step_y];
    count_lanes(samples, width, (low, high), &mut lanes);
    lanes.iter().flat_map(|lanes| to_sites(lanes, step_x)).collect()
}

/// The lanes of a row, summed to sites.
fn to_sites<T: Copy + Into<f64>>(lanes: &[T], step_x: usize) -> impl Iterator<Item = f64> + '_ {
    let of_site = move |x0| lanes.iter().skip(x0).step_by(step_x).map(|&v| v.into()).sum::<f64>();
    (0..step_x).map(of_site)
}

/// Adds rows to the lanes of their row of the pattern. The samples of a strip do not overflow a
/// lane.
#[vectorised]
fn sum_lanes(samples: &[u16], width: usize, sums: &mut [[u32; SAMPLE_LANES]]) -> (u16, u16) {
    let (mut low, mut high) = ([u16::MAX; SAMPLE_LANES], [0; SAMPLE_LANES]);
    let step_y = sums.len();
    for (y, row) in samples.chunks_exact(width).enumerate() {
        let sums = &mut sums[y % step_y];
        let (whole, rest) = row.as_chunks::<SAMPLE_LANES>();
        for chunk in whole {
            for i in 0..SAMPLE_LANES {
                sums[i] += u32::from(chunk[i]);
                low[i] = low[i].min(chunk[i]);
                high[i] = high[i].max(chunk[i]);
            }
        }
        for (i, &v) in rest.iter().enumerate() {
            sums[i] += u32::from(v);
            low[i] = low[i].min(v);
            high[i] = high[i].max(v);
        }
    }
    let low = low.iter().fold(u16::MAX, |a, &b| a.min(b));
    (low, high.iter().fold(0, |a, &b| a.max(b)))
}

#[vectorised]
fn count_lanes(
    samples: &[u16],
    width: usize,
    (low, high): (u16, u16),
    counts: &mut [[u32; SAMPLE_LANES]],
) {
    let step_y = counts.len();
    for (y, row) in samples.chunks_exact(width).enumerate() {
        let counts = &mut counts[y % step_y];
        for chunk in row.chunks(SAMPLE_LANES) {
            for (c, &v) in counts.iter_mut().zip(chunk) {
                *c += u32::from((v >= low) & (v <= high));
            }
        }
    }
}

/// Sums over the pixels of a strip.
pub struct StripMoments {
    /// Sum of the pixels' sums for each row and site of the row.
    pub rows: Vec<f64>,
    /// Sum of the pixels' sums for each row of the pattern and column.
    pub columns: Vec<f64>,
    /// Mean of the pixels' sums for each site.
    pub means: PerSite,
    /// Sum of the squared deviations from that mean for each site.
    pub squares: PerSite,
    /// Sum of the pseudo-variances `L Σy² - (Σy)²` for each site.
    pub variances: PerSite,
    /// Sum of the squared pseudo-variances for each site.
    pub variances_sq: PerSite,
}

/// Sums over the pixels of a row of the pattern, lane by lane.
#[derive(Clone, Copy)]
struct Lanes {
    /// Reference of the deviations: a pixel of the site, so that their squares stay small.
    reference: [f64; LANES],
    squares: [f64; LANES],
    variances: [f64; LANES],
    variances_sq: [f64; LANES],
}

impl StripMoments {
    /// The moments of sums over `frames` frames, of rows `width` pixels wide.
    pub fn of(
        frames: usize,
        (width, step_x, step_y): (usize, usize, usize),
        sum: &[u32],
        sum_sq: &[u64],
    ) -> Self {
        let height = sum.len() / width;
        // A strip at the bottom may lack the pattern's last rows.
        let first = |y: usize, i: usize| f64::from(sum[y.min(height - 1) * width + i % step_x]);
        let mut lanes: Vec<Lanes> = (0..step_y)
            .map(|y| Lanes {
                reference: std::array::from_fn(|i| first(y, i)),
                squares: [0.0; LANES],
                variances: [0.0; LANES],
                variances_sq: [0.0; LANES],
            })
            .collect();
        let mut columns = vec![0.0; step_y * width];
        let mut rows = Vec::with_capacity(height * step_x);
        let lines = sum.chunks_exact(width).zip(sum_sq.chunks_exact(width));
        for (y, (sum, sum_sq)) in lines.enumerate() {
            let y = y % step_y;
            let columns = &mut columns[y * width..][..width];
            let totals = add_row(frames as f64, (sum, sum_sq), columns, &mut lanes[y]);
            rows.extend(to_sites(&totals, step_x));
        }
        let of_sites = |f: fn(&Lanes) -> &[f64; LANES]| -> PerSite {
            lanes.iter().flat_map(|l| to_sites(f(l), step_x)).collect()
        };
        let mut squares = of_sites(|l| &l.squares);
        let means = squares.iter_mut().enumerate().map(|(site, square)| {
            let (x0, y0) = (site % step_x, site / step_x);
            let of_site = rows.iter().skip(y0 * step_x + x0).step_by(step_x * step_y);
            let count = (width - x0).div_ceil(step_x) * of_site.len();
            let mean = of_site.sum::<f64>() / count.max(1) as f64;
            let shift = mean - lanes[y0].reference[x0];
            *square = (*square - count as f64 * shift * shift).max(0.0);
            mean
        });
        Self {
            means: means.collect(),
            squares,
            variances: of_sites(|l| &l.variances),
            variances_sq: of_sites(|l| &l.variances_sq),
            rows,
            columns,
        }
    }
}

/// Adds a row of pixels to the lanes of its row of the pattern and to its columns; returns the
/// sums of its lanes.
#[vectorised]
fn add_row(
    frames: f64,
    (sum, sum_sq): (&[u32], &[u64]),
    columns: &mut [f64],
    lanes: &mut Lanes,
) -> [f64; LANES] {
    let mut totals = [0.0; LANES];
    let mut add = |i: usize, sum: u32, sum_sq: u64, column: &mut f64| {
        let (s, q) = (f64::from(sum), sum_sq as f64);
        let d = s - lanes.reference[i];
        // Exact below 2⁵³: the largest sample times the frames is below 9e7.
        let v = frames * q - s * s;
        *column += s;
        totals[i] += s;
        lanes.squares[i] += d * d;
        lanes.variances[i] += v;
        lanes.variances_sq[i] += v * v;
    };
    let (sum, sum_rest) = sum.as_chunks::<LANES>();
    let (sum_sq, sum_sq_rest) = sum_sq.as_chunks::<LANES>();
    let (columns, columns_rest) = columns.as_chunks_mut::<LANES>();
    for ((sum, sum_sq), columns) in sum.iter().zip(sum_sq).zip(columns) {
        for i in 0..LANES {
            add(i, sum[i], sum_sq[i], &mut columns[i]);
        }
    }
    for (i, column) in columns_rest.iter_mut().enumerate() {
        add(i, sum_rest[i], sum_sq_rest[i], column);
    }
    totals
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compared with direct sums, for a pattern of 2 x 3 and a width that is not a multiple of a
    /// vector.
    #[test]
    fn moments_of_a_strip() {
        let (width, height, step_x, step_y) = (515, 7, 2, 3);
        let frame = |k: u32| -> Vec<u16> {
            let noise = |i: u32| (i.wrapping_mul(2_654_435_761).wrapping_add(k * 97) >> 20) as u16;
            (0..(width * height) as u32).map(noise).collect()
        };
        let frames: Vec<Vec<u16>> = (0..3).map(frame).collect();
        let (mut sum, mut sum_sq) = (vec![7; width * height], vec![7; width * height]);
        add(&[&frames[0], &frames[1]], true, &mut sum, &mut sum_sq);
        add(&[&frames[2]], false, &mut sum, &mut sum_sq);
        let shape = (width, step_x, step_y);
        let m = StripMoments::of(3, shape, &sum, &sum_sq);
        let SiteSums { sums: totals, low, high } = sums(&frames[1], shape);
        let some = counts(&frames[1], shape, (100, 1000));
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
        let range = (frames[1].iter().min(), frames[1].iter().max());
        assert_eq!((Some(&low), Some(&high)), range);
        let row: f64 = (0..width).step_by(2).map(|x| f64::from(sum[4 * width + x])).sum();
        assert_eq!(m.rows[4 * step_x], row);
    }
}
