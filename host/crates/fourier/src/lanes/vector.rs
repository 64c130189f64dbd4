//! Sixteen values side by side, handled as many at a time as a vector register holds.

use super::real::{LANES, Lanes, Real};
use pulp::Simd;

impl<T: Real> Lanes<T> {
    /// Sixteen zeros.
    pub const ZERO: Self = Self([T::ZERO; LANES]);

    /// The values of a row from place `x` on, 0 beyond its end.
    #[inline(always)]
    #[must_use]
    pub fn of_row(row: &[f32], x: usize) -> Self {
        let mut lanes = Self::ZERO;
        match row.get(x..x + LANES) {
            Some(whole) => lanes.0.iter_mut().zip(whole).for_each(|(l, v)| *l = T::wide(*v)),
            None => {
                let rest = row.get(x..).unwrap_or_default();
                lanes.0.iter_mut().zip(rest).for_each(|(l, v)| *l = T::wide(*v));
            }
        }
        lanes
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(T, T) -> T) -> Self {
        let mut out = [T::ZERO; LANES];
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
    pub fn times(mut self, factor: T) -> Self {
        self.0.iter_mut().for_each(|a| *a = *a * factor);
        self
    }
}

/// Complex numbers in as many of the lanes as a register of the machine holds.
#[derive(Clone, Copy)]
pub struct Complex<S: Simd, T: Real> {
    /// Real parts.
    pub re: T::Vector<S>,
    /// Imaginary parts.
    pub im: T::Vector<S>,
}

impl<S: Simd, T: Real> Complex<S, T> {
    /// 0.
    #[inline(always)]
    pub fn zero(simd: S) -> Self {
        Self { re: T::splat(simd, T::ZERO), im: T::splat(simd, T::ZERO) }
    }

    /// a + b.
    #[inline(always)]
    pub fn add(self, simd: S, b: Self) -> Self {
        Self { re: T::plus(simd, self.re, b.re), im: T::plus(simd, self.im, b.im) }
    }

    /// a − b.
    #[inline(always)]
    pub fn sub(self, simd: S, b: Self) -> Self {
        Self { re: T::minus(simd, self.re, b.re), im: T::minus(simd, self.im, b.im) }
    }

    /// a·b, without fused operations.
    #[inline(always)]
    pub fn mul(self, simd: S, b: Self) -> Self {
        Self {
            re: T::minus(simd, T::times(simd, self.re, b.re), T::times(simd, self.im, b.im)),
            im: T::plus(simd, T::times(simd, self.re, b.im), T::times(simd, self.im, b.re)),
        }
    }

    /// The value times a real factor.
    #[inline(always)]
    pub fn scale(self, simd: S, factor: T) -> Self {
        let f = T::splat(simd, factor);
        Self { re: T::times(simd, self.re, f), im: T::times(simd, self.im, f) }
    }

    /// The value times cos + i·sin of an angle.
    #[inline(always)]
    pub fn turned(self, simd: S, (cos, sin): (T, T)) -> Self {
        self.mul(simd, Self { re: T::splat(simd, cos), im: T::splat(simd, sin) })
    }

    /// The value times −i·factor.
    #[inline(always)]
    pub fn minus_i_times(self, simd: S, factor: T) -> Self {
        Self {
            re: T::times(simd, self.im, T::splat(simd, factor)),
            im: T::times(simd, self.re, T::splat(simd, -factor)),
        }
    }
}
