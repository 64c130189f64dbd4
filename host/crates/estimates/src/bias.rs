//! Black level, read noise, noise of rows and frames, and offset patterns: the dark stack with the
//! shortest exposure, in which no charge is left to speak of.

use super::robust::{Sorted, clip, clipped_mean, mad_sd, mean, trigamma, variance};
use super::rows::RowSpectrum;
use super::{Sites, Stack};
use camrig_base::Value;
use camrig_base::tails::{chi_square, median_of_squares};

/// Variance that rounding to whole DN adds, DN².
pub(crate) const ROUNDING: f64 = 1.0 / 12.0;
/// Deviation from the median variance from which a pixel counts as noisy.
const NOISY: f64 = 6.0;
/// Robust standard deviations at which samples are clipped before sums over sites and rows, and
/// for the variance of ordinary pixels.
const CLIP_WIDE: f64 = 8.0;
const CLIP: f64 = 4.0;

/// What the bias stack shows. Variances are DN².
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Bias {
    /// Black level of each site, DN: the mean over pixels, clipped.
    pub black_by_site: Vec<Value>,
    /// Variance over frames of the offset of a site from its frame; none of a monochrome sensor.
    pub frame_site_variance: Option<Value>,
    /// Offsets of the sites in each frame, DN.
    pub frame_site_offsets: Vec<Vec<f64>>,
    /// Variance of row offsets that all columns share.
    pub row_variance: Value,
    /// Variance of row offsets of opposite sign in even and odd columns.
    pub opposite_row_variance: Value,
    /// Standard error of both row variances where there are none.
    pub row_variance_null: f64,
    /// Power of the row means, DN².
    pub row_spectrum: RowSpectrum,
    /// Variance of column offsets that change from frame to frame.
    pub column_variance: Value,
    /// Variance of frame offsets.
    pub frame_variance: Value,
    /// Drift of the level, DN per frame.
    pub drift: Value,
    /// Temporal variance of the median pixel, without that of rounding.
    pub read_noise_variance: Value,
    /// The same for each site.
    pub read_noise_variance_by_site: Vec<Value>,
    /// Mean of the pixels' temporal variances, noisy pixels included, without that of rounding.
    pub mean_variance: Value,
    /// Standard deviation over pixels of the logarithm of the read noise: from the lower half, so
    /// that noisy pixels do not count.
    pub read_noise_spread: Value,
    /// Share of pixels whose variance departs by six deviations from the median's.
    pub noisy_share: Value,
    /// Variance of the offset pattern: of single pixels, of columns, of rows.
    pub pattern: Pattern,
    pub(crate) map: Vec<f64>,
    pub(crate) pixel_variance: Vec<f64>,
    pub(crate) median_variance: f64,
    pub(crate) clipped_variance: f64,
    pub(crate) frames: usize,
}

/// Parts of a fixed pattern: variances in DN².
#[derive(Clone, Copy, Debug)]
pub struct Pattern {
    /// Of single pixels.
    pub pixels: Value,
    /// Of whole columns.
    pub columns: Value,
    /// Of whole rows.
    pub rows: Value,
    /// Standard errors of the variances of columns and of rows where there are none: by what the
    /// means of even and odd frames differ.
    pub line_nulls: [f64; 2],
    /// Straight slopes, from the first to the last column and row, DN; not in the variances.
    pub slopes: [Value; 2],
}

/// The temporal part of a stack, split into offsets of frames and sites, of rows, and what is left
/// of the pixels.
struct Temporal {
    width: usize,
    height: usize,
    frames: usize,
    /// Rows that share the sites whose mean was taken off each frame.
    rows_of_site: usize,
    /// By frame and site.
    site_offsets: Vec<Vec<f64>>,
    /// By parity of the column, then by frame and row.
    rows: [Vec<Vec<f64>>; 2],
    /// What is left, by frame.
    rest: Vec<Vec<f64>>,
    /// Mean square before sites and rows were removed.
    mean_square: f64,
}

