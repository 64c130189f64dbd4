//! The field at which the real chief ray lands at a given height, found from the axis outwards.

use camrig_base::{Error, Result};

/// Steps of the field from the axis and where they end, degrees.
const STEP: f64 = 0.5;
const END: f64 = 179.5;
/// Halvings of a step: the last bits of f64.
const HALVINGS: usize = 50;

/// The smallest field, degrees, whose chief ray lands at `mm`; `height` gives the height of a
/// field, or an error where the ray is lost.
///
/// # Errors
/// No field up to the first lost ray reaches the height.
pub(crate) fn first_field(mm: f64, height: impl Fn(f64) -> Result<f64>) -> Result<f64> {
    if mm == 0.0 {
        return Ok(0.0);
    }
    let (mut low, mut largest) = (0.0, 0.0_f64);
    let mut high = STEP;
    while high <= END {
        match height(high) {
            Ok(h) if h < mm => {
                (low, largest) = (high, largest.max(h));
                high += STEP;
            }
            // Reached, or lost: where between the two fields?
            _ => break,
        }
    }
    let mut reached = false;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match height(middle) {
            Ok(h) if h < mm => (low, largest) = (middle, largest.max(h)),
            Ok(_) => (high, reached) = (middle, true),
            Err(_) => high = middle,
        }
    }
    if reached || height(high).is_ok_and(|h| h >= mm) {
        return Ok(0.5 * (low + high));
    }
    Err(Error::input(format!("no chief ray reaches the image height {mm} mm"))
        .help(format!("the largest height is {largest:.4} mm; give smaller fields")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lost() -> Error {
        Error::input("lost").help("none")
    }

    #[test]
    fn heights_up_to_the_last_ray_are_found() {
        // Rises to 10 at 40°, lost from 40.3° on.
        let height = |deg: f64| match deg < 40.3 {
            true => Ok(deg / 4.0),
            false => Err(lost()),
        };
        assert!((first_field(2.5, height).unwrap() - 10.0).abs() < 1e-9);
        assert!((first_field(10.05, height).unwrap() - 40.2).abs() < 1e-9);
        assert_eq!(first_field(0.0, height).unwrap(), 0.0);
        let error = first_field(10.2, height).unwrap_err().to_string();
        assert!(error.contains("largest height is 10.07"), "{error}");
        // The first of two fields, where the height turns back.
        let arch = |deg: f64| Ok(deg * (60.0 - deg) / 90.0);
        assert!((first_field(8.0, arch).unwrap() - 16.583_592_135_001).abs() < 1e-9);
    }
}
