//! What runs over the frames of every stack alike: the first frames after a start, which are off
//! in dark and light by the same, and a lamp that drifts, in proportion to the light.
//!
//! The means of frames are compared with c (e^(−i/τ) − its mean) and c (i/(N − 1) − ½), c the
//! same number of DN in all stacks, or the same part of the light in all flats. Errors of a frame's
//! mean come from blocks of its rows, so that what rows share counts. The fall of χ² is divided by
//! what the rest scatters (with its correlation from frame to frame, where that is much), and where
//! five stacks or more differ by more than their errors, Student's t over stacks decides: an offset
//! that wanders is no curve.

use super::finding::{Done, Finding, Kind};
use super::scan::Scan;
use super::transfer::Transfer;
use camrig_base::tails;
use camrig_captures::{CaptureSet, Role};

/// Fall of χ² from which a curve is there. Of 350 sets without one, 2 passed 17 and none this
/// (numpy draws of offsets and lamps that wander).
const FALL: f64 = 25.0;
/// Frames from which a curve is looked for.
const MIN_FRAMES: usize = 6;
/// Stacks from which their own scatter counts.
const MIN_STACKS: usize = 5;
/// Blocks of rows that a frame is divided into.
const BLOCKS: usize = 8;
/// Scatter over the errors from which it is more than chance.
const MORE: f64 = 1.5;
/// Time constants that are tried, frames.
const CONSTANTS: [f64; 9] = [0.7, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 9.0];
/// Steps to the smallest χ² between neighbouring time constants: a thousandth of a frame.
const REFINED: usize = 24;

/// A shape over frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// e^(−i/τ), τ in frames.
    Decay(f64),
    /// i/(N − 1).
    Line,
}

impl Shape {
    /// The shape at a frame of a stack of `n`.
    pub fn at(self, frame: usize, n: usize) -> f64 {
        match self {
            Shape::Decay(tau) => libm::exp(-(frame as f64) / tau),
            Shape::Line => frame as f64 / (n as f64 - 1.0).max(1.0),
        }
    }

    fn centred(self, n: usize) -> Vec<f64> {
        let shape: Vec<f64> = (0..n).map(|i| self.at(i, n)).collect();
        let mean = shape.iter().sum::<f64>() / n as f64;
        shape.into_iter().map(|s| s - mean).collect()
    }
}

/// What frames have in common over their stacks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curve {
    /// Its shape.
    pub shape: Shape,
    /// Whether it is a part of the light rather than an offset.
    pub of_light: bool,
    /// Amplitude: DN, or the part of a stack's mean light.
    pub amplitude: f64,
    /// Its standard error.
    pub std_error: f64,
    /// Standard error of the time constant, frames.
    pub tau_std_error: f64,
}

/// Means of the rows of a stack's frames, events left out.
pub struct Rows {
    /// Index of the scan.
    pub stack: usize,
    /// For each frame, the sum of each row, DN.
    pub sums: Vec<Vec<f64>>,
    /// Columns.
    pub width: usize,
}

/// Means of a stack's frames about their mean, with their error.
struct Means {
    values: Vec<f64>,
    /// Variance of each.
    variance: f64,
    /// Whether it is a flat, and its light, DN.
    flat: bool,
    signal: f64,
}

impl Means {
    fn of(set: &CaptureSet, scans: &[Scan], black: f64, rows: &Rows) -> Option<Self> {
        let n = rows.sums.len();
        let height = rows.sums.first()?.len();
        if n < MIN_FRAMES || height < BLOCKS {
            return None;
        }
        let w = rows.width as f64;
        let row_means: Vec<f64> = (0..height)
            .map(|y| rows.sums.iter().map(|f| f[y]).sum::<f64>() / (n as f64 * w))
            .collect();
        let residual =
            |f: &[f64]| -> Vec<f64> { f.iter().zip(&row_means).map(|(s, m)| s / w - m).collect() };
        let size = height / BLOCKS;
        let (mut values, mut squares) = (Vec::with_capacity(n), 0.0);
        for frame in &rows.sums {
            let r = residual(frame);
            values.push(r.iter().sum::<f64>() / height as f64);
            let blocks: Vec<f64> = r
                .chunks_exact(size)
                .take(BLOCKS)
                .map(|b| b.iter().sum::<f64>() / size as f64)
                .collect();
            let mean = blocks.iter().sum::<f64>() / BLOCKS as f64;
            squares += blocks.iter().map(|b| (b - mean).powi(2)).sum::<f64>();
        }
        let b = BLOCKS as f64;
        let variance = squares / n as f64 / (b - 1.0) / b * n as f64 / (n as f64 - 1.0);
        let capture = &set.captures[scans[rows.stack].capture];
        let signal = row_means.iter().sum::<f64>() / height as f64 - black;
        let flat = capture.role == Role::Flat && signal > 0.0;
        let variance = variance.max(1e-12);
        Some(Self { values, variance, flat, signal })
    }

