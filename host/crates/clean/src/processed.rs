//! Frames that a camera processed. Filters correlate the noise of neighbouring pixels, equally in
//! the dark and in the light, as no sensor does; in demosaiced pictures the interpolated half of a
//! checkerboard has less noise than the other; compression leaves coefficients on steps
//! ([`super::blocks`]).

use super::blocks::Blocks;
use super::finding::{Done, Finding, Kind, names};
use super::residuals::Residuals;
use super::scan::Scan;
use super::transfer::Transfer;
use camrig_captures::{CaptureSet, Role};

/// Smallest correlation of neighbours that indicates a filter. Coupling between pixels and slow
/// amplifiers cause less.
const MIN_CORRELATION: f64 = 0.01;
/// Smallest contrast of the noise of the two halves of a checkerboard that indicates interpolation:
/// the mean of two pixels has half of the variance, of four a quarter, contrasts of 0.33 and 0.6.
const MIN_CONTRAST: f64 = 0.1;
/// Standard errors, 1/√samples, from which a correlation or contrast is significant.
const MIN_ERRORS: f64 = 6.0;
/// Largest ratio of the correlations of any two stacks that one filter causes: what a sensor's own
/// circuits cause depends on the share of shot noise.
const MAX_RATIO: f64 = 1.6;
/// Ratio of the brightest to the darkest stack's variance from which dark and light differ in
/// noise.
const DIFFERENT_NOISE: f64 = 2.0;
/// Residuals are clipped to this many standard deviations.
const CLIP: f64 = 5.0;

/// Correlation of a stack's noise with the next pixel of the same filter, along rows and columns.
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

    /// Adds a band that begins at `first_row` of the frame, for a filter pattern of `across`
    /// columns and `down` rows. The means of rows and columns are subtracted first, frame by
    /// frame: noise that a row or a column shares is not a filter's.
    pub fn add(&mut self, r: &Residuals, (across, down): (usize, usize), first_row: usize) {
        let (n, width) = (r.frames, r.width);
        let height = r.median.len() / width;
        if n < 3 || width <= across || height <= down {
            return;
        }
        let limit = (CLIP * r.typical_variance.sqrt()) as f32;
        let mut plane = vec![0.0f32; width * height];
        for i in 0..n {
            for (o, v) in plane.iter_mut().zip(r.values.iter().skip(i).step_by(n)) {
                *o = v.clamp(-limit, limit);
            }
            subtract_means(&mut plane, width);
            let product = |distance: usize, keep: &dyn Fn(usize) -> bool| {
                let pairs = plane.iter().zip(&plane[distance..]).enumerate();
                let kept = pairs.filter(|(p, _)| keep(p % width));
                kept.fold((0.0, 0.0), |(s, k), (_, (a, b))| (s + f64::from(a * b), k + 1.0))
            };
            let right = product(across, &|x| x + across < width);
            let below = product(down * width, &|_| true);
            for (k, (sum, count)) in [right, below].into_iter().enumerate() {
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
        // Subtracting the mean of w pixels correlates them by −1/w.
        let bias = [1.0 / width as f64, 1.0 / height as f64];
        let variance = self.squares / (self.samples + (n * plane.len()) as f64).max(1.0);
        for k in 0..2 {
            self.products[k] += bias[k] * variance * (n * plane.len()) as f64;
        }
        self.samples += (n * plane.len()) as f64;
    }

    /// Contrast of the variance of the two halves of a checkerboard.
    fn contrast(&self) -> f64 {
        let [a, b] = self.checkers;
        (a - b) / (a + b).max(1e-12)
    }

    /// Standard error of the contrast for normal noise.
    fn contrast_error(&self) -> f64 {
        (2.0 / self.samples.max(1.0)).sqrt()
    }

    /// Correlation along rows and along columns.
    fn correlation(&self) -> [f64; 2] {
        let variance = (self.squares / self.samples.max(1.0)).max(1e-12);
        [0, 1].map(|k| self.products[k] / self.pairs[k].max(1.0) / variance)
    }
}

/// Subtracts the means of rows, then those of columns.
fn subtract_means(plane: &mut [f32], width: usize) {
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

/// Ids of the captures of some stacks.
fn ids<'a>(set: &'a CaptureSet, scans: &[Scan], lags: &[&Lags]) -> Vec<&'a str> {
    lags.iter().map(|l| set.captures[scans[l.stack].capture].id.as_str()).collect()
}

/// A finding about processed captures.
fn finding(ids: &[&str]) -> Finding {
    Finding::new(Kind::ProcessedFrames, ids.join(", "), Done::Reported).with_count(ids.len())
}

