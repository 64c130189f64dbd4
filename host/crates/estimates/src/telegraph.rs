//! Pixels that blink: whose variance over frames is above what read noise and shot noise make.
//!
//! Telegraph noise of the read-out is the same at every exposure; that of the dark current grows
//! with it, its standard deviation as the exposure itself. So the pixels are chosen in one stack
//! and their excess variance v is measured in the others, where chance has not chosen it, and
//! v ∝ t²ᵖ is fitted over the exposure t: p = 0 of the read-out, p = 1 of the dark current.

use super::bias::Bias;
use super::dark::Dark;
use super::robust::{Sorted, clipped_mean, jackknife, mean, median};
use camrig_base::Value;
use camrig_base::tails::chi_square;
use rayon::prelude::*;

/// Deviation of its variance from which a pixel is chosen.
const CHOSEN: f64 = 5.0;
/// Part of the longest exposure from which a stack counts as long.
const LONG: f64 = 0.3;
/// Pixels without which no law is fitted.
const MIN_PIXELS: usize = 3;

/// What the dark stacks show.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Telegraph {
    /// Share of pixels that stand out in each dark stack, by exposure in s.
    pub share_by_stack: Vec<(f64, f64)>,
    /// Share of pixels that stand out in two of the long stacks; none without an exposed one.
    pub share: Option<Value>,
    /// Of the pixels chosen in the longest stack.
    pub chosen_in_longest: Option<Law>,
    /// Of the pixels chosen in the bias.
    pub chosen_in_bias: Option<Law>,
    /// Height of the jumps of those chosen in the longest stack, DN/s: of the median pixel.
    pub median_jump: Option<Value>,
}

/// How the excess variance of chosen pixels depends on the exposure.
#[derive(Clone, Debug)]
pub struct Law {
    /// How many were chosen.
    pub pixels: usize,
    /// Exposure in s and mean excess variance in DN², in the stacks in which they were not chosen.
    pub excess: Vec<(f64, Value)>,
    /// p of v ∝ t²ᵖ; none where fewer than two exposed stacks show an excess.
    pub exponent: Option<Value>,
}

/// A stack's variances.
struct Variances {
    exposure_s: f64,
    /// DN² above shot noise and the pixel's own variance in the bias, and above shot noise and the
    /// median pixel's; NaN of pixels with fewer than two frames.
    over_own: Vec<f64>,
    over_median: Vec<f64>,
    deviations: Vec<f64>,
}

impl Telegraph {
    /// Of dark stacks sorted by exposure, the first of which is the bias.
    pub(crate) fn of(darks: &[Dark<'_>], bias: &Bias, gain: f64) -> Self {
        let stacks: Vec<Variances> =
            darks.par_iter().map(|d| Variances::of(d, bias, gain)).collect();
        let pixels = bias.map.len() as f64;
        let longest = stacks.last().map_or(0.0, |s| s.exposure_s);
        let is_long = |s: &&Variances| s.exposure_s > 0.0 && s.exposure_s >= LONG * longest;
        let long: Vec<&Variances> = stacks.iter().filter(is_long).collect();
        let share_of =
            |s: &Variances| s.deviations.iter().filter(|z| **z > CHOSEN).count() as f64 / pixels;
        let last = stacks.len() - 1;
        let chosen_in = |k: usize| stacks[k].chosen();
        let share = (!long.is_empty()).then(|| {
            let in_long = |p: usize| long.iter().filter(|s| s.deviations[p] > CHOSEN).count();
            let count =
                (0..bias.map.len()).filter(|p| in_long(*p) >= 2.min(long.len())).count() as f64;
            Value { value: count / pixels, std_error: count.max(1.0).sqrt() / pixels }
        });
        let median_jump = (longest > 0.0 && !chosen_in(last).is_empty()).then(|| {
            // Two levels, each half of the time, differ by twice the standard deviation.
            let jump = |p: usize| 2.0 * stacks[last].over_own[p].max(0.0).sqrt() / longest;
            Sorted::new(chosen_in(last).into_iter().map(jump)).estimate(0.5)
        });
        Self {
            share_by_stack: stacks.iter().map(|s| (s.exposure_s, share_of(s))).collect(),
            share,
            chosen_in_longest: (longest > 0.0)
                .then(|| Law::of(&stacks, last, |s| &s.over_own))
                .flatten(),
            chosen_in_bias: Law::of(&stacks, 0, |s| &s.over_median),
            median_jump,
        }
    }
}

impl Variances {
    fn of(dark: &Dark<'_>, bias: &Bias, gain: f64) -> Self {
        let Dark { stack, map, counts, .. } = dark;
        let (width, height) = stack.size();
        let takes = dark.holds();
        let charge: Vec<f64> = map.iter().zip(&bias.map).map(|(m, b)| (m - b).max(0.0)).collect();
        let is_exposed = stack.exposure_s > 0.0;
        let bright = Sorted::new(charge.iter().copied()).quantile(0.97);
        let mut squares = vec![0.0; map.len()];
        for i in 0..stack.frames.len() {
            let rows: Vec<usize> = (0..height).filter(|y| takes(i, *y)).collect();
            if rows.is_empty() {
                continue;
            }
            let values = stack.values(i);
            let pixels = || rows.iter().flat_map(|y| y * width..(y + 1) * width);
            let rest = |p: usize| values[p] - map[p];
            let offset = clipped_mean(pixels().map(rest).collect(), 4.0).value;
            let scale = if is_exposed && stack.frames.len() > 2 {
                exposure_error(pixels(), &charge, bright, |p| rest(p) - offset)
            } else {
                0.0
            };
            pixels().for_each(|p| squares[p] += (rest(p) - offset - scale * charge[p]).powi(2));
        }
        let own = bias.frames as f64;
        let expected = |p: usize| {
            if !is_exposed {
                return bias.median_variance;
            }
            // The pixel's own variance in the bias, drawn towards that of the median.
            const PRIOR: f64 = 6.0;
            let shrunk = (bias.pixel_variance[p] * (own - 1.0) + PRIOR * bias.median_variance)
                / (own - 1.0 + PRIOR)
                + bias.row_variance.value;
            shrunk.max(0.3 * bias.median_variance) + gain * charge[p]
        };
        let dof = |p: usize| counts[p / width] as f64 - 1.0;
        let (mut over_own, mut over_median, mut deviations) = (Vec::new(), Vec::new(), Vec::new());
        for p in 0..map.len() {
            if dof(p) < 1.0 {
                over_own.push(f64::NAN);
                over_median.push(f64::NAN);
                deviations.push(0.0);
                continue;
            }
            let variance = squares[p] / dof(p);
            over_own.push(variance - expected(p));
            over_median.push(variance - bias.median_variance - gain * charge[p]);
            deviations.push(chi_square(variance / expected(p), dof(p)));
        }
        Self { exposure_s: stack.exposure_s, over_own, over_median, deviations }
    }

