//! How well the light was known: scatter of the flats' means that is no property of the sensor;
//! and what particle hits leave.
//!
//! The amount of light in a flat is known to some tenths of a per cent at best, unless the flats
//! themselves show that it was known better: a sensor's response is smooth in the level, so what
//! a quadratic leaves of the measured over the stated light is the scatter of the lamp.

use super::statistic::{Key, Place, Values, What};
use crate::data::design::{Condition, Design, same_temperature};
use camrig_camera::Camera;
use camrig_linear::{Matrix, Singular, Vector, apply};
use std::collections::BTreeMap;

/// Relative scatter of the light where a set has too few flats to show it: that of a stabilised
/// lamp with a calibrated photodiode.
const ASSUMED: f64 = 1e-3;
/// Relative scatter from which it is said: twice that of a stabilised lamp.
const SAID: f64 = 2.0 * ASSUMED;
/// Level, over that of the brightest flat, above which flats are left out: a saturation knee is no
/// scatter of the lamp.
const BELOW_KNEE: f64 = 0.85;
/// Flats below the knee from which a quadratic leaves degrees of freedom to speak of: two.
const MIN_FLATS: usize = 5;
/// Reduced χ² above which flats scatter more than their noise: with two degrees of freedom noise
/// alone gives more once in 4.5 sets, with ten once in eight.
const EXPECTED_CHI: f64 = 1.5;
/// The excess of variance is taken as many times, since few degrees of freedom may hide some of
/// it.
const EXCESS: f64 = 2.0;

/// Standard deviation, DN, that comes from the light: of each flat's mean, and of the levels in
/// captures of targets.
pub fn allowances(camera: &Camera, design: &Design, values: &Values) -> BTreeMap<Key, f64> {
    let channels = camera.sensor.channel_names.len() as u8;
    let mut out = BTreeMap::new();
    let flats: Vec<usize> =
        (0..design.conditions.len()).filter(|&i| design.conditions[i].is_known_flat()).collect();
    for &i in &flats {
        for class in 0..channels {
            let relative = scatter_at(design, values, &flats, i, class).unwrap_or(ASSUMED);
            let key = (Place::Stack(i), What::Mean(class));
            if let Some(s) = values.get(&key) {
                out.insert(key, relative * s.value.abs());
            }
        }
    }
    for (key, s) in values {
        if let (Place::Target(_), What::Of(figure)) = key
            && figure.is_level()
        {
            out.insert(*key, ASSUMED * s.value.abs());
        }
    }
    out
}

/// Standard deviations of what particles leave in the noise of stacks once their events are left
/// out, on the scales of the statistics: relative variance, skewness, excess kurtosis. Charges
/// below the limit of an event stay: 0.6 % of the variance and 0.1 of the kurtosis at most, for
/// mean charges from 30 to 900 e⁻ at some hits a frame (numpy draws of 12 sets each); skewness by
/// the same events.
const LEFT_BY_HITS: [f64; 3] = [0.006, 0.03, 0.1];

/// Allowances for what particle hits leave in dark and flat stacks.
pub fn after_hits(camera: &Camera, design: &Design) -> BTreeMap<Key, f64> {
    let [variance, skewness, kurtosis] = LEFT_BY_HITS;
    let mut out = BTreeMap::new();
    for place in (0..design.conditions.len()).map(Place::Stack) {
        for class in 0..camera.sensor.channel_names.len() as u8 {
            out.insert((place, What::Variance(class)), variance);
        }
        out.insert((place, What::Skewness), skewness);
        out.insert((place, What::Kurtosis), kurtosis);
    }
    out
}

/// What is said where flats are taken to know their light worse than a stabilised lamp: it weakens
/// all evidence of how the response bends.
pub fn note(design: &Design, allowed: &BTreeMap<Key, f64>, values: &Values) -> Option<String> {
    let relative = |i: usize| {
        let key = (Place::Stack(i), What::Mean(0));
        Some(allowed.get(&key)? / values.get(&key)?.value.abs().max(1e-9))
    };
    let most = (0..design.conditions.len()).filter_map(relative).fold(0.0, f64::max);
    (most > SAID).then(|| {
        format!(
            "the stated light of flats is taken to be off by {:.2} % (one standard deviation) at \
             random: so much more than noise do their means scatter about a smooth response",
            100.0 * most
        )
    })
}

/// Relative scatter of the light of a flat, from the series of levels at its exposure, or else
/// from the series of another exposure with the largest scatter: the lamp does not depend on the
/// exposure.
fn scatter_at(
    design: &Design,
    values: &Values,
    flats: &[usize],
    flat: usize,
    class: u8,
) -> Option<f64> {
    let own = &design.conditions[flat];
    let of_exposure = |exposure_s: f64| {
        let belongs = |j: &usize| {
            let c = &design.conditions[*j];
            same_lamp(own, c) && c.stack.exposure_s == exposure_s
        };
        let series: Vec<usize> = flats.iter().copied().filter(belongs).collect();
        scatter(design, values, &series, class)
    };
    let others = flats.iter().map(|&j| &design.conditions[j]).filter(|c| same_lamp(own, c));
    of_exposure(own.stack.exposure_s)
        .or_else(|| others.filter_map(|c| of_exposure(c.stack.exposure_s)).max_by(f64::total_cmp))
}

/// Whether two flats were taken in the same light with the same settings of the sensor.
fn same_lamp(a: &Condition, b: &Condition) -> bool {
    a.wavelength_nm == b.wavelength_nm
        && a.stack.analog_gain == b.stack.analog_gain
        && same_temperature(&a.stack, &b.stack)
}

/// Relative scatter about a quadratic in the level; `None` for too few flats below the knee.
fn scatter(design: &Design, values: &Values, series: &[usize], class: u8) -> Option<f64> {
    let points: Vec<(f64, f64, f64)> = series
        .iter()
        .filter_map(|&i| {
            let light = *design.conditions[i].photo_e.get(usize::from(class))?;
            let s = values.get(&(Place::Stack(i), What::Mean(class)))?;
            (light > 0.0 && s.value > 0.0).then_some((light, s.value / light, s.sd / light))
        })
        .collect();
    let top = points.iter().map(|p| p.0).fold(0.0, f64::max);
    let points: Vec<_> = points.into_iter().filter(|p| p.0 < BELOW_KNEE * top).collect();
    if points.len() < MIN_FLATS {
        return None;
    }
    let rows = points.len();
    let a = Matrix::from_fn(rows, 3, |r, c| (points[r].0 / top).powi(c as i32) / points[r].2);
    let b = Vector::from_fn(rows, |r, _| points[r].1 / points[r].2);
    let fit = Singular::of(&a).solve(&b, 1e-12)?;
    let left = b - apply(&a, &fit);
    let chi = left.norm_squared() / (rows as f64 - 3.0);
    let mean = points.iter().map(|p| p.1).sum::<f64>() / rows as f64;
    let statistical = points.iter().map(|p| p.2 * p.2).sum::<f64>() / rows as f64;
    Some((EXCESS * (chi - EXPECTED_CHI).max(0.0) * statistical).sqrt() / mean)
}
