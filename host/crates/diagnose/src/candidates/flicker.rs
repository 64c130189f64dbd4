//! `flicker-banding`: light that pulsates, under a rolling shutter.
//!
//! Row means of a flat have a wave of f t_row cycles per row, in proportion to the signal and with
//! another phase in every frame. Its frequency is that of the highest power of the row means, all
//! flats together; its amplitude in every frame comes from least squares beside what the rows of
//! the colour filter pattern have in common and what all frames share. An exposure t averages the
//! wave, so that the square of the relative amplitude is
//!
//!   a² = A² sinc²(f t),
//!
//! and exposures of different length give depth A (without unit) and frequency f (Hz).

use super::common::present;
use super::proposal::{Proposal, deviation};
use crate::evidence::{Evidence, slope};
use crate::model::effects::current;
use crate::numerics::tails::median_of_squares;
use crate::statistics::lines::phase_means;
use crate::statistics::maps;
use crate::statistics::temporal::Temporal;
use camrig_base::Value;
use camrig_base::median::median;
use camrig_fourier::sinc;
use camrig_linear::dot;
use camrig_sensor_core::effects::Effect;

/// Bins to either side of a line that a wave between two bins leaks into: beyond three the leakage
/// (sin πd/πd)² is below 1 % of the line.
const LEAK: usize = 3;
/// Bins to either side of those from which the power without the wave is taken: 24 in all give
/// their median to some 20 % with one degree of freedom each, less with more frames.
const AROUND: usize = 12;
/// Least frequency of a wave, in cycles per frame height: about half a wave, below which it cannot
/// be told from a slope. The search starts no lower than the first value, and its steps end at the
/// second.
const MIN_CYCLES: [f64; 2] = [0.5, 0.45];
/// First step of the search for the frequency between bins, in bins; each round is ten times
/// finer.
const FIRST_STEP_BINS: f64 = 0.1;
/// Rounds of that search: to 1e-3 bins.
const ROUNDS: usize = 3;
/// Steps to either side in a round: one and a half of the steps of the round before.
const STEPS: i32 = 15;
/// Frequencies of lamps on the mains: twice 50 and 60 Hz.
const MAINS_HZ: [f64; 2] = [100.0, 120.0];
/// Lowest frequency of light that is tried, Hz: below it eyes see the flicker.
const LOWEST_HZ: f64 = 30.0;
/// Ratio of the frequencies that are tried, up to 3 kHz, and their number.
const COARSE_RATIO: f64 = 1.01;
const COARSE: i32 = 463;
/// Relative step of the finer search about the best of these, over a step of them to either side.
const FINE_STEP: f64 = 5e-4;
const FINE: i32 = 20;
/// Rise of χ², in units of its scatter, up to which a lamp on the mains is preferred to the best
/// frequency: two standard deviations.
const MAINS_PREFERRED: f64 = 4.0;
/// Least sinc² by which a square is divided: an exposure of whole periods shows no wave.
const MIN_SINC_SQUARED: f64 = 1e-9;
/// Turns in which the depth and the scatter that follows from it settle.
const TURNS: usize = 4;

/// Frequency, cycles per sample, of the highest bin of the power of lines of `n` samples; between
/// bins by the amplitudes of its neighbours above the median power.
fn line_peak(power: &[f64], n: f64) -> f64 {
    let at = (0..power.len()).max_by(|&a, &b| power[a].total_cmp(&power[b])).unwrap_or(0);
    let white = median(&mut power.to_vec(), f64::total_cmp);
    let get = |i: usize| power.get(i).map_or(0.0, |p| (p - white).max(0.0).sqrt());
    let (l, m, r) = (get(at.max(1) - 1), get(at), get(at + 1));
    let shift = if r > l { r / (m + r) } else { -l / (m + l) };
    (at as f64 + 1.0 + shift) / n
}

