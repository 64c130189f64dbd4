//! Noise that is serially correlated from pixel to pixel along rows (an amplifier too slow for the
//! pixel rate) or down columns (a column amplifier with memory), equal in the dark and in light.
//!
//! The power of the residuals over frequency, averaged over the other axis, is W + A S(r), with S
//! the expected periodogram of r^|Δ| over a line of n pixels, Σ (1 − |Δ|/n) r^|Δ| cos(2πkΔ/n),
//! exact at all frequencies but 0, which the residuals do not have. W of each stack, r and A are
//! fitted by Whittle's likelihood (1953).

use super::seen::Seen;
use super::view::{IN_THE_DARK, View, gain, scale_noise};
use super::{FALSE_ALARMS, Shape, shapes};
use crate::data::design::Design;
use crate::finding::{Finding, number};
use crate::numerics::minimise::minimum;
use crate::report::{Domain, Form};
use crate::statistics::maps;
use crate::statistics::statistic::{Key, Place, What};
use crate::statistics::temporal::{Temporal, mean};
use camrig_base::Value;
use camrig_base::median::median;
use camrig_camera::Camera;
use camrig_camera::empirical::{Along, Empirical, Noise, Table};
use camrig_captures::Role;
use camrig_sensor_core::effects::empirical::Quantity;
use std::f64::consts::{SQRT_2, TAU};

/// Range of correlations: from alternating noise to noise that hardly changes over a frame.
const MIN_CORRELATION: f64 = -0.5;
const MAX_CORRELATION: f64 = 0.975;
/// Number of correlations tried, in equal steps.
const CORRELATIONS: usize = 119;
/// Correlations smaller than this are left out: they cannot be distinguished from white noise.
const NEGLIGIBLE: f64 = 0.03;
/// Standard deviations of white noise at which a bin is clipped: lines are not part of the
/// continuum.
const CLIP: f64 = 6.0;
/// Standard errors by which the amount in flats may exceed that in the dark.
const MAX_GROWTH_Z: f64 = 5.0;
/// Factor by which the amount in flats may exceed that in the dark.
const MAX_GROWTH: f64 = 1.5;
/// Correlation from which a length is reported instead, over 1.4 pixels.
const MIN_LENGTH_CORRELATION: f64 = 0.5;
/// Lags that are plotted.
const SHOWN_LAGS: usize = 24;
/// Fraction of the evidence that the held-out frames must have.
const MIN_CONFIRMED: f64 = 0.25;
/// Fewest frequencies of a line.
const MIN_BINS: usize = 8;
/// Iterations of the golden-section search: 5·10⁻⁴ of the range.
const ITERATIONS: usize = 16;
/// Passes in which the weights of a fit converge.
const PASSES: usize = 4;
/// Standard errors of the free fit within which the fit with known white noise is searched for.
const SEARCH_Z: f64 = 8.0;
/// Standard errors from which the held-out frames confirm it.
const CONFIRMED_Z: f64 = 4.0;

/// Serially correlated noise.
pub(crate) struct Serial {
    /// Whether along rows; down columns otherwise.
    along_rows: bool,
    correlation: Value,
    amount_e: Value,
    /// Pixels of a line.
    length: usize,
    /// Whether it is additional noise, rather than the correlation of the model's read noise.
    additional: bool,
    evidence: [f64; 2],
}

/// Power of a stack over the frequency along one axis, e², and how many bins each is the mean of.
struct Spectrum {
    power: Vec<f64>,
    bins: f64,
    length: usize,
    flat: bool,
    /// Variance of dark charge and rounding, e².
    white: f64,
}

/// Serial correlations that both halves show.
pub(crate) fn find(fit: &View<'_>, held_out: &View<'_>) -> Vec<Box<dyn Shape>> {
    shapes([true, false].into_iter().filter_map(|rows| of(rows, fit, held_out)))
}

