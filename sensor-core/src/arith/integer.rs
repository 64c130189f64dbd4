//! Elementary functions and random distributions in 32-bit integers with 64-bit products, for
//! parts without an FPU.
//!
//! They use the same random words as those in f32 and agree with them within the errors stated;
//! constants are computed at compile time from the closed forms. Qn means n fractional bits.

use core::f64::consts::{LN_2, PI, SQRT_2};

/// Rounds a constant to n fractional bits.
const fn q(x: f64, bits: u32) -> i64 {
    let scaled = x * (1u64 << bits) as f64;
    if scaled < 0.0 { (scaled - 0.5) as i64 } else { (scaled + 0.5) as i64 }
}

const fn q30(x: f64) -> i32 {
    q(x, 30) as i32
}

/// a * b of which the lowest `bits` bits are rounded away.
#[inline(always)]
pub(super) fn mul(a: i32, b: i32, bits: u32) -> i64 {
    (i64::from(a) * i64::from(b) + (1 << (bits - 1))) >> bits
}

/// a * b in Q30.
#[inline(always)]
fn mul30(a: i32, b: i32) -> i32 {
    mul(a, b, 30) as i32
}

/// Polynomial in x, coefficients from the highest power down, all in Q30.
#[inline(always)]
fn horner(x: i32, coefficients: &[i32]) -> i32 {
    coefficients.iter().fold(0, |p, &c| mul30(p, x) + c)
}

/// −2 ln((w + ½) 2⁻³²) in Q30; error below 4e-9.
fn minus_two_ln(w: u32) -> u64 {
    // ln(1 + f) = f − f²/2 + f³ P(f); P as in `math::ln` (Cephes logf).
    const P: [i32; 9] = [
        q30(7.037_683_629_2e-2),
        q30(-1.151_461_031_0e-1),
        q30(1.167_699_874_0e-1),
        q30(-1.242_014_084_6e-1),
        q30(1.424_932_278_7e-1),
        q30(-1.666_805_766_5e-1),
        q30(2.000_071_476_5e-1),
        q30(-2.499_999_399_3e-1),
        q30(3.333_333_117_4e-1),
    ];
    const ROOT_HALF: u64 = q(SQRT_2 / 2.0, 32) as u64;
    let x = 2 * u64::from(w) + 1;
    // x 2⁻³³ = m 2⁻ⁿ with m between √½ and √2, m in Q32.
    let shift = x.leading_zeros() - 31;
    let m = (x << shift) >> 1;
    let (m, n) = if m < ROOT_HALF { (m << 1, shift + 1) } else { (m, shift) };
    // Within -0.293..0.415, so Q30 holds it.
    let f = ((m as i64 - (1 << 32)) >> 2) as i32;
    let f2 = mul30(f, f);
    let ln = f - (f2 >> 1) + mul30(mul30(f2, f), horner(f, &P));
    let t = i64::from(n) * 2 * q(LN_2, 30) - 2 * i64::from(ln);
    t.max(0) as u64
}

/// 1/√x for x in Q32 between ¼ and 1, in Q30; relative error below 1e-8.
#[inline(always)]
fn rsqrt_mantissa(x: u32) -> u32 {
    // Quadratic through 1/√x at the Chebyshev points of the interval: within 2.1 %.
    const START: [i64; 3] = [q(1.610_4, 30), q(-3.147_7, 30), q(2.556_8, 30)];
    let x = u64::from(x);
    let start = ((START[0] * x as i64) >> 32) + START[1];
    let mut y = ((start * x as i64) >> 32) + START[2];
    for _ in 0..3 {
        // y ← y (3 − x y²) / 2
        let y2 = (y * y) >> 30;
        let xy2 = ((x * y2 as u64) >> 32) as i64;
        y = (y * ((3 << 30) - xy2)) >> 31;
    }
    y as u32
}

/// x = m 4⁻ˢ with m in Q32 between ¼ and 1 for x != 0 in Q32: (m, s).
#[inline(always)]
fn normalise(x: u64) -> (u32, i32) {
    let s = (x.leading_zeros() as i32 - 32) >> 1;
    let m = if s < 0 { x >> (-2 * s) } else { x << (2 * s) };
    (m as u32, s)
}

