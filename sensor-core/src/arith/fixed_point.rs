//! Fixed-point arithmetic.

use super::{Arith, BLOCK, Block, Counts, integer};
use crate::stream::{LANES, Lanes};
use fixed::types::{I4F28, I20F12};

/// 32-bit fixed point: signals in steps of 2⁻¹² e⁻ up to ±524 287 e⁻, factors in steps of 2⁻²⁸
/// within ±8.
///
/// In the range of light a signal is the same up to 2¹⁸ e⁻; from there its 32 bits count steps of
/// 2⁻⁸ e⁻ up to 2²⁰ e⁻, which is above any full well, and of 8 e⁻ beyond. The code rises with its
/// signal, so signals compare as their codes do.
///
/// No operation per pixel needs an FPU; single values per row or per group of pixels are converted
/// from f32.
///
/// # Error budget
/// Mean photo-electrons to DN, against f64 with the same irradiance: the parts are the collected
/// sum (half a step of 2⁻²⁰ e⁻ and 2⁻³⁰ of the largest weight per band), its rounding to a signal
/// (2⁻¹³ e⁻), one such rounding per stage, and the scale of the converter (24 bits: 2⁻²⁴ of the
/// signal). With 12 bits and a full well of 2 ke⁻ or more a step of the converter is G 4095 / W <
/// 33 DN/e⁻ at gain 16, so that a dozen stages stay within 0.05 DN before the rounding to a whole
/// DN: the raw is within 1 DN of the reference, and differs from it at all for pixels that close
/// to a half. `tests/error_budget.rs` measures it.
#[derive(Clone, Copy, Debug)]
pub struct FixedIn<const LIGHT: bool>;

/// 32-bit fixed point.
pub type Fixed = FixedIn<false>;

/// Fractional bits of a weight: differences of weights of 0..=1 fit 32 bits with a sign.
const WEIGHT_BITS: u32 = 30;
/// Fractional bits of a sum.
const SUM_BITS: u32 = 20;
/// Fractional bits of a signal.
const SIGNAL_BITS: u32 = 12;
/// Fractional bits of a factor.
const FACTOR_BITS: u32 = 28;

/// Nearest whole number of steps, saturated; 0 for NaN.
#[inline(always)]
fn to_bits(x: f32, bits: u32) -> i32 {
    let scaled = x * (1u64 << bits) as f32;
    // From 2²³ on there is no fraction left to round.
    let half = if scaled.abs() < 8_388_608.0 { 0.5f32.copysign(scaled) } else { 0.0 };
    (scaled + half) as i32
}

/// Codes of light from which steps are 2⁻⁸ e⁻ (2¹⁸ e⁻) and 8 e⁻ (2²⁰ e⁻).
const FINE_TO: i32 = 1 << 30;
const MEDIUM_TO: i32 = FINE_TO + (3 << 26);
/// Bits by which those steps are larger than 2⁻¹² e⁻.
const MEDIUM_BITS: u32 = 4;
const COARSE_BITS: u32 = 15;
/// 2²⁰ e⁻ in steps of 2⁻¹² e⁻.
const COARSE_FROM: i64 = 1 << (20 + SIGNAL_BITS);

/// The light of a code, in steps of 2⁻¹² e⁻.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn light_of(code: i32) -> i64 {
    let code = i64::from(code);
    let (fine, medium) = (i64::from(FINE_TO), i64::from(MEDIUM_TO));
    code + ((1 << MEDIUM_BITS) - 1) * (code - fine).max(0)
        + ((1 << COARSE_BITS) - (1 << MEDIUM_BITS)) * (code - medium).max(0)
}

