//! Two gains in one sample: above a signal a second amplifier with more noise and a slightly other
//! gain takes over, chosen pixel by pixel.
//!
//! The variance of the flats beside what the model predicts is a + b x + c [x above the step], the
//! signal over the light 1 + a' + b'/x + d [x above the step]. A smooth law, x^e in place of the
//! step, stands against it. The step is known between the samples of two levels only.

use crate::seen::{self, Seen};
use crate::view::{View, gain};
use crate::{FALSE_ALARMS, Shape, shapes};
use camrig_camera::Camera;
use camrig_camera::empirical::{Empirical, Response, Table};
use camrig_captures::Role;
use camrig_diagnose::data::design::Design;
use camrig_diagnose::evidence::Estimated;
use camrig_diagnose::finding::{Dependence, Domain, Finding, Form, number};
use camrig_diagnose::statistics::maps::{self, MapKind, SATURATED_FLAT, saturated};
use camrig_diagnose::statistics::noise::frame_variance;
use camrig_diagnose::statistics::statistic::{Key, Place, What};
use camrig_diagnose::statistics::temporal::{Temporal, mean};
use camrig_linear::{LeastSquares, Matrix, Vector};
use camrig_sensor_core::effects::empirical::Quantity;

/// Flats without which no step is told from a smooth law.
const LEAST_FLATS: usize = 5;
/// Exponents of the smooth law.
const EXPONENTS: [f64; 8] = [0.5, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0];
/// Relative scatter of the light that is allowed where the flats do not show more: that of a
/// stabilised lamp with a calibrated photodiode (EMVA 1288).
const LIGHT: f64 = 1e-4;
/// Standard errors from which the held-out frames show it, and from which a ratio of gains is told.
const SEEN_AGAIN: f64 = 4.0;
/// Share of a stack's samples left out at each end for the range of its samples.
const ENDS: f64 = 1e-4;

/// A step of the response.
pub(crate) struct Stitch {
    /// Levels of the flats on either side, e⁻.
    levels_e: [f64; 2],
    /// Their ids.
    ids: [String; 2],
    /// Highest sample of the first and lowest of the second, e⁻, and DN.
    open_e: [f64; 2],
    open_dn: [f64; 2],
    /// Noise that is added above it, e⁻.
    more_e: Estimated,
    /// Gain above it over that below; 1 where none is told.
    ratio: Estimated,
    evidence: [f64; 2],
}

/// A flat or dark as measured, e⁻.
struct Level {
    stack: usize,
    /// Signal as predicted.
    signal: f64,
    flat: bool,
    /// Variance beside the prediction, e².
    excess: Estimated,
    /// Predicted variance, e².
    predicted: f64,
    /// Measured over predicted signal, less 1.
    ratio: Estimated,
}

/// The step that both halves show.
pub(crate) fn find(fit: &View<'_>, held_out: &View<'_>) -> Vec<Box<dyn Shape>> {
    shapes(stitch(fit, held_out))
}

/// Stacks by signal; none without flats of known light in one channel.
fn levels(view: &View<'_>) -> Option<Vec<Level>> {
    let dark = maps::reference_dark(view.design)?;
    let black = view.stacks[dark].level();
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
            excess: Estimated {
                value: variance - predicted,
                se: variance * (2.0 / (t.dof * n)).sqrt(),
            },
            predicted,
            ratio: Estimated {
                value: measured / signal.max(1e-9) - 1.0,
                se: (se / signal.max(1e-9)).hypot(LIGHT),
            },
        });
    }
    out.sort_by(|a, b| a.signal.total_cmp(&b.signal));
    (out.iter().filter(|l| l.flat).count() >= LEAST_FLATS).then_some(out)
}

/// Weighted least squares: the last coefficient with its standard error, and χ².
fn least_squares(columns: &[Vec<f64>], y: &[Estimated]) -> Option<(Estimated, f64)> {
    let a = Matrix::from_fn(y.len(), columns.len(), |i, j| columns[j][i] / y[i].se);
    let b = Vector::from_fn(y.len(), |i, _| y[i].value / y[i].se);
    let fit = LeastSquares::of(&a, &b)?;
    let last = columns.len() - 1;
    let se = fit.covariance[(last, last)].sqrt();
    Some((Estimated { value: fit.coefficients[last], se }, fit.chi2))
}

