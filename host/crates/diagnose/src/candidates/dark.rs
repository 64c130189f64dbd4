//! Dark signal: `hot-pixels`, `dark-current`, `dark-current-temperature`, `dark-current-gradient`.
//!
//! The map of dark current (e⁻/s) is the difference of the longest dark stack and the reference
//! over that of their exposures; stacks have the mean dark signal of each channel (DN). With T the
//! temperature, T_ref and T_d those of the model's law 2^((T − T_ref)/T_d), primes what the model
//! predicts and ⟨ ⟩ inverse-variance means:
//!
//!   mean:     µ = µ₀ + ⟨(m − m')/(K t g)⟩, t the exposure beyond the reference's, g the growth,
//!             or by the map's median where that is more certain;
//!   spread:   σ² = σ₀² + (V − V')/g², V the variance of the map's pixels;
//!   doubling: 1/T_d = 1/T_d0 + ⟨log₂(1 + (m − m')/(K t µ g))/(T − T_ref)⟩;
//!   gradient: rate = 2√3 |a|/g, a the amplitudes of √3 u and √3 v in the map;
//!   hot:      the number of outliers above the rest and their mean excess over the outlier limit,
//!             which for an exponential law is the law's own mean.

use super::common::{Count, channel_count, dark_growth, present};
use super::proposal::{Proposal, deviation};
use crate::data::design::{Condition, same_temperature};
use crate::evidence::Evidence;
use crate::model::effects::current;
use crate::statistics::maps::{MapKind, long_dark, reference_dark};
use crate::statistics::statistic::{Place, What};
use camrig_base::Value;
use camrig_camera::Noise;
use camrig_captures::Role;
use camrig_sensor_core::effects::{
    dark_current::DarkCurrent, dark_current_gradient::DarkCurrentGradient, hot_pixels::HotPixels,
};

/// From this many standard deviations of a map's pixels on one is an outlier: the limit by which
/// the map's description counts them.
const OUTLIER_SD: f64 = 5.5;
/// Smallest mean of hot pixels, in outlier limits. Of pixels that all lie at the limit the mean
/// excess would be none, and the number of those below the limit without bound.
const MIN_HOT: f64 = 0.05;
/// Largest share of hot pixels. More of them are no outliers but the law of dark current.
const MAX_HOT: f64 = 0.1;
/// Standard error of the share of hot pixels in Poisson errors of their count: the share below the
/// limit follows from the mean excess, which is uncertain by as much. Chosen, not measured.
const HOT_SHARE_ERROR: f64 = 1.5;
/// Least difference of temperature, K, from the reference stack and from T_ref from which a stack
/// says something of the doubling: below it the error of the temperature itself counts most.
const TEMPERATURE_STEP_K: f64 = 2.0;
/// Least 1/T_d, 1/K: the effect's longest doubling is 100 K.
const MIN_INVERSE_DOUBLING: f64 = 0.01;

/// The dark current of a model with other figures.
fn with_dark_current(noise: &Noise, mean: f64, dsnu: f64, doubling_c: f64) -> DarkCurrent {
    DarkCurrent {
        mean_e_per_s: mean as f32,
        dsnu_e_per_s: dsnu as f32,
        doubling_c: doubling_c as f32,
        reference_c: noise.temperature_ref_c as f32,
    }
}

/// `hot-pixels`: outliers of the dark-current map; without one, of the offset map.
pub fn hot_pixels(e: &Evidence<'_>) -> Option<Proposal> {
    let (kind, per_unit) = match long_dark(e.design) {
        Some(_) => (MapKind::DarkCurrent, 1.0),
        None => {
            let c = &e.design.conditions[reference_dark(e.design)?];
            // A bias frame has no time for dark current.
            let exposure_s = Some(c.stack.exposure_s).filter(|t| *t > 0.0)?;
            (MapKind::Offset, 1.0 / (e.gain(c) * exposure_s))
        }
    };
    let s = &e.map(kind)?.spatial;
    let n = (s.rows.means.len() * s.columns.means.len()) as f64;
    let limit = OUTLIER_SD * s.pixel_variance.sqrt();
    let high = Count::new(s.high, e.predicted(Place::Map(kind), What::High)?);
    let noise = &e.camera.sensor.noise;
    let present = present(e.camera, "hot-pixels", "fraction").unwrap_or(0.0);
    if high.seen < 1.0 {
        return None;
    }
    // Beyond a limit an exponential law has its mean above it.
    let mean = ((s.high_sum / high.seen - limit) * per_unit).max(MIN_HOT * limit * per_unit);
    let more = (high.seen - high.expected).max(0.0);
    let fraction = if present > 0.0 {
        present * (high.seen / high.expected.max(1.0))
    } else {
        more / n * libm::exp(limit * per_unit / mean)
    };
    // The map was taken at the long stack's temperature. How hot pixels grow with it was not
    // looked at: the dark current's law serves.
    let growth = long_dark(e.design)
        .map_or(1.0, |i| dark_growth(noise, e.design.conditions[i].stack.temperature_c));
    let mean = mean / growth;
    let effect = HotPixels {
        fraction: fraction.min(MAX_HOT) as f32,
        mean_e_per_s: mean as f32,
        doubling_c: noise.dark_doubling_c as f32,
        reference_c: noise.temperature_ref_c as f32,
    };
    let se = fraction / more.max(1.0).sqrt() * HOT_SHARE_ERROR;
    let fraction = Value::new(fraction, se);
    let mean = Value { value: mean, std_error: mean / high.seen.sqrt() };
    let p = Proposal::new("hot-pixels", effect.into(), high.z);
    Some(p.with("fraction", fraction).with("mean_e_per_s", mean))
}

