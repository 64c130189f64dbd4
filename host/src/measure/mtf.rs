//! Slanted-edge spatial frequency response (e-SFR) of one channel of a raw frame.
//!
//! The method of ISO 12233:2023 (e-SFR), on the channel's own samples without demosaic:
//! 1. per row, the edge's place is the centroid of the windowed derivative of the samples;
//! 2. a cubic through the rows' places is the edge (lens distortion bends it; the standard allows
//!    up to the fifth order);
//! 3. every sample's distance from the edge along its normal puts it into bins of a quarter of the
//!    channel's sample pitch: the oversampled edge spread function;
//! 4. its derivative by central differences, under a Tukey window centred on the edge, is the line
//!    spread function, whose Fourier transform's magnitude, 1 at zero, is the SFR;
//! 5. the SFR is divided by the transfer functions of the central difference (the standard's
//!    correction) and of averaging over a bin.
//!
//! Frequencies are in cycles per sensor pixel for every channel: a Bayer plane's samples are two
//! pixels apart, but the bins are finer than that, so its curve too goes beyond its own Nyquist
//! frequency. The standard error is a jackknife over blocks of rows.

use super::value::Value;
use crate::camera::Cfa;
use crate::{Error, Plane, Result};
use realfft::RealFftPlanner;
use serde::Serialize;

/// Bins per sample pitch of the channel.
const OVERSAMPLING: f64 = 4.0;

/// Fraction of the window that is tapered, half on each side.
const TUKEY_ALPHA: f64 = 1.0;

/// Blocks of rows for the jackknife.
const BLOCKS: usize = 10;

/// A rectangle of a frame, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Roi {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

/// The response of one channel over one edge.
#[derive(Clone, Debug, Serialize)]
pub struct Edge {
    /// Channel letter, lower case.
    pub channel: String,
    /// Angle between the edge and the pixel columns (rows for an edge that lies down), degrees.
    pub angle_deg: f64,
    /// Frequency where the response falls to one half, cycles per pixel.
    pub mtf50_cycles_per_pixel: f64,
    /// Its standard error.
    pub mtf50_std_error: f64,
    /// The same in cycles per millimetre, where the pitch is known.
    pub mtf50_cycles_per_mm: Option<f64>,
    /// Response at 0.5 cycles per pixel.
    pub mtf_at_nyquist: f64,
    /// (cycles per pixel, response) from 0 to 1 cycle per pixel.
    pub curve: Vec<[f64; 2]>,
    /// Mean DN on the two sides of the edge, dark first.
    pub levels_dn: [f64; 2],
}

