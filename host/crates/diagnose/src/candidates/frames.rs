//! Noise of whole frames.

use super::rows::{common, present_columns, present_rows};
use super::{Proposal, deviation, list, lowest};
use crate::evidence::{Estimated, Evidence, pooled};
use crate::model::current;
use crate::statistics::{Place, What};
use crate::temporal::mean;
use camrig_sensor_core::effects::{
    Effect, frame_offset_noise::FrameOffsetNoise, light_flicker::LightFlicker,
};

/// Standard deviation of the light's factor in the model.
fn present_flicker(e: &Evidence<'_>) -> f64 {
    match current(e.camera, "light-flicker") {
        Some(Effect::LightFlicker(x)) => f64::from(x.sigma),
        _ => 0.0,
    }
}

/// Frame means that drift: likeliest standard deviation and correlation from frame to frame.
pub fn frame_offset(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let (w, h) = e.size();
        let excess = common(e, What::FrameVariance, w * h)?;
        let present = match current(e.camera, "frame-offset-noise") {
            Some(Effect::FrameOffsetNoise(x)) => f64::from(x.sigma_e),
            _ => 0.0,
        };
        let s = deviation(present, excess)?;
        let series = series(e);
        let around = s.value.ln();
        let (ln_sigma, correlation) = lowest(
            |ln_sigma, r| series.iter().map(|s| s.unlikeliness((2.0 * ln_sigma).exp(), r)).sum(),
            [around - 1.5, around + 1.5],
            [0.0, 0.98],
        );
        let sigma = ln_sigma.exp();
        let effect = FrameOffsetNoise { sigma_e: sigma as f32, correlation: correlation as f32 };
        let stacks = 0..e.stacks.len();
        let frames = stacks.map(|i| (Place::Stack(i), What::FrameVariance));
        let strength = e.stands_out(frames).abs().max(excess.z().abs());
        Some(
            Proposal::new("frame-offset-noise", effect.into(), strength)
                .with("sigma_e", sigma, s.se)
                .with("correlation", correlation, f64::NAN),
        )
    })())
}

/// Frame means of a stack, e⁻, and the variance that they have of what is white from frame to frame.
struct Series {
    means: Vec<f64>,
    white: f64,
}

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
    /// −2 ln of the likelihood of a stationary drift x_t = r x_(t−1) + √(1 − r²) σ z beside white noise about a mean that
    /// nothing is known of: Kalman's innovations of the series and of a constant, whose weight is integrated out
    /// (Harvey 1989, section 3.4).
    fn unlikeliness(&self, variance: f64, r: f64) -> f64 {
        let (mut x, mut one, mut p) = (0.0, 0.0, variance);
        let (mut logs, mut yy, mut y1, mut s11) = (0.0, 0.0, 0.0, 0.0);
        // The level itself would cost digits.
        let start = self.means.first().copied().unwrap_or(0.0);
        for y in &self.means {
            let f = p + self.white;
            let (ey, e1) = (y - start - x, 1.0 - one);
            logs += f.ln();
            yy += ey * ey / f;
            y1 += ey * e1 / f;
            s11 += e1 * e1 / f;
            let gain = p / f;
            x = r * (x + gain * ey);
            one = r * (one + gain * e1);
            p = r * r * p * (1.0 - gain) + (1.0 - r * r) * variance;
        }
        logs + yy - y1 * y1 / s11 + s11.ln()
    }
}

/// Variance of frame means in proportion to the square of the signal.
pub fn light_flicker(e: &Evidence<'_>) -> Vec<Proposal> {
    list((|| {
        let (w, h) = e.size();
        let excess = pooled(e.flats().filter_map(|(i, _)| {
            let square = e.signal(i)?.powi(2);
            let x = e.component(i, What::FrameVariance, w * h)?;
            Some(Estimated { value: x.value / square, se: x.se / square })
        }))?;
        let s = deviation(present_flicker(e), excess)?;
        let effect = LightFlicker { sigma: s.value as f32 };
        let frames = e.flats().map(|(i, _)| (Place::Stack(i), What::FrameVariance));
        let strength = e.stands_out(frames).abs().max(excess.z().abs());
        Some(Proposal::new("light-flicker", effect.into(), strength).with("sigma", s.value, s.se))
    })())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// 40 stacks of 50 frames: of a drift of correlation r the variance of s² is 2 σ⁴ (1 + r²)/(1 − r²)/n, so that 2000
    /// frames give σ to 2.5 % and r to √((1 − r²)/n) = 2 %. Four of these standard deviations are allowed.
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
            |ln_sigma, r| series.iter().map(|s| s.unlikeliness((2.0 * ln_sigma).exp(), r)).sum(),
            [-3.0, 1.0],
            [0.0, 0.98],
        );
        assert!((ln_sigma.exp() / sigma - 1.0).abs() < 0.1, "{}", ln_sigma.exp());
        assert!((found - r).abs() < 0.08, "{found}");
    }

    /// Of white drift the likelihood is that of independent normal values about an unknown mean.
    #[test]
    fn without_memory_the_likelihood_is_that_of_a_sample() {
        let means = vec![3.0, 5.0, 4.5, 2.0, 7.5];
        let mean = 4.4;
        let variance = 1.7;
        let squares: f64 = means.iter().map(|m: &f64| (m - mean).powi(2)).sum();
        let expected = 4.0 * f64::ln(variance) + squares / variance + 5f64.ln();
        let series = Series { means, white: 0.5 };
        let found = series.unlikeliness(variance - 0.5, 0.0);
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
}
