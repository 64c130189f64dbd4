//! Colour error of a developed picture of the ColorChecker, in ΔE2000 per patch.
//!
//! The reference is the CIE XYZ of the patches' reflectances under D65, the white of sRGB, to
//! which a converter's white balance should lead from any light. The picture is first scaled to
//! the reference luminance of the white patch, so that exposure has no influence. ΔE2000 is
//! computed in CIELAB relative to D65.

use camrig_base::color::XYZ_FROM_SRGB;
use camrig_base::{Error, Plane, Result, Spectrum, Value};
use camrig_light::delta_e::{delta_e_2000, lab};
use camrig_light::{Illuminant, photometry};
use camrig_scene::chart::colorchecker;
use serde::Serialize;

/// Index of the white patch (19), counted from 0.
const WHITE: usize = 18;
/// Side of the averaged square relative to the patch: demosaicing and sharpening change colours
/// near the edges.
const MIDDLE: f64 = 0.5;

/// Colour of one patch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Patch {
    /// Number on the chart, 1 to 24.
    pub number: usize,
    /// CIELAB of the patch's reflectance under D65.
    pub true_lab: [f64; 3],
    /// CIELAB in the picture, scaled.
    pub lab: [f64; 3],
    /// Difference, ΔE2000.
    pub delta_e_2000: Value,
}

/// Mean and largest difference of patches, ΔE2000.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ColourError {
    /// Mean over the patches.
    pub delta_e_2000_mean: Value,
    /// Largest of the patches.
    pub delta_e_2000_max: Value,
}

impl ColourError {
    /// Of patches. A simulated chart has no standard error of its colours.
    #[must_use]
    pub fn of(patches: &[Patch]) -> Self {
        let all = || patches.iter().map(|p| p.delta_e_2000.value);
        Self {
            delta_e_2000_mean: Value::chosen(all().sum::<f64>() / patches.len() as f64),
            delta_e_2000_max: Value::chosen(all().fold(0.0, f64::max)),
        }
    }
}

/// Linear value (0 to 1) of an sRGB value (0 to 1), IEC 61966-2-1.
pub fn srgb_to_linear(v: f64) -> f64 {
    if v <= 0.04045 { v / 12.92 } else { libm::pow((v + 0.055) / 1.055, 2.4) }
}

/// Where the built-in chart is in a picture.
#[derive(Clone, Copy, Debug)]
pub struct Card {
    /// Width of the raw frame, pixels; the picture may lack a border all round.
    pub frame_width: usize,
    /// Width of the chart, sensor widths.
    pub card_width: f64,
}

/// Colours of the patches of the built-in chart in a picture of linear sRGB.
///
/// # Errors
/// A picture too small for the chart, or one in which the white patch is black.
pub fn colours(picture: &Plane<[f64; 3]>, card: Card) -> Result<Vec<Patch>> {
    let too_small = || {
        Error::input(format!("a picture of {} x {} pixels", picture.width, picture.height))
            .help("the whole chart must be in it, at one picture pixel per sensor pixel")
    };
    let mut found = Vec::with_capacity(colorchecker::COLUMNS * colorchecker::ROWS);
    for index in 0..colorchecker::COLUMNS * colorchecker::ROWS {
        let [left, top, edge] = colorchecker::patch(index, card.card_width);
        let span = |start: f64, size: usize| {
            let at = |t: f64| (start + t * edge) * card.frame_width as f64 + size as f64 / 2.0;
            let (first, last) = (at(0.5 - MIDDLE / 2.0), at(0.5 + MIDDLE / 2.0));
            let fits = first >= 0.0 && last <= size as f64 && last - first >= 1.0;
            fits.then_some(first as usize..(last as usize).max(first as usize + 1))
        };
        let columns = span(left, picture.width).ok_or_else(too_small)?;
        let rows = span(top, picture.height).ok_or_else(too_small)?;
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for y in rows {
            for pixel in &picture.row(y)[columns.clone()] {
                (0..3).for_each(|c| sum[c] += pixel[c]);
                count += 1.0;
            }
        }
        let mean = sum.map(|s| s / count);
        found.push(XYZ_FROM_SRGB.map(|row| row.iter().zip(mean).map(|(m, c)| m * c).sum::<f64>()));
    }
    let truth = truth()?;
    if !(found[WHITE][1] > 0.0) {
        return Err(Error::input("the white patch is black in the picture")
            .help("the chart must be at the position of the built-in one"));
    }
    let scale = truth[WHITE][1] / found[WHITE][1];
    let white = XYZ_FROM_SRGB.map(|row| row.iter().sum());
    Ok(truth
        .iter()
        .zip(&found)
        .enumerate()
        .map(|(i, (truth, found))| {
            let (true_lab, lab) = (lab(*truth, white), lab(found.map(|v| v * scale), white));
            let delta_e_2000 = Value::chosen(delta_e_2000(true_lab, lab));
            Patch { number: i + 1, true_lab, lab, delta_e_2000 }
        })
        .collect())
}

/// CIE XYZ of the patches' reflectances under D65, a perfect white at Y = 1.
fn truth() -> Result<Vec<[f64; 3]>> {
    let light = Illuminant::parse("D65")?.power;
    let lit = |reflectance: &Spectrum| -> Result<[f64; 3]> {
        let nm: Vec<f64> = (380..=780).step_by(5).map(f64::from).collect();
        let power = nm.iter().map(|&n| light.at(n) * reflectance.at(n)).collect();
        Ok(photometry::xyz(&Spectrum::new(nm, power)?))
    };
    let white = lit(&Spectrum::constant(1.0))?[1];
    let table = colorchecker::reflectances();
    (0..table.curves.len()).map(|i| Ok(lit(&table.spectrum(i)?)?.map(|v| v / white))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture painted with the true colours, at any exposure, has no error; a tint has one.
    #[test]
    fn true_colours_have_no_error() {
        let truth = truth().unwrap();
        let inverse = camrig_base::color::inverse(&XYZ_FROM_SRGB).unwrap();
        let (width, height) = (360, 240);
        let card = Card { frame_width: width, card_width: 0.8 };
        let mut picture = Plane::filled(width, height, [0.01; 3]);
        for (index, xyz) in truth.iter().enumerate() {
            let rgb =
                inverse.map(|row| 0.7 * row.iter().zip(xyz).map(|(m, v)| m * v).sum::<f64>());
            let [left, top, edge] = colorchecker::patch(index, card.card_width);
            let at = |t: f64, size: usize| (t * width as f64 + size as f64 / 2.0) as usize;
            for y in at(top, height)..at(top + edge, height) {
                picture.row_mut(y)[at(left, width)..at(left + edge, width)].fill(rgb);
            }
        }
        let patches = colours(&picture, card).unwrap();
        assert!(patches.iter().all(|p| p.delta_e_2000.value < 1e-6), "{patches:?}");
        // A missing border has no effect.
        let cut = Plane::from_fn(width - 16, height - 16, |x, y| picture.at(x + 8, y + 8));
        assert!(colours(&cut, card).unwrap().iter().all(|p| p.delta_e_2000.value < 1e-6));
        picture.data.iter_mut().for_each(|p| p[0] *= 1.2);
        assert!(colours(&picture, card).unwrap().iter().any(|p| p.delta_e_2000.value > 3.0));
        assert!(colours(&Plane::filled(20, 10, [0.5; 3]), card).is_err());
    }
}