/// A wave of any phase down the rows, and a constant for each row of the colour filter pattern.
struct Wave {
    /// Sine of each row, less the constants.
    sine: Vec<f64>,
    /// Cosine of each row, less the constants.
    cosine: Vec<f64>,
    /// Sums of their products over rows: of sine and sine, cosine and cosine, sine and cosine.
    products: [f64; 3],
}

impl Wave {
    /// The wave of so many cycles per row, in addition to what repeats every `period` rows.
    fn new(cycles: f64, rows: usize, period: usize) -> Self {
        let of = |f: fn(f64) -> f64| {
            let at = |y: usize| f(std::f64::consts::TAU * cycles * y as f64);
            let all: Vec<f64> = (0..rows).map(at).collect();
            let means = phase_means(&all, period);
            all.iter().enumerate().map(|(y, v)| v - means[y % period]).collect::<Vec<f64>>()
        };
        let (sine, cosine) = (of(libm::sin), of(libm::cos));
        let products = [dot(&sine, &sine), dot(&cosine, &cosine), dot(&sine, &cosine)];
        Self { sine, cosine, products }
    }

    /// Amplitude of sine and cosine in the row means of each frame, DN, by least squares.
    fn in_frames(&self, t: &Temporal) -> Vec<[f64; 2]> {
        let [ss, cc, sc] = self.products;
        let determinant = ss * cc - sc * sc;
        let of_frame = |rows: &[f32]| {
            let (mut s, mut c) = (0.0, 0.0);
            for ((x, sine), cosine) in rows.iter().zip(&self.sine).zip(&self.cosine) {
                s += f64::from(*x) * sine;
                c += f64::from(*x) * cosine;
            }
            [(cc * s - sc * c) / determinant, (ss * c - sc * s) / determinant]
        };
        t.row_means.chunks(t.height).map(of_frame).collect()
    }

    /// Power of what changes of it from frame to frame, DN²: 2 v (n − 1) of white row means of
    /// variance v in n frames.
    fn changing(&self, t: &Temporal) -> f64 {
        let amplitudes = self.in_frames(t);
        let [x0, y0] = middle(&amplitudes);
        let [ss, cc, sc] = self.products;
        let of = |a: &[f64; 2]| {
            let (x, y) = (a[0] - x0, a[1] - y0);
            ss * x * x + cc * y * y + 2.0 * sc * x * y
        };
        amplitudes.iter().map(of).sum()
    }

    /// Mean square of an amplitude by white row means of variance 1.
    fn noise(&self) -> f64 {
        let [ss, cc, sc] = self.products;
        (ss + cc) / (ss * cc - sc * sc)
    }
}

/// A flat stack in which bands are looked for.
struct Flat<'a> {
    stack: &'a Temporal,
    exposure_s: f64,
    /// Mean above dark, DN.
    signal: f64,
    /// Power of a bin of the row means without the wave, DN².
    white: f64,
}

impl Flat<'_> {
    /// Weight of a power in this stack for a relative amplitude: frames times (signal/noise)².
    fn weight(&self) -> f64 {
        self.stack.dof * (self.signal / self.white).powi(2)
    }
}

/// The wave in a flat stack.
struct Band {
    exposure_s: f64,
    /// Square of its amplitude relative to the signal.
    square: f64,
    /// Mean square of what noise adds to the amplitude.
    noise: f64,
    frames: f64,
}

impl Band {
    /// Variance of `square` where its mean is `square`: of the mean of |a + ε|² over n frames, ε
    /// of mean square s, (2 a² s + s²)/n.
    fn variance(&self, square: f64) -> f64 {
        (2.0 * square + self.noise) * self.noise / self.frames
    }
}

