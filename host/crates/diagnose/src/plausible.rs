//! Captures that contradict their manifest are said, not explained.

use super::design::{Condition, Design};
use super::maps::{reference_dark, saturated};
use super::model::dn_per_e;
use super::temporal::{Temporal, mean};
use camrig_base::median::median;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_captures::Role;

/// A stack's signal, or its noise for its signal, that is this much off the others' is no effect of a sensor.
const GROSS: f64 = 1.5;

/// Checks that the stacks can be what the manifest says.
///
/// # Errors
/// A stack that contradicts the others; flats that are all saturated; stacks whose fixed patterns are
/// those of different sensors.
pub fn check(camera: &Camera, design: &Design, stacks: &[Temporal]) -> Result<()> {
    let black = match reference_dark(design) {
        Some(i) => stacks[i].level(),
        None => camera.sensor.black_level_dn,
    };
    let flats: Vec<(&Condition, &Temporal)> =
        design.conditions.iter().zip(stacks).filter(|(c, _)| c.role == Role::Flat).collect();
    let usable: Vec<(&Condition, &Temporal)> =
        flats.iter().copied().filter(|(_, t)| saturated(t) < 0.01).collect();
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
            let expected =
                tile.iter().sum::<f64>() / tile.len() as f64 * dn_per_e(camera, c.analog_gain);
            (*c, (t.level() - black) / expected)
        })
        .collect();
    alone(&known, |c, times| {
        Error::input(format!("{times:.2} times the signal that its light, exposure and gain give in the other captures"))
            .at(format!("capture {:?}", c.id))
            .help("one of the three is another capture's in captures.toml, or the frames are")
    })?;
    let transfer: Vec<(&Condition, f64)> = usable
        .iter()
        .filter_map(|(c, t)| {
            let k = dn_per_e(camera, c.analog_gain);
            let read = (camera.sensor.noise.read_e * k).powi(2) + 1.0 / 12.0;
            let signal = t.level() - black;
            // Only where shot noise is most of it.
            (signal * k > 2.0 * read).then(|| (*c, (mean(&t.pixel_variance) - read) / (signal * k)))
        })
        .collect();
    alone(&transfer, |c, times| {
        Error::input(format!("{times:.2} times the noise that its signal and gain give in the other captures"))
            .at(format!("capture {:?}", c.id))
            .help("analog_gain in captures.toml is not that of these frames, or the camera processed them")
    })?;
    same_sensor(camera, &usable, black)
}

/// Finds the one stack of five and more that is off by a gross factor where all others agree.
fn alone(ratios: &[(&Condition, f64)], say: impl Fn(&Condition, f64) -> Error) -> Result<()> {
    if ratios.len() < 5 {
        return Ok(());
    }
    let middle = median(&mut ratios.iter().map(|r| r.1).collect::<Vec<_>>(), f64::total_cmp);
    let off: Vec<&(&Condition, f64)> =
        ratios.iter().filter(|(_, r)| !(1.0 / GROSS..GROSS).contains(&(r / middle))).collect();
    let near = ratios.iter().filter(|(_, r)| (r / middle - 1.0).abs() < 0.1).count();
    // Two stacks whose entries were exchanged are both off.
    match off.first() {
        Some((c, r)) if off.len() <= 2 && near + off.len() == ratios.len() => {
            Err(say(c, r / middle))
        }
        _ => Ok(()),
    }
}

/// The gain pattern of one sensor is in all its flats.
fn same_sensor(camera: &Camera, flats: &[(&Condition, &Temporal)], black: f64) -> Result<()> {
    let level = |t: &Temporal| t.level() - black;
    let mut by_level = flats.to_vec();
    by_level.sort_by(|a, b| level(b.1).total_cmp(&level(a.1)));
    let [(first, a), (second, b), ..] = by_level[..] else { return Ok(()) };
    if camera.sensor.channel_names.len() > 1 {
        return Ok(());
    }
    // Pixels against their neighbours: shading and lines drop out.
    let fine = |t: &Temporal| -> Vec<f64> {
        t.mean.data.chunks(2).filter(|p| p.len() == 2).map(|p| f64::from(p[0] - p[1])).collect()
    };
    let (x, y) = (fine(a), fine(b));
    let clip = |v: &[f64]| {
        let limit =
            6.0 * median(&mut v.iter().map(|v| v.abs()).collect::<Vec<_>>(), f64::total_cmp);
        v.iter().map(|v| v.clamp(-limit, limit)).collect::<Vec<f64>>()
    };
    let (x, y) = (clip(&x), clip(&y));
    let product =
        |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(a, b)| a * b).sum::<f64>() / x.len() as f64;
    let noise = |t: &Temporal| 2.0 * mean(&t.pixel_variance) / t.frames as f64;
    let pattern = |v: &[f64], t: &Temporal| (product(v, v) - noise(t)).max(0.0);
    let expected = (pattern(&x, a) * pattern(&y, b)).sqrt();
    let scatter = (product(&x, &x) * product(&y, &y) / x.len() as f64).sqrt();
    // Where each flat has a pattern of its own that stands out, and nothing of it is in the other.
    if expected > 20.0 * scatter && product(&x, &y) < 0.3 * expected {
        return Err(Error::input("their fixed patterns are not the same")
            .at(format!("captures {:?} and {:?}", first.id, second.id))
            .help("a set holds frames of one sensor; do not crop or turn some of them"));
    }
    Ok(())
}
