//! Contrast transfer accuracy of IEEE 2020 (CTA, formerly contrast detection probability, CDP): how
//! often two pixels, one of a bright and one of a dark patch, show the patches' contrast.
//!
//! With the signals above black μ_B and μ_D, the Weber contrast is K = μ_B/μ_D − 1, and of pairs of
//! pixels b, d
//!
//! CTA(K, ε) = P(K (1 − ε) ≤ b/d − 1 ≤ K (1 + ε)).
//!
//! A raw channel is linear, so that DN above black stand for luminance. [`of_samples`] counts all
//! pairs; [`of_noise`] predicts the same from means and noise: samples are normally distributed and
//! rounded to codes, and the pairs of codes are summed. Where the noise covers many codes this is
//! the closed form F(K(1 + ε)) − F(K(1 − ε)) with
//! F(k) = Φ(−(μ_B − (1 + k) μ_D)/√(s_B² + (1 + k)² s_D²)).

use super::Value;
use camrig_base::{Error, Result};
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::FRAC_1_SQRT_2;

/// Standard deviations about the mean over which codes are summed: 1e-9 of a normal distribution
/// lie beyond.
const REACH: f64 = 6.0;
/// Largest standard deviation in codes that is summed code by code; of a larger one, every few
/// codes are one.
const MAX_CODES: f64 = 512.0;

/// A contrast and the relative deviation from it that counts as shown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Wanted {
    /// Weber contrast K.
    pub contrast: f64,
    /// ε; 0.5 is usual.
    pub tolerance: f64,
}

impl Wanted {
    /// # Errors
    /// A contrast that is not positive; a tolerance that is not between 0 and 1.
    pub fn new(contrast: f64, tolerance: f64) -> Result<Self> {
        if !(contrast > 0.0 && contrast.is_finite()) {
            return Err(Error::input(format!("a contrast of {contrast}"))
                .help("the bright patch needs more signal above black than the dark one"));
        }
        if !(tolerance > 0.0 && tolerance < 1.0) {
            return Err(Error::input(format!("a tolerance of {tolerance}")).help("0.5 is usual"));
        }
        Ok(Self { contrast, tolerance })
    }

    /// Smallest and largest ratio of the signals that count.
    fn ratios(self) -> [f64; 2] {
        [1.0 - self.tolerance, 1.0 + self.tolerance].map(|part| 1.0 + self.contrast * part)
    }
}

/// Samples of an even patch: signal above black, DN, and how many of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// Sorted by signal.
    counts: Vec<(f64, f64)>,
    /// Number of samples up to each.
    up_to: Vec<f64>,
}

impl Samples {
    /// From codes and their black level, DN.
    pub fn new(codes: impl IntoIterator<Item = u16>, black_dn: f64) -> Self {
        let mut counts = BTreeMap::new();
        codes.into_iter().for_each(|code| *counts.entry(code).or_insert(0.0) += 1.0);
        Self::of(counts.into_iter().map(|(code, n)| (f64::from(code) - black_dn, n)).collect())
    }

    /// The codes of a normal distribution of signals above `black_dn`.
    fn normal(noise: Noise, black_dn: f64) -> Self {
        let below = |v: f64| 0.5 * libm::erfc((noise.mean_dn - v) / noise.sd_dn * FRAC_1_SQRT_2);
        let step = (noise.sd_dn / MAX_CODES).ceil().max(1.0);
        let middle = (noise.mean_dn + black_dn).round() - black_dn;
        let side = (REACH * noise.sd_dn / step).ceil().max(1.0) as i32;
        let code = |i: i32| {
            let at = middle + step * f64::from(i);
            (at, below(at + 0.5 * step) - below(at - 0.5 * step))
        };
        Self::of((-side..=side).map(code).collect())
    }

    fn of(counts: Vec<(f64, f64)>) -> Self {
        let mut sum = 0.0;
        let up_to = counts.iter().map(|c| {
            sum += c.1;
            sum
        });
        let up_to = up_to.collect();
        Self { counts, up_to }
    }

    /// Number of samples.
    fn number(&self) -> f64 {
        self.up_to.last().copied().unwrap_or(0.0)
    }

    /// Mean signal above black, DN.
    pub fn mean_dn(&self) -> f64 {
        self.counts.iter().map(|(v, n)| v * n).sum::<f64>() / self.number()
    }

    /// Mean and standard deviation.
    pub fn noise(&self) -> Noise {
        let mean_dn = self.mean_dn();
        let squares: f64 = self.counts.iter().map(|(v, n)| n * (v - mean_dn).powi(2)).sum();
        Noise { mean_dn, sd_dn: (squares / (self.number() - 1.0).max(1.0)).sqrt() }
    }

    /// Share of the samples from `low` to `high`.
    fn share(&self, low: f64, high: f64) -> f64 {
        let until = |i: usize| if i == 0 { 0.0 } else { self.up_to[i - 1] };
        let from = self.counts.partition_point(|c| c.0 < low);
        let to = self.counts.partition_point(|c| c.0 <= high);
        (until(to.max(from)) - until(from)) / self.number()
    }

    /// Mean of `f` over the samples, and its variance from sample to sample.
    fn moments(&self, f: impl Fn(f64) -> f64) -> (f64, f64) {
        let (mut sum, mut square) = (0.0, 0.0);
        for &(v, n) in &self.counts {
            let value = f(v);
            sum += n * value;
            square += n * value * value;
        }
        let mean = sum / self.number();
        (mean, (square / self.number() - mean * mean).max(0.0))
    }
}

