//! Frames that a camera processed before it gave them away: filters make the noise of neighbours
//! correlate, in dark and light alike, which no sensor does; interpolated pixels of a demosaiced
//! picture have less noise than those between them, on a checkerboard; transforms in blocks of
//! 8 x 8 leave their coefficients on steps ([`super::blocks`]).

use super::band::Residuals;
use super::blocks::Blocks;
use super::finding::{Done, Finding, Kind, names};
use super::scan::Scan;
use super::transfer::Transfer;
use camrig_captures::{CaptureSet, Role};

/// Correlation of neighbours that a filter leaves at least. Below it coupling between pixels and
/// slow amplifiers do as much.
const MIN_CORRELATION: f64 = 0.01;
/// Contrast of the noise on the two halves of a checkerboard that interpolation leaves at least:
/// the mean of two pixels has half of the variance, of four a quarter, contrasts of 0.33 and 0.6.
const MIN_CONTRAST: f64 = 0.1;
/// Its errors, 1/√samples, from which it is there.
const ERRORS: f64 = 6.0;
/// Largest over smallest correlation over stacks of one filter: what a sensor's own circuits do
/// to noise changes with the share of shot noise in it.
const ALIKE: f64 = 1.6;
/// Variance of the brightest stack over the darkest's from which dark and light differ in their
/// noise at all.
const DIFFERENT_NOISE: f64 = 2.0;
/// Residuals count at most so many standard deviations.
const CLIP: f64 = 5.0;

/// Correlation of a stack's noise along and down.
#[derive(Clone, Debug, Default)]
pub struct Lags {
    /// Index of the scan.
    pub stack: usize,
    products: [f64; 2],
    pairs: [f64; 2],
    squares: f64,
    samples: f64,
    /// Sums of squares on the two halves of a checkerboard.
    checkers: [f64; 2],
}

impl Lags {
    /// Of a stack.
    pub fn new(stack: usize) -> Self {
        Self { stack, ..Self::default() }
    }

    /// Adds a band. Rows and columns are made level frame by frame first: noise that a row or a
    /// column shares is another matter. Neighbours are `period` apart, those of the same filter.
    /// The band's first row is `first_row` of the frame.
    pub fn add(&mut self, r: &Residuals, (across, down): (usize, usize), first_row: usize) {
        let (n, width) = (r.frames, r.width);
        let height = r.median.len() / width;
        if n < 3 || width <= across || height <= down {
            return;
        }
        let limit = (CLIP * r.typical.sqrt()) as f32;
        let mut plane = vec![0.0f32; width * height];
        for i in 0..n {
            for (o, v) in plane.iter_mut().zip(r.values.iter().skip(i).step_by(n)) {
                *o = v.clamp(-limit, limit);
            }
            level(&mut plane, width);
            let product = |apart: usize, keep: &dyn Fn(usize) -> bool| {
                let pairs = plane.iter().zip(&plane[apart..]).enumerate();
                let kept = pairs.filter(|(p, _)| keep(p % width));
                kept.fold((0.0, 0.0), |(s, k), (_, (a, b))| (s + f64::from(a * b), k + 1.0))
            };
            let beside = product(across, &|x| x + across < width);
            let below = product(down * width, &|_| true);
            for (k, (sum, count)) in [beside, below].into_iter().enumerate() {
                self.products[k] += sum;
                self.pairs[k] += count;
            }
            self.squares += plane.iter().map(|v| f64::from(v * v)).sum::<f64>();
            for (y, row) in plane.chunks(width).enumerate() {
                for (x, v) in row.iter().enumerate() {
                    self.checkers[(x + y + first_row) % 2] += f64::from(v * v);
                }
            }
        }
        // Levels of rows and columns make the rest of w pixels correlate by −1/w.
        let own = [1.0 / width as f64, 1.0 / height as f64];
        let variance = self.squares / (self.samples + (n * plane.len()) as f64).max(1.0);
        for k in 0..2 {
            self.products[k] += own[k] * variance * (n * plane.len()) as f64;
        }
        self.samples += (n * plane.len()) as f64;
    }

    /// Contrast of the noise on the two halves of a checkerboard, and its standard error for normal
    /// noise.
    fn contrast(&self) -> (f64, f64) {
        let [a, b] = self.checkers;
        ((a - b) / (a + b).max(1e-12), (2.0 / self.samples.max(1.0)).sqrt())
    }

    /// Correlation along and down.
    fn correlation(&self) -> [f64; 2] {
        let variance = (self.squares / self.samples.max(1.0)).max(1e-12);
        [0, 1].map(|k| self.products[k] / self.pairs[k].max(1.0) / variance)
    }
}

/// Takes the means of rows and columns off.
fn level(plane: &mut [f32], width: usize) {
    let height = plane.len() / width;
    let mut columns = vec![0.0f32; width];
    for row in plane.chunks_mut(width) {
        let mean = row.iter().sum::<f32>() / width as f32;
        row.iter_mut().for_each(|v| *v -= mean);
        columns.iter_mut().zip(row.iter()).for_each(|(c, v)| *c += v);
    }
    columns.iter_mut().for_each(|c| *c /= height as f32);
    for row in plane.chunks_mut(width) {
        row.iter_mut().zip(&columns).for_each(|(v, c)| *v -= c);
    }
}

