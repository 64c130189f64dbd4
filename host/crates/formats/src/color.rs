//! DNG colour matrices from spectral sensitivities.
//!
//! A training set of reflectances is lit by an illuminant; its tristimulus values XYZ and camera
//! responses are computed by the same sum over wavelength, and the matrix M minimises Σ |camera −
//! M XYZ|² over the set under the condition that white is exact: M XYZ(white) = camera(white).
//! Without the condition a converter that finds the scene's white from the camera's neutral (DNG
//! specification 1.4, chapter 6) would find a wrong one. Both are scaled to white: Y = 1 and the
//! largest channel 1. All in f64.

use camrig_base::color::Matrix;
use camrig_base::{Error, Result, Spectrum};

/// Range and step of the sums, nm: CIE 1931 2° functions at 10 nm (CIE 015).
const FIRST_NM: i32 = 380;
const LAST_NM: i32 = 780;
const STEP_NM: usize = 10;

/// Smallest determinant of the normal equations, relative to the product of their diagonal, for
/// which reflectances count as different colours. Colours on one line through white leave only the
/// rounding of f64 sums, below 1e-14; this is well above it and loses no usable set.
const MIN_DETERMINANT: f64 = 1e-12;

/// A camera's colour under one illuminant: the matrix from XYZ, and the camera's neutral.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorFit {
    /// XYZ (white: Y = 1) to camera (white: largest channel 1).
    pub camera_from_xyz: Matrix,
    /// Camera R, G, B of a white in this light, the largest 1: DNG's AsShotNeutral.
    pub neutral: [f64; 3],
    /// Root-mean-square residual over the training set and the channels, as a fraction of white.
    pub rms: f64,
}

/// Camera R, G, B of a white in this light, the largest 1.
///
/// `sensitivity` is per channel, in units proportional to electrons per **energy** (quantum
/// efficiency times wavelength, filters and lens included); `light` is spectral power per nm, up
/// to a factor.
///
/// # Errors
/// A camera without a response to this light between 380 and 780 nm.
pub fn neutral(sensitivity: &[Spectrum; 3], light: &Spectrum) -> Result<[f64; 3]> {
    let white = respond(sensitivity, light, &Spectrum::constant(1.0));
    let top = white.iter().copied().fold(0.0, f64::max);
    if top <= 0.0 || top.is_nan() {
        return Err(Error::input(
            "a camera that sees nothing of the light between 380 and 780 nm",
        )
        .help("check the units of the quantum efficiency and of the illuminant"));
    }
    Ok(white.map(|v| v / top))
}

/// Fits the matrix from XYZ to camera R, G, B for one illuminant.
///
/// `sensitivity` and `light` as in [`neutral`]; `xyz` are the colour-matching functions;
/// `reflectances` is the training set (the 24 ColorChecker patches, say), at least three that are
/// not grey.
///
/// # Errors
/// Those of [`neutral`], light without visible power, reflectances that do not span the colours.
pub fn fit(
    sensitivity: &[Spectrum; 3],
    light: &Spectrum,
    xyz: &[Spectrum; 3],
    reflectances: &[Spectrum],
) -> Result<ColorFit> {
    let white_reflectance = Spectrum::constant(1.0);
    let neutral = neutral(sensitivity, light)?;
    let raw_white = respond(sensitivity, light, &white_reflectance);
    let camera_scale = 1.0 / raw_white.iter().copied().fold(0.0, f64::max);
    let xyz_white = respond(xyz, light, &white_reflectance);
    if xyz_white[1] <= 0.0 {
        return Err(Error::input("an illuminant without visible light"));
    }
    let white = xyz_white.map(|v| v / xyz_white[1]);

    // XYZ split along white and perpendicular to it: the condition fixes the first part, the fit
    // is free in the second.
    let (u, v) = across(&white);
    let length = dot(&white, &white);
    let (mut uu, mut uv, mut vv) = (0.0, 0.0, 0.0);
    let (mut ru, mut rv) = ([0.0; 3], [0.0; 3]);
    let samples: Vec<([f64; 3], [f64; 3])> = reflectances
        .iter()
        .map(|reflectance| {
            let x = respond(xyz, light, reflectance).map(|t| t / xyz_white[1]);
            let c = respond(sensitivity, light, reflectance).map(|t| t * camera_scale);
            (x, c)
        })
        .collect();
    for (x, c) in &samples {
        let (a, b, along) = (dot(&u, x), dot(&v, x), dot(&white, x) / length);
        uu += a * a;
        uv += a * b;
        vv += b * b;
        for k in 0..3 {
            let residual = c[k] - neutral[k] * along;
            ru[k] += residual * a;
            rv[k] += residual * b;
        }
    }
    let determinant = uu * vv - uv * uv;
    if determinant <= MIN_DETERMINANT * uu * vv {
        return Err(Error::input("reflectances that do not span the colours")
            .help("give at least three different colours besides grey"));
    }
    let camera_from_xyz: Matrix = std::array::from_fn(|k| {
        let p = (ru[k] * vv - rv[k] * uv) / determinant;
        let q = (rv[k] * uu - ru[k] * uv) / determinant;
        std::array::from_fn(|j| neutral[k] * white[j] / length + p * u[j] + q * v[j])
    });
    let squares: f64 = samples
        .iter()
        .flat_map(|(x, c)| (0..3).map(move |k| (c[k] - dot(&camera_from_xyz[k], x)).powi(2)))
        .sum();
    let rms = (squares / (3 * samples.len()) as f64).sqrt();
    Ok(ColorFit { camera_from_xyz, neutral, rms })
}

