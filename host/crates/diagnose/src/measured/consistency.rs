//! Captures that contradict their manifest are refused, not explained by effects.

use crate::data::design::{Condition, Design};
use crate::model::effects::dn_per_e;
use crate::statistics::maps::{black_level, saturated};
use crate::statistics::temporal::{Temporal, mean};
use camrig_base::median::median;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_captures::Role;
use camrig_linear::dot;
use camrig_sensor_core::effects::Effect;
use camrig_sensor_core::effects::empirical::Quantity;

/// Factor by which a stack's signal, or its noise for its signal, differs from the others' where
/// that is no effect of a sensor but another entry of the manifest. Chosen below the factor of 2
/// by which neighbouring exposures and gains of a plan differ, and far above what effects of a
/// sensor do.
const GROSS_FACTOR: f64 = 1.5;
/// Relative difference within which the other stacks must agree for one to be singled out.
const AGREEMENT: f64 = 0.1;
/// Stacks without which none is singled out.
const MIN_STACKS: usize = 5;
/// Stacks that may be off: two, whose entries were exchanged.
const MAX_OFF: usize = 2;
/// Share of saturated samples from which a flat's mean and noise are not those of its light.
pub(super) const SATURATED: f64 = 0.01;
/// Variance of shot noise over that of read noise and rounding from which a stack's noise
/// determines its gain.
const SHOT_NOISE_LIMITED: f64 = 2.0;
/// Differences of neighbouring pixels are clipped at this multiple of their median magnitude, so
/// that defective pixels do not decide.
const CLIP: f64 = 6.0;
/// Standard deviations by which the flats' own patterns must stand out before they are compared.
const PATTERN_STANDS_OUT: f64 = 20.0;
/// Share of the expected covariance below which two patterns are those of different sensors.
const SAME_PATTERN: f64 = 0.3;

/// Checks that the stacks are consistent with the manifest.
///
/// # Errors
/// A stack that contradicts the others; flats that are all saturated; flats whose fixed patterns
/// are those of different sensors.
pub fn check(camera: &Camera, design: &Design, stacks: &[Temporal]) -> Result<()> {
    let black = black_level(camera, design, stacks);
    let flats: Vec<(&Condition, &Temporal)> =
        design.conditions.iter().zip(stacks).filter(|(c, _)| c.stack.role == Role::Flat).collect();
    let usable: Vec<(&Condition, &Temporal)> =
        flats.iter().copied().filter(|(_, t)| saturated(t) < SATURATED).collect();
    if !flats.is_empty() && usable.is_empty() {
        return Err(Error::input("every flat is saturated")
            .help("take flats below saturation, or leave them out of the set"));
    }
    let pattern = camera.sensor.pattern();
    let known: Vec<(&Condition, f64)> = usable
        .iter()
        .filter(|(c, _)| c.level_known)
        .map(|(c, t)| {
            let tile: Vec<f64> = pattern
                .channels
                .iter()
                .map(|&k| c.photo_e.get(usize::from(k)).copied().unwrap_or(0.0))
                .collect();
            let expected = tile.iter().sum::<f64>() / tile.len() as f64
                * dn_per_e(camera, c.stack.analog_gain);
            (*c, (t.level() - black) / expected)
        })
        .collect();
    alone(&known, |c, times| {
        let what = "the signal that its light, exposure and gain give in the other captures";
        Error::disagreement(format!("{times:.2} times {what}"))
            .at(format!("capture {:?}", c.stack.id))
            .help("one of the three is another capture's in captures.toml, or the frames are")
    })?;
    let transfer: Vec<(&Condition, f64)> = usable
        .iter()
        .filter_map(|(c, t)| {
            let k = dn_per_e(camera, c.stack.analog_gain);
            let read = read_variance_e2(camera) * k * k + 1.0 / 12.0;
            let signal = t.level() - black;
            (signal * k > SHOT_NOISE_LIMITED * read)
                .then(|| (*c, (mean(&t.pixel_variance) - read) / (signal * k)))
        })
        .collect();
    alone(&transfer, |c, times| {
        let what = "the noise that its signal and gain give in the other captures";
        Error::disagreement(format!("{times:.2} times {what}"))
            .at(format!("capture {:?}", c.stack.id))
            .help(
                "analog_gain in captures.toml is not that of these frames, or the camera \
                 processed them",
            )
    })?;
    same_sensor(camera, &usable, black)
}

