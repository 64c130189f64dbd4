//! A linear frame taken apart into channels, and a ColorChecker or a white in it.

use super::spectral::Channels;
use camrig_base::Bands;
use camrig_base::Cfa;
use camrig_base::{Error, ErrorCode, Plane, Result};
use camrig_light::Illuminant;
use camrig_scene::chart::colorchecker;
use std::fmt;
use std::str::FromStr;

/// One plane per channel, a value per cell of the colour filter pattern: the mean of the cell's
/// pixels of that channel, so nothing is interpolated.
#[derive(Clone, Debug)]
pub struct View {
    /// Channel letters.
    pub letters: Vec<char>,
    /// A plane per channel.
    pub planes: Vec<Plane<f32>>,
    /// Pixels per cell, a side.
    pub cell: usize,
}

/// A rectangle of raw pixels, `X,Y,W,H`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
}

impl FromStr for Region {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
        match numbers[..] {
            [left, top, width, height]
                if left >= 0.0 && top >= 0.0 && width > 0.0 && height > 0.0 =>
            {
                Ok(Self { left, top, width, height })
            }
            _ => Err(format!("{text:?} is no region; give X,Y,W,H in pixels of the raw frame")),
        }
    }
}

impl fmt::Display for Region {
    /// As it is given, to a tenth of a pixel.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, w, h] = [self.left, self.top, self.width, self.height].map(tenths);
        write!(f, "{x},{y},{w},{h}")
    }
}

fn tenths(v: f64) -> f64 {
    (10.0 * v).round() / 10.0
}

impl View {
    /// Takes a linear raw frame apart.
    pub fn new(frame: &Plane<f32>, cfa: &Cfa) -> Self {
        let letters = cfa.channels();
        let cell = cfa.width.max(cfa.height);
        let (width, height) = (frame.width / cell, frame.height / cell);
        let plane = |letter: char| {
            let places: Vec<(usize, usize)> = (0..cell * cell)
                .map(|i| (i % cell, i / cell))
                .filter(|&(x, y)| cfa.letter(x, y) == letter)
                .collect();
            Plane::from_fn(width, height, |x, y| {
                let at = |&(dx, dy): &(usize, usize)| frame.at(x * cell + dx, y * cell + dy);
                places.iter().map(at).sum::<f32>() / places.len() as f32
            })
        };
        let planes = letters.iter().map(|&l| plane(l)).collect();
        Self { letters, planes, cell }
    }

    /// Mean of every channel over a region; values that are not finite (saturated) are an error.
    pub fn mean(&self, region: &Region, what: &str) -> Result<Vec<f64>> {
        let cell = self.cell as f64;
        let (width, height) = (self.planes[0].width, self.planes[0].height);
        let columns = (region.left / cell).ceil() as usize
            ..((region.left + region.width) / cell).floor() as usize;
        let rows = (region.top / cell).ceil() as usize
            ..((region.top + region.height) / cell).floor() as usize;
        if columns.is_empty() || rows.is_empty() || columns.end > width || rows.end > height {
            return Err(Error::input(format!("{what} lies at {region}")).help(format!(
                "the frame has {} x {} pixels, and a region at least {cell} pixels a side",
                width * self.cell,
                height * self.cell
            )));
        }
        let mean = |plane: &Plane<f32>| {
            let values = rows.clone().flat_map(|y| &plane.row(y)[columns.clone()]);
            let sum: f64 = values.map(|&v| f64::from(v)).sum();
            sum / (rows.len() * columns.len()) as f64
        };
        let means: Vec<f64> = self.planes.iter().map(mean).collect();
        if means.iter().all(|m| m.is_finite()) {
            return Ok(means);
        }
        Err(Error::input(format!("{what} is saturated"))
            .help("merge in a shorter exposure, or expose less")
            .with_code(ErrorCode::SaturatedCapture))
    }

    /// Means over the middle half of the 24 patches, within a rectangle drawn around them (outer
    /// edges of the corner patches).
    pub fn patches(&self, around: &Region) -> Result<Vec<Vec<f64>>> {
        let table = colorchecker::reflectances();
        // Corners of the corner patches in a chart one unit wide.
        let first = colorchecker::patch(0, 1.0);
        let last = colorchecker::patch(23, 1.0);
        let span = [last[0] + last[2] - first[0], last[1] + last[2] - first[1]];
        let scale = [around.width / span[0], around.height / span[1]];
        (0..24)
            .map(|index| {
                let [left, top, edge] = colorchecker::patch(index, 1.0);
                let region = Region {
                    left: around.left + (left - first[0] + edge / 4.0) * scale[0],
                    top: around.top + (top - first[1] + edge / 4.0) * scale[1],
                    width: edge / 2.0 * scale[0],
                    height: edge / 2.0 * scale[1],
                };
                let name = &table.curves[index].0;
                self.mean(&region, &format!("patch {} ({name})", index + 1))
            })
            .collect()
    }
}

/// How a chart's measured signals relate to what the channels should see of it.
#[derive(Clone, Debug, serde::Serialize)]
pub struct ChartFit {
    /// The light.
    pub illuminant: String,
    /// Signal of a perfect white per channel.
    pub white: Vec<f64>,
    /// Root mean square of measured less expected signals, relative to white.
    pub residual: f64,
}

