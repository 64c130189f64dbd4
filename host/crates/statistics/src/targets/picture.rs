//! The mean picture of a target.

use super::patches::variances;
use crate::data::design::Target;
use camrig_base::Plane;
use camrig_camera::Camera;
use camrig_measure::patches::COUNT;
use camrig_scene::chart::Geometry;

/// The frames of a target, reduced to what its figures are computed from.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Mean of the frames, DN.
    pub mean: Plane<f32>,
    /// Number of frames.
    pub frames: usize,
    /// Variance of the luminance within each patch of a ColorChecker, DN², averaged over the
    /// frames; empty for other targets.
    pub patch_variance: Vec<f64>,
}

/// Collects a [`Picture`].
pub struct PictureCollector<'a> {
    camera: &'a Camera,
    target: &'a Target,
    sum: Plane<f32>,
    frames: usize,
    patch_variance: Vec<f64>,
}

impl<'a> PictureCollector<'a> {
    /// For frames of a target by a camera.
    pub fn new(camera: &'a Camera, target: &'a Target) -> Self {
        let (width, height) = (camera.sensor.width as usize, camera.sensor.height as usize);
        let sum = Plane { width, height, data: vec![0.0; width * height] };
        Self { camera, target, sum, frames: 0, patch_variance: Vec::new() }
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: &Plane<u16>) {
        self.sum.data.iter_mut().zip(&frame.data).for_each(|(s, &v)| *s += f32::from(v));
        self.frames += 1;
        if let Geometry::Patches { card_width } = self.target.geometry {
            // A chart that cannot be measured is reported when the mean frame is measured.
            let variances = variances(self.camera, card_width, frame).unwrap_or_default();
            self.patch_variance.resize(COUNT, 0.0);
            self.patch_variance.iter_mut().zip(variances).for_each(|(s, v)| *s += v);
        }
    }

    /// The picture.
    pub fn finish(mut self) -> Picture {
        let n = self.frames.max(1);
        self.sum.data.iter_mut().for_each(|v| *v /= n as f32);
        self.patch_variance.iter_mut().for_each(|v| *v /= n as f64);
        Picture { mean: self.sum, frames: n, patch_variance: self.patch_variance }
    }
}

/// The channel with most pixels, the first of several, by its index.
pub fn densest_channel(camera: &Camera) -> usize {
    let cfa = &camera.sensor.cfa;
    let count = |letter: char| cfa.letters.iter().filter(|l| **l == letter).count();
    let channels = cfa.channels();
    (0..channels.len()).rev().max_by_key(|&c| count(channels[c])).unwrap_or(0)
}
