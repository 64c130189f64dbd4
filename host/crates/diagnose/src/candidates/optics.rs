//! Effects of the optics, and those of the sensor that edges, dots and charts show: found together by least squares.
//!
//! Every figure of the looks depends a little on every parameter. How much is asked of the model itself: the optics
//! stage and one replicate with the parameter moved a step, with the same random numbers. The fall-off of the gain map,
//! which shadings alone move, is a figure beside them. Then
//!
//!   Σ ((measured − predicted − Σ_p J_p Δ_p) / σ)² → min
//!
//! over the parameters of a kind and those that the model has of the kinds of optics named already, so that these give way
//! where they had to stand for it; a quantum efficiency gives way to the mean of a shading. The search repeats it with the
//! same slopes (the chord method), and at its end with new ones.

use super::proposal::Proposal;
use super::response;
use crate::data::channels::Channels;
use crate::evidence::{Estimated, Evidence, Slope};
use crate::model::effects;
use crate::statistics::shading;
use crate::statistics::statistic::Key;
use crate::statistics::statistic::{Place, Statistic};
use camrig_camera::{Camera, LensKind};
use camrig_optics::OpticalEffect;
use camrig_sensor_core::effects::{Effect, Parameter};
use nalgebra::{DMatrix, DVector};

/// A parameter that is looked for: key, value without the effect, step for the derivative.
type Free = (&'static str, f64, f64);

/// Kinds with their parameters.
const KINDS: [(&str, &[Free]); 9] = [
    ("defocus", &[("shift_um", 0.0, 0.0)]),
    ("distortion", &[("size", 1.0, 0.002), ("k1", 0.0, 0.004), ("k2", 0.0, 0.004)]),
    ("lateral-colour", &[("blue_px", 0.0, 0.3), ("red_px", 0.0, 0.3)]),
    ("decentre-tilt", &[("x_px", 0.0, 4.0), ("y_px", 0.0, 4.0)]),
    ("lens-transmittance", &[("factor", 1.0, -0.02), ("slope", 0.0, 0.01)]),
    ("veiling-glare", &[("fraction", 0.0, 0.01)]),
    ("relative-illumination", &[("corner", 0.0, 0.02)]),
    (
        "colour-shading",
        &[("channel_0", 0.0, 0.02), ("channel_1", 0.0, 0.02), ("channel_2", 0.0, 0.02)],
    ),
    ("optical-crosstalk", &[("side", 0.0, 0.01)]),
];

/// Parameters that a kind does not yet have in the model stay only from this many standard errors on, but for one.
const KEEP: f64 = 4.0;
/// Figures that agree within this are not asked for new names.
const AGREES: f64 = 4.0;
/// Secant steps for the parameter that acts by its square.
const SECANTS: usize = 4;
/// Part of a parameter that the others must leave it, else it cannot be told from them.
const APART: f64 = 1e-4;

/// A parameter of a kind, and what a unit of it does to every figure, in standard deviations.
#[derive(Clone)]
struct Column {
    kind: &'static str,
    key: &'static str,
    change: DVector<f64>,
    /// Whether the model has it away from what does nothing.
    present: bool,
    /// Whether it moves figures of maps.
    in_maps: bool,
}

/// Measured less predicted, in standard deviations.
struct Residual {
    keys: Vec<Key>,
    /// Standard deviation of each figure on its scale.
    sd: Vec<f64>,
    z: DVector<f64>,
}

/// Whether a kind is estimated from edges, dots and charts.
pub fn shown_by_targets(kind: &str) -> bool {
    KINDS.iter().any(|k| k.0 == kind)
}

/// The proposal of one kind.
pub fn estimate(e: &Evidence<'_>, kind: &'static str) -> Option<Proposal> {
    let residual = Residual::of(e);
    // What is named is asked again all the same: many figures may each agree and together say more.
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
    // A shading that the channels share takes one parameter, and those of single channels beside it as many fewer.
    let shared = match kind {
        "colour-shading" => self::columns(e, "relative-illumination", residual),
        _ => Vec::new(),
    };
    let shared = shared.into_iter().find(|c| !c.present);
    let free = choose(&columns, own, shared, residual)?;
    proposal(e, kind, &columns, own, &Solution::of(&columns, &free, residual)?)
}

/// Which parameters are to be free: those of a kind (the first `own` columns) that the model has or that take `KEEP`² each
/// from the sum of squares, and all of the others. `None` where no parameter of the kind is. `shared` competes with them,
/// for another kind to propose; a second name costs half a parameter.
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
        let second = if set.iter().any(|&i| i >= columns.len()) { 0.5 } else { 0.0 };
        let cost = KEEP * KEEP * ((set.len() - must.len()) as f64 + second);
        let fall = if free.is_empty() { 0.0 } else { Solution::of(&all, &free, residual)?.fall };
        Some(fall - cost)
    };
    let (_, best) =
        sets.filter_map(|set| Some((worth(&set)?, set))).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let mine: Vec<usize> = best.into_iter().filter(|&i| i < own).collect();
    (!mine.is_empty()).then(|| mine.into_iter().chain(others).collect())
}

