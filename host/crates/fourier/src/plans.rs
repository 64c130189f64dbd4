//! Transforms of single sequences by `rustfft` and `realfft`; nothing is scaled in either
//! direction.

pub use realfft::RealToComplex;
pub use realfft::num_complex::Complex;
use realfft::{FftNum, RealFftPlanner};
pub use rustfft::Fft;
use rustfft::FftPlanner;
use std::sync::Arc;

/// A floating-point type whose transforms are compiled in this crate.
pub trait Sample: FftNum {
    /// A plan for forward transforms of `length` complex numbers.
    fn forward(length: usize) -> Arc<dyn Fft<Self>>;
    /// A plan for forward transforms of `length` real numbers into `length / 2 + 1` complex ones.
    fn real_forward(length: usize) -> Arc<dyn RealToComplex<Self>>;
}

impl Sample for f32 {
    fn forward(length: usize) -> Arc<dyn Fft<Self>> {
        FftPlanner::new().plan_fft_forward(length)
    }

    fn real_forward(length: usize) -> Arc<dyn RealToComplex<Self>> {
        RealFftPlanner::new().plan_fft_forward(length)
    }
}

impl Sample for f64 {
    fn forward(length: usize) -> Arc<dyn Fft<Self>> {
        FftPlanner::new().plan_fft_forward(length)
    }

    fn real_forward(length: usize) -> Arc<dyn RealToComplex<Self>> {
        RealFftPlanner::new().plan_fft_forward(length)
    }
}
