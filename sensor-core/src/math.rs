//! Elementary functions in f32 from IEEE basic operations only: the same bits on every machine,
//! and straight-line code that compilers turn into vector instructions.
//!
//! Coefficients are those of the Cephes library (Moshier, netlib, public domain). Errors measured
//! against f64 by the tests below.

use core::f32::consts::{FRAC_1_SQRT_2, LOG2_E};

const LN2_HIGH: f32 = 0.693_359_4;
const LN2_LOW: f32 = -2.121_944_4e-4;
/// 1.5 x 2²³: adding and subtracting it rounds a number below 2²² to an integer, ties to even.
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
    let z2 = z * z;
    // Evaluated in pairs (Estrin 1960): a short chain of dependent operations keeps the processor
    // busy.
    let low = (3.333_333e-1 - 2.499_999_4e-1 * f) + z * (2.000_071_4e-1 - 1.666_805_8e-1 * f);
    let high = (1.424_932_3e-1 - 1.242_014_1e-1 * f) + z * (1.167_699_9e-1 - 1.151_461e-1 * f);
    let p = low + z2 * (high + z2 * 7.037_683_6e-2);
    let y = f * z * p + k * LN2_LOW - 0.5 * z;
    (f + y) + k * LN2_HIGH
}

/// exp(x) for -87 <= x <= 88, beyond which it stays at the value of the limit; relative error
/// below 2e-7.
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    let x = x.clamp(-87.0, 88.0);
    let n = round(x * LOG2_E);
    let r = (x - n * LN2_HIGH) - n * LN2_LOW;
    let r2 = r * r;
    let high = (8.333_452e-3 + 1.398_199_9e-3 * r) + r2 * 1.987_569_1e-4;
    let p = (5.0e-1 + 1.666_666_5e-1 * r) + r2 * (4.166_579_6e-2 + r * high);
    let e = p * r2 + r + 1.0;
    e * f32::from_bits((((n + 127.0 + ROUNDER).to_bits()) & 0xff) << 23)
}

/// x to the power y for positive normal x, as exp(y ln x): relative error grows with |y ln x|.
#[inline(always)]
pub fn pow(x: f32, y: f32) -> f32 {
    exp(y * ln(x))
}

/// 1/sqrt(x) for positive normal x to 7e-4: the bits of x as its logarithm, then one Newton step,
/// with the constants of Moroz et al. 2018 (arXiv:1802.06302).
#[inline(always)]
fn rsqrt_start(x: f32) -> f32 {
    let y = f32::from_bits(0x5f1f_fff9_u32.wrapping_sub(x.to_bits() >> 1));
    0.703_952_25 * y * (2.389_244_6 - x * y * y)
}

/// 1/sqrt(x) for positive normal x; relative error below 2e-7. (Large and finite for x = 0.)
#[inline(always)]
pub fn rsqrt(x: f32) -> f32 {
    let y = rsqrt_start(x);
    // Halley step: third order.
    let d = 1.0 - x * y * y;
    y + y * d * (0.5 + 0.375 * d)
}