impl Temporal {
    fn of(stack: &Stack, map: &[f64], sites: Sites) -> Self {
        let (width, height) = stack.size();
        let frames = stack.frames.len();
        let mut all = Vec::with_capacity(frames * map.len());
        for i in 0..frames {
            let from = all.len();
            all.extend(stack.values(i).iter().zip(map).map(|(v, m)| v - m));
            let offset = mean(&all[from..]).value;
            all[from..].iter_mut().for_each(|v| *v -= offset);
        }
        let mean_square = all.iter().map(|v| v * v).sum::<f64>() / all.len() as f64;
        clip(&mut all, CLIP_WIDE);
        let mut rest: Vec<Vec<f64>> = all.chunks(map.len()).map(<[f64]>::to_vec).collect();
        let mut site_offsets = Vec::new();
        let mut rows = [Vec::new(), Vec::new()];
        for frame in &mut rest {
            let of_site = |values| clipped_mean(values, CLIP).value;
            let offsets: Vec<f64> = sites.split(frame, width).into_iter().map(of_site).collect();
            let mut of_rows = [Vec::with_capacity(height), Vec::with_capacity(height)];
            for (y, row) in frame.chunks_mut(width).enumerate() {
                row.iter_mut().enumerate().for_each(|(x, v)| *v -= offsets[sites.of(x, y)]);
                for (parity, means) in of_rows.iter_mut().enumerate() {
                    let columns = row.iter().skip(parity).step_by(2);
                    let offset = columns.clone().sum::<f64>() / columns.len() as f64;
                    row.iter_mut().skip(parity).step_by(2).for_each(|v| *v -= offset);
                    means.push(offset);
                }
            }
            site_offsets.push(offsets);
            rows.iter_mut().zip(of_rows).for_each(|(all, own)| all.push(own));
        }
        let rows_of_site = height / sites.down;
        Self { width, height, frames, rows_of_site, site_offsets, rows, rest, mean_square }
    }

    /// Frames over degrees of freedom: the mean over frames was removed.
    fn over_dof(&self) -> f64 {
        self.frames as f64 / (self.frames as f64 - 1.0)
    }

    /// Temporal variance of each pixel; the row means have taken 2 / width of it.
    fn pixel_variance(&self) -> Vec<f64> {
        let mut sum = vec![0.0; self.width * self.height];
        for frame in &self.rest {
            sum.iter_mut().zip(frame).for_each(|(s, v)| *s += v * v);
        }
        let dof = (self.frames as f64 - 1.0) * (1.0 - 2.0 / self.width as f64);
        sum.iter_mut().for_each(|v| *v /= dof);
        sum
    }

    /// Variance of row offsets, alike and opposite in even and odd columns, from the mean square V
    /// of row means and the mean product C of both: (V + C) / 2 and (V − C) / 2.
    fn row_variances(&self, pixel_variance: f64) -> [Value; 2] {
        let from_pixels = pixel_variance / (0.5 * self.width as f64);
        // The offsets of the sites have taken the mean over their rows.
        let n = self.rows_of_site as f64;
        let scale = self.over_dof() / self.frames as f64 * n / (n - 1.0);
        let of = |sign: f64| {
            let of_row = |y: usize| {
                let sum: f64 = (0..self.frames)
                    .map(|i| {
                        let (a, b) = (self.rows[0][i][y], self.rows[1][i][y]);
                        0.5 * (a * a + b * b) + sign * a * b
                    })
                    .sum();
                0.5 * (scale * sum - from_pixels)
            };
            mean(&(0..self.height).map(of_row).collect::<Vec<_>>())
        };
        [of(1.0), of(-1.0)]
    }

    fn row_spectrum(&self, pixel_variance: f64, sites: Sites) -> RowSpectrum {
        let frames = self.rows[0].iter().zip(&self.rows[1]);
        let means = frames.map(|(a, b)| a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect());
        let white = pixel_variance / self.width as f64;
        RowSpectrum { white, ..RowSpectrum::of(means, sites.down) }
    }

