//! Dual gain: above a certain signal, chosen for each pixel, a second amplifier with more noise and
//! a slightly different gain is used.
//!
//! The variance of the flats in excess of the prediction is a + b x + c [x above the step], and the
//! signal over the light 1 + a' + b'/x + d [x above the step]. The alternative is a smooth model
//! with x^e in place of the step. Its position is known only to lie between the samples of two
//! levels.

use super::seen::{self, Seen};
use super::view::{View, change_mean, gain, scale_noise};
use super::{FALSE_ALARMS, Shape, shapes};
use crate::data::design::Design;
use crate::finding::{Finding, number};
use crate::report::{Domain, Form};
use crate::statistics::maps::{self, MapKind, SATURATED_FLAT, saturated};
use crate::statistics::noise::frame_variance;
use crate::statistics::statistic::{Key, Place, What};
use crate::statistics::temporal::{Temporal, mean};
use camrig_base::Value;
use camrig_camera::Camera;
use camrig_camera::empirical::{Empirical, Response, Table};
use camrig_captures::Role;
use camrig_linear::{LeastSquares, Matrix, Vector};
use camrig_sensor_core::effects::empirical::Quantity;

/// Fewest flats that distinguish a step from a smooth model.
const MIN_FLATS: usize = 5;
/// Exponents of the smooth model.
const EXPONENTS: [f64; 8] = [0.5, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0];
/// Relative scatter of the light that is allowed where the flats do not show more: that of a
/// stabilised lamp with a calibrated photodiode (EMVA 1288).
const LIGHT: f64 = 1e-4;
/// Standard errors from which the held-out frames confirm it, and from which a ratio of gains is
/// reported.
const CONFIRMED_Z: f64 = 4.0;
/// χ² by which a smooth model may fit the noise better than the step if the signal shows the step.
const MAX_CHI2_DEFICIT: f64 = 6.0;
/// Positions of a step that are tried between two levels.
const POSITIONS: u32 = 200;
/// Fraction of a stack's samples left out at each end to determine their range.
const TAIL: f64 = 1e-4;

/// A step of the response.
pub(crate) struct Stitch {
    /// Levels of the flats on either side, e⁻.
    levels_e: [f64; 2],
    /// Their ids.
    ids: [String; 2],
    /// Highest sample of the first and lowest of the second, e⁻, and DN.
    open_e: [f64; 2],
    open_dn: [f64; 2],
    /// Where the model has it, e⁻.
    at_e: f64,
    /// Noise that is added above it, e⁻.
    more_e: Value,
    /// Gain above it over that below; 1 where the difference is not significant.
    ratio: Value,
    /// A stack whose samples lie on both sides, with its id.
    astride: Option<(usize, String)>,
    evidence: [f64; 2],
}

/// A flat or dark as measured, e⁻.
#[derive(Clone, Copy)]
struct Level {
    stack: usize,
    /// Signal as predicted.
    signal: f64,
    flat: bool,
    /// Variance minus the prediction, e².
    excess: Value,
    /// Predicted variance, e².
    predicted: f64,
    /// Measured over predicted signal, less 1.
    ratio: Value,
}

/// The step that both halves show.
pub(crate) fn find(fit: &View<'_>, held_out: &View<'_>) -> Vec<Box<dyn Shape>> {
    shapes(stitch(fit, held_out))
}

/// Stacks by signal; none without flats of known light in one channel.
fn levels(view: &View<'_>) -> Option<Vec<Level>> {
    let black = view.black()?;
    if view.camera.sensor.channel_names.len() > 1 {
        return None;
    }
    let mut out = Vec::new();
    for (i, (c, t)) in view.design.conditions.iter().zip(view.stacks).enumerate() {
        let flat = c.stack.role == Role::Flat;
        if flat && (!c.level_known || saturated(t) > SATURATED_FLAT) {
            continue;
        }
        let k = view.gain(i);
        let predicted = view.predicted((Place::Stack(i), What::Variance(0)))? / (k * k);
        let variance = mean(&t.pixel_variance) / (k * k);
        let n = t.pixel_variance.len() as f64;
        let signal = c.photo_e.first().copied().unwrap_or(0.0);
        let measured = (t.level() - black) / k;
        let frames = frame_variance(t) / (k * k);
        let se = ((variance / n).max(frames) / t.frames as f64).sqrt();
        out.push(Level {
            stack: i,
            signal,
            flat,
            excess: Value {
                value: variance - predicted,
                std_error: variance * (2.0 / (t.dof * n)).sqrt(),
            },
            predicted,
            ratio: Value {
                value: measured / signal.max(1e-9) - 1.0,
                std_error: libm::hypot(se / signal.max(1e-9), LIGHT),
            },
        });
    }
    out.sort_by(|a, b| a.signal.total_cmp(&b.signal));
    (out.iter().filter(|l| l.flat).count() >= MIN_FLATS).then_some(out)
}

