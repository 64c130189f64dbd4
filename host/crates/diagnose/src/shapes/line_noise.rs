//! Noise common to a row, or a column, that grows with the signal: a supply that the line loads, a
//! light that flickers faster than lines are read.
//!
//! The variance of line means in excess of white noise is c₀ + c₁ (s/S)^(2e) over the stacks, with
//! s the signal and S that of the brightest, by weighted least squares with the errors of the fit.
//! Without c₁ it is the catalogue's `row-temporal-noise` or `column-temporal-noise`; with a
//! spectrum that is not flat it is `flicker-banding` or `row-correlated-noise`.

use super::lines::Lines;
use super::seen::Seen;
use super::view::View;
use super::{FALSE_ALARMS, Shape, shapes};
use crate::data::design::Design;
use crate::finding::{Finding, number};
use crate::report::{Dependence, Domain, Form};
use crate::statistics::statistic::{Key, Place, What};
use crate::statistics::temporal::{Temporal, mean};
use camrig_base::Value;
use camrig_camera::Camera;
use camrig_camera::empirical::{Empirical, Table};
use camrig_captures::Role;
use camrig_sensor_core::effects::empirical::Quantity;

/// Exponents of the signal that are tried, in steps of 0.05; below them the model hardly differs
/// from a constant.
const EXPONENTS: std::ops::RangeInclusive<u32> = 5..=32;
const EXPONENT_STEP: f64 = 0.05;
/// Increase of χ² up to which an exponent is rounded to ½ or 1: 2.4 standard deviations.
const ROUNDING_CHI2: f64 = 6.0;
/// Standard errors from which the held-out frames confirm the part that grows.
const CONFIRMED_Z: f64 = 4.0;
/// Correlation of neighbouring lines above which the noise is not white over lines.
const MAX_CORRELATION: f64 = 0.1;
/// Fraction of the growing part's variance below which the constant part is negligible.
const NEGLIGIBLE: f64 = 0.02;
/// Fewest stacks, and flats among them, from which an exponent is estimated.
const MIN_STACKS: usize = 4;
const MIN_FLATS: usize = 3;

/// Line noise that grows with the signal.
pub(crate) struct LineNoise {
    /// Which lines it is common to.
    lines: Lines,
    exponent: Value,
    /// Standard deviation at a signal of S, e⁻.
    sigma_e: Value,
    /// S, e⁻.
    brightest_e: f64,
    /// Whether there is no constant part.
    alone: bool,
    evidence: [f64; 2],
}

/// Excess of the variance of line means, e², at a signal, e⁻, and the variance due to white noise.
struct Point {
    signal_e: f64,
    excess: f64,
    white: f64,
    /// Degrees of freedom.
    dof: f64,
}

/// Line noise that both halves show.
pub(crate) fn find(fit: &View<'_>, held_out: &View<'_>) -> Vec<Box<dyn Shape>> {
    shapes([Lines::Rows, Lines::Columns].into_iter().filter_map(|l| of(l, fit, held_out)))
}

fn points(view: &View<'_>, lines: Lines) -> Option<Vec<Point>> {
    let black = view.black()?;
    let (mut lag, mut all, mut samples) = (0.0, 0.0, 0.0);
    let mut out = Vec::new();
    for (i, (t, c)) in view.stacks.iter().zip(&view.design.conditions).enumerate() {
        let (power, across, what) = match lines {
            Lines::Rows => (&t.row_power, t.width, What::RowVariance),
            Lines::Columns => (&t.column_power, t.height, What::ColumnVariance),
        };
        let unit = view.gain(i).powi(2);
        let pixel = mean(&t.pixel_variance) / across as f64 / unit;
        let ratio = view.predicted((Place::Stack(i), what))?;
        // Smoothed frames have less pixel noise than shot noise, and no excess in their lines.
        let predicted = view.predicted((Place::Stack(i), What::Variance(0)))?;
        let pixel = pixel.max(predicted / across as f64 / unit);
        let bins = power.len() as f64;
        let measured = power.iter().sum::<f64>() / bins / unit;
        let flat = c.stack.role == Role::Flat;
        if flat {
            lag += t.row_lag / unit;
            all += measured;
            samples += t.dof * 2.0 * bins;
        }
        out.push(Point {
            signal_e: if flat { ((t.level() - black) / view.gain(i)).max(0.0) } else { 0.0 },
            excess: measured - ratio * pixel,
            white: ratio * pixel,
            dof: 2.0 * t.dof * bins,
        });
    }
    let flats = out.iter().filter(|p| p.signal_e > 0.0).count();
    let white = lines == Lines::Columns
        || (lag / all).abs() < MAX_CORRELATION.max(CONFIRMED_Z / samples.max(1.0).sqrt());
    (out.len() >= MIN_STACKS && flats >= MIN_FLATS && white).then_some(out)
}