/// Largest residual that is still a ColorChecker. Of measured exitances, whose six components adapt
/// to the signals, a chart leaves 0.002, and its patches in the order of their neighbours 0.19.
const NO_CHART: f64 = 0.15;

/// Checks that signals of the 24 patches, off what is expected of them by `residual` (not finite
/// where they have no scale), are those of a chart.
pub(crate) fn is_chart(residual: f64) -> Result<()> {
    if residual <= NO_CHART {
        return Ok(());
    }
    let off = match residual {
        r if r.is_finite() => {
            format!(": its patches would be off by {:.0} % of white", 100.0 * r)
        }
        _ => String::new(),
    };
    Err(Error::input(format!("no ColorChecker found there{off}"))
        .help("give the rectangle around the 24 patches, dark skin at the upper left"))
}

/// Finds each channel's scale by least squares over the patches, under the light of least residual
/// among `lights`.
pub fn fit_chart(
    measured: &[Vec<f64>],
    sensitivity: &[Vec<f64>],
    bands: &Bands,
    lights: &[Illuminant],
) -> Result<ChartFit> {
    let table = colorchecker::reflectances();
    let mut best: Option<ChartFit> = None;
    for light in lights {
        let channels = Channels::new(sensitivity, &light.in_bands(bands))?;
        let expected: Vec<Vec<f64>> = (0..24)
            .map(|i| Ok(channels.see(&table.spectrum(i)?.in_bands(bands))))
            .collect::<Result<_>>()?;
        let (mut white, mut square) = (Vec::new(), 0.0);
        for channel in 0..sensitivity.len() {
            let pairs = || expected.iter().zip(measured).map(|(e, m)| (e[channel], m[channel]));
            let scale = pairs().map(|(e, m)| e * m).sum::<f64>()
                / pairs().map(|(e, _)| e * e).sum::<f64>();
            square += pairs().map(|(e, m)| (m / scale - e).powi(2)).sum::<f64>();
            white.push(scale);
        }
        let residual = (square / (24 * sensitivity.len()) as f64).sqrt();
        if best.as_ref().is_none_or(|b| residual < b.residual) {
            best = Some(ChartFit { illuminant: light.name.clone(), white, residual });
        }
    }
    let best = best.ok_or_else(|| Error::input("no illuminant to choose from"))?;
    let positive = best.white.iter().all(|w| *w > 0.0);
    is_chart(if positive { best.residual } else { f64::INFINITY })?;
    Ok(best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_camera::Camera;
    use camrig_scene::{Grid, chart};

    /// A chart seen by a camera in closed form: light and scale are found, and the wrong place is
    /// refused.
    #[test]
    fn a_chart_gives_light_and_scale() {
        let bands = Bands::VISIBLE;
        let cfa = Cfa::parse("RGGB").unwrap();
        let sensitivity = Camera::load("mt9v024").unwrap().sensor.response(&bands);
        let light = Illuminant::parse("F11").unwrap();
        let channels = Channels::new(&sensitivity, &light.in_bands(&bands)).unwrap();
        let chart = chart::open("colorchecker").unwrap().unwrap();
        let grid = Grid { width: 320, height: 240, left: -0.5, top: -0.375, cell: 1.0 / 320.0 };
        let planes: Vec<Plane<f32>> = (0..31).map(|b| chart.plane(b, &grid).unwrap()).collect();
        let frame = Plane::from_fn(320, 240, |x, y| {
            let reflectance: Vec<f64> = planes.iter().map(|p| f64::from(p.at(x, y))).collect();
            let channel = cfa.channel(x, y);
            ([300.0, 500.0, 200.0][channel] * channels.see(&reflectance)[channel]) as f32
        });
        let view = View::new(&frame, &cfa);
        // Patches span from (0.5 − 0.4 · 5.86 / 6.5) of the width.
        let width = 320.0 * 0.8 * 5.86 / 6.5;
        let height = width * 3.86 / 5.86;
        let region = |dx: f64| Region {
            left: 160.0 - width / 2.0 + dx,
            top: 120.0 - height / 2.0,
            width,
            height,
        };
        let lights: Vec<Illuminant> =
            ["A", "D65", "F2", "F11"].iter().map(|n| Illuminant::parse(n).unwrap()).collect();
        let measured = view.patches(&region(0.0)).unwrap();
        let fit = fit_chart(&measured, &sensitivity, &bands, &lights).unwrap();
        assert_eq!(fit.illuminant, "F11");
        assert!(fit.residual < 1e-5, "{}", fit.residual);
        for (got, expected) in fit.white.iter().zip([300.0, 500.0, 200.0]) {
            assert!((got / expected - 1.0).abs() < 1e-4);
        }
        let measured = view.patches(&region(38.0)).unwrap();
        let error = fit_chart(&measured, &sensitivity, &bands, &lights).unwrap_err().to_string();
        assert!(error.contains("no ColorChecker found"), "{error}");
        assert!(view.patches(&region(200.0)).is_err());
    }
}
