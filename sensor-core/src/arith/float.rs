//! f32 arithmetic.

use super::{Arith, BLOCK, Block, Counts, EXPANSION_FROM_E, MAX_LIGHT_E, MAX_SIGNAL_E};
use crate::math;
use crate::spectral::power_of_two;
use crate::stream::{LANES, Lanes};

/// f32 from IEEE basic operations and the functions of [`crate::math`], in the range of light or
/// in that of charge.
#[derive(Clone, Copy, Debug)]
pub struct FloatIn<const LIGHT: bool>;

/// f32.
pub type Float = FloatIn<false>;

/// Terms of the inversion: at a mean of 16 the probability of a larger count is 2e-12.
const INVERSION_TERMS: usize = 52;
/// 1/k.
const INVERSE: [f32; INVERSION_TERMS + 1] = {
    let mut table = [0.0; INVERSION_TERMS + 1];
    let mut k = 1;
    while k <= INVERSION_TERMS {
        table[k] = 1.0 / k as f32;
        k += 1;
    }
    table
};

#[inline(always)]
fn clamp(x: f32, low: f32, high: f32) -> f32 {
    let x = if x > low { x } else { low };
    if x < high { x } else { high }
}

/// Cornish-Fisher expansion of the Poisson quantile to third order, floor of
/// q = λ + √λ w + (2+w²)/6 − (w/36 + w³/72)/√λ + (−8/405 + 7w²/810 + w⁴/270)/λ, w standard normal.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn expansion(mean: &mut Block<f32>, words: &Block<u32>) {
    let normals = normals_of(words);
    for i in 0..BLOCK {
        let (mean, w) = (&mut mean[i], normals[i]);
        let m = clamp(*mean, EXPANSION_FROM_E, MAX_LIGHT_E);
        let inv = math::rsqrt(m);
        let w2 = w * w;
        let first = w2 * (1.0 / 6.0) + 1.0 / 3.0;
        let second = w * inv * (w2 * (-1.0 / 72.0) - 1.0 / 36.0);
        let third = inv * inv * (w2 * (w2 * (1.0 / 270.0) + 7.0 / 810.0) - 8.0 / 405.0);
        let q = (m * inv * w + first) + (second + third) + m;
        // floor of a non-negative number: round, then step back where that went up. From 2²² on,
        // where f32 has no fractions to speak of, that costs at most a unit in the last place.
        let q = if q > 0.0 { q } else { 0.0 };
        let r = math::round(q);
        *mean = if r > q { r - 1.0 } else { r };
    }
}

/// Probability of a count below which the inversion stops: half the resolution of a uniform number
/// of 32 bits, 2⁻³³. Without it a u close to 1 might never be reached by the rounded sum of
/// probabilities.
const NEGLIGIBLE: f32 = 1.0 / 8_589_934_592.0;

/// Pixels whose counts are looked for together: what stays in the registers of vector units, and no
/// more steps than the largest of so few counts.
const GROUP: usize = 16;

/// Inversion: the smallest count whose distribution function reaches u; 0 for means that are not
/// below [`EXPANSION_FROM_E`], which have another method.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn inversion(means: &mut Block<f32>, words: &Block<u32>) {
    let words = words.as_chunks::<GROUP>().0;
    for (mean, words) in means.as_chunks_mut::<GROUP>().0.iter_mut().zip(words) {
        let mut count = [0.0; GROUP];
        let mut term = [0.0; GROUP];
        let mut left = [0.0; GROUP];
        let mut lambda = [0.0; GROUP];
        for i in 0..GROUP {
            lambda[i] = if mean[i] > 0.0 && mean[i] < EXPANSION_FROM_E { mean[i] } else { 0.0 };
            term[i] = math::exp(-lambda[i]);
            left[i] = (words[i] as f32 + 0.5) * (1.0 / 4_294_967_296.0) - term[i];
        }
        for step in INVERSE[1..].chunks(4) {
            for inverse_k in step {
                for i in 0..GROUP {
                    let more = (left[i] > 0.0) & (term[i] > NEGLIGIBLE);
                    term[i] *= lambda[i] * inverse_k;
                    count[i] += if more { 1.0 } else { 0.0 };
                    left[i] -= term[i];
                }
            }
            // A fold without early exit becomes a vector operation.
            let more = |i: usize| (left[i] > 0.0) & (term[i] > NEGLIGIBLE);
            if !(0..GROUP).fold(false, |any, i| any | more(i)) {
                break;
            }
        }
        *mean = count;
    }
}

/// The words of two draws, as one block.
#[inline(always)]
fn words(lanes: &mut Lanes) -> Block<u32> {
    let (a, b) = (lanes.draw(), lanes.draw());
    let mut out = [0; BLOCK];
    out[..LANES].copy_from_slice(&a);
    out[LANES..].copy_from_slice(&b);
    out
}

#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn normals_of(words: &Block<u32>) -> Block<f32> {
    let mut out = [0.0; BLOCK];
    for i in 0..LANES {
        let (a, b) = math::box_muller(words[i], words[i + LANES]);
        out[i] = a;
        out[i + LANES] = b;
    }
    out
}

impl<const LIGHT: bool> Arith for FloatIn<LIGHT> {
    type Light = FloatIn<true>;
    type Signal = f32;
    type Factor = f32;
    type Sum = f32;
    type Weight = f32;