/// The wave of the row means that grows with the signal: cycles per row, and what each flat shows
/// of it.
fn bands(e: &Evidence<'_>) -> Option<(f64, Vec<Band>)> {
    let (_, h) = e.size();
    let period = usize::from(e.camera.sensor.pattern().height);
    let mut flats = flats(e);
    let mut pooled = vec![0.0; flats.first()?.stack.row_power.len()];
    for f in &flats {
        let weight = f.weight();
        pooled.iter_mut().zip(&f.stack.row_power).for_each(|(sum, p)| *sum += weight * p);
    }
    let peak = line_peak(&pooled, h);
    let at = ((peak * h).round() as usize).clamp(1, pooled.len()) - 1;
    for f in &mut flats {
        f.white = white_beside(f.stack, at)?;
    }
    flats.retain(|f| f.white > 0.0);
    let cycles = between_bins(&flats, peak, h, period)?;
    let wave = Wave::new(cycles, h as usize, period);
    Some((cycles, amplitudes(e, &flats, &wave)))
}

/// The flats, with the mean power of all bins of their row means.
fn flats<'a>(e: &Evidence<'a>) -> Vec<Flat<'a>> {
    let stacks = e.stacks;
    let of = |(i, exposure_s): (usize, f64)| {
        let stack = &stacks[i];
        let white = stack.row_power.iter().sum::<f64>() / stack.row_power.len() as f64;
        let signal = e.signal(i)?;
        (signal > 0.0 && white > 0.0).then_some(Flat { stack, exposure_s, signal, white })
    };
    e.flats().map(|(i, c)| (i, c.stack.exposure_s)).filter_map(of).collect()
}

/// Power without the wave that lies in the bin `at`, DN²: from the median of the bins around.
/// `None` where there are none.
fn white_beside(stack: &Temporal, at: usize) -> Option<f64> {
    let power = &stack.row_power;
    let (from, to) = (at.saturating_sub(LEAK), (at + LEAK + 1).min(power.len()));
    let mut around: Vec<f64> = power[from.saturating_sub(AROUND)..from].to_vec();
    around.extend(&power[to..(to + AROUND).min(power.len())]);
    if around.is_empty() {
        return None;
    }
    Some(median(&mut around, f64::total_cmp) / median_of_squares(2.0 * stack.dof))
}

/// Cycles per row near a peak of the power with which most changes from frame to frame, in `h`
/// rows.
fn between_bins(flats: &[Flat<'_>], peak: f64, h: f64, period: usize) -> Option<f64> {
    let (mut cycles, mut step) = (peak.max(MIN_CYCLES[0] / h), FIRST_STEP_BINS / h);
    for _ in 0..ROUNDS {
        let near = (-STEPS..=STEPS).map(|i| cycles + f64::from(i) * step);
        let power = |cycles: f64| {
            let wave = Wave::new(cycles, h as usize, period);
            flats.iter().map(|f| f.weight() * wave.changing(f.stack)).sum::<f64>()
        };
        let tried = near.filter(|f| *f > MIN_CYCLES[1] / h && *f < 0.5).map(|f| (f, power(f)));
        cycles = tried.max_by(|a, b| a.1.total_cmp(&b.1))?.0;
        step /= 10.0;
    }
    Some(cycles)
}

/// What each flat shows of a wave, less what all frames share: the pattern of the rows.
fn amplitudes(e: &Evidence<'_>, flats: &[Flat<'_>], wave: &Wave) -> Vec<Band> {
    let dark = match maps::reference_dark(e.design) {
        Some(i) => middle(&wave.in_frames(&e.stacks[i])),
        None => [0.0; 2],
    };
    let seen: Vec<Vec<[f64; 2]>> = flats
        .iter()
        .map(|f| {
            let of = |a: [f64; 2]| [(a[0] - dark[0]) / f.signal, (a[1] - dark[1]) / f.signal];
            wave.in_frames(f.stack).into_iter().map(of).collect()
        })
        .collect();
    let noise = |f: &Flat<'_>| f.white * wave.noise() / (f.signal * f.signal);
    let weights = flats
        .iter()
        .zip(&seen)
        .map(|(f, seen)| 1.0 / (noise(f) * (noise(f) + scatter(seen) / seen.len() as f64)));
    let fixed = centre(seen.iter().zip(weights));
    let of_flat = |(f, seen): (&Flat<'_>, &Vec<[f64; 2]>)| {
        let n = seen.len() as f64;
        let square = |a: &[f64; 2]| (a[0] - fixed[0]).powi(2) + (a[1] - fixed[1]).powi(2);
        let value = seen.iter().map(square).sum::<f64>() / n - noise(f);
        Band { exposure_s: f.exposure_s, square: value, noise: noise(f), frames: n }
    };
    flats.iter().zip(&seen).map(of_flat).collect()
}

