//! Sixteen values side by side, handled as many at a time as a vector register holds.

use bytemuck::{cast_slice, cast_slice_mut};
use pulp::{Simd, bytemuck};

/// Sequences transformed at once.
pub const LANES: usize = 16;

/// One element of sixteen sequences.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lanes(pub [f32; LANES]);

// SAFETY: sixteen f32 without padding; any bits are values of it.
unsafe impl bytemuck::Zeroable for Lanes {}
// SAFETY: as above; `repr(C)`, `Copy`, no interior mutability, no references.
unsafe impl bytemuck::Pod for Lanes {}

impl Lanes {
    /// Sixteen zeros.
    pub const ZERO: Lanes = Lanes([0.0; LANES]);

    /// The values of a row from place `x` on, 0 beyond its end.
    #[inline(always)]
    #[must_use]
    pub fn of_row(row: &[f32], x: usize) -> Self {
        let mut lanes = Self::ZERO;
        match row.get(x..x + LANES) {
            Some(whole) => lanes.0.copy_from_slice(whole),
            None => {
                let rest = row.get(x..).unwrap_or_default();
                lanes.0[..rest.len()].copy_from_slice(rest);
            }
        }
        lanes
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = [0.0; LANES];
        for (o, (a, b)) in out.iter_mut().zip(self.0.iter().zip(&other.0)) {
            *o = f(*a, *b);
        }
        Lanes(out)
    }

    /// Lane by lane sum.
    #[inline(always)]
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }

    /// Lane by lane difference.
    #[inline(always)]
    #[must_use]
    pub fn minus(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }

    /// Lane by lane product.
    #[inline(always)]
    #[must_use]
    pub fn product(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }

    /// Every lane times one factor.
    #[inline(always)]
    #[must_use]
    pub fn times(mut self, factor: f32) -> Self {
        self.0.iter_mut().for_each(|a| *a *= factor);
        self
    }
}

/// Complex numbers in as many of the lanes as a register of the machine holds.
#[derive(Clone, Copy)]
pub struct Complex<S: Simd> {
    /// Real parts.
    pub re: S::f32s,
    /// Imaginary parts.
    pub im: S::f32s,
}

impl<S: Simd> Complex<S> {
    /// 0.
    #[inline(always)]
    pub fn zero(simd: S) -> Self {
        Self { re: simd.splat_f32s(0.0), im: simd.splat_f32s(0.0) }
    }

    /// a + b.
    #[inline(always)]
    pub fn add(self, simd: S, b: Self) -> Self {
        Self { re: simd.add_f32s(self.re, b.re), im: simd.add_f32s(self.im, b.im) }
    }

    /// a − b.
    #[inline(always)]
    pub fn sub(self, simd: S, b: Self) -> Self {
        Self { re: simd.sub_f32s(self.re, b.re), im: simd.sub_f32s(self.im, b.im) }
    }

    /// a·b, without fused operations.
    #[inline(always)]
    pub fn mul(self, simd: S, b: Self) -> Self {
        Self {
            re: simd.sub_f32s(simd.mul_f32s(self.re, b.re), simd.mul_f32s(self.im, b.im)),
            im: simd.add_f32s(simd.mul_f32s(self.re, b.im), simd.mul_f32s(self.im, b.re)),
        }
    }

    /// The value times a real factor.
    #[inline(always)]
    pub fn scale(self, simd: S, factor: f32) -> Self {
        let f = simd.splat_f32s(factor);
        Self { re: simd.mul_f32s(self.re, f), im: simd.mul_f32s(self.im, f) }
    }

    /// The value times cos + i·sin of an angle.
    #[inline(always)]
    pub fn turned(self, simd: S, (cos, sin): (f32, f32)) -> Self {
        self.mul(simd, Self { re: simd.splat_f32s(cos), im: simd.splat_f32s(sin) })
    }

    /// The value times −i·factor.
    #[inline(always)]
    pub fn minus_i_times(self, simd: S, factor: f32) -> Self {
        Self {
            re: simd.mul_f32s(self.im, simd.splat_f32s(factor)),
            im: simd.mul_f32s(self.re, simd.splat_f32s(-factor)),
        }
    }
}

/// Number of registers that hold sixteen lanes.
#[inline(always)]
#[must_use]
pub fn registers<S: Simd>() -> usize {
    LANES / S::F32_LANES
}

/// Views lanes as registers.
#[inline(always)]
#[must_use]
pub fn vectors<S: Simd>(lanes: &[Lanes]) -> &[S::f32s] {
    S::as_simd_f32s(cast_slice(lanes)).0
}

/// Views lanes as registers for writing.
#[inline(always)]
pub fn vectors_mut<S: Simd>(lanes: &mut [Lanes]) -> &mut [S::f32s] {
    S::as_mut_simd_f32s(cast_slice_mut(lanes)).0
}
