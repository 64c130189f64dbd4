//! Statistics that a model leaves unexplained, in sentences that a person can act on.

use super::whereabouts::whereabouts;
use super::words;
use crate::measured::Measured;
use crate::model::effects::dn_per_e;
use crate::search::Evaluation;
use crate::statistics::maps::MapKind;
use crate::statistics::statistic::{Key, Place, Scale, What};
use crate::statistics::temporal::BLOCK;
use camrig_base::numbers::plain;

/// A statistic that a model leaves unexplained, `z` standard deviations from it: how far, in units
/// that a person knows, and where. Empty where it was not measured or is not predicted.
pub(super) fn describe(measured: &Measured, model: &Evaluation, key: Key, z: f64) -> String {
    let value = measured.fit.values.get(&key).map(|s| s.value);
    let predicted = model.fit.of.get(&key).map(|p| p.value);
    let (Some(m), Some(p)) = (value, predicted) else { return String::new() };
    let statistic = words::name(&model.camera, key);
    let place = words::place(&measured.fit.design, key);
    let more = if z > 0.0 { "more" } else { "less" };
    let condition = |i: usize| measured.fit.design.conditions.get(i);
    let gain = |i| condition(i).map_or(1.0, |c| dn_per_e(&model.camera, c.stack.analog_gain));
    let level = |dn_per_e: f64| {
        let off = (m - p).abs();
        format!("{off:.3} DN ({:.2} e⁻) {more} than the model's {p:.2} DN", off / dn_per_e)
    };
    let size = match (key.0, key.1) {
        (Place::Stack(i), What::Mean(_)) => level(gain(i)),
        (Place::Stack(_), What::Ratio(_)) => {
            format!("{m:.6}, {:.4} % {more} than the model's {p:.6}", 100.0 * (m / p - 1.0).abs())
        }
        (Place::Stack(i), What::Variance(_)) => {
            let k = gain(i);
            let root = (m - p).abs().sqrt();
            format!("{root:.3} DN ({:.2} e⁻) rms {more} noise than the model", root / k)
        }
        (
            Place::Stack(i),
            What::RowVariance | What::ColumnVariance | What::FrameVariance | What::BlockVariance,
        ) => {
            let exposure = condition(i).map_or(0.0, |c| c.stack.exposure_s);
            let rms = rms_of_means(measured, key, m - p);
            format!(
                "{m:.3} times what white noise gives, the model {p:.3}: {rms:.3} DN ({:.2} e⁻) rms \
                 {more} than the model, at {exposure} s",
                rms / gain(i)
            )
        }
        (Place::Map(kind), what) if has_unit(what) => {
            let (unit, per_own) = unit_of(kind);
            let root = matches!(what, What::PixelPattern | What::RowPattern | What::ColumnPattern);
            let [m, p] = [m, p].map(|v| per_own * if root { v.max(0.0).sqrt() } else { v });
            let rms = if root { " rms" } else { "" };
            format!("{} {unit}{rms}, the model {} {unit}", plain(m), plain(p))
        }
        (Place::Target(i), What::Of(figure)) if figure.is_level() => {
            let gain = measured.fit.design.targets.get(i).map_or(1.0, |t| t.stack.analog_gain);
            level(dn_per_e(&model.camera, gain))
        }
        _ => match model.fit.of.get(&key).map(|x| x.scale) {
            Some(Scale::Log) => format!(
                "{}, {:.1} % {more} than the model's {}",
                plain(m),
                100.0 * (m / p - 1.0).abs(),
                plain(p)
            ),
            _ => format!("{m:.4}, the model {p:.4}"),
        },
    };
    let mut sentence = format!("{statistic} in {place}: {size} ({z:+.1} standard deviations)");
    if let Some(more) = whereabouts(measured, key) {
        sentence = format!("{sentence}; {more}");
    }
    sentence
}

/// The root mean square, DN, of means of lines, blocks or frames whose variance is so many times
/// that of white noise.
fn rms_of_means(measured: &Measured, (place, what): Key, times: f64) -> f64 {
    let Place::Stack(i) = place else { return f64::NAN };
    let values = measured.fit.values.iter();
    let own = values.filter(|(key, _)| key.0 == place && matches!(key.1, What::Variance(_)));
    let (sum, count) = own.fold((0.0, 0.0), |(sum, n), (_, s)| (sum + s.value, n + 1.0));
    let (w, h) = measured.fit.stacks.get(i).map_or((1, 1), |t| (t.width, t.height));
    let pixels = match what {
        What::RowVariance => w,
        What::ColumnVariance => h,
        What::BlockVariance => BLOCK * BLOCK,
        _ => w * h,
    };
    (times.abs() * sum / f64::max(count, 1.0) / pixels as f64).sqrt()
}

/// Whether a statistic of a map is in the map's unit, or that squared.
fn has_unit(what: What) -> bool {
    matches!(
        what,
        What::PixelPattern
            | What::RowPattern
            | What::ColumnPattern
            | What::Slope(_)
            | What::Corner(_)
            | What::EveryOtherRow
            | What::EveryOtherColumn
            | What::Checkerboard
            | What::Median
    )
}

/// The unit of a map for people, and how many of it are the map's own.
fn unit_of(map: MapKind) -> (&'static str, f64) {
    match map {
        MapKind::Gain | MapKind::Curvature => ("%", 100.0),
        MapKind::DarkCurrent => ("e⁻/s", 1.0),
        MapKind::Offset | MapKind::AfterLight => ("DN", 1.0),
    }
}