/// Weighted least squares: the last coefficient with its standard error, and χ².
fn least_squares(columns: &[Vec<f64>], y: &[Value]) -> Option<(Value, f64)> {
    let a = Matrix::from_fn(y.len(), columns.len(), |i, j| columns[j][i] / y[i].std_error);
    let b = Vector::from_fn(y.len(), |i, _| y[i].value / y[i].std_error);
    let fit = LeastSquares::of(&a, &b)?;
    let last = columns.len() - 1;
    let se = fit.covariance[(last, last)].sqrt();
    Some((Value::new(fit.coefficients[last], se), fit.chi2))
}

/// Regressors of the variance: constant, proportional to the signal, and one more.
fn of_variance(levels: &[Level], more: Vec<f64>) -> Option<(Value, f64)> {
    let top = levels.last()?.signal;
    let one = vec![1.0; levels.len()];
    let x: Vec<f64> = levels.iter().map(|l| l.signal / top).collect();
    let y: Vec<Value> = levels.iter().map(|l| l.excess).collect();
    least_squares(&[one, x, more], &y)
}

/// 0 below a level, 1 from it on.
fn above(levels: &[Level], from: usize) -> Vec<f64> {
    (0..levels.len()).map(|i| f64::from(u8::from(i >= from))).collect()
}

/// The same of the signal over the light: a free gain and offset, and one more, over the flats.
fn of_gain(levels: &[Level], more: Vec<f64>) -> Option<(Value, f64)> {
    let top = levels.last()?.signal;
    let flats = || levels.iter().zip(&more).filter(|(l, _)| l.flat);
    let one = vec![1.0; flats().count()];
    let offset = flats().map(|(l, _)| top / l.signal).collect();
    let more = flats().map(|(_, more)| *more).collect();
    let y: Vec<Value> = flats().map(|(l, _)| l.ratio).collect();
    least_squares(&[one, offset, more], &y)
}

/// Regressors with one more column.
type Law = fn(&[Level], Vec<f64>) -> Option<(Value, f64)>;

/// Smallest χ² of the smooth models.
fn smooth(of: Law, levels: &[Level]) -> f64 {
    let top = levels.last().map_or(1.0, |l| l.signal);
    let left = |e: &f64| {
        let x = levels.iter().map(|l| libm::pow(l.signal / top, *e)).collect();
        Some(of(levels, x)?.1)
    };
    EXPONENTS.iter().filter_map(left).fold(f64::INFINITY, f64::min)
}

/// Reduced χ², at least 1.
fn spread(chi: f64, dof: f64) -> f64 {
    (chi / dof.max(1.0)).max(1.0)
}

/// A step between two levels.
struct Tried {
    /// Levels of the frames to fit and of those held out.
    levels: [Vec<Level>; 2],
    /// The first above.
    at: usize,
    /// A level that was left out of them: its samples lie on both sides.
    astride: Option<Level>,
    /// Steps of the variance, and of the gain.
    variance: [Value; 2],
    gain: [Value; 2],
    /// Fall of χ² of the variances from the best smooth model to the step.
    evidence: [f64; 2],
    /// The same for the signal, in units of the residual of the step; for the frames to fit only,
    /// since the error of a flat's light is common to all its frames.
    signal: f64,
    /// Reduced χ² of the variances.
    left: f64,
}

