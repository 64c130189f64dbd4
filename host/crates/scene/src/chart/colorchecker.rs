//! The 24-patch ColorChecker.
//!
//! Patches in 4 rows of 6 at a pitch of one unit, each 0.86 units square, on a card of reflectance
//! 0.035 that reaches a quarter of a unit beyond the outer cells (6.5 x 4.5 units), on a grey
//! ground (0.18). The card is 0.8 sensor widths wide unless `width=` says otherwise, and centred.
//! Where a camera sees beyond the patches' data the chart is dark, or held at their ends with
//! `beyond=hold`.
//!
//! `colorchecker` has averages of measurements of 30 charts (D. Pascale, The ColorChecker,
//! babelcolor.com, 2012) from 380 to 730 nm. Under D50 they lie 0.8 CIEDE2000 in the mean, 1.5 at
//! most from the values that X-Rite publishes for charts made after November 2014. Beyond 730 nm,
//! to 1068 nm, each patch continues as that of ISETCam's chart, to which the difference fades out
//! linearly up to 830 nm.
//! `colorchecker-isetcam` is that chart alone, 3 in the mean from the maker's values.

use super::{BANDS, Options};
use crate::Beyond;
use crate::painting::Painting;
use crate::shape::Shape;
use camrig_base::table::{SpectralTable, built_in};
use camrig_base::{Bands, Result, Spectrum};

/// Patch names and reflectances in chart order, row by row: 1 dark skin ... 24 black; 380 to 1068
/// nm.
pub fn reflectances() -> SpectralTable {
    built_in(AVERAGES)
}

/// The same of the chart of ISETCam, 380 to 1068 nm.
pub fn isetcam_reflectances() -> SpectralTable {
    built_in(ISETCAM)
}

/// The table of a chart as a file, with its source in the first line; `None` where no chart of
/// patches has the name.
pub fn file(name: &str) -> Option<&'static str> {
    match name {
        "colorchecker" => Some(AVERAGES),
        "colorchecker-isetcam" => Some(ISETCAM),
        _ => None,
    }
}

const AVERAGES: &str = include_str!("../data/colorchecker.csv");
const ISETCAM: &str = include_str!("../data/colorchecker-isetcam.csv");

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
    painted(&reflectances(), bands, width)
}

fn painted(table: &SpectralTable, bands: Bands, width: f64) -> Result<Painting> {
    let mut painting = Painting::new(bands, &Spectrum::constant(GROUND));
    let card = painting.material(&Spectrum::constant(CARD));
    let height = width * (ROWS as f64 + 2.0 * BORDER) / (COLUMNS as f64 + 2.0 * BORDER);
    let outline = Shape::Rect { left: -width / 2.0, top: -height / 2.0, width, height };
    painting.lay(outline, card, Painting::GROUND);
    for index in 0..table.curves.len() {
        let material = painting.material(&table.spectrum(index)?);
        let [left, top, edge] = patch(index, width);
        painting.lay(Shape::Rect { left, top, width: edge, height: edge }, material, card);
    }
    Ok(painting)
}

pub(super) fn from_options(options: &mut Options, table: &SpectralTable) -> Result<Painting> {
    let width = width(options)?;
    let beyond = Beyond::parse(options.word("beyond", &Beyond::NAMES)?).unwrap_or_default();
    Ok(painted(table, BANDS, width)?.with_beyond(beyond))
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
    use camrig_light::delta_e::{delta_e_2000, lab};
    use camrig_light::photometry::xyz;

    /// CIEDE2000 of each patch under D50 from the maker's values.
    fn off(table: &SpectralTable) -> Vec<f64> {
        let light = Illuminant::parse("D50").unwrap().power;
        let nm: Vec<f64> = (360..=830).map(f64::from).collect();
        let patch = |index: usize| {
            let curve = table.spectrum(index).unwrap();
            let lit = nm.iter().map(|&w| curve.at(w) * light.at(w)).collect();
            xyz(&Spectrum::new(nm.clone(), lit).unwrap())
        };
        let found = (0..24).map(|index| lab(patch(index), xyz(&light)));
        found.zip(PUBLISHED_LAB_D50).map(|(a, b)| delta_e_2000(a, b)).collect()
    }

    /// The figures that the head of this file states, as another program computes them with the
    /// D50 of ISO 13655 (colour-science 0.4.7: 0.804 and 1.488).
    #[test]
    fn patches_are_those_that_the_maker_publishes() {
        let figures = |off: Vec<f64>| {
            (off.iter().sum::<f64>() / 24.0, off.iter().copied().fold(0.0, f64::max))
        };
        let (mean, max) = figures(off(&reflectances()));
        assert!((mean - 0.804).abs() < 0.04 && (max - 1.488).abs() < 0.08, "{mean} {max}");
        let (mean, _) = figures(off(&isetcam_reflectances()));
        assert!((2.5..3.5).contains(&mean), "{mean}");
        let names = |t: SpectralTable| t.curves.into_iter().map(|c| c.0).collect::<Vec<_>>();
        assert_eq!(names(reflectances()), names(isetcam_reflectances()));
    }

    /// CIE L*a*b* under D50 of charts made after November 2014 (X-Rite).
    const PUBLISHED_LAB_D50: [[f64; 3]; 24] = [
        [37.54, 14.37, 14.92],
        [64.66, 19.27, 17.50],
        [49.32, -3.82, -22.54],
        [43.46, -12.74, 22.72],
        [54.94, 9.61, -24.79],
        [70.48, -32.26, -0.37],
        [62.73, 35.83, 56.50],
        [39.43, 10.75, -45.17],
        [50.57, 48.64, 16.67],
        [30.10, 22.54, -20.87],
        [71.77, -24.13, 58.19],
        [71.51, 18.24, 67.37],
        [28.37, 15.42, -49.80],
        [54.38, -39.72, 32.27],
        [42.43, 51.05, 28.62],
        [81.80, 2.67, 80.41],
        [50.63, 51.28, -14.12],
        [49.57, -29.71, -28.32],
        [95.19, -1.03, 2.93],
        [81.29, -0.57, 0.44],
        [66.89, -0.75, -0.06],
        [50.76, -0.13, 0.14],
        [35.63, -0.46, -0.48],
        [20.64, 0.07, -0.46],
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
