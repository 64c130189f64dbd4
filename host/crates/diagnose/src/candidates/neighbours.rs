//! Neighbours that share light or charge: `optical-crosstalk`, `charge-coupling`,
//! `brighter-fatter`.
//!
//! Charge that moves between neighbours correlates their noise, and under a colour filter array
//! moves the means of the channels towards each other. With r the correlation of neighbours less
//! what the model predicts, and s the share of shot noise in the variance v,
//!
//!   charge coupling:  r = 2 s c, c the fraction that goes to each horizontal (vertical) neighbour;
//!   brighter-fatter:  r = 2 a ⟨µ²⟩/v, (v − v')/v = −8 a ⟨µ²⟩/v, a in 1/e⁻, µ signals of pixels,
//!
//! both over the flats by weighted slopes through the origin. What a unit of a parameter does to
//! the channels' means (DN) and to their ratios, which neither lamp nor the channels' own mean
//! gains change, gives the parameter once more; crosstalk of light, before shot noise, correlates
//! nothing and has that alone.

use super::common::present;
use super::proposal::{MIN_STRENGTH, Proposal};
use crate::data::channels::Channels;
use crate::data::design::Condition;
use crate::evidence::{Evidence, slope};
use crate::model::effects::current;
use crate::statistics::ratios::{reference_flat, strongest};
use crate::statistics::statistic::{Place, What};
use camrig_base::Value;
use camrig_sensor_core::effects::Effect;

/// Error, relative, that an estimate may have by what its equation leaves out, terms of second
/// order: the search repeats estimates until they settle.
const ROUGH: f64 = 0.25;
/// Distance, standard errors, within which two estimates of a parameter agree.
const AGREE_WITHIN: f64 = 3.0;

/// A parameter from the means of the channels of the flats and from their ratios. `lean` gives the
/// electrons that each channel gains per unit of the parameter, from the photo-electrons of each.
/// `None` for a monochrome sensor.
fn leaning(e: &Evidence<'_>, lean: &dyn Fn(&[f64]) -> Vec<f64>) -> Option<Value> {
    let n = e.camera.sensor.channel_names.len();
    if n < 2 {
        return None;
    }
    let means = e.flats().filter(|(_, c)| c.level_known).flat_map(|(i, c)| {
        let (k, gets) = (e.gain(c), lean(&c.photo_e));
        (0..n).filter_map(move |channel| {
            let d = e.difference(Place::Stack(i), What::Mean(channel as u8))?;
            Some((k * gets[channel], d))
        })
    });
    // The derivative of a ratio of ratios. A channel may have no light. Without
    // a reference flat there are no ratios, and any stack serves.
    let reference = e.design.conditions.get(reference_flat(e.design).unwrap_or(0))?;
    let relative = |c: &Condition, channel: usize| lean(&c.photo_e)[channel] / c.photo_e[channel];
    let ratios = e.flats().flat_map(|(i, c)| {
        let g = strongest(c);
        let strong = relative(c, g) - relative(reference, g);
        let gets = lean(&c.photo_e);
        let by = move |own: usize| reference.photo_e[g] / (reference.photo_e[own] * c.photo_e[g]);
        (0..n).filter_map(move |own| {
            let (place, what) = (Place::Stack(i), What::Ratio(own as u8));
            let d = e.difference(place, what)?;
            let ratio = e.predicted(place, what)?;
            Some((by(own) * gets[own] - ratio * (relative(reference, own) + strong), d))
        })
    });
    slope(means.chain(ratios))
}

/// `optical-crosstalk`: channels that lean towards each other.
pub fn optical_crosstalk(e: &Evidence<'_>) -> Option<Proposal> {
    let channels = Channels::new(e.camera);
    let found = leaning(e, &|photo_e| channels.mean_laplacian(photo_e))?;
    let present = present(e.camera, "optical-crosstalk", "side").unwrap_or(0.0);
    let k = Value { value: (present + found.value).max(0.0), ..found };
    Proposal::of("optical-crosstalk", found.z().abs(), [("side", k), ("vertical", k)])
}

/// What means give for a parameter, where it agrees with what noise gives.
fn agreeing(noise: Value, means: Option<Value>) -> Option<Value> {
    means.filter(|m| {
        let apart = (m.value - noise.value).abs();
        apart
            < AGREE_WITHIN * libm::hypot(m.std_error, noise.std_error) + ROUGH * noise.value.abs()
    })
}

