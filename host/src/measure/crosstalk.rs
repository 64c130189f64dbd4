//! The crosstalk fit: from rotation captures to the table of positional factors.
//!
//! Per filter wavelength and channel, the mean signal of an 11 x 11 region around each point,
//! relative to that at the sensor's centre (Chen et al. 2009, section IV-C), both per unit of
//! irradiance on the sensor: where the captures give no irradiance, a beam of constant strength is
//! assumed and its projection cos θ divided out (a lens's own fall-off has that factor already).
//! The standard error has the temporal noise and the fixed pattern of the region's pixels, of the
//! point and of the centre.
//!
//! The experiment sees the low spatial frequencies only. Charge that couples into neighbours leaves
//! these factors as they are; it shows as correlated noise in flats ([`super::coupling`]).

use super::stack::Stack;
use super::value::Value;
use crate::captures::{Capture, CaptureSet, Role, Rotation, Scan};
use crate::{Error, Result};
use serde::Serialize;

/// Side of the region read, pixels.
const REGION: usize = 11;

/// Positions closer than this are one grid line.
const SAME: f64 = 1e-6;

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
    /// Whether no capture had this node and its neighbours stand in.
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
    factor: Value,
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
            .help("camrig crosstalk bench makes such a set; role = \"rotation\""));
    }
    let letters = set.cfa().channels();
    let black = black_levels(set)?;
    let mut raw: Vec<Sample> = Vec::new();
    for (capture, rotation, nm) in &captures {
        let means = region_means(set, capture, rotation, &black)?;
        let tan2 = rotation.tilt_x_deg.to_radians().tan().powi(2)
            + rotation.tilt_y_deg.to_radians().tan().powi(2);
        let cos = (1.0 + tan2).powf(-0.5);
        let beam = capture.light.as_ref().and_then(|l| l.irradiance_w_m2).unwrap_or(cos);
        let per_light = 1.0 / (beam * capture.exposure_s);
        raw.extend(means.iter().enumerate().map(|(channel, m)| Sample {
            wavelength: *nm,
            channel,
            rotation: *rotation,
            factor: m.scaled(per_light),
        }));
    }
    let wavelengths = distinct(raw.iter().map(|s| s.wavelength));
    let mut table = Vec::new();
    let mut notes = Vec::new();
    let mut scans: Vec<(Scan, Vec<(f64, f64)>)> = Vec::new();
    for (channel, letter) in letters.iter().enumerate() {
        for &nm in &wavelengths {
            let mut samples: Vec<&Sample> = raw
                .iter()
                .filter(|s| s.channel == channel && (s.wavelength - nm).abs() < SAME)
                .collect();
            samples.sort_by(|a, b| a.rotation.y.total_cmp(&b.rotation.y));
            let name = letter.to_ascii_lowercase().to_string();
            let centre_sample =
                centre_of(&samples).map_err(|e| e.at(format!("channel {name}, {nm} nm")))?;
            let centre = centre_sample.factor;
            let relative = |s: &Sample| {
                if std::ptr::eq(s, centre_sample) {
                    return Value::new(1.0, 0.0);
                }
                s.factor.over(centre)
            };
            let grid: Vec<(f64, f64, Value)> = samples
                .iter()
                .filter(|s| s.rotation.scan == Scan::Grid)
                .map(|s| (s.rotation.x, s.rotation.y, relative(s)))
                .collect();
            let nodes = complete(&grid, &name, nm);
            let missing = nodes.iter().filter(|n| n.interpolated).count();
            if missing > 0 {
                notes.push(format!(
                    "channel {name}, {nm} nm: {missing} of {} nodes interpolated",
                    nodes.len()
                ));
            }
            for s in samples.iter().filter(|s| s.rotation.scan != Scan::Grid) {
                let Some(model) = bilinear(&nodes, s.rotation.x, s.rotation.y) else { continue };
                let found = relative(s);
                // The centre's error is common to both.
                let error = (found.std_error.powi(2) + model.std_error.powi(2)
                    - 2.0 * (centre.std_error / centre.value).powi(2) * model.value * found.value)
                    .max(0.25 * found.std_error.powi(2))
                    .sqrt();
                let difference = found.value - model.value;
                match scans.iter_mut().find(|(scan, _)| *scan == s.rotation.scan) {
                    Some((_, list)) => list.push((difference, difference / error)),
                    None => scans.push((s.rotation.scan, vec![(difference, difference / error)])),
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

/// Black per channel: the darks' mean, else the nominal level.
fn black_levels(set: &CaptureSet) -> Result<Vec<Value>> {
    let count = set.cfa().channels().len();
    if let Some(dark) = set.with_role(Role::Dark).next() {
        let stack = Stack::read_moments(set, dark)?;
        return Ok((0..count)
            .map(|c| {
                let m = stack.channel_moments(c);
                let pattern = (m.plane.measured / m.pixels()).sqrt();
                Value::new(m.mean(), m.mean_error().hypot(pattern))
            })
            .collect());
    }
    match set.sensor.black_level_dn {
        Some(black) => Ok(vec![Value::new(black, 0.0); count]),
        None => Err(Error::input("neither dark captures nor black_level_dn")
            .help("signals are ratios above black: add a capture of role = \"dark\"")),
    }
}

/// Mean above black of every channel over the region of a capture.
fn region_means(
    set: &CaptureSet,
    capture: &Capture,
    rotation: &Rotation,
    black: &[Value],
) -> Result<Vec<Value>> {
    let place = |e: Error| e.at(format!("capture {:?}", capture.id));
    let cfa = set.cfa();
    let (width, height) = (set.sensor.width, set.sensor.height);
    if width < REGION || height < REGION {
        return Err(place(Error::input(format!("frames of {width} x {height}")))
            .help("regions are 11 x 11 pixels"));
    }
    let start = |u: f64, side: usize| {
        let middle = if rotation.window { 0.5 } else { 0.5 * (u + 1.0) };
        let free = (side - REGION) as f64;
        (middle * side as f64 - 0.5 * REGION as f64).clamp(0.0, free) as usize
    };
    let (left, top) = (start(rotation.x, width), start(rotation.y, height));
    let mut sums = vec![(0.0f64, 0.0f64); REGION * REGION];
    let mut saturated = 0usize;
    let frames = set.for_each_batch(capture, |batch| {
        for frame in batch {
            for (k, (sum, square)) in sums.iter_mut().enumerate() {
                let v = frame.at(left + k % REGION, top + k / REGION);
                saturated += usize::from(v >= set.sensor.white_level_dn);
                *sum += f64::from(v);
                *square += f64::from(v).powi(2);
            }
        }
        Ok(())
    })?;
    if saturated * 1000 > frames * REGION * REGION {
        return Err(place(Error::input("the region is saturated"))
            .help("factors of saturated signals mean nothing: lower the light"));
    }
    let l = frames as f64;
    Ok(black
        .iter()
        .enumerate()
        .map(|(channel, black)| {
            let pixels: Vec<(f64, f64)> = (0..REGION * REGION)
                .filter(|k| cfa.channel(left + k % REGION, top + k / REGION) == channel)
                .map(|k| {
                    let mean = sums[k].0 / l;
                    (mean, (sums[k].1 / l - mean * mean).max(0.0) / (l - 1.0).max(1.0))
                })
                .collect();
            let n = pixels.len() as f64;
            let mean = pixels.iter().map(|p| p.0).sum::<f64>() / n;
            // The scatter of the pixels' means has fixed pattern and temporal noise both.
            let scatter = pixels.iter().map(|p| (p.0 - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let temporal = pixels.iter().map(|p| p.1).sum::<f64>() / n;
            let error = (scatter.max(temporal) / n).sqrt();
            Value::new(mean - black.value, error.hypot(black.std_error))
        })
        .collect())
}

fn centre_of<'a>(samples: &[&'a Sample]) -> Result<&'a Sample> {
    // The grid's own centre; an axis scan's where the grid has none.
    let off = |s: &Sample| s.rotation.x.hypot(s.rotation.y);
    let key = |s: &Sample| (s.rotation.scan != Scan::Grid, off(s));
    let nearest = samples.iter().filter(|s| off(s) < CENTRE).min_by(|a, b| {
        let (ka, kb) = (key(a), key(b));
        ka.0.cmp(&kb.0).then(ka.1.total_cmp(&kb.1))
    });
    match nearest {
        Some(s) if s.factor.value > 5.0 * s.factor.std_error => Ok(s),
        Some(_) => Err(Error::input("no signal above black at the centre")
            .help("raise the light or the exposure for this filter")),
        None => Err(Error::input("no capture of the sensor's centre")
            .help("factors are relative to the centre: add x = 0, y = 0")),
    }
}

fn distinct(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut all: Vec<f64> = values.collect();
    all.sort_by(f64::total_cmp);
    all.dedup_by(|a, b| (*a - *b).abs() < SAME);
    all
}

/// The full rectangular grid; nodes without a sample from their neighbours.
fn complete(grid: &[(f64, f64, Value)], channel: &str, nm: f64) -> Vec<Node> {
    let xs = distinct(grid.iter().map(|g| g.0));
    let ys = distinct(grid.iter().map(|g| g.1));
    let known = |i: usize, j: usize| {
        let near =
            |g: &&(f64, f64, Value)| (g.0 - xs[i]).abs() < SAME && (g.1 - ys[j]).abs() < SAME;
        let here: Vec<Value> = grid.iter().filter(near).map(|g| g.2).collect();
        if let [one] = here[..] { Some(one) } else { Value::combine(&here) }
    };
    let mut cells: Vec<Option<Value>> = Vec::with_capacity(xs.len() * ys.len());
    for j in 0..ys.len() {
        cells.extend((0..xs.len()).map(|i| known(i, j)));
    }
    let at = |i: usize, j: usize| cells[j * xs.len() + i];
    let mut nodes = Vec::with_capacity(cells.len());
    for j in 0..ys.len() {
        for i in 0..xs.len() {
            let row: Vec<(f64, Option<Value>)> = (0..xs.len()).map(|k| (xs[k], at(k, j))).collect();
            let column: Vec<(f64, Option<Value>)> =
                (0..ys.len()).map(|k| (ys[k], at(i, k))).collect();
            let factor = at(i, j).or_else(|| stand_in(&row, i, &column, j));
            if let Some(factor) = factor {
                nodes.push(Node {
                    channel: channel.to_owned(),
                    wavelength_nm: nm,
                    x: xs[i],
                    y: ys[j],
                    factor,
                    interpolated: at(i, j).is_none(),
                });
            }
        }
    }
    nodes
}

/// A missing node: the mean of the lines along its row and its column; their difference is part of
/// its error.
fn stand_in(
    row: &[(f64, Option<Value>)],
    i: usize,
    column: &[(f64, Option<Value>)],
    j: usize,
) -> Option<Value> {
    let along = |line: &[(f64, Option<Value>)], k: usize| {
        let before = line[..k].iter().rev().find_map(|(p, v)| v.map(|v| (*p, v)));
        let after = line[k + 1..].iter().find_map(|(p, v)| v.map(|v| (*p, v)));
        match (before, after) {
            (Some((p0, v0)), Some((p1, v1))) => {
                let t = (line[k].0 - p0) / (p1 - p0);
                let value = v0.value + t * (v1.value - v0.value);
                Some(Value::new(value, v0.std_error.max(v1.std_error)))
            }
            (Some((_, v)), None) | (None, Some((_, v))) => Some(v),
            (None, None) => None,
        }
    };
    match (along(row, i), along(column, j)) {
        (Some(a), Some(b)) => {
            let spread = 0.5 * (a.value - b.value).abs();
            let error = a.std_error.max(b.std_error).hypot(spread);
            Some(Value::new(0.5 * (a.value + b.value), error))
        }
        (a, b) => a.or(b),
    }
}

/// The table at a position, bilinear, as the model uses it.
fn bilinear(nodes: &[Node], x: f64, y: f64) -> Option<Value> {
    let xs = distinct(nodes.iter().map(|n| n.x));
    let ys = distinct(nodes.iter().map(|n| n.y));
    if xs.len() < 2 || ys.len() < 2 || nodes.len() != xs.len() * ys.len() {
        return None;
    }
    let cell = |v: f64, line: &[f64]| {
        let k = line.partition_point(|l| *l <= v).clamp(1, line.len() - 1) - 1;
        (k, ((v - line[k]) / (line[k + 1] - line[k])).clamp(0.0, 1.0))
    };
    let ((i, u), (j, v)) = (cell(x, &xs), cell(y, &ys));
    let at = |i: usize, j: usize| nodes[j * xs.len() + i].factor;
    let corners = [
        (at(i, j), (1.0 - u) * (1.0 - v)),
        (at(i + 1, j), u * (1.0 - v)),
        (at(i, j + 1), (1.0 - u) * v),
        (at(i + 1, j + 1), u * v),
    ];
    let value = corners.iter().map(|(f, w)| f.value * w).sum();
    let error = corners.iter().map(|(f, w)| (f.std_error * w).powi(2)).sum::<f64>().sqrt();
    Some(Value::new(value, error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::captures::bench;

    /// A hidden table on the paper's grid: falls with radius, differently per channel and
    /// wavelength, and leans to one side.
    fn hidden() -> String {
        let mut table = String::from("channel,wavelength_nm,x,y,factor\n");
        for (channel, depth) in [("r", 0.10), ("g", 0.16), ("b", 0.22)] {
            for nm in bench::FILTERS_NM {
                for j in 0..13 {
                    for i in 0..17 {
                        let (x, y) = (f64::from(i) / 8.0 - 1.0, f64::from(j) / 6.0 - 1.0);
                        let r2 = 0.64 * x * x + 0.36 * y * y;
                        let factor = 1.0 - depth * (1.3 - nm / 1000.0) * r2 + 0.02 * x;
                        table.push_str(&format!("{channel},{nm},{x},{y},{factor}\n"));
                    }
                }
            }
        }
        table
    }

    #[test]
    fn hidden_table_comes_back() {
        let directory = tempfile::tempdir().unwrap();
        let table = hidden();
        std::fs::write(directory.path().join("hidden.csv"), &table).unwrap();
        let mut camera = Camera::load("mt9t012").unwrap();
        (camera.sensor.width, camera.sensor.height) = (272, 208);
        let letters = camera.sensor.channel_names.clone();
        let truth = crate::camera::CrosstalkTable::parse(&table).unwrap();
        camera.sensor.crosstalk = Some(truth.for_channels(&letters).unwrap());
        let out = directory.path().join("bench");
        bench::bench(&camera, 100, 0.01, &out, false, 0, || ()).unwrap();
        let result = fit(&CaptureSet::load(&out).unwrap()).unwrap();
        assert_eq!(result.nodes.len(), 3 * 7 * 13 * 17);
        let (mut worst, mut inside, mut count) = (0.0f64, 0, 0);
        for n in &result.nodes {
            let depth = match n.channel.as_str() {
                "r" => 0.10,
                "g" => 0.16,
                _ => 0.22,
            };
            let (x, y) = (n.x, n.y);
            let r2 = 0.64 * x * x + 0.36 * y * y;
            let expected = 1.0 - depth * (1.3 - n.wavelength_nm / 1000.0) * r2 + 0.02 * x;
            let error = n.factor.value - expected;
            worst = worst.max(error.abs());
            if n.factor.std_error > 0.0 {
                count += 1;
                inside += usize::from(error.abs() <= 2.0 * n.factor.std_error);
            }
        }
        let share = inside as f64 / count as f64;
        println!("worst {worst:.4}, within two errors {share:.3}, {:?}", result.consistency);
        // Errors of 0.2 to 0.4 % (the fixed pattern of 30 pixels, mostly): none of 4641 nodes is
        // more than 1.2 % off (four errors of the dimmest channel).
        assert!(worst < 0.012, "{worst}");
        // All nodes of a channel and filter share their centre: 21 groups, so the share within two
        // errors scatters by a few per cent about 95 %.
        assert!((0.90..=0.99).contains(&share), "{share}");
        // Scan and grid share fixed pattern at their crossings only.
        assert!(result.consistency.iter().all(|c| c.chi2_per_sample < 1.5));
        // The table loads as a camera's.
        crate::camera::CrosstalkTable::parse(&to_csv(&result)).unwrap();
    }

    #[test]
    fn missing_nodes_are_interpolated_and_flagged() {
        let mut grid = Vec::new();
        for j in 0..3 {
            for i in 0..3 {
                if (i, j) != (1, 1) {
                    let (x, y) = (f64::from(i) - 1.0, f64::from(j) - 1.0);
                    grid.push((x, y, Value::new(1.0 + 0.1 * x - 0.05 * y, 0.01)));
                }
            }
        }
        let nodes = complete(&grid, "g", 550.0);
        assert_eq!(nodes.len(), 9);
        let hole = &nodes[4];
        assert!(hole.interpolated && (hole.factor.value - 1.0).abs() < 1e-12);
        assert_eq!(nodes.iter().filter(|n| n.interpolated).count(), 1);
    }
}
