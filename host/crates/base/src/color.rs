//! Matrices between colour spaces of three components.

/// Rows of a 3 x 3 matrix.
pub type Matrix = [[f64; 3]; 3];

/// Linear sRGB (D65 white = 1, 1, 1) to CIE XYZ (Y of white = 1), from the primaries and the white
/// of IEC 61966-2-1.
pub const XYZ_FROM_SRGB: Matrix = [
    [0.412_390_8, 0.357_584_3, 0.180_480_8],
    [0.212_639_0, 0.715_168_7, 0.072_192_3],
    [0.019_330_8, 0.119_194_8, 0.950_532_2],
];

/// Matrix product.
pub fn multiply(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// Inverse by cofactors; `None` for a singular or non-finite matrix.
pub fn inverse(m: &Matrix) -> Option<Matrix> {
    let minor = |i: usize, j: usize| {
        let (r, s) = ((i + 1) % 3, (i + 2) % 3);
        let (c, d) = ((j + 1) % 3, (j + 2) % 3);
        m[r][c] * m[s][d] - m[r][d] * m[s][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
    if !determinant.is_normal() {
        return None;
    }
    Some(std::array::from_fn(|i| std::array::from_fn(|j| minor(j, i) / determinant)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_undoes() {
        let m = [[2.0, 1.0, 0.0], [0.5, 3.0, -1.0], [0.1, 0.2, 4.0]];
        let one = multiply(&m, &inverse(&m).unwrap());
        for (i, row) in one.iter().enumerate() {
            for (j, v) in row.iter().enumerate() {
                assert!((v - f64::from(u8::from(i == j))).abs() < 1e-15);
            }
        }
        assert_eq!(inverse(&[[1.0; 3]; 3]), None);
    }
}
