//! Statistics of a stack's noise over time: its variance in each channel, its correlations in space
//! and time, spectral lines, and differences between pixels.

use super::collect::{Collected, cube_root_sd};
use super::quantiles::Codes;
use super::spatial::smooth_terms;
use super::statistic::{Scale, What};
use super::temporal::{BLOCK, LAGS, Temporal, mean};
use crate::data::channels::Channels;
use crate::data::design::Condition;
use crate::numerics::spectrum::Background;
use crate::numerics::tails;
use camrig_base::median::median;
use camrig_captures::Role;

/// Share of saturated samples from which a stack's noise is not measured, because it is clipped.
/// Half, because the effect of a smaller share is predicted by the model too.
const SATURATED_STACK: f64 = 0.5;
/// Pixel variance, DN², below which a stack has no noise: all samples have one code.
const MIN_VARIANCE_DN2: f64 = 1e-3;
/// Smallest share of samples for which the binomial standard deviation is computed: one of 10⁷.
const MIN_SHARE: f64 = 1e-7;
/// Standard deviation that is added to it: the effect of one defective pixel in a million.
const SHARE_SD: f64 = 1e-6;
/// Frames from which the trend and the correlation of frame means are measured: with fewer, their
/// distribution is far from normal.
const MIN_FRAMES_FOR_TREND: usize = 6;
/// Frames from which the noisiest pixels are described: with fewer, their selection by variance is
/// random.
const MIN_FRAMES_FOR_NOISIEST: usize = 8;
/// Standard deviations of the χ² distribution at which a pixel's variance is clipped in maps of the
/// noise, so that single noisy pixels do not count as regions.
const CLIP_VARIANCE_SD: f64 = 5.0;
/// Side of the blocks over which noise is mapped, pixels.
const REGION: usize = 16;
/// Number of lowest frequencies that count as slow; half of them are excluded from the search for
/// lines.
const SLOW_BINS: usize = 8;
/// Bins to either side of a bin whose median is its background.
const BACKGROUND_BINS: usize = 12;
/// The largest deviation is divided by this, because the background that it is relative to, the
/// median of 25 bins, itself scatters by a quarter of their spread: √(1 + 1/16) is 1.03, and the
/// largest of many is more affected.
const BACKGROUND_SCATTER: f64 = 1.05;
/// Normal quantile that one pixel in a million exceeds.
const ONE_IN_A_MILLION: f64 = 4.753;
/// One pixel in this many is among the noisiest.
const ONE_NOISIEST_IN: usize = 200;
/// Smallest number of noisiest pixels.
const MIN_NOISIEST: usize = 8;
/// Standard deviation of the noisiest pixels' correlation in time relative to that of independent
/// frames. Chosen: pixels of few levels have a wider distribution than normal noise.
const NOISIEST_LAG_SPREAD: f64 = 1.2;

/// Moments of a stack's noise, averaged over channels.
pub(super) struct Summary {
    /// Variance over time of each channel's pixels, DN².
    variance: Vec<f64>,
    mean_variance: f64,
    skewness: f64,
    /// Excess kurtosis.
    kurtosis: f64,
    /// Half the width, codes, of the central 68 % of the samples over pixels and time, insensitive
    /// to outliers.
    pub(super) width: f64,
}

impl Summary {
    pub(super) fn new(t: &Temporal, channels: &Channels) -> Self {
        let variance = channels.means(&t.pixel_variance);
        let (third, fourth) = (channels.means(&t.pixel_third), channels.means(&t.pixel_fourth));
        let k = channels.count() as f64;
        // Moments over n residuals from their own mean are (n − 1)/n of those from the true one.
        let n = t.dof.max(1.0);
        let shrink = n / (n + 1.0);
        let over = |m: &[f64], power: &dyn Fn(f64) -> f64| {
            m.iter().zip(&variance).map(|(m, v)| m / power(v.max(1e-9))).sum::<f64>() / k
        };
        // A product, because the last digit of a power function depends on the compiler.
        let kurtosis = over(&fourth, &|v| v * v) - 3.0 * shrink;
        let mean_variance = variance.iter().sum::<f64>() / k;
        Self {
            skewness: over(&third, &|v| libm::pow(v, 1.5)),
            kurtosis,
            width: half_width(&t.histogram),
            mean_variance,
            variance,
        }
    }
}

