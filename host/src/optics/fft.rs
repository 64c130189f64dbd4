//! Fourier transforms, sixteen side by side.
//!
//! A [`Fft`] transforms sixteen sequences at once: element i of all sixteen sits in one [`Lanes`], so
//! every butterfly is plain arithmetic on whole vector registers, of whichever width the machine has.
//! The operations and their order are the same on
//! every machine (no fused multiply-add, no library kernel chosen by processor), so the bits are too.
//!
//! Stockham autosort, decimation in frequency, mixed radix 2, 3, 4, 5; lengths 2^a·3^b·5^c.
//! Forward: X(k) = Σ x(i) e^(−2πi·ik/n); nothing is scaled in either direction.

use bytemuck::{cast_slice, cast_slice_mut};
use pulp::{Arch, Simd, WithSimd, bytemuck};
use std::f64::consts::TAU;

/// Transforms done at once.
pub const LANES: usize = 16;

/// One element of sixteen sequences.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lanes(pub [f32; LANES]);

// SAFETY: sixteen f32 without padding; any bits are values of it.
unsafe impl bytemuck::Zeroable for Lanes {}
// SAFETY: as above; `repr(C)`, `Copy`, no interior mutability, no references.
unsafe impl bytemuck::Pod for Lanes {}

impl Lanes {
    /// Sixteen zeros.
    pub const ZERO: Lanes = Lanes([0.0; LANES]);

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = [0.0; LANES];
        for (o, (a, b)) in out.iter_mut().zip(self.0.into_iter().zip(other.0)) {
            *o = f(a, b);
        }
        Lanes(out)
    }

    /// Lane by lane sum.
    #[inline(always)]
    pub fn plus(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }

    /// Lane by lane difference.
    #[inline(always)]
    pub fn minus(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }

    /// Lane by lane product.
    #[inline(always)]
    pub fn product(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }

    /// Every lane times one factor.
    #[inline(always)]
    pub fn times(self, factor: f32) -> Self {
        Lanes(self.0.map(|a| a * factor))
    }
}

/// Keeps the compiler from vectorising a loop over elements, which it would do with strided gathers:
/// the vectors are the lanes. Costs nothing.
#[inline(always)]
pub fn lanes_are_vectors() {
    std::hint::black_box(());
}

/// Complex numbers in as many of the lanes as a register of the machine holds.
#[derive(Clone, Copy)]
pub struct Complex<S: Simd> {
    /// Real parts.
    pub re: S::f32s,
    /// Imaginary parts.
    pub im: S::f32s,
}

impl<S: Simd> Complex<S> {
    /// a + b.
    #[inline(always)]
    pub fn add(self, simd: S, b: Self) -> Self {
        Self { re: simd.add_f32s(self.re, b.re), im: simd.add_f32s(self.im, b.im) }
    }

    /// a − b.
    #[inline(always)]
    pub fn sub(self, simd: S, b: Self) -> Self {
        Self { re: simd.sub_f32s(self.re, b.re), im: simd.sub_f32s(self.im, b.im) }
    }

    /// a·b, without fused operations.
    #[inline(always)]
    pub fn mul(self, simd: S, b: Self) -> Self {
        let m = |a, b| simd.mul_f32s(a, b);
        Self {
            re: simd.sub_f32s(m(self.re, b.re), m(self.im, b.im)),
            im: simd.add_f32s(m(self.re, b.im), m(self.im, b.re)),
        }
    }

    /// A real factor times the value.
    #[inline(always)]
    fn scale(self, simd: S, factor: f32) -> Self {
        let f = simd.splat_f32s(factor);
        Self { re: simd.mul_f32s(self.re, f), im: simd.mul_f32s(self.im, f) }
    }

    /// x·(s·−i).
    #[inline(always)]
    fn minus_i_times(self, simd: S, factor: f32) -> Self {
        Self {
            re: simd.mul_f32s(self.im, simd.splat_f32s(factor)),
            im: simd.mul_f32s(self.re, simd.splat_f32s(-factor)),
        }
    }
}

/// The registers that sixteen lanes take.
#[inline(always)]
pub fn registers<S: Simd>() -> usize {
    LANES / S::F32_LANES
}

struct Stage {
    radix: usize,
    /// Length of the remaining transforms after this stage.
    rest: usize,
    /// Transforms already interleaved.
    stride: usize,
    /// `rest * (radix - 1)` factors e^(−2πi·p·j/(radix·rest)), for p, then j = 1...
    twiddles: Vec<(f32, f32)>,
}

/// A transform of one length; see the module documentation.
pub struct Fft {
    length: usize,
    stages: Vec<Stage>,
}

/// Smallest length of at least `n` that [`Fft`] can transform.
pub fn good_length(n: usize) -> usize {
    (n.max(1)..).find(|&m| factors(m).is_some()).unwrap_or(n)
}

