//! The codes that occur in samples, and their step in DN.
//!
//! A converter of 10 bits whose samples are stored at the top of 16-bit words (left-aligned) has
//! steps of 64 DN, and rounding adds 64²/12 DN² instead of 1/12.

use super::rounding::{self, QUANTISATION, QUANTISATION_LIMITED, sensitivity};
use camrig_base::Value;

/// Variance of the noise, in squares of the step, above which rounding adds 1/12 independent of the
/// mean, to 1e-7.
const MIN_RESOLVED: f64 = 1.0;
/// Smallest variance of the noise, in squares of the step, for which the first harmonic describes
/// rounding (a standard deviation of 0.3).
const MIN_DESCRIBED: f64 = 0.09;
/// Steps of the fixed-point iteration for the variance of rounding. Each multiplies the error by
/// 2 |1 − 4π²v| exp(−2π²v) for a variance of v steps²: 0.15 at 0.24 and 0.8 at 0.1.
const ITERATIONS: usize = 50;

/// Which bits of a set of samples vary.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BitsSeen {
    /// One of the samples; `None` before the first.
    sample: Option<u16>,
    /// Bits in which a sample differs from that one.
    varied: u16,
}

impl BitsSeen {
    /// Of samples that differ from `sample`, one of them, in the bits `varied`.
    pub fn new(sample: u16, varied: u16) -> Self {
        Self { sample: Some(sample), varied }
    }

    /// Of both sets.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        match (self.sample, other.sample) {
            (Some(a), Some(b)) => Self::new(a, self.varied | other.varied | (a ^ b)),
            (Some(_), None) => self,
            _ => other,
        }
    }
}

/// The codes of samples: `offset + n step`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Codes {
    /// Distance of neighbouring codes, DN: a power of two.
    pub step_dn: f64,
    /// The lowest code, DN, less than a step.
    offset_dn: f64,
}

impl Codes {
    /// Of samples; a step of 1 DN where none differ.
    pub fn of(seen: impl IntoIterator<Item = BitsSeen>) -> Self {
        let seen = seen.into_iter().fold(BitsSeen::default(), BitsSeen::and);
        let step = if seen.varied == 0 { 1 } else { 1u32 << seen.varied.trailing_zeros() };
        let offset = u32::from(seen.sample.unwrap_or(0)) % step;
        Self { step_dn: step.into(), offset_dn: offset.into() }
    }

    /// Square of the step, DN²: the unit of variances in codes.
    pub fn square(&self) -> f64 {
        self.step_dn * self.step_dn
    }

    /// Variance of rounding to codes, DN².
    pub fn quantisation(&self) -> f64 {
        QUANTISATION * self.square()
    }

    /// Variance that rounding to codes adds to Gaussian noise, DN²: [`rounding::rounding`] in
    /// units of codes.
    pub fn rounding(&self, variance: f64, mean: f64, spread: f64) -> f64 {
        let square = self.square();
        let mean = (mean - self.offset_dn) / self.step_dn;
        square * rounding::rounding(variance / square, mean, spread / square)
    }

    /// Corrects a measured variance of samples for the dependence of rounding on the mean, so that
    /// rounding adds [`quantisation`](Self::quantisation), DN². With noise of less than a step,
    /// rounding changes the variance by anything from a negative amount (all samples have one
    /// code) to a quarter of the step's square (two codes). `None` where the noise is too small to
    /// be determined.
    pub fn as_if_resolved(&self, measured: Value, mean: f64, spread: f64) -> Option<Value> {
        let square = self.square();
        if measured.value - self.quantisation() > MIN_RESOLVED * square {
            return Some(measured);
        }
        let mut noise = measured.value - self.quantisation();
        for _ in 0..ITERATIONS {
            noise = measured.value - self.rounding(noise.max(0.0), mean, spread);
        }
        if noise < MIN_DESCRIBED * square {
            return None;
        }
        let slope =
            sensitivity(noise / square, (mean - self.offset_dn) / self.step_dn, spread / square);
        let error = if slope > 0.0 { measured.std_error / slope } else { f64::INFINITY };
        let error = error.min(self.quantisation()).max(measured.std_error);
        Some(Value::new(noise + self.quantisation(), error))
    }

