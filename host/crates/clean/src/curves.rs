//! Curves over the frames of all stacks: a start-up offset of the first frames, the same in dark
//! and light, and a drift of the lamp, in proportion to the light.
//!
//! The means of frames are fitted with c (e^(−i/τ) − its mean) and c (i/(N − 1) − ½), c the same
//! number of DN in all stacks, or the same share of the light in all flats. The error of a frame's
//! mean comes from blocks of its rows, so that noise shared by rows counts. The decrease of χ² is
//! divided by the scatter of the residuals (with their correlation from frame to frame where the
//! scatter is large), and where five or more stacks differ by more than their errors, Student's t
//! over stacks decides: a wandering offset is not a curve.

use super::finding::{Done, Finding, Kind};
use super::scan::Scan;
use super::transfer::Transfer;
use camrig_base::tails;
use camrig_captures::{CaptureSet, Role};
use camrig_linear::dot;

/// Decrease of χ² from which a curve is accepted. Of 350 sets without one, 2 exceeded 17 and none
/// exceeded this (numpy simulations of wandering offsets and lamps).
const MIN_DECREASE: f64 = 25.0;
/// Shortest stack that is used, frames.
const MIN_FRAMES: usize = 6;
/// Stacks from which the scatter between them counts.
const MIN_STACKS: usize = 5;
/// Blocks of rows that a frame is divided into.
const BLOCKS: usize = 8;
/// Reduced χ² from which scatter exceeds the errors.
const EXCESS: f64 = 1.5;
/// Time constants that are tested, frames.
const CONSTANTS: [f64; 9] = [0.7, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 9.0];
/// Golden-section steps between neighbouring time constants: to a thousandth of a frame.
const REFINEMENTS: usize = 24;

/// A shape over frames i of a stack of N.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CurveShape {
    /// e^(−i/τ), τ in frames.
    Decay(f64),
    /// i/(N − 1).
    Line,
}

impl CurveShape {
    /// Its value at a frame of a stack of `n`.
    pub fn at(self, frame: usize, n: usize) -> f64 {
        match self {
            CurveShape::Decay(tau) => libm::exp(-(frame as f64) / tau),
            CurveShape::Line => frame as f64 / (n as f64 - 1.0).max(1.0),
        }
    }

    fn centred(self, n: usize) -> Vec<f64> {
        let shape: Vec<f64> = (0..n).map(|i| self.at(i, n)).collect();
        let mean = shape.iter().sum::<f64>() / n as f64;
        shape.into_iter().map(|s| s - mean).collect()
    }
}

/// A curve over frames that all stacks share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameCurve {
    /// Its shape.
    pub shape: CurveShape,
    /// Whether it scales the light; otherwise it is an offset.
    pub of_light: bool,
    /// Amplitude, DN, or as a share of the stack's mean light.
    pub amplitude: f64,
    /// Its standard error.
    pub std_error: f64,
    /// Standard error of the time constant, frames.
    pub tau_std_error: f64,
}

/// Sums of the rows of a stack's frames, events excluded.
pub struct RowSums {
    /// Index of the scan.
    pub stack: usize,
    /// For each frame, the sum of each row, DN.
    pub sums: Vec<Vec<f64>>,
    /// Columns.
    pub width: usize,
}

/// Means of a stack's frames relative to the stack's mean.
struct Means {
    values: Vec<f64>,
    /// Error variance of each.
    variance: f64,
    /// Whether the stack is a flat with a signal.
    flat: bool,
    /// Signal above black, DN.
    signal: f64,
}

