//! The median: a mean that a few outliers do not move.

use std::cmp::Ordering;

/// Standard deviation over median absolute deviation of a normal distribution: 1/Φ⁻¹(3/4).
pub const SD_PER_MAD: f64 = 1.482_602_218_505_602;

/// The median of `values`, which are reordered: of an even number the upper of the two in the
/// middle, of none zero.
pub fn median<T: Copy + Default>(values: &mut [T], order: fn(&T, &T) -> Ordering) -> T {
    if values.is_empty() {
        return T::default();
    }
    *values.select_nth_unstable_by(values.len() / 2, order).1
}

/// Robust standard deviation of values from their deviations, by the median of their sizes.
pub fn robust_sd(deviations: impl IntoIterator<Item = f32>) -> f64 {
    let mut sizes: Vec<f32> = deviations.into_iter().map(f32::abs).collect();
    SD_PER_MAD * f64::from(median(&mut sizes, f32::total_cmp))
}

#[cfg(test)]
mod tests {
    use super::{SD_PER_MAD, median, robust_sd};

    #[test]
    fn the_value_in_the_middle_whatever_the_order() {
        assert_eq!(median(&mut [5.0, 1.0, 1e9], f64::total_cmp), 5.0);
        assert_eq!(median(&mut [4.0, 3.0, 1.0, 2.0f32], f32::total_cmp), 3.0);
        assert_eq!(median(&mut [], f32::total_cmp), 0.0);
        assert_eq!(robust_sd([-1.0, 2.0, 1e9]), 2.0 * SD_PER_MAD);
    }
}