/// Measures one channel (by letter, upper case) of a frame.
///
/// # Errors
/// A region outside the frame or too small, no edge in it, an edge that leaves it, is parallel to
/// the pixel grid, or is clipped at either level.
pub fn measure(
    frame: &Plane<u16>,
    cfa: &Cfa,
    channel: char,
    roi: Roi,
    white_level_dn: Option<u16>,
    pitch_um: Option<f64>,
) -> Result<Edge> {
    if roi.x + roi.width > frame.width || roi.y + roi.height > frame.height {
        return Err(Error::input(format!(
            "region {},{},{},{} is not inside the frame of {} x {}",
            roi.x, roi.y, roi.width, roi.height, frame.width, frame.height
        ))
        .help("--roi is X,Y,WIDTH,HEIGHT in pixels"));
    }
    if roi.width.min(roi.height) < 20 {
        return Err(Error::input(format!("region of {} x {} pixels", roi.width, roi.height))
            .help("an edge needs 20 pixels or more each way; 60 x 100 is good"));
    }
    let mut rows = collect(frame, cfa, channel, roi);
    if rows.iter().all(Vec::is_empty) {
        return Err(Error::input(format!("no channel {channel:?} in pattern {cfa}"))
            .help("use one of the pattern's letters"));
    }
    check_clipping(&rows, white_level_dn)?;
    if lies_down(&rows) {
        rows = transpose(&rows, roi);
    }
    rows.retain(|r| r.len() >= 8);
    if rows.len() < 10 {
        return Err(Error::input("fewer than 10 rows of samples across the edge"));
    }
    let step = rows[0][1].across - rows[0][0].across;
    let line = EdgeLine::find(&rows, step)?;
    let sfr = Sfr::of(&rows, &line, step, None)?;
    let mtf50 = sfr.crossing(0.5).ok_or_else(|| {
        Error::input("the response does not fall to one half below 1 cycle per pixel")
            .help("is this an image of an edge? noise alone has such a response")
    })?;
    // Jackknife: leave out one block of rows at a time.
    let mut spread = Vec::with_capacity(BLOCKS);
    for block in 0..BLOCKS {
        if let Ok(part) = Sfr::of(&rows, &line, step, Some(block))
            && let Some(f) = part.crossing(0.5)
        {
            spread.push(f);
        }
    }
    let b = spread.len() as f64;
    let mean = spread.iter().sum::<f64>() / b;
    let error = ((b - 1.0) / b * spread.iter().map(|f| (f - mean).powi(2)).sum::<f64>()).sqrt();
    let mtf50 = Value::new(mtf50, error);
    Ok(Edge {
        channel: channel.to_ascii_lowercase().to_string(),
        angle_deg: line.slope_at_middle().atan().to_degrees(),
        mtf50_cycles_per_pixel: mtf50.value,
        mtf50_std_error: mtf50.std_error,
        mtf50_cycles_per_mm: pitch_um.map(|p| mtf50.value / (p * 1e-3)),
        mtf_at_nyquist: sfr.at(0.5),
        curve: sfr.curve,
        levels_dn: line.levels,
    })
}

/// A sample: position across and along the edge, pixels, and value, DN.
#[derive(Clone, Copy, Debug)]
struct Sample {
    across: f64,
    along: f64,
    value: f64,
}

type Rows = Vec<Vec<Sample>>;

fn collect(frame: &Plane<u16>, cfa: &Cfa, channel: char, roi: Roi) -> Rows {
    (roi.y..roi.y + roi.height)
        .map(|y| {
            (roi.x..roi.x + roi.width)
                .filter(|&x| cfa.letter(x, y) == channel)
                .map(|x| Sample {
                    across: x as f64,
                    along: y as f64,
                    value: f64::from(frame.at(x, y)),
                })
                .collect()
        })
        .collect()
}

fn transpose(rows: &Rows, roi: Roi) -> Rows {
    let mut columns: Rows = vec![Vec::new(); roi.width];
    for s in rows.iter().flatten() {
        let turned = Sample { across: s.along, along: s.across, value: s.value };
        columns[s.across as usize - roi.x].push(turned);
    }
    columns
}

/// Whether the signal changes more from row to row than along the rows.
fn lies_down(rows: &Rows) -> bool {
    let half_mean = |part: &[Sample]| {
        part.iter().map(|s| s.value).sum::<f64>() / part.len().max(1) as f64
    };
    let filled: Vec<&Vec<Sample>> = rows.iter().filter(|r| !r.is_empty()).collect();
    let mid = filled.len() / 2;
    let mean_of = |rows: &[&Vec<Sample>]| {
        rows.iter().map(|r| half_mean(r)).sum::<f64>() / rows.len().max(1) as f64
    };
    let down = (mean_of(&filled[..mid]) - mean_of(&filled[mid..])).abs();
    let across: f64 = filled
        .iter()
        .map(|r| half_mean(&r[..r.len() / 2]) - half_mean(&r[r.len() / 2..]))
        .sum::<f64>()
        / filled.len().max(1) as f64;
    down > across.abs()
}

