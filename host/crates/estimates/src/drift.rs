//! Levels that wander from frame to frame: their standard deviation and their memory.
//!
//! The level of frame t is x_t = r x_(t−1) + √(1 − r²) σ z of variance σ², plus what is white from
//! frame to frame, about an unknown mean in each stack. σ and r are the likeliest; a walk without a
//! mean has r near 1. Start-up is no such thing: it is the same in every stack, and
//! `camrig-clean` finds it.

use camrig_base::Value;

/// The levels of a stack's frames, in order of time.
#[derive(Clone, Debug)]
pub struct Levels {
    /// Mean of each frame.
    pub means: Vec<f64>,
    /// Variance of a mean by what is white from frame to frame: pixels, rows, columns, light.
    pub white: f64,
}

/// How levels wander.
#[derive(Clone, Copy, Debug)]
pub struct Drift {
    /// Standard deviation σ over a long time, in the unit of the levels.
    pub sd: Value,
    /// Correlation r of a frame with the next.
    pub correlation: Value,
    /// Deviation from frames that are independent of each other: the root of the likelihood ratio
    /// (Wilks 1938), in standard deviations.
    pub memory: f64,
}

/// Steps of the correlation, up to a drift that is a trend over a stack of fifty frames, whose
/// variance the stack's own mean hides.
const STEP: f64 = 0.02;
const STEPS: u32 = 49;
/// How far the standard deviation is searched about that of the levels, in its logarithm.
const REACH: f64 = 3.0;
/// Steps of the search, each 0.618 of the one before.
const TURNS: usize = 30;

impl Levels {
    /// −2 ln of the likelihood of a variance σ² and a correlation r: Kalman's innovations of the
    /// series and of a constant, over whose factor the likelihood is integrated (Harvey 1989,
    /// section 3.4).
    pub fn deviance(&self, variance: f64, r: f64) -> f64 {
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

/// The likeliest drift of several stacks; none where no stack has three frames, or all their levels
/// are equal.
pub fn likeliest(stacks: &[Levels]) -> Option<Drift> {
    let used: Vec<&Levels> = stacks.iter().filter(|s| s.means.len() >= 3).collect();
    let dof: f64 = used.iter().map(|s| s.means.len() as f64 - 1.0).sum();
    let squares = |s: &&Levels| super::robust::variance(&s.means) * (s.means.len() as f64 - 1.0);
    let around = 0.5 * libm::log(used.iter().map(squares).sum::<f64>() / dof);
    if !around.is_finite() {
        return None;
    }
    let deviance = |ln_sd: f64, r: f64| -> f64 {
        used.iter().map(|s| s.deviance(libm::exp(2.0 * ln_sd), r)).sum()
    };
    // For each correlation the likeliest ln σ, by golden section.
    let profile = |k: u32| {
        let r = f64::from(k) * STEP;
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        let (mut low, mut high) = (around - REACH, around + REACH);
        for _ in 0..TURNS {
            let (a, b) = (high - golden * (high - low), low + golden * (high - low));
            if deviance(a, r) < deviance(b, r) { high = b } else { low = a }
        }
        let ln_sd = 0.5 * (low + high);
        (r, ln_sd, deviance(ln_sd, r))
    };
    let all: Vec<(f64, f64, f64)> = (0..=STEPS).map(profile).collect();
    let &(r, ln_sd, least) = all.iter().min_by(|a, b| a.2.total_cmp(&b.2))?;
    // As likely by four: two standard errors to either side, of r and, along it, of ln σ, as the
    // likelihood is steeper on the side of r = 1.
    let near = all.iter().filter(|p| p.2 < least + 4.0);
    let reach = near.fold([STEP, 0.0], |[of_r, of_sd], p| {
        [of_r.max(0.5 * (p.0 - r).abs()), f64::max(of_sd, 0.5 * (p.1 - ln_sd).abs())]
    });
    // The curvature over a step of a tenth.
    const TENTH: f64 = 0.1;
    let beside = deviance(ln_sd + TENTH, r) + deviance(ln_sd - TENTH, r) - 2.0 * least;
    let sd = libm::exp(ln_sd);
    let error = (2.0 / (beside / (TENTH * TENTH)).max(1e-3)).sqrt().min(1.0);
    let error = libm::hypot(error, reach[1]);
    Some(Drift {
        sd: Value::new(sd, sd * error),
        correlation: Value::new(r, reach[0]),
        memory: (all[0].2 - least).max(0.0).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// Stacks of a drift of σ 0.3 about levels of their own, with white noise of 0.1.
    fn drifting(stacks: u32, frames: usize, r: f64, seed: u64) -> Vec<Levels> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut stack = |i: u32| {
            let mut x = normal();
            let mut frame = || {
                x = r * x + f64::sqrt(1.0 - r * r) * normal();
                f64::from(i) * 100.0 + 0.3 * x + 0.1 * normal()
            };
            Levels { means: (0..frames).map(|_| frame()).collect(), white: 0.01 }
        };
        (0..stacks).map(&mut stack).collect()
    }

    /// Of n frames of a drift of correlation r the variance of s² is 2 σ⁴ (1 + r²)/(1 − r²)/n, so
    /// that 2000 give σ to 2.5 % and r to √((1 − r²)/n) = 2 %, beside the grid's step. Four of
    /// these standard deviations are allowed.
    #[test]
    fn the_likeliest_drift_is_the_one_that_was_put_in() {
        let found = likeliest(&drifting(40, 50, 0.6, 5)).unwrap();
        assert!((found.sd.value / 0.3 - 1.0).abs() < 0.1, "{found:?}");
        assert!((found.correlation.value - 0.6).abs() < 0.08, "{found:?}");
        assert!(found.memory > 10.0 && found.correlation.std_error < 0.05, "{found:?}");
    }

    /// Errors are those of the scatter over draws, and offsets that are white have no memory.
    #[test]
    fn errors_cover_the_drift_and_white_offsets_have_no_memory() {
        let within = |v: Value, right: f64| ((v.value - right) / v.std_error).abs() < 2.0;
        let draws: Vec<Drift> =
            (0..40).map(|s| likeliest(&drifting(4, 16, 0.6, s)).unwrap()).collect();
        let covered = draws.iter().filter(|d| within(d.correlation, 0.6)).count();
        let sd = draws.iter().filter(|d| within(d.sd, 0.3)).count();
        assert!(covered >= 34 && sd >= 34, "{covered} {sd} of 40");
        let white: Vec<f64> =
            (0..40).map(|s| likeliest(&drifting(4, 16, 0.0, 100 + s)).unwrap().memory).collect();
        assert!(white.iter().filter(|m| **m > 2.0).count() <= 4, "{white:?}");
        assert!(likeliest(&[Levels { means: vec![1.0; 9], white: 0.1 }]).is_none());
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
        let found = Levels { means, white: 0.5 }.deviance(variance - 0.5, 0.0);
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
}