/// Variance of the noise that a camera has in the dark, e⁻²: of its read noise, and of stages that
/// replace or add to it.
fn read_variance_e2(camera: &Camera) -> f64 {
    let of_stages = camera.effects.iter().filter_map(|effect| match effect {
        Effect::Empirical(e) if e.quantity() == Quantity::Temporal => Some(f64::from(e.amount)),
        _ => None,
    });
    camera.sensor.noise.read_e.powi(2) + of_stages.map(|e| e * e).sum::<f64>()
}

/// Finds the one stack that is off by a gross factor where all others agree.
fn alone(ratios: &[(&Condition, f64)], say: impl Fn(&Condition, f64) -> Error) -> Result<()> {
    if ratios.len() < MIN_STACKS {
        return Ok(());
    }
    let middle = median(&mut ratios.iter().map(|r| r.1).collect::<Vec<_>>(), f64::total_cmp);
    let off: Vec<&(&Condition, f64)> = ratios
        .iter()
        .filter(|(_, r)| !(1.0 / GROSS_FACTOR..GROSS_FACTOR).contains(&(r / middle)))
        .collect();
    let near = ratios.iter().filter(|(_, r)| (r / middle - 1.0).abs() < AGREEMENT).count();
    match off.first() {
        Some((c, r)) if off.len() <= MAX_OFF && near + off.len() == ratios.len() => {
            Err(say(c, r / middle))
        }
        _ => Ok(()),
    }
}

/// Checks that the two brightest flats show the gain pattern of one sensor. Under a colour filter
/// array neighbouring pixels differ anyhow, and nothing is checked.
fn same_sensor(camera: &Camera, flats: &[(&Condition, &Temporal)], black: f64) -> Result<()> {
    let level = |t: &Temporal| t.level() - black;
    let mut by_level = flats.to_vec();
    by_level.sort_by(|a, b| level(b.1).total_cmp(&level(a.1)));
    let [(first, a), (second, b), ..] = by_level[..] else { return Ok(()) };
    if camera.sensor.channel_names.len() > 1 {
        return Ok(());
    }
    // Differences of neighbouring pixels: shading and lines cancel.
    let fine = |t: &Temporal| -> Vec<f64> {
        t.mean.data.chunks(2).filter(|p| p.len() == 2).map(|p| f64::from(p[0] - p[1])).collect()
    };
    let (x, y) = (fine(a), fine(b));
    let clip = |v: &[f64]| {
        let limit =
            CLIP * median(&mut v.iter().map(|v| v.abs()).collect::<Vec<_>>(), f64::total_cmp);
        v.iter().map(|v| v.clamp(-limit, limit)).collect::<Vec<f64>>()
    };
    let (x, y) = (clip(&x), clip(&y));
    let product = |x: &[f64], y: &[f64]| dot(x, y) / x.len() as f64;
    let noise = |t: &Temporal| 2.0 * mean(&t.pixel_variance) / t.frames as f64;
    let pattern = |v: &[f64], t: &Temporal| (product(v, v) - noise(t)).max(0.0);
    let expected = (pattern(&x, a) * pattern(&y, b)).sqrt();
    let scatter = (product(&x, &x) * product(&y, &y) / x.len() as f64).sqrt();
    // Where each flat has a significant pattern that is absent from the other.
    if expected > PATTERN_STANDS_OUT * scatter && product(&x, &y) < SAME_PATTERN * expected {
        return Err(Error::disagreement("their fixed patterns are not the same")
            .at(format!("captures {:?} and {:?}", first.stack.id, second.stack.id))
            .help("a set holds frames of one sensor; do not crop or turn some of them"));
    }
    Ok(())
}
