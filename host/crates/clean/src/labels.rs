//! Single stacks whose light or exposure differs from the manifest, by robust regression over the
//! levels of a series.
//!
//! The response of a sensor is smooth in the level: y/x = g (1 − a uⁿ), y the mean above dark, x
//! the stated light × exposure, u = x over the largest x. Each stack is left out in turn, the
//! response is fitted to the others (alternatively with a term ∝ 1/x for an offset, or ∝ 1/t where
//! exposures differ), and the stack's residual is divided by its standard deviation: from the
//! errors of both, scaled up where the others scatter more (externally studentised). A label is
//! wrong where Student's t is exceeded once in a thousand sets, where neither another stack nor a
//! smooth response with one more parameter explains the series as well (F test at 1 %), and, for
//! the brightest, where its noise matches the others': saturation reduces noise too.

use super::finding::{Done, Finding, Kind};
use super::levels::{Level, series};
use super::scan::Scan;
use super::transfer::Transfer;
use camrig_base::median::median;
use camrig_base::tails;
use camrig_captures::CaptureSet;
use camrig_linear::{LeastSquares, Matrix, Vector, quadratic};

/// Probability of a false alarm in a set.
const FALSE_ALARM: f64 = 1e-3;
/// Probability above which another explanation fits as well.
const AS_GOOD: f64 = 0.01;
/// Levels from which one is singled out: three for the response, two that agree, one that does not.
const MIN_LEVELS: usize = 5;
/// Levels from which two may be wrong.
const MIN_LEVELS_FOR_PAIRS: usize = 9;
/// Ratio beyond which the manifest describes another capture altogether; such sets are refused
/// where they are used.
const GROSS_RATIO: f64 = 1.5;
/// Relative difference of the brightest stack's variance over signal from the others' within which
/// its noise matches. Chosen: far above the effect of a bent response, far below that of
/// saturation.
const SAME_NOISE: f64 = 0.1;
/// Exponents n that are tested; 0 stands for a linear response.
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
    /// Relative scatter of the other stacks about the fit.
    pub scatter: f64,
    /// Relative standard error of the stack's mean.
    pub noise: f64,
    /// Number of levels of its series.
    pub levels: usize,
}

/// The wrong labels of a set.
pub fn labels(set: &CaptureSet, scans: &[Scan], transfer: &Transfer) -> Vec<Label> {
    series(set, scans, transfer).iter().flat_map(|levels| wrong_labels(levels)).collect()
}

/// A response fitted to some levels of a series.
struct Fit {
    /// For each level of the series.
    levels: Vec<Fitted>,
    /// χ² of the levels that were fitted.
    chi2: f64,
    /// Their degrees of freedom.
    dof: f64,
}

/// A level compared with the fit, in units of the median of y/x.
#[derive(Clone, Copy)]
struct Fitted {
    /// y/x of the fit.
    value: f64,
    /// y/x measured minus fitted.
    residual: f64,
    /// Standard deviation of the residual from the errors of level and fit, without scatter beyond
    /// them.
    sd: f64,
}

impl Fit {
    /// Reduced χ², at least 1.
    fn scale(&self) -> f64 {
        (self.chi2 / self.dof).max(1.0)
    }
}

/// A term in addition to the response.
#[derive(Clone, Copy, PartialEq)]
enum Extra {
    None,
    Offset,
    Time,
}

/// The simplest response that fits the levels of `keep` (Schwarz's criterion); `None` where they
/// are too few.
fn fit(levels: &[Level], keep: &[bool], extra: Extra) -> Option<Fit> {
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
            match extra {
                Extra::None => {}
                Extra::Offset => terms.push(top / l.x),
                Extra::Time => terms.push(levels[0].exposure_s / l.exposure_s),
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
        let compared = levels.iter().map(|l| {
            let row = Vector::from_vec(terms(l));
            let value = row.dot(&fit.coefficients);
            let of_fit = quadratic(&fit.covariance, &row);
            Fitted { value, residual: ratio(l) - value, sd: (error(l).powi(2) + of_fit).sqrt() }
        });
        best = Some((score, Fit { levels: compared.collect(), chi2: fit.chi2, dof: n - used }));
    }
    best.map(|b| b.1)
}

/// The levels of a series that deviate from the response of the others.
fn wrong_labels(levels: &[Level]) -> Vec<Label> {
    if levels.len() < MIN_LEVELS {
        return Vec::new();
    }
    let one = outliers(levels, 1);
    // Two wrong labels can mask each other where only one is left out.
    let two = if levels.len() >= MIN_LEVELS_FOR_PAIRS { outliers(levels, 2) } else { None };
    match (one, two) {
        (Some(one), Some(two)) => {
            let freedom = levels.len() as f64 - 5.0;
            let better = one.scale / two.scale;
            let chance = tails::fisher_upper(better, freedom + 1.0, freedom);
            if chance < FALSE_ALARM { two.labels } else { one.labels }
        }
        (one, two) => one.or(two).map_or_else(Vec::new, |o| o.labels),
    }
}

/// Levels that deviate from the response of the others.
struct Outliers {
    labels: Vec<Label>,
    scale: f64,
}

