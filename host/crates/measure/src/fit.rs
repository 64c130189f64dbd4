//! Weighted linear least squares with the covariance of the coefficients.

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
    /// Fits `y ≈ Σ c_j design[i][j]` where `y[i]` has standard error `error[i]`.
    ///
    /// # Errors
    /// Fewer data than coefficients, errors that are not positive, or a design whose columns are
    /// not independent.
    pub fn new(design: &[Vec<f64>], y: &[f64], error: &[f64]) -> Result<Self> {
        let (rows, columns) = (y.len(), design.first().map_or(0, Vec::len));
        if rows < columns || columns == 0 {
            return Err(Error::input(format!("{rows} data for a fit of {columns} unknowns")));
        }
        if !error.iter().all(|e| *e > 0.0 && e.is_finite()) {
            return Err(Error::input("a fit to data without a positive error"));
        }
        // Columns are scaled to unit length, so that their units have no influence on the
        // condition.
        let weighted = Matrix::from_fn(rows, columns, |i, j| design[i][j] / error[i]);
        let scale: Vec<f64> = (0..columns).map(|j| weighted.column(j).norm()).collect();
        let scaled = Matrix::from_fn(rows, columns, |i, j| weighted[(i, j)] / scale[j]);
        let target = Vector::from_fn(rows, |i, _| y[i] / error[i]);
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
        let design: Vec<Vec<f64>> = (0..5).map(|x| vec![1.0, f64::from(x)]).collect();
        let y: Vec<f64> = (0..5).map(|x| 2.0 + 3.0 * f64::from(x)).collect();
        let fit = Fit::new(&design, &y, &[1.0; 5]).unwrap();
        assert!((fit.coefficients[0] - 2.0).abs() < 1e-12);
        assert!((fit.coefficients[1] - 3.0).abs() < 1e-12);
        assert!((fit.covariance(1, 1) - 0.1).abs() < 1e-12);
        assert!((fit.covariance(0, 0) - 0.6).abs() < 1e-12);
        assert!((fit.covariance(0, 1) + 0.2).abs() < 1e-12);
    }

    #[test]
    fn undetermined_coefficients_are_an_error() {
        let design = vec![vec![1.0, 2.0]; 4];
        assert!(Fit::new(&design, &[1.0; 4], &[1.0; 4]).is_err());
        assert!(Fit::new(&[vec![1.0, 0.0]], &[1.0], &[1.0]).is_err());
        assert!(Fit::new(&[vec![1.0], vec![1.0]], &[1.0, 1.0], &[1.0, 0.0]).is_err());
    }
}