/// `dark-current`: its mean, its spread over pixels, and both.
pub fn dark_current(e: &Evidence<'_>) -> Vec<Proposal> {
    let noise = &e.camera.sensor.noise;
    let Some(reference) = reference_dark(e.design).map(|i| &e.design.conditions[i]) else {
        return Vec::new();
    };
    let (mean, dsnu) = (noise.dark_current_e_per_s, noise.dsnu_e_per_s);
    let propose = |mean: f64, dsnu: f64, strength: f64| {
        let effect = with_dark_current(noise, mean, dsnu, noise.dark_doubling_c);
        Proposal::new("dark-current", effect.into(), strength)
    };
    // Each as its significance, and the new value.
    let new_mean = mean_excess(e, reference)
        .map(|x| (x.z().abs(), Value { value: (mean + x.value).max(0.0), ..x }));
    let new_dsnu =
        variance_excess(e, reference).and_then(|x| Some((x.z().abs(), deviation(dsnu, x)?)));
    let of_mean = new_mean.map(|(z, m)| propose(m.value, dsnu, z).with("mean_e_per_s", m));
    let of_spread = new_dsnu.map(|(z, s)| propose(mean, s.value, z).with("dsnu_e_per_s", s));
    let of_both = new_mean.zip(new_dsnu).map(|((z, m), (z_of_spread, s))| {
        let p = propose(m.value, s.value, z.min(z_of_spread));
        p.with("mean_e_per_s", m).with("dsnu_e_per_s", s)
    });
    [of_mean, of_spread, of_both].into_iter().flatten().collect()
}

/// Excess of the mean dark current at T_ref, e⁻/s: of the map's median, where the few hot pixels
/// that a sensor happens to have make the means less certain, or else of these.
fn mean_excess(e: &Evidence<'_>, reference: &Condition) -> Option<Value> {
    let both = [rise_of_means(e, reference), excess_of_median(e)];
    both.into_iter().flatten().min_by(|a, b| a.std_error.total_cmp(&b.std_error))
}

/// Excess of the median of the dark-current map at T_ref, e⁻/s.
fn excess_of_median(e: &Evidence<'_>) -> Option<Value> {
    let long = &e.design.conditions[long_dark(e.design)?];
    let g = dark_growth(&e.camera.sensor.noise, long.stack.temperature_c);
    Some(e.difference(Place::Map(MapKind::DarkCurrent), What::Median)?.scaled(1.0 / g))
}

/// Excess of the rise of the mean with exposure, at the temperature of the reference stack, as
/// e⁻/s at T_ref.
fn rise_of_means(e: &Evidence<'_>, reference: &Condition) -> Option<Value> {
    let noise = &e.camera.sensor.noise;
    Value::combine(e.of_role(Role::Dark).flat_map(|(i, c)| {
        let time = c.stack.exposure_s - reference.stack.exposure_s;
        let usable = time > 0.0
            && same_temperature(&c.stack, &reference.stack)
            && c.before_e.iter().all(|&b| b == 0.0);
        let scale = e.gain(c) * time * dark_growth(noise, c.stack.temperature_c);
        (0..channel_count(e)).filter(move |_| usable).filter_map(move |k| {
            Some(e.difference(Place::Stack(i), What::Mean(k))?.scaled(1.0 / scale))
        })
    }))
}

