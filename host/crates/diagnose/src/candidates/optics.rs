//! Effects that captures of targets (edges, dots, charts) show: `defocus`, `distortion`,
//! `lateral-colour`, `decentre-tilt`, `lens-transmittance`, `f-number`, `veiling-glare`,
//! `optical-crosstalk`; and the shadings, `relative-illumination` and `colour-shading`, which the gain map shows as
//! well.
//!
//! Every figure of the targets depends a little on every parameter. How much, J, is found by
//! simulation: the optics stage and one replicate with the parameter moved by a step, with the
//! same random numbers. With y measured and y' predicted figures on the scale on which they are
//! normal, of standard deviation σ, the changes Δ of the parameters, in the parameters' units,
//! minimise
//!
//!   Σ ((y − y' − Σ_p J_p Δ_p)/σ)².
//!
//! The fall-off of the gain map, which shadings alone move, is among the figures. Free are the
//! parameters of the kind and those that the model has of kinds named earlier, so that these give
//! back what they had absorbed of it; a quantum efficiency gives back the mean of a shading. The
//! search repeats the estimate with the same J (the chord method), and at its end with new ones.

use super::proposal::{MIN_STRENGTH, Proposal};
use super::response;
use crate::data::channels::Channels;
use crate::evidence::{Evidence, Slope};
use crate::model::effects;
use crate::statistics::shading;
use crate::statistics::statistic::{Key, Place, Statistic};
use camrig_base::Value;
use camrig_camera::{AnyEffect, Camera, LensKind};
use camrig_linear::{LeastSquares, Matrix, Vector, inverse, quadratic};
use camrig_sensor_core::effects::Parameter;

/// A parameter that is estimated.
struct Free {
    /// Key in the catalogue.
    key: &'static str,
    /// Value with which the effect does nothing, in the catalogue's unit.
    neutral: f64,
    /// Step for the derivative, in the catalogue's unit: large enough to stand out from the
    /// rounding of the figures, small enough for them to be linear. Of `defocus` see [`blur`].
    step: f64,
}

const fn free(key: &'static str, neutral: f64, step: f64) -> Free {
    Free { key, neutral, step }
}

/// Kinds with their parameters. `size`, k1, k2 and the shadings are relative; _px are pixels.
const KINDS: [(&str, &[Free]); 10] = [
    ("defocus", &[free("shift_um", 0.0, 0.0)]),
    ("distortion", &[free("size", 1.0, 0.002), free("k1", 0.0, 0.004), free("k2", 0.0, 0.004)]),
    ("lateral-colour", &[free("blue_px", 0.0, 0.3), free("red_px", 0.0, 0.3)]),
    ("decentre-tilt", &[free("x_px", 0.0, 4.0), free("y_px", 0.0, 4.0)]),
    ("lens-transmittance", &[free("factor", 1.0, -0.02), free("slope", 0.0, 0.01)]),
    ("f-number", &[free("light", 1.0, -0.05)]),
    ("veiling-glare", &[free("fraction", 0.0, 0.01)]),
    ("relative-illumination", &[free("corner", 0.0, 0.02)]),
    (
        "colour-shading",
        &[
            free("channel_0", 0.0, 0.02),
            free("channel_1", 0.0, 0.02),
            free("channel_2", 0.0, 0.02),
        ],
    ),
    ("optical-crosstalk", &[free("side", 0.0, 0.01)]),
];

/// Significance, standard errors, that each further parameter must add for a kind to have it: the
/// price of a parameter is its square in the sum of squares. It is that from which candidates are
/// simulated.
const KEEP: f64 = MIN_STRENGTH;
/// Price of a second kind, in parameters: where a shading of single channels and the one that they
/// share need as many parameters, the one kind is preferred.
const SECOND_KIND: f64 = 0.5;
/// Largest deviation, standard deviations, of figures that agree with the model. A kind that is
/// not named is not estimated where all agree.
const AGREES: f64 = MIN_STRENGTH;
/// Least share of a parameter's effect, squared, that the other free parameters must leave; below
/// it they are confounded, and the normal equations singular but for rounding.
const APART: f64 = 1e-4;
/// Least norm, standard deviations per unit, of what a parameter does to the figures; below it is
/// rounding, and the parameter does nothing.
const MIN_CHANGE: f64 = 1e-9;
/// Least standard deviation of a figure on its scale: a divisor that is not 0.
const MIN_SD: f64 = 1e-12;
/// Secant steps for `defocus`, which acts by its square.
const SECANTS: usize = 4;
/// Largest growth of the shift from one secant step to the next: blur saturates, and a longer step
/// would leave what was seen.
const SECANT_GROWTH: f64 = 3.0;
/// Relative change of the shift below which the secant steps end: the search estimates it again.
const SECANT_SETTLED: f64 = 0.1;
/// Where the model has a defocus, its derivative is taken over this factor of the shift.
const DEFOCUS_STEP: f64 = 1.1;
/// First shift, µm, for a lens whose f-number is not known: a quarter wave at f/3.
const UNKNOWN_LENS_SHIFT_UM: f64 = 10.0;
/// Shift for a quarter wave at the edge of the pupil over the square of the f-number, µm:
/// 8 λ/4 at 550 nm.
const QUARTER_WAVE_UM: f64 = 1.1;