/// Both coefficients, the second with its standard error.
struct Law {
    constant: f64,
    growing: Value,
}

/// c₀ and c₁ for an exponent; only c₀ without one.
fn law(points: &[Point], brightest: f64, exponent: Option<f64>) -> Law {
    let of = |p: &Point| exponent.map_or(0.0, |e| libm::pow(p.signal_e / brightest, 2.0 * e));
    let mut law = Law { constant: 0.0, growing: Value { value: 0.0, std_error: f64::NAN } };
    // The errors follow from the fit itself: they converge in three passes.
    for pass in 0..3 {
        let sd = |p: &Point| {
            let fitted = match pass {
                0 => p.excess.max(0.0),
                _ => law.constant + law.growing.value * of(p),
            };
            (2.0 / p.dof).sqrt() * (p.white + fitted)
        };
        let weights: Vec<f64> = points.iter().map(|p| sd(p).powi(2).recip()).collect();
        let sum = |f: &dyn Fn(&Point) -> f64| -> f64 {
            points.iter().zip(&weights).map(|(p, w)| w * f(p)).sum()
        };
        let (one, x, xx) = (sum(&|_| 1.0), sum(&of), sum(&|p| of(p).powi(2)));
        let (y, xy) = (sum(&|p| p.excess), sum(&|p| of(p) * p.excess));
        let free =
            exponent.map(|_| ((xy * one - x * y) / (xx * one - x * x), one / (xx * one - x * x)));
        let (growing, variance) = free.map_or((0.0, f64::NAN), |(v, s)| (v.max(0.0), s));
        let constant = (y - growing * x) / one;
        // No variance is negative.
        let (constant, growing, variance) = match (constant < 0.0, exponent) {
            (true, Some(_)) => (0.0, (xy / xx).max(0.0), 1.0 / xx),
            (true, None) => (0.0, 0.0, f64::NAN),
            _ => (constant, growing, variance),
        };
        law = Law { constant, growing: Value { value: growing, std_error: variance.sqrt() } };
    }
    law
}

fn of(lines: Lines, fit: &View<'_>, held_out: &View<'_>) -> Option<LineNoise> {
    let (a, b) = (points(fit, lines)?, points(held_out, lines)?);
    let brightest = a.iter().map(|p| p.signal_e).fold(0.0, f64::max);
    let exponents: Vec<f64> = EXPONENTS.map(|i| f64::from(i) * EXPONENT_STEP).collect();
    // By likelihood, in which larger errors of a model with more noise cost their logarithm.
    let constant = log_likelihood(&a, brightest, &law(&a, brightest, None), 1.0);
    let tried: Vec<(f64, Law, f64)> = exponents
        .iter()
        .map(|&e| {
            let law = law(&a, brightest, Some(e));
            let l = log_likelihood(&a, brightest, &law, e);
            (e, law, l)
        })
        .collect();
    let best = tried.iter().map(|t| t.2).fold(f64::INFINITY, f64::min);
    let chosen = tried
        .iter()
        .filter(|t| {
            [0.5, 1.0].iter().any(|s| (t.0 - s).abs() < 1e-9) && t.2 < best + ROUNDING_CHI2
        })
        .min_by(|x, y| x.2.total_cmp(&y.2))
        .or_else(|| tried.iter().min_by(|x, y| x.2.total_cmp(&y.2)))?;
    let within: Vec<f64> = tried.iter().filter(|t| t.2 < best + 1.0).map(|t| t.0).collect();
    let spread = within.last()? - within.first()?;
    // Two more parameters: χ² with two degrees of freedom, for two axes.
    let limit = -2.0 * libm::log(FALSE_ALARMS / 2.0);
    let again = law(&b, brightest, Some(chosen.0));
    let evidence = [
        constant - chosen.2,
        log_likelihood(&b, brightest, &law(&b, brightest, None), 1.0)
            - log_likelihood(&b, brightest, &again, chosen.0),
    ];
    if evidence[0] < limit || again.growing.z() < CONFIRMED_Z {
        return None;
    }
    let variance = (chosen.1.growing.value + again.growing.value) / 2.0;
    let se = libm::hypot(chosen.1.growing.std_error, again.growing.std_error) / 2.0;
    Some(LineNoise {
        lines,
        exponent: Value { value: chosen.0, std_error: spread / 2.0 + EXPONENT_STEP / 4.0 },
        sigma_e: Value::new(variance, se).sqrt()?,
        brightest_e: brightest,
        alone: chosen.1.constant < NEGLIGIBLE * chosen.1.growing.value,
        evidence,
    })
}

