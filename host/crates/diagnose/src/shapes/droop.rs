//! Noise common to a row that decays along it, independent between rows and frames: the transient
//! of a reference that settles at the start of each row. The same along columns.
//!
//! With v = e^(−x/L), noise σ z(y, frame) v adds σ²(v − v̄)² to the variance of the pixels of a
//! column and σ²v̄² to that of the row means, and correlates neighbours along the row, unlike noise
//! that merely differs between columns. The catalogue's `row-temporal-noise` has v = 1.

use super::lines::Lines;
use super::seen::Seen;
use super::stage;
use super::view::{IN_THE_DARK, View, gain};
use super::{FALSE_ALARMS, Shape, shapes};
use crate::data::design::Design;
use crate::finding::{Finding, number};
use crate::numerics::spectrum::Spectrum;
use crate::report::{Dependence, Domain};
use crate::statistics::maps;
use crate::statistics::statistic::{Key, Place, What};
use crate::statistics::temporal::{LAGS, Temporal, mean};
use camrig_base::Value;
use camrig_camera::Camera;
use camrig_camera::empirical::Empirical;
use camrig_captures::Role;
use camrig_sensor_core::effects::empirical::Quantity;

/// Shortest decay length, pixels.
const MIN_LENGTH: f64 = 1.5;
/// Longest decay length over the side of the sensor: longer decays look like a slope.
const MAX_LENGTH: f64 = 0.5;
/// Number of decay lengths tried, in a geometric series.
const LENGTHS: usize = 60;
/// Fraction of the expected covariance of neighbours that must be measured.
const MIN_COVARIANCE: f64 = 0.5;
/// Standard errors from which the held-out frames confirm it.
const CONFIRMED_Z: f64 = 4.0;
/// Fraction of the mean power that a bin keeps, whatever is subtracted.
const MIN_POWER: f64 = 0.1;
/// Pixels left out at each end of a line: the border's moments are copies of its neighbours'.
const BORDER: usize = 1;

/// The lines that share the noise, and the end from which they are read.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Side {
    lines: Lines,
    from_end: bool,
}

/// Noise of lines that decays along them.
pub(crate) struct Droop {
    side: Side,
    /// Fall of χ² of the pixels alone.
    pixels: f64,
    /// Whether it is significant and confirmed by the held-out frames.
    is_seen: bool,
    /// Whether it is equal in light and in the dark.
    alike: bool,
    length: Value,
    sigma_e: Value,
    evidence: [f64; 2],
}

/// Mean squares of a stack: variance of the pixels by position along the line, and of line means in
/// excess of white noise, e², each with its relative standard error.
struct Profile {
    pixels: Vec<f64>,
    relative: f64,
    lines: f64,
    white: f64,
    lines_relative: f64,
    /// Covariance of neighbours along the line.
    neighbours: f64,
    flat: bool,
}

/// Decays that both halves show: from the likelier side along rows, and along columns.
pub(crate) fn find(fit: &View<'_>, held_out: &View<'_>) -> Vec<Box<dyn Shape>> {
    let found = [Lines::Rows, Lines::Columns].into_iter().filter_map(|lines| {
        let sides = [false, true].map(|from_end| Side { lines, from_end });
        // What rises equally towards both ends is not a decay: serially correlated noise does, once
        // the mean of its line is subtracted.
        let [first, last] = sides.map(|side| along(side, fit, held_out));
        let (best, other) = match first.as_ref()?.pixels >= last.as_ref()?.pixels {
            true => (first?, last?),
            false => (last?, first?),
        };
        (best.is_seen && best.pixels - other.pixels > limit()).then_some(best)
    });
    shapes(found)
}

fn profiles(view: &View<'_>, lines: Lines) -> Vec<Profile> {
    let of = |(i, t): (usize, &Temporal)| {
        let (w, h) = (t.width, t.height);
        let unit = view.gain(i).powi(2);
        let (n, across) = (lines.across().count(w, h), lines.count(w, h));
        let mut pixels = vec![0.0; n];
        for (at, &v) in t.pixel_variance.iter().enumerate() {
            pixels[lines.across().of(at, w)] += f64::from(v) / across as f64 / unit;
        }
        let (power, lag) = match lines {
            Lines::Rows => (&t.row_power, (1, 0)),
            Lines::Columns => (&t.column_power, (0, 1)),
        };
        let bins = power.len() as f64;
        let neighbours = LAGS.iter().position(|&l| l == lag);
        Profile {
            pixels,
            relative: (2.0 / (t.dof * across as f64)).sqrt(),
            lines: power.iter().sum::<f64>() / bins / unit,
            white: mean(&t.pixel_variance) / n as f64 / unit,
            lines_relative: (1.0 / (t.dof * bins)).sqrt(),
            neighbours: neighbours.map_or(0.0, |l| t.covariance[l] / unit),
            flat: view.design.conditions[i].stack.role == Role::Flat,
        }
    };
    view.stacks.iter().enumerate().map(of).collect()
}

