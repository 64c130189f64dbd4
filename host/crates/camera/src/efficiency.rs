//! Curves of quantum efficiency through a few points of a data sheet.
//!
//! Between the points and beyond them the curve has the shape of a known sensor: the shape times a
//! factor that goes through all points, straight between them and held beyond the first and last.
//! One point scales the shape.

use camrig_base::table::SpectralTable;
use camrig_base::{Error, Result, Spectrum};
use std::collections::BTreeMap;
use std::str::FromStr;

/// Least part of its peak that a shape must have at a point: in the tail of a filter the ratio of
/// the two carries no information about its middle.
const LEAST: f64 = 0.1;

/// A point of a quantum efficiency: `529:0.64`, or `g:529:0.57` of a channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Letter of the channel, lower case; `None` for a sensor without filters.
    pub channel: Option<char>,
    /// Wavelength, nm.
    pub nm: f64,
    /// Electrons per photon.
    pub efficiency: f64,
}

impl FromStr for Point {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let wrong = || {
            Error::input(format!("{text:?} is no point of a quantum efficiency")).help(
                "write nm:efficiency such as 529:0.64, with colour filters channel:nm:efficiency \
                 such as g:529:0.57; efficiencies are above 0 and at most 1",
            )
        };
        let parts: Vec<&str> = text.split(':').map(str::trim).collect();
        let (channel, nm, efficiency) = match parts[..] {
            [nm, efficiency] => (None, nm, efficiency),
            [c, nm, efficiency] if c.len() == 1 => (c.chars().next(), nm, efficiency),
            _ => return Err(wrong()),
        };
        let number = |text: &str| text.parse::<f64>().map_err(|_| wrong());
        let point = Self {
            channel: channel.map(|c| c.to_ascii_lowercase()),
            nm: number(nm)?,
            efficiency: number(efficiency)?,
        };
        let ok = point.efficiency > 0.0 && point.efficiency <= 1.0 && point.nm > 0.0;
        if ok && point.nm.is_finite() { Ok(point) } else { Err(wrong()) }
    }
}

/// A table of the curves through points, in the shape of another table.
///
/// # Errors
/// Channels that the shape has not, or without a point; two points at one wavelength; points
/// where the shape has next to nothing.
pub fn through(points: &[Point], shape: &str, mono: bool) -> Result<String> {
    let table = SpectralTable::parse(shape)?;
    let mut of: BTreeMap<Option<char>, Vec<&Point>> = BTreeMap::new();
    for point in points {
        of.entry(point.channel).or_default().push(point);
    }
    let letter = |name: &str| if mono { None } else { name.chars().next() };
    let names: Vec<&str> = table.curves.iter().map(|(name, _)| &name[..]).collect();
    if !of.keys().copied().eq(sorted(names.iter().map(|name| letter(name)))) {
        let help = match mono {
            true => "a sensor without filters has points nm:efficiency".to_string(),
            false => format!("give points of each channel: {}", names.join(", ")),
        };
        return Err(Error::input("points of other channels than the sensor's").help(help));
    }
    let mut grid = table.wavelength_nm.clone();
    grid.extend(points.iter().map(|point| point.nm));
    grid.sort_by(f64::total_cmp);
    grid.dedup();
    let mut curves = Vec::new();
    for (column, name) in names.iter().enumerate() {
        let shape = table.spectrum(column)?;
        let factor = factor(&shape, of.get(&letter(name)).map_or(&[][..], |p| p))?;
        let value = |&nm: &f64| (shape.at(nm) * factor.at(nm)).min(1.0);
        curves.push(grid.iter().map(value).collect::<Vec<f64>>());
    }
    let mut text = format!(
        "# Through {} points of a data sheet; between and beyond them the shape is that of:\n",
        points.len()
    );
    shape.lines().filter(|line| line.starts_with('#')).for_each(|l| text += &format!("{l}\n"));
    text += &format!("wavelength_nm,{}\n", names.join(","));
    for (i, nm) in grid.iter().enumerate() {
        let values: Vec<String> = curves.iter().map(|c| format!("{:.4}", c[i])).collect();
        text += &format!("{nm},{}\n", values.join(","));
    }
    Ok(text)
}