/// Frames of a sensor without filters that a camera demosaiced: what is said of them. In the light
/// pixels of different filters differ in their noise on any sensor; in the dark, and as much, they
/// do not.
pub fn demosaiced(set: &CaptureSet, scans: &[Scan], lags: &[Lags]) -> Option<Finding> {
    let lags: Vec<&Lags> = lags.iter().filter(|l| l.samples > 0.0).collect();
    let role = |l: &Lags| set.captures[scans[l.stack].capture].role;
    let has = |r: Role| lags.iter().any(|l| role(l) == r);
    if set.cfa().channels().len() > 1 || !has(Role::Dark) || !has(Role::Flat) {
        return None;
    }
    let contrasts: Vec<(f64, f64)> = lags.iter().map(|l| l.contrast()).collect();
    let there = contrasts.iter().all(|(c, error)| {
        c.abs() > MIN_CONTRAST.max(ERRORS * error) && c.signum() == contrasts[0].0.signum()
    });
    let sizes = || contrasts.iter().map(|c| c.0.abs());
    let (low, high) = (sizes().fold(f64::INFINITY, f64::min), sizes().fold(0.0, f64::max));
    if !there || high > ALIKE * low {
        return None;
    }
    let mean = sizes().sum::<f64>() / contrasts.len() as f64;
    let ids: Vec<&str> =
        lags.iter().map(|l| set.captures[scans[l.stack].capture].id.as_str()).collect();
    let mut finding = Finding::new(Kind::ProcessedFrames, ids.join(", "), Done::Said);
    finding.count = lags.len();
    Some(finding.amount((1.0 - mean) / (1.0 + mean), f64::NAN, "1").says(format!(
        "the frames were processed: on one half of a checkerboard the noise has {:.2} times the \
         variance of the other half, in the dark and in the light alike ({}), as interpolated \
         pixels of a demosaiced picture have. Variances are not those of the sensor, and no effect \
         of it is named from them: take raw frames",
        (1.0 - mean) / (1.0 + mean),
        names(&ids),
    )))
}

/// Frames that a camera filtered: what is said of them.
pub fn filtered(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    lags: &[Lags],
) -> Option<Finding> {
    let lags: Vec<&Lags> = lags.iter().filter(|l| l.samples > 0.0).collect();
    let role = |l: &Lags| set.captures[scans[l.stack].capture].role;
    let variances = |r: Role| {
        let of = lags.iter().filter(move |l| role(l) == r);
        of.map(|l| transfer.points[l.stack].1).collect::<Vec<f64>>()
    };
    let darkest = variances(Role::Dark).into_iter().fold(f64::INFINITY, f64::min);
    let brightest = variances(Role::Flat).into_iter().fold(0.0, f64::max);
    if !(brightest > DIFFERENT_NOISE * darkest) {
        return None;
    }
    let correlations: Vec<[f64; 2]> = lags.iter().map(|l| l.correlation()).collect();
    for k in 0..2 {
        let there = lags.iter().zip(&correlations).all(|(l, c)| {
            c[k].abs() > MIN_CORRELATION.max(ERRORS / l.samples.sqrt())
                && c[k].signum() == correlations[0][k].signum()
        });
        let sizes = || correlations.iter().map(|c| c[k].abs());
        let (low, high) = (sizes().fold(f64::INFINITY, f64::min), sizes().fold(0.0, f64::max));
        if !there || high > ALIKE * low {
            return None;
        }
    }
    let mean = |k: usize| correlations.iter().map(|c| c[k]).sum::<f64>() / lags.len() as f64;
    let ids: Vec<&str> =
        lags.iter().map(|l| set.captures[scans[l.stack].capture].id.as_str()).collect();
    let what = if mean(0) > 0.0 { "smoothed" } else { "sharpened" };
    let mut finding = Finding::new(Kind::ProcessedFrames, ids.join(", "), Done::Said);
    finding.count = lags.len();
    Some(finding.amount(mean(0), f64::NAN, "1").says(format!(
        "the frames were processed: the noise of neighbouring pixels of a filter correlates by \
         {:.3} along rows and {:.3} along columns, in the dark and in the light alike ({}), as \
         frames do that a camera {what}. Variances are not those of the sensor, and no effect of \
         it is named from them: take raw frames with the camera's filters off",
        mean(0),
        mean(1),
        names(&ids),
    )))
}

/// Frames that were transformed in blocks of 8 x 8: what is said of them.
pub fn transformed(set: &CaptureSet, scan: &Scan, blocks: &Blocks) -> Finding {
    let id = &set.captures[scan.capture].id;
    let mut finding = Finding::new(Kind::ProcessedFrames, id.clone(), Done::Said);
    finding.count = 1;
    finding.amount(blocks.step_dn, f64::NAN, "DN").says(format!(
        "the frames were processed: coefficients of cosine transforms in blocks of 8 x 8 pixels \
         lie on steps of {:.2} DN, as lossy compression leaves them (strength {:.0} at the blocks' \
         own place, {:.1} at others, chance gives up to {:.1}). No effect of the sensor is named \
         from them: take raw frames without lossy compression",
        blocks.step_dn, blocks.strength, blocks.elsewhere, blocks.limit,
    ))
}