/// The proposal of a solution: the kind's own new values, and those of the others that gave way.
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
        let (sensor, optical) = (&mut p.effects, &mut p.optical);
        match in_camera(&camera, k)? {
            InCamera::Sensor(effect) if k == kind => sensor.push(effect),
            InCamera::Optical(effect) if k == kind => optical.push(effect),
            InCamera::Sensor(effect) => p.revised.0.push(effect),
            InCamera::Optical(effect) => p.revised.1.push(effect),
        }
    }
    if !p.of_targets {
        let mean = mean_shading(&camera)? / mean_shading(e.camera)?;
        p.revised.0.extend(response::efficiency_beside(e, mean));
    }
    Some(p)
}

/// What shadings leave of the mean light of a frame: r² is 1/3 on average, with r = 1 at the corners.
fn mean_shading(camera: &Camera) -> Option<f64> {
    let channels = Channels::new(camera);
    let of_channel =
        |(c, share): (usize, f64)| share * value(camera, "colour-shading", &format!("channel_{c}"));
    let by_channel: f64 = channels.shares().into_iter().enumerate().map(of_channel).sum();
    let common = value(camera, "relative-illumination", "corner");
    let mean = (1.0 + common / 3.0) * (1.0 + by_channel / 3.0);
    (mean > 0.0).then_some(mean)
}

/// What lies in a camera under a kind's name.
enum InCamera {
    Sensor(Effect),
    Optical(OpticalEffect),
}

fn in_camera(camera: &Camera, kind: &str) -> Option<InCamera> {
    let optical = camera.optical_effects.iter().find(|o| o.entry().kind == kind);
    optical
        .map(|o| InCamera::Optical(o.clone()))
        .or_else(|| effects::current(camera, kind).map(InCamera::Sensor))
}

impl Residual {
    fn of(e: &Evidence<'_>) -> Self {
        let mut out = Self { keys: Vec::new(), sd: Vec::new(), z: DVector::zeros(0) };
        let mut z = Vec::new();
        let of_falls = |what| shading::slope(what, None, 0).is_some();
        let wanted = |k: &Key| matches!(k.0, Place::Target(_)) || of_falls(k.1);
        for (key, s) in e.data.iter().filter(|(k, _)| wanted(k)) {
            let Some(p) = e.model.of.get(key) else { continue };
            let sd = p.sd.hypot(e.allowance.get(key).copied().unwrap_or(0.0)).max(1e-12);
            out.keys.push(*key);
            out.sd.push(sd);
            z.push((p.scale.of(s.value) - p.scaled) / sd);
        }
        out.z = DVector::from_vec(z);
        out
    }

    /// Slopes in standard deviations.
    fn scaled(&self, slope: &Slope) -> DVector<f64> {
        let at = |(key, sd): (&Key, &f64)| slope.get(key).copied().unwrap_or(0.0) / sd;
        DVector::from_iterator(self.keys.len(), self.keys.iter().zip(&self.sd).map(at))
    }
}

/// What the parameters of a kind do; those that do nothing, or cannot be moved in this camera, are left out.
fn columns(e: &Evidence<'_>, kind: &'static str, residual: &Residual) -> Vec<Column> {
    let Some((_, free)) = KINDS.iter().find(|k| k.0 == kind) else { return Vec::new() };
    // The axis shows in what is about it.
    let about_axis = |k: &&&str| matches!(**k, "distortion" | "lateral-colour");
    let grounds = match kind {
        "decentre-tilt" => e.named.iter().filter(about_axis).count(),
        _ => 0,
    };
    let all = free.iter().filter_map(|&(key, neutral, step)| {
        let value = value(e.camera, kind, key);
        let mut slope = e.slopes.of((kind, key, value != 0.0, grounds), || match kind {
            "defocus" => blur(e, residual),
            _ => derivative(e, kind, key, step),
        })?;
        let in_maps = in_maps(e.camera, kind, key, residual);
        slope.extend(&in_maps);
        let change = residual.scaled(&slope);
        let in_maps = in_maps.values().any(|s| *s != 0.0);
        let present = value as f32 != neutral as f32;
        (change.norm() > 1e-9).then_some(Column { kind, key, change, present, in_maps })
    });
    all.collect()
}

