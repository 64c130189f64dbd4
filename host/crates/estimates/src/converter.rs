//! Errors of the weights of the converter's bits, from the histograms h(c) of stacks.
//!
//! A weight that is ε_b too large (DN) makes some codes wider and others narrower, by ε_b d_b(c);
//! per width the codes with a bit are as many as those without. The same holds of both lowest bits
//! together, the third threshold of a flash stage:
//!
//!   Σ_c d_b(c) h(c)/(1 + Σ_b' ε_b' d_b'(c)) = 0,
//!
//! summed over the stacks whose density is smooth over the codes that bit b divides, solved for
//! all bits at once by Newton's method. Counts scatter as Poisson's do.

use camrig_base::Value;
use camrig_linear::{Matrix, Vector, apply, inverse, product};

/// Bits whose errors the effect has parameters for, from the lowest.
const BITS: usize = 7;
/// The number, after those of the bits, of the error that both lowest bits have together.
const BOTH_LOWEST: usize = BITS;
/// Keys of the errors in a camera file.
pub const KEYS: [&str; BITS + 1] = [
    "bit_0_lsb",
    "bit_1_lsb",
    "bit_2_lsb",
    "bit_3_lsb",
    "bit_4_lsb",
    "bit_5_lsb",
    "bit_6_lsb",
    "bits_0_1_lsb",
];
/// Significance, standard errors, below which a bit is taken to be right.
pub const SIGNIFICANT: f64 = 4.0;
/// Steps of Newton's method: products of errors, 0.03 of one of 0.2, are gone after the second.
const NEWTON: usize = 4;
/// Standard deviation of the samples, in weights of a bit, from which their density is smooth over
/// the codes that the bit divides: a normal law's wave of period 2h has the amplitude
/// exp(−π²σ²/2h²), 2e-5 at σ = 1.5 h.
const SMOOTH_FROM: f64 = 1.5;
/// Least width of a code, DN: a missing one has no more information than a very narrow one.
const MIN_WIDTH_DN: f64 = 0.05;

/// The samples of a stack. Codes at either end of the scale, where samples are cut off, are no
/// part of a smooth density: such stacks show nothing.
pub struct Codes<'a> {
    /// How often each code came.
    pub histogram: &'a [u32],
    /// Standard deviation of the samples, DN; of several channels that of the narrowest.
    pub sd: f64,
}

impl Codes<'_> {
    /// Whether the density would be smooth over the codes that a bit divides, or both lowest.
    fn smooth_over(&self, error: usize) -> bool {
        let bit = if error == BOTH_LOWEST { 1 } else { error };
        self.sd > SMOOTH_FROM * (1u32 << bit) as f64
    }
}

/// d_b(c), by how much an error of 1 DN of a bit widens a code, DN: a weight that is too large
/// makes the last code without the bit wider, and the last code with it narrower. Of both lowest
/// together it does so to the last two of four codes.
fn widening(error: usize, code: usize) -> f64 {
    if error == BOTH_LOWEST {
        return [0.0, 0.0, 1.0, -1.0][code % 4];
    }
    let half = 1usize << error;
    match (code % half == half - 1, code & half == 0) {
        (false, _) => 0.0,
        (true, true) => 1.0,
        (true, false) => -1.0,
    }
}

