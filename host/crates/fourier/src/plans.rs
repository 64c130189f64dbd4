//! Transforms of single sequences of any length by `rustfft` and `realfft`; nothing is scaled in
//! either direction.
//!
//! They have the same bits on every machine: the libraries are compiled without their vectorised
//! paths, which sum in another order on each kind of processor, and the system's sines and cosines,
//! which differ in the last bits of f64, are rounded to f32.

use realfft::RealFftPlanner;
pub use realfft::RealToComplex;
pub use realfft::num_complex::Complex;
pub use rustfft::Fft;
use rustfft::FftPlanner;
use std::sync::Arc;

/// A plan for forward transforms of `length` complex numbers.
#[must_use]
pub fn forward(length: usize) -> Arc<dyn Fft<f32>> {
    FftPlanner::new().plan_fft_forward(length)
}

/// A plan for forward transforms of `length` real numbers into `length / 2 + 1` complex ones.
#[must_use]
pub fn real_forward(length: usize) -> Arc<dyn RealToComplex<f32>> {
    RealFftPlanner::new().plan_fft_forward(length)
}