/// Square root of a number of 64 or less in Q30, in Q28; error below 1e-8 of the number's root or
/// 2⁻²⁸.
fn sqrt28(x: u64) -> i32 {
    if x == 0 {
        return 0;
    }
    let (m, s) = normalise(x << 2);
    let root = (u64::from(m) * u64::from(rsqrt_mantissa(m))) >> 32;
    // root in Q30, times 2⁻ˢ.
    let shift = s + 2;
    if shift >= 0 {
        (((root << 1) >> shift.min(40)) as i32 + 1) >> 1
    } else {
        (root << (-shift)) as i32
    }
}

/// A direction, uniform over the circle, as in `math::box_muller`: (cos, sin) in Q30; error below
/// 4e-9.
#[inline(always)]
fn direction(w: u32) -> (i32, i32) {
    const SIN: [i32; 4] =
        [q30(1.0 / 362_880.0), q30(-1.0 / 5_040.0), q30(1.0 / 120.0), q30(-1.0 / 6.0)];
    const COS: [i32; 5] = [
        q30(-1.0 / 3_628_800.0),
        q30(1.0 / 40_320.0),
        q30(-1.0 / 720.0),
        q30(1.0 / 24.0),
        q30(-1.0 / 2.0),
    ];
    // The lowest 29 bits are an angle within ±π/4.
    let t = mul((w << 3) as i32, q(PI / 4.0, 30) as i32, 31) as i32;
    let t2 = mul30(t, t);
    let s = t + mul30(mul30(horner(t2, &SIN), t2), t);
    let c = (1 << 30) + mul30(horner(t2, &COS), t2);
    let (x, y) = if w & (1 << 29) != 0 { (s, c) } else { (c, s) };
    (if w >> 31 != 0 { -x } else { x }, if (w >> 30) & 1 != 0 { -y } else { y })
}

/// A pair of standard normal numbers in Q28 (Box & Muller 1958); error below 2e-8 where the pair's
/// radius is above 0.2, below 4e-5 anywhere.
pub(super) fn box_muller(w0: u32, w1: u32) -> (i32, i32) {
    let r = sqrt28(minus_two_ln(w0));
    let (x, y) = direction(w1);
    (mul30(r, x), mul30(r, y))
}

/// See [`super::EXPANSION_FROM_E`].
pub(super) const EXPANSION_FROM: u32 = super::EXPANSION_FROM_E as u32;
/// As in `float`: at a mean of 16 the probability of a larger count is 2e-12.
const TERMS: usize = 52;

const fn exp_of_minus(x: f64) -> f64 {
    // e⁻ˣ = (e^(−x/16))^16, the inner one by its series.
    let t = -x / 16.0;
    let (mut sum, mut term, mut k) = (1.0, 1.0, 1);
    while k < 20 {
        term *= t / k as f64;
        sum += term;
        k += 1;
    }
    let p2 = sum * sum;
    let p4 = p2 * p2;
    (p4 * p4) * (p4 * p4)
}

const fn exp_table<const N: usize>(step: f64, bits: u32) -> [u64; N] {
    let mut table = [0; N];
    let mut i = 0;
    while i < N {
        table[i] = q(exp_of_minus(i as f64 * step), bits) as u64;
        i += 1;
    }
    table
}

const fn narrow(wide: [u64; 64]) -> [u32; 64] {
    let mut table = [0; 64];
    let mut i = 0;
    while i < 64 {
        table[i] = wide[i] as u32;
        i += 1;
    }
    table
}

/// e⁻ⁱ in Q56.
static EXP_WHOLE: [u64; 16] = exp_table(1.0, 56);
/// e^(−i/64) and e^(−i/4096) in Q31.
static EXP_64: [u32; 64] = narrow(exp_table(1.0 / 64.0, 31));
static EXP_4096: [u32; 64] = narrow(exp_table(1.0 / 4096.0, 31));
/// 1/k in Q31.
static INVERSE: [u32; TERMS + 1] = {
    let mut table = [0; TERMS + 1];
    let mut k = 1;
    while k <= TERMS {
        table[k] = q(1.0 / k as f64, 31) as u32;
        k += 1;
    }
    table
};

/// p f 2^-bits for p up to 2⁵⁶ with two 32-bit products, truncated.
#[inline(always)]
fn mul_wide(p: u64, f: u32, bits: u32) -> u64 {
    let (high, low) = (p >> 32, p & 0xffff_ffff);
    ((high * u64::from(f)) << (32 - bits)) + ((low * u64::from(f)) >> bits)
}

/// Probability below which the inversion stops, 2⁻³³ in Q56: see `float::NEGLIGIBLE`.
const NEGLIGIBLE: u64 = 1 << 23;

