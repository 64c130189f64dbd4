//! Maps over pixels from several stacks: offset, dark current, gain, its change with the level, and
//! the after-image of the frame before.

use super::spatial::{Spatial, describe};
use super::temporal::Temporal;
use crate::data::channels::Channels;
use crate::data::design::{Condition, Design, same_temperature};
use crate::numerics::steps::Spread;
use camrig_base::Plane;
use camrig_camera::Camera;
use camrig_captures::Role;

/// Share of saturated samples from which a flat is not used for maps, as its brightest pixels are
/// clipped. One sample in a hundred thousand does not affect a statistic of the map.
pub const SATURATED_FLAT: f64 = 1e-5;
/// Smallest ratio of the long to the reference dark exposure from which dark current is measured.
const LONG_OVER_SHORT: f64 = 2.0;
/// Smallest ratio of the levels of the brightest and the middle flat from which the curvature of
/// the response is measured.
const HIGH_OVER_MIDDLE: f64 = 1.5;

/// A kind of map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum MapKind {
    /// Mean of the shortest dark exposure, DN.
    Offset,
    /// Increase of the dark signal with exposure, e⁻/s.
    DarkCurrent,
    /// Response relative to the mean of the channel.
    Gain,
    /// Response at a high level minus that at a medium level, both relative to the mean.
    Curvature,
    /// Dark after light minus the reference dark, DN.
    AfterLight,
}

/// The after-image in dark frames after light.
#[derive(Clone, Copy, Debug)]
pub struct AfterImage {
    /// Mean signal as a share of the light before.
    pub share: f64,
    /// Its standard deviation.
    pub sd: f64,
}

/// A map and its components.
#[derive(Clone, Debug)]
pub struct Map {
    /// What it is.
    pub kind: MapKind,
    /// Its components.
    pub spatial: Spatial,
    /// Whether the light was even, so that shading belongs to the sensor.
    pub even: bool,
    /// Median of its pixels, in its unit.
    pub median: f64,
    /// The after-image, for [`MapKind::AfterLight`].
    pub after_image: Option<AfterImage>,
    /// The map itself.
    pub plane: Plane<f32>,
}

/// Whether two stacks have the same gain and temperature.
fn same_sensor_settings(a: &Condition, b: &Condition) -> bool {
    a.stack.analog_gain == b.stack.analog_gain && same_temperature(&a.stack, &b.stack)
}

/// Dark stacks that do not follow light.
fn plain_darks(design: &Design) -> impl Iterator<Item = (usize, &Condition)> {
    let darks = design.conditions.iter().enumerate();
    darks.filter(|(_, c)| c.stack.role == Role::Dark && c.before_e.iter().all(|&e| e == 0.0))
}

/// The dark stack that others are compared with: the shortest at the most common gain and
/// temperature.
pub fn reference_dark(design: &Design) -> Option<usize> {
    let count_alike =
        |c: &Condition| design.conditions.iter().filter(|o| same_sensor_settings(c, o)).count();
    plain_darks(design)
        .min_by(|(_, a), (_, b)| {
            let by_count = count_alike(b).cmp(&count_alike(a));
            let by_time = a.stack.exposure_s.total_cmp(&b.stack.exposure_s);
            by_count.then(by_time).then(b.stack.frames.cmp(&a.stack.frames))
        })
        .map(|(i, _)| i)
}

/// Mean of the reference dark, DN; the camera's black level where there is none.
pub fn black_level(camera: &Camera, design: &Design, stacks: &[Temporal]) -> f64 {
    reference_dark(design).map_or(camera.sensor.black_level_dn, |i| stacks[i].level())
}

/// The longest dark stack at the reference's settings, if it is more than twice as long.
pub fn long_dark(design: &Design) -> Option<usize> {
    let reference = &design.conditions[reference_dark(design)?];
    plain_darks(design)
        .filter(|(_, c)| {
            let least = LONG_OVER_SHORT * reference.stack.exposure_s;
            same_sensor_settings(c, reference) && c.stack.exposure_s > least
        })
        .max_by(|(_, a), (_, b)| a.stack.exposure_s.total_cmp(&b.stack.exposure_s))
        .map(|(i, _)| i)
}

/// The flats of the largest group with the same wavelength and gain, darkest first.
pub fn flats(design: &Design) -> Vec<usize> {
    let key = |c: &Condition| (c.wavelength_nm.map(f64::to_bits), c.stack.analog_gain.to_bits());
    let flats: Vec<usize> = (0..design.conditions.len())
        .filter(|&i| design.conditions[i].stack.role == Role::Flat)
        .collect();
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

/// Share of samples at full scale.
pub fn saturated(t: &Temporal) -> f64 {
    let top = t.histogram.last().copied().unwrap_or(0);
    f64::from(top) / (t.mean.data.len() * t.frames.max(1)) as f64
}

/// Inputs that all maps of a design share.
struct Maker<'a> {
    camera: &'a Camera,
    design: &'a Design,
    stacks: &'a [Temporal],
    channels: Channels,
    /// The reference dark stack.
    dark: &'a Temporal,
}