/// Mean of amplitudes.
fn middle(amplitudes: &[[f64; 2]]) -> [f64; 2] {
    let n = amplitudes.len() as f64;
    [0, 1].map(|i| amplitudes.iter().map(|a| a[i]).sum::<f64>() / n)
}

/// Sum of their squares about the mean.
fn scatter(amplitudes: &[[f64; 2]]) -> f64 {
    let m = middle(amplitudes);
    amplitudes.iter().map(|a| (a[0] - m[0]).powi(2) + (a[1] - m[1]).powi(2)).sum()
}

/// What all frames have in addition to a wave of random phase: the centre z of the circles, one for
/// each stack, on which the amplitudes lie, |a|² = 2 a·z + const. by least squares (Kåsa 1976).
/// Each stack has a weight.
fn centre<'a>(stacks: impl Iterator<Item = (&'a Vec<[f64; 2]>, f64)>) -> [f64; 2] {
    let (mut xx, mut xy, mut yy, mut xr, mut yr) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (amplitudes, weight) in stacks {
        let m = middle(amplitudes);
        let square = |a: &[f64; 2]| a[0] * a[0] + a[1] * a[1];
        let mean = amplitudes.iter().map(square).sum::<f64>() / amplitudes.len() as f64;
        for a in amplitudes {
            let (x, y, r) = (a[0] - m[0], a[1] - m[1], (square(a) - mean) / 2.0);
            xx += weight * x * x;
            xy += weight * x * y;
            yy += weight * y * y;
            xr += weight * x * r;
            yr += weight * y * r;
        }
    }
    let determinant = xx * yy - xy * xy;
    if determinant <= 0.0 {
        return [0.0; 2];
    }
    [(yy * xr - xy * yr) / determinant, (xx * yr - xy * xr) / determinant]
}

/// The square of the depth A of light that pulsates with f, Hz, and χ² of what A² sinc² leaves.
/// The scatter of squares is that of their fitted values, since that of the measured ones would
/// favour the small.
fn depth_squared(bands: &[Band], f: f64) -> Option<(Value, f64)> {
    let seen = |b: &Band| sinc(f * b.exposure_s).powi(2).max(MIN_SINC_SQUARED);
    let mut found = Value { value: 0.0, std_error: f64::INFINITY };
    for _ in 0..TURNS {
        let fitted = found.value.max(0.0);
        found = slope(bands.iter().map(|b| {
            (seen(b), Value { value: b.square, std_error: b.variance(fitted * seen(b)).sqrt() })
        }))?;
    }
    let left = bands.iter().map(|b| {
        let fitted = found.value.max(0.0) * seen(b);
        (b.square - fitted).powi(2) / b.variance(fitted)
    });
    Some((found, left.sum()))
}

