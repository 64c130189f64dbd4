//! Single stacks whose light or exposure is not what the manifest says: a robust regression over
//! the levels.
//!
//! The response of a sensor is smooth in the level: y/x = g (1 − a uⁿ), y the mean above dark, x
//! the stated light × exposure, u = x over the largest x. Each stack is left out in turn, the law
//! is fitted to the others (with a term ∝ 1/x for an offset, and one ∝ 1/t where exposures differ,
//! as alternatives), and the stack's distance is taken in standard deviations of what was fitted
//! *or* of the others' own scatter, whichever is larger (externally studentised). A stack is named
//! where Student's t passes once in a thousand sets, where no other stack and no smooth law of one
//! parameter more explains the same (F at 1 %), and, if it is the brightest, where its noise is
//! that of the others' light: saturation takes noise away too.

use super::finding::{Done, Finding, Kind};
use super::scan::Scan;
use super::transfer::Transfer;
use camrig_base::median::median;
use camrig_base::tails;
use camrig_captures::{Capture, CaptureSet, Light, Role};
use camrig_linear::{LeastSquares, Matrix, Vector, quadratic};

/// Chance of a false name in a set.
const FALSE_NAME: f64 = 1e-3;
/// Chance by which another explanation that is as good is no chance.
const AS_GOOD: f64 = 0.01;
/// Levels without which none is singled out: three for the law, two that agree, one that does not.
const MIN_LEVELS: usize = 5;
/// Levels from which two may be named.
const LEVELS_FOR_PAIRS: usize = 9;
/// Ratio beyond which an entry of the manifest is another capture's altogether, which is refused
/// where the set is judged.
const GROSS_RATIO: f64 = 1.5;
/// Share of saturated samples from which a flat is left out: its mean is below its light.
const SATURATED: f64 = 1e-5;
/// Variance over signal of the brightest stack, over that of the others, within which its own light
/// made its noise. Chosen: far above what a bent response does, far below what
/// saturation takes away.
const OWN_NOISE: f64 = 0.1;
/// Variance over that of the dark from which it tells the light.
const SHOT_NOISE: f64 = 2.0;
/// Exponents n that are tried; 0 stands for a straight response.
const EXPONENTS: [f64; 17] =
    [0.0, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.25, 2.5, 2.75, 3.0, 3.25, 3.5, 4.0, 5.0, 6.0];

/// A wrong label.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// Index of the capture.
    pub capture: usize,
    /// Stated over true light × exposure.
    pub ratio: f64,
    /// Its standard error.
    pub std_error: f64,
    /// Relative scatter of the other stacks about the law.
    pub scatter: f64,
    /// Relative standard error of a mean from its frames alone.
    pub noise: f64,
    /// Levels that were compared.
    pub levels: usize,
}

/// One level.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Level {
    pub capture: usize,
    /// Stated light × exposure.
    pub x: f64,
    pub exposure_s: f64,
    /// Mean above dark, DN, and its standard error.
    pub y: f64,
    pub se: f64,
    /// Variance above the dark's over y, DN; `None` where noise does not tell.
    pub slope: Option<f64>,
}

/// Wrong labels of a set, each series of flats by itself.
pub fn labels(set: &CaptureSet, scans: &[Scan], transfer: &Transfer) -> Vec<Label> {
    let mut found = Vec::new();
    let mut series: Vec<(&Capture, Vec<Level>)> = Vec::new();
    for (i, scan) in scans.iter().enumerate() {
        let capture = &set.captures[scan.capture];
        let Some(level) = level(set, scans, transfer, i) else { continue };
        match series.iter_mut().find(|(c, _)| same_lamp(c, capture)) {
            Some((_, levels)) => levels.push(level),
            None => series.push((capture, vec![level])),
        }
    }
    for (_, levels) in series {
        found.extend(named(&levels));
    }
    found
}

/// Whether two flats were taken in the same light with the same settings.
fn same_lamp(a: &Capture, b: &Capture) -> bool {
    let light = |c: &Capture| c.light.as_ref().and_then(|l| l.wavelength_nm);
    a.analog_gain == b.analog_gain && light(a) == light(b) && a.temperature_c == b.temperature_c
}

/// The stated amount of light of a capture, in one unit for all captures of a wavelength.
fn amount(light: &Light) -> Option<f64> {
    match (light.irradiance_w_m2, light.photons_per_pixel_per_s, light.lux) {
        (Some(e), None, None) => Some(e),
        (None, Some(n), None) => Some(n),
        (None, None, Some(lux)) => Some(lux),
        _ => None,
    }
}

