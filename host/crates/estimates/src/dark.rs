//! Dark current and its pattern, hot pixels, offsets from frame to frame: the dark stacks over
//! exposure.

use super::areas::{Area, far, find, running_median};
use super::bias::Bias;
use super::drift::{Drift, Levels, likeliest};
use super::robust::{Core, Sorted, clipped_mean, mean, median, variance};
use super::torn::{Torn, holds};
use super::{Sites, Stack};
use camrig_base::Value;
use camrig_base::tails::chi_square;

/// Longest over shortest exposure from which dark stacks tell dark current from offsets.
pub const MIN_SPAN: f64 = 1.5;
/// Widths of the core above the median from which a pixel is hot.
const HOT: f64 = 6.0;
/// Robust standard deviations of rows' medians from which a whole row is hot.
const HOT_ROW: f64 = 8.0;
/// Deviation of a drift from white offsets from which it has a memory.
const MIN_MEMORY: f64 = 3.0;
/// Robust standard deviations at which maps are clipped.
const CLIP: f64 = 3.0;

/// A dark stack with its mean map, in which torn rows do not count.
pub(crate) struct Dark<'a> {
    pub stack: &'a Stack,
    torn: &'a [Torn],
    /// NaN in rows of which no frame is left.
    pub map: Vec<f64>,
    /// Frames left of each row.
    pub counts: Vec<usize>,
}

impl<'a> Dark<'a> {
    pub(crate) fn read(stack: &'a Stack, torn: &'a [Torn]) -> Self {
        let (map, counts) = stack.mean_map(holds(torn, stack));
        Self { stack, torn, map, counts }
    }

    /// For which frames and rows the stated exposure holds.
    pub(crate) fn holds(&self) -> impl Fn(usize, usize) -> bool + Copy {
        holds(self.torn, self.stack)
    }
}

/// What the dark stacks show over exposure. Rates are DN/s.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct DarkCurrent {
    /// Of the median pixel.
    pub median: Value,
    /// Of the mean over the ordinary pixels; of the median pixel where they have a wide tail.
    pub ordinary: Value,
    /// Of the mean over pixels, hot ones included.
    pub mean: Value,
    /// Of the mean over pixels, clipped.
    pub clipped_mean: Value,
    /// Of the median pixel at each site.
    pub median_by_site: Vec<Value>,
    /// Variance over the ordinary pixels.
    pub pattern_variance: Value,
    /// The same about the median of each site.
    pub variance_within_sites: Value,
    /// Rate above that of its site, beside the median, from which a pixel is hot.
    pub hot_threshold: f64,
    /// Rows, parts of lines and clusters that are hot, with their rate above the median.
    pub hot_areas: Vec<Area>,
    /// Share of hot pixels outside these.
    pub hot_share: Value,
    /// Mean rate of hot pixels above the threshold; none of three or fewer.
    pub hot_excess: Option<Value>,
    /// Level of the lines at exposure 0, less the bias, DN.
    pub intercept_above_bias: Value,
    pub(crate) rates: Vec<f64>,
    /// Of each exposed stack: its exposure, its weight in the line, its frames.
    stacks: Vec<(f64, f64, usize)>,
}