/// Excess of the variance of dark current over pixels at T_ref, (e⁻/s)².
fn variance_excess(e: &Evidence<'_>, reference: &Condition) -> Option<Value> {
    let g = dark_growth(&e.camera.sensor.noise, reference.stack.temperature_c).powi(2);
    Some(e.difference(Place::Map(MapKind::DarkCurrent), What::PixelPattern)?.scaled(1.0 / g))
}

/// `dark-current-temperature`: the doubling, from dark stacks at other temperatures than the
/// reference.
pub fn doubling(e: &Evidence<'_>) -> Option<Proposal> {
    let noise = &e.camera.sensor.noise;
    let reference = &e.design.conditions[reference_dark(e.design)?];
    let all = e.of_role(Role::Dark).flat_map(|(i, _)| (0..channel_count(e)).map(move |k| (i, k)));
    let shift =
        Value::combine(all.filter_map(|(i, channel)| doubling_shift(e, reference, i, channel)))?;
    let inverse = 1.0 / noise.dark_doubling_c + shift.value;
    if inverse <= MIN_INVERSE_DOUBLING {
        return None;
    }
    let value = 1.0 / inverse;
    let effect = with_dark_current(noise, noise.dark_current_e_per_s, noise.dsnu_e_per_s, value);
    let p = Proposal::new("dark-current-temperature", effect.into(), shift.z().abs());
    Some(p.with("doubling_c", Value { value, std_error: shift.std_error * value * value }))
}

/// Estimate of 1/T_d minus that of the model, 1/K, from one channel of a dark stack:
/// ln 2 (T − T_ref)/T_d = ln 2 (T − T_ref)/T_d0 + ln ratio.
fn doubling_shift(
    e: &Evidence<'_>,
    reference: &Condition,
    stack: usize,
    channel: u8,
) -> Option<Value> {
    let (noise, c) = (&e.camera.sensor.noise, &e.design.conditions[stack]);
    let dt = c.stack.temperature_c - reference.stack.temperature_c;
    let from_ref = c.stack.temperature_c - noise.temperature_ref_c;
    let near = dt.abs() < TEMPERATURE_STEP_K || from_ref.abs() < TEMPERATURE_STEP_K;
    if near || c.before_e.iter().any(|&b| b > 0.0) {
        return None;
    }
    let d = e.difference(Place::Stack(stack), What::Mean(channel))?;
    let scale = e.gain(c) * c.stack.exposure_s;
    let model = noise.dark_current_e_per_s * dark_growth(noise, c.stack.temperature_c);
    let ratio = 1.0 + d.value / scale / model;
    if ratio <= 0.0 {
        return None;
    }
    let value = libm::log(ratio) / (std::f64::consts::LN_2 * from_ref);
    let se = d.std_error / scale / model / ratio / (std::f64::consts::LN_2 * from_ref.abs());
    Some(Value::new(value, se))
}

/// `dark-current-gradient`: the slope of the dark-current map.
pub fn gradient(e: &Evidence<'_>) -> Option<Proposal> {
    if current(e.camera, "dark-current-gradient").is_some() {
        return None;
    }
    let of = |i| e.difference(Place::Map(MapKind::DarkCurrent), What::Slope(i));
    let (x, y) = (of(0)?, of(1)?);
    let noise = &e.camera.sensor.noise;
    let long = &e.design.conditions[long_dark(e.design)?];
    let growth = dark_growth(noise, long.stack.temperature_c);
    // rate (1 + u cos θ)/2 has an amplitude of rate/(2√3) of √3 u.
    let rate = 2.0 * 3f64.sqrt() * libm::hypot(x.value, y.value) / growth;
    let direction = libm::atan2(y.value, x.value).to_degrees();
    let effect = DarkCurrentGradient {
        rate_e_per_s: rate as f32,
        direction_deg: direction as f32,
        doubling_c: noise.dark_doubling_c as f32,
        reference_c: noise.temperature_ref_c as f32,
    };
    // The gradient has a mean of rate/2, which the dark current had before.
    let mean = (noise.dark_current_e_per_s - rate / 2.0).max(0.0);
    let rest = with_dark_current(noise, mean, noise.dsnu_e_per_s, noise.dark_doubling_c);
    let rate = Value { value: rate, std_error: x.std_error * 2.0 * 3f64.sqrt() / growth };
    let se = (x.std_error / libm::hypot(x.value, y.value)).to_degrees();
    let p = Proposal::new("dark-current-gradient", effect.into(), libm::hypot(x.z(), y.z()));
    let p = p.and(rest.into()).with("rate_e_per_s", rate);
    Some(p.with("direction_deg", Value::new(direction, se)))
}