/// Whether the figures of all stacks are significant, each above its least size, and equal to
/// within what one filter causes.
fn are_alike(figures: &[f64], least: impl Iterator<Item = f64>) -> bool {
    let same_sign = |f: &f64| f.signum() == figures[0].signum();
    let significant = figures.iter().zip(least).all(|(f, least)| f.abs() > least && same_sign(f));
    let sizes = || figures.iter().map(|f| f.abs());
    let (low, high) = (sizes().fold(f64::INFINITY, f64::min), sizes().fold(0.0, f64::max));
    significant && high <= MAX_RATIO * low
}

/// The finding about frames of a set without colour filters that a camera demosaiced. In the light,
/// pixels of different filters differ in noise on any sensor; in the dark, and by the same ratio,
/// they do not.
pub fn demosaiced(set: &CaptureSet, scans: &[Scan], lags: &[Lags]) -> Option<Finding> {
    let lags: Vec<&Lags> = lags.iter().filter(|l| l.samples > 0.0).collect();
    let role = |l: &Lags| set.captures[scans[l.stack].capture].role;
    let has = |r: Role| lags.iter().any(|l| role(l) == r);
    if set.cfa().channels().len() > 1 || !has(Role::Dark) || !has(Role::Flat) {
        return None;
    }
    let contrasts: Vec<f64> = lags.iter().map(|l| l.contrast()).collect();
    let least = |l: &Lags| MIN_CONTRAST.max(MIN_ERRORS * l.contrast_error());
    if !are_alike(&contrasts, lags.iter().map(|l| least(l))) {
        return None;
    }
    let mean = contrasts.iter().map(|c| c.abs()).sum::<f64>() / contrasts.len() as f64;
    let ids = ids(set, scans, &lags);
    let finding = finding(&ids).with_amount((1.0 - mean) / (1.0 + mean), f64::NAN, "1");
    Some(finding.with_description(format!(
        "the frames were processed: the noise of one half of a checkerboard has {:.2} times the \
         variance of the other half, equally in the dark and in the light ({}), like the \
         interpolated pixels of a demosaiced picture. Variances are not those of the sensor, and no \
         effect is identified from them: take raw frames",
        (1.0 - mean) / (1.0 + mean),
        names(&ids),
    )))
}

/// The finding about frames that a camera filtered.
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
        of.map(|l| transfer.points[l.stack].variance_dn2).collect::<Vec<f64>>()
    };
    let darkest = variances(Role::Dark).into_iter().fold(f64::INFINITY, f64::min);
    let brightest = variances(Role::Flat).into_iter().fold(0.0, f64::max);
    if !(brightest > DIFFERENT_NOISE * darkest) {
        return None;
    }
    let correlations: Vec<[f64; 2]> = lags.iter().map(|l| l.correlation()).collect();
    for k in 0..2 {
        let along: Vec<f64> = correlations.iter().map(|c| c[k]).collect();
        let least = |l: &Lags| MIN_CORRELATION.max(MIN_ERRORS / l.samples.sqrt());
        if !are_alike(&along, lags.iter().map(|l| least(l))) {
            return None;
        }
    }
    let mean = |k: usize| correlations.iter().map(|c| c[k]).sum::<f64>() / lags.len() as f64;
    let ids = ids(set, scans, &lags);
    let what = if mean(0) > 0.0 { "smoothed" } else { "sharpened" };
    Some(finding(&ids).with_amount(mean(0), f64::NAN, "1").with_description(format!(
        "the frames were processed: the correlation of neighbouring pixels' noise is {:.3} along \
         rows and {:.3} along columns, equally in the dark and in the light ({}), as in frames that \
         a camera {what}. Variances are not those of the sensor, and no effect is identified from \
         them: take raw frames with the camera's filters off",
        mean(0),
        mean(1),
        names(&ids),
    )))
}

/// The finding about frames that were compressed in blocks of 8 x 8.
pub fn transformed(set: &CaptureSet, scan: &Scan, blocks: &Blocks) -> Finding {
    let finding = finding(&[&set.captures[scan.capture].id]);
    finding.with_amount(blocks.step_dn, f64::NAN, "DN").with_description(format!(
        "the frames were processed: coefficients of cosine transforms in blocks of 8 x 8 pixels \
         are multiples of {:.2} DN, as after lossy compression (test statistic {:.0} at the position \
         of a coder's blocks, {:.1} elsewhere, limit {:.1}). No effect of the sensor is identified \
         from them: take raw frames without lossy compression",
        blocks.step_dn, blocks.strength, blocks.elsewhere, blocks.limit,
    ))
}
