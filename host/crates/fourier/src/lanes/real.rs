//! The numbers that transforms compute with, and their vector registers.

use pulp::Simd;
use pulp::bytemuck::{Pod, Zeroable, cast_slice, cast_slice_mut};
use std::fmt::Debug;
use std::ops::{Add, Mul, Neg, Sub};

/// Sequences transformed at once.
pub const LANES: usize = 16;

/// One element of sixteen sequences.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lanes<T = f32>(pub [T; LANES]);

// SAFETY: sixteen f32 or f64 without padding; any bits are values of it.
unsafe impl<T: Real> Zeroable for Lanes<T> {}
// SAFETY: as above; `repr(C)`, `Copy`, no interior mutability, no references.
unsafe impl<T: Real> Pod for Lanes<T> {}

/// f32 or f64.
pub trait Real:
    Pod
    + PartialEq
    + Debug
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
{
    /// 0.
    const ZERO: Self;
    /// A register of the machine, full of these numbers.
    type Vector<S: Simd>: Copy;

    /// The nearest number.
    fn of(value: f64) -> Self;
    /// The same number.
    fn wide(value: f32) -> Self;
    /// The nearest f32.
    fn narrow(self) -> f32;
    /// Number of registers that hold sixteen lanes.
    fn registers<S: Simd>() -> usize;
    /// Views lanes as registers.
    fn vectors<S: Simd>(lanes: &[Lanes<Self>]) -> &[Self::Vector<S>];
    /// Views lanes as registers for writing.
    fn vectors_mut<S: Simd>(lanes: &mut [Lanes<Self>]) -> &mut [Self::Vector<S>];
    /// The same number in every place of a register.
    fn splat<S: Simd>(simd: S, value: Self) -> Self::Vector<S>;
    /// a + b.
    fn plus<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// a − b.
    fn minus<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// a·b.
    fn times<S: Simd>(simd: S, a: Self::Vector<S>, b: Self::Vector<S>) -> Self::Vector<S>;
    /// −a.
    fn negated<S: Simd>(simd: S, a: Self::Vector<S>) -> Self::Vector<S>;
}

macro_rules! real {
    ($t:ty, $vector:ident, $lanes:ident, $view:ident, $view_mut:ident, $splat:ident, $add:ident,
     $sub:ident, $mul:ident, $neg:ident) => {
        impl Real for $t {
            const ZERO: Self = 0.0;
            type Vector<S: Simd> = S::$vector;

            #[inline(always)]
            fn of(value: f64) -> Self {
                value as $t
            }

            #[inline(always)]
            fn wide(value: f32) -> Self {
                <$t>::from(value)
            }

            #[inline(always)]
            fn narrow(self) -> f32 {
                self as f32
            }

            #[inline(always)]
            fn registers<S: Simd>() -> usize {
                LANES / S::$lanes
            }

            #[inline(always)]
            fn vectors<S: Simd>(lanes: &[Lanes<Self>]) -> &[S::$vector] {
                S::$view(cast_slice(lanes)).0
            }

            #[inline(always)]
            fn vectors_mut<S: Simd>(lanes: &mut [Lanes<Self>]) -> &mut [S::$vector] {
                S::$view_mut(cast_slice_mut(lanes)).0
            }

            #[inline(always)]
            fn splat<S: Simd>(simd: S, value: Self) -> S::$vector {
                simd.$splat(value)
            }

            #[inline(always)]
            fn plus<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$add(a, b)
            }

            #[inline(always)]
            fn minus<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$sub(a, b)
            }

            #[inline(always)]
            fn times<S: Simd>(simd: S, a: S::$vector, b: S::$vector) -> S::$vector {
                simd.$mul(a, b)
            }

            #[inline(always)]
            fn negated<S: Simd>(simd: S, a: S::$vector) -> S::$vector {
                simd.$neg(a)
            }
        }
    };
}

real!(
    f32,
    f32s,
    F32_LANES,
    as_simd_f32s,
    as_mut_simd_f32s,
    splat_f32s,
    add_f32s,
    sub_f32s,
    mul_f32s,
    neg_f32s
);
real!(
    f64,
    f64s,
    F64_LANES,
    as_simd_f64s,
    as_mut_simd_f64s,
    splat_f64s,
    add_f64s,
    sub_f64s,
    mul_f64s,
    neg_f64s
);
