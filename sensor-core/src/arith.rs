//! The two arithmetics behind one pipeline.
//!
//! A stage is written once over [`Arith`]: [`Float`] (f32, for workstations and parts with an FPU) and
//! [`Fixed`] (32-bit fixed point, for parts without). Values are handled in blocks of [`BLOCK`] pixels,
//! which become a few vector instructions on a workstation and a plain loop on a microcontroller.
//!
//! Both use IEEE or integer basic operations only: no fused multiply-add, no platform library, so a
//! result is the same bits everywhere.

mod fixed_point;
mod float;
mod integer;

pub use fixed_point::Fixed;
pub use float::Float;

use crate::stream::Lanes;

/// Pixels handled together.
pub const BLOCK: usize = 64;

/// One value for each pixel of a block.
pub type Block<T> = [T; BLOCK];

/// Blocks that hold a row of `width` pixels; what lies beyond the last pixel is padding.
pub const fn blocks(width: usize) -> usize {
    width.div_ceil(BLOCK)
}

/// Largest signal, e⁻: above any full well in use, and what a fixed-point signal can hold.
pub const MAX_SIGNAL_E: f32 = 524_287.0;

/// Mean (e⁻) from which a Poisson count comes from a normal number, below it from a uniform one.
pub const EXPANSION_FROM_E: f32 = 16.0;

/// Streams of Poisson counts: uniform and normal numbers for each pixel. What a pixel draws does not depend
/// on its neighbours' means; a stream that no pixel of the row needs is left out.
#[derive(Clone, Debug)]
pub struct Counts {
    uniform: Option<Lanes>,
    normal: Option<Lanes>,
}

impl Counts {
    /// Streams for a row with some means below [`EXPANSION_FROM_E`] (`low`), some from there on (`high`).
    #[inline(always)]
    pub fn new(uniform: Lanes, normal: Lanes, low: bool, high: bool) -> Self {
        Self { uniform: low.then_some(uniform), normal: high.then_some(normal) }
    }
}

/// No normal number of a stream is larger.
pub const MAX_NORMAL: f32 = 6.8;

/// Arithmetic of a sensor pipeline.
pub trait Arith: Copy + Send + Sync + 'static {
    /// A signal, e⁻; magnitudes up to [`MAX_SIGNAL_E`].
    type Signal: Copy + Default + PartialOrd + Send + Sync;
    /// A dimensionless number of magnitude below 8: gains near 1, normal numbers.
    type Factor: Copy + Send + Sync;
    /// Sum of band contributions of one pixel.
    type Sum: Copy + Default + Send + Sync;
    /// Electrons per unit of irradiance mantissa, see [`crate::collect`].
    type Weight: Copy + Default + Send + Sync;

    /// A signal of `e` electrons (saturated to the range).
    fn signal(e: f32) -> Self::Signal;
    /// A factor (saturated to the range).
    fn factor(f: f32) -> Self::Factor;
    /// A signal in electrons.
    fn electrons(s: Self::Signal) -> f32;
    /// A factor as a number.
    fn number(f: Self::Factor) -> f32;
    /// a + b, saturating.
    fn add(a: Self::Signal, b: Self::Signal) -> Self::Signal;
    /// a - b, saturating.
    fn sub(a: Self::Signal, b: Self::Signal) -> Self::Signal;
    /// Signal times factor.
    fn scale(s: Self::Signal, f: Self::Factor) -> Self::Signal;
    /// 1 + sigma * n: the gain of a pixel.
    fn gain(sigma: Self::Factor, n: Self::Factor) -> Self::Factor;
    /// Standard normal numbers, one per pixel; uses two draws.
    fn normals(lanes: &mut Lanes) -> Block<Self::Factor>;
    /// Replaces means (e⁻) by Poisson counts: see [`crate::effects::shot_noise`] for method and error.
    fn poisson(means: &mut [Block<Self::Signal>], counts: &mut Counts);

    /// A weight of 0..=1 (the collector scales by a power of two to get there).
    fn weight(w: f32) -> Self::Weight;
    /// Weights between two nodes for 16 pixels: a + t (b - a) with t = first + i step, held to 0..=1.
    fn lerp(
        a: &[Self::Weight; 16],
        b: &[Self::Weight; 16],
        first: f32,
        step: f32,
    ) -> [Self::Weight; 16];
    /// sum += mantissa * 2^exponent * weight, e⁻, for 16 pixels that share an exponent.
    fn accumulate(
        sum: &mut [Self::Sum; 16],
        mantissa: &[u16; 16],
        exponent: i32,
        weight: &[Self::Weight; 16],
    );
    /// The accumulated mean electrons.
    fn collected(sum: Self::Sum) -> Self::Signal;

    /// DN = round(signal * dn_per_e + black), ties to even, clamped to 0..=max_dn.
    fn digitise(
        signal: &Block<Self::Signal>,
        dn_per_e: f32,
        black_dn: f32,
        max_dn: u16,
        out: &mut Block<u16>,
    );
}