/// The errors `bits`, DN, all at once: within a narrow histogram the codes that one widens are not
/// balanced by those it narrows, and would pass for another's. `None` where the stacks do not
/// determine them.
fn solve(stacks: &[Codes<'_>], bits: &[usize]) -> Option<Vec<Value>> {
    let n = bits.len();
    let mut errors = Vector::zeros(n);
    let mut scatter = Matrix::zeros(n, n);
    for _ in 0..NEWTON {
        let (mut sums, mut matrix) = (Vector::zeros(n), Matrix::zeros(n, n));
        let mut covariance = Matrix::zeros(n, n);
        for stack in stacks {
            let smooth: Vec<bool> = bits.iter().map(|&b| stack.smooth_over(b)).collect();
            for (code, &count) in stack.histogram.iter().enumerate().filter(|(_, h)| **h > 0) {
                let widened: Vec<f64> = bits.iter().map(|&b| widening(b, code)).collect();
                let width = 1.0 + widened.iter().zip(&errors).map(|(d, e)| d * e).sum::<f64>();
                let density = f64::from(count) / width.max(MIN_WIDTH_DN);
                for i in (0..n).filter(|&i| smooth[i]) {
                    sums[i] += widened[i] * density;
                    for j in 0..n {
                        let product = widened[i] * widened[j] * density;
                        matrix[(i, j)] += product;
                        covariance[(i, j)] += if smooth[j] { product } else { 0.0 };
                    }
                }
            }
        }
        let inverse = inverse(matrix)?;
        errors += apply(&inverse, &sums);
        scatter = product(&product(&inverse, &covariance), &inverse.transpose());
    }
    Some((0..n).map(|i| Value { value: errors[i], std_error: scatter[(i, i)].sqrt() }).collect())
}

/// The bits with a significant error, DN, by their place in [`KEYS`]: the least significant one is
/// left out until all are. Both lowest together have one only where none of each can stand for it.
pub fn significant_errors(stacks: &[Codes<'_>]) -> Vec<(usize, Value)> {
    let seen = |b: &usize| stacks.iter().any(|s| s.smooth_over(*b));
    let mut bits: Vec<usize> = (0..=BOTH_LOWEST).filter(seen).collect();
    let together = solve(stacks, &bits).and_then(|found| found.last().copied());
    if together.is_none_or(|error| error.z().abs() <= SIGNIFICANT) {
        bits.retain(|b| *b != BOTH_LOWEST);
    }
    while let Some(found) = solve(stacks, &bits) {
        let weakest =
            (0..bits.len()).min_by(|&a, &b| found[a].z().abs().total_cmp(&found[b].z().abs()));
        match weakest {
            Some(i) if !(found[i].z().abs() > SIGNIFICANT) => drop(bits.remove(i)),
            _ => return bits.into_iter().zip(found).collect(),
        }
    }
    Vec::new()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Histogram of a million samples of a normal law, code `c` from `begins(c)` to `begins(c +
    /// 1)`.
    fn histogram(mean: f64, sd: f64, begins: impl Fn(usize) -> f64) -> Vec<u32> {
        let below = |v: f64| 0.5 * libm::erfc((mean - v) / sd / std::f64::consts::SQRT_2);
        (0..256).map(|c| (1e6 * (below(begins(c + 1)) - below(begins(c)))) as u32).collect()
    }

    /// A narrow histogram about a code that bit 2 widens looks like an error of bit 0 as well:
    /// only bit 2 has one.
    #[test]
    fn a_wrong_bit_is_not_taken_for_another() {
        for error in [0.04, -0.04, 0.15, -0.15] {
            let begins = |c: usize| c as f64 - 0.5 + if c & 4 != 0 { error } else { 0.0 };
            let means_and_sds = [(19.0, 2.0), (43.0, 2.5), (130.0, 12.0)];
            let all = means_and_sds.map(|(mean, sd)| (histogram(mean, sd, begins), sd));
            let stacks: Vec<Codes<'_>> =
                all.iter().map(|(h, sd)| Codes { histogram: h, sd: *sd }).collect();
            let alone = solve(&stacks, &[0]).unwrap();
            assert!(
                alone[0].z().abs() > SIGNIFICANT,
                "bit 0 alone does not look wrong: {}",
                alone[0].z()
            );
            let found = significant_errors(&stacks);
            assert_eq!(found.iter().map(|f| f.0).collect::<Vec<_>>(), [2]);
            let (value, se) = (found[0].1.value, found[0].1.std_error);
            assert!((value - error).abs() < 2.0 * se, "{value} ± {se}, {error}");
        }
    }

    /// The codes of a flash stage of two bits, widths 1.06, 1.06, 0.94 and 0.94: no errors of
    /// single bits make the first two codes of four alike and the last two.
    #[test]
    fn thresholds_of_a_flash_stage_are_found_one_by_one() {
        let begins = |c: usize| c as f64 - 0.5 + [0.0, 0.06, 0.12, 0.06][c % 4];
        let all =
            [(70.0, 12.0), (130.0, 14.0)].map(|(mean, sd)| (histogram(mean, sd, begins), sd));
        let stacks: Vec<Codes<'_>> =
            all.iter().map(|(h, sd)| Codes { histogram: h, sd: *sd }).collect();
        let found = significant_errors(&stacks);
        let expected = [(0, 0.06), (1, 0.12), (BOTH_LOWEST, -0.12)];
        assert_eq!(found.len(), expected.len(), "{found:?}");
        for ((bit, error), (of, true_error)) in found.into_iter().zip(expected) {
            let off = (error.value - true_error).abs();
            assert!(bit == of && off < 2.0 * error.std_error, "{bit}: {error:?}");
        }
    }
}