/// Refuses an edge whose bright or dark side is cut off: samples at the white level or at 0 DN, or
/// half of a side at the one value that no other sample exceeds (frames without a known white
/// level).
fn check_clipping(rows: &Rows, white: Option<u16>) -> Result<()> {
    let mut values: Vec<f64> = rows.iter().flatten().map(|s| s.value).collect();
    values.sort_by(f64::total_cmp);
    let (Some(&low), Some(&high)) = (values.first(), values.last()) else { return Ok(()) };
    if high - low < 8.0 {
        return Err(Error::input(format!("no edge: all samples lie within {} DN", high - low))
            .help("choose a region across a dark and a bright area"));
    }
    let n = values.len() as f64;
    let share = |level: f64| values.iter().filter(|v| **v == level).count() as f64 / n;
    let at_white = white.map_or(0.0, |w| {
        values.iter().filter(|v| **v >= f64::from(w)).count() as f64 / n
    });
    if at_white > 0.005 || share(high) > 0.25 {
        return Err(Error::input(format!(
            "the bright side is clipped at {high} DN ({:.0} % of the samples)",
            100.0 * at_white.max(share(high))
        ))
        .help("expose less: a clipped edge has no true response"));
    }
    if (low == 0.0 && share(0.0) > 0.005) || share(low) > 0.25 {
        return Err(Error::input(format!(
            "the dark side is clipped at {low} DN ({:.0} % of the samples)",
            100.0 * share(low)
        ))
        .help("raise the black level or the light: a clipped edge has no true response"));
    }
    Ok(())
}

/// Where the edge is: `across = Σ c_k t^k` with t the distance along from the middle row.
struct EdgeLine {
    middle: f64,
    coefficients: Vec<f64>,
    levels: [f64; 2],
}

impl EdgeLine {
    fn find(rows: &Rows, step: f64) -> Result<Self> {
        let (first, last) = (rows[0][0].along, rows[rows.len() - 1][0].along);
        let mut line = Self {
            middle: 0.5 * (first + last),
            coefficients: Vec::new(),
            levels: [0.0; 2],
        };
        // First pass: the whole row; then windows around the line found so far.
        for pass in 0..4 {
            let mut places = Vec::with_capacity(rows.len());
            for row in rows {
                let centre = (pass > 0).then(|| line.at(row[0].along));
                if let Some(place) = centroid(row, centre, step) {
                    places.push((row[0].along - line.middle, place));
                }
            }
            if places.len() < rows.len() / 2 {
                return Err(no_edge());
            }
            line.coefficients = polynomial(&places, if pass < 2 { 1 } else { 3 })?;
        }
        line.check(rows, step)?;
        Ok(line)
    }

    fn at(&self, along: f64) -> f64 {
        let t = along - self.middle;
        self.coefficients.iter().rev().fold(0.0, |sum, c| sum * t + c)
    }

    fn slope(&self, along: f64) -> f64 {
        let t = along - self.middle;
        let terms = self.coefficients.iter().enumerate().skip(1);
        terms.map(|(k, c)| k as f64 * c * t.powi(k as i32 - 1)).sum()
    }

    fn slope_at_middle(&self) -> f64 {
        self.slope(self.middle)
    }

    fn check(&mut self, rows: &Rows, step: f64) -> Result<()> {
        let margin = 4.0 * step;
        let (mut dark, mut bright) = (Vec::new(), Vec::new());
        for row in rows {
            let place = self.at(row[0].along);
            let (first, last) = (row[0].across, row[row.len() - 1].across);
            if !(place > first + margin && place < last - margin) {
                return Err(Error::input("the edge leaves the region")
                    .help("keep the edge inside the region in every row, with room on both sides"));
            }
            let (left, right): (Vec<&Sample>, Vec<&Sample>) =
                row.iter().partition(|s| s.across < place);
            let far = |s: &&&Sample| (s.across - place).abs() > 0.5 * margin;
            dark.extend(left.iter().filter(far).map(|s| s.value));
            bright.extend(right.iter().filter(far).map(|s| s.value));
        }
        let moments = |v: &[f64]| {
            let mean = v.iter().sum::<f64>() / v.len() as f64;
            let variance = v.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / v.len() as f64;
            (mean, variance)
        };
        let ((a, va), (b, vb)) = (moments(&dark), moments(&bright));
        self.levels = [a.min(b), a.max(b)];
        if (a - b).abs() < 3.0 * (va + vb).sqrt() {
            return Err(no_edge());
        }
        // Every phase of the sampling must be met: over the rows, the edge has to move by at least
        // one sample.
        let travel = (self.at(rows[rows.len() - 1][0].along) - self.at(rows[0][0].along)).abs();
        if travel < step {
            return Err(Error::input(format!(
                "the edge is parallel to the pixel grid ({:.2} degrees; it moves by {travel:.2} \
                 pixels over the region)",
                self.slope_at_middle().atan().to_degrees()
            ))
            .help("slant it by 2 to 10 degrees, or use a longer region"));
        }
        if self.slope_at_middle().abs() > 1.0 {
            return Err(no_edge());
        }
        Ok(())
    }
}