/// Σ curve · light · reflectance over the range, for three curves.
fn respond(curves: &[Spectrum; 3], light: &Spectrum, reflectance: &Spectrum) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for nm in (FIRST_NM..=LAST_NM).step_by(STEP_NM).map(f64::from) {
        let stimulus = light.at(nm) * reflectance.at(nm);
        for (sum, curve) in sum.iter_mut().zip(curves) {
            // A table's end value says nothing of what lies beyond its end.
            let (first, last) = curve.range_nm();
            if (first..=last).contains(&nm) {
                *sum += curve.at(nm) * stimulus;
            }
        }
    }
    sum
}

/// Two orthonormal vectors perpendicular to `w`.
fn across(w: &[f64; 3]) -> ([f64; 3], [f64; 3]) {
    let unit = |a: [f64; 3]| {
        let n = dot(&a, &a).sqrt();
        a.map(|t| t / n)
    };
    let cross = |a: &[f64; 3], b: &[f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    // White has no component near zero, so this is not parallel to it.
    let u = unit(cross(w, &[1.0, 0.0, 0.0]));
    (u, unit(cross(w, &u)))
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bump(centre: f64, width: f64) -> Spectrum {
        let nm: Vec<f64> = (38..=78).map(|n| f64::from(n) * 10.0).collect();
        let value = nm.iter().map(|n| (-((n - centre) / width).powi(2)).exp()).collect();
        Spectrum::new(nm, value).unwrap()
    }

    /// A camera whose sensitivities are a known mixture of the colour-matching functions (the
    /// Luther condition) has that mixture as its exact matrix, up to the scale of white.
    #[test]
    fn a_colorimetric_camera_gives_its_own_mixture() {
        let xyz = [bump(600.0, 50.0), bump(555.0, 55.0), bump(450.0, 30.0)];
        let mixture: Matrix = [[0.9, 0.2, 0.05], [-0.3, 1.2, 0.1], [0.02, -0.1, 0.8]];
        let nm: Vec<f64> = (38..=78).map(|n| f64::from(n) * 10.0).collect();
        let camera = mixture.map(|row| {
            let value = nm.iter().map(|&n| (0..3).map(|k| row[k] * xyz[k].at(n)).sum()).collect();
            Spectrum::new(nm.clone(), value).unwrap()
        });
        let light = Spectrum::new(vec![380.0, 780.0], vec![0.6, 1.4]).unwrap();
        let patches: Vec<_> = (0..8).map(|i| bump(400.0 + 45.0 * f64::from(i), 40.0)).collect();
        let fit = fit(&camera, &light, &xyz, &patches).unwrap();
        let scale = fit.camera_from_xyz[1][1] / mixture[1][1];
        // Rounding of sums of 41 terms and of the normal equations' condition (< 1e3).
        let found = fit.camera_from_xyz.as_flattened().iter();
        for (found, expected) in found.zip(mixture.as_flattened()) {
            assert!((found - scale * expected).abs() < 1e-11);
        }
        assert!(fit.rms < 1e-12);
        assert_eq!(fit.neutral.iter().copied().fold(0.0, f64::max), 1.0);
    }

    /// White is exact whatever the camera, by construction.
    #[test]
    fn white_is_exact() {
        let xyz = [bump(600.0, 50.0), bump(555.0, 55.0), bump(450.0, 30.0)];
        let camera = [bump(620.0, 40.0), bump(530.0, 60.0), bump(470.0, 35.0)];
        let light = Spectrum::constant(1.0);
        let patches: Vec<_> = (0..8).map(|i| bump(400.0 + 45.0 * f64::from(i), 40.0)).collect();
        let fit = fit(&camera, &light, &xyz, &patches).unwrap();
        let white = respond(&xyz, &light, &light);
        for k in 0..3 {
            let camera = dot(&fit.camera_from_xyz[k], &white) / white[1];
            assert!((camera - fit.neutral[k]).abs() < 1e-12);
        }
        assert!(fit.rms > 1e-4, "this camera is no linear mixture: {}", fit.rms);
    }
}