/// Half the distance, codes, between the quantiles of a histogram at ±1 standard deviation of a
/// normal distribution.
fn half_width(histogram: &[u32]) -> f64 {
    let codes = Codes::of(histogram);
    (codes.quantile(0.841_344_746) - codes.quantile(0.158_655_254)) / 2.0
}

/// Variance of the frames' means about their mean, DN².
#[must_use]
pub fn frame_variance(t: &Temporal) -> f64 {
    let m = t.frame_means.iter().sum::<f64>() / t.frames as f64;
    t.frame_means.iter().map(|f| (f - m).powi(2)).sum::<f64>() / (t.frames as f64 - 1.0)
}

/// The statistics of a stack's noise; without those of single pixels where the light, and with it
/// the noise, differs between channels.
pub(super) fn statistics(t: &Temporal, c: &Condition, s: &Summary, out: &mut Collected) {
    let (w, h) = (t.width as f64, t.height as f64);
    let (n, f) = (w * h, t.dof);
    let top = t.histogram.len() - 1;
    let saturated = f64::from(t.histogram[top]) / (n * t.frames as f64);
    let zeros = f64::from(t.histogram[0]) / (n * t.frames as f64);
    let fraction = |p: f64| (p.max(MIN_SHARE) * (1.0 - p.min(0.5)) / (n * f)).sqrt() + SHARE_SD;
    out.add(What::Zeros, zeros, fraction(zeros), Scale::Linear);
    out.add(What::Saturated, saturated, fraction(saturated), Scale::Linear);
    if saturated > SATURATED_STACK || s.mean_variance < MIN_VARIANCE_DN2 {
        return;
    }
    let k = s.variance.len() as f64;
    let excess = 1.0 + s.kurtosis.max(0.0) / 2.0;
    for (class, &v) in s.variance.iter().enumerate() {
        out.add(What::Variance(class as u8), v, (2.0 * k * excess / (f * n)).sqrt(), Scale::Log);
    }
    let v = s.mean_variance;
    of_frame_means(t, v, out);
    let names = [What::RowVariance, What::RowSlow, What::RowPeak];
    line_noise(&LineSpectrum { power: &t.row_power, across: w, names }, f, v, out);
    let row_variance = t.row_power.iter().sum::<f64>() / t.row_power.len() as f64;
    let lag = t.row_lag / row_variance.max(1e-12);
    out.add(What::RowLag, lag, 1.0 / (f * h).sqrt(), Scale::Linear);
    let names = [What::ColumnVariance, What::ColumnSlow, What::ColumnPeak];
    line_noise(&LineSpectrum { power: &t.column_power, across: h, names }, f, v, out);
    // The variance of products of pixels is the mean of v² for the same channel, less otherwise.
    let unequal = (s.variance.iter().map(|v| v * v).sum::<f64>() / k).sqrt() / v;
    for (i, c) in t.covariance.iter().enumerate().take(LAGS.len()) {
        out.add(What::Covariance(i as u8), c / v, unequal / (f * n).sqrt(), Scale::Linear);
    }
    out.add(
        What::BlockVariance,
        t.block_variance / v,
        (2.0 * (BLOCK * BLOCK) as f64 / (f * n)).sqrt(),
        Scale::Log,
    );
    if let Some(power) = &t.power {
        let (_, over) = Background::of(power, t.width).highest(power);
        let top = f64::from(over) * tails::median_of_squares(2.0 * f);
        let z = tails::largest(tails::chi_square(top, 2.0 * f), power.len());
        out.add(What::PlanePeak, z, 1.0, Scale::Linear);
    }
    out.add(What::Skewness, s.skewness, (6.0 / (f * n)).sqrt(), Scale::Linear);
    out.add(What::Kurtosis, s.kurtosis, (24.0 * excess * excess / (f * n)).sqrt(), Scale::Linear);
    if c.photo_e.len() == 1 || c.stack.role == Role::Dark {
        pixels(t, s, out);
    }
}