    #[inline(always)]
    fn signal(e: f32) -> f32 {
        let largest = if LIGHT { MAX_LIGHT_E } else { MAX_SIGNAL_E };
        clamp(e, -largest, largest)
    }

    #[inline(always)]
    fn factor(f: f32) -> f32 {
        f
    }

    #[inline(always)]
    fn electrons(s: f32) -> f32 {
        s
    }

    #[inline(always)]
    fn number(f: f32) -> f32 {
        f
    }

    #[inline(always)]
    fn add(a: f32, b: f32) -> f32 {
        a + b
    }

    #[inline(always)]
    fn sub(a: f32, b: f32) -> f32 {
        a - b
    }

    #[inline(always)]
    fn scale(s: f32, f: f32) -> f32 {
        s * f
    }

    #[inline(always)]
    fn times(s: f32, gain: f32) -> f32 {
        Self::signal(s * gain)
    }

    #[inline(always)]
    fn held(light: f32) -> f32 {
        clamp(light, -MAX_SIGNAL_E, MAX_SIGNAL_E)
    }

    #[inline(always)]
    fn gain(sigma: f32, n: f32) -> f32 {
        1.0 + sigma * n
    }

    #[inline(always)]
    fn normals(lanes: &mut Lanes) -> Block<f32> {
        normals_of(&words(lanes))
    }

    #[inline(always)]
    fn poisson(means: &mut [Block<f32>], counts: &mut Counts) {
        match (&mut counts.uniform, &mut counts.normal) {
            (Some(uniform), None) => {
                for mean in means {
                    inversion(mean, &words(uniform));
                }
            }
            (None, Some(normal)) => {
                for mean in means {
                    expansion(mean, &words(normal));
                }
            }
            // One stream after the other, which leaves each loop enough registers. Between the
            // loops the counts of small means are stored as −1 − count.
            (Some(uniform), Some(normal)) => {
                for mean in &mut *means {
                    let words = words(uniform);
                    if mean.iter().fold(false, |any, &m| any | (m < EXPANSION_FROM_E)) {
                        let mut low = *mean;
                        inversion(&mut low, &words);
                        for i in 0..BLOCK {
                            let m = mean[i];
                            mean[i] = if m < EXPANSION_FROM_E { -1.0 - low[i] } else { m };
                        }
                    }
                }
                for mean in means {
                    let mut high = *mean;
                    let words = words(normal);
                    if high.iter().fold(false, |any, &m| any | (m >= 0.0)) {
                        expansion(&mut high, &words);
                    }
                    for i in 0..BLOCK {
                        mean[i] = if mean[i] < 0.0 { -1.0 - mean[i] } else { high[i] };
                    }
                }
            }
            (None, None) => {}
        }
    }

    #[inline(always)]
    fn weight(w: f32) -> f32 {
        w
    }

    #[inline(always)]
    fn lerp(a: &[f32; 16], b: &[f32; 16], first: f32, step: f32) -> [f32; 16] {
        let mut out = [0.0; 16];
        for i in 0..16 {
            let t = clamp(first + i as f32 * step, 0.0, 1.0);
            out[i] = a[i] + t * (b[i] - a[i]);
        }
        out
    }

    #[inline(always)]
    fn accumulate<const N: usize>(
        sum: &mut [f32; N],
        mantissa: &[u16; N],
        exponent: i32,
        weight: &[f32; N],
    ) {
        let unit = power_of_two(exponent);
        for i in 0..N {
            sum[i] += f32::from(mantissa[i]) * unit * weight[i];
        }
    }

    #[inline(always)]
    fn collected(sum: f32) -> f32 {
        clamp(sum, 0.0, MAX_LIGHT_E)
    }

    #[inline(always)]
    fn digitise(
        signal: &Block<f32>,
        dn_per_e: f32,
        black_dn: f32,
        max_dn: u16,
        out: &mut Block<u16>,
    ) {
        let max = f32::from(max_dn);
        for i in 0..BLOCK {
            let v = clamp(signal[i] * dn_per_e + black_dn, 0.0, max);
            // The rounded integer is in the low mantissa bits.
            out[i] = (v + math::ROUNDER).to_bits() as u16;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uniform_number_next_to_one_gives_a_count_that_can_be() {
        for lambda in [0.0f32, 0.01, 0.04, 0.3, 3.0, 15.9] {
            let mut words = [u32::MAX; BLOCK];
            words.iter_mut().zip(0..).for_each(|(w, i)| *w -= i);
            let mut counts = [lambda; BLOCK];
            inversion(&mut counts, &words);
            let most = counts.iter().fold(0.0, |a: f32, &b| a.max(b));
            let whole = crate::arith::integer::inversion((lambda * 4096.0) as u32, u32::MAX);
            for count in [most as u32, whole] {
                let mean = f64::from(lambda);
                let chance = (1..=count).fold((-mean).exp(), |p, k| p * mean / f64::from(k));
                // 64 of 2³² numbers may reach a count whose chance is of the order of 2⁻³²; one
                // more for rounding.
                assert!(
                    count == 0 || chance > 2f64.powi(43).recip(),
                    "{lambda}: {count}, {chance:e}"
                );
            }
        }
    }
}