    /// Whether the noise of a measured variance is so small that the effect of rounding depends on
    /// the mean.
    pub fn hides(&self, measured: f64) -> bool {
        measured < (QUANTISATION_LIMITED + QUANTISATION) * self.square()
    }

    /// A remark where the step is more than one DN.
    pub fn note(&self) -> Option<String> {
        let (step, bits) = (self.step_dn, libm::log2(self.step_dn));
        (step > 1.0).then(|| {
            format!(
                "all samples differ by multiples of {step} DN (left-aligned: the lowest {bits} bits \
                 never vary): {step}²/12 = {:.4} DN² are subtracted for quantisation, not 1/12",
                self.quantisation()
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(samples: &[u16]) -> BitsSeen {
        samples.iter().map(|&v| BitsSeen::new(v, 0)).fold(BitsSeen::default(), BitsSeen::and)
    }

    #[test]
    fn the_step_is_the_lowest_bit_that_varies() {
        for (samples, step) in [
            (&[64u16, 65, 70][..], 1.0),
            (&[64, 128, 640], 64.0),
            // A constant offset, as some converters add, is no smaller step.
            (&[1027, 1031, 2047], 4.0),
            (&[500, 500], 1.0),
            (&[], 1.0),
        ] {
            let codes = Codes::of([seen(samples)]);
            assert_eq!(codes.step_dn, step, "{samples:?}");
            assert_eq!(codes.note().is_some(), step > 1.0);
        }
        // Constant stacks of different levels together determine the step.
        assert_eq!(Codes::of([seen(&[64]), seen(&[96]), BitsSeen::default()]).step_dn, 32.0);
    }

    #[test]
    fn rounding_scales_with_the_step() {
        let fine = Codes::of([seen(&[3, 4])]);
        let coarse = Codes::of([seen(&[3 * 64 + 5, 4 * 64 + 5])]);
        assert_eq!(fine.rounding(0.3, 7.25, 0.0), rounding::rounding(0.3, 7.25, 0.0));
        let expected = 4096.0 * fine.rounding(0.3, 7.25, 0.1);
        let found = coarse.rounding(0.3 * 4096.0, 7.25 * 64.0 + 5.0, 0.1 * 4096.0);
        assert!((found / expected - 1.0).abs() < 1e-12);
        assert_eq!(coarse.quantisation(), 4096.0 / 12.0);
    }

    /// Rounded samples of Gaussian noise of 0.35 to 1.2 steps around means between two codes: the
    /// noise is recovered for every mean.
    #[test]
    fn rounding_is_corrected_for_any_mean() {
        let codes = Codes::of([BitsSeen::new(64, 0b11 << 2)]);
        for (sigma, mean) in [(0.35, 10.0), (0.35, 10.25), (0.4, 10.5), (0.5, 10.1), (1.2, 10.5)] {
            let density = |x: f64| (-0.5 * ((x - mean) / sigma).powi(2)).exp();
            let (mut n, mut sum, mut square) = (0.0, 0.0, 0.0);
            for k in 0..200_000 {
                let x = f64::from(k) * 1e-4;
                let (w, code) = (density(x), x.round() - mean);
                n += w;
                sum += w * code;
                square += w * code * code;
            }
            let variance = 16.0 * (square / n - (sum / n).powi(2));
            let measured = Value::new(variance, 0.01);
            let resolved = codes.as_if_resolved(measured, 4.0 * mean, 0.0).unwrap();
            let noise = (resolved.value - codes.quantisation()).sqrt() / 4.0;
            assert!((noise - sigma).abs() < 0.02, "{sigma} around {mean}: {noise}");
        }
        // With one or two codes, the noise is unknown.
        for (variance, mean) in [(0.0, 40.0), (4.0, 42.0)] {
            assert!(codes.as_if_resolved(Value::new(variance, 1e-3), mean, 0.0).is_none());
            assert!(codes.hides(variance));
        }
    }
}
