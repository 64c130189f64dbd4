//! Fourier transforms: [`lanes`] transforms sixteen sequences side by side with the same bits on every
//! machine (blurs); [`plans`] hands out double-precision plans of `rustfft` and `realfft` (analysis),
//! which are compiled here once for all crates.

pub mod lanes;
pub mod plans;
