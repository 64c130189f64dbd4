//! Decomposes a map over pixels: smooth terms, rows, columns, pixels, outliers, lattices.
//!
//! The components are estimated with outliers clipped and subtracted one after the other, so that
//! none is counted twice: the mean, smooth terms, rows and columns, blocks, single pixels.

use super::lines::Lines;
use super::temporal::covariance;
use crate::data::channels::Channels;
use camrig_base::Plane;
use camrig_base::median::{median, robust_sd};
use camrig_linear::moments;

/// Side of the blocks that show large-scale structure, pixels.
pub const BLOCK: usize = 16;
/// Robust standard deviations from the mean above which a pixel is an outlier: one in 26 million of
/// a normal distribution.
const OUTLIER: f64 = 5.5;
/// Values are clipped at this many robust standard deviations before they are summed: a normal
/// distribution loses 1.2·10⁻⁴ of its variance, and an outlier counts as much as 16 pixels at most.
pub const CLIP: f64 = 4.0;
/// Values are clipped at this multiple of [`CLIP`] while rows, columns and smooth terms are still
/// in the map and widen its distribution.
const CLIP_OF_WHOLE_MAP: f64 = 1.5;
/// Kurtosis by octiles of a normal distribution.
const MOORS_OF_NORMAL: f64 = 1.233_095;
/// Number of half waves over a map that count as smooth.
pub const HALF_WAVES: usize = 4;
/// A corner region has 1/`CORNER_SHARE` of the columns and rows.
pub const CORNER_SHARE: usize = 8;
/// Side of the lattice whose phases are compared, pixels.
pub const LATTICE: usize = 16;
/// Names of the smooth terms, see [`smooth_terms`].
pub const SMOOTH_TERMS: [&str; 5] = [
    "left-right slope",
    "top-bottom slope",
    "horizontal curvature",
    "vertical curvature",
    "saddle",
];

/// The components of a map, in the map's unit.
#[derive(Clone, Debug, Default)]
pub struct Spatial {
    /// Amplitudes (root mean square) of the five [`smooth_terms`].
    pub slopes: [f64; 5],
    /// Means of rows.
    pub rows: Lines,
    /// Means of columns.
    pub columns: Lines,
    /// Variance after subtraction of rows and columns, outliers clipped at 4 standard deviations.
    pub pixel_variance: f64,
    /// The same with outliers.
    pub whole_variance: f64,
    /// Variance of the means of 16x16 blocks, times 256, relative to the pixel variance.
    pub blocks: f64,
    /// The same after subtraction of cosines of up to four half waves over the map, per degree of
    /// freedom.
    pub fine_blocks: f64,
    /// Means of the four corner regions (an eighth of each side): top left, top right, bottom
    /// left, bottom right.
    pub corners: [f64; 4],
    /// Contrasts of the 2x2 phases: even minus odd rows, even minus odd columns, one half of a
    /// checkerboard minus the other.
    pub phases: [f64; 3],
    /// Correlation with the neighbour right, below, and diagonally below.
    pub correlation: [f64; 3],
    /// Number of bright outliers.
    pub high: f64,
    /// Sum of the bright outliers' deviations.
    pub high_sum: f64,
    /// Number of dark outliers.
    pub low: f64,
    /// Sum of the dark outliers' deviations (negative).
    pub low_sum: f64,
    /// Skewness of the pixels by octiles E: (E7 + E1 − 2 E4)/(E7 − E1) (Bowley's, of octiles).
    pub skewness: f64,
    /// Excess over a normal distribution of their kurtosis by octiles,
    /// (E7 − E5 + E3 − E1)/(E6 − E2) (Moors 1988).
    pub kurtosis: f64,
    /// Third and fourth cumulant of the pixels, outliers included.
    pub cumulants: [f64; 2],
    /// Largest mean over a phase of the 16x16 lattice, after subtraction of the 2x2 phases, in
    /// standard deviations.
    pub lattice: f64,
}

/// √3u, √3v, √5(3u²−1)/2, √5(3v²−1)/2 and 3uv at (u, v), which run from −1 to 1 over the columns
/// and rows: products of Legendre polynomials, orthogonal, of mean square 1.
pub fn smooth_terms(u: f64, v: f64) -> [f64; 5] {
    let (r3, r5) = (3f64.sqrt(), 5f64.sqrt() / 2.0);
    [r3 * u, r3 * v, r5 * (3.0 * u * u - 1.0), r5 * (3.0 * v * v - 1.0), 3.0 * u * v]
}

