//! One pass over memory: read R elements, apply a butterfly, multiply by twiddle factors, write.

use super::butterflies::{Butterfly, Dft2, Dft3, Dft4, Dft5, Dft6, Dft8, Dft9};
use super::real::{Lanes, Real};
use super::vector::Complex;
use super::{Split, Stage};
use pulp::Simd;

/// Source of a stage's input; indices count registers.
pub trait Input<S: Simd, T: Real>: Copy {
    /// The value of a register.
    fn read(&self, simd: S, i: usize) -> Complex<S, T>;
}

/// Destination of a stage's output; indices count registers.
pub trait Output<S: Simd, T: Real> {
    /// Takes the values of registers `first`, `first + step`, ...
    fn write<const R: usize>(
        &mut self,
        simd: S,
        first: usize,
        step: usize,
        values: [Complex<S, T>; R],
    );
}

/// A buffer that a stage reads.
#[derive(Clone, Copy)]
pub struct Reader<'a, S: Simd, T: Real> {
    /// Real parts.
    pub re: &'a [T::Vector<S>],
    /// Imaginary parts.
    pub im: &'a [T::Vector<S>],
}

/// A buffer that a stage writes.
pub struct Writer<'a, S: Simd, T: Real> {
    /// Real parts.
    pub re: &'a mut [T::Vector<S>],
    /// Imaginary parts.
    pub im: &'a mut [T::Vector<S>],
}

/// Real and imaginary parts, each times weights of its own; 0 beyond the end of the data.
#[derive(Clone, Copy)]
pub struct Weighted<'a, S: Simd, T: Real> {
    /// Real parts.
    re: &'a [T::Vector<S>],
    /// Imaginary parts, as many.
    im: &'a [T::Vector<S>],
    re_weights: &'a [T],
    im_weights: &'a [T],
}

impl<'a, S: Simd, T: Real> Weighted<'a, S, T> {
    /// Parts and their weights, as many of each.
    #[inline(always)]
    #[must_use]
    pub fn new(re: (&'a [Lanes<T>], &'a [T]), im: (&'a [Lanes<T>], &'a [T])) -> Self {
        let n = re.0.len();
        Self {
            re: T::vectors::<S>(re.0),
            im: &T::vectors::<S>(im.0)[..n * T::registers::<S>()],
            re_weights: &re.1[..n],
            im_weights: &im.1[..n],
        }
    }
}

/// Multiplies a spectrum by each of several kernels and accumulates each product in its own sum.
pub struct Products<'a, T: Real> {
    /// The kernels.
    pub kernels: &'a [KernelPart<'a, T>],
    /// The sums.
    pub sums: &'a mut [Split<T>],
    /// Whether the products replace the sums; otherwise they are added.
    pub first: bool,
}

/// Real and imaginary parts of a kernel's spectrum.
pub type KernelPart<'a, T> = (&'a [Lanes<T>], &'a [Lanes<T>]);

impl<S: Simd, T: Real> Input<S, T> for Reader<'_, S, T> {
    #[inline(always)]
    fn read(&self, _simd: S, i: usize) -> Complex<S, T> {
        Complex { re: self.re[i], im: self.im[i] }
    }
}

impl<S: Simd, T: Real> Input<S, T> for Weighted<'_, S, T> {
    #[inline(always)]
    fn read(&self, simd: S, i: usize) -> Complex<S, T> {
        if i >= self.re.len() {
            return Complex::zero(simd);
        }
        let element = i / T::registers::<S>();
        Complex {
            re: T::times(simd, self.re[i], T::splat(simd, self.re_weights[element])),
            im: T::times(simd, self.im[i], T::splat(simd, self.im_weights[element])),
        }
    }
}

impl<S: Simd, T: Real> Output<S, T> for Writer<'_, S, T> {
    #[inline(always)]
    fn write<const R: usize>(
        &mut self,
        _simd: S,
        first: usize,
        step: usize,
        values: [Complex<S, T>; R],
    ) {
        for (j, value) in values.iter().enumerate() {
            self.re[first + step * j] = value.re;
            self.im[first + step * j] = value.im;
        }
    }
}

impl<S: Simd, T: Real> Output<S, T> for Products<'_, T> {
    #[inline(always)]
    fn write<const R: usize>(
        &mut self,
        simd: S,
        first: usize,
        step: usize,
        values: [Complex<S, T>; R],
    ) {
        for ((re, im), sum) in self.kernels.iter().zip(&mut *self.sums) {
            let kernel = Reader::<S, T> { re: T::vectors::<S>(re), im: T::vectors::<S>(im) };
            let sum = sum.writer::<S>();
            for (j, value) in values.iter().enumerate() {
                let i = first + step * j;
                let product = value.mul(simd, kernel.read(simd, i));
                let total = match self.first {
                    true => product,
                    false => Complex { re: sum.re[i], im: sum.im[i] }.add(simd, product),
                };
                (sum.re[i], sum.im[i]) = (total.re, total.im);
            }
        }
    }
}

/// Runs one stage.
#[inline(always)]
pub fn pass<S: Simd, T: Real, I: Input<S, T>, O: Output<S, T>>(
    simd: S,
    stage: &Stage<T>,
    input: I,
    output: O,
) {
    match stage.radix {
        2 => run::<S, T, 2, Dft2, I, O>(simd, stage, input, output),
        3 => run::<S, T, 3, Dft3, I, O>(simd, stage, input, output),
        4 => run::<S, T, 4, Dft4, I, O>(simd, stage, input, output),
        5 => run::<S, T, 5, Dft5, I, O>(simd, stage, input, output),
        6 => run::<S, T, 6, Dft6, I, O>(simd, stage, input, output),
        8 => run::<S, T, 8, Dft8, I, O>(simd, stage, input, output),
        _ => run::<S, T, 9, Dft9, I, O>(simd, stage, input, output),
    }
}

#[inline(always)]
fn run<S: Simd, T: Real, const R: usize, B: Butterfly<R>, I: Input<S, T>, O: Output<S, T>>(
    simd: S,
    stage: &Stage<T>,
    input: I,
    mut output: O,
) {
    let (s, m) = (stage.stride * T::registers::<S>(), stage.rest);
    for p in 0..m {
        let twiddles = &stage.twiddles[p * (R - 1)..(p + 1) * (R - 1)];
        for q in 0..s {
            let mut x = [Complex::zero(simd); R];
            for (k, x) in x.iter_mut().enumerate() {
                *x = input.read(simd, q + s * (p + m * k));
            }
            let mut y = B::apply(simd, x);
            if p > 0 {
                for j in 1..R {
                    y[j] = y[j].turned(simd, twiddles[j - 1]);
                }
            }
            output.write(simd, q + s * R * p, s, y);
        }
    }
}
