//! A measured value with its standard error.

use serde::Serialize;

/// A measured value and its standard error (one standard deviation of the estimate).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Value {
    /// The estimate.
    pub value: f64,
    /// Standard error of the estimate, in its unit.
    pub std_error: f64,
}

impl Value {
    /// An estimate with its standard error.
    pub fn new(value: f64, std_error: f64) -> Self {
        Self { value, std_error }
    }

    /// Square root of a variance estimate `v`, with its error to first order; `None` where the
    /// estimate is not positive, as one that is smaller than its error can be.
    pub fn sqrt(v: f64, std_error: f64) -> Option<Self> {
        (v > 0.0).then(|| Self::new(v.sqrt(), 0.5 * std_error / v.sqrt()))
    }

    /// The value times an exact factor.
    #[must_use]
    pub fn scaled(self, factor: f64) -> Self {
        Self::new(self.value * factor, self.std_error * factor.abs())
    }

    /// The ratio of two independent estimates, with its error to first order.
    #[must_use]
    pub fn over(self, other: Self) -> Self {
        let ratio = self.value / other.value;
        let relative = libm::hypot(self.std_error / self.value, other.std_error / other.value);
        Self::new(ratio, (ratio * relative).abs())
    }

    /// The mean of independent estimates of one quantity, weighted by inverse variance; `None`
    /// without an estimate of positive error.
    pub fn combine(values: &[Self]) -> Option<Self> {
        let known: Vec<&Self> = values.iter().filter(|v| v.std_error > 0.0).collect();
        if known.is_empty() {
            return None;
        }
        let weight: f64 = known.iter().map(|v| v.std_error.powi(-2)).sum();
        let sum: f64 = known.iter().map(|v| v.value * v.std_error.powi(-2)).sum();
        Some(Self::new(sum / weight, libm::pow(weight, -0.5)))
    }
}