/// Robust standard deviation, from the median absolute deviation.
fn sd_about_median(mut v: Vec<f32>) -> f64 {
    let middle = median(&mut v, f32::total_cmp);
    robust_sd(v.into_iter().map(|x| x - middle))
}

/// Robust standard deviation of each channel's pixels.
pub fn robust_sds(d: &[f32], channels: &Channels) -> Vec<f64> {
    let mut own = vec![Vec::new(); channels.count()];
    channels.visit(d, |x, channel| own[channel].push(x));
    own.into_iter().map(sd_about_median).collect()
}

/// Decomposes a map. Where the light may be uneven (`even` false), rows and columns are high-pass
/// filtered.
pub fn describe(map: &Plane<f32>, channels: &Channels, even: bool) -> Spatial {
    let (w, h) = (map.width, map.height);
    let mut d = map.data.clone();
    let scale = sd_about_median(d.clone()).max(1e-12);
    let limit = (CLIP_OF_WHOLE_MAP * CLIP * scale) as f32;
    centre(&mut d, limit);
    let mut s =
        Spatial { slopes: subtract_smooth_terms(&mut d, w, h, limit), ..Spatial::default() };
    subtract_lines(&mut d, w, h, limit, even, &mut s);
    // Blocks after subtraction of rows and columns, whose patterns lines of blocks would share.
    let (blocks, fine_blocks) = blocks(&d, w, h, limit);
    let sd = sd_about_median(d.clone()).max(1e-12);
    centre(&mut d, (CLIP * sd) as f32);
    describe_outliers(&d, channels, &mut s);
    describe_clipped(&mut d, w, h, (CLIP * sd) as f32, &mut s);
    s.blocks = blocks / s.pixel_variance;
    s.fine_blocks = fine_blocks / s.pixel_variance;
    s.lattice = lattice(&d, w, h, s.pixel_variance);
    s
}

/// Subtracts the median of a map and then the mean of what is clipped, so that the clipped map has
/// the mean 0: a few outliers would move a plain mean, and the constant that is left would count as
/// correlation, skewness and level of the corners.
fn centre(d: &mut [f32], limit: f32) {
    let middle = median(&mut d.to_vec(), f32::total_cmp);
    let clipped = d.iter().map(|&x| f64::from((x - middle).clamp(-limit, limit)));
    let mean = clipped.sum::<f64>() / d.len() as f64;
    let zero = (f64::from(middle) + mean) as f32;
    d.iter_mut().for_each(|x| *x -= zero);
}

/// Subtracts the smooth terms from a map of mean 0 and returns their amplitudes; outliers are
/// clipped.
fn subtract_smooth_terms(d: &mut [f32], w: usize, h: usize, limit: f32) -> [f64; 5] {
    let n = (w * h) as f64;
    let mut slopes = [0.0; 5];
    let u: Vec<f64> = (0..w).map(|x| (x as f64 + 0.5) / w as f64 * 2.0 - 1.0).collect();
    for (y, row) in d.chunks(w).enumerate() {
        let v = (y as f64 + 0.5) / h as f64 * 2.0 - 1.0;
        // All five sums follow from moments of the row over u.
        let (mut m0, mut m1, mut m2) = (0.0, 0.0, 0.0);
        for (&x, &u) in row.iter().zip(&u) {
            let x = f64::from(x.clamp(-limit, limit));
            m0 += x;
            m1 += x * u;
            m2 += x * u * u;
        }
        let (r3, r5) = (3f64.sqrt(), 5f64.sqrt() / 2.0);
        slopes[0] += r3 * m1;
        slopes[1] += r3 * v * m0;
        slopes[2] += r5 * (3.0 * m2 - m0);
        slopes[3] += r5 * (3.0 * v * v - 1.0) * m0;
        slopes[4] += 3.0 * v * m1;
    }
    slopes.iter_mut().for_each(|k| *k /= n);
    for (y, row) in d.chunks_mut(w).enumerate() {
        let v = (y as f64 + 0.5) / h as f64 * 2.0 - 1.0;
        for (x, &u) in row.iter_mut().zip(&u) {
            let b = smooth_terms(u, v);
            let slope: f64 = b.iter().zip(&slopes).map(|(b, k)| b * k).sum();
            *x -= slope as f32;
        }
    }
    slopes
}

