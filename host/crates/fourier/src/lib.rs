//! Fourier transforms with the same bits on every machine. The principal type is [`lanes::Fft`]:
//! many short sequences at once; [`plans`] has those of established libraries for analysis.
//!
//! - [`lanes`] transforms sixteen sequences of f32 or f64 side by side, for blurs. Lengths are products of
//!   2, 3 and 5.
//! - [`plans`] hands out f32 plans of `rustfft` and `realfft` for any length. They are compiled
//!   once, here, for all crates.
//!
//! Transforms are unscaled: forward X(k) = Σ x(i)·e^(−2πi·ik/n), backward with the opposite sign,
//! so that there and back multiplies by n. Frequencies are in cycles per n samples.
//!
//! ```
//! use camrig_fourier::lanes::{Fft, LANES, Split, good_length};
//!
//! // A cosine of 3 cycles in lane 5; the other fifteen sequences are 0.
//! let n = good_length(13);
//! assert_eq!(n, 15);
//! let (mut data, mut scratch) = (Split::zeros(n), Split::zeros(n));
//! for i in 0..n {
//!     data.re[i].0[5] = (std::f32::consts::TAU * (3 * i) as f32 / n as f32).cos();
//! }
//! Fft::new(n).forward(&mut data, &mut scratch);
//! // Half of the n samples' amplitude at frequency 3, half at its mirror image.
//! assert!((data.re[3].0[5] - 7.5).abs() < 1e-5);
//! assert!((data.re[n - 3].0[5] - 7.5).abs() < 1e-5);
//! assert!(data.re[4].0[5].abs() < 1e-5 && LANES == 16);
//! ```
//!
//! ```
//! use camrig_fourier::plans::{Complex, real_forward};
//!
//! let plan = real_forward(8);
//! let mut input = [1.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0, 0.0];
//! let mut spectrum = vec![Complex::default(); 5];
//! plan.process(&mut input, &mut spectrum).expect("buffers of the planned lengths");
//! assert!((spectrum[2].re - 4.0).abs() < 1e-6);
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

#[cfg(feature = "lanes")]
pub mod lanes;
pub mod plans;

/// sin(πx)/(πx): the transform of an aperture or an exposure of length 1 at the frequency x;
/// the same bits on every machine.
#[must_use]
pub fn sinc(x: f64) -> f64 {
    let a = std::f64::consts::PI * x;
    if a.abs() < 1e-9 { 1.0 } else { libm::sin(a) / a }
}