/// The signal of an even patch above black and its standard deviation from pixel to pixel, DN.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Noise {
    /// Mean.
    pub mean_dn: f64,
    /// Standard deviation, without that of rounding where it is to be predicted.
    pub sd_dn: f64,
}

/// The share of all pairs of pixels that show a contrast, with its standard error: that of a mean
/// over pairs of two independent samples (Hoeffding 1948).
///
/// # Errors
/// Patches without samples.
pub fn of_samples(bright: &Samples, dark: &Samples, wanted: Wanted) -> Result<Value> {
    if bright.counts.is_empty() || dark.counts.is_empty() {
        return Err(Error::input("a patch without samples").help("choose larger regions"));
    }
    let [low, high] = wanted.ratios();
    // Signals at or below black have no contrast to anything.
    let of_dark = |d: f64| if d > 0.0 { bright.share(low * d, high * d) } else { 0.0 };
    let least = f64::MIN_POSITIVE;
    let of_bright = |b: f64| dark.share((b / high).max(least), b / low);
    let (share, over_dark) = dark.moments(of_dark);
    let over_bright = bright.moments(of_bright).1;
    let variance = over_dark / dark.number() + over_bright / bright.number();
    Ok(Value::new(share, variance.sqrt()))
}

/// The contrast transfer accuracy that the noise of two patches gives, for codes in whole DN over a
/// black level of `black_dn`.
#[must_use]
pub fn of_noise(bright: Noise, dark: Noise, black_dn: f64, wanted: Wanted) -> f64 {
    let [low, high] = wanted.ratios();
    let bright = Samples::normal(bright, black_dn);
    let dark = Samples::normal(dark, black_dn);
    dark.moments(|d| if d > 0.0 { bright.share(low * d, high * d) } else { 0.0 }).0
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Normal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    fn phi(x: f64) -> f64 {
        0.5 * libm::erfc(-x * FRAC_1_SQRT_2)
    }

    fn closed(bright: Noise, dark: Noise, wanted: Wanted) -> f64 {
        let f = |k: f64| {
            let r = 1.0 + k;
            phi(-(bright.mean_dn - r * dark.mean_dn) / bright.sd_dn.hypot(r * dark.sd_dn))
        };
        let Wanted { contrast, tolerance } = wanted;
        f(contrast * (1.0 + tolerance)) - f(contrast * (1.0 - tolerance))
    }

    fn drawn(noise: Noise, black_dn: f64, seed: u64) -> Samples {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let normal = Normal::new(noise.mean_dn + black_dn, noise.sd_dn).unwrap();
        let codes = (0..4096).map(|_| normal.sample(&mut rng).round() as u16);
        Samples::new(codes, black_dn)
    }

    /// Levels of a camera at 5 to 100 lx, with the noise of a signal of 0.45 DN/e⁻.
    #[test]
    fn pairs_codes_and_the_closed_form_agree() {
        for (contrast, dark_dn) in [(0.3, 33.5), (1.0, 33.5), (0.1, 167.1), (0.3, 167.1)] {
            let noise = |mean_dn: f64| Noise { mean_dn, sd_dn: (2.0 + 0.45 * mean_dn).sqrt() };
            let (dark, bright) = (noise(dark_dn), noise(dark_dn * (1.0 + contrast)));
            let wanted = Wanted::new(contrast, 0.5).unwrap();
            let truth = of_noise(bright, dark, 64.0, wanted);
            // The closed form knows no codes: their width matters by its square over the noise's.
            let codes = 1.0 / (12.0 * dark.sd_dn.powi(2));
            let off = (truth - closed(bright, dark, wanted)).abs();
            assert!(off < 2.0 * codes, "{contrast} {dark_dn}: {truth} {off}");
            let of = |n: Noise, seed| drawn(n, 64.0, seed);
            let found = of_samples(&of(bright, 1), &of(dark, 2), wanted).unwrap();
            let z = (found.value - truth) / found.std_error;
            assert!(z.abs() < 4.0, "{contrast} {dark_dn}: {found:?} {truth}");
        }
    }

    /// A contrast of 0.1 at 3 DN lies between the ratios of small whole numbers: no pair shows it,
    /// while the closed form has 8 %.
    #[test]
    fn few_codes_show_no_small_contrast() {
        let noise = |mean_dn: f64| Noise { mean_dn, sd_dn: 0.6 };
        let (dark, bright, wanted) = (noise(3.4), noise(3.74), Wanted::new(0.1, 0.5).unwrap());
        assert!(closed(bright, dark, wanted) > 0.05);
        assert!(of_noise(bright, dark, 64.0, wanted) < 1e-3);
        let counted = of_samples(&drawn(bright, 64.0, 3), &drawn(dark, 64.0, 4), wanted).unwrap();
        assert!(counted.value < 1e-3, "{counted:?}");
    }

    #[test]
    fn pairs_are_counted_and_bad_contrasts_refused() {
        // Of 4 pairs, 12/6 and 9/6 lie within K = 0.75 ± 50 %, 12/10 and 9/10 do not.
        let (bright, dark) = (Samples::new([112, 109], 100.0), Samples::new([106, 110], 100.0));
        let found = of_samples(&bright, &dark, Wanted::new(0.75, 0.5).unwrap()).unwrap();
        assert_eq!(found.value, 0.5);
        assert!(Wanted::new(0.0, 0.5).is_err() && Wanted::new(1.0, 1.0).is_err());
        assert!(of_samples(&Samples::default(), &dark, Wanted::new(1.0, 0.5).unwrap()).is_err());
    }
}
