//! The two arithmetics behind one pipeline.
//!
//! Each stage is written once, for any [`Arith`]: [`Float`] (f32, for workstations and parts with
//! a floating-point unit, FPU) or [`Fixed`] (32-bit fixed point, for parts without one). Values
//! are handled in blocks of [`BLOCK`] pixels, which become a few vector instructions on a
//! workstation and a plain loop on a microcontroller.
//!
//! Each has two ranges. Charge is at most a full well ([`MAX_SIGNAL_E`]); the light that falls on a
//! pixel may be a million times that, as where the sun or a headlamp is in the picture
//! ([`MAX_LIGHT_E`]). Light and photo-electrons are computed in [`Arith::Light`], what a pixel
//! holds of them from [`Arith::held`] on in the range of charge.
//!
//! Both use only basic IEEE 754 or integer operations: no fused multiply-add and no platform
//! library, so results have the same bits everywhere.

mod fixed_point;
mod float;
mod integer;

pub use fixed_point::{Fixed, FixedIn};
pub use float::{Float, FloatIn};

use crate::stream::Lanes;

/// Pixels that are handled together.
pub const BLOCK: usize = 64;

/// One value for each pixel of a block.
pub type Block<T> = [T; BLOCK];

/// Number of blocks that hold a row of `width` pixels; values beyond the last pixel are padding.
pub const fn blocks(width: usize) -> usize {
    width.div_ceil(BLOCK)
}

/// Largest signal of charge and voltage, e⁻: above any full well in use, and what a fixed-point
/// signal can hold.
pub const MAX_SIGNAL_E: f32 = 524_287.0;

/// Largest signal of light and photo-electrons, e⁻: above 10⁴ of the largest full wells, from where
/// the strongest black sun sets in, and what a fixed-point signal of light can hold.
pub const MAX_LIGHT_E: f32 = 6.9e9;

/// Mean (e⁻) from which a Poisson count is made from a normal number; below it, from a uniform
/// one. Errors of both methods: [`crate::effects::shot_noise`].
pub const EXPANSION_FROM_E: f32 = 16.0;

/// Random streams of Poisson counts: uniform and normal numbers for each pixel. The numbers of a
/// pixel do not depend on the means of its neighbours; a stream that no pixel of the row needs is
/// not drawn.
#[derive(Clone, Debug)]
pub struct Counts {
    uniform: Option<Lanes>,
    normal: Option<Lanes>,
}

impl Counts {
    /// Streams for a row with some means below [`EXPANSION_FROM_E`] (`low`), some from there on
    /// (`high`).
    #[inline(always)]
    pub fn new(uniform: Lanes, normal: Lanes, low: bool, high: bool) -> Self {
        Self { uniform: low.then_some(uniform), normal: high.then_some(normal) }
    }
}

/// Bound on the magnitude of the normal numbers of a stream (the largest is 6.77, see
/// [`crate::math::box_muller`]).
pub const MAX_NORMAL: f32 = 6.8;

mod sealed {
    pub trait Sealed {}
}

impl<const LIGHT: bool> sealed::Sealed for FloatIn<LIGHT> {}
impl<const LIGHT: bool> sealed::Sealed for FixedIn<LIGHT> {}

/// Arithmetic of a sensor pipeline: [`Float`] and [`Fixed`], and no others, so that it can gain
/// operations.
pub trait Arith: sealed::Sealed + Copy + Send + Sync + 'static {
    /// The same arithmetic in the range of light. A signal of one range must be converted to be one
    /// of the other ([`Self::held`]), though both are of one type, so that they can share memory.
    type Light: Arith<Signal = Self::Signal, Light = Self::Light>;
    /// A signal, e⁻; magnitudes up to [`MAX_SIGNAL_E`], in the range of light [`MAX_LIGHT_E`].
    type Signal: Copy + Default + PartialOrd + Send + Sync;
    /// A dimensionless number of magnitude below 8: normal numbers, 1 + 0.14 of one, shares.
    type Factor: Copy + Send + Sync;
    /// Sum of band contributions of one pixel.
    type Sum: Copy + Default + Send + Sync;
    /// Electrons per unit of irradiance mantissa, see [`crate::collect`].
    type Weight: Copy + Default + Send + Sync;

    /// The signal of `e` electrons, saturated to the range.
    fn signal(e: f32) -> Self::Signal;
    /// The factor `f`, saturated to the range.
    fn factor(f: f32) -> Self::Factor;
    /// A signal as electrons, e⁻.
    fn electrons(s: Self::Signal) -> f32;
    /// A factor as a number.
    fn number(f: Self::Factor) -> f32;
    /// a + b, in fixed point saturating; f32 keeps what is beyond until the full well or the
    /// converter.
    fn add(a: Self::Signal, b: Self::Signal) -> Self::Signal;
    /// a - b, saturating.
    fn sub(a: Self::Signal, b: Self::Signal) -> Self::Signal;
    /// Signal times factor, saturating.
    fn scale(s: Self::Signal, f: Self::Factor) -> Self::Signal;
    /// Signal times any finite number, saturating.
    fn times(s: Self::Signal, gain: f32) -> Self::Signal;
    /// The charge of this many photo-electrons, a signal of [`Self::Light`]; what is above
    /// [`MAX_SIGNAL_E`] is cut.
    fn held(light: Self::Signal) -> Self::Signal;
    /// 1 + sigma * n: the gain of a pixel.
    fn gain(sigma: Self::Factor, n: Self::Factor) -> Self::Factor;
    /// Standard normal numbers, one per pixel of a block; uses two draws.
    fn normals(lanes: &mut Lanes) -> Block<Self::Factor>;
    /// Replaces means (e⁻) by Poisson counts; method and error: [`crate::effects::shot_noise`].
    fn poisson(means: &mut [Block<Self::Signal>], counts: &mut Counts);

    /// A weight of 0..=1 (the collector scales by a power of two to get there).
    fn weight(w: f32) -> Self::Weight;
    /// Weights between two nodes for 16 pixels: a + t (b - a), with t = first + i step clamped to
    /// 0..=1.
    fn lerp(
        a: &[Self::Weight; 16],
        b: &[Self::Weight; 16],
        first: f32,
        step: f32,
    ) -> [Self::Weight; 16];
    /// sum += mantissa * 2^exponent * weight, e⁻, for pixels that share an exponent.
    fn accumulate<const N: usize>(
        sum: &mut [Self::Sum; N],
        mantissa: &[u16; N],
        exponent: i32,
        weight: &[Self::Weight; N],
    );
    /// The accumulated mean photo-electrons as a signal of [`Self::Light`].
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
