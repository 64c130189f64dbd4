//! The camera as computer vision takes it: a pinhole with radial distortion.

use super::{lens, sensor_grid};
use camrig_base::{Bands, Error, Result};
use camrig_camera::Camera;
use camrig_formats::mcap::CameraInfo;
use camrig_linear::{LeastSquares, Matrix, Vector};
use camrig_optics::{Options, OverField};

/// The wavelength at which the eye is most sensitive, nm.
const NM: f64 = 555.0;
/// Image heights from the axis to the corner at which the lens is asked.
const HEIGHTS: usize = 64;
/// Largest change of height by distortion that counts as none, pixels.
const NONE_PX: f64 = 1e-6;

/// A camera's figures, and how well they describe its lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Focal length, centre and distortion, pixels.
    pub info: CameraInfo,
    /// Largest distance between places by these figures and by the lens, pixels, up to the corner.
    pub largest_error_px: f64,
}

/// Figures of a camera at 555 nm, for the whole sensor.
///
/// With h the image height of a lens without distortion and f its principal distance
/// ([`camrig_optics::Lens::principal_distance_mm`]), the real height is fitted by least squares as
/// a·h·(1 + k1·r² + k2·r⁴ + k3·r⁶), r = h/f, over heights from the axis to the sensor's corner;
/// then a·f is the focal length. Source: Brown 1966; REP 104's `plumb_bob` without tangential
/// terms, as the lens is centred.
///
/// # Errors
/// Lens data that cannot be read or traced; a lens without rotational symmetry, which those figures
/// do not describe.
pub fn intrinsics(camera: &Camera) -> Result<Intrinsics> {
    let band = Bands { start_nm: NM, step_nm: 1.0, count: 1 };
    let lens = lens(camera, &band, &Options::default())?;
    let grid = sensor_grid(camera);
    let pixels_per_mm = 1e3 / grid.pitch_um;
    let f = lens.principal_distance_mm();
    let axis = lens.axis_mm();
    let corner_mm = grid.corner_mm() + libm::hypot(axis.0, axis.1);
    let ideal: Box<dyn Fn(f64) -> f64 + '_> = match lens.ideal_place(NM) {
        None => Box::new(|real| real),
        Some(OverField::Radial(ideal)) => ideal,
        Some(OverField::Plane(_)) => {
            return Err(Error::unsupported("the lens is not rotationally symmetric")
                .at("intrinsics")
                .help(
                    "radial distortion about an axis does not describe it: choose an output \
                     without intrinsics",
                ));
        }
    };
    let heights: Vec<(f64, f64)> = (1..=HEIGHTS)
        .map(|i| corner_mm * i as f64 / HEIGHTS as f64)
        .map(|real| (ideal(real), real))
        .collect();
    let terms = |h: f64| [h, h * (h / f).powi(2), h * (h / f).powi(4), h * (h / f).powi(6)];
    let bent = |(h, real): &(f64, f64)| (h - real).abs() * pixels_per_mm > NONE_PX;
    let fitted = heights.iter().any(bent).then(|| {
        let design = Matrix::from_fn(HEIGHTS, 4, |i, k| terms(heights[i].0)[k]);
        let data = Vector::from_fn(HEIGHTS, |i, _| heights[i].1);
        LeastSquares::of(&design, &data).map(|fit| [0, 1, 2, 3].map(|k| fit.coefficients[k]))
    });
    let [a, b, c, d] = fitted.flatten().unwrap_or([1.0, 0.0, 0.0, 0.0]);
    let error = |&(h, real): &(f64, f64)| {
        let sum: f64 = terms(h).iter().zip([a, b, c, d]).map(|(term, k)| term * k).sum();
        (sum - real).abs() * pixels_per_mm
    };
    let centre =
        |pixels: usize, axis_mm: f64| (pixels as f64 - 1.0) / 2.0 + axis_mm * pixels_per_mm;
    let info = CameraInfo {
        focal_px: [a * f * pixels_per_mm; 2],
        centre_px: [centre(grid.width, axis.0), centre(grid.height, axis.1)],
        radial: [b / a, c / a, d / a],
    };
    let largest_error_px = heights.iter().map(error).fold(0.0, f64::max);
    Ok(Intrinsics { info, largest_error_px })
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_camera::OpticalEffect;

    fn camera(effects: &[(&str, &[f32])]) -> Camera {
        let mut camera = Camera::load("mt9v024").unwrap();
        camera.optical_effects = effects
            .iter()
            .map(|(kind, values)| OpticalEffect::new(kind, values).unwrap())
            .collect();
        camera
    }

    #[test]
    fn without_distortion_it_is_the_focal_length_over_the_pitch() {
        let camera = camera(&[]);
        let grid = sensor_grid(&camera);
        let f_mm = lens(&camera, &Bands::VISIBLE, &Options::default()).unwrap();
        let f_px = 1e3 * f_mm.principal_distance_mm() / grid.pitch_um;
        let found = intrinsics(&camera).unwrap();
        assert_eq!(found.info.focal_px, [f_px; 2]);
        assert_eq!(found.info.centre_px, [(752.0 - 1.0) / 2.0, (480.0 - 1.0) / 2.0]);
        assert_eq!((found.info.radial, found.largest_error_px), ([0.0; 3], 0.0));
    }

    /// The effect is Brown's polynomial in h over the corner's height: its coefficients come back
    /// in units of h over the principal distance, and size as focal length.
    #[test]
    fn distortion_of_the_same_form_comes_back_exactly() {
        let (k1, k2, size) = (-0.08f32, 0.02f32, 1.01f32);
        let camera = camera(&[("distortion", &[k1, k2, size])]);
        let plain = intrinsics(&self::camera(&[])).unwrap().info;
        let found = intrinsics(&camera).unwrap();
        let (k1, k2, size) = (f64::from(k1), f64::from(k2), f64::from(size));
        let grid = sensor_grid(&camera);
        // h/f at the corner.
        let r = grid.corner_mm() / grid.pitch_um * 1e3 / plain.focal_px[0];
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-6 * b.abs().max(1e-3), "{a} {b}");
        near(found.info.focal_px[0], size * plain.focal_px[0]);
        near(found.info.radial[0], k1 / size / r.powi(2));
        near(found.info.radial[1], k2 / size / r.powi(4));
        assert!(found.largest_error_px < 1e-6, "{}", found.largest_error_px);
    }
}