/// Square root of a number >= 0 and below 1e38; relative error below 1.2e-7.
#[inline(always)]
pub fn sqrt(x: f32) -> f32 {
    let y = rsqrt_start(x);
    let s = x * y;
    let d = 1.0 - s * y;
    s + s * d * (0.5 + 0.375 * d)
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

/// √(−2 ln((w + ½) 2⁻³²)), the radius of a pair of normal numbers; relative error below 6e-7.
///
/// Normal numbers are most of the work of a frame, so this uses as few multiplications as
/// possible: a minimax polynomial made for it, with the constants folded in.
#[inline(always)]
fn radius(w: u32) -> f32 {
    // w + ½ = m 2^(k + 32), m between √½ and √2.
    const BASE: u32 = FRAC_1_SQRT_2.to_bits() + (32 << 23);
    let bits = (w as f32 + 0.5).to_bits();
    let k = (bits.wrapping_sub(BASE) as i32) >> 23;
    let m = f32::from_bits(bits.wrapping_sub(32 << 23).wrapping_sub((k << 23) as u32));
    // −2 ln m = −2f + f² + f³ P(f), relative error of P's share 1.7e-7.
    let f = m - 1.0;
    let z = f * f;
    let high = (3.423_471e-1 - 3.274_660_3e-1 * f) + z * 2.127_222e-1;
    let p = (-6.667_217_4e-1 + 4.996_366e-1 * f) + z * (-3.974_817e-1 + f * high);
    let t = (((f * z) * p + z) - (f + f)) - k as f32 * (2.0 * core::f32::consts::LN_2);
    // Rounding can leave −2 ln(1) slightly below zero.
    let t = if t > 0.0 { t } else { 0.0 };
    // h = ½/√t to 6.5e-4 (Moroz et al. 2018, their two multipliers folded into the start), then
    // Newton.
    let y = f32::from_bits(0x5edf_b700_u32.wrapping_sub(t.to_bits() >> 1));
    let h = y * (1.191_066_9 - t * y * y);
    let r = (t + t) * h;
    r * (1.500_000_4 - r * h)
}

/// A direction, uniform over the circle: (cos, sin) of an angle within ±π/4 from the word's lowest
/// 29 bits, swapped and mirrored by its top bits. Absolute error below 7e-7.
#[inline(always)]
fn direction(w: u32) -> (f32, f32) {
    let v = (w << 3) as i32 as f32;
    // Minimax polynomials in v, which is the angle in units of π/4 2⁻³¹.
    let v = v * (1.0 / 2_147_483_648.0);
    let v2 = v * v;
    let s = v * (7.853_942_3e-1 + v2 * (-8.071_399_8e-2 + v2 * 2.427_105_9e-3));
    let c = 1.0 + v2 * (-3.084_245e-1 + v2 * (1.585_039_8e-2 - v2 * 3.191_601_5e-4));
    let (x, y) = if w & (1 << 29) != 0 { (s, c) } else { (c, s) };
    let sign = 1 << 31;
    (f32::from_bits(x.to_bits() ^ (w & sign)), f32::from_bits(y.to_bits() ^ ((w << 1) & sign)))
}

/// A pair of standard normal numbers from two words of 32 uniform bits (Box & Muller 1958). The
/// largest magnitude is 6.77.
#[inline(always)]
pub fn box_muller(w0: u32, w1: u32) -> (f32, f32) {
    let r = radius(w0);
    let (x, y) = direction(w1);
    (r * x, r * y)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn worst(points: impl Iterator<Item = (f32, f64, f64)>) -> f64 {
        points.map(|(got, want, scale)| (f64::from(got) - want).abs() / scale).fold(0.0, f64::max)
    }

    #[test]
    fn errors_against_f64_are_as_stated() {
        let logspace =
            || (1..200_000).map(|i| (1e-10 * libm::pow(1.000_25, f64::from(i / 2))) as f32);
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
            (
                if i.is_multiple_of(2) { s } else { c },
                if i.is_multiple_of(2) { a.sin() } else { a.cos() },
                1.0,
            )
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
    fn normals_have_the_stated_error() {
        let words = (0..1 << 20).map(|i: u32| i.wrapping_mul(4096 + 17)).chain([0, 1, 2]);
        let e = worst(words.clone().map(|w| {
            // Of the uniform number as f32 holds it; towards 1 the radius goes to 0.
            let u = f64::from(w as f32 + 0.5) / 4_294_967_296.0;
            let want = (-2.0 * u.ln()).sqrt();
            (radius(w), want, want.max(1e-3))
        }));
        assert!(e < 6e-7, "radius {e}");
        let e = worst(words.map(|w| {
            let angle =
                f64::from((w << 3) as i32) / 2_147_483_648.0 * core::f64::consts::FRAC_PI_4;
            let (x, y) = if w & (1 << 29) != 0 {
                (angle.sin(), angle.cos())
            } else {
                (angle.cos(), angle.sin())
            };
            let (x, y) =
                (if w >> 31 != 0 { -x } else { x }, if (w >> 30) & 1 != 0 { -y } else { y });
            let got = direction(w);
            if w & 64 != 0 { (got.0, x, 1.0) } else { (got.1, y, 1.0) }
        }));
        assert!(e < 7e-7, "direction {e}");
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
