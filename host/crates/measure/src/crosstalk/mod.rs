//! Positional crosstalk: the table of factors from rotation captures.
//!
//! For each filter wavelength and channel, the signal at a point is the mean over a region of 11 x
//! 11 pixels around it (Chen et al. 2009, section IV-C), each pixel less its own dark, per unit of
//! irradiance on the sensor. Where the captures give no irradiance, a beam of constant irradiance
//! is assumed and divided by its projection cos θ (the fall-off of a lens includes that factor).
//! The error of a region's signal, from temporal noise and PRNU, is 0.2 to 0.4 % with the paper's
//! averages of 100 frames; a smooth surface through neighbouring points lowers it (`surface`).
//! Factors are relative to the value at the sensor's centre.
//!
//! The experiment measures low spatial frequencies only. Charge that couples into neighbours does
//! not change these factors; it shows as correlated noise in flats ([`super::coupling`]).

mod regions;
mod surface;

use self::regions::{Black, SAME, signals};
use self::surface::{Estimate, Point, Surface};
use camrig_base::Value;
use camrig_base::{Error, ErrorCode, Result};
use camrig_captures::{Capture, CaptureSet, Role, Rotation, Scan};
use serde::Serialize;

/// Largest distance of the point that counts as the sensor's centre, in half widths: over a
/// twentieth of the half width factors vary by far less than their errors.
const CENTRE: f64 = 0.05;
/// Smallest signal at the centre in standard errors. All factors are divided by it: below 5 their
/// error would exceed 20 %.
const MIN_SIGNAL: f64 = 5.0;
/// χ² per sample above which a scan is inconsistent with the grid: with 30 samples, 2 is exceeded
/// by chance once in a thousand scans.
const INCONSISTENT_CHI2: f64 = 2.0;
/// Smallest rms difference of a scan and the grid, per cent, that is noted: about the error of one
/// region's signal.
const INCONSISTENT_PERCENT: f64 = 0.5;

/// One node of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Node {
    /// Channel letter, lower case.
    pub channel: String,
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Position, -1 to 1 over the half width.
    pub x: f64,
    /// Position, -1 to 1 over the half height.
    pub y: f64,
    /// Signal relative to the centre.
    pub factor: Value,
    /// Whether no capture has this node, so that its factor comes from the surface through the
    /// others.
    pub interpolated: bool,
}

/// Agreement of an axis scan with the table of the grid.
#[derive(Clone, Debug, Serialize)]
pub struct Consistency {
    /// The scan.
    pub scan: &'static str,
    /// Number of samples.
    pub samples: usize,
    /// Root mean square of scan minus table, per cent of the centre.
    pub rms_percent: f64,
    /// χ² per sample: 1 for agreement within the stated errors.
    pub chi2_per_sample: f64,
}

/// Result of the fit.
#[derive(Clone, Debug, Serialize)]
pub struct Crosstalk {
    /// The table: every channel, wavelength and node, in that order, row by row.
    pub nodes: Vec<Node>,
    /// Agreement of axis scans with the table.
    pub consistency: Vec<Consistency>,
    /// Remarks for the reader, such as interpolated nodes.
    pub notes: Vec<String>,
}

/// Signal of one region, DN per second and unit of irradiance.
struct Sample {
    wavelength: f64,
    channel: usize,
    rotation: Rotation,
    signal: Value,
}

