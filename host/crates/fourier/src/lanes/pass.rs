//! One pass over memory: read R elements, apply a butterfly, multiply by twiddle factors, write.

use super::butterflies::{Butterfly, Dft2, Dft3, Dft4, Dft5, Dft6, Dft8, Dft9};
use super::vector::{Complex, Lanes, registers, vectors};
use super::{Split, Stage};
use pulp::Simd;

/// Source of a stage's input; indices count registers.
pub trait Input<S: Simd>: Copy {
    /// The value of a register.
    fn read(&self, simd: S, i: usize) -> Complex<S>;
}

/// Destination of a stage's output; indices count registers.
pub trait Output<S: Simd> {
    /// Takes the values of registers `first`, `first + step`, ...
    fn write<const R: usize>(
        &mut self,
        simd: S,
        first: usize,
        step: usize,
        values: [Complex<S>; R],
    );
}

/// A buffer that a stage reads.
#[derive(Clone, Copy)]
pub struct Reader<'a, S: Simd> {
    /// Real parts.
    pub re: &'a [S::f32s],
    /// Imaginary parts.
    pub im: &'a [S::f32s],
}

/// A buffer that a stage writes.
pub struct Writer<'a, S: Simd> {
    /// Real parts.
    pub re: &'a mut [S::f32s],
    /// Imaginary parts.
    pub im: &'a mut [S::f32s],
}

/// Real and imaginary parts, each times weights of its own; 0 beyond the end of the data.
#[derive(Clone, Copy)]
pub struct Weighted<'a, S: Simd> {
    /// Real parts.
    re: &'a [S::f32s],
    /// Imaginary parts, as many.
    im: &'a [S::f32s],
    re_weights: &'a [f32],
    im_weights: &'a [f32],
}

impl<'a, S: Simd> Weighted<'a, S> {
    /// Parts and their weights, as many of each.
    #[inline(always)]
    #[must_use]
    pub fn new(re: (&'a [Lanes], &'a [f32]), im: (&'a [Lanes], &'a [f32])) -> Self {
        let n = re.0.len();
        Self {
            re: vectors::<S>(re.0),
            im: &vectors::<S>(im.0)[..n * registers::<S>()],
            re_weights: &re.1[..n],
            im_weights: &im.1[..n],
        }
    }
}

/// Multiplies a spectrum by each of several kernels and accumulates each product in its own sum.
pub struct Products<'a> {
    /// The kernels.
    pub kernels: &'a [KernelPart<'a>],
    /// The sums.
    pub sums: &'a mut [Split],
    /// Whether the products replace the sums; otherwise they are added.
    pub first: bool,
}

/// Real and imaginary parts of a kernel's spectrum.
pub type KernelPart<'a> = (&'a [Lanes], &'a [Lanes]);

impl<S: Simd> Input<S> for Reader<'_, S> {
    #[inline(always)]
    fn read(&self, _simd: S, i: usize) -> Complex<S> {
        Complex { re: self.re[i], im: self.im[i] }
    }
}

impl<S: Simd> Input<S> for Weighted<'_, S> {
    #[inline(always)]
    fn read(&self, simd: S, i: usize) -> Complex<S> {
        if i >= self.re.len() {
            return Complex::zero(simd);
        }
        let element = i / registers::<S>();
        Complex {
            re: simd.mul_f32s(self.re[i], simd.splat_f32s(self.re_weights[element])),
            im: simd.mul_f32s(self.im[i], simd.splat_f32s(self.im_weights[element])),
        }
    }
}

impl<S: Simd> Output<S> for Writer<'_, S> {
    #[inline(always)]
    fn write<const R: usize>(
        &mut self,
        _simd: S,
        first: usize,
        step: usize,
        values: [Complex<S>; R],
    ) {
        for (j, value) in values.iter().enumerate() {
            self.re[first + step * j] = value.re;
            self.im[first + step * j] = value.im;
        }
    }
}

impl<S: Simd> Output<S> for Products<'_> {
    #[inline(always)]
    fn write<const R: usize>(
        &mut self,
        simd: S,
        first: usize,
        step: usize,
        values: [Complex<S>; R],
    ) {
        for ((re, im), sum) in self.kernels.iter().zip(&mut *self.sums) {
            let kernel = Reader::<S> { re: vectors::<S>(re), im: vectors::<S>(im) };
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
pub fn pass<S: Simd, I: Input<S>, O: Output<S>>(simd: S, stage: &Stage, input: I, output: O) {
    match stage.radix {
        2 => run::<S, 2, Dft2, I, O>(simd, stage, input, output),
        3 => run::<S, 3, Dft3, I, O>(simd, stage, input, output),
        4 => run::<S, 4, Dft4, I, O>(simd, stage, input, output),
        5 => run::<S, 5, Dft5, I, O>(simd, stage, input, output),
        6 => run::<S, 6, Dft6, I, O>(simd, stage, input, output),
        8 => run::<S, 8, Dft8, I, O>(simd, stage, input, output),
        _ => run::<S, 9, Dft9, I, O>(simd, stage, input, output),
    }
}

#[inline(always)]
fn run<S: Simd, const R: usize, B: Butterfly<R>, I: Input<S>, O: Output<S>>(
    simd: S,
    stage: &Stage,
    input: I,
    mut output: O,
) {
    let (s, m) = (stage.stride * registers::<S>(), stage.rest);
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
