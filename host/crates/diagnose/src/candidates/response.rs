//! The mean signal and its conversion: `black-level-offset`, `system-gain`, `quantum-efficiency`,
//! `nonlinearity`, `image-lag`, `exposure-offset`.
//!
//! From the mean of each channel of each stack, m, and the variance of its pixels over frames, v,
//! both in DN, and the model's predictions m' and v'. ⟨ ⟩ are inverse-variance means, slopes
//! go through the origin, µ is the charge by the light (e⁻) and K the system gain (DN/e⁻).
//!
//!   black level:        m − m' of the reference dark stack, DN; its slope over the analog gain;
//!                       and over the temperature; the contrasts of the 2 x 2 phases of the offset map
//!   quantum efficiency: ratio = ratio₀ (1 + ⟨m/m' − 1⟩) over the flats
//!   system gain:        ratio = ratio₀ (1 + ⟨(v/v')/(m/m') − 1⟩), by photon transfer
//!   nonlinearity:       m/m' − 1 = c − a xⁿ, x the level in full wells
//!   image lag:          fraction = fraction₀ + slope of m − m' over K µ of the frame before
//!   exposure offset:    offset = offset₀ + slope of m/m' − 1 over 1/exposure, s
//!
//! Where two of them act on the same figures, each is estimated with the other left free.

use super::common::{channel_count, present};
use super::proposal::Proposal;
use crate::data::design::{Condition, same_temperature};
use crate::evidence::{Evidence, slope};
use crate::model::effects::current;
use crate::numerics::minimise::minimum;
use crate::statistics::maps::{MapKind, reference_dark};
use crate::statistics::statistic::{Place, What};
use camrig_base::Value;
use camrig_camera::AnyEffect;
use camrig_captures::Role;
use camrig_linear::{Matrix, Singular, Vector, apply};
use camrig_sensor_core::effects::{
    Effect, black_level_offset::BlackLevelOffset, exposure_offset::ExposureOffset,
    quantum_efficiency::QuantumEfficiency, system_gain::SystemGain,
};

/// Longest exposure of a dark stack, in that of the reference, from which the change of the black
/// level with gain is taken: of longer ones it is the dark signal that changes.
const SHORT_DARK: f64 = 2.0;
/// Exponents n of the nonlinearity that are searched: from a parabola to a loss near saturation
/// alone. Within the range of the effect, 0.5 to 6.
const EXPONENTS: [f64; 2] = [1.0, 4.0];
/// Steps of the golden section between them, each 0.62 of the one before: 2e-4 is left.
const EXPONENT_STEPS: usize = 20;
/// Largest change of the exponent at a time, where the model has one.
const EXPONENT_CHANGE: f64 = 1.0;
/// Least number of means of flats from which a nonlinearity of three parameters is fitted.
const MIN_POINTS: usize = 4;
/// Least difference of temperature that shows a change of the black level, K.
const MIN_KELVINS: f64 = 2.0;
/// Singular values below this share of the largest one are taken as none.
const SINGULAR: f64 = 1e-9;
/// Least ratio of the longest to the shortest exposure of flats that shows an exposure offset.
const EXPOSURES_APART: f64 = 1.5;

/// Measured over predicted signal of a channel of a flat, less 1.
fn relative(e: &Evidence<'_>, stack: usize, channel: u8) -> Option<Value> {
    let place = Place::Stack(stack);
    let d = e.difference(place, What::Mean(channel))?;
    let m = e.predicted(place, What::Mean(channel))?;
    (m > 0.0).then(|| d.scaled(1.0 / m))
}

/// Flats whose light is known.
fn known_flats<'a>(e: &'a Evidence<'_>) -> impl Iterator<Item = (usize, &'a Condition)> {
    e.flats().filter(|(_, c)| c.level_known)
}