impl DarkCurrent {
    /// A weighted line over exposure with a free intercept through the mean maps of each pixel;
    /// none of fewer than two exposed stacks.
    pub(crate) fn of(darks: &[Dark<'_>], bias: &Bias, sites: Sites, gain: f64) -> Option<Self> {
        let exposed: Vec<&Dark<'_>> = darks.iter().filter(|d| d.stack.exposure_s > 0.0).collect();
        if exposed.len() < 2 {
            return None;
        }
        let width = exposed[0].stack.size().0;
        // Offsets of rows and columns in a frame are noise of each of their pixels.
        let lines = bias.row_variance.value.max(0.0) + bias.column_variance.value.max(0.0);
        let noise = |dark: &&Dark<'_>| {
            let charge = dark.map.iter().zip(&bias.map).map(|(m, b)| m - b);
            let known: Vec<f64> = charge.filter(|v| !v.is_nan()).collect();
            let charge = clipped_mean(known, CLIP).value.max(0.0);
            bias.clipped_variance + lines + gain * charge
        };
        let noises: Vec<f64> = exposed.iter().map(noise).collect();
        let (mut rates, mut intercepts, mut variances) = (Vec::new(), Vec::new(), Vec::new());
        for p in 0..bias.map.len() {
            let points = exposed.iter().zip(&noises).filter(|(s, _)| !s.map[p].is_nan());
            let points = points.map(|(s, noise)| {
                (s.stack.exposure_s, s.map[p], s.counts[p / width] as f64 / noise)
            });
            let (w, wt, wm) = points
                .clone()
                .fold((0.0, 0.0, 0.0), |(w, wt, wm), (t, m, k)| (w + k, wt + k * t, wm + k * m));
            let (t0, m0) = (wt / w, wm / w);
            let (num, den) = points.fold((0.0, 0.0), |(num, den), (t, m, k)| {
                (num + k * (t - t0) * m, den + k * (t - t0) * (t - t0))
            });
            rates.push(num / den);
            intercepts.push(m0 - num / den * t0 - bias.map[p]);
            variances.push(1.0 / den);
        }
        let own = mean(&variances).value;
        let sorted = Sorted::new(rates.iter().copied());
        let middle = sorted.estimate(0.5);
        let of_sites = sites.split(&rates, width).into_iter();
        let median_by_site: Vec<Value> = of_sites.map(|r| Sorted::new(r).estimate(0.5)).collect();
        let excess = |p: usize| rates[p] - median_by_site[sites.of(p % width, p / width)].value;
        let mut above: Vec<f64> = (0..rates.len()).map(excess).collect();
        let stacks: Vec<(f64, f64, usize)> = exposed
            .iter()
            .zip(&noises)
            .map(|(d, noise)| {
                let frames = d.stack.frames.len();
                (d.stack.exposure_s, frames as f64 / noise, frames)
            })
            .collect();
        let step = step(&stacks);
        let Core { centre, sd: core } = Core::of(&sorted, step);
        let within = Core::of(&Sorted::new(above.iter().copied()), step).sd;
        let limit = HOT * core.value.max(own.sqrt());
        // Pixels that blink are where they are by chance, to within their own noise.
        for (p, above) in above.iter_mut().enumerate() {
            if *above < HOT * (variances[p] * bias.noise_over_ordinary(p)).sqrt() {
                *above = above.min(0.0);
            }
        }
        let hot_areas = hot_areas(&mut above, width, limit);
        let hot: Vec<f64> = above.iter().copied().filter(|r| *r > limit).collect();
        let pixels = rates.len() as f64;
        let count = hot.len() as f64;
        let excess: Vec<f64> = hot.iter().map(|r| r - limit).collect();
        let variance = |core: Value| Value {
            value: (core.value.powi(2) - own).max(0.0),
            std_error: 2.0 * core.value * core.std_error,
        };
        Some(Self {
            median: middle,
            ordinary: centre,
            mean: mean(&rates),
            clipped_mean: clipped_mean(rates.clone(), CLIP),
            median_by_site,
            pattern_variance: variance(core),
            variance_within_sites: variance(within),
            hot_threshold: middle.value + limit,
            hot_areas,
            hot_share: Value { value: count / pixels, std_error: count.max(1.0).sqrt() / pixels },
            hot_excess: (hot.len() > 3).then(|| mean(&excess)),
            intercept_above_bias: clipped_mean(intercepts, CLIP),
            rates,
            stacks,
        })
    }

    /// Standard errors of the rates in DN/s, and of the level at exposure 0 in DN, from levels that
    /// change by 1 DN from frame to frame with a correlation of one frame with the next; errors of
    /// the figures are those of the pixels alone.
    pub fn errors_of_levels(&self, correlation: f64) -> [f64; 2] {
        let Line { weight, centre, squares } = Line::through(&self.stacks);
        let mut errors = [0.0; 2];
        for (t, w, frames) in &self.stacks {
            let of_slope = w * (t - centre) / squares;
            let of_level = w / weight - centre * of_slope;
            let variance = variance_of_mean(*frames, correlation);
            errors[0] += of_slope * of_slope * variance;
            errors[1] += of_level * of_level * variance;
        }
        errors.map(f64::sqrt)
    }

    /// Quantile over pixels of the rate, DN/s.
    pub fn quantile(&self, p: f64) -> f64 {
        Sorted::new(self.rates.iter().copied()).quantile(p)
    }
}

/// What weights a line over exposure through stacks of an exposure, s, a weight and frames each.
struct Line {
    /// Sum of the weights.
    weight: f64,
    /// Weighted mean of the exposures, s.
    centre: f64,
    /// Weighted sum of their squared distances from it, s².
    squares: f64,
}

impl Line {
    fn through(stacks: &[(f64, f64, usize)]) -> Self {
        let sum = |of: &dyn Fn(f64) -> f64| stacks.iter().map(|(t, w, _)| w * of(*t)).sum::<f64>();
        let weight = sum(&|_| 1.0);
        let centre = sum(&|t| t) / weight;
        Self { weight, centre, squares: sum(&|t| (t - centre).powi(2)) }
    }
}