/// Describes rows, columns, corners and 2x2 phases of a map, then subtracts rows and columns.
fn subtract_lines(d: &mut [f32], w: usize, h: usize, limit: f32, even: bool, s: &mut Spatial) {
    let clipped = |x: f32| f64::from(x.clamp(-limit, limit));
    let rows: Vec<f64> =
        d.chunks(w).map(|r| r.iter().map(|&x| clipped(x)).sum::<f64>() / w as f64).collect();
    let mut columns = vec![0.0; w];
    for row in d.chunks(w) {
        columns.iter_mut().zip(row).for_each(|(c, &x)| *c += clipped(x));
    }
    columns.iter_mut().for_each(|c| *c /= h as f64);
    s.rows = Lines::new(rows.clone(), even);
    s.columns = Lines::new(columns.clone(), even);
    s.corners = corners(d, w, h, limit);
    s.phases = phases(d, w, h, limit);
    for (row, mean) in d.chunks_mut(w).zip(&rows) {
        row.iter_mut().zip(&columns).for_each(|(x, c)| *x -= (mean + c) as f32);
    }
}

/// Counts the outliers among single pixels, and computes moments that include them. The limit is
/// that of each channel: the gain map of a channel with less light has more noise.
fn describe_outliers(d: &[f32], channels: &Channels, s: &mut Spatial) {
    let n = d.len() as f64;
    let limits: Vec<f64> =
        robust_sds(d, channels).into_iter().map(|sd| OUTLIER * sd.max(1e-12)).collect();
    channels.visit(d, |x, channel| {
        let x = f64::from(x);
        s.whole_variance += x * x;
        s.cumulants[0] += x * x * x;
        s.cumulants[1] += x * x * x * x;
        if x > limits[channel] {
            s.high += 1.0;
            s.high_sum += x;
        } else if x < -limits[channel] {
            s.low += 1.0;
            s.low_sum += x;
        }
    });
    s.whole_variance /= n;
    s.cumulants = [s.cumulants[0] / n, s.cumulants[1] / n - 3.0 * s.whole_variance.powi(2)];
}

/// Clips single pixels at `clip` and describes them: octiles, variance, correlation of neighbours.
fn describe_clipped(d: &mut [f32], w: usize, h: usize, clip: f32, s: &mut Spatial) {
    let n = (w * h) as f64;
    d.iter_mut().for_each(|x| *x = x.clamp(-clip, clip));
    s.pixel_variance = d.iter().map(|&x| f64::from(x) * f64::from(x)).sum::<f64>() / n;
    let [e1, e2, e3, e4, e5, e6, e7] = octiles(&mut d.to_vec());
    s.skewness = (e7 + e1 - 2.0 * e4) / (e7 - e1);
    s.kurtosis = (e7 - e5 + e3 - e1) / (e6 - e2) - MOORS_OF_NORMAL;
    for (c, (dx, dy)) in s.correlation.iter_mut().zip([(1, 0), (0, 1), (1, 1)]) {
        *c = covariance(d, w, h, dx, dy) / s.pixel_variance;
    }
}

/// The seven octiles of values, which are reordered: each half is divided where its middle is.
fn octiles(values: &mut [f32]) -> [f64; 7] {
    let mut out = [0.0; 7];
    let mut parts: Vec<(&mut [f32], usize, usize)> = vec![(values, 3, 2)];
    while let Some((part, at, reach)) = parts.pop() {
        if part.is_empty() {
            continue;
        }
        let (below, middle, above) = part.select_nth_unstable_by(part.len() / 2, f32::total_cmp);
        out[at] = f64::from(*middle);
        if reach > 0 {
            parts.extend([(below, at - reach, reach / 2), (above, at + reach, reach / 2)]);
        }
    }
    out
}

/// Variance of block means × the pixels of a block: as it is, and after subtraction of smooth
/// cosines.
fn blocks(d: &[f32], w: usize, h: usize, limit: f32) -> (f64, f64) {
    let (across, down) = (w / BLOCK, h / BLOCK);
    let mut blocks = vec![0.0f64; across * down];
    for (y, row) in d.chunks(w).enumerate().take(down * BLOCK) {
        for (bx, pixels) in row.chunks_exact(BLOCK).enumerate() {
            let sum: f32 = pixels.iter().map(|x| x.clamp(-limit, limit)).sum();
            blocks[y / BLOCK * across + bx] += f64::from(sum);
        }
    }
    let area = (BLOCK * BLOCK) as f64;
    blocks.iter_mut().for_each(|b| *b /= area);
    (moments(&blocks).1 * area, beyond_cosines(&blocks, across, down) * area)
}