/// `black-level-offset`: all channels together, each of the four phases of a 2 x 2 pattern by
/// itself, and the change with gain.
pub fn black_level(e: &Evidence<'_>) -> Vec<Proposal> {
    let Some(reference) = reference_dark(e.design) else { return Vec::new() };
    let present = match current(e.camera, "black-level-offset") {
        Some(Effect::BlackLevelOffset(x)) => x,
        _ => BlackLevelOffset {
            offset_dn: 0.0,
            per_gain_dn: 0.0,
            per_second_dn: 0.0,
            plane_0_dn: 0.0,
            plane_1_dn: 0.0,
            plane_2_dn: 0.0,
            plane_3_dn: 0.0,
            per_kelvin_dn: 0.0,
            reference_c: e.camera.sensor.noise.temperature_ref_c as f32,
        },
    };
    let own: Vec<Value> = (0..channel_count(e))
        .filter_map(|c| e.difference(Place::Stack(reference), What::Mean(c)))
        .collect();
    if own.is_empty() {
        return Vec::new();
    }
    let n = own.len() as f64;
    let mean = own.iter().map(|o| o.value).sum::<f64>() / n;
    // Channels share rows and columns: their errors do not average.
    let se = own.iter().map(|o| o.std_error).sum::<f64>() / n;
    let mut common = present;
    common.offset_dn += mean as f32;
    let offset = f64::from(common.offset_dn);
    let all = Proposal::new("black-level-offset", common.into(), (mean / se).abs());
    let mut out = vec![all.with("offset_dn", Value::new(offset, se))];
    out.extend(black_level_by_phase(e, common, se));
    out.extend(black_level_over_gain(e, present, reference));
    out.extend(black_level_over_temperature(e, present, reference));
    out
}

/// Change of the `present` black level with temperature, DN: over the dark stacks that are as short
/// as the shortest and have its gain.
fn black_level_over_temperature(
    e: &Evidence<'_>,
    present: BlackLevelOffset,
    reference: usize,
) -> Option<Proposal> {
    let first = &e.design.conditions[reference].stack;
    let short = |c: &Condition| {
        c.stack.exposure_s <= SHORT_DARK * first.exposure_s
            && c.stack.analog_gain == first.analog_gain
    };
    let darks = e.of_role(Role::Dark).filter(|(_, c)| short(c));
    // The level at the reference temperature is free: the common offset.
    let points: Vec<(f64, Value)> = darks
        .flat_map(|(i, c)| {
            let kelvins = c.stack.temperature_c - f64::from(present.reference_c);
            let of = move |k| e.difference(Place::Stack(i), What::Mean(k));
            (0..channel_count(e)).filter_map(move |k| Some((kelvins, of(k)?)))
        })
        .collect();
    let weight = |v: &Value| v.std_error.powi(2).recip();
    let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
        points.iter().map(|(t, v)| weight(v) * of(*t, v.value)).sum()
    };
    let n = sum(&|_, _| 1.0);
    let (t, y) = (sum(&|t, _| t) / n, sum(&|_, y| y) / n);
    let spread = sum(&|k, _| (k - t).powi(2));
    if !(spread > 0.0) || points.iter().all(|p| (p.0 - points[0].0).abs() < MIN_KELVINS) {
        return None;
    }
    let slope = Value::new(sum(&|k, y| (k - t) * y) / spread, 1.0 / spread.sqrt());
    let mut moved = present;
    moved.per_kelvin_dn += slope.value as f32;
    moved.offset_dn += (y - slope.value * t) as f32;
    let p = Proposal::new("black-level-offset", moved.into(), slope.z().abs());
    let offset = Value::new(moved.offset_dn.into(), 1.0 / n.sqrt());
    let p = p.with("per_kelvin_dn", Value { value: moved.per_kelvin_dn.into(), ..slope });
    Some(p.with("reference_c", Value::chosen(moved.reference_c.into())).with("offset_dn", offset))
}

