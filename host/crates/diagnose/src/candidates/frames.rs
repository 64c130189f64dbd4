//! Noise that a whole frame shares: `frame-offset-noise` and `light-flicker`.
//!
//! Both come from the variance V of frame means, DN², and the model's prediction of it, V':
//!
//!   offset: σ² = σ₀² + ⟨(V − V')/K²⟩, e⁻², over all stacks;
//!   light:  σ² = σ₀² + ⟨(V − V')/s²⟩, without unit, over the flats,
//!
//! with K the system gain (DN/e⁻), s the signal of a flat above dark (DN), ⟨ ⟩ inverse-variance
//! means and σ₀ what the model has already. The offset's correlation from one frame to the next is
//! the likeliest one of a first-order autoregression plus white noise (Kalman's filter).

use super::common::{LN_SIGMA_REACH, present};
use super::proposal::{Proposal, deviation};
use super::rows::{common_excess, present_columns, present_rows};
use crate::evidence::Evidence;
use crate::numerics::minimise::lowest;
use crate::statistics::statistic::{Place, What};
use crate::statistics::temporal::mean;
use camrig_base::Value;

/// Correlations from one frame to the next that are searched. A drift closer to 1 is a trend over
/// the frames of a stack, whose variance its own mean hides.
const CORRELATIONS: [f64; 2] = [0.0, 0.98];

/// Standard deviation of the light's factor in the model.
fn present_flicker(e: &Evidence<'_>) -> f64 {
    present(e.camera, "light-flicker", "sigma").unwrap_or(0.0)
}

/// `frame-offset-noise`: standard deviation and correlation of the likeliest drift.
pub fn frame_offset(e: &Evidence<'_>) -> Option<Proposal> {
    let (w, h) = e.size();
    let excess = common_excess(e, What::FrameVariance, w * h)?;
    let present = present(e.camera, "frame-offset-noise", "sigma_e").unwrap_or(0.0);
    let s = deviation(present, excess)?;
    let series = series(e);
    let around = libm::log(s.value);
    let (ln_sigma, correlation) = lowest(
        |ln_sigma, r| series.iter().map(|s| s.deviance(libm::exp(2.0 * ln_sigma), r)).sum(),
        [around - LN_SIGMA_REACH, around + LN_SIGMA_REACH],
        CORRELATIONS,
    );
    let stacks = 0..e.stacks.len();
    let frames = stacks.map(|i| (Place::Stack(i), What::FrameVariance));
    let strength = e.stands_out(frames).abs().max(excess.z().abs());
    let sigma = Value { value: libm::exp(ln_sigma), ..s };
    let drift = [("sigma_e", sigma), ("correlation", Value::chosen(correlation))];
    Proposal::of("frame-offset-noise", strength, drift)
}

/// Frame means of a stack.
struct Series {
    /// Mean of each frame, e⁻.
    means: Vec<f64>,
    /// Variance of a mean by what is white from frame to frame (pixels, rows, columns, light),
    /// e⁻².
    white: f64,
}

/// The frame means of every stack.
fn series(e: &Evidence<'_>) -> Vec<Series> {
    let (w, h) = e.size();
    let of_stack = |i: usize| {
        let (c, t) = (&e.design.conditions[i], &e.stacks[i]);
        let k = e.gain(c);
        let light = present_flicker(e) * e.signal(i).unwrap_or(0.0) / k;
        Series {
            means: t.frame_means.iter().map(|m| m / k).collect(),
            white: mean(&t.pixel_variance) / (w * h * k * k)
                + present_rows(e).powi(2) / h
                + present_columns(e).powi(2) / w
                + light * light,
        }
    };
    (0..e.stacks.len()).map(of_stack).collect()
}

impl Series {
    /// −2 ln of the likelihood of a stationary drift x_t = r x_(t−1) + √(1 − r²) σ z of a variance
    /// σ² (e⁻²) plus white noise, about an unknown mean: Kalman's innovations of the series and
    /// of a constant, over whose factor the likelihood is integrated (Harvey 1989, section 3.4).
    fn deviance(&self, variance: f64, r: f64) -> f64 {
        let (mut x, mut one, mut p) = (0.0, 0.0, variance);
        let (mut logs, mut yy, mut y1, mut s11) = (0.0, 0.0, 0.0, 0.0);
        // Less the first value: the level itself would cost digits.
        let start = self.means.first().copied().unwrap_or(0.0);
        for y in &self.means {
            let f = p + self.white;
            let (ey, e1) = (y - start - x, 1.0 - one);
            logs += libm::log(f);
            yy += ey * ey / f;
            y1 += ey * e1 / f;
            s11 += e1 * e1 / f;
            let gain = p / f;
            x = r * (x + gain * ey);
            one = r * (one + gain * e1);
            p = r * r * p * (1.0 - gain) + (1.0 - r * r) * variance;
        }
        logs + yy - y1 * y1 / s11 + libm::log(s11)
    }
}

/// `light-flicker`: variance of the frame means of flats in proportion to the square of the
/// signal.
pub fn light_flicker(e: &Evidence<'_>) -> Option<Proposal> {
    let (w, h) = e.size();
    let excess = Value::combine(e.flats().filter_map(|(i, _)| {
        Some(e.component(i, What::FrameVariance, w * h)?.scaled(1.0 / e.signal(i)?.powi(2)))
    }))?;
    let s = deviation(present_flicker(e), excess)?;
    let frames = e.flats().map(|(i, _)| (Place::Stack(i), What::FrameVariance));
    let strength = e.stands_out(frames).abs().max(excess.z().abs());
    Proposal::of("light-flicker", strength, [("sigma", s)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// 40 stacks of 50 frames: of a drift of correlation r the variance of s² is
    /// 2 σ⁴ (1 + r²)/(1 − r²)/n, so that 2000 frames give σ to 2.5 % and r to √((1 − r²)/n) = 2 %.
    /// Four of these standard deviations are allowed.
    #[test]
    fn the_likeliest_drift_is_the_one_that_was_put_in() {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let (sigma, r, white) = (0.3, 0.6, 0.01f64);
        let series: Vec<Series> = (0..40)
            .map(|i| {
                let mut x = normal();
                let mut frame = || {
                    x = r * x + f64::sqrt(1.0 - r * r) * normal();
                    f64::from(i) * 100.0 + sigma * x + white.sqrt() * normal()
                };
                Series { means: (0..50).map(|_| frame()).collect(), white }
            })
            .collect();
        let (ln_sigma, found) = lowest(
            |ln_sigma, r| series.iter().map(|s| s.deviance((2.0 * ln_sigma).exp(), r)).sum(),
            [-3.0, 1.0],
            CORRELATIONS,
        );
        assert!((ln_sigma.exp() / sigma - 1.0).abs() < 0.1, "{}", ln_sigma.exp());
        assert!((found - r).abs() < 0.08, "{found}");
    }

    /// A drift without correlation has the likelihood of independent normal values about an
    /// unknown mean.
    #[test]
    fn without_memory_the_likelihood_is_that_of_a_sample() {
        let means = vec![3.0, 5.0, 4.5, 2.0, 7.5];
        let mean = 4.4;
        let variance = 1.7;
        let squares: f64 = means.iter().map(|m: &f64| (m - mean).powi(2)).sum();
        let expected = 4.0 * f64::ln(variance) + squares / variance + 5f64.ln();
        let series = Series { means, white: 0.5 };
        let found = series.deviance(variance - 0.5, 0.0);
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
}