/// Means of the four corner regions, outliers clipped.
fn corners(d: &[f32], w: usize, h: usize, limit: f32) -> [f64; 4] {
    let (cw, ch) = ((w / CORNER_SHARE).max(1), (h / CORNER_SHARE).max(1));
    [0, 1, 2, 3].map(|i| {
        let (x0, y0) = ((i % 2) * (w - cw), (i / 2) * (h - ch));
        let rows = d.chunks(w).skip(y0).take(ch);
        let sum: f64 =
            rows.flat_map(|r| &r[x0..x0 + cw]).map(|x| f64::from(x.clamp(-limit, limit))).sum();
        sum / (cw * ch) as f64
    })
}

/// Variance of a grid of means after subtraction of cosines of up to [`HALF_WAVES`] half waves, per
/// degree of freedom.
fn beyond_cosines(blocks: &[f64], across: usize, down: usize) -> f64 {
    let n = blocks.len() as f64;
    let (nx, ny) = ((HALF_WAVES + 1).min(across), (HALF_WAVES + 1).min(down));
    let wave = |k: usize, i: usize, n: usize| {
        let scale = if k == 0 { 1.0 } else { std::f64::consts::SQRT_2 };
        scale * libm::cos(std::f64::consts::PI * k as f64 * (i as f64 + 0.5) / n as f64)
    };
    let mut remaining: f64 = blocks.iter().map(|b| b * b).sum();
    for ky in 0..ny {
        for kx in 0..nx {
            let mut sum = 0.0;
            for (y, row) in blocks.chunks(across.max(1)).enumerate() {
                let terms = row.iter().enumerate().map(|(x, b)| b * wave(kx, x, across));
                sum += terms.sum::<f64>() * wave(ky, y, down);
            }
            // Cosines at the centres of a grid are orthogonal, of mean square 1.
            remaining -= sum * sum / n;
        }
    }
    remaining.max(0.0) / (n - (nx * ny) as f64).max(1.0)
}

/// Contrasts of the means of the 2x2 phases, outliers clipped: rows, columns, checkerboard. They
/// are orthogonal, and so independent.
fn phases(d: &[f32], w: usize, h: usize, limit: f32) -> [f64; 3] {
    let mut mean = [0.0f64; 4];
    for (y, row) in d.chunks(w).enumerate().take(h / 2 * 2) {
        for pair in row.chunks_exact(2) {
            for (x, v) in pair.iter().enumerate() {
                mean[y % 2 * 2 + x] += f64::from(v.clamp(-limit, limit));
            }
        }
    }
    let count = (w / 2 * (h / 2)) as f64;
    let [a, b, c, e] = mean.map(|m| m / count);
    [(a + b - c - e) / 2.0, (a + c - b - e) / 2.0, (a + e - b - c) / 2.0]
}