/// Black level of the four phases of a 2 x 2 pattern beside the `common` one, which has the
/// standard error `std_error`, DN: from the contrasts of the offset map.
fn black_level_by_phase(
    e: &Evidence<'_>,
    common: BlackLevelOffset,
    std_error: f64,
) -> Option<Proposal> {
    let of = |what| e.difference(Place::Map(MapKind::Offset), what);
    let rows = of(What::EveryOtherRow)?;
    let columns = of(What::EveryOtherColumn)?;
    let checkerboard = of(What::Checkerboard)?;
    let (r, c, x) = (rows.value, columns.value, checkerboard.value);
    let own = [r + c + x, r - c - x, c - r - x, x - r - c].map(|o| o / 2.0);
    let se_own =
        libm::hypot(libm::hypot(rows.std_error, columns.std_error), checkerboard.std_error) / 2.0;
    let mut apart = common;
    let parts = [
        ("plane_0_dn", &mut apart.plane_0_dn),
        ("plane_1_dn", &mut apart.plane_1_dn),
        ("plane_2_dn", &mut apart.plane_2_dn),
        ("plane_3_dn", &mut apart.plane_3_dn),
    ];
    let mut parameters = vec![("offset_dn", Value::new(f64::from(common.offset_dn), std_error))];
    for ((key, part), own) in parts.into_iter().zip(own) {
        *part += own as f32;
        parameters.push((key, Value { value: f64::from(*part), std_error: se_own }));
    }
    // Columns alone are what channels of the read-out do.
    let strength = libm::hypot(rows.z(), checkerboard.z());
    let mut p = Proposal::new("black-level-offset", apart.into(), strength);
    p.parameters = parameters;
    Some(p)
}

/// Change of the `present` black level with analog gain, DN: over the short dark stacks.
fn black_level_over_gain(
    e: &Evidence<'_>,
    present: BlackLevelOffset,
    reference: usize,
) -> Option<Proposal> {
    let c0 = &e.design.conditions[reference];
    let per_gain = slope(e.of_role(Role::Dark).flat_map(|(i, c)| {
        let short = c.stack.exposure_s <= SHORT_DARK * c0.stack.exposure_s
            && same_temperature(&c.stack, &c0.stack);
        let wanted = (0..channel_count(e)).filter(move |_| short && i != reference);
        let of = move |k| e.difference(Place::Stack(i), What::Mean(k));
        wanted.filter_map(move |k| Some((c.stack.analog_gain - c0.stack.analog_gain, of(k)?)))
    }))?;
    let mut moved = present;
    moved.per_gain_dn += per_gain.value as f32;
    let p = Proposal::new("black-level-offset", moved.into(), per_gain.z().abs());
    Some(p.with("per_gain_dn", Value { value: moved.per_gain_dn.into(), ..per_gain }))
}

/// Common factor of the means of all flats, less 1.
fn common_factor(e: &Evidence<'_>) -> Option<Value> {
    Value::combine(
        known_flats(e)
            .flat_map(|(i, _)| (0..channel_count(e)).filter_map(move |k| relative(e, i, k))),
    )
}

/// Variance over mean of the flats in that of the model, less 1: photon transfer, with the model's
/// dark variance.
fn transfer_factor(e: &Evidence<'_>) -> Option<Value> {
    Value::combine(e.flats().filter_map(|(i, c)| {
        let (vd, vm) = e.variance(i)?;
        let se = e.variance_excess(i)?.std_error / vm;
        let means = if c.level_known { relative(e, i, 0)?.value } else { 0.0 };
        Some(Value::new(vd / vm / (1.0 + means) - 1.0, se))
    }))
}

/// The system gain of the model over that of the camera, where it has a `system-gain` effect.
fn present_gain(e: &Evidence<'_>) -> Option<f64> {
    present(e.camera, "system-gain", "ratio")
}

/// The quantum efficiency of the model over that of the camera, where it has a
/// `quantum-efficiency` effect.
fn present_efficiency(e: &Evidence<'_>) -> Option<f64> {
    present(e.camera, "quantum-efficiency", "ratio")
}

/// The effect with a quantum efficiency over that of the camera.
fn with_efficiency(ratio: f64) -> AnyEffect {
    AnyEffect::Sensor(QuantumEfficiency { ratio: ratio as f32 }.into())
}

/// `system-gain`: signal and noise larger than the model's alike, by means and by photon transfer.
/// Where the model has a quantum efficiency of its own, by photon transfer alone, and the
/// efficiency keeps the means.
pub fn system_gain(e: &Evidence<'_>) -> Option<Proposal> {
    let present = present_gain(e).unwrap_or(1.0);
    let efficiency = present_efficiency(e);
    let (mean, transfer) = (common_factor(e), transfer_factor(e));
    let f = match efficiency {
        Some(_) => transfer?,
        None => Value::combine(mean.into_iter().chain(transfer))?,
    };
    let ratio = Value { value: present * (1.0 + f.value), std_error: present * f.std_error };
    let mut p = Proposal::of("system-gain", f.z().abs(), [("ratio", ratio)])?;
    if let (Some(efficiency), Some(mean)) = (efficiency, mean) {
        p.revised.push(with_efficiency(efficiency * (1.0 + mean.value) / (1.0 + f.value)));
    }
    Some(p)
}

