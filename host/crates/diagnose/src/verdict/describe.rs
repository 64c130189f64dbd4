//! Statistics that a model leaves unexplained, in sentences that a person can act on.

use super::whereabouts::whereabouts;
use super::words;
use crate::measured::Measured;
use crate::model::effects::dn_per_e;
use crate::search::Evaluation;
use crate::statistics::statistic::{Key, Place, Scale, What};
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
            format!("{m:.3} times what white noise gives, the model {p:.3}, at {exposure} s")
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