/// Fits the table.
///
/// # Errors
/// No rotation captures, none at the centre for some wavelength, saturated regions, neither darks
/// nor a black level.
pub fn fit(set: &CaptureSet) -> Result<Crosstalk> {
    let captures: Vec<(&Capture, Rotation, f64)> = set
        .with_role(Role::Rotation)
        .map(|c| {
            let nm = c.light.as_ref().and_then(|l| l.wavelength_nm).ok_or_else(|| {
                Error::input("a rotation capture without a wavelength")
                    .at(format!("capture {:?}", c.id))
                    .help("add [capture.light] with wavelength_nm")
            })?;
            c.rotation.map(|r| (c, r, nm)).ok_or_else(|| {
                Error::input("no [capture.rotation]").at(format!("capture {:?}", c.id))
            })
        })
        .collect::<Result<_>>()?;
    if captures.is_empty() {
        return Err(Error::input("no rotation captures")
            .help("give captures with role = \"rotation\"")
            .with_code(ErrorCode::RotationStacks));
    }
    let letters = set.cfa().channels();
    let black = Black::of(set)?;
    let mut raw: Vec<Sample> = Vec::new();
    for (capture, rotation, nm) in &captures {
        let means = signals(set, capture, rotation, &black)?;
        let tan2 = libm::tan(rotation.tilt_x_deg.to_radians()).powi(2)
            + libm::tan(rotation.tilt_y_deg.to_radians()).powi(2);
        let cos = libm::pow(1.0 + tan2, -0.5);
        let beam = capture.light.as_ref().and_then(|l| l.irradiance_w_m2).unwrap_or(cos);
        let per_light = 1.0 / (beam * capture.exposure_s);
        raw.extend(means.iter().enumerate().map(|(channel, m)| Sample {
            wavelength: *nm,
            channel,
            rotation: *rotation,
            signal: m.scaled(per_light),
        }));
    }
    let wavelengths = distinct(raw.iter().map(|s| s.wavelength));
    let mut table = Vec::new();
    let mut notes = Vec::new();
    let mut scans: Vec<(Scan, Vec<(f64, f64)>)> = Vec::new();
    for (channel, letter) in letters.iter().enumerate() {
        for &nm in &wavelengths {
            let samples: Vec<&Sample> = raw
                .iter()
                .filter(|s| s.channel == channel && (s.wavelength - nm).abs() < SAME)
                .collect();
            let name = letter.to_ascii_lowercase().to_string();
            let place = |e: Error| e.at(format!("channel {name}, {nm} nm"));
            let (grid, others): (Vec<&Sample>, Vec<&Sample>) =
                samples.into_iter().partition(|s| s.rotation.scan == Scan::Grid);
            let table_of = Grid::of(&grid, &others).map_err(place)?;
            let nodes = table_of.nodes(&name, nm);
            let missing = nodes.iter().filter(|n| n.interpolated).count();
            if missing > 0 {
                notes.push(format!(
                    "channel {name}, {nm} nm: {missing} of {} nodes interpolated",
                    nodes.len()
                ));
            }
            for s in others {
                let model = table_of.surface.anywhere(s.rotation.x, s.rotation.y);
                let error = libm::hypot(s.signal.std_error, table_of.surface.error(&model));
                let difference = s.signal.value - model.value;
                let found = (difference / table_of.centre.value, difference / error);
                match scans.iter_mut().find(|(scan, _)| *scan == s.rotation.scan) {
                    Some((_, list)) => list.push(found),
                    None => scans.push((s.rotation.scan, vec![found])),
                }
            }
            table.extend(nodes);
        }
    }
    let consistency: Vec<Consistency> = scans
        .iter()
        .map(|(scan, list)| {
            let n = list.len() as f64;
            Consistency {
                scan: scan_name(*scan),
                samples: list.len(),
                rms_percent: 100.0 * (list.iter().map(|d| d.0 * d.0).sum::<f64>() / n).sqrt(),
                chi2_per_sample: list.iter().map(|d| d.1 * d.1).sum::<f64>() / n,
            }
        })
        .collect();
    for c in &consistency {
        if c.chi2_per_sample > INCONSISTENT_CHI2 && c.rms_percent > INCONSISTENT_PERCENT {
            notes.push(format!(
                "the {} scan does not agree with the grid ({:.2} % rms, χ² per sample {:.1}): the \
                 light or the alignment changed between them, or the grid is too coarse",
                c.scan, c.rms_percent, c.chi2_per_sample
            ));
        }
    }
    Ok(Crosstalk { nodes: table, consistency, notes })
}

/// The table as CSV in the format of a camera file's `crosstalk` key, with the standard error as
/// an additional column.
pub fn to_csv(result: &Crosstalk) -> String {
    let mut out = String::from("channel,wavelength_nm,x,y,factor,std_error\n");
    for n in &result.nodes {
        out.push_str(&format!(
            "{},{},{:.6},{:.6},{:.6},{:.6}\n",
            n.channel, n.wavelength_nm, n.x, n.y, n.factor.value, n.factor.std_error
        ));
    }
    out
}