/// The `size` levels without which the others fit best, where their deviation is significant.
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
            if let Some(fit) = fit(levels, &keep, Extra::None) {
                tried.push((fit, out));
            }
        }
    }
    tried.sort_by(|a, b| (a.0.chi2 / a.0.dof).total_cmp(&(b.0.chi2 / b.0.dof)));
    let (best, out) = tried.first()?;
    let scale = best.scale();
    let subsets = tried.len() as f64;
    let significant = out.iter().all(|&i| {
        let Fitted { residual, sd, .. } = best.levels[i];
        tails::student_two_sided(residual / (sd * scale.sqrt()), best.dof) < FALSE_ALARM / subsets
    });
    let as_good =
        |other: &Fit| tails::fisher_upper(other.scale() / scale, other.dof, best.dof) > AS_GOOD;
    let ambiguous = tried.get(1).is_some_and(|(other, _)| as_good(other));
    let all = vec![true; n];
    let times = levels.iter().any(|l| l.exposure_s != levels[0].exposure_s);
    let smooth = |extra: Extra| fit(levels, &all, extra).is_some_and(|f| as_good(&f));
    if !significant
        || ambiguous
        || smooth(Extra::Offset)
        || (times && smooth(Extra::Time))
        || !out.iter().all(|&i| same_noise(levels, i))
    {
        return None;
    }
    let labels: Vec<Label> = out
        .iter()
        .map(|&i| {
            let Fitted { value, residual, sd } = best.levels[i];
            // Light stated too high makes measured over stated too low.
            let ratio = value / (value + residual);
            let noise = levels[i].se / levels[i].y;
            Label {
                capture: levels[i].capture,
                ratio,
                std_error: ratio * sd * scale.sqrt() / value,
                scatter: scale.sqrt() * noise,
                noise,
                levels: n,
            }
        })
        .collect();
    let gross = |r: f64| !(1.0 / GROSS_RATIO..GROSS_RATIO).contains(&r);
    (!labels.iter().any(|l| gross(l.ratio))).then_some(Outliers { labels, scale })
}

/// Whether a level's noise matches the others'. Tested for the brightest alone, where saturation
/// would look like a wrong label.
fn same_noise(levels: &[Level], i: usize) -> bool {
    let x = levels[i].x;
    if !levels.iter().all(|l| l.x <= x) {
        return true;
    }
    let mut others: Vec<f64> =
        levels.iter().enumerate().filter(|o| o.0 != i).filter_map(|o| o.1.slope).collect();
    let middle = median(&mut others, f64::total_cmp);
    levels[i].slope.is_some_and(|s| (s / middle - 1.0).abs() < SAME_NOISE)
}

/// The finding about a wrong label.
pub fn finding(set: &CaptureSet, label: &Label) -> Finding {
    let id = &set.captures[label.capture].id;
    let percent = 100.0 * (label.ratio - 1.0);
    let finding = Finding::new(Kind::LightLabel, id.clone(), Done::Corrected).with_count(1);
    let more = if percent > 0.0 { "more" } else { "less" };
    finding.with_amount(label.ratio, label.std_error, "1").with_description(format!(
        "captures.toml states {:.4} ± {:.4} times the light × exposure of these frames, {:.2} % \
         {more}, according to a smooth response through the other {} levels, which scatter about \
         it by {:.3} % (expected from noise: {:.3} %). A light or exposure is wrong, or another lamp \
         was used; the light of this stack is divided by {:.4}",
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
                // Golden-ratio steps: evenly distributed, and unlike any smooth response.
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
    fn one_wrong_label_is_found_with_its_ratio() {
        for (n, wrong, ratio) in [(7, 3, 1.05), (9, 2, 0.97), (13, 7, 1.02)] {
            let mut levels = series(n, 1e-4, bent);
            levels[wrong].x *= ratio;
            let found = wrong_labels(&levels);
            assert_eq!(found.len(), 1, "{found:?}");
            assert_eq!(found[0].capture, wrong);
            assert!((found[0].ratio - ratio).abs() < 2e-3, "{found:?}");
        }
    }

    #[test]
    fn two_wrong_labels_of_many_are_both_found() {
        let mut levels = series(13, 1e-4, |x| 0.4 * x);
        levels[3].x *= 1.05;
        levels[8].x *= 0.95;
        let mut found: Vec<usize> = wrong_labels(&levels).iter().map(|l| l.capture).collect();
        found.sort_unstable();
        assert_eq!(found, [3, 8]);
    }

    #[test]
    fn smooth_responses_offsets_and_saturation_are_not_wrong_labels() {
        assert_eq!(wrong_labels(&series(9, 1e-4, bent)), []);
        assert_eq!(wrong_labels(&series(7, 1e-4, |x| 0.4 * x)), []);
        assert_eq!(wrong_labels(&series(9, 1e-4, |x| 0.4 * x - 6.0)), []);
        let mut saturated = series(9, 1e-4, |x| 0.4 * x);
        saturated[8].y *= 0.9;
        saturated[8].slope = Some(0.1);
        assert_eq!(wrong_labels(&saturated), []);
        // A lamp that scatters masks a small error.
        let mut scattered = series(7, 3e-3, |x| 0.4 * x);
        scattered.iter_mut().for_each(|l| l.se = 1e-4 * l.y);
        scattered[3].x *= 1.005;
        assert_eq!(wrong_labels(&scattered), []);
    }
}
