//! Maps over pixels that several stacks make together: offset, dark current, gain, its change with the level,
//! and what remains of the frame before.

use super::channels::Channels;
use super::design::{Condition, Design};
use super::spatial::{Spatial, describe};
use super::temporal::Temporal;
use camrig_base::Plane;
use camrig_camera::Camera;
use camrig_captures::Role;

/// A kind of map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MapKind {
    /// Mean of the shortest dark exposure, DN.
    Offset,
    /// Rise of the dark signal with exposure, e⁻/s.
    DarkCurrent,
    /// Response relative to the mean of the channel.
    Gain,
    /// Response at a high level less that at a medium level, both relative to the mean.
    Curvature,
    /// Dark after light less the dark reference, DN.
    AfterLight,
}

/// A map and its description.
#[derive(Clone, Debug)]
pub struct Map {
    /// What it is.
    pub kind: MapKind,
    /// Its description.
    pub spatial: Spatial,
    /// Whether shading in it belongs to the sensor.
    pub even: bool,
    /// Of [`MapKind::AfterLight`]: mean in units of the light before, and its standard deviation.
    pub after_image: Option<(f64, f64)>,
    /// The map itself.
    pub plane: Plane<f32>,
}

/// Whether two stacks differ only in exposure or light.
fn alike(a: &Condition, b: &Condition) -> bool {
    a.analog_gain == b.analog_gain && (a.temperature_c - b.temperature_c).abs() < 0.5
}

fn plain_darks(design: &Design) -> impl Iterator<Item = (usize, &Condition)> {
    let darks = design.conditions.iter().enumerate();
    darks.filter(|(_, c)| c.role == Role::Dark && c.before_e.iter().all(|&e| e == 0.0))
}

/// The dark stack that others are compared with: the shortest at the gain and temperature of most.
pub fn reference_dark(design: &Design) -> Option<usize> {
    let alike_count = |c: &Condition| design.conditions.iter().filter(|o| alike(c, o)).count();
    plain_darks(design)
        .min_by(|(_, a), (_, b)| {
            let by_company = alike_count(b).cmp(&alike_count(a));
            let by_time = a.exposure_s.total_cmp(&b.exposure_s);
            by_company.then(by_time).then(b.frames.cmp(&a.frames))
        })
        .map(|(i, _)| i)
}

/// The longest dark stack like the reference, if it is at least twice as long.
pub fn long_dark(design: &Design) -> Option<usize> {
    let reference = &design.conditions[reference_dark(design)?];
    plain_darks(design)
        .filter(|(_, c)| alike(c, reference) && c.exposure_s > 2.0 * reference.exposure_s)
        .max_by(|(_, a), (_, b)| a.exposure_s.total_cmp(&b.exposure_s))
        .map(|(i, _)| i)
}

/// Flats of the largest group with the same light and gain, weakest first.
pub fn flats(design: &Design) -> Vec<usize> {
    let key = |c: &Condition| (c.wavelength_nm.map(f64::to_bits), c.analog_gain.to_bits());
    let flats: Vec<usize> =
        (0..design.conditions.len()).filter(|&i| design.conditions[i].role == Role::Flat).collect();
    let group = |i: usize| {
        let k = key(&design.conditions[i]);
        flats.iter().copied().filter(|&j| key(&design.conditions[j]) == k).collect::<Vec<_>>()
    };
    let mut best: Vec<usize> = Vec::new();
    for &i in &flats {
        let g = group(i);
        if g.len() > best.len() {
            best = g;
        }
    }
    let level = |i: usize| design.conditions[i].photo_e.iter().sum::<f64>();
    best.sort_by(|&a, &b| level(a).total_cmp(&level(b)));
    best
}

/// Share of samples at the end of the scale.
pub fn saturated(t: &Temporal) -> f64 {
    let top = t.histogram.last().copied().unwrap_or(0);
    f64::from(top) / (t.mean.data.len() * t.frames.max(1)) as f64
}