/// `quantum-efficiency`: signal larger than the model's at the same gain. Where the model has a
/// gain of its own, at the gain that photon transfer gives.
pub fn quantum_efficiency(e: &Evidence<'_>) -> Option<Proposal> {
    let present = present_efficiency(e).unwrap_or(1.0);
    let mean = common_factor(e)?;
    let (f, revised) = match present_gain(e) {
        Some(gain) => {
            let transfer = transfer_factor(e)?;
            let value = (1.0 + mean.value) / (1.0 + transfer.value) - 1.0;
            let ratio = gain * (1.0 + transfer.value);
            let se = libm::hypot(mean.std_error, transfer.std_error);
            let gain = AnyEffect::Sensor(SystemGain { ratio: ratio as f32 }.into());
            (Value::new(value, se), vec![gain])
        }
        None => (mean, Vec::new()),
    };
    let ratio = Value { value: present * (1.0 + f.value), std_error: present * f.std_error };
    let mut p = Proposal::of("quantum-efficiency", f.z().abs(), [("ratio", ratio)])?;
    p.revised = revised;
    Some(p)
}

/// The quantum efficiency, where the model has one of its own, beside an effect that multiplies
/// the means of flats by `factor`.
pub fn efficiency_beside(e: &Evidence<'_>, factor: f64) -> Option<AnyEffect> {
    Some(with_efficiency(present_efficiency(e)? * (1.0 + common_factor(e)?.value) / factor))
}

/// A fit of m/m' − 1 = c − a xⁿ − b l xⁿ ln x: b is the change of the exponent of a loss l.
struct Bend {
    /// c, 0 where it is not free.
    scale: f64,
    /// a and b.
    values: [Value; 2],
    /// χ² left.
    left: f64,
    /// Fall of χ² by a and b.
    fell: f64,
}

/// Least squares over points of x and m/m' − 1; `free` says whether c is. `None` where the points
/// do not allow it.
fn bend(points: &[(f64, Value)], free: bool, n: f64, l: f64) -> Option<Bend> {
    let weighted = |f: &dyn Fn(f64) -> f64| {
        Vector::from_iterator(points.len(), points.iter().map(|(x, r)| f(*x) / r.std_error))
    };
    let y = Vector::from_iterator(points.len(), points.iter().map(|(_, r)| r.value / r.std_error));
    let scale = weighted(&|_| f64::from(u8::from(free)));
    let unbent = match scale.norm_squared() {
        0.0 => y.clone(),
        norm => &y - &scale * (scale.dot(&y) / norm),
    };
    let columns = [
        scale,
        weighted(&|x| -libm::pow(x, n)),
        weighted(&|x| -l * libm::pow(x, n) * libm::log(x)),
    ];
    let a = Matrix::from_columns(&columns);
    let singular = Singular::of(&a);
    let least = SINGULAR * singular.largest();
    let solved = singular.solve(&y, least)?;
    let inverse = singular.pseudo_inverse(least)?;
    let value = |i: usize| Value { value: solved[i], std_error: inverse.row(i).norm() };
    let left = (&y - apply(&a, &solved)).norm_squared();
    let fell = (unbent.norm_squared() - left).max(0.0);
    Some(Bend { scale: solved[0], values: [value(1), value(2)], left, fell })
}

/// `nonlinearity`: a loss a xⁿ at x full wells, with the scale of the light free and with it as
/// known. Where the model has a quantum efficiency of its own, that keeps the scale.
pub fn nonlinearity(e: &Evidence<'_>) -> Vec<Proposal> {
    let points = levels_and_signals(e);
    if points.len() < MIN_POINTS {
        return Vec::new();
    }
    let scales: &[bool] = if present_efficiency(e).is_some() { &[true] } else { &[true, false] };
    let mut out: Vec<Proposal> =
        scales.iter().filter_map(|&free| with_scale(e, &points, free)).collect();
    out.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    out
}

