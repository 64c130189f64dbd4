//! Full well: the brightest flats fall short of the line, and of its noise.

use super::{Proposal, minimum};
use crate::evidence::{Estimated, Evidence};
use crate::maps::saturated;
use crate::model::current;
use crate::statistics::{Place, What};
use camrig_captures::Role;
use camrig_sensor_core::effects::{Effect, full_well::FullWell};

/// Knees that are tried, as fractions of full well.
const KNEES: [f64; 4] = [0.0, 0.02, 0.05, 0.1];
/// Flats below this share of the brightest say nothing.
const BRIGHT: f64 = 0.5;

/// A bright flat: electrons collected, and what the well took of their mean and of their variance over time.
struct Bright {
    electrons: f64,
    prnu: f64,
    loss: Estimated,
    calm: Option<Estimated>,
}

impl Bright {
    /// Loss of mean and of temporal variance in a well with a knee, for normal shot noise of pixels that differ by PRNU.
    fn losses(&self, well: f64, knee: f64) -> (f64, f64) {
        let width = knee * well;
        let kept = |q: f64| match (q - well) / width {
            // A sharp well, and far above a soft one.
            t if width == 0.0 || t > 30.0 => q.min(well),
            t => q - width * t.exp().ln_1p(),
        };
        let (mut loss, mut calm, mut pixels) = (0.0, 0.0, 0.0);
        for (z, weight) in normal_grid(4) {
            let mean = self.electrons * (1.0 + self.prnu * z);
            let sd = mean.max(0.0).sqrt();
            let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
            for (z, weight) in normal_grid(16) {
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

/// Points of a standard normal law, 2 `n` + 1 of them up to 4 standard deviations, with their weights.
fn normal_grid(n: i32) -> impl Iterator<Item = (f64, f64)> {
    (-n..=n).map(move |i| {
        let z = 4.0 * f64::from(i) / f64::from(n);
        (z, (-0.5 * z * z).exp())
    })
}

/// Full well and knee from mean and variance of the bright flats.
pub fn full_well(e: &Evidence<'_>) -> Vec<Proposal> {
    let own = e.camera.effects.iter().any(|x| matches!(x, Effect::FullWell(_)));
    let held = match current(e.camera, "full-well") {
        Some(Effect::FullWell(x)) if own => Some((f64::from(x.full_well_e), f64::from(x.knee))),
        _ => None,
    };
    let bright = bright(e, held);
    let Some(most) = bright.iter().map(|b| b.electrons).reduce(f64::max) else { return Vec::new() };
    let misfit = |well: f64, knee: f64| -> f64 {
        let of = |b: &Bright| {
            let (loss, calm) = b.losses(well, knee);
            let z = |found: &Estimated, expected: f64| (found.value - expected) / found.se;
            z(&b.loss, loss).powi(2) + b.calm.map_or(0.0, |c| z(&c, calm).powi(2))
        };
        bright.iter().map(of).sum()
    };
    let nothing = misfit(f64::MAX.sqrt(), 0.0);
    let knees: &[f64] = held.as_ref().map_or(&KNEES, |h| std::slice::from_ref(&h.1));
    let solve = |&knee: &f64| {
        // Near the charge in steps of some standard deviation of it, then between two of them.
        let at = |i: i32| most * (f64::from(i) * 0.014).exp();
        let best = (-50..=50)
            .map(|i| (i, misfit(at(i), knee)))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map_or(0, |b| b.0);
        let well = minimum(at(best - 1), at(best + 1), 40, |w| misfit(w, knee));
        let step = 1e-3 * well;
        let left = misfit(well, knee);
        // χ² rises by 1 at one standard error.
        let bend = (misfit(well + step, knee) + misfit(well - step, knee) - 2.0 * left) / 2.0;
        let se = step / bend.max(1e-12).sqrt();
        let effect = FullWell { full_well_e: well as f32, knee: knee as f32 };
        Proposal::new("full-well", effect.into(), (nothing - left).max(0.0).sqrt())
            .with("full_well_e", well, se)
            .with("knee", knee, f64::NAN)
    };
    knees.iter().map(solve).collect()
}

/// The flats that a well may reach, channel by channel, with what they lack beyond the well `held` that the model has.
fn bright(e: &Evidence<'_>, held: Option<(f64, f64)>) -> Vec<Bright> {
    let mut out = Vec::new();
    for (i, c) in e.of_role(Role::Flat).filter(|(i, _)| saturated(&e.stacks[*i]) < 0.5) {
        let (k, place) = (e.gain(c), Place::Stack(i));
        for class in 0..e.camera.sensor.channel_names.len() as u8 {
            let Some(short) = e.difference(place, What::Mean(class)) else { continue };
            let less = |x: Estimated, k: f64| Estimated { value: -x.value / k, se: x.se / k };
            let noise = e.difference(place, What::Variance(class));
            let mut flat = Bright {
                electrons: c.photo_e[usize::from(class).min(c.photo_e.len() - 1)],
                prnu: e.camera.sensor.noise.prnu,
                loss: less(short, k),
                // The converter's end stills the noise too.
                calm: noise.filter(|_| saturated(&e.stacks[i]) < 1e-5).map(|x| less(x, k * k)),
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
        let nothing = Estimated { value: 0.0, se: 1.0 };
        let flat = Bright { electrons: 4000.0, prnu: 0.0, loss: nothing, calm: None };
        // At the mean, half of a normal law is cut: E[max(x, 0)] = s φ(0), Var[min(x, 0)] = s² (1/2 − 1/2π).
        let (loss, calm) = flat.losses(4000.0, 0.0);
        let pi = std::f64::consts::PI;
        // The error of the trapezoid rule at the kink, h²/12 of it with h = 1/4.
        assert!((loss / (4000.0 / std::f64::consts::TAU).sqrt() - 1.0).abs() < 0.01, "{loss}");
        assert!((calm / (4000.0 * (0.5 + 0.5 / pi)) - 1.0).abs() < 0.01, "{calm}");
        let (loss, calm) = flat.losses(1e9, 0.0);
        assert!(loss.abs() < 1e-6 && (calm / 4000.0).abs() < 0.002, "{loss} {calm}");
    }
}
