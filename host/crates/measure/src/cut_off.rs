//! Detects darks that are cut off: samples below some code were set to that code, which then
//! contains the whole lower tail of the noise.
//!
//! The logarithm of a Gaussian is a parabola, so that its third difference over codes is 0. The
//! three codes above a code predict its number of samples: n0 = n1³ n3 / n2³. A code that contains
//! a cut-off tail has more, and the code below it fewer; with tails heavier than a Gaussian's,
//! both have more. The test is applied to the lowest code above a few defective pixels.

use super::codes::{CodeCounts, Codes};
use super::moments::SATURATED_SHARE;
use camrig_base::Result;
use camrig_base::Value;
use camrig_captures::StoredFrame;

/// Approximate number of samples used: they determine a share of 0.1 % to 6 %.
const SAMPLES: usize = 1 << 18;
/// Standard errors of the counts by which a code must exceed a Gaussian: by chance, once in three
/// million darks.
const MIN_ERRORS: f64 = 5.0;

/// Where a dark is cut off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutOff {
    /// The lowest code that occurs, DN.
    pub code_dn: u16,
    /// Share of the samples there.
    pub share: f64,
    /// Share that Gaussian noise would have there.
    pub expected: f64,
}

impl CutOff {
    /// Tests rows of a frame. `None` where it is not cut off, where it is cut off at 0 DN (see
    /// [`Moments::zeros`](super::moments::Moments)), or where too few codes occur.
    pub fn of(samples: &[u16]) -> Option<Self> {
        let mut counts = vec![0u32; 1 << 16];
        for &v in samples {
            counts[usize::from(v)] += 1;
        }
        let step = Codes::of([&CodeCounts::of(samples, u16::MAX)]).step_dn as usize;
        let all = samples.len() as f64;
        let mut below = 0.0;
        let lowest = counts.iter().position(|&n| {
            below += f64::from(n);
            below > SATURATED_SHARE * all
        })?;
        let at = |code: usize| counts.get(code).map_or(0.0, |&n| f64::from(n));
        let [n0, n1, n2, n3] = [0, 1, 2, 3].map(|k| at(lowest + k * step));
        if lowest == 0 || n1 == 0.0 || n2 == 0.0 || n3 == 0.0 {
            return None;
        }
        let here = below_of([n1, n2, n3]);
        let more = n0 - here.value;
        let next = below_of([n0, n1, n2]);
        let fewer = next.value - lowest.checked_sub(step).map_or(0.0, at);
        let cut_off = more > SATURATED_SHARE * all
            && more > MIN_ERRORS * libm::hypot(here.std_error, n0.sqrt())
            && fewer > MIN_ERRORS * next.std_error;
        cut_off.then_some(Self {
            code_dn: lowest as u16,
            share: n0 / all,
            expected: here.value / all,
        })
    }

    /// A remark about `darks`, the name of the frames that are cut off.
    pub fn note(&self, darks: &str) -> String {
        format!(
            "{:.1} % of the samples of {darks} are {} DN, where Gaussian noise would have {:.1} %: \
             it is cut off there, so that the offset is too high and read noise and fixed \
             patterns are too low; take darks without subtraction, or raise the black level",
            100.0 * self.share,
            self.code_dn,
            100.0 * self.expected
        )
    }
}

/// Samples of the code below three codes of these numbers, of Gaussian noise.
fn below_of([n1, n2, n3]: [f64; 3]) -> Value {
    let expected = n1.powi(3) * n3 / n2.powi(3);
    Value::new(expected, expected * (9.0 / n1 + 9.0 / n2 + 1.0 / n3).sqrt())
}

/// Rows of a frame in whole periods, evenly spread over it.
///
/// # Errors
/// A file that cannot be read.
pub fn some_rows(frame: &StoredFrame, period: usize) -> Result<Vec<u16>> {
    let periods = (frame.height / period).max(1);
    let rows = period.min(frame.height);
    let taken = (SAMPLES / (rows * frame.width)).clamp(1, periods);
    let mut samples = vec![0; taken * rows * frame.width];
    for (i, rows) in samples.chunks_mut(rows * frame.width).enumerate() {
        frame.read_rows(i * periods / taken * period, rows)?;
    }
    Ok(samples)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Normal};
    use rand_xoshiro::{Xoshiro256PlusPlus, rand_core::SeedableRng};

    /// Gaussian noise about 64.4 DN in codes of `step`.
    fn noise(sigma: f64, step: f64) -> Vec<u16> {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
        let normal = Normal::new(64.4 / step, sigma).unwrap();
        (0..20_000).map(|_| (normal.sample(&mut random).round() * step) as u16).collect()
    }

    #[test]
    fn a_cut_is_found_at_any_code_and_only_where_there_is_one() {
        for (sigma, step) in [(0.2, 1.0), (0.5, 1.0), (1.0, 4.0), (2.0, 1.0), (9.0, 1.0)] {
            let mut whole = noise(sigma, step);
            assert_eq!(CutOff::of(&whole), None, "{sigma} {step}");
            // Two dead pixels do not matter.
            whole[..2].fill(0);
            assert_eq!(CutOff::of(&whole), None, "{sigma} {step}");
            let cut: Vec<u16> =
                whole.iter().map(|&v| if v == 0 { 0 } else { v.max(64) }).collect();
            let found = CutOff::of(&cut);
            if sigma < 1.0 {
                // Three codes are too few.
                assert_eq!(found, None, "{sigma} {step}");
                continue;
            }
            let found = found.unwrap();
            assert_eq!(found.code_dn, 64, "{sigma} {step}");
            assert!(found.share > 1.5 * found.expected, "{found:?}");
        }
        assert_eq!(CutOff::of(&[64; 1000]), None);
        // A real dark of an IMX541, whose tails are wider than a Gaussian's.
        let counts = [5, 4, 3, 3, 18, 24, 116, 2814, 28_319, 85_325, 64_886, 13_992, 939, 68];
        let codes = (1..).zip(counts).flat_map(|(code, n)| std::iter::repeat_n(code, n));
        assert_eq!(CutOff::of(&codes.collect::<Vec<u16>>()), None);
        assert_eq!(CutOff::of(&[]), None);
    }
}