/// What a unit of a shading does to the fall-off of maps.
fn in_maps(camera: &Camera, kind: &str, key: &str, residual: &Residual) -> Slope {
    let channel = match kind {
        "relative-illumination" => None,
        "colour-shading" => key.strip_prefix("channel_").and_then(|c| c.parse().ok()),
        _ => return Slope::new(),
    };
    let widest = Channels::new(camera).widest();
    let of = |k: &Key| Some((*k, shading::slope(k.1, channel, widest)?));
    residual.keys.iter().filter_map(of).collect()
}

/// Change of every figure on its scale for a unit of a parameter.
fn derivative(e: &Evidence<'_>, kind: &str, key: &str, step: f64) -> Option<Slope> {
    let present = value(e.camera, kind, key);
    // Away from the end of the range.
    let to = with(e.camera, kind, key, present + step)
        .or_else(|| with(e.camera, kind, key, present - step))?;
    let step = value(&to, kind, key) - present;
    slope(e, &to, step)
}

fn slope(e: &Evidence<'_>, to: &Camera, step: f64) -> Option<Slope> {
    let from = (e.simulate_targets)(e.camera).ok()?;
    let to = (e.simulate_targets)(to).ok()?;
    let change = |(key, b): (&Key, &Statistic)| {
        let a = from.get(key)?;
        Some((*key, (b.scale.of(b.value) - a.scale.of(a.value)) / step))
    };
    Some(to.iter().filter_map(change).collect())
}

/// What defocus does, per µm² of its square: a lens in focus does not change with the first power.
///
/// The slope is that of the secant to where the residual alone would have the shift, since blur saturates.
fn blur(e: &Evidence<'_>, residual: &Residual) -> Option<Slope> {
    let present = value(e.camera, "defocus", "shift_um");
    let mut shift = if present == 0.0 { quarter_wave_um(e.camera) } else { 1.1 * present };
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
        let next = wanted.sqrt().min(3.0 * shift);
        if (next / shift - 1.0).abs() < 0.1 {
            break;
        }
        shift = next;
    }
    best
}

/// Shift for a quarter of a wave at the pupil's edge, µm: δ = 8 N² λ/4 at 550 nm.
fn quarter_wave_um(camera: &Camera) -> f64 {
    match camera.lens.kind {
        LensKind::DiffractionLimited { f_number, .. } => 1.1 * f_number * f_number,
        _ => 10.0,
    }
}

/// Least squares over some columns.
struct Solution {
    /// Column and change of its parameter.
    estimates: Vec<(usize, Estimated)>,
    covariance: DMatrix<f64>,
    /// By how much the sum of squares falls.
    fall: f64,
}

impl Solution {
    fn of(columns: &[Column], free: &[usize], residual: &Residual) -> Option<Self> {
        if free.is_empty() {
            return None;
        }
        let norms: Vec<f64> = free.iter().map(|&i| columns[i].change.norm()).collect();
        let scaled: Vec<DVector<f64>> =
            free.iter().zip(&norms).map(|(&i, n)| &columns[i].change / *n).collect();
        let a = DMatrix::from_columns(&scaled);
        let normal = a.transpose() * &a;
        let inverse = normal.try_inverse()?;
        // Diagonal of the inverse: one over the part of each column that the others leave.
        if inverse.diagonal().iter().any(|d| !(*d > 0.0 && *d < 1.0 / APART)) {
            return None;
        }
        let moment = a.transpose() * &residual.z;
        let x = &inverse * &moment;
        let estimates = free.iter().enumerate().map(|(k, &i)| {
            let se = inverse[(k, k)].sqrt() / norms[k];
            (i, Estimated { value: x[k] / norms[k], se })
        });
        let estimates = estimates.collect();
        let scale = DMatrix::from_diagonal(&DVector::from_vec(norms)).try_inverse()?;
        Some(Self { estimates, covariance: &scale * inverse * &scale, fall: x.dot(&moment) })
    }