/// The code of light in steps of 2⁻¹² e⁻: the nearest, saturated.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn code_of(light: i64) -> i32 {
    let above = |from: i64, bits: u32| (light - from + (1 << (bits - 1))) >> bits;
    if light < i64::from(FINE_TO) {
        saturate(light)
    } else if light < COARSE_FROM {
        FINE_TO + above(FINE_TO.into(), MEDIUM_BITS) as i32
    } else {
        saturate(i64::from(MEDIUM_TO).saturating_add(above(COARSE_FROM, COARSE_BITS)))
    }
}

/// x m 2^-bits, rounded and saturated, for x of less than 2⁴⁶ and m of less than 2³¹.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn mul_long(x: i64, m: i32, bits: u32) -> i64 {
    let (high, low) = (x >> 16, x & 0xffff);
    let m = i64::from(m);
    let product = high * m + ((low * m) >> 16); // in units of 2¹⁶
    match bits.checked_sub(17) {
        Some(less) => (product + (1 << less)) >> less >> 1,
        None => product.saturating_mul(1 << (16 - bits)),
    }
}

#[inline(always)]
fn saturate(wide: i64) -> i32 {
    wide.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32
}

/// x rounded to whole numbers of 2⁻ᵇⁱᵗˢ, ties to even.
#[inline(always)]
fn round_even(x: i64, bits: u32) -> i64 {
    let half = 1i64 << (bits - 1);
    (x + half - 1 + ((x >> bits) & 1)) >> bits
}

#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn normals_of(lanes: &mut Lanes) -> Block<I4F28> {
    let (a, b) = (lanes.draw(), lanes.draw());
    let mut out = [I4F28::ZERO; BLOCK];
    let (cosines, sines) = out.split_at_mut(LANES);
    for (((&a, &b), c), s) in a.iter().zip(&b).zip(cosines).zip(sines) {
        let pair = integer::box_muller(a, b);
        *c = I4F28::from_bits(pair.0);
        *s = I4F28::from_bits(pair.1);
    }
    out
}

/// A Poisson count for a mean, both in steps of 2⁻¹² e⁻, from a uniform or a normal number.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
fn count_of(mean: i64, uniform: u32, normal: i32) -> i64 {
    let count = if mean < i64::from(integer::EXPANSION_FROM << SIGNAL_BITS) {
        integer::inversion(mean.max(0) as u32, uniform).into()
    } else if mean < i64::from(FINE_TO) {
        integer::expansion(mean as u32, normal).into()
    } else {
        integer::expansion_of_many(mean as u64, normal)
    };
    count << SIGNAL_BITS
}

impl<const LIGHT: bool> FixedIn<LIGHT> {
    /// Steps of 2⁻¹² e⁻ of a signal.
    #[inline(always)]
    fn steps(s: I20F12) -> i64 {
        if LIGHT { light_of(s.to_bits()) } else { s.to_bits().into() }
    }

    /// The signal of so many steps, saturated.
    #[inline(always)]
    fn of_steps(steps: i64) -> I20F12 {
        I20F12::from_bits(if LIGHT { code_of(steps) } else { saturate(steps) })
    }

    /// Whether a signal is not a code of more light than charge has steps for.
    #[inline(always)]
    fn is_fine(s: I20F12) -> bool {
        !LIGHT || s.to_bits() < FINE_TO
    }
}

impl<const LIGHT: bool> Arith for FixedIn<LIGHT> {
    type Light = FixedIn<true>;
    type Signal = I20F12;
    type Factor = I4F28;
    /// Units of 2⁻²⁰ e⁻.
    type Sum = u64;
    /// Units of 2⁻³⁰.
    type Weight = u32;

    #[inline(always)]
    fn signal(e: f32) -> I20F12 {
        if LIGHT && e >= (1 << 18) as f32 {
            // No fraction of a step is lost: f32 has 24 bits.
            return Self::of_steps((e * (1u32 << SIGNAL_BITS) as f32) as i64);
        }
        I20F12::from_bits(to_bits(e, SIGNAL_BITS))
    }

    #[inline(always)]
    fn factor(f: f32) -> I4F28 {
        I4F28::from_bits(to_bits(f, FACTOR_BITS))
    }

