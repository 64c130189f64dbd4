//! The response curve: mean signal against the amount of light.

use super::fit::Fit;
use super::value::Value;

/// `S = x + q x² + c x³`, x being the signal (DN) of a sensor with the same slope at zero that was
/// a straight line. Valid up to the largest signal fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Quadratic coefficient, 1/DN.
    pub quadratic: Value,
    /// Cubic coefficient, 1/DN²; 0 unless the data ask for it.
    pub cubic: f64,
    /// Slope at zero, DN per unit of light.
    pub responsivity: Value,
    /// Signal without light that the light ladder implies, DN: an exposure error's mark.
    pub offset: Value,
}

impl Response {
    /// Fits mean signals `s` (dark subtracted, standard errors `error`) over amounts of light `h`:
    /// `s = offset + R h + q' h²`, and a cubic term where it lowers χ² by more than 9 of the
    /// scatter left. `None` with fewer than five levels.
    ///
    /// Errors are widened to the scatter, so light that is not steady costs certainty.
    pub fn fit(h: &[f64], s: &[f64], error: &[f64]) -> Option<Self> {
        if h.len() < 5 {
            return None;
        }
        let powers = |n: i32| -> Vec<Vec<f64>> {
            h.iter().map(|&h| (0..=n).map(|k| h.powi(k)).collect()).collect()
        };
        let mut fit = Fit::new(&powers(2), s, error).ok()?;
        if h.len() >= 8
            && let Ok(cubic) = Fit::new(&powers(3), s, error)
            && fit.chi2 - cubic.chi2 > 9.0 * cubic.reduced_chi2().max(1.0)
        {
            fit = cubic;
        }
        let c = &fit.coefficients;
        let r = c[1];
        if r <= 0.0 {
            return None;
        }
        Some(Self {
            quadratic: Value::new(c[2] / (r * r), fit.std_error(2) / (r * r)),
            cubic: c.get(3).map_or(0.0, |c| c / (r * r * r)),
            responsivity: Value::new(r, fit.std_error(1)),
            offset: Value::new(c[0], fit.std_error(0)),
        })
    }

    /// The same curve with another quadratic coefficient.
    #[must_use]
    pub fn with_quadratic(self, quadratic: Value) -> Self {
        Self { quadratic, ..self }
    }

    /// dS/dx at x.
    pub fn slope(&self, x: f64) -> f64 {
        1.0 + 2.0 * self.quadratic.value * x + 3.0 * self.cubic * x * x
    }

    /// The straight-line signal x of a measured signal, by Newton's method (the curve is within a
    /// few per cent of its tangent wherever it was fitted).
    pub fn linearise(&self, s: f64) -> f64 {
        let mut x = s;
        for _ in 0..8 {
            let value = x + self.quadratic.value * x * x + self.cubic * x * x * x;
            x -= (value - s) / self.slope(x).max(0.1);
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovers_a_curve_and_inverts_it() {
        let h: Vec<f64> = (1..=8).map(|k| f64::from(k) * 10.0).collect();
        let curve = |x: f64| x - 2e-5 * x * x;
        let s: Vec<f64> = h.iter().map(|h| curve(12.0 * h)).collect();
        let r = Response::fit(&h, &s, &[0.01; 8]).unwrap();
        assert!((r.quadratic.value + 2e-5).abs() < 1e-11, "{r:?}");
        assert!((r.responsivity.value - 12.0).abs() < 1e-6);
        assert!((r.linearise(curve(700.0)) - 700.0).abs() < 1e-6);
    }
}