impl Tried {
    fn new(levels: [Vec<Level>; 2], at: usize, astride: Option<Level>) -> Option<Self> {
        let [a, b] = [0, 1].map(|i| of_variance(&levels[i], above(&levels[i], at)));
        let [c, d] = [0, 1].map(|i| of_gain(&levels[i], above(&levels[i], at)));
        let (a, b, c, d) = (a?, b?, c?, d?);
        let free = levels[0].len() as f64 - 3.0;
        let flats = levels[0].iter().filter(|l| l.flat).count() as f64 - 3.0;
        let with_scatter = |(step, chi): (Value, f64)| Value {
            std_error: step.std_error * spread(chi, flats).sqrt(),
            ..step
        };
        Some(Self {
            at,
            astride,
            variance: [a.0, b.0],
            gain: [with_scatter(c), with_scatter(d)],
            evidence: [
                smooth(of_variance, &levels[0]) - a.1,
                smooth(of_variance, &levels[1]) - b.1,
            ],
            signal: (smooth(of_gain, &levels[0]) - c.1) / spread(c.1, flats),
            left: spread(a.1 + b.1, 2.0 * free),
            levels,
        })
    }

    fn in_all(&self) -> f64 {
        self.evidence[0] + self.evidence[1] + self.signal
    }

    /// Whether both halves show more noise above the step, significantly for the best of so many.
    fn is_seen(&self, tried: usize) -> bool {
        // χ² with one degree of freedom.
        let limit = 2.0 * self.left * libm::log(tried as f64 / FALSE_ALARMS);
        let [a, b] = self.variance;
        a.z() + b.z() > CONFIRMED_Z * 2f64.sqrt()
            && a.value.min(b.value) > 0.0
            && self.evidence[0] + self.evidence[1] > -MAX_CHI2_DEFICIT
            && self.in_all() > limit
    }
}

/// Steps between levels, two or more below and one above; and the same with a level left out,
/// whose samples may lie on both sides.
fn steps(a: &[Level], b: &[Level]) -> Vec<Tried> {
    let flats = (0..a.len()).filter(|&i| a[i].flat).skip(2);
    let of = |at: usize| {
        let without = |levels: &[Level], i: usize| {
            let mut levels = levels.to_vec();
            levels.remove(i);
            levels
        };
        let enough = a.iter().filter(|l| l.flat).count() > MIN_FLATS && at + 1 < a.len();
        let astride = enough.then(|| [without(a, at), without(b, at)]);
        [
            Tried::new([a.to_vec(), b.to_vec()], at, None),
            astride.and_then(|levels| Tried::new(levels, at, Some(a[at]))),
        ]
    };
    flats.flat_map(of).flatten().collect()
}

fn stitch(fit: &View<'_>, held_out: &View<'_>) -> Option<Stitch> {
    let (a, b) = (levels(fit)?, levels(held_out)?);
    if a.len() != b.len() {
        return None;
    }
    let tried = steps(&a, &b);
    let seen = tried.iter().filter(|t| t.is_seen(tried.len()));
    let best = seen.max_by(|x, y| x.in_all().total_cmp(&y.in_all()))?;
    let (at, [first, second]) = (best.at, best.evidence);
    let evidence = [first + best.signal, second];
    let [a, b] = &best.levels;
    let [d, d2] = best.gain;
    let significant = d.z().abs() > CONFIRMED_Z && d2.z() * d.value.signum() > CONFIRMED_Z / 2.0;
    let ratio = match significant {
        true => {
            Value { value: 1.0 + (d.value + d2.value) / 2.0, std_error: d.std_error / 2f64.sqrt() }
        }
        false => Value::chosen(1.0),
    };
    let more_e = added(&[a, b], at, ratio.value)?;
    let (below, over) = (&a[at - 1], &a[at]);
    let id = |l: &Level| fit.design.conditions[l.stack].stack.id.clone();
    let black = fit.black()?;
    let open_dn =
        [quantile(&fit.stacks[below.stack], 1.0 - TAIL), quantile(&fit.stacks[over.stack], TAIL)];
    let open_e = [
        (open_dn[0] - black) / fit.gain(below.stack),
        (open_dn[1] - black) / fit.gain(over.stack),
    ];
    // Anywhere between the two, if no level has samples on both sides.
    let middle = (open_e[0] + open_e[1]) / 2.0;
    let at_e = best.astride.map_or(middle, |l| place(&l, open_e, more_e.value, ratio.value));
    Some(Stitch {
        levels_e: [below.signal, over.signal],
        ids: [id(below), id(over)],
        open_e,
        open_dn,
        at_e,
        more_e,
        ratio,
        astride: best.astride.map(|l| (l.stack, id(&l))),
        evidence,
    })
}