/// How far the slope of a line moves at most with one code in one frame, DN/s.
fn step(stacks: &[(f64, f64, usize)]) -> f64 {
    let Line { centre, squares, .. } = Line::through(stacks);
    let one = |(t, w, n): &(f64, f64, usize)| w * (t - centre).abs() / squares / *n as f64;
    stacks.iter().map(one).fold(0.0, f64::max)
}

/// Variance of the mean of so many levels of variance 1 that are correlated with the next.
pub fn variance_of_mean(frames: usize, correlation: f64) -> f64 {
    let n = frames as f64;
    let pairs = (1..frames).map(|k| (n - k as f64) * libm::pow(correlation, k as f64));
    (n + 2.0 * pairs.sum::<f64>()) / (n * n)
}

/// The hot areas of a map of rates above the median, whose pixels are 0 in it afterwards.
fn hot_areas(above: &mut [f64], width: usize, limit: f64) -> Vec<Area> {
    let rows: Vec<f64> = above.chunks(width).map(|row| median(row.to_vec())).collect();
    let departures: Vec<f64> =
        rows.iter().zip(running_median(&rows)).map(|(r, around)| r - around).collect();
    let row = |y: usize| {
        let own = &above[y * width..(y + 1) * width];
        Area { left: 0, top: y, width, height: 1, value: clipped_mean(own.to_vec(), CLIP) }
    };
    let hot = far(&departures, HOT_ROW, limit / HOT).into_iter().filter(|y| departures[*y] > 0.0);
    let mut areas: Vec<Area> = hot.map(row).collect();
    let leave_out = |areas: &[Area], above: &mut [f64]| {
        areas.iter().flat_map(|a| a.places(width)).for_each(|p| above[p] = 0.0);
    };
    leave_out(&areas, above);
    let clusters = find(above, width, |r| r > limit);
    leave_out(&clusters, above);
    areas.extend(clusters);
    areas
}

/// Offsets from frame to frame, pooled over the dark stacks.
#[derive(Clone, Copy, Debug)]
pub struct FrameOffsets {
    /// Normal deviate of their variance over that of the pixels and rows alone.
    pub deviation: f64,
    /// Their standard deviation beyond that, DN.
    pub sd: Value,
    /// How they wander, DN, where they have a memory from frame to frame.
    pub drift: Option<Drift>,
}

impl FrameOffsets {
    /// Of the frames that are not torn; none where no stack has two of them.
    pub(crate) fn of(darks: &[Dark<'_>], bias: &Bias, gain: f64) -> Option<Self> {
        let (width, height) = darks.first()?.stack.size();
        let (mut dof, mut ratio, mut squares, mut beyond) = (0.0, 0.0, 0.0, 0.0);
        let mut stacks = Vec::new();
        for Dark { stack, torn, map, .. } in darks {
            let whole = |i: &usize| !torn.iter().any(|t| t.stack == stack.id && t.frame == *i);
            let frames: Vec<usize> = (0..stack.frames.len()).filter(whole).collect();
            if frames.len() < 2 {
                continue;
            }
            let level = |i: &usize| {
                let rest = stack
                    .values(*i)
                    .iter()
                    .zip(map)
                    .map(|(v, m)| v - m)
                    .filter(|v| !v.is_nan())
                    .collect();
                clipped_mean(rest, 4.0).value
            };
            let levels: Vec<f64> = frames.iter().map(level).collect();
            let offsets = variance(&levels);
            let charge = (median(map.iter().copied().filter(|v| !v.is_nan()).collect())
                - median(bias.map.clone()))
            .max(0.0);
            let pixels = bias.clipped_variance + gain * charge;
            // Offsets of sites are not common to the frame, of which each is a part.
            let of_sites = bias.frame_site_variance.map_or(0.0, |v| v.value.max(0.0));
            let expected = pixels / (width * height) as f64
                + bias.row_variance.value.max(0.0) / height as f64
                + of_sites / bias.black_by_site.len() as f64;
            let own = frames.len() as f64 - 1.0;
            dof += own;
            ratio += own * offsets / expected;
            squares += own * offsets;
            beyond += own * (offsets - expected);
            stacks.push(Levels { means: levels, white: expected });
        }
        let drift = likeliest(&stacks).filter(|d| d.memory > MIN_MEMORY);
        (dof > 0.0).then(|| {
            // They scatter too: the error of a variance of so many degrees of freedom.
            let error = squares / dof * (2.0 / dof).sqrt();
            let none = Value::new(0.0, error.sqrt());
            let sd = Value::new(beyond / dof, error).sqrt().unwrap_or(none);
            Self { deviation: chi_square(ratio / dof, dof), sd: drift.map_or(sd, |d| d.sd), drift }
        })
    }
}