impl Means {
    fn of(set: &CaptureSet, scans: &[Scan], black: f64, rows: &RowSums) -> Option<Self> {
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
    fn shape(&self, shape: CurveShape, of_light: bool) -> Vec<f64> {
        let scale = if of_light { self.signal } else { 1.0 };
        shape.centred(self.values.len()).into_iter().map(|s| s * scale).collect()
    }
}

/// A curve fitted to stacks.
struct Fitted {
    /// Decrease of χ² relative to the scatter of the residuals.
    decrease: f64,
    /// χ² of the residuals.
    chi2: f64,
    /// Least-squares amplitude over all stacks.
    amplitude: f64,
}

/// A curve fitted to one stack.
struct StackFit {
    /// Inverse variance of the amplitude.
    weight: f64,
    amplitude: f64,
}

fn fit(stacks: &[&Means], shape: CurveShape, of_light: bool) -> Fitted {
    let shapes: Vec<Vec<f64>> = stacks.iter().map(|m| m.shape(shape, of_light)).collect();
    let by_stack: Vec<StackFit> = (stacks.iter().zip(&shapes))
        .map(|(m, s)| {
            let square = dot(s, s).max(1e-30);
            StackFit { weight: square / m.variance, amplitude: dot(s, &m.values) / square }
        })
        .collect();
    let weight: f64 = by_stack.iter().map(|o| o.weight).sum();
    let amplitude = by_stack.iter().map(|o| o.weight * o.amplitude).sum::<f64>() / weight;
    let (mut chi2, mut count, mut lag, mut length) = (0.0, 0.0, 0.0, 0.0);
    for (m, s) in stacks.iter().zip(&shapes) {
        let residuals: Vec<f64> = (m.values.iter().zip(s))
            .map(|(v, s)| (v - amplitude * s) / m.variance.sqrt())
            .collect();
        chi2 += dot(&residuals, &residuals);
        lag += dot(&residuals[1..], &residuals[..residuals.len() - 1]);
        count += residuals.len() as f64 - 1.0;
        length += residuals.len() as f64;
    }
    let scatter = chi2 / (count - 1.0).max(1.0);
    // Subtracting the mean and the curve correlates neighbours among n frames by about −1.5/n.
    let correlation = lag / chi2.max(1e-30) + 1.5 * stacks.len() as f64 / length;
    let correlation = correlation.clamp(0.0, 0.95);
    let inflated = match scatter > EXCESS {
        true => scatter * (1.0 + correlation) / (1.0 - correlation),
        false => scatter.max(1.0),
    };
    let mut decrease = amplitude * amplitude * weight / inflated;
    if stacks.len() >= MIN_STACKS {
        let between = by_stack.iter().map(|o| o.weight * (o.amplitude - amplitude).powi(2));
        let dof = stacks.len() as f64 - 1.0;
        let between = between.sum::<f64>() / dof;
        if between > EXCESS {
            let t = amplitude * (weight / between).sqrt();
            let chance = tails::student_two_sided(t, dof).max(1e-300);
            decrease = decrease.min(tails::normal_quantile(libm::log(chance / 2.0)).powi(2));
        } else {
            // Stacks agree, however single frames scatter.
            decrease = decrease.max(amplitude * amplitude * weight / between.max(1.0));
        }
    }
    Fitted { decrease, chi2, amplitude }
}

/// The curve that fits the means of frames best; `None` where none is significant.
pub fn curve(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    rows: &[RowSums],
) -> Option<FrameCurve> {
    let means: Vec<Means> =
        rows.iter().filter_map(|r| Means::of(set, scans, transfer.black, r)).collect();
    let all: Vec<&Means> = means.iter().collect();
    let flats: Vec<&Means> = means.iter().filter(|m| m.flat).collect();
    let shapes = || CONSTANTS.map(CurveShape::Decay).into_iter().chain([CurveShape::Line]);
    let mut best: Option<(Fitted, CurveShape, bool)> = None;
    for of_light in [false, true] {
        let stacks = if of_light { &flats } else { &all };
        if stacks.is_empty() {
            continue;
        }
        for shape in shapes() {
            let fitted = fit(stacks, shape, of_light);
            if best.as_ref().is_none_or(|(b, ..)| fitted.decrease > b.decrease) {
                best = Some((fitted, shape, of_light));
            }
        }
    }
    let (found, shape, of_light) = best.filter(|(b, ..)| b.decrease > MIN_DECREASE)?;
    let stacks = if of_light { &flats } else { &all };
    let (shape, tau_std_error) = match shape {
        CurveShape::Decay(tau) => refine(stacks, tau, of_light),
        CurveShape::Line => (CurveShape::Line, f64::NAN),
    };
    let fitted = fit(stacks, shape, of_light);
    let std_error = fitted.amplitude.abs() / found.decrease.sqrt();
    Some(FrameCurve { shape, of_light, amplitude: fitted.amplitude, std_error, tau_std_error })
}

/// The time constant of least χ² near `tau`, by golden section, and its standard error from the
/// curvature there, frames.
fn refine(stacks: &[&Means], tau: f64, of_light: bool) -> (CurveShape, f64) {
    let chi2 = |tau: f64| fit(stacks, CurveShape::Decay(tau), of_light).chi2;
    let (mut low, mut high) = (tau * 0.6, tau * 1.6);
    for _ in 0..REFINEMENTS {
        let (a, b) = (low + 0.382 * (high - low), low + 0.618 * (high - low));
        if chi2(a) < chi2(b) { high = b } else { low = a }
    }
    let best = 0.5 * (low + high);
    let step = 0.05 * best;
    let bend = (chi2(best + step) - 2.0 * chi2(best) + chi2(best - step)) / (step * step);
    (CurveShape::Decay(best), (2.0 / bend.max(1e-12)).sqrt())
}

/// The finding about a curve.
pub fn finding(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    curve: &FrameCurve,
) -> Finding {
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
            let direction = if (a > 0.0) == (shape == CurveShape::Line) { "rose" } else { "fell" };
            let how = match shape {
                CurveShape::Line => "evenly from the first frame to the last".to_string(),
                CurveShape::Decay(tau) => {
                    format!("settling with a time constant of {tau:.2} frames")
                }
            };
            let cause = match shape {
                CurveShape::Decay(_) if direction == "rose" => {
                    "the lamp warms up, or the sensor holds charge from frame to frame \
                     (`image-lag`), as a dark frame right after light shows"
                }
                _ => "the lamp drifts, which is not a property of the sensor",
            };
            Finding::new(Kind::LampDrift, place, Done::Modelled)
                .with_amount(percent(a), percent(se), "%")
                .with_description(format!(
                    "the light {direction} by {:.2} ± {:.2} % within each of the stacks, {how}: \
                     {cause}. The model gets the same drift; the frame at which the stated light \
                     was measured is unknown, which limits the accuracy of the response",
                    percent(a.abs()),
                    percent(se),
                ))
        }
        (false, shape) => {
            let electrons = transfer.dn_per_e.filter(|k| *k > 0.0);
            let in_electrons = electrons.map_or(String::new(), |k| {
                format!(" ({:.2} ± {:.2} e⁻ at an analog gain of 1)", a.abs() / k, se / k)
            });
            let direction = if a > 0.0 { "higher" } else { "lower" };
            let how = match shape {
                CurveShape::Line => format!(
                    "the level of frames drifts by {a:.3} ± {se:.3} DN{in_electrons} from the \
                     first frame of each stack to the last, equally in dark and light"
                ),
                CurveShape::Decay(tau) => format!(
                    "the first frames of each stack are {direction}: {:.3} ± {se:.3} \
                     DN{in_electrons} at the first, settling with a time constant of {tau:.2} ± \
                     {:.2} frames, equally in dark and light: start-up",
                    a.abs(),
                    curve.tau_std_error
                ),
            };
            Finding::new(Kind::StartUp, place, Done::Modelled)
                .with_amount(a, se, "DN")
                .with_description(format!(
                    "{how}. The model gets the same offset; skip the first frames"
                ))
        }
    }
}