fn spectra(view: &View<'_>, along_rows: bool) -> Vec<Spectrum> {
    let of = |(i, t): (usize, &Temporal)| {
        let power = t.power.as_ref()?;
        let (w, h) = (t.width, t.height);
        let unit = view.gain(i).powi(2);
        let columns = w / 2 + 1;
        let at = |x: usize, y: usize| f64::from(power[y * columns + x]) / unit;
        let inner = 1..w.div_ceil(2);
        let (length, power, bins): (usize, Vec<f64>, usize) = if along_rows {
            let of = |x: usize| clipped_mean((1..h).map(|y| at(x, y)).collect(), t.dof);
            (w, inner.map(of).collect(), h - 1)
        } else {
            // Both signs of a frequency.
            let both = |x, y| [at(x, y), at(x, h - y)];
            let of =
                |y: usize| clipped_mean(inner.clone().flat_map(|x| both(x, y)).collect(), t.dof);
            (h, (1..h.div_ceil(2)).map(of).collect(), 2 * inner.len())
        };
        let c = &view.design.conditions[i].stack;
        let flat = c.role == Role::Flat;
        let dark = view.camera.sensor.noise.dark_current_e_per_s * c.exposure_s;
        let white = dark + 1.0 / (12.0 * unit);
        Some(Spectrum { power, bins: bins as f64 * t.dof, length, flat, white })
    };
    view.stacks.iter().enumerate().filter_map(of).collect()
}

/// Mean of powers over `dof` frames, with bins that exceed their median clipped: lines are not part
/// of the continuum.
fn clipped_mean(mut powers: Vec<f64>, dof: f64) -> f64 {
    let middle = median(&mut powers, f64::total_cmp);
    let limit = middle * (1.0 + CLIP / dof.max(1.0).sqrt());
    powers.iter().map(|p| p.min(limit)).sum::<f64>() / powers.len().max(1) as f64
}

/// The expected periodogram of r^|Δ| at frequencies 1 to `bins`.
fn periodogram(r: f64, length: usize, bins: usize) -> Vec<f64> {
    let n = length as f64;
    let of = |k: usize| {
        let mut sum = 1.0;
        let mut power = 1.0;
        for d in 1..length {
            power *= r;
            if f64::abs(power) < 1e-9 {
                break;
            }
            let d = d as f64;
            sum += 2.0 * (1.0 - d / n) * power * libm::cos(TAU * k as f64 * d / n);
        }
        sum
    };
    (1..=bins).map(of).collect()
}

/// Variance of the mean of a line of noise r^|Δ| over that of a pixel.
fn of_mean(r: f64, length: usize) -> f64 {
    let n = length as f64;
    let pairs = (1..length).map(|d| 2.0 * (1.0 - d as f64 / n) * libm::pow(r, d as f64));
    (1.0 + pairs.sum::<f64>()) / n
}

/// A of a spectrum for a given S, and twice the gain in log-likelihood over W alone.
struct Fit {
    amount: Value,
    gain: f64,
}

fn fit(s: &Spectrum, shape: &[f64]) -> Fit {
    let n = s.power.len() as f64;
    let flat = s.power.iter().sum::<f64>() / n;
    let (mut white, mut amount, mut se) = (flat, 0.0, f64::NAN);
    // Weights of the fitted spectrum, which converge in four passes.
    for _ in 0..PASSES {
        let [mut one, mut x, mut xx, mut y, mut xy] = [0.0; 5];
        for (p, s1) in s.power.iter().zip(shape) {
            let expected = (white + amount * s1).max(0.02 * flat);
            let weight = s.bins / (expected * expected);
            one += weight;
            x += weight * s1;
            xx += weight * s1 * s1;
            y += weight * p;
            xy += weight * s1 * p;
        }
        let determinant = one * xx - x * x;
        amount = ((one * xy - x * y) / determinant).max(0.0);
        se = (one / determinant).sqrt();
        white = (y - amount * x) / one;
    }
    let twice = |expected: f64, p: f64| 2.0 * s.bins * (libm::log(expected) + p / expected);
    let gain = s
        .power
        .iter()
        .zip(shape)
        .map(|(&p, s1)| twice(flat, p) - twice((white + amount * s1).max(0.02 * flat), p));
    Fit { amount: Value::new(amount, se), gain: gain.sum() }
}

