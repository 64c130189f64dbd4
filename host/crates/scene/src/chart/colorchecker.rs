//! The 24-patch ColorChecker.
//!
//! Patches in 4 rows of 6 at a pitch of one unit, each 0.86 units square, on a card of reflectance
//! 0.035 that reaches a quarter of a unit beyond the outer cells (6.5 x 4.5 units), on a grey
//! ground (0.18). The card is 0.8 sensor widths wide unless `width=` says otherwise, and centred.
//! Where a camera sees beyond the patches' data the chart is dark, or held at their ends with
//! `beyond=hold`.

use super::{BANDS, Options};
use crate::Beyond;
use crate::painting::Painting;
use crate::shape::Shape;
use camrig_base::table::{SpectralTable, built_in};
use camrig_base::{Bands, Result, Spectrum};

/// Patch names and reflectances in chart order, row by row: 1 dark skin ... 24 black; 380 to 1068
/// nm.
pub fn reflectances() -> SpectralTable {
    built_in(include_str!("../data/colorchecker.csv"))
}

/// Columns of patches.
pub const COLUMNS: usize = 6;
/// Rows of patches.
pub const ROWS: usize = 4;
/// Patch edge over patch pitch.
const PATCH: f64 = 0.86;
/// Card edge beyond the outer cells, over patch pitch.
const BORDER: f64 = 0.25;
/// Default width of the card in sensor widths: the whole card fits frames from 4:3 to 16:9.
const WIDTH: f64 = 0.8;
/// Reflectance of the card, that of its black border.
const CARD: f64 = 0.035;
/// Reflectance of the ground: middle grey.
const GROUND: f64 = 0.18;

/// Left, top and edge length of a patch (0 to 23) on a card of some width, all in sensor widths.
pub fn patch(index: usize, card_width: f64) -> [f64; 3] {
    let pitch = card_width / (COLUMNS as f64 + 2.0 * BORDER);
    let cell =
        |i: usize, count: usize| (i as f64 - count as f64 / 2.0 + (1.0 - PATCH) / 2.0) * pitch;
    [cell(index % COLUMNS, COLUMNS), cell(index / COLUMNS, ROWS), PATCH * pitch]
}

/// The chart in some bands, the card `width` sensor widths wide.
///
/// # Errors
/// None: the built-in table is complete.
pub fn chart(bands: Bands, width: f64) -> Result<Painting> {
    let mut painting = Painting::new(bands, &Spectrum::constant(GROUND));
    let card = painting.material(&Spectrum::constant(CARD));
    let height = width * (ROWS as f64 + 2.0 * BORDER) / (COLUMNS as f64 + 2.0 * BORDER);
    let outline = Shape::Rect { left: -width / 2.0, top: -height / 2.0, width, height };
    painting.lay(outline, card, Painting::GROUND);
    let table = reflectances();
    for index in 0..table.curves.len() {
        let material = painting.material(&table.spectrum(index)?);
        let [left, top, edge] = patch(index, width);
        painting.lay(Shape::Rect { left, top, width: edge, height: edge }, material, card);
    }
    Ok(painting)
}

pub(super) fn from_options(options: &mut Options) -> Result<Painting> {
    let width = width(options)?;
    let beyond = Beyond::parse(options.word("beyond", &Beyond::NAMES)?).unwrap_or_default();
    Ok(chart(BANDS, width)?.with_beyond(beyond))
}

/// Width of the card, sensor widths.
pub(super) fn width(options: &mut Options) -> Result<f64> {
    options.number("width", WIDTH, 0.01..=10.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Grid, Scene};
    use camrig_light::Illuminant;
    use camrig_light::photometry::{chromaticity, xyz};

    /// Every patch is nearest to the published colour of its own name (xyY under D50, average of
    /// 30 charts, D. Pascale, babelcolor.com), so none is out of order.
    #[test]
    fn patches_have_the_colours_of_their_names() {
        let light = Illuminant::parse("D50").unwrap().power;
        let table = reflectances();
        assert_eq!(table.curves.len(), 24);
        for (index, (name, _)) in table.curves.iter().enumerate() {
            let curve = table.spectrum(index).unwrap();
            let nm: Vec<f64> = (360..=830).map(f64::from).collect();
            let lit = nm.iter().map(|&w| curve.at(w) * light.at(w)).collect();
            let lit = Spectrum::new(nm, lit).unwrap();
            let luminance = xyz(&lit)[1] / xyz(&light)[1];
            let [x, y] = chromaticity(&lit);
            let distance = |published: &[f64; 3]| {
                (x - published[0]).hypot(y - published[1]).hypot(luminance - published[2] / 100.0)
            };
            let distances: Vec<f64> = PUBLISHED_XYY_D50.iter().map(distance).collect();
            let nearest = (0..24).min_by(|&a, &b| distances[a].total_cmp(&distances[b]));
            assert_eq!(nearest, Some(index), "{name}");
        }
    }

    const PUBLISHED_XYY_D50: [[f64; 3]; 24] = [
        [0.4325, 0.3788, 10.34],
        [0.4191, 0.3748, 35.25],
        [0.2761, 0.3004, 18.47],
        [0.3700, 0.4501, 13.35],
        [0.3020, 0.2877, 23.24],
        [0.2856, 0.3910, 41.74],
        [0.5291, 0.4075, 31.17],
        [0.2339, 0.2155, 11.40],
        [0.5008, 0.3293, 19.79],
        [0.3326, 0.2556, 6.44],
        [0.3989, 0.4998, 44.35],
        [0.4962, 0.4428, 43.58],
        [0.2040, 0.1696, 5.79],
        [0.3270, 0.5033, 23.07],
        [0.5709, 0.3298, 12.68],
        [0.4694, 0.4732, 60.81],
        [0.4177, 0.2704, 20.07],
        [0.2151, 0.3037, 19.03],
        [0.3488, 0.3628, 91.29],
        [0.3451, 0.3596, 58.85],
        [0.3446, 0.3590, 35.95],
        [0.3438, 0.3589, 19.12],
        [0.3423, 0.3576, 8.93],
        [0.3439, 0.3565, 3.20],
    ];

    #[test]
    fn patches_lie_where_they_are_said_to() {
        let chart = chart(BANDS, 0.8).unwrap();
        let grid = Grid { width: 640, height: 480, left: -0.5, top: -0.375, cell: 1.0 / 640.0 };
        let table = reflectances();
        for band in [0, 15, 30] {
            let plane = chart.plane(band, &grid).unwrap();
            let at = |u: f64, v: f64| {
                f64::from(plane.at(((u + 0.5) * 640.0) as usize, ((v + 0.375) * 640.0) as usize))
            };
            for index in 0..24 {
                let [left, top, edge] = patch(index, 0.8);
                let expected = table.spectrum(index).unwrap().in_bands(&BANDS)[band];
                assert!((at(left + edge / 2.0, top + edge / 2.0) - expected).abs() < 1e-6);
                assert!((at(left - edge * 0.08, top + edge / 2.0) - CARD).abs() < 1e-6);
            }
            assert!((at(0.49, 0.0) - GROUND).abs() < 1e-6);
        }
    }
}