/// The frequency, Hz, of light whose bands exposures of different length average: that of a lamp
/// on the mains, if it serves as well as the best.
fn light_frequency(bands: &[Band]) -> Option<f64> {
    let best = |tried: &mut dyn Iterator<Item = f64>| {
        tried
            .filter_map(|f| Some((f, depth_squared(bands, f)?.1)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let coarse =
        best(&mut (0..COARSE).map(|i| LOWEST_HZ * libm::pow(COARSE_RATIO, f64::from(i))))?.0;
    let fine = (-FINE..=FINE).map(|i| coarse * (1.0 + FINE_STEP * f64::from(i)));
    let free = best(&mut { fine })?;
    let mains = best(&mut MAINS_HZ.into_iter())?;
    // Squares that scatter more than their noise are worth less.
    let unit = (free.1 / (bands.len() as f64 - 2.0).max(1.0)).max(1.0);
    Some(if mains.1 < free.1 + MAINS_PREFERRED * unit { mains.0 } else { free.0 })
}

/// `flicker-banding`: depth, frequency of the light and time from row to row.
pub fn flicker_banding(e: &Evidence<'_>) -> Option<Proposal> {
    let (cycles_per_row, bands) = bands(e)?;
    let (cycles_per_row, frequency) = match current(e.camera, "flicker-banding") {
        Some(Effect::FlickerBanding(x)) => {
            let cycles_per_row = f64::from(x.frequency_hz) * f64::from(x.row_time_us) * 1e-6;
            (cycles_per_row, f64::from(x.frequency_hz))
        }
        _ => (cycles_per_row, light_frequency(&bands)?),
    };
    let present = present(e.camera, "flicker-banding", "depth").unwrap_or(0.0);
    let (square, _) = depth_squared(&bands, frequency)?;
    let depth = deviation(0.0, square)?;
    let row_time_us = cycles_per_row / frequency * 1e6;
    let strength = (square.value - present * present).abs() / square.std_error;
    let light = [
        ("depth", depth),
        ("frequency_hz", Value::chosen(frequency)),
        ("row_time_us", Value::chosen(row_time_us)),
    ];
    Proposal::of("flicker-banding", strength, light)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wave_between_bins_has_its_amplitude_beside_any_constant() {
        let (rows, cycles) = (200, 1.37 / 200.0);
        let mut t = crate::statistics::temporal::Collector::new(4, rows, 255, false).finish();
        let phases = [0.2f64, 1.9, 4.4];
        t.row_means = phases
            .iter()
            .flat_map(|phase| {
                let at = move |y| std::f64::consts::TAU * cycles * f64::from(y) + phase;
                // Rows of two levels, as under a colour filter array.
                (0..rows as i32).map(move |y| (7.0 + f64::from(y % 2) + 0.25 * at(y).sin()) as f32)
            })
            .collect();
        let wave = Wave::new(cycles, rows, 2);
        for (phase, [s, c]) in phases.iter().zip(wave.in_frames(&t)) {
            // Rounding of 8.25 to 32 bits, 4.8e-7, over 200 rows.
            assert!(
                (s - 0.25 * phase.cos()).abs() < 1e-6 && (c - 0.25 * phase.sin()).abs() < 1e-6
            );
        }
    }

    #[test]
    fn the_centre_of_circles_is_found() {
        let circle = |radius: f64, angles: [f64; 3]| {
            angles.map(|a| [0.3 + radius * a.cos(), -0.1 + radius * a.sin()]).to_vec()
        };
        let circles = [circle(0.02, [0.1, 0.9, 3.0]), circle(0.5, [2.0, 2.2, 5.0])];
        let [x, y] = centre(circles.iter().zip([1.0, 3.0]));
        assert!((x - 0.3).abs() < 1e-12 && (y + 0.1).abs() < 1e-12, "{x} {y}");
    }

    #[test]
    fn the_frequency_of_the_lamp_is_told_by_exposures() {
        let bands = |f: f64| -> Vec<Band> {
            [0.2e-3, 1e-3, 5e-3, 12e-3]
                .iter()
                .map(|&exposure_s| Band {
                    exposure_s,
                    square: 1e-4 * sinc(f * exposure_s).powi(2),
                    noise: 1e-9,
                    frames: 4.0,
                })
                .collect()
        };
        assert_eq!(light_frequency(&bands(100.0)), Some(100.0));
        assert_eq!(light_frequency(&bands(120.0)), Some(120.0));
        // No lamp of the mains: within the finer steps.
        let found = light_frequency(&bands(250.0)).unwrap();
        assert!((found / 250.0 - 1.0).abs() < 5e-4, "{found}");
        let (depth, left) = depth_squared(&bands(100.0), 100.0).unwrap();
        assert!((depth.value / 1e-4 - 1.0).abs() < 1e-9 && left < 1e-9);
    }
}