/// All maps that the stacks determine; none without a dark stack.
pub fn maps(camera: &Camera, design: &Design, stacks: &[Temporal]) -> Vec<Map> {
    let Some(reference) = reference_dark(design) else { return Vec::new() };
    let dark = &stacks[reference];
    let maker = Maker { camera, design, stacks, channels: Channels::new(camera), dark };
    let mut out = vec![maker.map(MapKind::Offset, dark.mean.clone(), dark.step(), true)];
    out.extend(maker.dark_current(&design.conditions[reference]));
    let flats: Vec<usize> =
        flats(design).into_iter().filter(|&i| saturated(&stacks[i]) < SATURATED_FLAT).collect();
    let even = flats.iter().all(|&i| design.conditions[i].even);
    if !flats.is_empty() {
        out.push(maker.map(MapKind::Gain, maker.gain(&flats), 0.0, even));
    }
    let curvature = maker.curvature(&flats);
    out.extend(curvature.map(|plane| maker.map(MapKind::Curvature, plane, 0.0, even)));
    out.extend(maker.after_light(&design.conditions[reference]));
    out
}

impl Maker<'_> {
    /// A map whose values lie on multiples of `step`; of 0, on no lattice.
    fn map(&self, kind: MapKind, plane: Plane<f32>, step: f64, even: bool) -> Map {
        let spatial = describe(&plane, &self.channels, even);
        let median = Spread::of(plane.data.clone(), step).median();
        Map { kind, spatial, even, median, after_image: None, plane }
    }

    /// A stack's mean frame above the reference dark, times `scale`.
    fn above_dark(&self, t: &Temporal, scale: f32) -> Plane<f32> {
        let pairs = t.mean.data.iter().zip(&self.dark.mean.data);
        let data = pairs.map(|(a, b)| (a - b) * scale).collect();
        Plane { width: t.width, height: t.height, data }
    }

    /// Step of the values of a stack's mean frame above the reference dark, DN: that of the one
    /// with fewer frames.
    fn step_above_dark(&self, t: &Temporal) -> f64 {
        t.step().max(self.dark.step())
    }

    /// DN per electron at an analog gain, from the camera file.
    fn nominal_gain(&self, analog_gain: f64) -> f64 {
        self.camera.sensor.dn_per_e(analog_gain)
    }

    /// Mean level of a stack above dark, DN.
    fn level(&self, i: usize) -> f64 {
        let d = &self.stacks[i].mean.data;
        let pairs = d.iter().zip(&self.dark.mean.data);
        pairs.map(|(a, b)| f64::from(a - b)).sum::<f64>() / d.len() as f64
    }

    /// A plane relative to the mean of each channel.
    fn relative(&self, mut plane: Plane<f32>) -> Plane<f32> {
        let means = self.channels.means(&plane.data);
        self.channels.change(&mut plane.data, &means, |v, mean| v / mean);
        plane
    }

    /// Increase of the dark signal with exposure, e⁻/s.
    fn dark_current(&self, reference: &Condition) -> Option<Map> {
        let long = long_dark(self.design)?;
        let c = &self.design.conditions[long].stack;
        let longer = c.exposure_s - reference.stack.exposure_s;
        let scale = 1.0 / (self.nominal_gain(c.analog_gain) * longer);
        let t = &self.stacks[long];
        let step = scale * self.step_above_dark(t);
        Some(self.map(MapKind::DarkCurrent, self.above_dark(t, scale as f32), step, true))
    }

    /// Weighted slope Σ w µ s / Σ w µ² of each pixel's signal s against the level µ, relative to
    /// the mean of its channel.
    fn gain(&self, flats: &[usize]) -> Plane<f32> {
        let mut sum = vec![0.0f32; self.dark.mean.data.len()];
        for &i in flats {
            let t = &self.stacks[i];
            let mu = self.level(i);
            let variance = t.pixel_variance.iter().map(|&v| f64::from(v)).sum::<f64>()
                / t.pixel_variance.len() as f64;
            let weight = (mu * t.frames as f64 / variance.max(1e-9)) as f32;
            for ((s, a), b) in sum.iter_mut().zip(&t.mean.data).zip(&self.dark.mean.data) {
                *s += weight * (a - b);
            }
        }
        self.relative(Plane { width: self.dark.width, height: self.dark.height, data: sum })
    }

    /// Relative response in the brightest flat minus that in the middle one.
    fn curvature(&self, flats: &[usize]) -> Option<Plane<f32>> {
        if flats.len() < 3 {
            return None;
        }
        let (high, middle) = (flats[flats.len() - 1], flats[(flats.len() - 1) / 2]);
        let of = |i: usize| self.relative(self.above_dark(&self.stacks[i], 1.0));
        (self.level(high) > HIGH_OVER_MIDDLE * self.level(middle)).then(|| {
            let (a, b) = (of(high), of(middle));
            let data = a.data.iter().zip(&b.data).map(|(a, b)| a - b).collect();
            Plane { data, ..a }
        })
    }

    /// The dark stack after light, above the reference dark, DN, with its after-image.
    fn after_light(&self, reference: &Condition) -> Option<Map> {
        let (i, c) = self.design.conditions.iter().enumerate().find(|(_, c)| {
            let after_light = c.before_e.iter().any(|&e| e > 0.0);
            c.stack.role == Role::Dark && after_light && same_sensor_settings(c, reference)
        })?;
        let (plane, step) =
            (self.above_dark(&self.stacks[i], 1.0), self.step_above_dark(&self.stacks[i]));
        let mut m = self.map(MapKind::AfterLight, plane, step, true);
        let n = m.plane.data.len() as f64;
        let mean = m.plane.data.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
        let before = c.before_e.iter().sum::<f64>() / c.before_e.len() as f64
            * self.nominal_gain(c.stack.analog_gain);
        let sd = (m.spatial.pixel_variance / n).sqrt() / before;
        m.after_image = Some(AfterImage { share: mean / before, sd });
        Some(m)
    }
}
