//! Numerical tools that do not depend on cameras: sums in lanes, spectra, tails of distributions,
//! minima of functions, order statistics of values on a lattice.

pub mod lanes;
pub mod minimise;
pub mod spectrum;
pub mod steps;

pub use camrig_base::tails;