/// Poisson count for a mean below 16 (Q12) by inversion: the smallest count whose distribution
/// function, in Q56, reaches (w + ½) 2⁻³².
pub(super) fn inversion(mean: u32, w: u32) -> u32 {
    let mean = mean.min((EXPANSION_FROM << 12) - 1);
    let place = |shift: u32, size: u32| ((mean >> shift) & (size - 1)) as usize;
    let whole = EXP_WHOLE.get(place(12, 16)).copied().unwrap_or(0);
    let sixty_fourths = EXP_64.get(place(6, 64)).copied().unwrap_or(0);
    let rest = EXP_4096.get(place(0, 64)).copied().unwrap_or(0);
    let mut p = mul_wide(mul_wide(whole, sixty_fourths, 31), rest, 31);
    let u = (2 * u64::from(w) + 1) << 23;
    let mut reached = p;
    let mut count = 0;
    for &inverse in INVERSE.iter().skip(1) {
        if reached >= u || p < NEGLIGIBLE {
            break;
        }
        // mean / k in Q28.
        let ratio = ((u64::from(mean) * u64::from(inverse)) >> 15) as u32;
        p = mul_wide(p, ratio, 28);
        reached += p;
        count += 1;
    }
    count
}

/// Poisson count for a mean (Q12) of 16 and more from a normal number (Q28): floor of the
/// third-order Cornish-Fisher expansion, see `float::expansion`. Error of the expansion's value
/// below 2e-5.
pub(super) fn expansion(mean: u32, w: i32) -> u32 {
    const THIRD: i64 = q(1.0 / 3.0, 24);
    const SIXTH: i32 = q30(1.0 / 6.0);
    const SECOND: i32 = q30(1.0 / 72.0);
    const A: i32 = q30(1.0 / 270.0);
    const B: i32 = q(7.0 / 810.0, 24) as i32;
    const C: i32 = q(8.0 / 405.0, 24) as i32;
    // λ = m 4⁻ˢ, s from -10 to -3; √λ = m y 2⁻ˢ, 1/√λ = y 2ˢ.
    let (m, s) = normalise(u64::from(mean) << 20);
    let y = rsqrt_mantissa(m);
    let s = (-s).clamp(2, 10) as u32;
    let root = (((u64::from(m) * u64::from(y)) >> 32) << s >> 10) as i32; // Q20
    let inverse = (y >> s) as i32; // Q30, at most ¼
    let w2 = mul(w, w, 32) as i32; // Q24
    let first = ((i64::from(w2) * i64::from(SIXTH)) >> 30) + THIRD; // Q24
    let bend = mul(w2 + (2 << 24), SECOND, 30) as i32; // Q24
    let second = mul(mul(w, inverse, 32) as i32, bend, 26); // Q24
    let quartic = mul(w2, mul(w2, A, 30) as i32 + B, 24) as i32 - C; // Q24
    let third = mul(mul30(inverse, inverse), quartic, 30); // Q24
    let linear = mul(root, w, 28); // Q20
    let value = (i64::from(mean) << 8) + linear + ((first - second + third) >> 4);
    (value.max(0) >> 20) as u32
}