/// Columns of the laws of the variance: constant, in proportion to the signal, and one more.
fn of_variance(levels: &[Level], more: Vec<f64>) -> Option<(Estimated, f64)> {
    let top = levels.last()?.signal;
    let one = vec![1.0; levels.len()];
    let x: Vec<f64> = levels.iter().map(|l| l.signal / top).collect();
    let y: Vec<Estimated> = levels.iter().map(|l| l.excess).collect();
    least_squares(&[one, x, more], &y)
}

/// 1 from a level on.
fn above(levels: &[Level], from: usize) -> Vec<f64> {
    (0..levels.len()).map(|i| f64::from(u8::from(i >= from))).collect()
}

fn stitch(fit: &View<'_>, held_out: &View<'_>) -> Option<Stitch> {
    let (a, b) = (levels(fit)?, levels(held_out)?);
    if a.len() != b.len() {
        return None;
    }
    let top = a.last()?.signal;
    let flats: Vec<usize> = (0..a.len()).filter(|&i| a[i].flat).collect();
    // Levels on both sides: two below, and one above.
    let steps = flats.iter().copied().skip(2);
    let (at, (more, chi)) = steps
        .filter_map(|at| Some((at, of_variance(&a, above(&a, at))?)))
        .min_by(|x, y| x.1.1.total_cmp(&y.1.1))?;
    let smooth = |levels: &[Level]| {
        let of = |e: &f64| {
            let x = levels.iter().map(|l| (l.signal / top).powf(*e)).collect();
            Some(of_variance(levels, x)?.1)
        };
        EXPONENTS.iter().filter_map(of).fold(f64::INFINITY, f64::min)
    };
    let (again, held) = of_variance(&b, above(&b, at))?;
    let evidence = [smooth(&a) - chi, smooth(&b) - held];
    // χ² of one degree of freedom for the best of so many levels, scaled by what the step leaves.
    let left = (chi / (a.len() as f64 - 3.0)).max(1.0);
    let limit = 2.0 * left * (flats.len() as f64 / FALSE_ALARMS).ln();
    if evidence[0] < limit || more.value < 0.0 || again.z() < SEEN_AGAIN || evidence[1] < 0.0 {
        return None;
    }
    // The gain above, beside a free gain and offset.
    let of_gain = |levels: &[Level], from: usize| {
        let own: Vec<&Level> = levels.iter().filter(|l| l.flat).collect();
        let one = vec![1.0; own.len()];
        let offset = own.iter().map(|l| top / l.signal).collect();
        let step = own.iter().map(|l| f64::from(u8::from(l.signal >= levels[from].signal)));
        let y: Vec<Estimated> = own.iter().map(|l| l.ratio).collect();
        let (d, chi) = least_squares(&[one, offset, step.collect()], &y)?;
        let scatter = (chi / (own.len() as f64 - 3.0).max(1.0)).sqrt().max(1.0);
        Some(Estimated { se: d.se * scatter, ..d })
    };
    let (d, d2) = (of_gain(&a, at)?, of_gain(&b, at)?);
    let told = d.z().abs() > SEEN_AGAIN && d2.z() * d.value.signum() > SEEN_AGAIN / 2.0;
    let ratio = match told {
        true => Estimated { value: 1.0 + (d.value + d2.value) / 2.0, se: d.se / 2f64.sqrt() },
        false => Estimated { value: 1.0, se: f64::NAN },
    };
    let more_e = added(&[&a, &b], at, ratio.value)?;
    let (below, over) = (&a[at - 1], &a[at]);
    let id = |l: &Level| fit.design.conditions[l.stack].stack.id.clone();
    let dark = maps::reference_dark(fit.design)?;
    let black = fit.stacks[dark].level();
    let open_dn =
        [quantile(&fit.stacks[below.stack], 1.0 - ENDS), quantile(&fit.stacks[over.stack], ENDS)];
    Some(Stitch {
        levels_e: [below.signal, over.signal],
        ids: [id(below), id(over)],
        open_e: [
            (open_dn[0] - black) / fit.gain(below.stack),
            (open_dn[1] - black) / fit.gain(over.stack),
        ],
        open_dn,
        more_e,
        ratio,
        evidence,
    })
}