    #[inline(always)]
    fn electrons(s: I20F12) -> f32 {
        Self::steps(s) as f32 * (1.0 / (1u32 << SIGNAL_BITS) as f32)
    }

    #[inline(always)]
    fn number(f: I4F28) -> f32 {
        f.to_bits() as f32 * (1.0 / (1u32 << FACTOR_BITS) as f32)
    }

    #[inline(always)]
    fn add(a: I20F12, b: I20F12) -> I20F12 {
        if LIGHT { Self::of_steps(Self::steps(a) + Self::steps(b)) } else { a.saturating_add(b) }
    }

    #[inline(always)]
    fn sub(a: I20F12, b: I20F12) -> I20F12 {
        if LIGHT { Self::of_steps(Self::steps(a) - Self::steps(b)) } else { a.saturating_sub(b) }
    }

    #[inline(always)]
    fn scale(s: I20F12, f: I4F28) -> I20F12 {
        Self::of_steps(if Self::is_fine(s) {
            integer::mul(s.to_bits(), f.to_bits(), FACTOR_BITS)
        } else {
            mul_long(Self::steps(s), f.to_bits(), FACTOR_BITS)
        })
    }

    #[inline(always)]
    fn times(s: I20F12, gain: f32) -> I20F12 {
        // The gain is its 24-bit mantissa by a power of two.
        let word = gain.to_bits();
        let exponent = (word >> 23 & 0xff) as i32;
        let size = (word & 0x7f_ffff | u32::from(exponent > 0) << 23) as i32;
        let mantissa = if gain < 0.0 { -size } else { size };
        let down = 150 - exponent.max(1);
        let steps = Self::steps(s);
        Self::of_steps(if down < 1 {
            steps.saturating_mul(mantissa.into()).saturating_mul(1 << (-down).min(62))
        } else if Self::is_fine(s) {
            let down = down.min(62) as u32;
            (i64::from(s.to_bits()) * i64::from(mantissa) + (1 << (down - 1))) >> down
        } else {
            mul_long(steps, mantissa, down.min(62) as u32)
        })
    }

    #[inline(always)]
    fn held(light: I20F12) -> I20F12 {
        I20F12::from_bits(saturate(light_of(light.to_bits())))
    }

    #[inline(always)]
    fn gain(sigma: I4F28, n: I4F28) -> I4F28 {
        let part = integer::mul(sigma.to_bits(), n.to_bits(), FACTOR_BITS);
        I4F28::from_bits(saturate((1 << FACTOR_BITS) + part))
    }

    #[inline(always)]
    fn normals(lanes: &mut Lanes) -> Block<I4F28> {
        normals_of(lanes)
    }

    #[inline(always)]
    fn poisson(means: &mut [Block<I20F12>], counts: &mut Counts) {
        for mean in means {
            let uniform =
                counts.uniform.as_mut().map_or([[0; LANES]; 2], |l| [l.draw(), l.draw()]);
            let normal = counts.normal.as_mut().map_or([I4F28::ZERO; BLOCK], normals_of);
            for ((m, &word), normal) in mean.iter_mut().zip(uniform.as_flattened()).zip(normal) {
                *m = Self::of_steps(count_of(Self::steps(*m), word, normal.to_bits()));
            }
        }
    }

    #[inline(always)]
    fn weight(w: f32) -> u32 {
        to_bits(w, WEIGHT_BITS).clamp(0, 1 << WEIGHT_BITS) as u32
    }