fn sorted<T: Ord>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut items: Vec<T> = items.collect();
    items.sort_unstable();
    items
}

/// What takes a shape through the points, as a function of wavelength.
fn factor(shape: &Spectrum, points: &[&Point]) -> Result<Spectrum> {
    let largest = shape.samples().fold(0.0f64, |m, (_, v)| m.max(v));
    let mut factors: Vec<(f64, f64)> = Vec::new();
    for point in points {
        let here = shape.at(point.nm);
        let (first, last) = shape.range_nm();
        if here < LEAST * largest || !(first..=last).contains(&point.nm) {
            return Err(Error::input(format!(
                "{} at {} nm, where a usual curve has next to nothing",
                point.efficiency, point.nm
            ))
            .help("give points near the peaks, or the curve as a table"));
        }
        factors.push((point.nm, point.efficiency / here));
    }
    factors.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (nm, factor) = factors.into_iter().unzip();
    Spectrum::new(nm, factor)
}

/// The source of a table, from its head.
pub(crate) fn source(table: &str) -> String {
    let head = table.lines().take_while(|line| line.starts_with('#'));
    let head: Vec<&str> = head.map(|line| line.trim_start_matches('#').trim()).collect();
    let head = head.join(" ");
    let source = head.split_once("Source: ").map_or(&head[..], |(_, source)| source);
    source.trim_end_matches('.').to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHAPE: &str = "# Head.\nwavelength_nm,r,g\n400,0.1,0.2\n500,0.2,1\n700,0.8,0.1\n";

    fn told(points: &[&str], mono: bool) -> Result<SpectralTable> {
        let points: Vec<Point> = points.iter().map(|p| p.parse().unwrap()).collect();
        SpectralTable::parse(&through(&points, SHAPE, mono)?)
    }

    /// One point scales its channel; between two the factor changes in a straight line: the green
    /// shape is 0.6 at 450 nm, the factor there 0.75.
    #[test]
    fn curves_go_through_the_points_in_the_given_shape() {
        let table = told(&["r:700:0.4", "g:400:0.2", "G:500:0.5"], false).unwrap();
        let (r, g) = (table.spectrum(0).unwrap(), table.spectrum(1).unwrap());
        assert_eq!([400.0, 500.0, 700.0].map(|nm| r.at(nm)), [0.05, 0.1, 0.4]);
        assert_eq!([400.0, 500.0, 700.0].map(|nm| g.at(nm)), [0.2, 0.5, 0.05]);
        let points = ["r:600:0.3", "g:400:0.2", "g:450:0.45", "g:500:0.5"];
        let table = told(&points, false).unwrap();
        assert_eq!(table.spectrum(0).unwrap().at(600.0), 0.3);
        assert_eq!(table.spectrum(1).unwrap().at(450.0), 0.45);
    }

    #[test]
    fn points_that_no_curve_goes_through_are_refused() {
        for (points, words) in [
            (&["529:0.6"][..], "points of other channels"),
            (&["r:700:0.4"], "each channel: r, g"),
            (&["r:700:0.4", "g:500:0.5", "g:500:0.6"], "follows"),
            (&["r:700:0.4", "g:900:0.5"], "next to nothing"),
        ] {
            let error = told(points, false).unwrap_err().to_string();
            assert!(error.contains(words), "{points:?}: {error}");
        }
        for wrong in ["529", "529:0", "529:1.1", "x:0.5", "gr:529:0.5", "-529:0.5", "529:nan"] {
            assert!(wrong.parse::<Point>().is_err(), "{wrong}");
        }
    }
}
