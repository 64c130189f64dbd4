//! Elementary functions in f32 from IEEE basic operations only: the same bits on every machine, and
//! straight-line code that compilers turn into vector instructions.
//!
//! Coefficients are those of the Cephes library (Moshier, netlib, public domain). Errors measured
//! against f64 by the tests below.

use core::f32::consts::{FRAC_1_SQRT_2, LOG2_E};

const LN2_HIGH: f32 = 0.693_359_4;
const LN2_LOW: f32 = -2.121_944_4e-4;
/// Adding and subtracting it rounds a number below 2²² to an integer, ties to even.
pub(crate) const ROUNDER: f32 = 12_582_912.0;

/// Nearest integer, ties to even, for |x| < 2²².
#[inline(always)]
pub fn round(x: f32) -> f32 {
    (x + ROUNDER) - ROUNDER
}

/// Natural logarithm of a positive normal number; error below 2e-7 of max(1, |ln x|).
#[inline(always)]
pub fn ln(x: f32) -> f32 {
    const BASE: u32 = FRAC_1_SQRT_2.to_bits();
    let bits = x.to_bits();
    let k = (bits.wrapping_sub(BASE) as i32) >> 23;
    let m = f32::from_bits(bits.wrapping_sub((k << 23) as u32));
    let (f, k) = (m - 1.0, k as f32);
    let z = f * f;
    let mut p = 7.037_683_6e-2;
    p = p * f - 1.151_461e-1;
    p = p * f + 1.167_699_9e-1;
    p = p * f - 1.242_014_1e-1;
    p = p * f + 1.424_932_3e-1;
    p = p * f - 1.666_805_8e-1;
    p = p * f + 2.000_071_4e-1;
    p = p * f - 2.499_999_4e-1;
    p = p * f + 3.333_333_2e-1;
    let y = f * z * p + k * LN2_LOW - 0.5 * z;
    (f + y) + k * LN2_HIGH
}

/// exp(x) for -87 <= x <= 88 (outside, the value at the limit); relative error below 2e-7.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    let x = x.clamp(-87.0, 88.0);
    let n = round(x * LOG2_E);
    let r = (x - n * LN2_HIGH) - n * LN2_LOW;
    let mut p = 1.987_569_1e-4;
    p = p * r + 1.398_199_9e-3;
    p = p * r + 8.333_452e-3;
    p = p * r + 4.166_579_6e-2;
    p = p * r + 1.666_666_5e-1;
    p = p * r + 5.0e-1;
    let e = p * (r * r) + r + 1.0;
    e * f32::from_bits((((n + 127.0 + ROUNDER).to_bits()) & 0xff) << 23)
}

/// x to the power y for positive normal x, as exp(y ln x): relative error grows with |y ln x|.
#[inline(always)]
pub fn pow(x: f32, y: f32) -> f32 {
    exp(y * ln(x))
}

/// 1/sqrt(x) for positive normal x; relative error below 2e-7. (Large and finite for x = 0.)
#[inline(always)]
pub fn rsqrt(x: f32) -> f32 {
    let mut y = f32::from_bits(0x5f37_59df_u32.wrapping_sub(x.to_bits() >> 1));
    let half = 0.5 * x;
    y *= 1.5 - half * y * y;
    y *= 1.5 - half * y * y;
    y *= 1.5 - half * y * y;
    y
}

/// Square root of a number >= 0 and below 1e38; within one unit in the last place.
#[inline(always)]
pub fn sqrt(x: f32) -> f32 {
    let y = rsqrt(x);
    let s = x * y;
    s + 0.5 * y * (x - s * s)
}