/// Noise that is added above the step, where the gain there is `ratio` times that below.
fn added(halves: &[&[Level]], at: usize, ratio: f64) -> Option<Value> {
    let mut found = Vec::new();
    for levels in halves {
        let (below, over) = levels.split_at(at);
        // The slope of the variance, of a gain error in the model, is that of the levels below.
        let top = below.last()?.signal.max(1e-9);
        let one = vec![1.0; below.len()];
        let x: Vec<f64> = below.iter().map(|l| l.signal / top).collect();
        let y: Vec<Value> = below.iter().map(|l| l.excess).collect();
        let (slope, _) = least_squares(&[one, x], &y)?;
        let slope = if slope.z().abs() > CONFIRMED_Z { slope.value / top } else { 0.0 };
        found.extend(over.iter().map(|l| {
            let own = l.predicted + slope * l.signal;
            let variance = l.excess.value + l.predicted;
            Value { value: variance - ratio * ratio * own, std_error: l.excess.std_error }
        }));
    }
    let variance = Value::combine(found)?;
    variance.sqrt()
}

/// Where between two signals, e⁻, a step lies that a level has on both sides: where its excess of
/// noise and its gain are nearest to those measured. Its samples are normal about its signal.
fn place(l: &Level, [low, high]: [f64; 2], more_e: f64, ratio: f64) -> f64 {
    let sd = l.predicted.max(1e-9).sqrt();
    let change = (ratio - 1.0) * l.signal;
    let left = |step: &f64| {
        let z = (step - l.signal) / sd;
        let part = 0.5 * libm::erfc(z / std::f64::consts::SQRT_2);
        let density = libm::exp(-z * z / 2.0) / std::f64::consts::TAU.sqrt();
        // Samples above the step are higher than others in any case.
        let noise = part * more_e * more_e
            + change * change * part * (1.0 - part)
            + 2.0 * change * sd * density;
        ((noise - l.excess.value) / l.excess.std_error).powi(2)
            + (((ratio - 1.0) * part - l.ratio.value) / l.ratio.std_error).powi(2)
    };
    let steps = (0..=POSITIONS).map(|i| low + (high - low) * f64::from(i) / f64::from(POSITIONS));
    steps.min_by(|x, y| left(x).total_cmp(&left(y))).unwrap_or(low)
}

/// Quantile of a stack's samples, DN.
fn quantile(t: &Temporal, share: f64) -> f64 {
    let total: f64 = t.histogram.iter().map(|&n| f64::from(n)).sum();
    let mut sum = 0.0;
    let at = t.histogram.iter().position(|&n| {
        sum += f64::from(n);
        sum >= share * total
    });
    at.unwrap_or(0) as f64
}