/// Level in full wells, and m/m' − 1, of each channel of the flats.
fn levels_and_signals(e: &Evidence<'_>) -> Vec<(f64, Value)> {
    let full = e.camera.sensor.full_well_e;
    known_flats(e)
        .flat_map(|(i, c)| {
            let levels = e.levels(i).into_iter().map(move |level| level / e.gain(c) / full);
            (0..).zip(levels).filter_map(move |(k, x)| Some((x, relative(e, i, k)?)))
        })
        .filter(|(x, _)| *x > 0.0)
        .collect()
}

/// The nonlinearity with the scale of the light free or as known.
fn with_scale(e: &Evidence<'_>, points: &[(f64, Value)], free: bool) -> Option<Proposal> {
    let (loss, exponent, fit) = match current(e.camera, "nonlinearity") {
        // In the model already: what is to be added to its loss and exponent.
        Some(Effect::Nonlinearity(x)) => {
            let (loss, n) = (f64::from(x.loss), f64::from(x.exponent));
            let fit = bend(points, free, n, loss)?;
            let change = fit.values[1].value.clamp(-EXPONENT_CHANGE, EXPONENT_CHANGE);
            (loss + fit.values[0].value, n + change, fit)
        }
        _ => {
            let left = |n| bend(points, free, n, 0.0).map_or(f64::MAX, |f| f.left);
            let n = minimum(EXPONENTS[0], EXPONENTS[1], EXPONENT_STEPS, left);
            let straight = bend(points, free, n, 0.0)?;
            let loss = straight.values[0].value;
            let values = bend(points, free, n, loss)?.values;
            (loss, n, Bend { values, ..straight })
        }
    };
    let exponent = exponent.clamp(EXPONENTS[0], EXPONENTS[1]);
    let loss = Value { value: loss, ..fit.values[0] };
    let exponent = Value { value: exponent, ..fit.values[1] };
    let law = [("loss", loss), ("exponent", exponent)];
    let mut p = Proposal::of("nonlinearity", fit.fell.sqrt(), law)?;
    p.revised.extend(present_efficiency(e).map(|r| with_efficiency(r * (1.0 + fit.scale))));
    Some(p)
}

/// `image-lag`: light of the frame before in a dark frame.
pub fn image_lag(e: &Evidence<'_>) -> Option<Proposal> {
    let after = slope(e.of_role(Role::Dark).flat_map(|(i, c)| {
        let k = e.gain(c);
        (0..).zip(&c.before_e).filter_map(move |(channel, before)| {
            Some((before * k, e.difference(Place::Stack(i), What::Mean(channel))?))
        })
    }))?;
    let present = present(e.camera, "image-lag", "fraction").unwrap_or(0.0);
    let fraction = Value { value: (present + after.value).max(0.0), ..after };
    Proposal::of("image-lag", after.z().abs(), [("fraction", fraction)])
}

/// `exposure-offset`: signal over exposure, against one over exposure.
pub fn exposure_offset(e: &Evidence<'_>) -> Option<Proposal> {
    let points: Vec<(f64, Value)> = known_flats(e)
        .flat_map(|(i, c)| {
            let of = move |k| Some((1.0 / c.stack.exposure_s, relative(e, i, k)?));
            (0..channel_count(e)).filter_map(of)
        })
        .collect();
    let (least, most) =
        points.iter().fold((f64::MAX, 0.0f64), |(a, b), p| (a.min(p.0), b.max(p.0)));
    if most < EXPOSURES_APART * least {
        return None;
    }
    let found = slope(points)?;
    let (present, step) = match current(e.camera, "exposure-offset") {
        Some(Effect::ExposureOffset(x)) => (f64::from(x.offset_us), x.step_us),
        _ => (0.0, 0.0),
    };
    let offset = present + found.value * 1e6;
    let effect = ExposureOffset { offset_us: offset as f32, step_us: step };
    let p = Proposal::new("exposure-offset", effect.into(), found.z().abs());
    Some(p.with("offset_us", Value { value: offset, std_error: found.std_error * 1e6 }))
}
