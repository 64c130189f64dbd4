//! Linear algebra of small matrices of double precision. The principal type is [`LeastSquares`]: a
//! fit with its covariance; inverses and decompositions are functions.
//!
//! The algorithms are those of `nalgebra`, which is generic: what is called through this crate is
//! compiled here, once, instead of in every crate that fits something.
//!
//! ```
//! use camrig_linear::{LeastSquares, Matrix, Vector};
//! // y = 1 + 2 x at x = 0, 1, 2, each with a standard error of 1.
//! let design = Matrix::from_fn(3, 2, |row, column| [1.0, row as f64][column]);
//! let fit = LeastSquares::of(&design, &Vector::from_vec(vec![1.0, 3.0, 5.0])).unwrap();
//! assert!((fit.coefficients[1] - 2.0).abs() < 1e-12);
//! // Variance of the slope: 1 / Σ (x - mean)².
//! assert!((fit.covariance[(1, 1)] - 0.5).abs() < 1e-12);
//! assert!(fit.chi2 < 1e-20);
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

use nalgebra::{Dyn, SVD};

/// A matrix of any size.
pub type Matrix = nalgebra::DMatrix<f64>;
/// A column of any length.
pub type Vector = nalgebra::DVector<f64>;

/// Σ aᵢ bᵢ over the common length.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Mean of values, and their sample variance (divisor n − 1).
pub fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0))
}

/// a b.
///
/// # Panics
/// If a has not as many columns as b has rows.
pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    a * b
}

/// a x.
///
/// # Panics
/// If a has not as many columns as x has entries.
pub fn apply(a: &Matrix, x: &Vector) -> Vector {
    a * x
}

/// xᵀ a x.
///
/// # Panics
/// If a is not a square matrix of as many rows as x has entries.
pub fn quadratic(a: &Matrix, x: &Vector) -> f64 {
    x.dot(&(a * x))
}

/// The inverse by LU decomposition (to four rows in closed form); `None` of a singular matrix.
///
/// # Panics
/// If the matrix is not square.
pub fn inverse(a: Matrix) -> Option<Matrix> {
    a.try_inverse()
}

/// x of a x = b by Cholesky decomposition; `None` where a is not positive definite.
pub fn solve_positive(a: Matrix, b: &Vector) -> Option<Vector> {
    a.cholesky().map(|c| c.solve(b))
}

/// Eigenvalues of a symmetric matrix, the largest first, and their eigenvectors as columns.
pub fn symmetric_eigen(a: Matrix) -> (Vector, Matrix) {
    let eigen = a.symmetric_eigen();
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let n = order.len();
    (
        Vector::from_fn(n, |k, _| eigen.eigenvalues[order[k]]),
        Matrix::from_fn(n, n, |row, k| eigen.eigenvectors[(row, order[k])]),
    )
}

/// Singular value decomposition, for designs whose columns may be dependent.
pub struct Singular(SVD<f64, Dyn, Dyn>);

impl Singular {
    /// Of a matrix.
    pub fn of(a: &Matrix) -> Self {
        Self(a.clone().svd(true, true))
    }

    /// The largest singular value.
    pub fn largest(&self) -> f64 {
        self.0.singular_values.max()
    }

    /// The smallest singular value over the largest; NaN of a matrix of zeros.
    pub fn condition(&self) -> f64 {
        self.0.singular_values.min() / self.largest()
    }

    /// x of least norm that minimises |a x − b|, where singular values up to `least` count as
    /// zero.
    pub fn solve(&self, b: &Vector, least: f64) -> Option<Vector> {
        self.0.solve(b, least).ok()
    }

    /// The pseudo-inverse, where singular values up to `least` count as zero.
    pub fn pseudo_inverse(self, least: f64) -> Option<Matrix> {
        self.0.pseudo_inverse(least).ok()
    }
}

/// Ordinary least squares of data whose standard errors are 1: divide each row of the design and
/// each datum by its standard error beforehand.
pub struct LeastSquares {
    /// One per column of the design.
    pub coefficients: Vector,
    /// Covariance of the coefficients, (aᵀ a)⁻¹.
    pub covariance: Matrix,
    /// Sum of the squared residuals.
    pub chi2: f64,
}

impl LeastSquares {
    /// y ≈ a x by the normal equations; `None` where the columns of a are dependent.
    ///
    /// # Panics
    /// If a has not as many rows as y has entries.
    pub fn of(a: &Matrix, y: &Vector) -> Option<Self> {
        let covariance = (a.transpose() * a).try_inverse()?;
        let coefficients = &covariance * a.transpose() * y;
        let chi2 = (y - a * &coefficients).norm_squared();
        Some(Self { coefficients, covariance, chi2 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dependent_columns_are_told() {
        let a = Matrix::from_fn(4, 2, |row, column| (row + 1) as f64 * (column + 1) as f64);
        let y = Vector::from_vec(vec![1.0, 2.0, 3.0, 4.0]);
        assert!(LeastSquares::of(&a, &y).is_none());
        let singular = Singular::of(&a);
        assert!(singular.condition() < 1e-15);
        // Of all solutions of x₁ + 2 x₂ = 1 the nearest to zero.
        let x = singular.solve(&y, 1e-12 * singular.largest()).unwrap();
        assert!((x[0] - 0.2).abs() < 1e-14 && (x[1] - 0.4).abs() < 1e-14, "{x}");
    }

    #[test]
    fn the_variance_of_a_sample_is_unbiased() {
        assert_eq!(moments(&[1.0, 2.0, 6.0]), (3.0, 7.0));
        assert_eq!(moments(&[4.0]), (4.0, 0.0));
        assert_eq!(dot(&[1.0, 2.0], &[3.0, 4.0, 5.0]), 11.0);
    }

    #[test]
    fn eigenvalues_fall() {
        let a = Matrix::from_row_slice(3, 3, &[2.0, 0.0, 0.0, 0.0, 3.0, 4.0, 0.0, 4.0, 9.0]);
        let (values, vectors) = symmetric_eigen(a.clone());
        assert!((values - Vector::from_vec(vec![11.0, 2.0, 1.0])).norm() < 1e-12);
        let first = Vector::from_column_slice(vectors.column(0).as_slice());
        assert!((quadratic(&a, &first) - 11.0).abs() < 1e-12);
    }
}
