//! Previews of scenes: CIE 1931 colour under an illuminant, as sRGB.

use super::{Grid, Quantity, Scene};
use camrig_base::color::srgb_byte;
use camrig_base::{Plane, Result};
use camrig_light::Illuminant;
use camrig_light::photometry::observer_in_bands;

/// CIE XYZ (Y of white = 1, D65) to linear sRGB, IEC 61966-2-1.
const SRGB_FROM_XYZ: [[f64; 3]; 3] = [
    [3.240_969_9, -1.537_383_2, -0.498_610_8],
    [-0.969_243_6, 1.875_967_5, 0.041_555_1],
    [0.055_630_1, -0.203_977_0, 1.056_971_5],
];

/// Share of the pixels of a radiance scene that its white leaves below: the brightest per cent,
/// light sources and highlights, are clipped.
const WHITE_PERCENTILE: usize = 99;

/// CIE XYZ of D65, Y = 1.
const D65: [f64; 3] = [0.950_456, 1.0, 1.089_058];

/// The scene as 8-bit sRGB, its longer side `longest` pixels, 4:3 where it fills any frame. A
/// reflectance scene is lit by `light`, whose white becomes sRGB white (X, Y and Z are scaled
/// separately); a radiance scene is scaled so that the 99th percentile of luminance is white.
///
/// # Errors
/// Those of [`Scene::plane`].
pub fn render(scene: &dyn Scene, light: &Illuminant, longest: usize) -> Result<Plane<[u8; 3]>> {
    let aspect = scene.aspect().unwrap_or(4.0 / 3.0);
    let (width, height) = if aspect >= 1.0 {
        (longest, (longest as f64 / aspect).round().max(1.0) as usize)
    } else {
        ((longest as f64 * aspect).round().max(1.0) as usize, longest)
    };
    let cell = 1.0 / width as f64;
    let grid = Grid { width, height, left: -0.5, top: -0.5 * height as f64 * cell, cell };
    let bands = scene.bands();
    let observer = observer_in_bands(&bands);
    let power = match scene.quantity() {
        Quantity::Reflectance => light.in_bands(&bands),
        Quantity::Radiance => vec![1.0; bands.count],
    };
    let mut xyz = vec![[0.0; 3]; width * height];
    let mut white = [0.0; 3];
    for band in 0..bands.count {
        let weight = [0, 1, 2].map(|i| observer[i][band] * power[band]);
        let plane = scene.plane(band, &grid)?;
        for (sum, value) in xyz.iter_mut().zip(&plane.data) {
            for i in 0..3 {
                sum[i] += weight[i] * f64::from(*value);
            }
        }
        for i in 0..3 {
            white[i] += weight[i];
        }
    }
    let scale = match scene.quantity() {
        Quantity::Reflectance => [0, 1, 2].map(|i| D65[i] / white[i]),
        Quantity::Radiance => {
            let mut luminance: Vec<f64> = xyz.iter().map(|v| v[1]).collect();
            luminance.sort_by(f64::total_cmp);
            let white =
                luminance[(luminance.len() - 1) * WHITE_PERCENTILE / 100].max(f64::MIN_POSITIVE);
            [1.0 / white; 3]
        }
    };
    let data = xyz.iter().map(|v| srgb([0, 1, 2].map(|i| v[i] * scale[i]))).collect();
    Ok(Plane { width, height, data })
}

/// sRGB code values of an XYZ colour relative to D65 white, clipped to the gamut.
pub fn srgb(xyz: [f64; 3]) -> [u8; 3] {
    SRGB_FROM_XYZ.map(|row| {
        let linear = (row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2]).clamp(0.0, 1.0);
        srgb_byte(linear)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::open;

    /// A neutral of reflectance 0.18 is sRGB 118 under any light (18 % grey), white is white.
    #[test]
    fn greys_are_grey_under_any_light() {
        for light in ["D65", "A", "F11"] {
            let light = Illuminant::parse(light).unwrap();
            let picture = render(&*open("uniform:0.18").unwrap().unwrap(), &light, 4).unwrap();
            assert!(picture.data.iter().flatten().all(|&v| v == 118), "{:?}", picture.data[0]);
            let picture = render(&*open("uniform:1").unwrap().unwrap(), &light, 4).unwrap();
            assert!(picture.data.iter().flatten().all(|&v| v == 255), "{:?}", picture.data[0]);
        }
    }
}