/// Noise that is added above the step, where the gain there is `ratio` times that below.
fn added(halves: &[&[Level]], at: usize, ratio: f64) -> Option<Estimated> {
    let mut found = Vec::new();
    for levels in halves {
        let (below, over) = levels.split_at(at);
        // A slope of the variance, of a gain that the model has wrong, is that of the levels below.
        let top = below.last()?.signal.max(1e-9);
        let one = vec![1.0; below.len()];
        let x: Vec<f64> = below.iter().map(|l| l.signal / top).collect();
        let y: Vec<Estimated> = below.iter().map(|l| l.excess).collect();
        let (slope, _) = least_squares(&[one, x], &y)?;
        let slope = if slope.z().abs() > SEEN_AGAIN { slope.value / top } else { 0.0 };
        found.extend(over.iter().map(|l| {
            let own = l.predicted + slope * l.signal;
            let variance = l.excess.value + l.predicted;
            Estimated { value: variance - ratio * ratio * own, se: l.excess.se }
        }));
    }
    let variance = camrig_diagnose::evidence::pooled(found)?;
    let sigma = variance.value.max(0.0).sqrt();
    (sigma > 0.0).then(|| Estimated { value: sigma, se: variance.se / (2.0 * sigma) })
}

/// The code below which a share of a stack's samples lies, DN.
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
    fn take_out(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]) {
        let Some(dark) = maps::reference_dark(design) else { return };
        let black = stacks[dark].level();
        let middle = (self.levels_e[0] + self.levels_e[1]) / 2.0;
        for (c, t) in design.conditions.iter().zip(stacks) {
            let k = gain(camera, c);
            if (t.level() - black) / k < middle {
                continue;
            }
            let r = self.ratio.value;
            crate::view::change_mean(camera, t, &|_, _, v| black + (v - black) / r);
            let old = mean(&t.pixel_variance);
            let new = (old - (k * self.more_e.value).powi(2)).max(0.0) / (r * r);
            let ratio = new / old.max(1e-12);
            let by = |v: &mut [f32], f: f64| v.iter_mut().for_each(|x| *x *= f as f32);
            by(&mut t.pixel_variance, ratio);
            by(&mut t.pixel_lag, ratio);
            by(&mut t.pixel_third, ratio.powf(1.5));
            by(&mut t.pixel_fourth, ratio * ratio);
            t.row_power.iter_mut().chain(&mut t.column_power).for_each(|p| *p *= ratio);
            t.row_lag *= ratio;
            t.block_variance *= ratio;
            t.covariance.iter_mut().for_each(|c| *c *= ratio);
        }
    }

    fn sets_aside(&self, _: &Design, (place, _): &Key) -> bool {
        // The map of how the response bends has the noise above the step.
        *place == Place::Map(MapKind::Curvature)
    }

    fn stages(&self, camera: &mut Camera, _: &Design) -> Vec<Empirical> {
        // Anywhere between the two levels; beyond the converter's scale nothing is seen.
        let step = (self.open_e[0] + self.open_e[1]) / 2.0;
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
        let known = |value| Estimated { value, se: f64::NAN };
        let ratio = match self.ratio.se.is_finite() {
            true => format!(" and the gain is {} times that below", number(self.ratio)),
            false => " with the same gain".into(),
        };
        let mut parameters = vec![
            ("above_e", known(low)),
            ("below_e", known(high)),
            ("read_noise_more_e", self.more_e),
        ];
        if self.ratio.se.is_finite() {
            parameters.push(("gain_ratio", self.ratio));
        }
        vec![Finding {
            domain: Domain::Response,
            form: Form::SignalStep,
            dependence: Dependence { exposure: 0.0, signal: 0.0 },
            parameters,
            evidence: self.evidence,
            shown: None,
            description: format!(
                "a step of the response (two gains in one sample) between {low:.0} and {high:.0} \
                 e⁻ ({low_dn:.0} and {high_dn:.0} DN), where neither {first} nor {second} has \
                 samples: above it there are {} e⁻ of noise more{ratio}; a flat between the two \
                 would tell the place",
                number(self.more_e),
            ),
        }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::{Hidden, Shot, figure, shoot};

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
