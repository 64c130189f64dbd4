//! The crosstalk fit: from rotation captures to the table of positional factors.
//!
//! Per filter wavelength and channel, the mean signal of an 11 x 11 region around each point (Chen
//! et al. 2009, section IV-C), each pixel less its own dark, per unit of irradiance on the sensor:
//! where the captures give no irradiance, a beam of constant strength is assumed and its
//! projection cos θ divided out (a lens's own fall-off has that factor already). A region's signal
//! has an error of temporal noise and of its pixels' pattern of gains, 0.2 to 0.4 % with the
//! paper's averages of 100 frames; what neighbouring points have in common lowers it (`surface`).
//! Factors are relative to the value at the sensor's centre.
//!
//! The experiment sees the low spatial frequencies only. Charge that couples into neighbours
//! leaves these factors as they are; it shows as correlated noise in flats ([`super::coupling`]).

mod regions;
mod surface;

use self::regions::{Black, SAME, signals};
use self::surface::{Estimate, Point, Surface};
use super::value::Value;
use camrig_base::{Error, Result};
use camrig_captures::{Capture, CaptureSet, Role, Rotation, Scan};
use serde::Serialize;

/// The point that counts as the sensor's centre lies within this of it: factors vary by far less
/// than their errors over a twentieth of the half width.
const CENTRE: f64 = 0.05;

/// One node of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Node {
    /// Channel letter, lower case.
    pub channel: String,
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Position, -1..1 over the half width.
    pub x: f64,
    /// Position, -1..1 over the half height.
    pub y: f64,
    /// Signal relative to the centre.
    pub factor: Value,
    /// Whether no capture had this node and the surface of the others stands in.
    pub interpolated: bool,
}

/// How an axis scan agrees with the table of the grid.
#[derive(Clone, Debug, Serialize)]
pub struct Consistency {
    /// The scan.
    pub scan: &'static str,
    /// Samples.
    pub samples: usize,
    /// Root mean square of scan less table, per cent of the centre.
    pub rms_percent: f64,
    /// χ² per sample: 1 for agreement within the stated errors.
    pub chi2_per_sample: f64,
}

/// The outcome.
#[derive(Clone, Debug, Serialize)]
pub struct Crosstalk {
    /// The table: every channel, wavelength and node, in that order, rows before columns.
    pub nodes: Vec<Node>,
    /// Axis scans against the table.
    pub consistency: Vec<Consistency>,
    /// What a reader must know.
    pub notes: Vec<String>,
}

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
            .with_code("rotation-stacks"));
    }
    let letters = set.cfa().channels();
    let black = Black::of(set)?;
    let mut raw: Vec<Sample> = Vec::new();
    for (capture, rotation, nm) in &captures {
        let means = signals(set, capture, rotation, &black)?;
        let tan2 = rotation.tilt_x_deg.to_radians().tan().powi(2)
            + rotation.tilt_y_deg.to_radians().tan().powi(2);
        let cos = (1.0 + tan2).powf(-0.5);
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
                let error = s.signal.std_error.hypot(table_of.surface.error(&model));
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
        if c.chi2_per_sample > 2.0 && c.rms_percent > 0.5 {
            notes.push(format!(
                "the {} scan does not agree with the grid ({:.2} % rms, χ² per sample {:.1}): the \
                 light or the alignment changed between them, or the grid is too coarse",
                c.scan, c.rms_percent, c.chi2_per_sample
            ));
        }
    }
    Ok(Crosstalk { nodes: table, consistency, notes })
}

/// The table as CSV (files.md, section 4), with the standard error as a further column.
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
    /// Of the grid's samples; `others` may stand in for a centre that the grid has not.
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
            .filter_map(|(x, y, signals)| Some((*x, *y, Value::combine(signals)?)))
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

    /// The full rectangle of nodes.
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

/// The sample nearest to the sensor's centre: the grid's own, an axis scan's where the grid has
/// none.
fn centre_of<'a>(grid: &[&'a Sample], others: &[&'a Sample]) -> Result<&'a Sample> {
    let off = |s: &Sample| s.rotation.x.hypot(s.rotation.y);
    let nearest = |samples: &[&'a Sample]| {
        let near = samples.iter().copied().filter(|s| off(s) < CENTRE);
        near.min_by(|a, b| off(a).total_cmp(&off(b)))
    };
    match nearest(grid).or_else(|| nearest(others)) {
        Some(s) if s.signal.value > 5.0 * s.signal.std_error => Ok(s),
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
