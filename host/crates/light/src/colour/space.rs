//! Colour spaces of pictures: primaries and white, and what takes them to linear sRGB.

use super::transfer::Transfer;
use camrig_base::color::{Matrix, XYZ_FROM_SRGB, inverse, multiply};
use camrig_base::{Error, Result};
use std::array::from_fn;

/// Chromaticity (x, y) of CIE D65 as the standards of colour spaces round it.
pub const D65: [f64; 2] = [0.3127, 0.3290];
/// Chromaticity of the white of ACES (about 6000 K).
const ACES_WHITE: [f64; 2] = [0.32168, 0.33767];
/// Cone responses of XYZ after K. Lam and Bradford, as ICC.1 and CIE 015 give them.
const BRADFORD: Matrix =
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];
const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// Matrices closer than this to the identity differ from it by the rounding of profiles, whose
/// numbers have 16 bits behind the point and were rounded to 4 decimals before.
const PROFILE_ROUNDING: f64 = 1.5e-3;

/// Chromaticities of red, green and blue, and of the white they add up to.
pub type Chromaticities = [[f64; 2]; 4];

/// sRGB, IEC 61966-2-1, and Rec. 709.
pub const SRGB: Chromaticities = [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], D65];
/// ITU-R BT.2020.
pub const REC2020: Chromaticities = [[0.708, 0.292], [0.170, 0.797], [0.131, 0.046], D65];
/// ACEScg, S-2014-004.
pub const ACESCG: Chromaticities = [[0.713, 0.293], [0.165, 0.830], [0.128, 0.044], ACES_WHITE];
/// Display P3: SMPTE EG 432-1 with D65.
pub const DISPLAY_P3: Chromaticities = [[0.680, 0.320], [0.265, 0.690], [0.150, 0.060], D65];
/// Adobe RGB (1998).
pub const ADOBE_RGB: Chromaticities = [[0.64, 0.33], [0.21, 0.71], [0.15, 0.06], D65];

/// The power of Adobe RGB (1998), 4.3.4.2.
pub const ADOBE_GAMMA: f64 = 563.0 / 256.0;

/// What the samples of a picture mean.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// Its name, in words.
    pub name: String,
    /// Linear components to linear sRGB; none where they are it.
    pub to_srgb: Option<Matrix>,
    /// Code to linear light, per channel.
    pub transfer: [Transfer; 3],
}

impl Space {
    /// The space of these primaries.
    ///
    /// # Errors
    /// Chromaticities that span no colours.
    pub fn of(name: &str, primaries: &Chromaticities, transfer: Transfer) -> Result<Self> {
        let from = xyz_from_rgb(primaries)
            .ok_or_else(|| Error::input(format!("primaries {primaries:?} span no colours")))?;
        let adapted = multiply(&adaptation(xyz_of(primaries[3]), xyz_of(D65)), &from);
        Ok(Self::adapted(name, &adapted, from_fn(|_| transfer.clone())))
    }

    /// The space whose linear components these columns of XYZ (relative to D65) belong to.
    fn adapted(name: &str, xyz_d65: &Matrix, transfer: [Transfer; 3]) -> Self {
        let to_srgb = multiply(&srgb_from_xyz(), xyz_d65);
        let off = |r: usize, c: usize| (to_srgb[r][c] - IDENTITY[r][c]).abs();
        let same = (0..9).all(|i| off(i / 3, i % 3) < PROFILE_ROUNDING);
        Self { name: name.into(), to_srgb: (!same).then_some(to_srgb), transfer }
    }

    /// The space of an ICC profile, whose columns are XYZ relative to the profile's own white:
    /// their sum is taken as white.
    pub fn of_columns(name: &str, columns: &Matrix, transfer: [Transfer; 3]) -> Self {
        let white = columns.map(|row| row.iter().sum());
        let adapted = multiply(&adaptation(white, xyz_of(D65)), columns);
        Self::adapted(name, &adapted, transfer)
    }

    /// XYZ, relative to D65.
    pub fn xyz() -> Self {
        Self::adapted("XYZ (of D65)", &IDENTITY, [const { Transfer::Linear }; 3])
    }

    /// sRGB.
    pub fn srgb() -> Self {
        Self { name: "sRGB".into(), to_srgb: None, transfer: [const { Transfer::Srgb }; 3] }
    }

    /// Linear sRGB.
    pub fn linear_srgb() -> Self {
        let name = "linear Rec. 709 (the primaries of sRGB)".into();
        Self { name, to_srgb: None, transfer: [const { Transfer::Linear }; 3] }
    }

    /// The same primaries with another transfer.
    #[must_use]
    pub fn with(mut self, transfer: &Transfer) -> Self {
        self.name = format!("{} with a transfer of {}", self.name, transfer.name());
        self.transfer = from_fn(|_| transfer.clone());
        self
    }