    fn column_variance(&self, pixel_variance: f64) -> Value {
        let scale = self.over_dof() / self.frames as f64;
        let of_column = |x: usize| {
            let squares = self.rest.iter().map(|frame| {
                let column = frame.iter().skip(x).step_by(self.width);
                (column.sum::<f64>() / self.height as f64).powi(2)
            });
            scale * squares.sum::<f64>() - pixel_variance / self.height as f64
        };
        mean(&(0..self.width).map(of_column).collect::<Vec<_>>())
    }

    fn frame_site_variance(&self, sites: Sites) -> Option<Value> {
        let (n, count) = (self.frames as f64, sites.count() as f64);
        if sites.count() == 1 {
            return None;
        }
        let of_site = |site: usize| {
            let own: Vec<f64> = self
                .site_offsets
                .iter()
                .map(|frame| frame[site] - frame.iter().sum::<f64>() / count)
                .collect();
            variance(&own)
        };
        let total = (0..sites.count()).map(of_site).sum::<f64>() / (count - 1.0);
        let from_pixels = self.mean_square * count / (self.width * self.height) as f64;
        let dof = (count - 1.0) * (n - 1.0);
        Some(Value { value: total - from_pixels, std_error: total * (2.0 / dof).sqrt() })
    }
}

impl Bias {
    /// How many frames the stack has.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Temporal variance of a pixel whose noise stands out over that of the median one; 1 of others.
    pub(crate) fn noise_over_ordinary(&self, pixel: usize) -> f64 {
        let ratio = self.pixel_variance[pixel] / self.median_variance;
        if chi_square(ratio, self.frames as f64 - 1.0) > NOISY { ratio } else { 1.0 }
    }

    /// Of a dark stack of two frames or more.
    pub fn of(stack: &Stack, sites: Sites) -> Self {
        let (width, height) = stack.size();
        let frames = stack.frames.len();
        let n = frames as f64;
        let pixels = (width * height) as f64;
        let (map, _) = stack.mean_map(|_, _| true);
        let temporal = Temporal::of(stack, &map, sites);
        let pixel_variance = temporal.pixel_variance();
        let all_pixels = mean(&pixel_variance);
        let mut ordinary = temporal.rest.concat();
        clip(&mut ordinary, CLIP);
        let clipped_variance = ordinary.iter().map(|v| v * v).sum::<f64>() / ordinary.len() as f64
            * temporal.over_dof()
            / (1.0 - 2.0 / width as f64);
        let [row_variance, opposite_row_variance] = temporal.row_variances(all_pixels.value);
        let row_variance_null =
            all_pixels.value / (0.5 * width as f64) * (0.5 / (height as f64 * (n - 1.0))).sqrt();
        let frame_levels: Vec<f64> = (0..frames).map(|i| mean(&stack.values(i)).value).collect();
        let spread = variance(&frame_levels);
        let frame_variance = Value {
            value: spread
                - all_pixels.value / pixels
                - row_variance.value.max(0.0) / height as f64,
            std_error: spread * (2.0 / (n - 1.0)).sqrt(),
        };
        let variance_sorted = Sorted::new(pixel_variance.iter().copied());
        let of_median = |sorted: &Sorted| {
            let Value { value, std_error } = sorted.estimate(0.5);
            let median = median_of_squares(n - 1.0);
            Value { value: value / median - ROUNDING, std_error: std_error / median }
        };
        let read_noise_variance = of_median(&variance_sorted);
        let median_variance = read_noise_variance.value + ROUNDING;
        let by_site = sites.split(&pixel_variance, width);
        let noisy = pixel_variance
            .iter()
            .filter(|v| chi_square(**v / median_variance, n - 1.0) > NOISY)
            .count() as f64;
        let pattern = pattern(halves(stack, |_, _| true), width, sites);
        // A sensor's own rows and columns move its level, too.
        let by_lines = pattern.rows.value.max(0.0) / height as f64
            + pattern.columns.value.max(0.0) / width as f64;
        let levels = levels_by_site(stack, sites).into_iter();
        let level = |v: Value| Value::new(v.value, libm::hypot(v.std_error, by_lines.sqrt()));
        Self {
            black_by_site: levels.map(level).collect(),
            frame_site_variance: temporal.frame_site_variance(sites),
            row_variance,
            opposite_row_variance,
            row_variance_null,
            row_spectrum: temporal.row_spectrum(all_pixels.value, sites),
            column_variance: temporal.column_variance(clipped_variance),
            frame_variance,
            drift: slope(&frame_levels),
            read_noise_variance,
            read_noise_variance_by_site: by_site
                .into_iter()
                .map(|v| of_median(&Sorted::new(v)))
                .collect(),
            mean_variance: Value { value: all_pixels.value - ROUNDING, ..all_pixels },
            read_noise_spread: spread_of_noise(&pixel_variance, n - 1.0),
            noisy_share: Value { value: noisy / pixels, std_error: (noisy + 1.0).sqrt() / pixels },
            pattern,
            frame_site_offsets: temporal.site_offsets,
            map,
            pixel_variance,
            median_variance,
            clipped_variance,
            frames,
        }
    }
}