/// Sine and cosine of an angle in units of 2⁻³² turns; absolute error below 1.2e-7.
#[inline(always)]
pub fn sin_cos_turns(turns: u32) -> (f32, f32) {
    const STEP: f32 = (core::f64::consts::TAU / 4_294_967_296.0) as f32;
    let quadrant = turns.wrapping_add(1 << 29) >> 30;
    let t = (turns.wrapping_sub(quadrant << 30) as i32) as f32 * STEP;
    let t2 = t * t;
    let s = ((-1.951_529_6e-4 * t2 + 8.332_161e-3) * t2 - 1.666_665_5e-1) * t2 * t + t;
    let c = ((2.443_315_7e-5 * t2 - 1.388_731_6e-3) * t2 + 4.166_664_6e-2) * t2 * t2 - 0.5 * t2;
    let c = c + 1.0;
    let swap = quadrant & 1 != 0;
    let (sin, cos) = if swap { (c, s) } else { (s, c) };
    let sin_sign = (quadrant & 2) << 30;
    let cos_sign = (quadrant.wrapping_add(1) & 2) << 30;
    (f32::from_bits(sin.to_bits() ^ sin_sign), f32::from_bits(cos.to_bits() ^ cos_sign))
}

/// Sine of an angle in turns (any size below 2²²).
#[inline(always)]
pub fn sin_turns(turns: f32) -> f32 {
    let part = turns - round(turns);
    sin_cos_turns((part * 4_294_967_296.0) as i64 as u32).0
}

/// A pair of standard normal numbers from two words of 32 uniform bits (Box & Muller 1958). The largest
/// magnitude is 6.77.
#[inline(always)]
pub fn box_muller(w0: u32, w1: u32) -> (f32, f32) {
    let u = (w0 as f32 + 0.5) * (1.0 / 4_294_967_296.0);
    let t = -2.0 * ln(u);
    // Rounding can leave ln(1) a hair above zero.
    let r = sqrt(if t > 0.0 { t } else { 0.0 });
    let (s, c) = sin_cos_turns(w1);
    (r * c, r * s)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn worst(points: impl Iterator<Item = (f32, f64, f64)>) -> f64 {
        points.map(|(got, want, scale)| (f64::from(got) - want).abs() / scale).fold(0.0, f64::max)
    }

    #[test]
    fn errors_against_f64_are_as_stated() {
        let logspace = || (1..200_000).map(|i| (1e-10 * 1.000_25f64.powi(i / 2)) as f32);
        let e = worst(logspace().map(|x| {
            let want = f64::from(x).ln();
            (ln(x), want, want.abs().max(1.0))
        }));
        assert!(e < 2e-7, "ln {e}");
        let e = worst(logspace().map(|x| (sqrt(x), f64::from(x).sqrt(), f64::from(x).sqrt())));
        assert!(e < 1.2e-7, "sqrt {e}");
        let e = worst((-8700..8800).map(|i| {
            let x = i as f32 * 0.01;
            (exp(x), f64::from(x).exp(), f64::from(x).exp())
        }));
        assert!(e < 2e-7, "exp {e}");
        let e = worst((0..1 << 20).map(|i: u32| {
            let w = i.wrapping_mul(4096 + 17);
            let a = f64::from(w) / 4_294_967_296.0 * core::f64::consts::TAU;
            let (s, c) = sin_cos_turns(w);
            (if i % 2 == 0 { s } else { c }, if i % 2 == 0 { a.sin() } else { a.cos() }, 1.0)
        }));
        assert!(e < 1.2e-7, "sin, cos {e}");
        let e = worst((-1000..1000).map(|i| {
            let x = i as f32 * 0.0173;
            (sin_turns(x), (f64::from(x) * core::f64::consts::TAU).sin(), 1.0)
        }));
        assert!(e < 1e-6, "sin_turns {e}");
        assert_eq!(sqrt(0.0), 0.0);
        assert_eq!((round(2.5), round(3.5), round(-0.5), round(7.49)), (2.0, 4.0, 0.0, 7.0));
    }

    #[test]
    fn extreme_words_give_finite_normals() {
        for w0 in [0, 1, u32::MAX] {
            for w1 in [0, 1, 1 << 29, 1 << 31, u32::MAX] {
                let (a, b) = box_muller(w0, w1);
                assert!(a.abs() < 6.77 && b.abs() < 6.77, "{w0} {w1}: {a} {b}");
            }
        }
    }
}