/// A parameter of a kind, as a column of the least squares.
#[derive(Clone)]
struct Column {
    kind: &'static str,
    key: &'static str,
    /// What a unit of it does to every figure, in standard deviations.
    change: Vector,
    /// Whether the model has another value than that which does nothing.
    present: bool,
    /// Whether it moves figures of maps.
    in_maps: bool,
}

/// What the model leaves of the figures.
struct Residual {
    keys: Vec<Key>,
    /// Standard deviation of each figure on its scale.
    sd: Vec<f64>,
    /// Measured less predicted, in standard deviations.
    z: Vector,
}

/// Whether a kind is estimated from captures of targets.
pub fn shown_by_targets(kind: &str) -> bool {
    KINDS.iter().any(|k| k.0 == kind)
}

/// The proposal of a kind of this file. `None` where no figure deviates, or none shows the kind.
pub fn estimate(e: &Evidence<'_>, kind: &'static str) -> Option<Proposal> {
    let residual = Residual::of(e);
    // A kind that is named is estimated all the same: figures that each agree may together say
    // more.
    if !e.named.contains(&kind) && residual.z.iter().all(|z| z.abs() < AGREES) {
        return None;
    }
    let colours = e.camera.sensor.channel_names.len();
    if matches!(kind, "lateral-colour" | "colour-shading") && colours < 2 {
        return None;
    }
    propose(e, kind, &residual)
}

fn propose(e: &Evidence<'_>, kind: &'static str, residual: &Residual) -> Option<Proposal> {
    let mut columns = columns(e, kind, residual);
    let own = columns.len();
    for other in e.named.iter().filter(|k| **k != kind) {
        columns.extend(self::columns(e, other, residual).into_iter().filter(|c| c.present));
    }
    // A shading that the channels share takes one parameter; in addition, those of single channels
    // need as many fewer.
    let shared = match kind {
        "colour-shading" => self::columns(e, "relative-illumination", residual),
        _ => Vec::new(),
    };
    let shared = shared.into_iter().find(|c| !c.present);
    let free = choose(&columns, own, shared, residual)?;
    proposal(e, kind, &columns, own, &Solution::of(&columns, &free, residual)?)
}

/// The columns to be free: of the kind's own (the first `own`) those that the model has and those
/// that are worth their price, and all columns of other kinds. `None` where none of the kind's own
/// is. `shared`, a column of another kind, competes with the kind's own for what they explain.
fn choose(
    columns: &[Column],
    own: usize,
    shared: Option<Column>,
    residual: &Residual,
) -> Option<Vec<usize>> {
    let others = own..columns.len();
    let all: Vec<Column> = columns.iter().cloned().chain(shared).collect();
    let may: Vec<usize> =
        (0..own).chain(columns.len()..all.len()).filter(|&i| !all[i].present).collect();
    let must: Vec<usize> = (0..own).filter(|&i| all[i].present).collect();
    let sets = (0u32..1 << may.len()).map(|set| {
        let taken = may.iter().enumerate().filter(|(bit, _)| set >> bit & 1 == 1).map(|(_, i)| *i);
        must.iter().copied().chain(taken).collect::<Vec<usize>>()
    });
    let worth = |set: &[usize]| {
        let free: Vec<usize> = set.iter().copied().chain(others.clone()).collect();
        let second = if set.iter().any(|&i| i >= columns.len()) { SECOND_KIND } else { 0.0 };
        let cost = KEEP * KEEP * ((set.len() - must.len()) as f64 + second);
        let fall = if free.is_empty() { 0.0 } else { Solution::of(&all, &free, residual)?.fall };
        Some(fall - cost)
    };
    let (_, best) =
        sets.filter_map(|set| Some((worth(&set)?, set))).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let mine: Vec<usize> = best.into_iter().filter(|&i| i < own).collect();
    (!mine.is_empty()).then(|| mine.into_iter().chain(others).collect())
}

