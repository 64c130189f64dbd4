//! Dark current and its pattern, hot pixels, offsets from frame to frame: the dark stacks over
//! exposure.

use super::bias::Bias;
use super::robust::{Sorted, clipped_mean, mean, median, variance};
use super::torn::{Torn, holds};
use super::{Sites, Stack};
use camrig_base::Value;
use camrig_base::tails::chi_square;

/// Widths of the core above the median from which a pixel is hot.
const HOT: f64 = 6.0;
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
    /// Of the mean over pixels, hot ones included.
    pub mean: Value,
    /// Of the mean over pixels, clipped.
    pub clipped_mean: Value,
    /// Of the median pixel at each site.
    pub median_by_site: Vec<Value>,
    /// Variance over pixels, from the lower half.
    pub pattern_variance: Value,
    /// Rate from which a pixel is hot.
    pub hot_threshold: f64,
    /// Share of hot pixels.
    pub hot_share: Value,
    /// Mean rate of hot pixels above the threshold; none of three or fewer.
    pub hot_excess: Option<Value>,
    /// Level of the lines at exposure 0, less the bias, DN.
    pub intercept_above_bias: Value,
    pub(crate) rates: Vec<f64>,
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
        let noise = |dark: &&Dark<'_>| {
            let charge = dark.map.iter().zip(&bias.map).map(|(m, b)| m - b);
            let known: Vec<f64> = charge.filter(|v| !v.is_nan()).collect();
            bias.clipped_variance + gain * clipped_mean(known, CLIP).value.max(0.0)
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
        let core = sorted.lower_sd();
        let hot_threshold = middle.value + HOT * core.value.max(own.sqrt());
        let hot: Vec<f64> = rates.iter().copied().filter(|r| *r > hot_threshold).collect();
        let pixels = rates.len() as f64;
        let count = hot.len() as f64;
        let excess: Vec<f64> = hot.iter().map(|r| r - hot_threshold).collect();
        let by_site = sites.split(&rates, width).into_iter();
        Some(Self {
            median: middle,
            mean: mean(&rates),
            clipped_mean: clipped_mean(rates.clone(), CLIP),
            median_by_site: by_site.map(|r| Sorted::new(r).estimate(0.5)).collect(),
            pattern_variance: Value {
                value: (core.value.powi(2) - own).max(0.0),
                std_error: 2.0 * core.value * core.std_error,
            },
            hot_threshold,
            hot_share: Value { value: count / pixels, std_error: count.max(1.0).sqrt() / pixels },
            hot_excess: (hot.len() > 3).then(|| mean(&excess)),
            intercept_above_bias: clipped_mean(intercepts, CLIP),
            rates,
        })
    }

    /// Quantile over pixels of the rate, DN/s.
    pub fn quantile(&self, p: f64) -> f64 {
        Sorted::new(self.rates.iter().copied()).quantile(p)
    }
}

/// Offsets from frame to frame, pooled over the dark stacks.
#[derive(Clone, Copy, Debug)]
pub struct FrameOffsets {
    /// Normal deviate of their variance over that of the pixels and rows alone.
    pub deviation: f64,
    /// Their standard deviation beyond that, DN.
    pub sd_dn: f64,
}

impl FrameOffsets {
    /// Of the frames that are not torn; none where no stack has two of them.
    pub(crate) fn of(darks: &[Dark<'_>], bias: &Bias, gain: f64) -> Option<Self> {
        let (width, height) = darks.first()?.stack.size();
        let (mut dof, mut ratio, mut beyond) = (0.0, 0.0, 0.0);
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
            let offsets = variance(&frames.iter().map(level).collect::<Vec<_>>());
            let charge = (median(map.iter().copied().filter(|v| !v.is_nan()).collect())
                - median(bias.map.clone()))
            .max(0.0);
            let pixels = bias.clipped_variance + gain * charge;
            let expected = pixels / (width * height) as f64
                + bias.row_variance.value.max(0.0) / height as f64;
            let own = frames.len() as f64 - 1.0;
            dof += own;
            ratio += own * offsets / expected;
            beyond += own * (offsets - expected);
        }
        (dof > 0.0).then(|| Self {
            deviation: chi_square(ratio / dof, dof),
            sd_dn: (beyond / dof).max(0.0).sqrt(),
        })
    }
}