/// The most likely correlation of the darks; none where it is not significant or the held-out
/// frames do not confirm it.
fn likeliest(a: &[Spectrum], b: &[Spectrum]) -> Option<(Value, [f64; 2])> {
    let (bins, length) = (a.first()?.power.len(), a.first()?.length);
    let (from, to) = (MIN_CORRELATION, MAX_CORRELATION);
    let step = (to - from) / (CORRELATIONS - 1) as f64;
    let all = (0..CORRELATIONS).map(|i| from + step * i as f64);
    let tried: Vec<f64> = all.filter(|r| r.abs() > NEGLIGIBLE).collect();
    let gain = |spectra: &[Spectrum], r: f64| {
        let shape = periodogram(r, length, bins);
        spectra.iter().filter(|s| !s.flat).map(|s| fit(s, &shape).gain).sum::<f64>()
    };
    let gains: Vec<f64> = tried.iter().map(|&r| gain(a, r)).collect();
    let best = (0..tried.len()).max_by(|&i, &j| gains[i].total_cmp(&gains[j]))?;
    // χ² with two degrees of freedom on two axes, and ln n for each of the two (Schwarz 1978).
    let samples = a.iter().filter(|s| !s.flat).map(|s| s.bins * bins as f64).sum::<f64>();
    let limit = 2.0 * (libm::log(samples) - libm::log(FALSE_ALARMS / 2.0));
    let held = gain(b, tried[best]);
    if gains[best] < limit || held < MIN_CONFIRMED * gains[best] {
        return None;
    }
    let (low, high) = (tried[best] - step, tried[best] + step);
    let r = minimum(low, high, ITERATIONS, |r| -gain(a, r) - gain(b, r));
    let within = tried.iter().zip(&gains).filter(|(_, g)| **g > gains[best] - 1.0);
    let (low, high) = within.fold((r, r), |(l, h), (r, _)| (l.min(*r), h.max(*r)));
    // Of both halves together.
    let se = ((high - low) / 2.0).max(step / 4.0) / SQRT_2;
    Some((Value::new(r, se), [gains[best], held]))
}

/// Correlation and amount if only dark charge and rounding are white, which determines them much
/// better than with white noise of an unknown amount.
fn with_known_white(spectra: &[&Spectrum], near: Value) -> (Value, Value) {
    let length = spectra[0].length;
    let bins = spectra[0].power.len();
    // Twice the negative log-likelihood, and the amount with its standard error.
    let of = |r: f64| {
        let shape = periodogram(r, length, bins);
        let mut amount = Value { value: 0.0, std_error: f64::NAN };
        for _ in 0..PASSES {
            let (mut xx, mut xy) = (0.0, 0.0);
            for s in spectra {
                for (p, x) in s.power.iter().zip(&shape) {
                    let fitted = s.white + amount.value * x;
                    let expected = if amount.value > 0.0 { fitted } else { *p };
                    let weight = s.bins / (expected * expected);
                    xx += weight * x * x;
                    xy += weight * x * (p - s.white);
                }
            }
            amount = Value { value: (xy / xx).max(0.0), std_error: xx.sqrt().recip() };
        }
        let cost = spectra.iter().flat_map(|s| {
            s.power.iter().zip(&shape).map(|(p, x)| {
                let expected = (s.white + amount.value * x).max(1e-9);
                2.0 * s.bins * (libm::log(expected) + p / expected)
            })
        });
        (cost.sum::<f64>(), amount)
    };
    let reach = SEARCH_Z * near.std_error;
    let r = minimum(near.value - reach, near.value + reach, ITERATIONS, |r| of(r).0);
    let (cost, amount) = of(r);
    // From the curvature of the log-likelihood, which increases by (d/se)² over a distance d.
    let d = near.std_error / 2.0;
    let rise = ((of(r - d).0 + of(r + d).0) / 2.0 - cost).max(1e-9);
    (Value { value: r, std_error: d / rise.sqrt() }, amount)
}

