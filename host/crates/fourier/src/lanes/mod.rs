//! Fourier transforms, sixteen side by side.
//!
//! A [`Fft`] transforms sixteen sequences at once: element i of all sixteen sits in one [`Lanes`],
//! so every butterfly is plain arithmetic on whole vector registers, of whichever width the
//! machine has. The operations and their order are the same on every machine (no fused
//! multiply-add, no library kernel chosen by processor), and so are the bits of the result.
//!
//! Stockham autosort, decimation in frequency, mixed radix 2, 3, 4, 5, 6, 8, 9; lengths
//! 2^a·3^b·5^c. Passes over memory limit the speed of a transform, so radices are large and few.
//! The first pass may weight what it reads (`Input`), and the last may multiply by kernels and
//! accumulate instead of writing (`Output`).
//!
//! Everything exists in f32, and in f64 for what has more range: the rounding of f32 spreads some
//! 2e-8 of the largest value over a whole plane.
//!
//! Forward: X(k) = Σ x(i)·e^(−2πi·ik/n); nothing is scaled in either direction.

mod butterflies;
mod pass;
mod real;
mod transpose;
mod vector;

use pass::{Input, Output, Reader, Writer, pass};
pub use pass::{KernelPart, Products, Weighted};
use pulp::{Arch, Simd, WithSimd};
pub use real::{LANES, Lanes, Real};
use std::f64::consts::TAU;
pub use transpose::transpose;

struct Stage<T> {
    radix: usize,
    /// Length of the remaining transforms after this stage.
    rest: usize,
    /// Transforms already interleaved.
    stride: usize,
    /// `rest * (radix - 1)` factors e^(−2πi·p·j/(radix·rest)), for p, then j = 1...
    twiddles: Vec<(T, T)>,
}

/// A plan for transforms of one length; see the module documentation.
pub struct Fft<T = f32> {
    length: usize,
    stages: Vec<Stage<T>>,
}

/// Smallest length of at least `n` that [`Fft`] can transform.
#[must_use]
pub fn good_length(n: usize) -> usize {
    let smooth = |m: &usize| {
        let without = |m: usize, prime: usize| {
            std::iter::successors(Some(m), |m| m.is_multiple_of(prime).then(|| m / prime)).last()
        };
        [2, 3, 5].into_iter().try_fold(*m, without) == Some(1)
    };
    (n.max(1)..).find(smooth).unwrap_or(n)
}

/// Radices of the stages, largest first.
const RADICES: [usize; 7] = [9, 8, 6, 5, 4, 3, 2];

/// The fewest radices whose product is `n`, large ones first.
fn factors(n: usize) -> Option<Vec<usize>> {
    if n == 1 {
        return Some(Vec::new());
    }
    let fitting = RADICES.into_iter().filter(|&radix| n.is_multiple_of(radix));
    let all = fitting.filter_map(|radix| {
        let mut radices = factors(n / radix)?;
        radices.push(radix);
        Some(radices)
    });
    let mut fewest = all.min_by_key(Vec::len)?;
    fewest.sort_unstable_by(|a, b| b.cmp(a));
    Some(fewest)
}

/// Passes over memory of a transform of length `n`; `n` is a length that [`good_length`] returns.
#[must_use]
pub fn passes(n: usize) -> usize {
    factors(n).map_or(0, |radices| radices.len())
}