    /// How far the kind's own parameters are from what the model has, in standard errors.
    fn strength(&self, own: usize) -> Option<f64> {
        let mine: Vec<usize> =
            (0..self.estimates.len()).filter(|&k| self.estimates[k].0 < own).collect();
        let n = mine.len();
        let block = DMatrix::from_fn(n, n, |r, c| self.covariance[(mine[r], mine[c])]);
        let x = DVector::from_fn(n, |r, _| self.estimates[mine[r]].1.value);
        Some((x.transpose() * block.try_inverse()? * x)[(0, 0)].max(0.0).sqrt())
    }
}

/// New value of a parameter after a change, with its standard error.
fn moved(camera: &Camera, kind: &str, key: &str, change: Estimated) -> Option<Estimated> {
    let present = value(camera, kind, key);
    if kind == "defocus" {
        let square = present * present + change.value;
        if square <= 0.0 {
            return None;
        }
        let shift = square.sqrt() * if present < 0.0 { -1.0 } else { 1.0 };
        return Some(Estimated { value: shift, se: change.se / (2.0 * shift.abs()) });
    }
    let range = declared(kind).iter().find(|p| p.key == key)?;
    let value = (present + change.value).clamp(f64::from(range.min), f64::from(range.max));
    Some(Estimated { value, se: change.se })
}

/// The declared parameters of a kind.
fn declared(kind: &str) -> &'static [Parameter] {
    let optical = OpticalEffect::CATALOGUE.iter().find(|c| c.kind == kind);
    let sensor = Effect::CATALOGUE.iter().find(|c| c.kind == kind);
    optical.map(|c| c.parameters).or(sensor.map(|c| c.parameters)).unwrap_or_default()
}

/// Values of a kind in a camera, in the order of its declaration.
fn values(camera: &Camera, kind: &str) -> Vec<f32> {
    if let Some(effect) = camera.optical_effects.iter().find(|o| o.entry().kind == kind) {
        return effect.values().to_vec();
    }
    if let Some(effect) = effects::current(camera, kind) {
        return effect.values().to_vec();
    }
    let neutral = |key: &str| {
        let free = KINDS.iter().find(|k| k.0 == kind).map_or(&[][..], |k| k.1);
        free.iter().find(|f| f.0 == key).map(|f| f.1 as f32)
    };
    let of = |p: &Parameter| neutral(p.key).or(p.default).unwrap_or(0.0);
    declared(kind).iter().map(of).collect()
}

fn value(camera: &Camera, kind: &str, key: &str) -> f64 {
    let index = declared(kind).iter().position(|p| p.key == key);
    index.and_then(|i| values(camera, kind).get(i).copied()).map_or(0.0, f64::from)
}

/// The camera with a parameter changed; `None` out of its range.
fn with(camera: &Camera, kind: &str, key: &str, value: f64) -> Option<Camera> {
    let mut values = values(camera, kind);
    for (v, p) in values.iter_mut().zip(declared(kind)) {
        // Neighbours above and below get what those beside get.
        if p.key == key || (kind == "optical-crosstalk" && p.key == "vertical") {
            *v = value as f32;
        }
    }
    let mut out = camera.clone();
    match OpticalEffect::new(kind, &values) {
        Some(effect) => effects::put_optical(&mut out, effect),
        None => {
            let id = Effect::CATALOGUE.iter().find(|c| c.kind == kind)?.id;
            effects::put(&mut out, Effect::new(id, &values)?);
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A column that moves some of three figures by `change` each.
    fn column(key: &'static str, change: [f64; 3]) -> Column {
        let change = DVector::from_row_slice(&change);
        Column { kind: "colour-shading", key, change, present: false, in_maps: true }
    }

    #[test]
    fn a_shading_is_told_with_the_fewest_parameters() {
        let channels = [
            column("channel_0", [1.0, 0.0, 0.0]),
            column("channel_1", [0.0, 1.0, 0.0]),
            column("channel_2", [0.0, 0.0, 1.0]),
        ];
        let shared = || Some(column("corner", [1.0; 3]));
        let chosen = |z: [f64; 3], shared| {
            let residual =
                Residual { keys: Vec::new(), sd: Vec::new(), z: DVector::from_row_slice(&z) };
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