fn factors(mut n: usize) -> Option<Vec<usize>> {
    let mut out = Vec::new();
    for radix in [4, 5, 3, 2] {
        while n.is_multiple_of(radix) {
            out.push(radix);
            n /= radix;
        }
    }
    (n == 1).then_some(out)
}

impl Fft {
    /// Plans transforms of `length`, which [`good_length`] gives.
    ///
    /// # Panics
    /// When the length has a prime factor above 5 or is 0.
    pub fn new(length: usize) -> Self {
        let radices = factors(length);
        assert!(length > 0 && radices.is_some(), "no transform of length {length}");
        let (mut rest, mut stride, mut stages) = (length, 1, Vec::new());
        for radix in radices.unwrap_or_default() {
            rest /= radix;
            let n = (radix * rest) as f64;
            let twiddles = (0..rest)
                .flat_map(|p| (1..radix).map(move |j| (p * j) as f64))
                .map(|turns| {
                    let (s, c) = libm::sincos(-TAU * turns / n);
                    (c as f32, s as f32)
                })
                .collect();
            stages.push(Stage { radix, rest, stride, twiddles });
            stride *= radix;
        }
        Self { length, stages }
    }

    /// Number of elements of each of the sixteen sequences.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Forward transform of sixteen sequences in place.
    pub fn forward(&self, data: &mut Split, scratch: &mut Split) {
        Arch::new().dispatch(Transform { stages: &self.stages, data, scratch });
    }

    /// Backward transform (e^(+2πi...), unscaled) of sixteen sequences in place.
    pub fn backward(&self, data: &mut Split, scratch: &mut Split) {
        std::mem::swap(&mut data.re, &mut data.im);
        self.forward(data, scratch);
        std::mem::swap(&mut data.re, &mut data.im);
    }
}

/// Sixteen complex sequences: real and imaginary parts apart.
#[derive(Clone)]
pub struct Split {
    /// Real parts.
    pub re: Vec<Lanes>,
    /// Imaginary parts.
    pub im: Vec<Lanes>,
}

impl Split {
    /// Sequences of `length` zeros.
    pub fn zeros(length: usize) -> Self {
        Self { re: vec![Lanes::ZERO; length], im: vec![Lanes::ZERO; length] }
    }

    /// Sets everything to 0.
    pub fn clear(&mut self) {
        self.re.fill(Lanes::ZERO);
        self.im.fill(Lanes::ZERO);
    }
}

/// All stages of a transform; the bounds of [`Simd`] types carry the instruction set.
struct Transform<'a> {
    stages: &'a [Stage],
    data: &'a mut Split,
    scratch: &'a mut Split,
}

impl WithSimd for Transform<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for stage in self.stages {
            match stage.radix {
                2 => run::<S, 2, Dft2>(simd, stage, self.data, self.scratch),
                3 => run::<S, 3, Dft3>(simd, stage, self.data, self.scratch),
                4 => run::<S, 4, Dft4>(simd, stage, self.data, self.scratch),
                _ => run::<S, 5, Dft5>(simd, stage, self.data, self.scratch),
            }
            std::mem::swap(self.data, self.scratch);
        }
    }
}

#[inline(always)]
fn run<S: Simd, const R: usize, B: Butterfly<R>>(
    simd: S,
    stage: &Stage,
    source: &Split,
    target: &mut Split,
) {
    let w = registers::<S>();
    let (s, m) = (stage.stride * w, stage.rest);
    let n = R * m * s;
    let (sre, sim) = (
        &S::as_simd_f32s(cast_slice(&source.re)).0[..n],
        &S::as_simd_f32s(cast_slice(&source.im)).0[..n],
    );
    let tre = &mut S::as_mut_simd_f32s(cast_slice_mut(&mut target.re)).0[..n];
    let tim = &mut S::as_mut_simd_f32s(cast_slice_mut(&mut target.im)).0[..n];
    for p in 0..m {
        let twiddles = &stage.twiddles[p * (R - 1)..(p + 1) * (R - 1)];
        for q in 0..s {
            let x: [Complex<S>; R] = std::array::from_fn(|k| {
                let i = q + s * (p + m * k);
                Complex { re: sre[i], im: sim[i] }
            });
            let y = B::apply(simd, x);
            for j in 0..R {
                let mut y = y[j];
                if j > 0 && p > 0 {
                    let (c, s) = twiddles[j - 1];
                    y = y.mul(simd, Complex { re: simd.splat_f32s(c), im: simd.splat_f32s(s) });
                }
                let i = q + s * (R * p + j);
                tre[i] = y.re;
                tim[i] = y.im;
            }
        }
    }
}

/// The transform of R neighbours.
trait Butterfly<const R: usize> {
    fn apply<S: Simd>(simd: S, x: [Complex<S>; R]) -> [Complex<S>; R];
}

struct Dft2;
struct Dft3;
struct Dft4;
struct Dft5;