/// The level of each site of a stack, DN: the clipped mean over its pixels, with an error from the
/// pixels and from the frames.
pub fn levels_by_site(stack: &Stack, sites: Sites) -> Vec<Value> {
    let width = stack.size().0;
    let (map, _) = stack.mean_map(|_, _| true);
    let of_frame = |i: usize| -> Vec<f64> {
        let split = sites.split(&stack.values(i), width);
        split.iter().map(|v| mean(v).value).collect()
    };
    let frames: Vec<Vec<f64>> = (0..stack.frames.len()).map(of_frame).collect();
    let of_site = |(site, values)| {
        let pixels = clipped_mean(values, CLIP);
        let over_frames = mean(&frames.iter().map(|f: &Vec<f64>| f[site]).collect::<Vec<_>>());
        Value {
            value: pixels.value,
            std_error: libm::hypot(pixels.std_error, over_frames.std_error),
        }
    };
    sites.split(&map, width).into_iter().enumerate().map(of_site).collect()
}

/// Slope over the index, its error from the scatter about the line.
fn slope(levels: &[f64]) -> Value {
    let n = levels.len() as f64;
    let middle = 0.5 * (n - 1.0);
    let centre = mean(levels).value;
    let squares = n * (n * n - 1.0) / 12.0;
    let at = |i: usize| i as f64 - middle;
    let value =
        levels.iter().enumerate().map(|(i, v)| at(i) * (v - centre)).sum::<f64>() / squares;
    let rest = levels.iter().enumerate().map(|(i, v)| (v - centre - value * at(i)).powi(2));
    let std_error = (rest.sum::<f64>() / (n - 2.0).max(1.0) / squares).sqrt();
    Value { value, std_error }
}

/// Standard deviation over pixels of ln σ: half that of the logarithm of their variances, less
/// what a sample of `dof` degrees of freedom scatters by.
fn spread_of_noise(variances: &[f64], dof: f64) -> Value {
    /// Least variance whose logarithm is taken, DN².
    const LEAST: f64 = 1e-3;
    let width = Sorted::new(variances.iter().map(|v| libm::log(v.max(LEAST)))).lower_sd();
    let own = (width.value.powi(2) - trigamma(0.5 * dof)).max(0.0);
    // The root of a square that is one error larger: finite where there is no spread.
    let above = own + 2.0 * width.value * width.std_error;
    Value::new(0.5 * own.sqrt(), 0.5 * (above.sqrt() - own.sqrt()))
}

/// Variance over pixels of the offset at exposure 0, DN²: on the line through the means of a short
/// and a long dark stack, so that charge in proportion to the exposure is not in it, whatever its
/// law over pixels. Frames and rows of the long stack count where they are `held`; none where a row
/// has no two of them.
pub(crate) fn offsets_at_0(
    short: &Stack,
    long: &Stack,
    held: impl Fn(usize, usize) -> bool,
    sites: Sites,
) -> Option<Value> {
    let over = short.exposure_s / (long.exposure_s - short.exposure_s);
    let mut at_0 = halves(short, |_, _| true);
    for (short, long) in at_0.iter_mut().zip(halves(long, held)) {
        short.iter_mut().zip(long).for_each(|(s, l)| *s -= over * (l - *s));
    }
    let known = at_0.iter().flatten().all(|v| v.is_finite());
    known.then(|| pattern(at_0, short.size().0, sites).pixels)
}