/// The proposal of a solution: new values of the kind's own parameters, and of those of other
/// kinds that gave back what they had absorbed.
fn proposal(
    e: &Evidence<'_>,
    kind: &'static str,
    columns: &[Column],
    own: usize,
    solution: &Solution,
) -> Option<Proposal> {
    let mut camera = e.camera.clone();
    let mut parameters = Vec::new();
    for (i, change) in &solution.estimates {
        let column = &columns[*i];
        let value = moved(e.camera, column.kind, column.key, *change)?;
        camera = with(&camera, column.kind, column.key, value.value)?;
        if *i < own {
            parameters.push((column.key, value));
        }
    }
    let mut p = Proposal::from_targets(kind, solution.strength(own)?);
    p.of_targets = !columns[..own].iter().any(|c| c.in_maps);
    p.parameters = parameters;
    for k in std::iter::once(kind).chain(e.named.iter().copied().filter(|k| *k != kind)) {
        let effects = if k == kind { &mut p.effects } else { &mut p.revised };
        effects.push(effects::of_camera(&camera, k)?);
    }
    if !p.of_targets {
        let mean = mean_shading(&camera)? / mean_shading(e.camera)?;
        p.revised.extend(response::efficiency_beside(e, mean));
    }
    Some(p)
}

/// What shadings leave of the mean light of a frame, as a factor: with r = 1 at the corners r² is
/// 1/3 on average. `None` where that is no light.
fn mean_shading(camera: &Camera) -> Option<f64> {
    let channels = Channels::new(camera);
    let of_channel = |(c, share): (usize, f64)| {
        share * value(camera, "colour-shading", &format!("channel_{c}"))
    };
    let by_channel: f64 = channels.shares().into_iter().enumerate().map(of_channel).sum();
    let common = value(camera, "relative-illumination", "corner");
    let mean = (1.0 + common / 3.0) * (1.0 + by_channel / 3.0);
    (mean > 0.0).then_some(mean)
}

impl Residual {
    /// Of all figures of targets, and of the fall-off of the gain map.
    fn of(e: &Evidence<'_>) -> Self {
        let mut out = Self { keys: Vec::new(), sd: Vec::new(), z: Vector::zeros(0) };
        let mut z = Vec::new();
        let of_falls = |what| shading::slope(what, None, 0).is_some();
        let wanted = |k: &Key| matches!(k.0, Place::Target(_)) || of_falls(k.1);
        for (key, s) in e.data.iter().filter(|(k, _)| wanted(k)) {
            let Some(p) = e.model.of.get(key) else { continue };
            let sd = libm::hypot(p.sd, e.allowance.get(key).copied().unwrap_or(0.0)).max(MIN_SD);
            out.keys.push(*key);
            out.sd.push(sd);
            z.push((p.scale.of(s.value) - p.scaled) / sd);
        }
        out.z = Vector::from_vec(z);
        out
    }

    /// A derivative with every figure in its standard deviations.
    fn scaled(&self, slope: &Slope) -> Vector {
        let at = |(key, sd): (&Key, &f64)| slope.get(key).copied().unwrap_or(0.0) / sd;
        Vector::from_iterator(self.keys.len(), self.keys.iter().zip(&self.sd).map(at))
    }
}

/// The columns of a kind. Parameters that do nothing, or cannot be moved in this camera, are left
/// out.
fn columns(e: &Evidence<'_>, kind: &'static str, residual: &Residual) -> Vec<Column> {
    let Some((_, free)) = KINDS.iter().find(|k| k.0 == kind) else { return Vec::new() };
    // A decentred axis shows only in effects that are symmetric about it.
    let about_axis = |k: &&&str| matches!(**k, "distortion" | "lateral-colour");
    let symmetric = match kind {
        "decentre-tilt" => e.named.iter().filter(about_axis).count(),
        _ => 0,
    };
    let all = free.iter().filter_map(|&Free { key, neutral, step }| {
        let value = value(e.camera, kind, key);
        let mut slope = e.slopes.of((kind, key, value != 0.0, symmetric), || match kind {
            "defocus" => blur(e, residual),
            _ => derivative(e, kind, key, step),
        })?;
        let in_maps = in_maps(e.camera, kind, key, residual);
        slope.extend(&in_maps);
        let change = residual.scaled(&slope);
        let in_maps = in_maps.values().any(|s| *s != 0.0);
        let present = value as f32 != neutral as f32;
        (change.norm() > MIN_CHANGE).then_some(Column { kind, key, change, present, in_maps })
    });
    all.collect()
}

