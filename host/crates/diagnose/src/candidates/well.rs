//! `full-well`: charge and temporal noise that the brightest flats lack.
//!
//! A channel of a flat with µ electrons per pixel loses, in a well of capacity Q (e⁻) and knee κ,
//!
//!   L = µ − ⟨kept(q)⟩ and C = µ − Var kept(q),  kept(q) = q − κQ ln(1 + exp((q − Q)/κQ)),
//!
//! of its mean (e⁻) and variance (e⁻²), with q Poisson (here normal) and pixels that differ by
//! PRNU. Q and κ minimise the χ² of both against measured less predicted mean and variance.

use super::common::channel_count;
use super::proposal::Proposal;
use crate::evidence::Evidence;
use crate::model::effects::current;
use crate::numerics::minimise::minimum;
use crate::statistics::maps::{SATURATED_FLAT, saturated};
use crate::statistics::statistic::{Place, What};
use camrig_base::Value;
use camrig_captures::Role;
use camrig_sensor_core::effects::Effect;

/// Knees that are tried, as fractions of full well: a sharp one, and soft ones in steps of a
/// factor of some two. Chosen; the effect allows up to 0.5.
const KNEES: [f64; 4] = [0.0, 0.02, 0.05, 0.1];
/// Flats below this share of the brightest one are left out: a well that reached them would have
/// taken half of the brightest.
const BRIGHT: f64 = 0.5;
/// Largest share of saturated samples of a flat that is used: above it the median itself is.
const MAX_SATURATED: f64 = 0.5;
/// Step of the search for the capacity, in its logarithm: about a standard deviation of the shot
/// noise of 5000 e⁻.
const CAPACITY_STEP: f64 = 0.014;
/// Steps to either side of the charge of the brightest flat: half to twice of it.
const CAPACITY_STEPS: i32 = 50;
/// Steps of the golden section between two of these.
const GOLDEN_STEPS: usize = 40;
/// Change of the capacity, relative, from which the curvature of χ² is taken.
const CURVATURE_STEP: f64 = 1e-3;
/// Knees above the capacity beyond which the exponential is lost in the rounding of the sum.
const FAR_ABOVE: f64 = 30.0;
/// Points to either side of the mean over which normal laws are summed, up to 4 standard
/// deviations: of PRNU, a smooth correction, and of shot noise, whose kink wants a finer step.
const PRNU_POINTS: i32 = 4;
const SHOT_POINTS: i32 = 16;

/// A channel of a bright flat.
struct Bright {
    /// Mean charge that the light makes, e⁻.
    electrons: f64,
    /// Relative standard deviation of the pixels.
    prnu: f64,
    /// What the well took of the mean, e⁻.
    loss: Value,
    /// What the well took of the variance over frames, e⁻²; none where the converter saturates.
    calm: Option<Value>,
}

impl Bright {
    /// L and C, e⁻ and e⁻², in a well (e⁻) with a knee.
    fn losses(&self, well: f64, knee: f64) -> (f64, f64) {
        let width = knee * well;
        let kept = |q: f64| match (q - well) / width {
            // A sharp well, or far above a soft one.
            t if width == 0.0 || t > FAR_ABOVE => q.min(well),
            t => q - width * libm::log1p(libm::exp(t)),
        };
        let (mut loss, mut calm, mut pixels) = (0.0, 0.0, 0.0);
        for (z, weight) in normal_grid(PRNU_POINTS) {
            let mean = self.electrons * (1.0 + self.prnu * z);
            let sd = mean.max(0.0).sqrt();
            let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
            for (z, weight) in normal_grid(SHOT_POINTS) {
                let q = kept(mean + sd * z) - mean;
                n += weight;
                sum += weight * q;
                squares += weight * q * q;
            }
            let q = sum / n;
            pixels += weight;
            loss -= weight * q;
            calm += weight * (sd * sd - (squares / n - q * q));
        }
        (loss / pixels, calm / pixels)
    }
}

/// Points of a standard normal law, 2 `n` + 1 of them up to 4 standard deviations, with their
/// weights.
fn normal_grid(n: i32) -> impl Iterator<Item = (f64, f64)> {
    (-n..=n).map(move |i| {
        let z = 4.0 * f64::from(i) / f64::from(n);
        (z, libm::exp(-0.5 * z * z))
    })
}

/// `full-well`: for every knee the capacity; where the model has an effect of its own, for its
/// knee alone.
pub fn full_well(e: &Evidence<'_>) -> Vec<Proposal> {
    // The base model has a well too, of the camera's full well: that is no effect of its own.
    let own = e.camera.effects.iter().any(|x| matches!(x, Effect::FullWell(_)));
    let held = match current(e.camera, "full-well") {
        Some(Effect::FullWell(x)) if own => Some((f64::from(x.full_well_e), f64::from(x.knee))),
        _ => None,
    };
    let flats = bright_flats(e, held);
    let Some(most) = flats.iter().map(|b| b.electrons).reduce(f64::max) else { return Vec::new() };
    let knees: &[f64] = held.as_ref().map_or(&KNEES, |h| std::slice::from_ref(&h.1));
    knees.iter().filter_map(|&knee| with_knee(&flats, most, knee)).collect()
}

