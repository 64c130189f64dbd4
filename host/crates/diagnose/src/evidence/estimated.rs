//! Values with standard errors, and how several are combined.

/// A value with its standard error, in the unit of the value.
#[derive(Clone, Copy, Debug)]
pub struct Estimated {
    /// The value.
    pub value: f64,
    /// Its standard error; NaN where the value was chosen rather than estimated.
    pub se: f64,
}

impl Estimated {
    /// A value that was chosen rather than estimated.
    pub fn chosen(value: f64) -> Self {
        Self { value, se: f64::NAN }
    }

    /// Distance from zero, standard errors.
    pub fn z(&self) -> f64 {
        self.value / self.se
    }

    /// This over a positive number that is known.
    #[must_use]
    pub fn over(self, known: f64) -> Self {
        Self { value: self.value / known, se: self.se / known }
    }

    /// The square root, with its error to first order.
    #[must_use]
    pub fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        Self { value, se: self.se / (2.0 * value) }
    }
}

/// Mean weighted by inverse variance. Values that are not finite, or without a finite weight, are
/// left out; `None` where none remains.
pub fn pooled(values: impl IntoIterator<Item = Estimated>) -> Option<Estimated> {
    let (mut sum, mut weight) = (0.0, 0.0);
    for e in values {
        let w = 1.0 / (e.se * e.se);
        if w.is_finite() && e.value.is_finite() {
            sum += w * e.value;
            weight += w;
        }
    }
    (weight > 0.0).then(|| Estimated { value: sum / weight, se: weight.sqrt().recip() })
}

/// Slope of y over x of a line through the origin, weighted by inverse variance, for points (x,
/// y).
pub fn slope(points: impl IntoIterator<Item = (f64, Estimated)>) -> Option<Estimated> {
    pooled(
        points
            .into_iter()
            .filter(|(x, _)| *x != 0.0)
            .map(|(x, y)| Estimated { value: y.value / x, se: y.se / x.abs() }),
    )
}
