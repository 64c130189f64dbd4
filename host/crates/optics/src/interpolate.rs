//! Shape-preserving interpolation of tabulated curves over image height.

/// A monotone piecewise-cubic curve through tabulated points (Fritsch and Carlson 1980), continued
/// beyond both ends along its end slopes.
///
/// Where the data rise strictly the curve does, so it has an inverse; between neighbours it never
/// leaves their range. Third-order accurate for smooth data.
#[derive(Clone, Debug, PartialEq)]
pub struct MonotoneCubic {
    x: Vec<f64>,
    y: Vec<f64>,
    slope: Vec<f64>,
}

impl MonotoneCubic {
    /// The curve through `(x[i], y[i])`; `x` strictly rising, both of the same length, at least
    /// one.
    ///
    /// # Panics
    /// When the lengths differ or are 0: callers hold validated tables.
    #[must_use]
    pub fn new(x: Vec<f64>, y: Vec<f64>) -> Self {
        assert!(!x.is_empty() && x.len() == y.len(), "a curve needs one y per x, at least one");
        let n = x.len();
        let secant: Vec<f64> = (1..n).map(|i| (y[i] - y[i - 1]) / (x[i] - x[i - 1])).collect();
        let slope = (0..n)
            .map(|i| match (i.checked_sub(1).map(|j| secant[j]), secant.get(i).copied()) {
                (None, None) => 0.0,
                (None, Some(s)) => end_slope(s, secant.get(1), &x[..3.min(n)]),
                (Some(s), None) => {
                    let tail = &x[n.saturating_sub(3)..];
                    let mirrored: Vec<f64> = tail.iter().rev().map(|v| -v).collect();
                    end_slope(s, n.checked_sub(3).map(|j| &secant[j]), &mirrored)
                }
                (Some(a), Some(b)) => inner_slope(a, b, x[i] - x[i - 1], x[i + 1] - x[i]),
            })
            .collect();
        Self { x, y, slope }
    }

    /// The value at `x`.
    #[must_use]
    pub fn at(&self, x: f64) -> f64 {
        let last = self.x.len() - 1;
        if x <= self.x[0] {
            return self.y[0] + self.slope[0] * (x - self.x[0]);
        }
        if x >= self.x[last] {
            return self.y[last] + self.slope[last] * (x - self.x[last]);
        }
        let i = self.x.partition_point(|&v| v <= x) - 1;
        let h = self.x[i + 1] - self.x[i];
        let t = (x - self.x[i]) / h;
        let (t2, t3) = (t * t, t * t * t);
        self.y[i] * (2.0 * t3 - 3.0 * t2 + 1.0)
            + self.y[i + 1] * (3.0 * t2 - 2.0 * t3)
            + h * (self.slope[i] * (t3 - 2.0 * t2 + t) + self.slope[i + 1] * (t3 - t2))
    }

    /// The x at which a strictly rising curve has the value `y`, by bisection to the last bit or
    /// so; beyond the table along the end slopes.
    #[must_use]
    pub fn inverse(&self, y: f64) -> f64 {
        let last = self.x.len() - 1;
        for end in [0, last] {
            let beyond = if end == 0 { y <= self.y[0] } else { y >= self.y[last] };
            if beyond {
                return self.x[end] + (y - self.y[end]) / self.slope[end].max(f64::MIN_POSITIVE);
            }
        }
        let i = self.y.partition_point(|&v| v <= y) - 1;
        let (mut low, mut high) = (self.x[i], self.x[i + 1]);
        // 60 halvings exhaust the 53 bits of f64.
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.at(middle) <= y { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }
}

/// Parabolic slope at an inner point, limited to three times the smaller secant so that the curve
/// stays monotone (Fritsch and Carlson 1980).
fn inner_slope(before: f64, after: f64, h_before: f64, h_after: f64) -> f64 {
    if before * after <= 0.0 {
        return 0.0;
    }
    let parabolic = (h_after * before + h_before * after) / (h_before + h_after);
    let limit = 3.0 * before.abs().min(after.abs());
    parabolic.clamp(-limit, limit)
}

/// Parabolic slope at the first point of `x` given its secant and the next one.
fn end_slope(secant: f64, next: Option<&f64>, x: &[f64]) -> f64 {
    let Some(&next) = next else { return secant };
    let (h0, h1) = (x[1] - x[0], x[2] - x[1]);
    let slope = secant + (secant - next) * h0 / (h0 + h1);
    // In units of the secant: at least a tenth, so that a rising curve keeps rising beyond its
    // table; at most 3, so that it is monotone inside (Fritsch and Carlson 1980).
    if secant == 0.0 { 0.0 } else { (slope / secant).clamp(0.1, 3.0) * secant }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_through_points_and_reproduces_a_parabola_exactly() {
        let x = vec![0.0, 0.5, 1.25, 2.0, 3.0];
        let f = |x: f64| 1.0 + 2.0 * x + 0.25 * x * x;
        let curve = MonotoneCubic::new(x.clone(), x.iter().map(|&x| f(x)).collect());
        for k in 0..=60 {
            let x = k as f64 / 20.0;
            assert!((curve.at(x) - f(x)).abs() < 1e-12, "at {x}");
        }
    }

    #[test]
    fn inverse_undoes_the_curve_inside_and_beyond_the_table() {
        let curve = MonotoneCubic::new(vec![0.0, 1.0, 2.0, 3.0], vec![0.0, 0.9, 2.1, 2.2]);
        for k in -10..=50 {
            let x = k as f64 / 10.0;
            assert!((curve.inverse(curve.at(x)) - x).abs() < 1e-9, "at {x}");
        }
    }

    #[test]
    fn never_leaves_the_range_of_neighbours() {
        let curve = MonotoneCubic::new(vec![0.0, 1.0, 2.0, 3.0], vec![0.0, 0.0, 1.0, 1.0]);
        for k in 0..=30 {
            let y = curve.at(k as f64 / 10.0);
            assert!((0.0..=1.0).contains(&y));
        }
    }
}