fn level(set: &CaptureSet, scans: &[Scan], transfer: &Transfer, i: usize) -> Option<Level> {
    let scan = &scans[i];
    let capture = &set.captures[scan.capture];
    if capture.role != Role::Flat || scan.saturated(set.sensor.white_level_dn) > SATURATED {
        return None;
    }
    let x = amount(capture.light.as_ref()?)? * capture.exposure_s;
    let (dark, dark_variance) = dark(set, scans, transfer, capture)?;
    let (mean, variance) = transfer.points[i];
    let (y, n) = (mean - dark, scan.frames.len() as f64);
    let pixels = (set.sensor.width * set.sensor.height) as f64;
    // Shot and read noise, or what the frames' means scatter by, where that is more.
    let own = (variance.max(0.0) / (n * pixels)).sqrt();
    let of_frames = (0..scan.frames.len()).map(|f| (scan.level(f) - mean).powi(2)).sum::<f64>();
    let of_frames = (of_frames / (n * (n - 1.0).max(1.0))).sqrt();
    let excess = variance - dark_variance;
    (x > 0.0 && y > 0.0).then_some(Level {
        capture: scan.capture,
        x,
        exposure_s: capture.exposure_s,
        y,
        se: own.max(of_frames).max(1e-6 * y),
        slope: (excess > SHOT_NOISE * dark_variance).then_some(excess / y),
    })
}

/// Level and variance of the dark at a capture's exposure and gain, along the line through the
/// darks on either side of it.
fn dark(
    set: &CaptureSet,
    scans: &[Scan],
    transfer: &Transfer,
    of: &Capture,
) -> Option<(f64, f64)> {
    let mut darks: Vec<(f64, f64, f64)> = scans
        .iter()
        .zip(&transfer.points)
        .filter(|(s, _)| {
            let c = &set.captures[s.capture];
            // Not those after light, which may hold some of it.
            c.role == Role::Dark
                && c.analog_gain == of.analog_gain
                && c.temperature_c == of.temperature_c
                && c.preceded_by.is_none()
        })
        .map(|(s, p)| (set.captures[s.capture].exposure_s, p.0, p.1))
        .collect();
    darks.sort_by(|a, b| a.0.total_cmp(&b.0));
    let t = of.exposure_s;
    let (first, last) = (*darks.first()?, *darks.last()?);
    if darks.len() == 1 || t <= first.0 {
        return Some((first.1, first.2));
    }
    if t >= last.0 {
        return Some((last.1, last.2));
    }
    let after = darks.iter().position(|d| d.0 > t)?;
    let (a, b) = (darks[after - 1], darks[after]);
    let share = (t - a.0) / (b.0 - a.0);
    Some((a.1 + share * (b.1 - a.1), a.2 + share * (b.2 - a.2)))
}

/// What a law leaves of the levels.
struct Fit {
    /// Of each level: what the law leaves, relative, and its standard deviation from its own error
    /// and the law's, both without the scatter of the rest.
    left: Vec<(f64, f64)>,
    /// The law's value of each level, over the median ratio.
    law: Vec<f64>,
    /// χ² of the levels that were fitted, and their degrees of freedom.
    chi: f64,
    dof: f64,
}

impl Fit {
    /// Variance of the levels about the law over what their errors give, at least 1.
    fn scale(&self) -> f64 {
        (self.chi / self.dof).max(1.0)
    }
}

/// Terms beside the straight and the bent response.
#[derive(Clone, Copy, PartialEq)]
enum Also {
    Nothing,
    Offset,
    Time,
}