    /// The shape of a curve in this stack, DN per unit of amplitude.
    fn shape(&self, shape: Shape, of_light: bool) -> Vec<f64> {
        let scale = if of_light { self.signal } else { 1.0 };
        shape.centred(self.values.len()).into_iter().map(|s| s * scale).collect()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// A curve fitted to stacks.
struct Fitted {
    /// Fall of χ², divided by what the rest scatters.
    fall: f64,
    /// χ² left.
    left: f64,
    amplitude: f64,
}

fn fit(stacks: &[&Means], shape: Shape, of_light: bool) -> Fitted {
    let shapes: Vec<Vec<f64>> = stacks.iter().map(|m| m.shape(shape, of_light)).collect();
    // For each stack: weight and amplitude.
    let own: Vec<(f64, f64)> = (stacks.iter().zip(&shapes))
        .map(|(m, s)| {
            let square = dot(s, s).max(1e-30);
            (square / m.variance, dot(s, &m.values) / square)
        })
        .collect();
    let weight: f64 = own.iter().map(|o| o.0).sum();
    let amplitude = own.iter().map(|o| o.0 * o.1).sum::<f64>() / weight;
    let (mut left, mut count, mut lag, mut length) = (0.0, 0.0, 0.0, 0.0);
    for (m, s) in stacks.iter().zip(&shapes) {
        let rest: Vec<f64> = (m.values.iter().zip(s))
            .map(|(v, s)| (v - amplitude * s) / m.variance.sqrt())
            .collect();
        left += dot(&rest, &rest);
        lag += dot(&rest[1..], &rest[..rest.len() - 1]);
        count += rest.len() as f64 - 1.0;
        length += rest.len() as f64;
    }
    let scatter = left / (count - 1.0).max(1.0);
    // A mean that was taken off makes neighbours of n frames correlate by about −1.5/n.
    let correlation = lag / left.max(1e-30) + 1.5 * stacks.len() as f64 / length;
    let correlation = correlation.clamp(0.0, 0.95);
    let inflated = match scatter > MORE {
        true => scatter * (1.0 + correlation) / (1.0 - correlation),
        false => scatter.max(1.0),
    };
    let mut fall = amplitude * amplitude * weight / inflated;
    if stacks.len() >= MIN_STACKS {
        let differ = own.iter().map(|o| o.0 * (o.1 - amplitude).powi(2)).sum::<f64>();
        let dof = stacks.len() as f64 - 1.0;
        let differ = differ / dof;
        if differ > MORE {
            let t = amplitude * (weight / differ).sqrt();
            let chance = tails::student_both(t, dof).max(1e-300);
            fall = fall.min(tails::deviate(libm::log(chance / 2.0)).powi(2));
        } else {
            // What stacks share, whatever single frames scatter.
            fall = fall.max(amplitude * amplitude * weight / differ.max(1.0));
        }
    }
    Fitted { fall, left, amplitude }
}

/// The curve that explains the means of the frames best, where one is there.
pub fn curve(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    rows: &[Rows],
) -> Option<Curve> {
    let means: Vec<Means> =
        rows.iter().filter_map(|r| Means::of(set, scans, transfer.black, r)).collect();
    let all: Vec<&Means> = means.iter().collect();
    let flats: Vec<&Means> = means.iter().filter(|m| m.flat).collect();
    let shapes = || CONSTANTS.map(Shape::Decay).into_iter().chain([Shape::Line]);
    let mut best: Option<(Fitted, Shape, bool)> = None;
    for of_light in [false, true] {
        let stacks = if of_light { &flats } else { &all };
        if stacks.is_empty() {
            continue;
        }
        for shape in shapes() {
            let fitted = fit(stacks, shape, of_light);
            if best.as_ref().is_none_or(|(b, ..)| fitted.fall > b.fall) {
                best = Some((fitted, shape, of_light));
            }
        }
    }
    let (found, shape, of_light) = best.filter(|(b, ..)| b.fall > FALL)?;
    let stacks = if of_light { &flats } else { &all };
    let (shape, tau_std_error) = match shape {
        Shape::Decay(tau) => refined(stacks, tau, of_light),
        Shape::Line => (Shape::Line, f64::NAN),
    };
    let fitted = fit(stacks, shape, of_light);
    let std_error = fitted.amplitude.abs() / found.fall.sqrt();
    Some(Curve { shape, of_light, amplitude: fitted.amplitude, std_error, tau_std_error })
}

/// The time constant of least χ² near `tau`, by golden section, and its standard error from the
/// curvature there.
fn refined(stacks: &[&Means], tau: f64, of_light: bool) -> (Shape, f64) {
    let left = |tau: f64| fit(stacks, Shape::Decay(tau), of_light).left;
    let (mut low, mut high) = (tau * 0.6, tau * 1.6);
    for _ in 0..REFINED {
        let (a, b) = (low + 0.382 * (high - low), low + 0.618 * (high - low));
        if left(a) < left(b) { high = b } else { low = a }
    }
    let best = 0.5 * (low + high);
    let step = 0.05 * best;
    let bend = (left(best + step) - 2.0 * left(best) + left(best - step)) / (step * step);
    (Shape::Decay(best), (2.0 / bend.max(1e-12)).sqrt())
}

/// What is said of a curve.
pub fn finding(set: &CaptureSet, scans: &[Scan], transfer: &Transfer, curve: &Curve) -> Finding {
    let ids: Vec<&str> = scans
        .iter()
        .map(|s| &set.captures[s.capture])
        .filter(|c| !curve.of_light || c.role == Role::Flat)
        .map(|c| c.id.as_str())
        .collect();
    let place = ids.join(", ");
    let (a, se) = (curve.amplitude, curve.std_error);
    let percent = |v: f64| 100.0 * v;
    match (curve.of_light, curve.shape) {
        (true, shape) => {
            let way = if (a > 0.0) == (shape == Shape::Line) { "rose" } else { "fell" };
            let how = match shape {
                Shape::Line => "evenly from the first frame to the last".to_string(),
                Shape::Decay(tau) => {
                    format!("as it settled with a time constant of {tau:.2} frames")
                }
            };
            Finding::new(Kind::LampDrift, place, Done::Modelled)
                .amount(percent(a), percent(se), "%")
                .says(format!(
                    "the light {way} by {:.2} ± {:.2} % within each of the stacks, {how}: the lamp \
                     drifts, which is no property of the sensor. The model is given the same light; \
                     at which frame the stated light was read is not known, so the response is \
                     known to no better than that",
                    percent(a.abs()),
                    percent(se),
                ))
        }
        (false, shape) => {
            let electrons = transfer.dn_per_e.filter(|k| *k > 0.0);
            let of_gain = electrons.map_or(String::new(), |k| {
                format!(" ({:.2} ± {:.2} e⁻ at an analog gain of 1)", a.abs() / k, se / k)
            });
            let way = if a > 0.0 { "higher" } else { "lower" };
            let how = match shape {
                Shape::Line => format!(
                    "the level of frames drifts by {a:.3} ± {se:.3} DN{of_gain} from the first \
                     frame of each stack to its last, in dark and light alike"
                ),
                Shape::Decay(tau) => format!(
                    "the first frames of each stack are {way}: {:.3} ± {se:.3} DN{of_gain} at the \
                     first, which settles with a time constant of {tau:.2} ± {:.2} frames, in dark \
                     and light alike: start-up",
                    a.abs(),
                    curve.tau_std_error
                ),
            };
            Finding::new(Kind::StartUp, place, Done::Modelled)
                .amount(a, se, "DN")
                .says(format!("{how}. The model is given the same; leave the first frames out"))
        }
    }
}
