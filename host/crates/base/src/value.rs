//! A figure with its standard error, and how several are combined.

use serde::Serialize;
use std::ops::{Add, Sub};

/// A figure and its standard error (one standard deviation), in the same unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Value {
    /// The figure.
    pub value: f64,
    /// Its standard error; NaN where the figure was chosen rather than estimated.
    pub std_error: f64,
}

impl Value {
    /// A figure with its standard error.
    pub fn new(value: f64, std_error: f64) -> Self {
        Self { value, std_error }
    }

    /// A figure that was chosen rather than estimated.
    pub fn chosen(value: f64) -> Self {
        Self::new(value, f64::NAN)
    }

    /// Distance from zero, standard errors.
    pub fn z(self) -> f64 {
        self.value / self.std_error
    }

    /// The figure times an exact factor.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self::new(self.value * factor, self.std_error * factor.abs())
    }

    /// Its square, with its error to first order.
    #[must_use]
    pub fn squared(self) -> Self {
        Self::new(self.value * self.value, 2.0 * self.value.abs() * self.std_error)
    }

    /// The square root of a variance, with its error to first order; `None` where the variance is
    /// not positive, as one that is smaller than its error can be.
    pub fn sqrt(self) -> Option<Self> {
        let root = self.value.sqrt();
        (self.value > 0.0).then(|| Self::new(root, 0.5 * self.std_error / root))
    }

    /// The ratio of two independent figures, with its error to first order.
    #[must_use]
    pub fn over(self, other: Self) -> Self {
        let ratio = self.value / other.value;
        let error = libm::hypot(self.std_error, ratio * other.std_error);
        Self::new(ratio, (error / other.value).abs())
    }

    /// The mean of independent estimates of one quantity, weighted by inverse variance. Those that
    /// are not finite, or without a finite weight, are left out; `None` where none remains.
    pub fn combine(values: impl IntoIterator<Item = Self>) -> Option<Self> {
        let (mut sum, mut weight) = (0.0, 0.0);
        for v in values {
            let w = v.std_error.powi(2).recip();
            if w.is_finite() && v.value.is_finite() {
                sum += w * v.value;
                weight += w;
            }
        }
        (weight > 0.0).then(|| Self::new(sum / weight, weight.sqrt().recip()))
    }
}

/// The sum of two independent figures.
impl Add for Value {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.value + other.value, libm::hypot(self.std_error, other.std_error))
    }
}

/// The difference of two independent figures.
impl Sub for Value {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self::new(self.value - other.value, libm::hypot(self.std_error, other.std_error))
    }
}

#[cfg(test)]
mod tests {
    use super::Value;

    #[test]
    fn errors_follow_the_arithmetic() {
        let (a, b) = (Value::new(4.0, 0.3), Value::new(2.0, 0.2));
        assert_eq!(a.sqrt(), Some(Value::new(2.0, 0.075)));
        assert_eq!(Value::new(-0.1, 0.3).sqrt(), None);
        assert_eq!(a.scaled(-2.0), Value::new(-8.0, 0.6));
        assert_eq!(b.z(), 10.0);
        assert_eq!(b.squared(), Value::new(4.0, 0.8));
        assert_eq!(a + Value::new(1.0, 0.4), Value::new(5.0, 0.5));
        assert_eq!(a - Value::new(1.0, 0.4), Value::new(3.0, 0.5));
        assert_eq!(Value::new(0.0, 0.3).over(b), Value::new(0.0, 0.15));
        // Relative errors of 3/40 and 4/40 make 5/40.
        assert!((a.over(b).std_error - 0.25).abs() < 1e-12);
        let mean = Value::combine([a, Value::chosen(9.0), Value::new(5.0, 0.3)]).unwrap();
        assert!((mean.value - 4.5).abs() < 1e-12);
        assert!((mean.std_error - 0.3 / 2f64.sqrt()).abs() < 1e-12);
        assert_eq!(Value::combine([Value::chosen(1.0)]), None);
    }
}