/// The simplest law that fits the levels of `keep` (Schwarz's criterion); `None` where they are
/// too few.
fn fit(levels: &[Level], keep: &[bool], also: Also) -> Option<Fit> {
    let top = levels.iter().map(|l| l.x).fold(0.0, f64::max);
    let middle = median(&mut levels.iter().map(|l| l.y / l.x).collect::<Vec<_>>(), f64::total_cmp);
    let kept: Vec<usize> = (0..levels.len()).filter(|&i| keep[i]).collect();
    let n = kept.len() as f64;
    let mut best: Option<(f64, Fit)> = None;
    for exponent in EXPONENTS {
        let terms = |l: &Level| {
            let mut terms = vec![1.0];
            if exponent > 0.0 {
                terms.push(libm::pow(l.x / top, exponent));
            }
            match also {
                Also::Nothing => {}
                Also::Offset => terms.push(top / l.x),
                Also::Time => terms.push(levels[0].exposure_s / l.exposure_s),
            }
            terms
        };
        let (ratio, error) = (|l: &Level| l.y / l.x / middle, |l: &Level| l.se / l.x / middle);
        let columns = terms(&levels[0]).len();
        // The exponent is a parameter too.
        let used = columns as f64 + f64::from(u8::from(exponent > 0.0));
        if n - used < 1.0 {
            continue;
        }
        let a = Matrix::from_fn(kept.len(), columns, |r, c| {
            terms(&levels[kept[r]])[c] / error(&levels[kept[r]])
        });
        let b =
            Vector::from_fn(kept.len(), |r, _| ratio(&levels[kept[r]]) / error(&levels[kept[r]]));
        let Some(fit) = LeastSquares::of(&a, &b) else { continue };
        let score = n * libm::log(fit.chi2.max(0.3 * n)) + used * libm::log(n);
        if best.as_ref().is_some_and(|(least, _)| score >= *least) {
            continue;
        }
        let (mut left, mut law) = (Vec::new(), Vec::new());
        for l in levels {
            let row = Vector::from_vec(terms(l));
            let value = row.dot(&fit.coefficients);
            let of_law = quadratic(&fit.covariance, &row);
            left.push((ratio(l) - value, (error(l).powi(2) + of_law).sqrt()));
            law.push(value);
        }
        best = Some((score, Fit { left, law, chi: fit.chi2, dof: n - used }));
    }
    best.map(|b| b.1)
}

/// The levels of a series that do not belong to the law of the others.
pub(crate) fn named(levels: &[Level]) -> Vec<Label> {
    if levels.len() < MIN_LEVELS {
        return Vec::new();
    }
    let one = outliers(levels, 1);
    // Two wrong labels hide each other where one is left out.
    let two = if levels.len() >= LEVELS_FOR_PAIRS { outliers(levels, 2) } else { None };
    match (one, two) {
        (Some(one), Some(two)) => {
            let freedom = levels.len() as f64 - 5.0;
            let better = one.scale / two.scale;
            let chance = tails::fisher_upper(better, freedom + 1.0, freedom);
            if chance < FALSE_NAME { two.labels } else { one.labels }
        }
        (one, two) => one.or(two).map_or_else(Vec::new, |o| o.labels),
    }
}

/// Levels that stand out of the law of the others.
struct Outliers {
    labels: Vec<Label>,
    scale: f64,
}

/// The `size` levels without which the others fit best, where they are named.
fn outliers(levels: &[Level], size: usize) -> Option<Outliers> {
    let n = levels.len();
    let mut tried: Vec<(Fit, Vec<usize>)> = Vec::new();
    for i in 0..n {
        let others: Vec<Vec<usize>> = match size {
            1 => vec![vec![i]],
            _ => (i + 1..n).map(|j| vec![i, j]).collect(),
        };
        for out in others {
            let keep: Vec<bool> = (0..n).map(|k| !out.contains(&k)).collect();
            if let Some(fit) = fit(levels, &keep, Also::Nothing) {
                tried.push((fit, out));
            }
        }
    }
    tried.sort_by(|a, b| (a.0.chi / a.0.dof).total_cmp(&(b.0.chi / b.0.dof)));
    let (best, out) = tried.first()?;
    let scale = best.scale();
    let subsets = tried.len() as f64;
    let stands_out = out.iter().all(|&i| {
        let (left, sd) = best.left[i];
        tails::student_both(left / (sd * scale.sqrt()), best.dof) < FALSE_NAME / subsets
    });
    let as_good =
        |other: &Fit| tails::fisher_upper(other.scale() / scale, other.dof, best.dof) > AS_GOOD;
    let ambiguous = tried.get(1).is_some_and(|(other, _)| as_good(other));
    let all = vec![true; n];
    let times = levels.iter().any(|l| l.exposure_s != levels[0].exposure_s);
    let smooth = |also: Also| fit(levels, &all, also).is_some_and(|f| as_good(&f));
    if !stands_out
        || ambiguous
        || smooth(Also::Offset)
        || (times && smooth(Also::Time))
        || !out.iter().all(|&i| own_noise(levels, i))
    {
        return None;
    }
    let labels: Vec<Label> = out
        .iter()
        .map(|&i| {
            let (left, sd) = best.left[i];
            let law = best.law[i];
            // Measured over stated light is too low by what was stated too high.
            let ratio = law / (law + left);
            let noise = levels[i].se / levels[i].y;
            Label {
                capture: levels[i].capture,
                ratio,
                std_error: ratio * sd * scale.sqrt() / law,
                scatter: scale.sqrt() * noise,
                noise,
                levels: n,
            }
        })
        .collect();
    let gross = |r: f64| !(1.0 / GROSS_RATIO..GROSS_RATIO).contains(&r);
    (!labels.iter().any(|l| gross(l.ratio))).then_some(Outliers { labels, scale })
}

