//! The response curve: mean signal, DN, over exposure (photons per pixel or another unit of
//! light).

use super::fit::Fit;
use camrig_base::Value;

/// Smallest number of levels for a quadratic: two degrees of freedom remain.
const MIN_LEVELS: usize = 5;
/// Smallest number of levels for a cubic: four degrees of freedom remain.
const MIN_LEVELS_CUBIC: usize = 8;
/// Decrease of χ² for which the cubic term is used, in units of the residual scatter: three
/// standard errors.
const CUBIC_GAIN: f64 = 9.0;
/// Steps of Newton's method, which doubles its digits with each: 8 suffice from any start within a
/// factor of two.
const NEWTON_STEPS: usize = 8;
/// Smallest slope of the curve in Newton's method, which keeps a step beyond the fitted range
/// bounded.
const MIN_SLOPE: f64 = 0.1;

/// `S = x + q x² + c x³`, where x is the signal (DN) of a linear sensor with the same slope at
/// zero. Valid up to the largest signal fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Quadratic coefficient, 1/DN.
    pub quadratic: Value,
    /// Cubic coefficient, 1/DN²; 0 unless it improves the fit.
    pub cubic: f64,
    /// Responsivity: slope at zero, DN per unit of light.
    pub responsivity: Value,
    /// Signal at zero light by extrapolation, DN: other than 0 where exposure times are wrong.
    pub offset: Value,
}

impl Response {
    /// Fits mean signals s (dark subtracted) over amounts of light h, as points (h, s):
    /// `s = offset + R h + q' h²`, and a cubic term where it lowers χ² by more than nine times the
    /// remaining scatter. `None` with fewer than five levels.
    ///
    /// Errors are widened to the scatter, which includes that of the light.
    pub fn fit(points: &[(f64, Value)]) -> Option<Self> {
        if points.len() < MIN_LEVELS {
            return None;
        }
        let to_power = |n: i32| {
            let datum = |&(h, s): &(f64, Value)| ((0..=n).map(|k| f64::powi(h, k)).collect(), s);
            Fit::new(&points.iter().map(datum).collect::<Vec<_>>())
        };
        let mut fit = to_power(2).ok()?;
        if points.len() >= MIN_LEVELS_CUBIC
            && let Ok(cubic) = to_power(3)
            && fit.chi2 - cubic.chi2 > CUBIC_GAIN * cubic.reduced_chi2().max(1.0)
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

    /// Slope dS/dx at x (DN).
    pub fn slope(&self, x: f64) -> f64 {
        1.0 + 2.0 * self.quadratic.value * x + 3.0 * self.cubic * x * x
    }

    /// The linear signal x of a measured signal s, DN, by Newton's method (the curve lies within a
    /// few per cent of its tangent over the fitted range).
    pub fn linearise(&self, s: f64) -> f64 {
        let mut x = s;
        for _ in 0..NEWTON_STEPS {
            let value = x + self.quadratic.value * x * x + self.cubic * x * x * x;
            x -= (value - s) / self.slope(x).max(MIN_SLOPE);
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovers_a_curve_and_inverts_it() {
        let curve = |x: f64| x - 2e-5 * x * x;
        let point = |k: i32| {
            let h = f64::from(k) * 10.0;
            (h, Value::new(curve(12.0 * h), 0.01))
        };
        let r = Response::fit(&(1..=8).map(point).collect::<Vec<_>>()).unwrap();
        assert!((r.quadratic.value + 2e-5).abs() < 1e-11, "{r:?}");
        assert!((r.responsivity.value - 12.0).abs() < 1e-6);
        assert!((r.linearise(curve(700.0)) - 700.0).abs() < 1e-6);
    }
}