fn scan_name(scan: Scan) -> &'static str {
    match scan {
        Scan::Grid => "grid",
        Scan::Horizontal => "horizontal",
        Scan::Vertical => "vertical",
        Scan::Diagonal => "diagonal",
        Scan::Antidiagonal => "antidiagonal",
    }
}

/// The grid of one channel and wavelength.
struct Grid {
    xs: Vec<f64>,
    ys: Vec<f64>,
    points: Vec<Point>,
    surface: Surface,
    centre: Estimate,
}

impl Grid {
    /// The grid of its samples; the centre may come from `others` where the grid has none.
    fn of(grid: &[&Sample], others: &[&Sample]) -> Result<Self> {
        let mut points: Vec<(f64, f64, Vec<Value>)> = Vec::new();
        for s in grid {
            let (x, y) = (s.rotation.x, s.rotation.y);
            match points.iter_mut().find(|p| same(p.0, x) && same(p.1, y)) {
                Some(point) => point.2.push(s.signal),
                None => points.push((x, y, vec![s.signal])),
            }
        }
        let points: Vec<Point> = (points.iter())
            .filter_map(|(x, y, signals)| Some((*x, *y, Value::combine(signals.iter().copied())?)))
            .collect();
        let centre = centre_of(grid, others)?;
        let surface = Surface::fit(&points)?;
        let (x, y) = (centre.rotation.x, centre.rotation.y);
        let centre = match points.iter().find(|p| same(p.0, x) && same(p.1, y)) {
            Some(point) => surface.at_point(point),
            None => surface.anywhere(x, y),
        };
        let xs = distinct(points.iter().map(|p| p.0));
        let ys = distinct(points.iter().map(|p| p.1));
        Ok(Self { xs, ys, points, surface, centre })
    }

    /// The complete rectangle of nodes.
    fn nodes(&self, channel: &str, nm: f64) -> Vec<Node> {
        let mut nodes = Vec::with_capacity(self.xs.len() * self.ys.len());
        for &y in &self.ys {
            for &x in &self.xs {
                let measured = self.points.iter().find(|p| same(p.0, x) && same(p.1, y));
                let estimate = match measured {
                    Some(point) => self.surface.at_point(point),
                    None => self.surface.anywhere(x, y),
                };
                let at_centre = (estimate.x, estimate.y) == (self.centre.x, self.centre.y);
                nodes.push(Node {
                    channel: channel.to_owned(),
                    wavelength_nm: nm,
                    x,
                    y,
                    factor: match at_centre {
                        true => Value::new(1.0, 0.0),
                        false => self.surface.ratio(&estimate, &self.centre),
                    },
                    interpolated: measured.is_none(),
                });
            }
        }
        nodes
    }
}

fn same(a: f64, b: f64) -> bool {
    (a - b).abs() < SAME
}

/// The sample nearest to the sensor's centre: of the grid, or of an axis scan where the grid has
/// none.
fn centre_of<'a>(grid: &[&'a Sample], others: &[&'a Sample]) -> Result<&'a Sample> {
    let off = |s: &Sample| libm::hypot(s.rotation.x, s.rotation.y);
    let nearest = |samples: &[&'a Sample]| {
        let near = samples.iter().copied().filter(|s| off(s) < CENTRE);
        near.min_by(|a, b| off(a).total_cmp(&off(b)))
    };
    match nearest(grid).or_else(|| nearest(others)) {
        Some(s) if s.signal.value > MIN_SIGNAL * s.signal.std_error => Ok(s),
        Some(_) => Err(Error::input("no signal above black at the centre")
            .help("raise the light or the exposure for this filter")),
        None => Err(Error::input("no capture of the sensor's centre")
            .help("factors are relative to the centre: add x = 0, y = 0")),
    }
}

fn distinct(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut all: Vec<f64> = values.collect();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|a, b| same(*a, *b));
    all
}

#[cfg(test)]
mod tests;
