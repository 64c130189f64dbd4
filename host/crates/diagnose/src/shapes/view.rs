//! The moments of a half as detectors read them, and how a shape is subtracted from them.

use crate::data::channels::Channels;
use crate::data::design::{Condition, Design};
use crate::model::effects::dn_per_e;
use crate::model::prediction::Prediction;
use crate::statistics::maps::{self, Map, MapKind};
use crate::statistics::statistic::Key;
use crate::statistics::temporal::Temporal;
use camrig_base::Plane;
use camrig_base::median::{median, robust_sd};
use camrig_camera::Camera;
use camrig_captures::Role;

/// Values are clipped at this many robust standard deviations, so that single pixels have little
/// influence; a normal distribution loses 1.2·10⁻⁴ of its variance.
const CLIP: f64 = 4.0;

/// Maps of the means of dark frames, which contain residual voltage noise.
pub(crate) const IN_THE_DARK: [MapKind; 3] =
    [MapKind::Offset, MapKind::DarkCurrent, MapKind::AfterLight];

/// The moments of one half.
#[derive(Clone, Copy)]
pub(crate) struct View<'a> {
    pub camera: &'a Camera,
    pub design: &'a Design,
    pub stacks: &'a [Temporal],
    pub maps: &'a [Map],
    /// What the model as given predicts.
    pub prediction: Option<&'a Prediction>,
}

impl<'a> View<'a> {
    /// The map of a kind, where the set has it.
    pub fn plane(&self, kind: MapKind) -> Option<&'a Plane<f32>> {
        self.maps.iter().find(|m| m.kind == kind).map(|m| &m.plane)
    }

    /// System gain of a stack, DN/e⁻.
    pub fn gain(&self, stack: usize) -> f64 {
        gain(self.camera, &self.design.conditions[stack])
    }

    /// Factor from a map's unit to that of findings: from DN to e⁻ for the offset.
    pub fn unit(&self, kind: MapKind) -> f64 {
        match (kind, maps::reference_dark(self.design)) {
            (MapKind::Offset, Some(dark)) => 1.0 / self.gain(dark),
            _ => 1.0,
        }
    }

    /// Mean of the reference dark, DN.
    pub fn black(&self) -> Option<f64> {
        Some(self.stacks[maps::reference_dark(self.design)?].level())
    }

    /// What the model as given predicts for a statistic.
    pub fn predicted(&self, key: Key) -> Option<f64> {
        Some(self.prediction?.of.get(&key)?.value)
    }

    /// Indices of the stacks of a role.
    pub fn stacks_of(&self, role: Role) -> impl Iterator<Item = usize> + 'a {
        let conditions = self.design.conditions.iter().enumerate();
        conditions.filter(move |(_, c)| c.stack.role == role).map(|(i, _)| i)
    }

    /// A map minus the median of each channel.
    pub fn about_median(&self, plane: &Plane<f32>) -> Plane<f32> {
        let mut plane = plane.clone();
        let channels = Channels::new(self.camera);
        let middles = channel_medians(&plane.data, &channels);
        channels.change(&mut plane.data, &middles, |v, m| v - m);
        plane
    }

    /// A map minus the mean of each channel, clipped.
    pub fn levelled(&self, plane: &Plane<f32>) -> Plane<f32> {
        let mut plane = self.about_median(plane);
        let channels = Channels::new(self.camera);
        let limit = (CLIP * robust_sd(plane.data.iter().copied())) as f32;
        plane.data.iter_mut().for_each(|v| *v = v.clamp(-limit, limit));
        let means = channels.means(&plane.data);
        channels.change(&mut plane.data, &means, |v, m| v - m);
        plane
    }
}

/// System gain under a condition, DN/e⁻.
pub(crate) fn gain(camera: &Camera, condition: &Condition) -> f64 {
    dn_per_e(camera, condition.stack.analog_gain)
}

/// The median of each channel.
pub(crate) fn channel_medians(values: &[f32], channels: &Channels) -> Vec<f64> {
    let mut own = vec![Vec::new(); channels.count()];
    channels.visit(values, |v, c| own[c].push(v));
    own.iter_mut().map(|v| f64::from(median(v, f32::total_cmp))).collect()
}

/// Multiplies the moments of each pixel over time: variance and lag, third and fourth moment each
/// by a factor that depends on the pixel and its variance.
pub(crate) fn scale_noise(t: &mut Temporal, by: impl Fn(usize, f32) -> [f32; 3]) {
    let second = t.pixel_variance.iter_mut().zip(&mut t.pixel_lag);
    let higher = t.pixel_third.iter_mut().zip(&mut t.pixel_fourth);
    for (i, ((variance, lag), (third, fourth))) in second.zip(higher).enumerate() {
        let [square, cube, fourth_power] = by(i, *variance);
        *variance *= square;
        *lag *= square;
        *third *= cube;
        *fourth *= fourth_power;
    }
}

/// Changes each value of a stack's mean frame by its column and row. The outermost pixels are
/// copies of those one period of the colour pattern further in, and change as those do.
pub(crate) fn change_mean(
    camera: &Camera,
    t: &mut Temporal,
    change: &dyn Fn(usize, usize, f64) -> f64,
) {
    let pattern = camera.sensor.pattern();
    let (w, h) = (t.width, t.height);
    let (across, down) = (usize::from(pattern.width), usize::from(pattern.height));
    let inside = |i: usize, n: usize, repeat: usize| match i {
        _ if n <= 2 * repeat => i,
        0 => repeat,
        i if i + 1 == n => i - repeat,
        i => i,
    };
    let mut by_row = vec![0.0; h];
    for (y, row) in t.mean.data.chunks_mut(w).enumerate() {
        for (x, v) in row.iter_mut().enumerate() {
            let old = f64::from(*v);
            let new = change(inside(x, w, across), inside(y, h, down), old);
            by_row[y] += (new - old) / w as f64;
            *v = new as f32;
        }
    }
    let level = by_row.iter().sum::<f64>() / h as f64;
    t.frame_means.iter_mut().for_each(|m| *m += level);
    for frame in t.row_means.chunks_mut(h) {
        frame.iter_mut().zip(&by_row).for_each(|(r, b)| *r += (b - level) as f32);
    }
}