/// Twice the negative log-likelihood of mean squares under a model.
fn log_likelihood(points: &[Point], brightest: f64, law: &Law, exponent: f64) -> f64 {
    let of = |p: &Point| libm::pow(p.signal_e / brightest, 2.0 * exponent);
    let one = |p: &Point| {
        let expected = p.white + law.constant + law.growing.value * of(p);
        p.dof * (libm::log(expected) + (p.white + p.excess) / expected)
    };
    points.iter().map(one).sum()
}

impl Shape for LineNoise {
    fn subtract(&self, _: &Camera, _: &Design, _: &mut [Temporal]) {}

    fn shows_in(&self, design: &Design, key: &Key) -> bool {
        let (Place::Stack(i), what) = *key else { return false };
        let own = match self.lines {
            Lines::Rows => {
                matches!(what, What::RowVariance | What::RowSlow | What::RowPeak | What::RowLag)
            }
            Lines::Columns => {
                matches!(what, What::ColumnVariance | What::ColumnSlow | What::ColumnPeak)
            }
        };
        // The mean of all lines is that of the frame.
        let frames = matches!(what, What::FrameVariance | What::FrameTrend | What::FrameLag);
        design.conditions[i].stack.role == Role::Flat && (own || frames)
    }

    fn stages(&self, _: &mut Camera, _: &Design) -> Vec<Empirical> {
        let table = match self.lines {
            Lines::Rows => Table::RowFlat,
            Lines::Columns => Table::ColumnFlat,
        };
        let noise = Empirical::new(Quantity::Temporal, table, self.sigma_e.value);
        vec![Empirical { on_signal: (self.exponent.value, self.brightest_e.max(1.0)), ..noise }]
    }

    fn seen(&self, view: &View<'_>) -> Option<Seen> {
        let mut points = points(view, self.lines)?;
        points.sort_by(|a, b| a.signal_e.total_cmp(&b.signal_e));
        let point = |p: Point| [p.signal_e, p.excess.max(0.0).sqrt()];
        let y = match self.lines {
            Lines::Rows => "noise common to a row, e⁻",
            Lines::Columns => "noise common to a column, e⁻",
        };
        Some(Seen::curve("signal, e⁻", y, points.into_iter().map(point)))
    }

    fn findings(&self) -> Vec<Finding> {
        let line = self.lines.word();
        let form = match self.lines {
            Lines::Rows => Form::RowFlat,
            Lines::Columns => Form::ColumnFlat,
        };
        let part = self.sigma_e.scaled(1.0 / self.brightest_e);
        let law = match (self.exponent.value - 1.0).abs() < 1e-9 {
            true => format!("{} of the signal", number(part)),
            false => {
                format!("{} e⁻ at a signal of {:.0} e⁻", number(self.sigma_e), self.brightest_e)
            }
        };
        vec![Finding {
            dependence: Dependence { exposure: 0.0, signal: self.exponent.value },
            parameters: vec![
                ("exponent", self.exponent),
                ("part_of_signal", part),
                ("sigma_e", self.sigma_e),
                ("signal_e", Value::chosen(self.brightest_e)),
            ],
            description: format!(
                "noise common to a {line}, new in every {line} and frame, that grows with the \
                 signal to the power {}: {law}{} (a supply that the \
                 {line} loads, or a light that flickers faster than a {line} is read)",
                number(self.exponent),
                if self.alone { ", none in the dark" } else { "" },
            ),
            ..Finding::new(Domain::Temporal, form, self.evidence)
        }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::bench::{Hidden, Shot, WIDTH, figure, shoot};

    #[test]
    fn row_noise_that_grows_with_the_signal_is_told_from_one_that_does_not() {
        let of = |part: f64, constant: f64| {
            let volts = |e: &mut [f64], shot: &mut Shot<'_>| {
                for row in e.chunks_mut(WIDTH) {
                    let more = part * shot.signal * shot.normal() + constant * shot.normal();
                    row.iter_mut().for_each(|v| *v += more);
                }
            };
            let bench = shoot(61, &Hidden { volts: Some(&volts), ..Hidden::default() });
            let found = find(&bench.view(0), &bench.view(1));
            found.iter().flat_map(|s| s.findings()).collect::<Vec<Finding>>()
        };
        let findings = of(0.0015, 0.0);
        let [noise] = &findings[..] else { panic!("{findings:?}") };
        assert!((figure(noise, "exponent") - 1.0).abs() < 1e-9, "{noise:?}");
        // 2 · 10 frames of 56 rows in each of five flats: some 3 % of the amount.
        assert!((figure(noise, "part_of_signal") - 0.0015).abs() < 1.5e-4, "{noise:?}");
        assert!(noise.description.contains("none in the dark"), "{noise:?}");
        assert!(of(0.0, 3.0).is_empty() && of(0.0, 0.0).is_empty());
    }
}