/// The decay along a line.
fn fall(n: usize, length: f64, from_end: bool) -> Vec<f64> {
    let at = |i: usize| if from_end { n - 1 - i } else { i };
    (0..n).map(|i| libm::exp(-(at(i) as f64) / length)).collect()
}

/// Fall of χ² that is due to chance: two degrees of freedom, for both sides along rows and columns.
fn limit() -> f64 {
    -2.0 * libm::log(FALSE_ALARMS / 4.0)
}

/// σ² for a decay length, the fall of χ², and the part of it due to the pixels; white noise is
/// fitted for each stack.
fn fitted<'a>(
    profiles: impl IntoIterator<Item = &'a Profile>,
    length: f64,
    from_end: bool,
) -> (Value, f64, f64) {
    let (mut xx, mut xy, mut pixels, mut lines) = (0.0, 0.0, (0.0, 0.0), (0.0, 0.0));
    for p in profiles {
        let n = p.pixels.len();
        let v = fall(n, length, from_end);
        let middle = v.iter().sum::<f64>() / n as f64;
        let x: Vec<f64> = v.iter().map(|v| (v - middle).powi(2)).collect();
        let inner = BORDER..n - BORDER;
        let mut sorted = p.pixels.clone();
        let typical = camrig_base::median::median(&mut sorted, f64::total_cmp);
        // Errors of the noise that all pixels have: those of single lines would hide it.
        let weight = (typical * p.relative).powi(2).recip();
        let count = inner.len() as f64;
        let mean_of = |v: &[f64]| v[inner.clone()].iter().sum::<f64>() / count;
        let (mx, my) = (mean_of(&x), mean_of(&p.pixels));
        for i in inner.clone() {
            xx += weight * (x[i] - mx).powi(2);
            xy += weight * (x[i] - mx) * (p.pixels[i] - my);
        }
        pixels = (xx - lines.0, xy - lines.1);
        // The line means.
        let weight = (p.white * p.lines_relative).powi(2).recip();
        let (x, y) = (middle * middle, p.lines - p.white);
        lines.0 += weight * x * x;
        lines.1 += weight * x * y;
        xx += weight * x * x;
        xy += weight * x * y;
    }
    let value = (xy / xx).max(0.0);
    let alone = (pixels.1 / pixels.0).max(0.0);
    (Value { value, std_error: xx.sqrt().recip() }, value * value * xx, alone * alone * pixels.0)
}

/// Measured over expected covariance of neighbours.
fn covaries(profiles: &[Profile], length: f64, from_end: bool, variance: f64) -> f64 {
    let share = |p: &Profile| {
        let v = fall(p.pixels.len(), length, from_end);
        let middle = v.iter().sum::<f64>() / v.len() as f64;
        let pairs = v.windows(2).map(|p| (p[0] - middle) * (p[1] - middle));
        let expected = variance * pairs.sum::<f64>() / (v.len() - 1) as f64;
        let weight = p.white.powi(2).recip();
        // White noise minus the mean of its line has a covariance of −v/n.
        (weight * (p.neighbours + p.white), weight * expected)
    };
    let (measured, expected) =
        profiles.iter().map(share).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    measured / expected
}