/// `charge-coupling`: correlation of neighbours in flats over the fraction of shot noise,
/// horizontally and above each other. The means of the channels give the mean of both.
pub fn charge_coupling(e: &Evidence<'_>) -> Option<Proposal> {
    let of = |lag: u8| {
        slope(e.flats().filter_map(|(i, c)| {
            let r = e.difference(Place::Stack(i), What::Covariance(lag))?;
            Some((2.0 * shot_share(e, i, c)?, r))
        }))
    };
    let (mut x, mut y) = (of(0)?, of(1)?);
    let present = match current(e.camera, "charge-coupling") {
        Some(Effect::ChargeCoupling(k)) => Some((f64::from(k.side), f64::from(k.vertical))),
        _ => None,
    };
    let mut strength = libm::hypot(x.z(), y.z());
    let channels = Channels::new(e.camera);
    let both = Value {
        value: (x.value + y.value) / 2.0,
        std_error: libm::hypot(x.std_error, y.std_error) / 2.0,
    };
    if let Some(means) = agreeing(both, leaning(e, &|photo_e| channels.mean_laplacian(photo_e))) {
        // Least squares of x, y and their mean.
        let off = (means.value - both.value) / (means.std_error.powi(2) + both.std_error.powi(2));
        for one in [&mut x, &mut y] {
            let shared = one.std_error.powi(2) / 2.0;
            one.value += shared * off;
            let known = shared * shared / (means.std_error.powi(2) + both.std_error.powi(2));
            one.std_error = (one.std_error.powi(2) - known).sqrt();
        }
        // Means alone are no ground for it: `optical-crosstalk` moves them alike.
        if strength > MIN_STRENGTH || present.is_some() {
            strength = libm::hypot(strength, means.z());
        }
    }
    let (px, py) = present.unwrap_or((0.0, 0.0));
    let side = Value { value: (px + x.value).max(0.0), ..x };
    let vertical = Value { value: (py + y.value).max(0.0), ..y };
    Proposal::of("charge-coupling", strength, [("side", side), ("vertical", vertical)])
}

/// Share of shot noise in a stack's variance.
fn shot_share(e: &Evidence<'_>, stack: usize, c: &Condition) -> Option<f64> {
    let (v, _) = e.variance(stack)?;
    Some((e.signal(stack)? * e.gain(c) / v).clamp(0.0, 1.0))
}

/// `brighter-fatter`: correlation of neighbours in flats in proportion to the signal, and the
/// variance lost to it where both agree; where they do, the charge that brighter channels push
/// into others.
pub fn brighter_fatter(e: &Evidence<'_>) -> Option<Proposal> {
    let channels = Channels::new(e.camera);
    let mut found = by_noise(e, &channels)?;
    let mut strength = found.z().abs();
    let present = present(e.camera, "brighter-fatter", "coefficient");
    let half_squares = |photo_e: &[f64]| -> Vec<f64> {
        channels.mean_laplacian(&photo_e.iter().map(|q| 0.5 * q * q).collect::<Vec<_>>())
    };
    if let Some(means) = agreeing(found, leaning(e, &half_squares)) {
        found = Value::combine([found, means])?;
        if strength > MIN_STRENGTH || present.is_some() {
            strength = libm::hypot(strength, means.z());
        }
    }
    let value = (present.unwrap_or(0.0) + found.value).max(0.0);
    Proposal::of("brighter-fatter", strength, [("coefficient", Value { value, ..found })])
}

/// The coefficient of brighter-fatter, 1/e⁻, from correlation and variance.
fn by_noise(e: &Evidence<'_>, channels: &Channels) -> Option<Value> {
    // ⟨µ²⟩/v: a times this is what a pixel's shot noise pushes to one side, over the variance.
    let pushed = |i: usize| {
        let (v, _) = e.variance(i)?;
        let squares = e.levels(i).into_iter().zip(channels.shares()).map(|(s, n)| n * s * s);
        Some(squares.sum::<f64>() / v)
    };
    let gained = slope(e.flats().flat_map(|(i, _)| {
        let x = pushed(i).map(|x| 2.0 * x);
        [0, 1].into_iter().filter_map(move |lag| {
            Some((x?, e.difference(Place::Stack(i), What::Covariance(lag))?))
        })
    }))?;
    // Of the shot noise (1 − 4b)² + 4b² is left, b = a µ.
    let lost = slope(e.flats().filter_map(|(i, _)| {
        let (v, excess) = (e.variance(i)?.0, e.variance_excess(i)?);
        Some((-8.0 * pushed(i)?, excess.scaled(1.0 / v)))
    }))?;
    let apart = (gained.value - lost.value).abs() / libm::hypot(gained.std_error, lost.std_error);
    if apart < AGREE_WITHIN { Value::combine([gained, lost]) } else { Some(gained) }
}