/// Whether a level's noise is that of the others' light: asked of the brightest, where saturation
/// would look like a wrong label.
fn own_noise(levels: &[Level], i: usize) -> bool {
    let x = levels[i].x;
    if !levels.iter().all(|l| l.x <= x) {
        return true;
    }
    let mut others: Vec<f64> =
        levels.iter().enumerate().filter(|o| o.0 != i).filter_map(|o| o.1.slope).collect();
    let middle = median(&mut others, f64::total_cmp);
    levels[i].slope.is_some_and(|s| (s / middle - 1.0).abs() < OWN_NOISE)
}

/// What is said of a wrong label.
pub fn finding(set: &CaptureSet, label: &Label) -> Finding {
    let id = &set.captures[label.capture].id;
    let percent = 100.0 * (label.ratio - 1.0);
    let mut finding = Finding::new(Kind::LightLabel, id.clone(), Done::TakenOff);
    finding.count = 1;
    let more = if percent > 0.0 { "more" } else { "less" };
    finding.amount(label.ratio, label.std_error, "1").says(format!(
        "captures.toml states {:.4} ± {:.4} times the light × exposure that these frames had, \
         {:.2} % {more}, by a smooth law through the other {} levels, which scatter about it by \
         {:.3} % (their noise alone: {:.3} %). A light or exposure is written wrongly, or the lamp \
         was another; the stack is judged with its light divided by {:.4}",
        label.ratio,
        label.std_error,
        percent.abs(),
        label.levels - 1,
        100.0 * label.scatter,
        100.0 * label.noise,
        label.ratio,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels of this response with errors of `se` each, drawn evenly about it.
    fn series(n: usize, se: f64, response: impl Fn(f64) -> f64) -> Vec<Level> {
        (0..n)
            .map(|i| {
                let x = 500.0 + 8000.0 * i as f64 / (n as f64 - 1.0);
                // Golden-ratio steps: even, and unlike any smooth law.
                let draw = ((i as f64 + 1.0) * 0.618_034).fract() * 2.0 - 1.0;
                let y = response(x) * (1.0 + se * draw);
                Level { capture: i, x, exposure_s: 0.01, y, se: se * y, slope: Some(0.4) }
            })
            .collect()
    }

    fn bent(x: f64) -> f64 {
        0.4 * x * (1.0 - 0.03 * (x / 8500.0).powf(1.8))
    }

    #[test]
    fn one_wrong_label_is_named_with_its_ratio() {
        for (n, wrong, ratio) in [(7, 3, 1.05), (9, 2, 0.97), (13, 7, 1.02)] {
            let mut levels = series(n, 1e-4, bent);
            levels[wrong].x *= ratio;
            let found = named(&levels);
            assert_eq!(found.len(), 1, "{found:?}");
            assert_eq!(found[0].capture, wrong);
            assert!((found[0].ratio - ratio).abs() < 2e-3, "{found:?}");
        }
    }

    #[test]
    fn two_wrong_labels_of_many_are_both_named() {
        let mut levels = series(13, 1e-4, |x| 0.4 * x);
        levels[3].x *= 1.05;
        levels[8].x *= 0.95;
        let mut found: Vec<usize> = named(&levels).iter().map(|l| l.capture).collect();
        found.sort_unstable();
        assert_eq!(found, [3, 8]);
    }

    #[test]
    fn smooth_responses_offsets_and_saturation_are_no_labels() {
        assert_eq!(named(&series(9, 1e-4, bent)), []);
        assert_eq!(named(&series(7, 1e-4, |x| 0.4 * x)), []);
        assert_eq!(named(&series(9, 1e-4, |x| 0.4 * x - 6.0)), []);
        let mut saturated = series(9, 1e-4, |x| 0.4 * x);
        saturated[8].y *= 0.9;
        saturated[8].slope = Some(0.1);
        assert_eq!(named(&saturated), []);
        // A lamp that scatters by itself hides a small error.
        let mut scattered = series(7, 3e-3, |x| 0.4 * x);
        scattered.iter_mut().for_each(|l| l.se = 1e-4 * l.y);
        scattered[3].x *= 1.005;
        assert_eq!(named(&scattered), []);
    }
}