/// What a unit of a shading does to the fall-off of the gain map; nothing for other kinds.
fn in_maps(camera: &Camera, kind: &str, key: &str, residual: &Residual) -> Slope {
    let channel = match kind {
        "relative-illumination" => None,
        "colour-shading" => key.strip_prefix("channel_").and_then(|c| c.parse().ok()),
        _ => return Slope::new(),
    };
    let widest = Channels::new(camera).densest();
    let of = |k: &Key| Some((*k, shading::slope(k.1, channel, widest)?));
    residual.keys.iter().filter_map(of).collect()
}

/// Change of every figure, on its scale, per unit of a parameter, over a step of it.
fn derivative(e: &Evidence<'_>, kind: &str, key: &str, step: f64) -> Option<Slope> {
    let present = value(e.camera, kind, key);
    // At the end of the range the other way.
    let to = with(e.camera, kind, key, present + step)
        .or_else(|| with(e.camera, kind, key, present - step))?;
    let step = value(&to, kind, key) - present;
    slope(e, &to, step)
}

/// Change of every figure, on its scale, from the model to a camera, over `step`.
fn slope(e: &Evidence<'_>, to: &Camera, step: f64) -> Option<Slope> {
    let from = (e.simulate_targets)(e.camera).ok()?;
    let to = (e.simulate_targets)(to).ok()?;
    let change = |(key, b): (&Key, &Statistic)| {
        let a = from.get(key)?;
        Some((*key, (b.scale.of(b.value) - a.scale.of(a.value)) / step))
    };
    Some(to.iter().filter_map(change).collect())
}

/// What defocus does to every figure, on its scale, per µm² of its square: a lens in focus does
/// not change with the first power. Since blur saturates, the slope is that of the secant to the
/// shift that the residual alone would have.
fn blur(e: &Evidence<'_>, residual: &Residual) -> Option<Slope> {
    let present = value(e.camera, "defocus", "shift_um");
    let mut shift =
        if present == 0.0 { quarter_wave_um(e.camera) } else { DEFOCUS_STEP * present };
    let mut best = None;
    for _ in 0..SECANTS {
        let to = with(e.camera, "defocus", "shift_um", shift)?;
        let slope = slope(e, &to, shift * shift - present * present)?;
        let change = residual.scaled(&slope);
        let wanted = present * present + change.dot(&residual.z) / change.norm_squared();
        best = Some(slope);
        if present != 0.0 || wanted <= 0.0 {
            break;
        }
        let next = wanted.sqrt().min(SECANT_GROWTH * shift);
        if (next / shift - 1.0).abs() < SECANT_SETTLED {
            break;
        }
        shift = next;
    }
    best
}

/// Shift for a quarter wave at the edge of the pupil, µm: δ = 8 N² λ/4.
fn quarter_wave_um(camera: &Camera) -> f64 {
    match camera.lens.kind {
        LensKind::DiffractionLimited { f_number, .. } => QUARTER_WAVE_UM * f_number * f_number,
        _ => UNKNOWN_LENS_SHIFT_UM,
    }
}

/// Least squares over some columns.
struct Solution {
    /// Index of a column and change of its parameter, in the parameter's unit.
    estimates: Vec<(usize, Value)>,
    /// Covariance of the changes.
    covariance: Matrix,
    /// By how much the sum of squares falls.
    fall: f64,
}

impl Solution {
    /// Over the columns with the indices `free`. `None` where some of them are confounded.
    fn of(columns: &[Column], free: &[usize], residual: &Residual) -> Option<Self> {
        if free.is_empty() {
            return None;
        }
        let norms: Vec<f64> = free.iter().map(|&i| columns[i].change.norm()).collect();
        // Columns of unit length: their units have no influence on what counts as confounded.
        let a = Matrix::from_fn(residual.z.len(), free.len(), |row, k| {
            columns[free[k]].change[row] / norms[k]
        });
        let fit = LeastSquares::of(&a, &residual.z)?;
        // Diagonal of the inverse: one over the share of each column that the others leave.
        if fit.covariance.diagonal().iter().any(|d| !(*d > 0.0 && *d < 1.0 / APART)) {
            return None;
        }
        let estimates = free.iter().enumerate().map(|(k, &i)| {
            let se = fit.covariance[(k, k)].sqrt() / norms[k];
            (i, Value::new(fit.coefficients[k] / norms[k], se))
        });
        let estimates = estimates.collect();
        let covariance = Matrix::from_fn(free.len(), free.len(), |r, c| {
            fit.covariance[(r, c)] / (norms[r] * norms[c])
        });
        Some(Self { estimates, covariance, fall: residual.z.norm_squared() - fit.chi2 })
    }