/// Variance, trend and correlation of the frames' means, where `v` is the pixel variance, DN².
fn of_frame_means(t: &Temporal, v: f64, out: &mut Collected) {
    let n = (t.width * t.height) as f64;
    let frames = t.frames as f64;
    let df = frames - 1.0;
    let ratio = frame_variance(t) * n / v;
    out.add(What::FrameVariance, ratio, cube_root_sd(ratio, df), Scale::CubeRoot);
    if t.frames >= MIN_FRAMES_FOR_TREND {
        // In standard deviations of the frame means themselves.
        let m = t.frame_means.iter().sum::<f64>() / frames;
        let sd = frame_variance(t).sqrt().max(1e-12);
        let d: Vec<f64> = t.frame_means.iter().map(|f| (f - m) / sd).collect();
        let middle = (frames - 1.0) / 2.0;
        let power: f64 = (0..t.frames).map(|i| (i as f64 - middle).powi(2)).sum();
        let slope: f64 = d.iter().enumerate().map(|(i, d)| d * (i as f64 - middle)).sum::<f64>();
        out.add(What::FrameTrend, slope / power.sqrt(), 1.0, Scale::Linear);
        let lag = d.windows(2).map(|p| p[0] * p[1]).sum::<f64>() / df;
        out.add(What::FrameLag, lag, 1.0 / df.sqrt(), Scale::Linear);
    }
}

/// The noise over the sensor: smooth terms and 16x16 blocks of the pixels' variance relative to its
/// mean `v`, DN², single noisy pixels clipped.
fn noise_over_the_sensor(t: &Temporal, v: f64, out: &mut Collected) {
    let (w, h) = (t.width, t.height);
    let limit = 1.0 + CLIP_VARIANCE_SD * (2.0 / t.dof).sqrt();
    let at = |i: usize| (f64::from(t.pixel_variance[i]) / v).min(limit);
    let n = (w * h) as f64;
    let middle = (0..w * h).map(at).sum::<f64>() / n;
    let scatter = (0..w * h).map(|i| (at(i) - middle).powi(2)).sum::<f64>() / n;
    let (across, down) = (w / REGION, h / REGION);
    let (side, area) = (REGION as f64, (REGION * REGION) as f64);
    let (mut slopes, mut blocks) = ([0.0; 5], Vec::with_capacity(across * down));
    for by in 0..down {
        for bx in 0..across {
            let mut sum = 0.0;
            for y in by * REGION..(by + 1) * REGION {
                sum += (y * w + bx * REGION..y * w + (bx + 1) * REGION).map(at).sum::<f64>();
            }
            let block = sum / area - middle;
            let u = (bx as f64 * side + side / 2.0) / w as f64 * 2.0 - 1.0;
            let v = (by as f64 * side + side / 2.0) / h as f64 * 2.0 - 1.0;
            for (s, b) in slopes.iter_mut().zip(smooth_terms(u, v)) {
                *s += block * b;
            }
            blocks.push(block);
        }
    }
    let count = blocks.len() as f64;
    let sd = (scatter / (area * count)).sqrt();
    for (i, s) in slopes.iter().enumerate() {
        out.add(What::NoiseSlope(i as u8), s / count, sd, Scale::Linear);
    }
    let ratio = blocks.iter().map(|b| b * b).sum::<f64>() / count * area / scatter;
    out.add(What::NoiseBlocks, ratio, cube_root_sd(ratio, count), Scale::CubeRoot);
}

/// The power spectrum of the means of rows or columns of a stack.
struct LineSpectrum<'a> {
    /// Power, DN².
    power: &'a [f64],
    /// Number of pixels averaged in a line.
    across: f64,
    /// Statistics for the whole power, its slow part and its highest line.
    names: [What; 3],
}