impl<T: Real> Fft<T> {
    /// Plans transforms of `length`, a length that [`good_length`] returns.
    ///
    /// # Panics
    /// When the length has a prime factor above 5 or is 0.
    #[must_use]
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
                    (T::of(c), T::of(s))
                })
                .collect();
            stages.push(Stage { radix, rest, stride, twiddles });
            stride *= radix;
        }
        Self { length, stages }
    }

    /// Number of elements of each of the sixteen sequences.
    #[must_use]
    pub fn length(&self) -> usize {
        self.length
    }

    /// Forward transform of sixteen sequences in place.
    pub fn forward(&self, data: &mut Split<T>, scratch: &mut Split<T>) {
        middle(&self.stages, data, scratch);
    }

    /// Backward transform (e^(+2πi...), unscaled) of sixteen sequences in place.
    pub fn backward(&self, data: &mut Split<T>, scratch: &mut Split<T>) {
        std::mem::swap(&mut data.re, &mut data.im);
        self.forward(data, scratch);
        std::mem::swap(&mut data.re, &mut data.im);
    }

    /// Forward transform of `input` into `data`.
    #[inline(always)]
    pub fn forward_from<S: Simd>(
        &self,
        simd: S,
        input: Weighted<'_, S, T>,
        data: &mut Split<T>,
        scratch: &mut Split<T>,
    ) {
        leading(simd, &self.stages, input, data, scratch);
    }

    /// Forward transform of `input`; its spectrum goes into the products and sums of `output`.
    /// `data` and `scratch` are overwritten.
    #[inline(always)]
    pub fn forward_into<S: Simd>(
        &self,
        simd: S,
        input: Weighted<'_, S, T>,
        data: &mut Split<T>,
        scratch: &mut Split<T>,
        mut output: Products<'_, T>,
    ) {
        let (first, last) = match self.stages.as_slice() {
            [first @ .., last] if !first.is_empty() => (first, Some(last)),
            all => (all, None),
        };
        leading(simd, first, input, data, scratch);
        match last {
            Some(last) => pass(simd, last, data.reader(), output),
            None => (0..self.length * T::registers::<S>())
                .for_each(|i| output.write(simd, i, 0, [data.reader().read(simd, i)])),
        }
    }
}

/// Sixteen complex sequences: real and imaginary parts apart.
#[derive(Clone)]
pub struct Split<T = f32> {
    /// Real parts.
    pub re: Vec<Lanes<T>>,
    /// Imaginary parts.
    pub im: Vec<Lanes<T>>,
}

impl<T: Real> Split<T> {
    /// Sequences of `length` zeros.
    #[must_use]
    pub fn zeros(length: usize) -> Self {
        Self { re: vec![Lanes::ZERO; length], im: vec![Lanes::ZERO; length] }
    }

    #[inline(always)]
    fn reader<S: Simd>(&self) -> Reader<'_, S, T> {
        Reader { re: T::vectors::<S>(&self.re), im: T::vectors::<S>(&self.im) }
    }

    #[inline(always)]
    fn writer<S: Simd>(&mut self) -> Writer<'_, S, T> {
        Writer { re: T::vectors_mut::<S>(&mut self.re), im: T::vectors_mut::<S>(&mut self.im) }
    }

    /// Sets everything to 0.
    pub fn clear(&mut self) {
        self.re.fill(Lanes::ZERO);
        self.im.fill(Lanes::ZERO);
    }
}

/// The stages at the beginning of a transform: from `input` into `data`.
#[inline(always)]
fn leading<S: Simd, T: Real>(
    simd: S,
    stages: &[Stage<T>],
    input: Weighted<'_, S, T>,
    data: &mut Split<T>,
    scratch: &mut Split<T>,
) {
    match stages.split_first() {
        Some((first, rest)) => {
            pass(simd, first, input, data.writer());
            middle(rest, data, scratch);
        }
        // A transform of length 1.
        None => (0..T::registers::<S>())
            .for_each(|i| data.writer().write(simd, i, 0, [input.read(simd, i)])),
    }
}

/// Stages that read and write memory, with `data` and `scratch` in turn. Compiled once, here, not
/// wherever a transform is used.
fn middle<T: Real>(stages: &[Stage<T>], data: &mut Split<T>, scratch: &mut Split<T>) {
    Arch::new().dispatch(Middle { stages, data, scratch });
}

/// What [`middle`] does; the bounds of [`Simd`] types carry the instruction set.
struct Middle<'a, T> {
    stages: &'a [Stage<T>],
    data: &'a mut Split<T>,
    scratch: &'a mut Split<T>,
}

impl<T: Real> WithSimd for Middle<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for stage in self.stages {
            pass(simd, stage, self.data.reader(), self.scratch.writer());
            std::mem::swap(self.data, self.scratch);
        }
    }
}
