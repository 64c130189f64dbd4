//! Matrices between colour spaces of three components, and the curve of sRGB.

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

/// The sRGB code, 0 to 1, of linear light (IEC 61966-2-1). Values below 0 follow the reflected
/// curve, those above 1 the continued one.
pub fn srgb_code(linear: f64) -> f64 {
    let magnitude = linear.abs();
    let code = if magnitude <= 0.003_130_8 {
        12.92 * magnitude
    } else {
        1.055 * libm::pow(magnitude, 1.0 / 2.4) - 0.055
    };
    code.copysign(linear)
}

/// The sRGB code of linear light from 0 to 1 in 8 bits.
pub fn srgb_byte(linear: f64) -> u8 {
    (srgb_code(linear) * 255.0).round() as u8
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