/// The means of even and of odd frames, of those and their rows that are `held`.
fn halves(stack: &Stack, held: impl Fn(usize, usize) -> bool) -> [Vec<f64>; 2] {
    [0, 1].map(|parity| stack.mean_map(|i, y| i % 2 == parity && held(i, y)).0)
}

/// The fixed pattern by the products of the means of even and odd frames, in which noise does not
/// count.
fn pattern(mut halves: [Vec<f64>; 2], width: usize, sites: Sites) -> Pattern {
    /// Least width at which the maps are clipped, DN.
    const LEAST_WIDTH: f64 = 0.2;
    let height = halves[0].len() / width;
    for map in &mut halves {
        let levels: Vec<f64> = sites
            .split(map, width)
            .into_iter()
            .map(|site| clipped_mean(site, CLIP).value)
            .collect();
        for (y, row) in map.chunks_mut(width).enumerate() {
            row.iter_mut().enumerate().for_each(|(x, v)| *v -= levels[sites.of(x, y)]);
        }
    }
    let reach = 5.0 * mad_sd(&halves[0]).max(LEAST_WIDTH);
    halves.iter_mut().flatten().for_each(|v| *v = v.clamp(-reach, reach));
    let products = |halves: &[Vec<f64>; 2]| -> Vec<f64> {
        halves[0].iter().zip(&halves[1]).map(|(a, b)| a * b).collect()
    };
    let slopes = remove_slopes(&mut halves, width);
    let all = mean(&products(&halves)).value;
    let row_means = |map: &[f64]| row_means(map, width);
    let column_means = |map: &[f64]| column_means(map, width);
    let lines = |means: [Vec<f64>; 2], length: usize| {
        let product = mean(&products(&means));
        Value { value: product.value - all / length as f64, ..product }
    };
    let of_rows = halves.each_ref().map(|half| row_means(half));
    let of_columns = halves.each_ref().map(|half| column_means(half));
    let line_nulls = [&of_columns, &of_rows].map(|[a, b]| {
        let rest: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
        0.5 * variance(&rest) / (rest.len() as f64).sqrt()
    });
    let (rows, columns) = (lines(of_rows, width), lines(of_columns, height));
    for map in &mut halves {
        let of_rows = row_means(map);
        map.chunks_mut(width)
            .zip(of_rows)
            .for_each(|(row, m)| row.iter_mut().for_each(|v| *v -= m));
        let of_columns = column_means(map);
        map.chunks_mut(width)
            .for_each(|row| row.iter_mut().zip(&of_columns).for_each(|(v, m)| *v -= m));
    }
    Pattern { pixels: mean(&products(&halves)), columns, rows, line_nulls, slopes }
}

fn row_means(map: &[f64], width: usize) -> Vec<f64> {
    map.chunks(width).map(|row| row.iter().sum::<f64>() / width as f64).collect()
}

fn column_means(map: &[f64], width: usize) -> Vec<f64> {
    let height = (map.len() / width) as f64;
    (0..width).map(|x| map.iter().skip(x).step_by(width).sum::<f64>() / height).collect()
}

/// Takes straight slopes across and down off both halves: what is smooth is no pattern of lines.
/// Returns them from the first to the last line, with errors from the scatter of the lines.
fn remove_slopes(halves: &mut [Vec<f64>; 2], width: usize) -> [Value; 2] {
    [true, false].map(|across| {
        let [a, b] = halves.each_mut().map(|map| {
            let lines = if across { column_means(map, width) } else { row_means(map, width) };
            let (by, middle) = (slope(&lines), (lines.len() as f64 - 1.0) / 2.0);
            for (i, v) in map.iter_mut().enumerate() {
                let line = if across { i % width } else { i / width };
                *v -= by.value * (line as f64 - middle);
            }
            by.scaled(lines.len() as f64 - 1.0)
        });
        Value { value: 0.5 * (a.value + b.value), std_error: a.std_error.max(b.std_error) }
    })
}