    #[inline(always)]
    fn lerp(a: &[u32; 16], b: &[u32; 16], first: f32, step: f32) -> [u32; 16] {
        let one = 1i64 << WEIGHT_BITS;
        // Clamped, far beyond any distance that matters, so that the sums below cannot overflow.
        let fraction = |f: f32| (f.clamp(-1e8, 1e8) * one as f32) as i64;
        let (mut t, step) = (fraction(first), fraction(step));
        let mut out = [0; 16];
        for ((out, &a), &b) in out.iter_mut().zip(a).zip(b) {
            let part = integer::mul(t.clamp(0, one) as i32, b as i32 - a as i32, WEIGHT_BITS);
            *out = (i64::from(a) + part) as u32;
            t += step;
        }
        out
    }

    #[inline(always)]
    fn accumulate<const N: usize>(
        sum: &mut [u64; N],
        mantissa: &[u16; N],
        exponent: i32,
        weight: &[u32; N],
    ) {
        let shift = exponent + SUM_BITS as i32 - WEIGHT_BITS as i32;
        let parts = sum.iter_mut().zip(mantissa).zip(weight);
        if shift < 0 {
            let down = (-shift).min(63) as u32;
            let half = 1u64 << (down - 1);
            for ((sum, &m), &w) in parts {
                *sum = sum.saturating_add((u64::from(m) * u64::from(w) + half) >> down);
            }
        } else {
            // Far above any full well: only the saturation has to be right.
            for ((sum, &m), &w) in parts {
                let part = u64::from(m) * u64::from(w);
                let fits = shift < part.leading_zeros() as i32;
                *sum = sum.saturating_add(if fits { part << shift } else { u64::MAX });
            }
        }
    }

    #[inline(always)]
    fn collected(sum: u64) -> I20F12 {
        let down = SUM_BITS - SIGNAL_BITS;
        let rounded = sum.saturating_add(1 << (down - 1)) >> down;
        I20F12::from_bits(code_of(rounded as i64)) // of 56 bits
    }

