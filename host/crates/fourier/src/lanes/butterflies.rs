//! Butterflies: transforms of two to nine elements in registers.

use super::real::Real;
use super::vector::Complex;
use pulp::Simd;
use std::f64::consts::FRAC_1_SQRT_2;

/// The transform of R elements.
pub trait Butterfly<const R: usize> {
    /// Transforms one sequence in every lane.
    fn apply<S: Simd, T: Real>(simd: S, x: [Complex<S, T>; R]) -> [Complex<S, T>; R];
}

/// Radix 2.
pub struct Dft2;
/// Radix 3.
pub struct Dft3;
/// Radix 4.
pub struct Dft4;
/// Radix 5.
pub struct Dft5;
/// Radix 6.
pub struct Dft6;
/// Radix 8.
pub struct Dft8;
/// Radix 9.
pub struct Dft9;

impl Butterfly<2> for Dft2 {
    #[inline(always)]
    fn apply<S: Simd, T: Real>(simd: S, [a, b]: [Complex<S, T>; 2]) -> [Complex<S, T>; 2] {
        [a.add(simd, b), a.sub(simd, b)]
    }
}

impl Butterfly<3> for Dft3 {
    #[inline(always)]
    fn apply<S: Simd, T: Real>(simd: S, [a, b, c]: [Complex<S, T>; 3]) -> [Complex<S, T>; 3] {
        const HALF_SQRT3: f64 = 0.866_025_403_784_438_6;
        let sum = b.add(simd, c);
        let turned = b.sub(simd, c).minus_i_times(simd, T::of(HALF_SQRT3));
        let middle = a.sub(simd, sum.scale(simd, T::of(0.5)));
        [a.add(simd, sum), middle.add(simd, turned), middle.sub(simd, turned)]
    }
}

impl Butterfly<4> for Dft4 {
    #[inline(always)]
    fn apply<S: Simd, T: Real>(simd: S, x: [Complex<S, T>; 4]) -> [Complex<S, T>; 4] {
        let (a, b) = (x[0].add(simd, x[2]), x[0].sub(simd, x[2]));
        let (c, d) = (x[1].add(simd, x[3]), x[1].sub(simd, x[3]));
        // b ∓ i·d, written out: multiplying by ±i only exchanges parts.
        let down = Complex { re: T::plus(simd, b.re, d.im), im: T::minus(simd, b.im, d.re) };
        let up = Complex { re: T::minus(simd, b.re, d.im), im: T::plus(simd, b.im, d.re) };
        [a.add(simd, c), down, a.sub(simd, c), up]
    }
}

impl Butterfly<5> for Dft5 {
    #[inline(always)]
    fn apply<S: Simd, T: Real>(simd: S, x: [Complex<S, T>; 5]) -> [Complex<S, T>; 5] {
        // cos and sin of 72 and 144 degrees.
        const C1: f64 = 0.309_016_994_374_947_45;
        const C2: f64 = -0.809_016_994_374_947_5;
        const S1: f64 = 0.951_056_516_295_153_5;
        const S2: f64 = 0.587_785_252_292_473_1;
        let [c1, c2, s1, s2] = [C1, C2, S1, S2].map(T::of);
        let (a, b) = (x[1].add(simd, x[4]), x[1].sub(simd, x[4]));
        let (c, d) = (x[2].add(simd, x[3]), x[2].sub(simd, x[3]));
        let m1 = x[0].add(simd, a.scale(simd, c1)).add(simd, c.scale(simd, c2));
        let m2 = x[0].add(simd, a.scale(simd, c2)).add(simd, c.scale(simd, c1));
        let t1 = b.minus_i_times(simd, s1).add(simd, d.minus_i_times(simd, s2));
        let t2 = b.minus_i_times(simd, s2).add(simd, d.minus_i_times(simd, T::of(-S1)));
        [
            x[0].add(simd, a).add(simd, c),
            m1.add(simd, t1),
            m2.add(simd, t2),
            m2.sub(simd, t2),
            m1.sub(simd, t1),
        ]
    }
}

impl Butterfly<6> for Dft6 {
    /// 2 x 3 with coprime factors, so no twiddle factors between them (Good 1958).
    #[inline(always)]
    fn apply<S: Simd, T: Real>(simd: S, x: [Complex<S, T>; 6]) -> [Complex<S, T>; 6] {
        let even = Dft3::apply(simd, [x[0], x[2], x[4]]);
        let odd = Dft3::apply(simd, [x[3], x[5], x[1]]);
        let a = Dft2::apply(simd, [even[0], odd[0]]);
        let b = Dft2::apply(simd, [even[1], odd[1]]);
        let c = Dft2::apply(simd, [even[2], odd[2]]);
        [a[0], b[1], c[0], a[1], b[0], c[1]]
    }
}

impl Butterfly<8> for Dft8 {
    #[inline(always)]
    fn apply<S: Simd, T: Real>(simd: S, x: [Complex<S, T>; 8]) -> [Complex<S, T>; 8] {
        let even = Dft4::apply(simd, [x[0], x[2], x[4], x[6]]);
        let odd = Dft4::apply(simd, [x[1], x[3], x[5], x[7]]);
        // Multiplied by e^(−2πi·k/8), k = 1, 3, 2.
        let Complex { re, im } = odd[1];
        let first = Complex { re: T::plus(simd, re, im), im: T::minus(simd, im, re) }
            .scale(simd, T::of(FRAC_1_SQRT_2));
        let Complex { re, im } = odd[3];
        let third =
            Complex { re: T::minus(simd, im, re), im: T::negated(simd, T::plus(simd, re, im)) }
                .scale(simd, T::of(FRAC_1_SQRT_2));
        let Complex { re, im } = odd[2];
        let down =
            Complex { re: T::plus(simd, even[2].re, im), im: T::minus(simd, even[2].im, re) };
        let up = Complex { re: T::minus(simd, even[2].re, im), im: T::plus(simd, even[2].im, re) };
        [
            even[0].add(simd, odd[0]),
            even[1].add(simd, first),
            down,
            even[3].add(simd, third),
            even[0].sub(simd, odd[0]),
            even[1].sub(simd, first),
            up,
            even[3].sub(simd, third),
        ]
    }
}

impl Butterfly<9> for Dft9 {
    #[inline(always)]
    fn apply<S: Simd, T: Real>(simd: S, x: [Complex<S, T>; 9]) -> [Complex<S, T>; 9] {
        // e^(−2πi·k/9) for k = 1, 2, 4.
        const ONE: (f64, f64) = (0.766_044_443_118_978, -0.642_787_609_686_539_3);
        const TWO: (f64, f64) = (0.173_648_177_666_930_41, -0.984_807_753_012_208);
        const FOUR: (f64, f64) = (-0.939_692_620_785_908_4, -0.342_020_143_325_668_9);
        let [one, two, four] = [ONE, TWO, FOUR].map(|(c, s)| (T::of(c), T::of(s)));
        let a = Dft3::apply(simd, [x[0], x[3], x[6]]);
        let b = Dft3::apply(simd, [x[1], x[4], x[7]]);
        let c = Dft3::apply(simd, [x[2], x[5], x[8]]);
        let u = Dft3::apply(simd, [a[0], b[0], c[0]]);
        let v = Dft3::apply(simd, [a[1], b[1].turned(simd, one), c[1].turned(simd, two)]);
        let w = Dft3::apply(simd, [a[2], b[2].turned(simd, two), c[2].turned(simd, four)]);
        [u[0], v[0], w[0], u[1], v[1], w[1], u[2], v[2], w[2]]
    }
}