/// The likeliest capacity for a knee; `most` is the charge of the brightest flat, e⁻.
fn with_knee(flats: &[Bright], most: f64, knee: f64) -> Option<Proposal> {
    let misfit = |well: f64| chi_squared(flats, well, knee);
    // Near the charge of the brightest flat step by step, then between two of the steps.
    let at = |i: i32| most * libm::exp(f64::from(i) * CAPACITY_STEP);
    let best = (-CAPACITY_STEPS..=CAPACITY_STEPS)
        .map(|i| (i, misfit(at(i))))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(0, |b| b.0);
    let well = minimum(at(best - 1), at(best + 1), GOLDEN_STEPS, misfit);
    let step = CURVATURE_STEP * well;
    let left = misfit(well);
    // χ² rises by 1 at one standard error.
    let bend = (misfit(well + step) + misfit(well - step) - 2.0 * left) / 2.0;
    let well = Value { value: well, std_error: step / bend.max(1e-12).sqrt() };
    let without = chi_squared(flats, f64::MAX.sqrt(), 0.0);
    let strength = (without - left).max(0.0).sqrt();
    Proposal::of("full-well", strength, [("full_well_e", well), ("knee", Value::chosen(knee))])
}

/// χ² of what the flats lack against what a well (e⁻) with a knee takes.
fn chi_squared(flats: &[Bright], well: f64, knee: f64) -> f64 {
    let of = |b: &Bright| {
        let (loss, calm) = b.losses(well, knee);
        let z = |found: &Value, expected: f64| (found.value - expected) / found.std_error;
        z(&b.loss, loss).powi(2) + b.calm.map_or(0.0, |c| z(&c, calm).powi(2))
    };
    flats.iter().map(of).sum()
}

/// The flats that a well may reach, channel by channel, with what they lack in all: beyond what
/// the model predicts, and by the well `held` (capacity in e⁻, knee) that it has.
fn bright_flats(e: &Evidence<'_>, held: Option<(f64, f64)>) -> Vec<Bright> {
    let mut out = Vec::new();
    let usable = |i: usize| saturated(&e.stacks[i]) < MAX_SATURATED;
    for (i, c) in e.of_role(Role::Flat).filter(|(i, _)| usable(*i)) {
        let (k, place) = (e.gain(c), Place::Stack(i));
        for class in 0..channel_count(e) {
            let Some(short) = e.difference(place, What::Mean(class)) else { continue };
            let less =
                |x: Value, k: f64| Value { value: -x.value / k, std_error: x.std_error / k };
            let noise = e.difference(place, What::Variance(class));
            let mut flat = Bright {
                electrons: c.photo_e[usize::from(class).min(c.photo_e.len() - 1)],
                prnu: e.camera.sensor.noise.prnu,
                loss: less(short, k),
                // The end of the converter's scale takes noise as well.
                calm: noise
                    .filter(|_| saturated(&e.stacks[i]) < SATURATED_FLAT)
                    .map(|x| less(x, k * k)),
            };
            if let Some((well, knee)) = held {
                let (loss, calm) = flat.losses(well, knee);
                flat.loss.value += loss;
                flat.calm.iter_mut().for_each(|c| c.value += calm);
            }
            out.push(flat);
        }
    }
    let most = out.iter().map(|b| b.electrons).fold(0.0, f64::max);
    out.retain(|b| b.electrons > BRIGHT * most);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sharp_well_takes_what_the_closed_forms_say() {
        let nothing = Value { value: 0.0, std_error: 1.0 };
        let flat = Bright { electrons: 4000.0, prnu: 0.0, loss: nothing, calm: None };
        // At the mean, half of a normal law is cut: E[max(x, 0)] = s φ(0), and
        // Var[min(x, 0)] = s² (1/2 − 1/2π).
        let (loss, calm) = flat.losses(4000.0, 0.0);
        let pi = std::f64::consts::PI;
        // The error of the trapezoid rule at the kink, h²/12 of it with h = 1/4.
        assert!((loss / (4000.0 / std::f64::consts::TAU).sqrt() - 1.0).abs() < 0.01, "{loss}");
        assert!((calm / (4000.0 * (0.5 + 0.5 / pi)) - 1.0).abs() < 0.01, "{calm}");
        let (loss, calm) = flat.losses(1e9, 0.0);
        assert!(loss.abs() < 1e-6 && (calm / 4000.0).abs() < 0.002, "{loss} {calm}");
    }
}
