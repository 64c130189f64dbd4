//! Colours that no spectrum has: moved to their grey until one has them.

use super::smoothest::{Curve, Domain, REACHED, Smoothest};
use super::space::{D65, luminance, xyz_of};
use crate::delta_e::{delta_e_2000, lab};
use camrig_base::color::{Matrix, XYZ_FROM_SRGB};

/// Halvings of the way to the grey: its last step is below a code of 8 bits for most colours.
const HALVINGS: usize = 7;

/// The spectrum of a colour, and how far the colour was moved for it.
pub struct Reached {
    /// The value in each band.
    pub values: Curve,
    /// ΔE2000 of the colour moved; 0 where it was not.
    pub delta_e: f64,
}

/// The spectrum of a colour in linear sRGB, within the cube of sRGB or outside.
pub fn reach(smoothest: &Smoothest, domain: Domain, rgb: [f64; 3]) -> Reached {
    let whole = smoothest.solve(rgb);
    if whole.residual <= REACHED {
        return Reached { values: whole.values, delta_e: 0.0 };
    }
    let y = luminance(rgb);
    let most = if domain == Domain::Reflectance { 1.0 } else { f64::INFINITY };
    let grey = y.clamp(0.0, most);
    let (mut values, mut part, mut step) = (smoothest.solve([grey; 3]).values, 0.0, 0.5);
    for _ in 0..HALVINGS {
        let next = rgb.map(|c| grey + (part + step) * (c - grey));
        let found = smoothest.solve(next);
        if found.residual <= REACHED {
            (values, part) = (found.values, part + step);
        }
        step /= 2.0;
    }
    Reached { values, delta_e: difference(rgb, smoothest.colour(&values), domain) }
}

/// ΔE2000 of two colours in linear sRGB: relative to white for reflectances, to the larger of their
/// components for emissions.
pub fn difference(one: [f64; 3], two: [f64; 3], domain: Domain) -> f64 {
    let largest = one.iter().chain(&two).copied().fold(f64::MIN_POSITIVE, f64::max);
    let scale = if domain == Domain::Reflectance { 1.0 } else { largest };
    let lab = |rgb: [f64; 3]| {
        let rows: &Matrix = &XYZ_FROM_SRGB;
        let xyz = rows.map(|row| (0..3).map(|c| row[c] * rgb[c] / scale).sum());
        lab(xyz, xyz_of(D65))
    };
    delta_e_2000(lab(one), lab(two))
}
