//! Numerical tools that do not depend on cameras: sums in lanes, spectra, tails of distributions,
//! minima of functions.

pub mod lanes;
pub mod minimise;
pub mod spectrum;

pub use camrig_base::tails;