impl Shape for Stitch {
    fn subtract(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]) {
        let Some(dark) = maps::reference_dark(design) else { return };
        let black = stacks[dark].level();
        let middle = (self.levels_e[0] + self.levels_e[1]) / 2.0;
        for (c, t) in design.conditions.iter().zip(stacks) {
            let k = gain(camera, c);
            if (t.level() - black) / k < middle {
                continue;
            }
            let r = self.ratio.value;
            change_mean(camera, t, &|_, _, v| black + (v - black) / r);
            let old = mean(&t.pixel_variance);
            let new = (old - (k * self.more_e.value).powi(2)).max(0.0) / (r * r);
            let ratio = new / old.max(1e-12);
            let factors = [ratio, libm::pow(ratio, 1.5), ratio * ratio].map(|f| f as f32);
            scale_noise(t, |_, _| factors);
            t.row_power.iter_mut().chain(&mut t.column_power).for_each(|p| *p *= ratio);
            t.row_lag *= ratio;
            t.block_variance *= ratio;
            t.covariance.iter_mut().for_each(|c| *c *= ratio);
        }
    }

    fn shows_in(&self, _: &Design, (place, _): &Key) -> bool {
        // The map of curvature has the noise above the step, and a stack on both sides of it cannot
        // be corrected by a factor.
        *place == Place::Map(MapKind::Curvature)
            || self.astride.as_ref().is_some_and(|(stack, _)| *place == Place::Stack(*stack))
    }

    fn stages(&self, camera: &mut Camera, _: &Design) -> Vec<Empirical> {
        // Beyond the converter's range there are no samples.
        let step = self.at_e;
        let top = 2.0 * camera.sensor.full_well_e.max(step);
        let (more, noise) = (self.ratio.value - 1.0, self.more_e.value);
        let response = Table::SignalCurve(Response {
            signal_e: vec![step, step, top],
            change_e: vec![0.0, more * step, more * top],
            noise_e: vec![0.0, noise, noise],
        });
        vec![Empirical::new(Quantity::Response, response, 1.0)]
    }

    fn seen(&self, view: &View<'_>) -> Option<Seen> {
        seen::noise_over_signal(view)
    }

    fn findings(&self) -> Vec<Finding> {
        let [low, high] = self.open_e;
        let [low_dn, high_dn] = self.open_dn;
        let [first, second] = &self.ids;
        let ratio = match self.ratio.std_error.is_finite() {
            true => format!(" and the gain is {} times that below", number(self.ratio)),
            false => " with the same gain".into(),
        };
        let place = match &self.astride {
            None => "a flat between the two would determine the position".into(),
            Some((_, id)) => format!("{id} has samples on both sides of it"),
        };
        let mut parameters = vec![
            ("above_e", Value::chosen(low)),
            ("below_e", Value::chosen(high)),
            ("read_noise_more_e", self.more_e),
        ];
        if self.ratio.std_error.is_finite() {
            parameters.push(("gain_ratio", self.ratio));
        }
        vec![Finding {
            parameters,
            description: format!(
                "a step of the response (two gains in one sample) between {low:.0} and {high:.0} \
                 e⁻ ({low_dn:.0} and {high_dn:.0} DN), where neither {first} nor {second} has \
                 samples: above it noise is higher by {} e⁻{ratio}; {place}",
                number(self.more_e),
            ),
            ..Finding::new(Domain::Response, Form::SignalStep, self.evidence)
        }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::bench::{Hidden, Shot, figure, shoot};

    #[test]
    fn a_second_amplifier_is_told_from_a_bent_response() {
        let of = |volts: &dyn Fn(&mut [f64], &mut Shot<'_>)| {
            let bench = shoot(81, &Hidden { volts: Some(volts), ..Hidden::default() });
            let found = find(&bench.view(0), &bench.view(1));
            found.iter().flat_map(|s| s.findings()).collect::<Vec<Finding>>()
        };
        let stitch = |e: &mut [f64], shot: &mut Shot<'_>| {
            for v in e.iter_mut().filter(|v| **v > 5000.0) {
                *v = *v * 1.006 + 30.0 * shot.normal();
            }
        };
        let bent = |e: &mut [f64], _: &mut Shot<'_>| {
            e.iter_mut().for_each(|v| *v *= 1.0 - 0.03 * (v.max(0.0) / 10_000.0).powi(2));
        };
        let findings = of(&stitch);
        let [found] = &findings[..] else { panic!("{findings:?}") };
        assert!((3900.0..5000.0).contains(&figure(found, "above_e")), "{found:?}");
        assert!((5000.0..6600.0).contains(&figure(found, "below_e")), "{found:?}");
        assert!((figure(found, "read_noise_more_e") - 30.0).abs() < 2.0, "{found:?}");
        assert!((figure(found, "gain_ratio") - 1.006).abs() < 1e-3, "{found:?}");
        assert!(of(&bent).is_empty() && of(&|_, _| ()).is_empty());
    }
}
