//! Fourier transforms, sixteen side by side.
//!
//! A [`Fft`] transforms sixteen sequences at once: element i of all sixteen sits in one [`Lanes`], so
//! every butterfly is plain arithmetic on sixteen neighbouring values, which compilers turn into
//! whichever vector instructions the machine has. The operations and their order are the same on
//! every machine (no fused multiply-add, no library kernel chosen by processor), so the bits are too.
//!
//! Stockham autosort, decimation in frequency, mixed radix 2, 3, 4, 5; lengths 2^a·3^b·5^c.
//! Forward: X(k) = Σ x(i) e^(−2πi·ik/n); nothing is scaled in either direction.

use multiversion::multiversion;
use std::f64::consts::TAU;

/// Transforms done at once.
pub const LANES: usize = 16;

/// One element of sixteen sequences.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lanes(pub [f32; LANES]);

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

/// Sixteen complex numbers in registers.
#[derive(Clone, Copy)]
struct Complex {
    re: Lanes,
    im: Lanes,
}

impl Complex {
    const ZERO: Complex = Complex { re: Lanes::ZERO, im: Lanes::ZERO };

    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { re: self.re.plus(b.re), im: self.im.plus(b.im) }
    }

    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { re: self.re.minus(b.re), im: self.im.minus(b.im) }
    }

    #[inline(always)]
    fn scale(self, f: f32) -> Self {
        Self { re: self.re.times(f), im: self.im.times(f) }
    }

    /// −i times the value.
    #[inline(always)]
    fn minus_i(self) -> Self {
        Self { re: self.im, im: Lanes::ZERO.minus(self.re) }
    }

    #[inline(always)]
    fn turn(self, (c, s): (f32, f32)) -> Self {
        Self {
            re: self.re.times(c).minus(self.im.times(s)),
            im: self.re.times(s).plus(self.im.times(c)),
        }
    }
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
        transform(&self.stages, data, scratch);
    }

    /// Backward transform (e^(+2πi...), unscaled) of sixteen sequences in place.
    pub fn backward(&self, data: &mut Split, scratch: &mut Split) {
        std::mem::swap(&mut data.re, &mut data.im);
        transform(&self.stages, data, scratch);
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

#[multiversion(targets("x86_64+avx+avx2+avx512f+avx512vl+avx512dq+avx512bw", "x86_64+avx+avx2",))]
fn transform(stages: &[Stage], data: &mut Split, scratch: &mut Split) {
    for stage in stages {
        match stage.radix {
            2 => run::<2, Dft2>(stage, data, scratch),
            3 => run::<3, Dft3>(stage, data, scratch),
            4 => run::<4, Dft4>(stage, data, scratch),
            _ => run::<5, Dft5>(stage, data, scratch),
        }
        std::mem::swap(data, scratch);
    }
}

/// The transform of R neighbours. A trait rather than a function passed: a function value would not be
/// inlined into (and compiled for) each instruction set.
trait Butterfly<const R: usize> {
    fn apply(x: [Complex; R]) -> [Complex; R];
}

struct Dft2;
struct Dft3;
struct Dft4;
struct Dft5;

#[inline(always)]
fn run<const R: usize, B: Butterfly<R>>(stage: &Stage, source: &Split, target: &mut Split) {
    let (s, m) = (stage.stride, stage.rest);
    let n = R * m * s;
    let (sre, sim) = (&source.re[..n], &source.im[..n]);
    let (tre, tim) = (&mut target.re[..n], &mut target.im[..n]);
    for p in 0..m {
        let twiddles = &stage.twiddles[p * (R - 1)..(p + 1) * (R - 1)];
        for q in 0..s {
            lanes_are_vectors();
            let mut x = [Complex::ZERO; R];
            for (k, x) in x.iter_mut().enumerate() {
                let i = q + s * (p + m * k);
                *x = Complex { re: sre[i], im: sim[i] };
            }
            for (j, y) in B::apply(x).into_iter().enumerate() {
                let y = if j == 0 || p == 0 { y } else { y.turn(twiddles[j - 1]) };
                let i = q + s * (R * p + j);
                tre[i] = y.re;
                tim[i] = y.im;
            }
        }
    }
}

impl Butterfly<2> for Dft2 {
    #[inline(always)]
    fn apply(x: [Complex; 2]) -> [Complex; 2] {
        [x[0].add(x[1]), x[0].sub(x[1])]
    }
}

impl Butterfly<3> for Dft3 {
    #[inline(always)]
    fn apply(x: [Complex; 3]) -> [Complex; 3] {
        const HALF_SQRT3: f32 = 0.866_025_4;
        let sum = x[1].add(x[2]);
        let turned = x[1].sub(x[2]).scale(HALF_SQRT3).minus_i();
        let middle = x[0].sub(sum.scale(0.5));
        [x[0].add(sum), middle.add(turned), middle.sub(turned)]
    }
}

impl Butterfly<4> for Dft4 {
    #[inline(always)]
    fn apply(x: [Complex; 4]) -> [Complex; 4] {
        let (a, b) = (x[0].add(x[2]), x[0].sub(x[2]));
        let (c, d) = (x[1].add(x[3]), x[1].sub(x[3]).minus_i());
        [a.add(c), b.add(d), a.sub(c), b.sub(d)]
    }
}

impl Butterfly<5> for Dft5 {
    #[inline(always)]
    fn apply(x: [Complex; 5]) -> [Complex; 5] {
        // cos and sin of 72 and 144 degrees.
        const C1: f32 = 0.309_017;
        const C2: f32 = -0.809_017;
        const S1: f32 = 0.951_056_5;
        const S2: f32 = 0.587_785_25;
        let (a, b) = (x[1].add(x[4]), x[1].sub(x[4]));
        let (c, d) = (x[2].add(x[3]), x[2].sub(x[3]));
        let (m1, m2) =
            (x[0].add(a.scale(C1)).add(c.scale(C2)), x[0].add(a.scale(C2)).add(c.scale(C1)));
        let t1 = b.scale(S1).add(d.scale(S2)).minus_i();
        let t2 = b.scale(S2).sub(d.scale(S1)).minus_i();
        [x[0].add(a).add(c), m1.add(t1), m2.add(t2), m2.sub(t2), m1.sub(t1)]
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