    fn chosen(&self) -> Vec<usize> {
        (0..self.deviations.len()).filter(|p| self.deviations[*p] > CHOSEN).collect()
    }
}

/// By what part the exposure of a frame differs from the stack's, seen in the pixels with the most
/// charge; 0 where too few have enough.
fn exposure_error(
    pixels: impl Iterator<Item = usize>,
    charge: &[f64],
    bright: f64,
    rest: impl Fn(usize) -> f64,
) -> f64 {
    /// Pixels, and DN of charge in each, without which the exposure is not seen.
    const MIN_BRIGHT: usize = 31;
    const MIN_CHARGE_DN: f64 = 5.0;
    let used = pixels.filter(|p| charge[*p] > bright.max(MIN_CHARGE_DN));
    let ratios: Vec<f64> = used.map(|p| rest(p) / charge[p]).collect();
    if ratios.len() < MIN_BRIGHT { 0.0 } else { median(ratios) }
}

impl Law {
    /// Of the pixels that stand out in stack `from`, by their `excess` in the other stacks.
    fn of(
        stacks: &[Variances],
        from: usize,
        excess: impl Fn(&Variances) -> &[f64],
    ) -> Option<Self> {
        /// Groups of pixels that are left out in turn for the errors.
        const GROUPS: usize = 20;
        let chosen = stacks[from].chosen();
        if chosen.len() < MIN_PIXELS {
            return None;
        }
        let others: Vec<&Variances> =
            stacks.iter().enumerate().filter(|(k, _)| *k != from).map(|(_, s)| s).collect();
        let groups = GROUPS.min(chosen.len());
        let without = |group: usize| -> Vec<usize> {
            let kept = chosen.iter().enumerate().filter(|(i, _)| i % groups != group);
            kept.map(|(_, p)| *p).collect()
        };
        let means = |chosen: &[usize]| -> Vec<f64> {
            others.iter().map(|s| trimmed_mean(chosen.iter().map(|p| excess(s)[*p]))).collect()
        };
        let all = means(&chosen);
        let left_out: Vec<Vec<f64>> = (0..groups).map(|g| means(&without(g))).collect();
        let errors: Vec<f64> =
            (0..others.len()).map(|k| jackknife(groups, |g| left_out[g][k])).collect();
        let exposures: Vec<f64> = others.iter().map(|s| s.exposure_s).collect();
        let exponent = exponent(&exposures, &all, &errors).map(|value| {
            let without = |g: usize| exponent_or(value, &exposures, &left_out[g], &errors);
            Value { value, std_error: jackknife(groups, without) }
        });
        let excess = exposures.iter().zip(all.iter().zip(&errors));
        Some(Self {
            pixels: chosen.len(),
            excess: excess
                .map(|(t, (value, error))| (*t, Value { value: *value, std_error: *error }))
                .collect(),
            exponent,
        })
    }
}

fn exponent_or(other: f64, exposures: &[f64], excess: &[f64], errors: &[f64]) -> f64 {
    exponent(exposures, excess, errors).unwrap_or(other)
}

/// Half the slope of ln v over ln t, weighted by the relative errors, of which none counts as below
/// a fifth.
fn exponent(exposures: &[f64], excess: &[f64], errors: &[f64]) -> Option<f64> {
    let points: Vec<(f64, f64, f64)> = exposures
        .iter()
        .zip(excess.iter().zip(errors))
        .filter(|(t, (v, _))| **t > 0.0 && **v > 0.0)
        .map(|(t, (v, e))| (libm::log(*t), libm::log(*v), (v / e.max(1e-9)).min(5.0).powi(2)))
        .collect();
    if points.len() < 2 {
        return None;
    }
    let weight: f64 = points.iter().map(|p| p.2).sum();
    let centre =
        |of: fn(&(f64, f64, f64)) -> f64| points.iter().map(|p| p.2 * of(p)).sum::<f64>() / weight;
    let (t0, v0) = (centre(|p| p.0), centre(|p| p.1));
    let (num, den) = points.iter().fold((0.0, 0.0), |(num, den), (t, v, w)| {
        (num + w * (t - t0) * (v - v0), den + w * (t - t0).powi(2))
    });
    (den > 0.0).then(|| 0.5 * num / den)
}

/// Mean without the lowest and the highest twentieth.
fn trimmed_mean(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.filter(|v| !v.is_nan()).collect();
    values.sort_unstable_by(f64::total_cmp);
    let cut = values.len() / 20;
    mean(&values[cut..values.len() - cut]).value
}
