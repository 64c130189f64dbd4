//! The codes that samples take: their step in DN.
//!
//! A converter of 10 bits whose samples are stored at the top of 16-bit words (left-aligned) has
//! steps of 64 DN, and rounding adds 64²/12 DN² instead of 1/12.

use super::rounding::{self, QUANTISATION};

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

    /// A remark where the step is more than one DN.
    pub fn note(&self) -> Option<String> {
        let (step, bits) = (self.step_dn, self.step_dn.log2());
        (step > 1.0).then(|| {
            format!(
                "all samples lie a multiple of {step} DN apart (left-aligned: the lowest {bits} \
                 bits never vary): {step}²/12 = {:.4} DN² are taken off for quantisation, not \
                 1/12",
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
        // Constant stacks of different levels say together what none says alone.
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
}