impl Butterfly<2> for Dft2 {
    #[inline(always)]
    fn apply<S: Simd>(simd: S, [a, b]: [Complex<S>; 2]) -> [Complex<S>; 2] {
        [a.add(simd, b), a.sub(simd, b)]
    }
}

impl Butterfly<3> for Dft3 {
    #[inline(always)]
    fn apply<S: Simd>(simd: S, [a, b, c]: [Complex<S>; 3]) -> [Complex<S>; 3] {
        const HALF_SQRT3: f32 = 0.866_025_4;
        let sum = b.add(simd, c);
        let turned = b.sub(simd, c).minus_i_times(simd, HALF_SQRT3);
        let middle = a.sub(simd, sum.scale(simd, 0.5));
        [a.add(simd, sum), middle.add(simd, turned), middle.sub(simd, turned)]
    }
}

impl Butterfly<4> for Dft4 {
    #[inline(always)]
    fn apply<S: Simd>(simd: S, x: [Complex<S>; 4]) -> [Complex<S>; 4] {
        let (a, b) = (x[0].add(simd, x[2]), x[0].sub(simd, x[2]));
        let (c, d) = (x[1].add(simd, x[3]), x[1].sub(simd, x[3]));
        // b ∓ i·d, written out: multiplying by ±i only exchanges parts.
        let down = Complex { re: simd.add_f32s(b.re, d.im), im: simd.sub_f32s(b.im, d.re) };
        let up = Complex { re: simd.sub_f32s(b.re, d.im), im: simd.add_f32s(b.im, d.re) };
        [a.add(simd, c), down, a.sub(simd, c), up]
    }
}

impl Butterfly<5> for Dft5 {
    #[inline(always)]
    fn apply<S: Simd>(simd: S, x: [Complex<S>; 5]) -> [Complex<S>; 5] {
        // cos and sin of 72 and 144 degrees.
        const C1: f32 = 0.309_017;
        const C2: f32 = -0.809_017;
        const S1: f32 = 0.951_056_5;
        const S2: f32 = 0.587_785_25;
        let (a, b) = (x[1].add(simd, x[4]), x[1].sub(simd, x[4]));
        let (c, d) = (x[2].add(simd, x[3]), x[2].sub(simd, x[3]));
        let blend = |p, q| x[0].add(simd, a.scale(simd, p)).add(simd, c.scale(simd, q));
        let turn = |p, q| b.minus_i_times(simd, p).add(simd, d.minus_i_times(simd, q));
        let (m1, m2) = (blend(C1, C2), blend(C2, C1));
        let (t1, t2) = (turn(S1, S2), turn(S2, -S1));
        [
            x[0].add(simd, a).add(simd, c),
            m1.add(simd, t1),
            m2.add(simd, t2),
            m2.sub(simd, t2),
            m1.sub(simd, t1),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(seed: usize) -> f32 {
        ((seed.wrapping_mul(2_654_435_761) >> 7) % 1000) as f32 / 500.0 - 1.0
    }

    #[test]
    fn equals_the_sum_that_defines_it() {
        for n in [1, 2, 3, 4, 5, 6, 8, 12, 20, 45, 60, 96, 150] {
            let fft = Fft::new(n);
            let mut data = Split::zeros(n);
            for i in 0..n {
                for l in 0..LANES {
                    data.re[i].0[l] = noise(i * 31 + l);
                    data.im[i].0[l] = noise(i * 57 + l + 9);
                }
            }
            let before = data.clone();
            let mut scratch = Split::zeros(n);
            fft.forward(&mut data, &mut scratch);
            for l in [0, 7, 15] {
                for k in 0..n {
                    let (mut re, mut im) = (0.0, 0.0);
                    for i in 0..n {
                        let (s, c) = (-TAU * ((i * k) % n) as f64 / n as f64).sin_cos();
                        let (a, b) = (f64::from(before.re[i].0[l]), f64::from(before.im[i].0[l]));
                        re += a * c - b * s;
                        im += a * s + b * c;
                    }
                    // f32 butterflies: a few 2⁻²⁴ of the norm √n per stage.
                    let tolerance = 1e-6 * (n as f64).sqrt() + 1e-6;
                    assert!((f64::from(data.re[k].0[l]) - re).abs() < tolerance, "n {n} k {k}");
                    assert!((f64::from(data.im[k].0[l]) - im).abs() < tolerance, "n {n} k {k}");
                }
            }
            fft.backward(&mut data, &mut scratch);
            for i in 0..n {
                for l in 0..LANES {
                    let back = data.re[i].0[l] / n as f32;
                    assert!((back - before.re[i].0[l]).abs() < 3e-6, "n {n}");
                }
            }
        }
    }

    #[test]
    fn good_lengths_have_small_factors() {
        assert_eq!([1, 7, 11, 13, 97, 127].map(good_length), [1, 8, 12, 15, 100, 128]);
    }
}
