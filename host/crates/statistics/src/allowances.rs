//! Allowances for what is not the sensor: the uncertainty of the stated light, estimated from the
//! scatter of the flats' means, and particle hits below the limit of detection.
//!
//! The light of a flat is known to a tenth of a per cent at best, unless the flats show otherwise:
//! a sensor's response is smooth in the level, so the residuals of a quadratic fit to measured
//! over stated light are the scatter of the lamp.

use super::statistic::{Key, Place, Values, What};
use crate::data::design::{Condition, Design, same_temperature};
use camrig_camera::Camera;
use camrig_linear::{Matrix, Singular, Vector, apply};
use std::collections::BTreeMap;

/// Relative scatter of the light where a set has too few flats to estimate it: that of a stabilised
/// lamp with a calibrated photodiode.
const DEFAULT_SCATTER: f64 = 1e-3;
/// Relative scatter above which it is noted: twice that of a stabilised lamp.
const NOTED_SCATTER: f64 = 2.0 * DEFAULT_SCATTER;
/// Largest level relative to the brightest flat that is fitted: a saturation knee is not scatter of
/// the lamp.
const MAX_LEVEL: f64 = 0.85;
/// Flats below the knee from which a quadratic leaves enough degrees of freedom: two.
const MIN_FLATS: usize = 5;
/// Reduced χ² above which flats scatter more than their noise: noise alone exceeds it once in 4.5
/// sets with two degrees of freedom, once in eight with ten.
const EXPECTED_CHI2: f64 = 1.5;
/// Factor on the excess variance, since with few degrees of freedom it may be underestimated.
const EXCESS_FACTOR: f64 = 2.0;

/// Standard deviation, DN, due to the uncertainty of the light: of each flat's mean, and of the
/// levels in captures of targets.
pub fn of_light(camera: &Camera, design: &Design, values: &Values) -> BTreeMap<Key, f64> {
    let channels = camera.sensor.channel_names.len() as u8;
    let (cfa, pattern) = (&camera.sensor.cfa, camera.sensor.pattern());
    let mut out = BTreeMap::new();
    let flats: Vec<usize> =
        (0..design.conditions.len()).filter(|&i| design.conditions[i].is_known_flat()).collect();
    for &i in &flats {
        for class in 0..channels {
            let relative = scatter_at(design, values, &flats, i, class).unwrap_or(DEFAULT_SCATTER);
            let key = (Place::Stack(i), What::Mean(class));
            if let Some(s) = values.get(&key) {
                let allowed = relative * s.value.abs();
                out.insert(key, allowed);
                let own = |site: &usize| {
                    pattern.channel(site % cfa.width, site / cfa.width) == usize::from(class)
                };
                let sites = (0..cfa.width * cfa.height).filter(own);
                let key = |site: usize| (Place::Stack(i), What::SiteMean(site as u8));
                out.extend(sites.map(|site| (key(site), allowed)));
            }
        }
    }
    for (key, s) in values {
        if let (Place::Target(_), What::Of(figure)) = key
            && figure.is_level()
        {
            out.insert(*key, DEFAULT_SCATTER * s.value.abs());
        }
    }
    out
}

/// Standard deviations due to particles after exclusion of their events, on the scales of the
/// statistics: relative variance, skewness, excess kurtosis. Charges below the limit of detection
/// remain: at most 0.6 % of the variance and 0.1 of the kurtosis, for mean charges from 30 to 900
/// e⁻ at a few hits per frame (numpy simulations of 12 sets each); skewness from the same
/// simulations.
const UNDETECTED_HITS: [f64; 3] = [0.006, 0.03, 0.1];

/// Allowances for undetected particle hits in dark and flat stacks.
pub fn of_hits(camera: &Camera, design: &Design) -> BTreeMap<Key, f64> {
    let [variance, skewness, kurtosis] = UNDETECTED_HITS;
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

/// A note where the light of flats is less certain than that of a stabilised lamp, which weakens
/// all evidence of nonlinearity.
pub fn note(design: &Design, allowed: &BTreeMap<Key, f64>, values: &Values) -> Option<String> {
    let relative = |i: usize| {
        let key = (Place::Stack(i), What::Mean(0));
        Some(allowed.get(&key)? / values.get(&key)?.value.abs().max(1e-9))
    };
    let most = (0..design.conditions.len()).filter_map(relative).fold(0.0, f64::max);
    (most > NOTED_SCATTER).then(|| {
        format!(
            "the stated light of flats is assigned a random error of {:.2} % (one standard \
             deviation): their means scatter by that much more than noise about a smooth response",
            100.0 * most
        )
    })
}

/// Relative scatter of the light of a flat, from the series of levels at its exposure, otherwise
/// the largest from the series at other exposures: the lamp does not depend on the exposure.
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

/// A level of a series.
struct Point {
    light: f64,
    /// Measured over stated light, and its standard deviation.
    ratio: f64,
    sd: f64,
}

/// Relative scatter about a quadratic in the level; `None` for too few flats below the knee.
fn scatter(design: &Design, values: &Values, series: &[usize], class: u8) -> Option<f64> {
    let points: Vec<Point> = series
        .iter()
        .filter_map(|&i| {
            let light = *design.conditions[i].photo_e.get(usize::from(class))?;
            let s = values.get(&(Place::Stack(i), What::Mean(class)))?;
            let point = Point { light, ratio: s.value / light, sd: s.sd / light };
            (light > 0.0 && s.value > 0.0).then_some(point)
        })
        .collect();
    let top = points.iter().map(|p| p.light).fold(0.0, f64::max);
    let points: Vec<_> = points.into_iter().filter(|p| p.light < MAX_LEVEL * top).collect();
    if points.len() < MIN_FLATS {
        return None;
    }
    let rows = points.len();
    let a =
        Matrix::from_fn(rows, 3, |r, c| libm::pow(points[r].light / top, c as f64) / points[r].sd);
    let b = Vector::from_fn(rows, |r, _| points[r].ratio / points[r].sd);
    let fit = Singular::of(&a).solve(&b, 1e-12)?;
    let residuals = b - apply(&a, &fit);
    let chi2 = residuals.norm_squared() / (rows as f64 - 3.0);
    let mean = points.iter().map(|p| p.ratio).sum::<f64>() / rows as f64;
    let statistical = points.iter().map(|p| p.sd * p.sd).sum::<f64>() / rows as f64;
    Some((EXCESS_FACTOR * (chi2 - EXPECTED_CHI2).max(0.0) * statistical).sqrt() / mean)
}