fn of(along_rows: bool, fit_view: &View<'_>, held_out: &View<'_>) -> Option<Serial> {
    let (a, b) = (spectra(fit_view, along_rows), spectra(held_out, along_rows));
    let (bins, length) = (a.first()?.power.len(), a.first()?.length);
    if bins < MIN_BINS || !a.iter().any(|s| !s.flat) {
        return None;
    }
    let (correlation, evidence) = likeliest(&a, &b)?;
    let shape = periodogram(correlation.value, length, bins);
    let amount = |spectra: &[Spectrum], flat: bool| {
        Value::combine(spectra.iter().filter(|s| s.flat == flat).map(|s| fit(s, &shape).amount))
    };
    let again = amount(&b, false)?;
    let both = Value::combine([amount(&a, false)?, again])?;
    if again.z() < CONFIRMED_Z {
        return None;
    }
    // Correlation that grows with the light is crosstalk of charge or light, or processing.
    if let Some(light) = Value::combine([amount(&a, true), amount(&b, true)].into_iter().flatten())
    {
        let more = light.value - both.value;
        if more > MAX_GROWTH_Z * libm::hypot(light.std_error, both.std_error)
            && light.value > MAX_GROWTH * both.value
        {
            return None;
        }
    }
    let reference = maps::reference_dark(fit_view.design)?;
    let variance =
        mean(&fit_view.stacks[reference].pixel_variance) / fit_view.gain(reference).powi(2);
    let predicted = fit_view.predicted((Place::Stack(reference), What::Variance(0)));
    let predicted = predicted.map_or(variance, |v| v / fit_view.gain(reference).powi(2));
    let additional = variance - predicted > both.value / 2.0;
    let (correlation, both) = if additional {
        (correlation, both)
    } else {
        let darks: Vec<&Spectrum> = a.iter().chain(&b).filter(|s| !s.flat).collect();
        with_known_white(&darks, correlation)
    };
    Some(Serial { along_rows, length, correlation, amount_e: both.sqrt()?, additional, evidence })
}