/// Largest mean over a phase of the lattice, after subtraction of the 2x2 phases, in standard
/// deviations; 0 for a map smaller than the lattice.
fn lattice(d: &[f32], w: usize, h: usize, pixel_variance: f64) -> f64 {
    let (across, down) = (w / LATTICE, h / LATTICE);
    if across == 0 || down == 0 {
        return 0.0;
    }
    let mut lattice = [0.0f64; LATTICE * LATTICE];
    for (y, row) in d.chunks(w).enumerate().take(down * LATTICE) {
        for (x, &v) in row[..across * LATTICE].iter().enumerate() {
            lattice[y % LATTICE * LATTICE + x % LATTICE] += f64::from(v);
        }
    }
    let count = (across * down) as f64;
    lattice.iter_mut().for_each(|l| *l /= count);
    let phase = |i: usize| i / LATTICE % 2 * 2 + i % 2;
    let mut phases = [0.0; 4];
    for (i, l) in lattice.iter().enumerate() {
        phases[phase(i)] += l / (LATTICE * LATTICE / 4) as f64;
    }
    let sd = (pixel_variance / count).sqrt().max(1e-300);
    let deviations = lattice.iter().enumerate().map(|(i, l)| (l - phases[phase(i)]).abs() / sd);
    deviations.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_camera::Camera;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    fn channels_of(width: usize) -> Channels {
        let mut camera = Camera::load("mt9v024").unwrap();
        camera.sensor.width = width as u32;
        Channels::new(&camera)
    }

    /// 0.3 % of the pixels at 500 times the spread: a plain mean would leave 1.6 spreads on all
    /// pixels, and a correlation of 0.7.
    #[test]
    fn outliers_are_no_correlation_of_neighbours() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(9);
        let map = Plane::from_fn(96, 96, |x, y| {
            let noise: f32 = StandardNormal.sample(&mut rng);
            if (x * 31 + y * 57) % 331 == 0 { 500.0 } else { noise }
        });
        let s = describe(&map, &channels_of(96), true);
        // Of 9216 independent pixels 0.0104 each.
        assert!(s.correlation.iter().all(|c| c.abs() < 0.042), "{:?}", s.correlation);
        assert!(s.corners.iter().all(|c| c.abs() < 4.0 / 12.0), "{:?}", s.corners);
        // The outliers count as four deviations: 0.3 % of 16.
        assert!((s.pixel_variance - 1.0).abs() < 0.11, "{}", s.pixel_variance);
    }

    #[test]
    fn outliers_are_relative_to_their_own_channel() {
        let (w, h) = (128, 96);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(2);
        let channels = channels_of(w);
        assert!(channels.count() > 1);
        // One channel has five times the noise of the others: their limit is 1.1 of its standard
        // deviations.
        let mut data: Vec<f32> = (0..w * h).map(|_| StandardNormal.sample(&mut rng)).collect();
        let sd: Vec<f64> = (0..channels.count()).map(|c| if c == 0 { 5.0 } else { 1.0 }).collect();
        channels.change(&mut data, &sd, |v, sd| v * sd);
        let map = Plane { width: w, height: h, data };
        let s = describe(&map, &channels, true);
        assert_eq!((s.high, s.low), (0.0, 0.0));
        let mut weak = map;
        weak.data.iter_mut().step_by(1001).for_each(|v| *v -= 40.0);
        let s = describe(&weak, &channels, true);
        // Rows and columns absorb a share of 1/w + 1/h; the noise of the mean is at most √(25/13).
        assert_eq!(s.low, 13.0);
        let share = 40.0 * (1.0 / w as f64 + 1.0 / h as f64);
        assert!((s.low_sum / s.low + 40.0).abs() < share + 3.0 * (25.0f64 / 13.0).sqrt());
    }

    #[test]
    fn components_are_separated() {
        let (w, h) = (256, 192);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let mut normal = |n: usize, sd: f64| -> Vec<f64> {
            (0..n)
                .map(|_| {
                    let z: f64 = StandardNormal.sample(&mut rng);
                    sd * z
                })
                .collect()
        };
        let (rows, columns, pixels) = (normal(h, 0.5), normal(w, 0.25), normal(w * h, 2.0));
        let map = Plane {
            width: w,
            height: h,
            data: (0..w * h)
                .map(|i| {
                    let (x, y) = (i % w, i / w);
                    let u = (x as f64 + 0.5) / w as f64 * 2.0 - 1.0;
                    let v = (y as f64 + 0.5) / h as f64 * 2.0 - 1.0;
                    let even = if x % 2 == 0 { 0.1 } else { -0.1 };
                    let hot = if i % 5000 == 77 { 40.0 } else { 0.0 };
                    (7.0 + 0.8 * smooth_terms(u, v)[2]
                        + rows[y]
                        + columns[x]
                        + pixels[i]
                        + even
                        + hot) as f32
                })
                .collect(),
        };
        let s = describe(&map, &channels_of(w), true);
        // Three standard errors of each estimate: slope √(4/n + 0.0625/w), variances √(2/lines).
        assert!((s.slopes[2] - 0.8).abs() < 3.0 * (4.0 / 49152.0f64 + 0.0725 / 256.0).sqrt());
        assert!(
            (s.rows.variance / (0.25 + 4.0 / 256.0) - 1.0).abs() < 3.0 * (2.0f64 / 192.0).sqrt()
        );
        assert!((s.pixel_variance / 4.0 - 1.0).abs() < 3.0 * (2.0f64 / 49152.0).sqrt() + 0.005);
        assert_eq!(s.high, 10.0);
        assert!((s.high_sum / 400.0 - 1.0).abs() < 0.1);
        assert!(s.columns.periods[0] > 5.0 && s.rows.periods[0] < 12.0);
        // A wave of one period over the frame is uneven light: rows, columns and pixels stay the
        // same.
        let mut waved = map;
        for (y, row) in waved.data.chunks_mut(w).enumerate() {
            let wave = 3.0 * (y as f64 / h as f64 * std::f64::consts::TAU).sin() as f32;
            row.iter_mut().for_each(|v| *v += wave);
        }
        let smooth = describe(&waved, &channels_of(w), false);
        assert!(
            (smooth.rows.variance / s.rows.variance - 1.0).abs() < 0.3,
            "{}",
            smooth.rows.variance
        );
        assert!((smooth.pixel_variance / s.pixel_variance - 1.0).abs() < 1e-3);
        assert!(smooth.columns.periods[0] > 5.0);
        assert!(describe(&waved, &channels_of(w), true).rows.variance > 3.0 * s.rows.variance);
    }
}