/// Every map that the stacks determine.
pub fn maps(camera: &Camera, design: &Design, stacks: &[Temporal]) -> Vec<Map> {
    let Some(reference) = reference_dark(design) else { return Vec::new() };
    let (c0, t0) = (&design.conditions[reference], &stacks[reference]);
    let channels = Channels::new(camera);
    let map = |kind, plane: Plane<f32>, even| Map {
        kind,
        spatial: describe(&plane, &channels, even),
        even,
        after_image: None,
        plane,
    };
    let mut out = vec![map(MapKind::Offset, t0.mean.clone(), true)];
    let difference = |t: &Temporal, scale: f32| Plane {
        width: t.width,
        height: t.height,
        data: t.mean.data.iter().zip(&t0.mean.data).map(|(a, b)| (a - b) * scale).collect(),
    };
    let config_gain =
        |gain: f64| gain * f64::from((1u32 << camera.sensor.bits) - 1) / camera.sensor.full_well_e;
    if let Some(long) = long_dark(design) {
        let c = &design.conditions[long];
        let scale = 1.0 / (config_gain(c.analog_gain) * (c.exposure_s - c0.exposure_s));
        out.push(map(MapKind::DarkCurrent, difference(&stacks[long], scale as f32), true));
    }
    let flats: Vec<usize> =
        flats(design).into_iter().filter(|&i| saturated(&stacks[i]) < 1e-5).collect();
    let relative = |mut plane: Plane<f32>| -> Plane<f32> {
        let means = channels.means(&plane.data);
        channels.change(&mut plane.data, &means, |v, mean| v / mean);
        plane
    };
    let mean = |i: usize| {
        let d = &stacks[i].mean.data;
        d.iter().zip(&t0.mean.data).map(|(a, b)| f64::from(a - b)).sum::<f64>() / d.len() as f64
    };
    let even = flats.iter().all(|&i| design.conditions[i].even);
    if !flats.is_empty() {
        // Weighted slope of signal over level: Σ w µ s / Σ w µ².
        let mut sum = vec![0.0f32; t0.mean.data.len()];
        for &i in &flats {
            let mu = mean(i);
            let variance = stacks[i].pixel_variance.iter().map(|&v| f64::from(v)).sum::<f64>()
                / stacks[i].pixel_variance.len() as f64;
            let weight = (mu * stacks[i].frames as f64 / variance.max(1e-9)) as f32;
            for ((s, a), b) in sum.iter_mut().zip(&stacks[i].mean.data).zip(&t0.mean.data) {
                *s += weight * (a - b);
            }
        }
        let plane = Plane { width: t0.width, height: t0.height, data: sum };
        out.push(map(MapKind::Gain, relative(plane), even));
    }
    if flats.len() >= 3 {
        let (high, middle) = (flats[flats.len() - 1], flats[(flats.len() - 1) / 2]);
        if mean(high) > 1.5 * mean(middle) {
            let (a, b) = (
                relative(difference(&stacks[high], 1.0)),
                relative(difference(&stacks[middle], 1.0)),
            );
            let data = a.data.iter().zip(&b.data).map(|(a, b)| a - b).collect();
            out.push(map(MapKind::Curvature, Plane { data, ..a }, even));
        }
    }
    let after =
        design.conditions.iter().enumerate().find(|(_, c)| {
            c.role == Role::Dark && c.before_e.iter().any(|&e| e > 0.0) && alike(c, c0)
        });
    if let Some((i, c)) = after {
        let plane = difference(&stacks[i], 1.0);
        let mut m = map(MapKind::AfterLight, plane, true);
        let n = m.plane.data.len() as f64;
        let mean = m.plane.data.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
        let before =
            c.before_e.iter().sum::<f64>() / c.before_e.len() as f64 * config_gain(c.analog_gain);
        m.after_image = Some((mean / before, (m.spatial.pixel_variance / n).sqrt() / before));
        out.push(m);
    }
    out
}