fn along(side: Side, fit: &View<'_>, held_out: &View<'_>) -> Option<Droop> {
    let (a, b) = (profiles(fit, side.lines), profiles(held_out, side.lines));
    let n = a.first()?.pixels.len();
    let (shortest, longest) = (MIN_LENGTH, MAX_LENGTH * n as f64);
    if n < 8 || longest < shortest {
        return None;
    }
    let ratio = libm::pow(longest / shortest, 1.0 / (LENGTHS - 1) as f64);
    let lengths: Vec<f64> = (0..LENGTHS).map(|i| shortest * libm::pow(ratio, i as f64)).collect();
    let tried: Vec<(f64, (Value, f64, f64))> =
        lengths.iter().map(|&l| (l, fitted(&a, l, side.from_end))).collect();
    let &(length, (first, gain, pixels)) = tried.iter().max_by(|x, y| x.1.1.total_cmp(&y.1.1))?;
    // Line noise that is constant along the line has no part in the pixels, which must show the
    // decay. The longest length is a slope of the noise.
    let (again, held, held_pixels) = fitted(&b, length, side.from_end);
    let parts = [&a, &b].map(|p| covaries(p, length, side.from_end, first.value));
    let is_seen = length < longest * 0.999
        && pixels > limit()
        && held_pixels > CONFIRMED_Z.powi(2)
        && again.z() > CONFIRMED_Z
        && parts.iter().all(|s| *s > MIN_COVARIANCE);
    let [dark, light] = [false, true].map(|flat| {
        let own = a.iter().chain(&b).filter(|p| p.flat == flat);
        fitted(own, length, side.from_end).0
    });
    let apart = (dark.value - light.value).abs();
    let alike = !(apart > CONFIRMED_Z * libm::hypot(dark.std_error, light.std_error)
        && apart > dark.value / 4.0);
    // χ² is relative to white noise, so that the interval of a fall by one is too narrow by the
    // ratio of all noise to white noise at the start of the line.
    let white = a.iter().map(|p| p.white * n as f64).fold(f64::MAX, f64::min);
    let widest = 1.0 + first.value / white;
    let within = tried.iter().filter(|t| t.1.1 > gain - widest.powi(2)).map(|t| t.0);
    let (low, high) = within.fold((f64::MAX, 0.0f64), |r, l| (r.0.min(l), r.1.max(l)));
    let sigma = ((first.value + again.value) / 2.0).sqrt();
    let refined = refine(&[&a, &b], length / ratio, length * ratio, side.from_end);
    let length_se = (high - low) / 2.0 + length * (ratio - 1.0) / 4.0;
    Some(Droop {
        side,
        pixels,
        is_seen,
        alike,
        length: Value { value: refined, std_error: length_se },
        sigma_e: Value { value: sigma, std_error: widest * first.std_error / (2.0 * sigma) },
        evidence: [gain, held],
    })
}

/// The length between two that minimises χ² of both halves.
fn refine(halves: &[&Vec<Profile>], low: f64, high: f64, from_end: bool) -> f64 {
    /// Iterations of the golden-section search: 10⁻⁴ of the range.
    const TURNS: usize = 20;
    crate::numerics::minimise::minimum(low, high, TURNS, |l| {
        -halves.iter().map(|p| fitted(p.iter(), l, from_end).1).sum::<f64>()
    })
}

impl Droop {
    /// Subtracts the power of the decay `v` along the lines from that of a stack, DN² per `unit` of
    /// e².
    fn subtract_from_power(&self, t: &mut Temporal, unit: f64, v: &[f64]) {
        let Some(power) = &mut t.power else { return };
        let own = Spectrum::of(v);
        let (w, h) = (t.width, t.height);
        let columns = w / 2 + 1;
        let floor = MIN_POWER * mean(&t.pixel_variance);
        for (i, p) in power.iter_mut().enumerate().filter(|(_, p)| **p > 0.0) {
            let (x, y) = (i % columns, i / columns);
            let k = self.side.lines.across().at(x, y.min(h - y));
            let more = match k {
                0 => 0.0,
                k => unit * self.sigma_e.value.powi(2) * own.get(k - 1).copied().unwrap_or(0.0),
            };
            *p = (f64::from(*p) - more).max(floor) as f32;
        }
    }
}