    #[inline(always)]
    fn digitise(
        signal: &Block<I20F12>,
        dn_per_e: f32,
        black_dn: f32,
        max_dn: u16,
        out: &mut Block<u16>,
    ) {
        // Keeps all 24 bits of the f32 in the scale wherever the fraction of a DN then fits 64
        // bits.
        let exponent = (dn_per_e.to_bits() >> 23) as i32 - 127;
        let scale_bits = (23 - exponent).clamp(4, 32) as u32;
        let bits = scale_bits + SIGNAL_BITS;
        let scale = i64::from(to_bits(dn_per_e, scale_bits));
        let black = (black_dn * (1u64 << bits) as f32) as i64;
        for (out, s) in out.iter_mut().zip(signal) {
            let dn = round_even(i64::from(s.to_bits()) * scale + black, bits);
            *out = dn.clamp(0, i64::from(max_dn)) as u16;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arith::Float;
    use crate::stream::Key;

    fn counts(mean: f32) -> Counts {
        Counts::new(Key::new(9).lanes(), Key::new(10).lanes(), mean < 16.0, mean >= 16.0)
    }

    /// Normals of both arithmetics from the same words.
    #[test]
    fn normals_agree_with_f32() {
        let (mut a, mut b) = (Key::new(3).lanes(), Key::new(3).lanes());
        let (mut worst, mut sum) = (0.0f64, 0.0f64);
        let blocks = 20_000;
        for _ in 0..blocks {
            let (x, y) = (Fixed::normals(&mut a), Float::normals(&mut b));
            for i in 0..BLOCK {
                // Errors of radius and direction in f32; and it holds u to 2⁻²⁵ near 1, a radius
                // to 2⁻²⁵/r.
                let j = i % LANES;
                let r = f64::from(y[j]).hypot(f64::from(y[j + LANES])).max(3e-4);
                let d = (x[i].to_num::<f64>() - f64::from(y[i])).abs();
                worst = worst.max(d / (1.3e-6 * r + 2f64.powi(25).recip() / r));
                sum += d;
            }
        }
        assert!(worst < 1.0, "{worst}");
        let mean = sum / f64::from(blocks * BLOCK as i32);
        assert!(mean < 5e-7, "{mean:e}");
    }

    /// Counts of both arithmetics from the same words: the same but where rounding of f32 moves
    /// the value over a whole number.
    #[test]
    fn poisson_agrees_with_f32() {
        // Means that both hold exactly. Allowed: the rounding error of f32, of the distribution
        // function (a few 2⁻²⁴) below 16, of the count (a few times 2⁻²⁴ of it) from there on.
        for (lambda, allowed) in [
            (0.0, 0.0),
            (0.3125, 1e-5),
            (3.0, 1e-5),
            (15.875, 3e-5),
            (16.0, 1e-4),
            (900.0, 1e-3),
            (3e4, 1e-2),
        ] {
            let mut a = counts(lambda);
            let mut b = counts(lambda);
            let (mut differ, blocks) = (0, 4000);
            for _ in 0..blocks {
                let mut x = [Fixed::signal(lambda); BLOCK];
                let mut y = [lambda; BLOCK];
                Fixed::poisson(core::slice::from_mut(&mut x), &mut a);
                Float::poisson(core::slice::from_mut(&mut y), &mut b);
                for (x, y) in x.iter().zip(y) {
                    let d = (Fixed::electrons(*x) - y).abs();
                    assert!(d <= 1.0, "{lambda}: {x} {y}");
                    differ += u32::from(d != 0.0);
                }
            }
            let share = f64::from(differ) / f64::from(blocks * BLOCK as u32);
            assert!(share <= allowed, "{lambda}: {share:e}");
        }
    }

    #[test]
    fn converter_rounds_ties_to_even_and_clamps() {
        let mut dn = [0; BLOCK];
        let signals = [0.5, 1.5, 2.5, -0.5, -1.5, -100.0, 300.0, 255.4];
        let mut block = [I20F12::ZERO; BLOCK];
        for (b, s) in block.iter_mut().zip(signals) {
            *b = Fixed::signal(s);
        }
        Fixed::digitise(&block, 1.0, 2.0, 255, &mut dn);
        assert_eq!(dn[..8], [2, 4, 4, 2, 0, 0, 255, 255]);
        let mut float = [0; BLOCK];
        Float::digitise(&block.map(Fixed::electrons), 1.0, 2.0, 255, &mut float);
        assert_eq!(dn, float);
        for scale in [1e-30, 1e-3, 1e3, 1e30] {
            Fixed::digitise(&block, scale, 2.0, 65_535, &mut dn);
            let top = if scale > 1.0 { 65_535 } else { 2 };
            assert_eq!(dn[6], if scale == 1e3 { 65_535 } else { top }, "{scale}");
        }
    }

    #[test]
    fn extremes_saturate() {
        assert_eq!(Fixed::signal(f32::INFINITY), I20F12::MAX);
        assert_eq!(Fixed::signal(f32::NAN), I20F12::ZERO);
        assert_eq!(Fixed::add(I20F12::MAX, I20F12::MAX), I20F12::MAX);
        assert_eq!(Fixed::scale(I20F12::MIN, I4F28::MAX), I20F12::MIN);
        let mut sum = [0; 16];
        for exponent in [i32::MIN / 2, -100, 0, 9, 40, 100] {
            Fixed::accumulate(&mut sum, &[u16::MAX; 16], exponent, &[1 << 30; 16]);
        }
        assert_eq!(Fixed::collected(sum[0]), I20F12::MAX);
        assert_eq!(Fixed::held(I20F12::MAX), I20F12::MAX);
        let mut block = [I20F12::MAX; BLOCK];
        Fixed::poisson(core::slice::from_mut(&mut block), &mut counts(1e6));
        assert!(block.iter().all(|b| Fixed::electrons(*b) > 5e5));
        let ends = Fixed::lerp(&[0; 16], &[1 << 30; 16], -3.0, 1e30);
        assert_eq!((ends[0], ends[1]), (0, 1 << 30));
    }
}