fn no_edge() -> Error {
    Error::input("no single straight edge found in the region")
        .help("choose a region with one edge between two even areas, slanted by 2 to 10 degrees")
}

/// Centroid of the derivative along a row, under a Hamming window around `centre` (the row's
/// middle without one), as in the standard.
fn centroid(row: &[Sample], centre: Option<f64>, step: f64) -> Option<f64> {
    let (first, last) = (row[0].across, row[row.len() - 1].across);
    let middle = centre.unwrap_or(0.5 * (first + last));
    let half = (middle - first).min(last - middle).max(4.0 * step);
    let (mut sum, mut moment) = (0.0, 0.0);
    for pair in row.windows(2) {
        let at = 0.5 * (pair[0].across + pair[1].across);
        let u = (at - middle) / half;
        if centre.is_some() && u.abs() > 1.0 {
            continue;
        }
        let window = match centre {
            Some(_) => 0.54 + 0.46 * (std::f64::consts::PI * u).cos(),
            None => 1.0,
        };
        let d = (pair[1].value - pair[0].value) * window;
        sum += d;
        moment += d * at;
    }
    let place = moment / sum;
    (place > first && place < last).then_some(place)
}

fn polynomial(points: &[(f64, f64)], order: usize) -> Result<Vec<f64>> {
    // Scaled to the range, so that powers stay comparable.
    let range = points.iter().map(|p| p.0.abs()).fold(1.0, f64::max);
    let design: Vec<Vec<f64>> = points
        .iter()
        .map(|p| (0..=order).map(|k| (p.0 / range).powi(k as i32)).collect())
        .collect();
    let y: Vec<f64> = points.iter().map(|p| p.1).collect();
    let fit = super::fit::Fit::new(&design, &y, &vec![1.0; y.len()])?;
    Ok(fit.coefficients.iter().enumerate().map(|(k, c)| c / range.powi(k as i32)).collect())
}

/// The response of a set of rows.
struct Sfr {
    curve: Vec<[f64; 2]>,
}