    /// Distance of the kind's own parameters from what the model has, in standard errors.
    fn strength(&self, own: usize) -> Option<f64> {
        let mine: Vec<usize> =
            (0..self.estimates.len()).filter(|&k| self.estimates[k].0 < own).collect();
        let n = mine.len();
        let block = Matrix::from_fn(n, n, |r, c| self.covariance[(mine[r], mine[c])]);
        let x = Vector::from_fn(n, |r, _| self.estimates[mine[r]].1.value);
        Some(quadratic(&inverse(block)?, &x).max(0.0).sqrt())
    }
}

/// New value of a parameter after a change (of defocus: of its square), in the parameter's unit.
/// `None` where a square would be negative.
fn moved(camera: &Camera, kind: &str, key: &str, change: Value) -> Option<Value> {
    let present = value(camera, kind, key);
    if kind == "defocus" {
        let square = present * present + change.value;
        if square <= 0.0 {
            return None;
        }
        let shift = square.sqrt() * if present < 0.0 { -1.0 } else { 1.0 };
        return Some(Value { value: shift, std_error: change.std_error / (2.0 * shift.abs()) });
    }
    let range = effects::declared(kind).iter().find(|p| p.key == key)?;
    let value = (present + change.value).clamp(f64::from(range.min), f64::from(range.max));
    Some(Value { value, std_error: change.std_error })
}

/// Values of a kind's parameters in a camera, in the order of the declaration; without the effect
/// those that do nothing.
fn values(camera: &Camera, kind: &str) -> Vec<f32> {
    if let Some(effect) = effects::of_camera(camera, kind) {
        return effect.values();
    }
    let neutral = |key: &str| {
        let free = KINDS.iter().find(|k| k.0 == kind).map_or(&[][..], |k| k.1);
        free.iter().find(|f| f.key == key).map(|f| f.neutral as f32)
    };
    let of = |p: &Parameter| neutral(p.key).or(p.default).unwrap_or(0.0);
    effects::declared(kind).iter().map(of).collect()
}

/// Value of a parameter in a camera; without the effect that which does nothing.
fn value(camera: &Camera, kind: &str, key: &str) -> f64 {
    let index = effects::declared(kind).iter().position(|p| p.key == key);
    index.and_then(|i| values(camera, kind).get(i).copied()).map_or(0.0, f64::from)
}

/// The camera with another value of a parameter. `None` out of its range.
fn with(camera: &Camera, kind: &str, key: &str, value: f64) -> Option<Camera> {
    let mut values = values(camera, kind);
    for (v, p) in values.iter_mut().zip(effects::declared(kind)) {
        // Crosstalk to vertical neighbours is assumed equal to that to horizontal ones.
        if p.key == key || (kind == "optical-crosstalk" && p.key == "vertical") {
            *v = value as f32;
        }
    }
    let mut out = camera.clone();
    effects::put(&mut out, &AnyEffect::new(kind, &values)?);
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A column that moves some of three figures by `change` each.
    fn column(key: &'static str, change: [f64; 3]) -> Column {
        let change = Vector::from_row_slice(&change);
        Column { kind: "colour-shading", key, change, present: false, in_maps: true }
    }

    #[test]
    fn a_shading_takes_the_fewest_parameters() {
        let channels = [
            column("channel_0", [1.0, 0.0, 0.0]),
            column("channel_1", [0.0, 1.0, 0.0]),
            column("channel_2", [0.0, 0.0, 1.0]),
        ];
        let shared = || Some(column("corner", [1.0; 3]));
        let chosen = |z: [f64; 3], shared| {
            let residual =
                Residual { keys: Vec::new(), sd: Vec::new(), z: Vector::from_row_slice(&z) };
            choose(&channels, 3, shared, &residual)
        };
        assert_eq!(chosen([1.0, -2.0, 3.0], shared()), None, "nothing");
        assert_eq!(chosen([0.0, 1.0, 9.0], shared()), Some(vec![2]), "one channel");
        assert_eq!(chosen([20.0, 21.0, 19.0], shared()), None, "all alike are the shared one");
        assert_eq!(chosen([20.0, 50.0, 20.0], shared()), Some(vec![1]), "one beside the shared");
        assert_eq!(chosen([20.0, 50.0, 90.0], shared()).map(|c| c.len()), Some(3));
        assert_eq!(chosen([20.0, 50.0, 20.0], None).map(|c| c.len()), Some(3));
    }
}