/// White part, slow part and highest line of row or column means of a stack of `dof` degrees of
/// freedom and this pixel variance, DN².
fn line_noise(of: &LineSpectrum<'_>, dof: f64, pixel_variance: f64, out: &mut Collected) {
    let &LineSpectrum { power, across, names: [all, slow, peak] } = of;
    let bins = power.len() as f64;
    let mean = power.iter().sum::<f64>() / bins;
    out.add(all, mean * across / pixel_variance, (1.0 / (dof * bins)).sqrt(), Scale::Log);
    let few = power.len().min(SLOW_BINS);
    let low = power[..few].iter().sum::<f64>() / few as f64;
    let (ratio, samples) = (low / mean.max(1e-12), 2.0 * dof * few as f64);
    out.add(slow, ratio, cube_root_sd(ratio, samples), Scale::CubeRoot);
    // Relative to the bins around, so that a continuum is not a line.
    let mut top = f64::MIN;
    for (i, &p) in power.iter().enumerate().skip(SLOW_BINS / 2) {
        let (from, to) =
            (i.saturating_sub(BACKGROUND_BINS).max(1), (i + BACKGROUND_BINS + 1).min(power.len()));
        let middle = median(&mut power[from..to].to_vec(), f64::total_cmp);
        let white = middle / tails::median_of_squares(2.0 * dof);
        top = top.max(tails::chi_square(p / white.max(1e-12), 2.0 * dof));
    }
    let z = tails::largest(top / BACKGROUND_SCATTER, power.len());
    out.add(peak, z, 1.0, Scale::Linear);
}

/// Differences between pixels in their noise.
fn pixels(t: &Temporal, s: &Summary, out: &mut Collected) {
    let (n, f) = (t.pixel_variance.len() as f64, t.dof);
    if f < 3.0 {
        return;
    }
    let v = s.mean_variance;
    let second =
        t.pixel_variance.iter().map(|&x| (f64::from(x) / v - 1.0).powi(2)).sum::<f64>() / n;
    // The variance of χ²/f is 2/f, its fourth central moment 12/f² (1 + 4/f).
    let scatter = ((8.0 + 48.0 / f) / (f * f) / n).sqrt();
    out.add(What::Spread, second * f / 2.0, scatter * f / 2.0, Scale::Linear);
    let limit = v * tails::quantile_of_squares(ONE_IN_A_MILLION, f);
    let noisy = t.pixel_variance.iter().filter(|&&x| f64::from(x) > limit).count();
    out.add(What::NoisyPixels, noisy as f64, 1.0, Scale::Count);
    noise_over_the_sensor(t, v, out);
    let lag = mean(&t.pixel_lag) / v;
    out.add(What::TimeLag, lag, 1.0 / (f * n).sqrt(), Scale::Linear);
    if t.frames >= MIN_FRAMES_FOR_NOISIEST {
        // Telegraph noise has few levels and stays at each for several frames.
        let rank = (t.pixel_variance.len() / ONE_NOISIEST_IN).max(MIN_NOISIEST);
        let mut sorted = t.pixel_variance.clone();
        let at = sorted.len() - rank;
        let edge = *sorted.select_nth_unstable_by(at, f32::total_cmp).1;
        let (mut fourth, mut square, mut lag, mut own, mut count) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (i, &x) in t.pixel_variance.iter().enumerate().filter(|(_, x)| **x >= edge) {
            let x = f64::from(x);
            fourth += f64::from(t.pixel_fourth[i]);
            square += x * x;
            lag += f64::from(t.pixel_lag[i]);
            own += x;
            count += 1.0;
        }
        out.add(What::TopKurtosis, fourth / square, (24.0 / (f * count)).sqrt(), Scale::Linear);
        out.add(
            What::TopTimeLag,
            lag / own,
            NOISIEST_LAG_SPREAD / (f * count).sqrt(),
            Scale::Linear,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_do_not_widen_a_histogram() {
        // A normal distribution of standard deviation 3 at 100, in 65536 samples. The density is
        // taken as constant within a code, which shifts a quantile by up to a code times 1/(8 ·
        // 3).
        let mut histogram: Vec<u32> = (0..4096)
            .map(|code| {
                let z = (f64::from(code) - 100.0) / 3.0;
                (65536.0 / (3.0 * std::f64::consts::TAU.sqrt()) * (-z * z / 2.0).exp()) as u32
            })
            .collect();
        let width = half_width(&histogram);
        assert!((width - 3.0).abs() < 1.0 / 24.0, "{width}");
        histogram[4000] = 30;
        assert!((half_width(&histogram) - width).abs() < 0.01);
        assert_eq!(half_width(&[0; 16]), 0.0);
    }
}