impl Sfr {
    /// `without`: a block of rows to leave out.
    fn of(rows: &Rows, line: &EdgeLine, step: f64, without: Option<usize>) -> Result<Self> {
        let bin = step / OVERSAMPLING;
        // Half width that every row reaches on both sides of the edge.
        let mut half = f64::INFINITY;
        for row in rows {
            let cos = 1.0 / line.slope(row[0].along).hypot(1.0);
            let place = line.at(row[0].along);
            half = half.min((place - row[0].across) * cos);
            half = half.min((row[row.len() - 1].across - place) * cos);
        }
        let side = ((half / bin).floor() as usize).max(4);
        let count = 2 * side;
        let mut sums = vec![(0.0, 0u32); count];
        for (index, row) in rows.iter().enumerate() {
            if without == Some(index * BLOCKS / rows.len()) {
                continue;
            }
            let place = line.at(row[0].along);
            let cos = 1.0 / line.slope(row[0].along).hypot(1.0);
            for s in row {
                let distance = (s.across - place) * cos;
                let index = (distance / bin).floor() + side as f64;
                if index >= 0.0 && (index as usize) < count {
                    let (sum, n) = &mut sums[index as usize];
                    *sum += s.value;
                    *n += 1;
                }
            }
        }
        let empty = sums.iter().filter(|s| s.1 == 0).count();
        if empty > count / 20 {
            return Err(Error::input(format!(
                "the rows meet too few phases of the sampling ({empty} of {count} bins empty)"
            ))
            .help("slant the edge by 2 to 10 degrees away from 1/4, 1/2 and whole pixels per row"));
        }
        let spread: Vec<f64> = fill(&sums);
        let window = |i: usize| tukey((i as f64 + 0.5 - side as f64) / side as f64);
        // Central difference; the ends, where the window vanishes, stay 0.
        let mut lsf = vec![0.0; count];
        for i in 1..count - 1 {
            lsf[i] = 0.5 * (spread[i + 1] - spread[i - 1]) * window(i);
        }
        // Zeros around the windowed function make the transform's samples dense.
        let padded = (8 * count).next_power_of_two();
        lsf.resize(padded, 0.0);
        let plan = RealFftPlanner::<f64>::new().plan_fft_forward(padded);
        let mut spectrum = plan.make_output_vec();
        plan.process(&mut lsf, &mut spectrum)
            .map_err(|e| Error::input(format!("Fourier transform: {e}")))?;
        let zero = spectrum[0].norm();
        if zero.is_nan() || zero <= 0.0 {
            return Err(no_edge());
        }
        let mut curve = Vec::new();
        for (k, value) in spectrum.iter().enumerate() {
            let f = k as f64 / (padded as f64 * bin);
            // At the bins' own Nyquist frequency the central difference passes nothing.
            if f > 1.0 || f * bin > 0.45 {
                break;
            }
            let correction = sinc(2.0 * f * bin) * sinc(f * bin);
            curve.push([f, value.norm() / zero / correction]);
        }
        Ok(Self { curve })
    }

    fn crossing(&self, level: f64) -> Option<f64> {
        self.curve.windows(2).find_map(|w| {
            let ([f0, m0], [f1, m1]) = (w[0], w[1]);
            (m0 >= level && m1 < level).then(|| f0 + (f1 - f0) * (m0 - level) / (m0 - m1))
        })
    }

    fn at(&self, f: f64) -> f64 {
        let i = self.curve.partition_point(|p| p[0] < f).clamp(1, self.curve.len() - 1);
        let ([f0, m0], [f1, m1]) = (self.curve[i - 1], self.curve[i]);
        m0 + (m1 - m0) * (f - f0) / (f1 - f0)
    }
}

/// Bin means; empty bins between their neighbours.
fn fill(sums: &[(f64, u32)]) -> Vec<f64> {
    let known: Vec<(usize, f64)> = (0..sums.len())
        .filter(|&i| sums[i].1 > 0)
        .map(|i| (i, sums[i].0 / f64::from(sums[i].1)))
        .collect();
    (0..sums.len())
        .map(|i| {
            let next = known.partition_point(|k| k.0 < i).min(known.len() - 1);
            let previous = next.saturating_sub(usize::from(known[next].0 > i));
            let ((i0, v0), (i1, v1)) = (known[previous], known[next]);
            if i0 == i1 { v0 } else { v0 + (v1 - v0) * (i as f64 - i0 as f64) / (i1 - i0) as f64 }
        })
        .collect()
}

/// Tukey window at u in -1..1.
fn tukey(u: f64) -> f64 {
    let flat = 1.0 - TUKEY_ALPHA;
    let u = u.abs();
    if u <= flat {
        1.0
    } else {
        0.5 * (1.0 + (std::f64::consts::PI * (u - flat) / TUKEY_ALPHA).cos())
    }
}

/// sin(πx)/(πx).
fn sinc(x: f64) -> f64 {
    let a = std::f64::consts::PI * x;
    if a.abs() < 1e-9 { 1.0 } else { a.sin() / a }
}