impl Shape for Droop {
    fn subtract(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]) {
        for (c, t) in design.conditions.iter().zip(stacks) {
            let unit = gain(camera, c).powi(2);
            let (w, along) = (t.width, self.side.lines.across());
            let n = along.count(w, t.height);
            let v = fall(n, self.length.value, self.side.from_end);
            let middle = v.iter().sum::<f64>() / n as f64;
            let mut own = vec![0.0; n];
            let across = (t.pixel_variance.len() / n) as f64;
            for (at, &v) in t.pixel_variance.iter().enumerate() {
                own[along.of(at, w)] += f64::from(v) / across;
            }
            let factor: Vec<f32> = own
                .iter()
                .zip(&v)
                .map(|(own, v)| {
                    let more = unit * (self.sigma_e.value * (v - middle)).powi(2);
                    ((own - more) / own.max(1e-12)).max(0.0) as f32
                })
                .collect();
            let old = mean(&t.pixel_variance);
            for (at, v) in t.pixel_variance.iter_mut().enumerate() {
                *v *= factor[along.of(at, w)];
            }
            let ratio = (mean(&t.pixel_variance) / old.max(1e-12)) as f32;
            t.pixel_fourth.iter_mut().for_each(|v| *v *= ratio * ratio);
            self.subtract_from_power(t, unit, &v);
        }
    }

    fn shows_in(&self, _: &Design, (place, what): &Key) -> bool {
        let lines = match self.side.lines {
            Lines::Rows => matches!(what, What::RowVariance | What::RowPeak | What::RowSlow),
            Lines::Columns => {
                matches!(what, What::ColumnVariance | What::ColumnPeak | What::ColumnSlow)
            }
        };
        let together = matches!(
            what,
            What::Covariance(_) | What::BlockVariance | What::PlanePeak | What::FrameVariance
        );
        match place {
            Place::Stack(_) => lines || together || what.is_of_single_pixels(),
            // Its residual in the mean of the frames.
            Place::Map(kind) => IN_THE_DARK.contains(kind),
            _ => false,
        }
    }

    fn stages(&self, camera: &mut Camera, _: &Design) -> Vec<Empirical> {
        let along = self.side.lines.across();
        let side = along.count(camera.sensor.width as usize, camera.sensor.height as usize);
        let fall = along.table(stage::fall(side, self.length.value, self.side.from_end));
        vec![Empirical::new(Quantity::Temporal, fall, self.sigma_e.value)]
    }

    fn seen(&self, view: &View<'_>) -> Option<Seen> {
        let dark = maps::reference_dark(view.design)?;
        let pixels = profiles(view, self.side.lines).swap_remove(dark).pixels;
        let sd: Vec<f64> = pixels.into_iter().map(f64::sqrt).collect();
        let x = self.side.lines.across().word();
        Some(Seen::lines(x, "noise in the dark in excess of its line's, e⁻", &sd))
    }

    fn findings(&self) -> Vec<Finding> {
        let (line, along) = (self.side.lines.word(), self.side.lines.across());
        let start = if self.side.from_end { "last" } else { "first" };
        let length = match along {
            Lines::Columns => "length_columns",
            Lines::Rows => "length_rows",
        };
        vec![Finding {
            dependence: Dependence {
                exposure: 0.0,
                signal: if self.alike { 0.0 } else { f64::NAN },
            },
            parameters: vec![("sigma_e", self.sigma_e), (length, self.length)],
            description: format!(
                "noise common to a {line}, independent in every {line} and frame, that decays along it: {} \
                 e⁻ at the {start} pixel, with a length of {} {}s (to 1/e), {} (a reference that \
                 settles at the {start} pixels)",
                number(self.sigma_e),
                number(self.length),
                along.word(),
                if self.alike { "equal in the dark and in light" } else { "different in light" },
            ),
            ..Finding::new(Domain::Temporal, along.profile(), self.evidence)
        }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::Form;
    use crate::shapes::bench::{Hidden, Shot, WIDTH, figure, shoot};

    #[test]
    fn a_kick_that_falls_along_the_row_is_told_from_row_noise() {
        let rows = |e: &mut [f64], shot: &mut Shot<'_>, length: f64| {
            for row in e.chunks_mut(WIDTH) {
                let kick = 6.0 * shot.normal();
                row.iter_mut()
                    .enumerate()
                    .for_each(|(x, v)| *v += kick * (-(x as f64) / length).exp());
            }
        };
        let of = |length: Option<f64>| {
            let volts = |e: &mut [f64], shot: &mut Shot<'_>| {
                length.iter().for_each(|&l| rows(e, shot, l));
            };
            let bench = shoot(51, &Hidden { volts: Some(&volts), ..Hidden::default() });
            let found = find(&bench.view(0), &bench.view(1));
            found.iter().flat_map(|s| s.findings()).collect::<Vec<Finding>>()
        };
        let findings = of(Some(12.0));
        let [droop] = &findings[..] else { panic!("{findings:?}") };
        assert_eq!(droop.form, Form::RowProfile);
        assert!((figure(droop, "sigma_e") - 6.0).abs() < 0.5, "{droop:?}");
        assert!((figure(droop, "length_columns") - 12.0).abs() < 1.5, "{droop:?}");
        // An infinite length is the catalogue's row noise.
        assert!(of(Some(1e9)).is_empty() && of(None).is_empty());
    }
}