/// Poisson count for a mean (Q12) of 2¹⁸ to 2³³ from a normal number (Q28): floor of
/// λ + √λ w + (2 + w²)/6. The expansion's next term is below 0.01 there.
pub(super) fn expansion_of_many(mean: u64, w: i32) -> i64 {
    const THIRD: i64 = q(1.0 / 3.0, 24);
    const SIXTH: i32 = q30(1.0 / 6.0);
    // λ 2⁻²⁰ = m 4⁻ˢ, s from -7 to 1.
    let (m, s) = normalise(mean);
    let root = (u64::from(m) * u64::from(rsqrt_mantissa(m))) >> 32; // √m in Q30
    let root = (root >> (8 + s.clamp(-7, 1))) as i32; // √λ in Q12
    let w2 = mul(w, w, 32) as i32; // Q24
    let first = ((i64::from(w2) * i64::from(SIXTH)) >> 30) + THIRD; // Q24
    (mean as i64 + mul(root, w, 28) + (first >> 12)) >> 12
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: usize = 65_537;

    #[test]
    fn errors_against_f64_are_as_stated() {
        let two30 = (1u64 << 30) as f64;
        let (mut ln, mut trig, mut root) = (0.0f64, 0.0f64, 0.0f64);
        let words = (0..=u32::MAX).step_by(STEP).chain([0, 1, 2, u32::MAX - 1, u32::MAX]);
        for w in words {
            let want = -2.0 * ((f64::from(w) + 0.5) / 4_294_967_296.0).ln();
            ln = ln.max((minus_two_ln(w) as f64 / two30 - want).abs());
            let angle = f64::from((w << 3) as i32) / 2_147_483_648.0 * PI / 4.0;
            let (x, y) =
                if w & (1 << 29) != 0 { angle.sin_cos() } else { (angle.cos(), angle.sin()) };
            let x = if w & (1 << 31) != 0 { -x } else { x };
            let y = if w & (1 << 30) != 0 { -y } else { y };
            let got = direction(w);
            trig = trig.max((f64::from(got.0) / two30 - x).abs());
            trig = trig.max((f64::from(got.1) / two30 - y).abs());
            let x = u64::from(w) * 15;
            let want = (x as f64 / two30).sqrt();
            root = root
                .max((f64::from(sqrt28(x)) * 2f64.powi(28).recip() - want).abs() / want.max(0.25));
        }
        assert!(ln < 1e-7, "ln {ln:e}");
        assert!(trig < 4e-9, "trig {trig:e}");
        assert!(root < 1e-8, "root {root:e}");
        for x in [0, 1, 2, 3, 100, 12_345] {
            let want = (x as f64 / two30).sqrt();
            assert!((f64::from(sqrt28(x)) * 2f64.powi(28).recip() - want).abs() < 4e-9, "{x}");
        }
        let worst = (1 << 30..=u32::MAX).step_by(9_973).map(|x| {
            let y = f64::from(rsqrt_mantissa(x)) / two30;
            (y * (f64::from(x) / 4_294_967_296.0).sqrt() - 1.0).abs()
        });
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < 1e-8, "rsqrt {worst:e}");
    }

    #[test]
    fn inversion_has_the_law_of_poisson() {
        // Against the distribution function in f64: wrong only where that is within 1e-9 of the
        // uniform.
        for mean in [0, 1, 4095, 4096, 20_000, 65_535] {
            let lambda = f64::from(mean) / 4096.0;
            for w in (0..=u32::MAX).step_by(STEP * 7) {
                let u = (f64::from(w) + 0.5) / 4_294_967_296.0;
                let n = inversion(mean, w);
                let (mut p, mut below, mut cdf) = ((-lambda).exp(), 0.0, 0.0);
                for k in 0..=n {
                    p *= if k > 0 { lambda / f64::from(k) } else { 1.0 };
                    below = cdf;
                    cdf += p;
                }
                assert!(cdf > u - 1e-9 && below < u + 1e-9, "{lambda} {u}: {n}");
            }
        }
    }

    #[test]
    fn expansion_is_within_its_error() {
        for lambda in [16.0f64, 17.3, 63.9, 64.0, 1000.0, 99_999.75, 524_287.0] {
            let mean = (lambda * 4096.0) as u32;
            let (l, mut differ, mut count) = (f64::from(mean) / 4096.0, 0, 0);
            for i in -6_700..6_700 {
                let w = f64::from(i) * 1e-3;
                let q = l + l.sqrt() * w + (2.0 + w * w) / 6.0
                    - (w / 36.0 + w.powi(3) / 72.0) / l.sqrt()
                    + (-8.0 / 405.0 + 7.0 * w * w / 810.0 + w.powi(4) / 270.0) / l;
                let got = f64::from(expansion(mean, (w * 2f64.powi(28)) as i32));
                let q = q.max(0.0);
                assert!(got <= q + 2e-5 && got > q - 1.0 - 2e-5, "{l} {w}: {got} {q}");
                count += 1;
                differ += i32::from(got != q.floor());
            }
            assert!(f64::from(differ) / f64::from(count) < 1e-3);
        }
    }

    /// To 2⁻²⁸ of the square root times the normal number, and what is left out.
    #[test]
    fn expansion_of_many_is_within_its_error() {
        for lambda in [262_144.0f64, 524_288.5, 1.25e6, 1e8, 6.9e9] {
            let mean = (lambda * 4096.0) as u64;
            for i in -6_700..6_700 {
                let w = f64::from(i) * 1e-3;
                let q = lambda + lambda.sqrt() * w + (2.0 + w * w) / 6.0;
                let got = expansion_of_many(mean, (w * 2f64.powi(28)) as i32) as f64;
                let error = 1e-3 + lambda.sqrt() * 1e-7;
                assert!(got <= q + error && got > q - 1.0 - error, "{lambda} {w}: {got} {q}");
            }
        }
    }
}