impl Shape for Serial {
    fn subtract(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]) {
        if !self.additional {
            return;
        }
        for (c, t) in design.conditions.iter().zip(stacks) {
            // Without the variance of the line's mean.
            let mean_of_line = of_mean(self.correlation.value, self.length);
            let share = 1.0 - mean_of_line;
            let more = share * self.amount_e.value.powi(2) * gain(camera, c).powi(2);
            let all = mean(&t.pixel_variance);
            let ratio = ((all - more) / all.max(1e-12)).max(0.0) as f32;
            let factors = [ratio, libm::powf(ratio, 1.5), ratio * ratio];
            scale_noise(t, |_, _| factors);
        }
    }

    fn shows_in(&self, _: &Design, (place, what): &Key) -> bool {
        let correlated = matches!(
            what,
            What::Covariance(_)
                | What::BlockVariance
                | What::PlanePeak
                | What::NoiseBlocks
                | What::FrameVariance
                | What::RowVariance
                | What::RowLag
                | What::RowSlow
                | What::RowPeak
                | What::ColumnVariance
                | What::ColumnSlow
                | What::ColumnPeak
        );
        match place {
            Place::Stack(_) => correlated,
            // Its residual in the mean of the frames.
            Place::Map(kind) => IN_THE_DARK.contains(kind),
            _ => false,
        }
    }

    fn stages(&self, camera: &mut Camera, _: &Design) -> Vec<Empirical> {
        if !self.additional {
            // It is the read noise itself.
            camera.sensor.noise.read_e = 0.0;
            camera.sensor.noise.read_e_post = 0.0;
        }
        let r = self.correlation.value;
        let along = if self.along_rows { Along::Rows } else { Along::Columns };
        // r^|Δ| by its first coefficients, exact to r⁸, or by its length.
        let (taps, length) = match r > MIN_LENGTH_CORRELATION {
            true => (None, Some(-1.0 / libm::log(r))),
            false => (Some((0..4).map(|k| libm::pow(r, f64::from(k))).collect()), None),
        };
        let noise = Table::Correlation(Noise { along, taps, length });
        vec![Empirical::new(Quantity::Temporal, noise, self.amount_e.value)]
    }

    fn seen(&self, view: &View<'_>) -> Option<Seen> {
        let dark = spectra(view, self.along_rows).into_iter().find(|s| !s.flat)?;
        let n = dark.length as f64;
        let at = |lag: f64| -> f64 {
            let of = |(k, p): (usize, &f64)| p * libm::cos(TAU * (k as f64 + 1.0) * lag / n);
            dark.power.iter().enumerate().map(of).sum()
        };
        let whole = at(0.0);
        let lags = (0..=SHOWN_LAGS.min(dark.length / 2)).map(|lag| lag as f64);
        let x = if self.along_rows { "distance, columns" } else { "distance, rows" };
        let points = lags.map(|lag| [lag, at(lag) / whole]);
        Some(Seen::curve(x, "correlation of the noise in the dark", points))
    }

    fn findings(&self) -> Vec<Finding> {
        let (along, lines) = match self.along_rows {
            true => ("along the row", "columns"),
            false => ("down the column", "rows"),
        };
        let r = self.correlation;
        let mut parameters = vec![("correlation", r), ("sigma_e", self.amount_e)];
        let reach = if r.value > MIN_LENGTH_CORRELATION {
            let length = -1.0 / libm::log(r.value);
            // dL/dr = L²/r.
            let length =
                Value { value: length, std_error: r.std_error * length * length / r.value };
            parameters
                .push((if self.along_rows { "length_columns" } else { "length_rows" }, length));
            format!("with a length of {} {lines} (to 1/e)", number(length))
        } else {
            format!("correlation {} from pixel to pixel", number(r))
        };
        let whose = match self.additional {
            true => format!("{} e⁻ in addition to the read noise", number(self.amount_e)),
            false => format!("the read noise itself, {} e⁻", number(self.amount_e)),
        };
        let what = if self.along_rows { "an amplifier" } else { "a column's amplifier" };
        vec![Finding {
            parameters,
            description: format!(
                "serially correlated noise {along}: {whose}, {reach}, equal in the dark and in \
                 light ({what} with memory of the pixel before)",
            ),
            ..Finding::new(Domain::Temporal, Form::Correlation, self.evidence)
        }]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::bench::{HEIGHT, Hidden, Shot, WIDTH, figure, shoot};

    #[test]
    fn noise_that_follows_itself_is_found_along_its_axis() {
        // Along rows the read noise itself; down columns additional noise.
        let along = |e: &mut [f64], shot: &mut Shot<'_>| {
            for row in e.chunks_mut(WIDTH) {
                let mut z = shot.normal();
                for v in row {
                    *v += 5.0 * z;
                    z = 0.4 * z + 0.84f64.sqrt() * shot.normal();
                }
            }
        };
        let r = (-1.0f64 / 6.0).exp();
        let down = |e: &mut [f64], shot: &mut Shot<'_>| {
            for x in 0..WIDTH {
                let mut z = shot.normal();
                for y in 0..HEIGHT {
                    e[y * WIDTH + x] += 3.0 * z;
                    z = r * z + (1.0 - r * r).sqrt() * shot.normal();
                }
            }
        };
        let of = |hidden: &Hidden<'_>| {
            let bench = shoot(71, hidden);
            let found = find(&bench.view(0), &bench.view(1));
            found.iter().flat_map(|s| s.findings()).collect::<Vec<Finding>>()
        };
        let findings = of(&Hidden { volts: Some(&along), read_e: Some(0.0), ..Hidden::default() });
        let [serial] = &findings[..] else { panic!("{findings:?}") };
        assert!((figure(serial, "correlation") - 0.4).abs() < 0.015, "{serial:?}");
        assert!((figure(serial, "sigma_e") - 5.0).abs() < 0.08, "{serial:?}");
        let findings = of(&Hidden { volts: Some(&down), ..Hidden::default() });
        let [serial] = &findings[..] else { panic!("{findings:?}") };
        assert!((figure(serial, "length_rows") - 6.0).abs() < 1.0, "{serial:?}");
        assert!((figure(serial, "sigma_e") - 3.0).abs() < 0.2, "{serial:?}");
        assert!(of(&Hidden::default()).is_empty());
    }
}
