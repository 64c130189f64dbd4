//! Weighted linear least squares with the covariance of the coefficients.

use camrig_base::Value;
use camrig_base::{Error, Result};
use camrig_linear::{Matrix, Singular, Vector, apply, inverse, product};

/// Smallest ratio of singular values of the scaled design with which its columns count as
/// independent: below 1e-10 rounding (1e-16) costs more than six of the sixteen digits.
const MIN_CONDITION: f64 = 1e-10;

/// Result of a weighted least-squares fit.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Fitted coefficients, one per column of the design.
    pub coefficients: Vec<f64>,
    /// Covariance of the coefficients for the given errors of the data.
    covariance: Matrix,
    /// χ²: sum of squared residuals in units of the given errors.
    pub chi2: f64,
    /// Degrees of freedom: number of data minus number of coefficients.
    pub freedom: usize,
}

impl Fit {
    /// Fits `y ≈ Σ c_j x_j` to `data`: for each datum its row x of the design, and y with its
    /// standard error.
    ///
    /// # Errors
    /// Fewer data than coefficients, errors that are not positive, or a design whose columns are
    /// not independent.
    pub fn new(data: &[(Vec<f64>, Value)]) -> Result<Self> {
        let (rows, columns) = (data.len(), data.first().map_or(0, |(row, _)| row.len()));
        let error = |i: usize| data[i].1.std_error;
        if rows < columns || columns == 0 {
            return Err(Error::input(format!("{rows} data for a fit of {columns} unknowns")));
        }
        if !(0..rows).map(error).all(|e| e > 0.0 && e.is_finite()) {
            return Err(Error::input("a fit to data without a positive error"));
        }
        // Columns are scaled to unit length, so that their units have no influence on the
        // condition.
        let weighted = Matrix::from_fn(rows, columns, |i, j| data[i].0[j] / error(i));
        let scale: Vec<f64> = (0..columns).map(|j| weighted.column(j).norm()).collect();
        let scaled = Matrix::from_fn(rows, columns, |i, j| weighted[(i, j)] / scale[j]);
        let target = Vector::from_fn(rows, |i, _| data[i].1.value / error(i));
        let degenerate = || Error::input("the data do not determine every unknown of a fit");
        if scale.iter().any(|s| !(*s > 0.0 && s.is_finite())) {
            return Err(degenerate());
        }
        let singular = Singular::of(&scaled);
        let condition = singular.condition();
        if condition.is_nan() || condition < MIN_CONDITION {
            return Err(degenerate());
        }
        let solution = singular.solve(&target, 0.0).ok_or_else(degenerate)?;
        let residual = &target - apply(&scaled, &solution);
        let normal = product(&scaled.transpose(), &scaled);
        let inverse = inverse(normal).ok_or_else(degenerate)?;
        Ok(Self {
            coefficients: (0..columns).map(|j| solution[j] / scale[j]).collect(),
            covariance: Matrix::from_fn(columns, columns, |i, j| {
                inverse[(i, j)] / (scale[i] * scale[j])
            }),
            chi2: residual.norm_squared(),
            freedom: rows - columns,
        })
    }

    /// χ² per degree of freedom; 1 without degrees of freedom.
    pub fn reduced_chi2(&self) -> f64 {
        if self.freedom == 0 { 1.0 } else { self.chi2 / self.freedom as f64 }
    }

    /// Covariance of coefficients `i` and `j` for the given errors of the data.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        self.covariance[(i, j)]
    }

    /// Standard error of coefficient `j`, increased by √(χ²/ν) where the data scatter more than
    /// their errors.
    pub fn std_error(&self, j: usize) -> f64 {
        (self.covariance[(j, j)] * self.reduced_chi2().max(1.0)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn straight_line_has_textbook_errors() {
        // y = 2 + 3 x at x = 0..4 with unit errors: var(slope) = 1 / Σ(x - 2)² = 1/10,
        // var(intercept) = 1/5 + 4/10.
        let datum = |x: f64| (vec![1.0, x], Value::new(2.0 + 3.0 * x, 1.0));
        let fit = Fit::new(&[0.0, 1.0, 2.0, 3.0, 4.0].map(datum)).unwrap();
        assert!((fit.coefficients[0] - 2.0).abs() < 1e-12);
        assert!((fit.coefficients[1] - 3.0).abs() < 1e-12);
        assert!((fit.covariance(1, 1) - 0.1).abs() < 1e-12);
        assert!((fit.covariance(0, 0) - 0.6).abs() < 1e-12);
        assert!((fit.covariance(0, 1) + 0.2).abs() < 1e-12);
    }

    #[test]
    fn undetermined_coefficients_are_an_error() {
        let datum = |row: &[f64], error| (row.to_vec(), Value::new(1.0, error));
        assert!(Fit::new(&[0; 4].map(|_| datum(&[1.0, 2.0], 1.0))).is_err());
        assert!(Fit::new(&[datum(&[1.0, 0.0], 1.0)]).is_err());
        assert!(Fit::new(&[datum(&[1.0], 1.0), datum(&[1.0], 0.0)]).is_err());
    }
}