    /// Linear sRGB of linear components.
    #[inline]
    pub fn linear_srgb_of(&self, rgb: [f64; 3]) -> [f64; 3] {
        self.to_srgb.map_or(rgb, |m| m.map(|row| (0..3).map(|c| row[c] * rgb[c]).sum()))
    }
}

/// Y of a colour in linear sRGB.
#[inline]
pub fn luminance(rgb: [f64; 3]) -> f64 {
    (0..3).map(|c| XYZ_FROM_SRGB[1][c] * rgb[c]).sum()
}

/// XYZ of a chromaticity with Y = 1.
pub fn xyz_of([x, y]: [f64; 2]) -> [f64; 3] {
    [x / y, 1.0, (1.0 - x - y) / y]
}

/// XYZ (Y of white 1) to linear sRGB.
pub fn srgb_from_xyz() -> Matrix {
    // The primaries of sRGB span colours, so that there is always an inverse.
    xyz_from_rgb(&SRGB).and_then(|m| inverse(&m)).unwrap_or(IDENTITY)
}

/// Linear components to XYZ, the white of the primaries having Y = 1.
fn xyz_from_rgb(primaries: &Chromaticities) -> Option<Matrix> {
    let [red, green, blue, white] = primaries;
    let column = |[x, y]: &[f64; 2]| [*x, *y, 1.0 - x - y];
    let (r, g, b) = (column(red), column(green), column(blue));
    let columns: Matrix = [0, 1, 2].map(|i| [r[i], g[i], b[i]]);
    let white = xyz_of(*white);
    let amounts = inverse(&columns)?.map(|row| (0..3).map(|c| row[c] * white[c]).sum::<f64>());
    let whole = columns.map(|row| [0, 1, 2].map(|c| row[c] * amounts[c]));
    whole.iter().flatten().all(|v| v.is_finite()).then_some(whole)
}

/// The adaptation of one white (XYZ) to another, by von Kries on Bradford's responses.
fn adaptation(from: [f64; 3], to: [f64; 3]) -> Matrix {
    let response =
        |xyz: [f64; 3]| BRADFORD.map(|row| (0..3).map(|c| row[c] * xyz[c]).sum::<f64>());
    let (from, to) = (response(from), response(to));
    let mut gains = BRADFORD;
    for (row, (from, to)) in gains.iter_mut().zip(from.iter().zip(to)) {
        row.iter_mut().for_each(|v| *v *= to / from);
    }
    inverse(&BRADFORD).map_or(IDENTITY, |back| multiply(&back, &gains))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The published matrices of linear Rec. 2020 and ACEScg to linear sRGB (ITU-R BT.2087; the
    /// ACES project's, Bradford).
    #[test]
    fn known_spaces_have_their_published_matrices() {
        let rec2020 = Space::of("Rec. 2020", &REC2020, Transfer::Linear).unwrap();
        let aces = Space::of("ACEScg", &ACESCG, Transfer::Linear).unwrap();
        for (space, expected) in [
            (
                rec2020,
                [
                    [1.6605, -0.5876, -0.0728],
                    [-0.1246, 1.1329, -0.0083],
                    [-0.0182, -0.1006, 1.1187],
                ],
            ),
            (
                aces,
                [
                    [1.7051, -0.6218, -0.0833],
                    [-0.1303, 1.1408, -0.0105],
                    [-0.0240, -0.1290, 1.1530],
                ],
            ),
        ] {
            let found = space.to_srgb.unwrap();
            for i in 0..9 {
                let (r, c) = (i / 3, i % 3);
                assert!((found[r][c] - expected[r][c]).abs() < 1.5e-4, "{found:?}");
            }
            let white = space.linear_srgb_of([1.0; 3]);
            assert!(white.iter().all(|v| (v - 1.0).abs() < 1e-12), "{white:?}");
        }
    }

    #[test]
    fn srgb_is_left_as_it_is_and_no_colours_are_an_error() {
        assert_eq!(Space::of("sRGB", &SRGB, Transfer::Srgb).unwrap().to_srgb, None);
        // The columns of the profile that most files carry (HP's, of D50).
        let columns = [
            [0.436_066, 0.385_147, 0.143_066],
            [0.222_488, 0.716_873, 0.060_608],
            [0.013_916, 0.097_076, 0.714_096],
        ];
        let linear = [const { Transfer::Linear }; 3];
        assert_eq!(Space::of_columns("profile", &columns, linear).to_srgb, None);
        let line = [[0.3, 0.3], [0.4, 0.4], [0.5, 0.5], D65];
        assert!(Space::of("none", &line, Transfer::Linear).is_err());
    }
}
