//! What is measured in captures of things: an edge, a grid of dots, a ColorChecker.
//!
//! A [`Look`] is a stack of one thing. Of its frames a [`Picture`] is kept: their mean, and for a ColorChecker the
//! scatter in the patches of each. [`battery`] makes statistics of it, the same from measured frames and from the
//! model's, so that what the measurement itself does to a figure (sampling by a colour filter, the window of the
//! edge, the square of a patch) is in both.

mod chart;
mod dots;
mod edge;
pub mod light;

use super::design::Design;
use super::statistics::{Place, Scale, Statistic, What};
use camrig_base::{Plane, Result};
use camrig_camera::Camera;
use camrig_captures::Role;
use camrig_measure::patches;
use camrig_scene::chart::Geometry;

pub use dots::RINGS;

/// A stack of one thing.
#[derive(Clone, Debug)]
pub struct Look {
    /// Index of the capture in the set.
    pub capture: usize,
    /// Its id.
    pub id: String,
    /// What it is for.
    pub role: Role,
    /// Frames left out at its start.
    pub skip: usize,
    /// Frames used.
    pub frames: usize,
    /// Exposure, s.
    pub exposure_s: f64,
    /// Analog gain.
    pub analog_gain: f64,
    /// Temperature, °C; the camera's where the manifest has none.
    pub temperature_c: f64,
    /// The scene, as on the command line.
    pub scene: String,
    /// Where things lie in it.
    pub geometry: Geometry,
    /// Illuminant of a reflecting scene.
    pub illuminant: Option<String>,
    /// Illuminance, lx, where the manifest tells.
    pub lux: Option<f64>,
    /// Factor on the model's light: 1 where the illuminance is known, else what makes the means agree.
    pub light: f64,
}

/// A figure of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Figure {
    /// Response of an edge: part of the edge (from its start), channel, tenths of a cycle per pixel.
    Response(u8, u8, u8),
    /// Level of the dark (0) and the bright side (1) of an edge: side, channel.
    EdgeLevel(u8, u8),
    /// Distance of dots from where an ideal image has them, away from the centre, pixels: ring.
    Outwards(u8),
    /// The same to the right.
    Rightwards(u8),
    /// The same downwards.
    Downwards(u8),
    /// Dots of a channel further out than those of the sharpest-sampled one, pixels: channel, ring.
    Apart(u8, u8),
    /// Root mean square radius of the dots, pixels: ring.
    DotRadius(u8),
    /// Level between the dots: channel, ring.
    Ground(u8, u8),
    /// Mean of a patch: patch, channel.
    PatchMean(u8, u8),
    /// Standard deviation of the luminance in a patch.
    PatchScatter(u8),
}

/// What is kept of a stack.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Mean of the frames.
    pub mean: Plane<f32>,
    /// Frames.
    pub frames: usize,
    /// Variance of the luminance in each patch of a ColorChecker, mean of the frames.
    pub patch_variance: Vec<f64>,
}

/// Collects a [`Picture`].
pub struct Gatherer<'a> {
    camera: &'a Camera,
    look: &'a Look,
    sum: Plane<f32>,
    frames: usize,
    patch_variance: Vec<f64>,
}

impl<'a> Gatherer<'a> {
    /// For frames of a camera.
    pub fn new(camera: &'a Camera, look: &'a Look) -> Self {
        let (width, height) = (camera.sensor.width as usize, camera.sensor.height as usize);
        let sum = Plane { width, height, data: vec![0.0; width * height] };
        Self { camera, look, sum, frames: 0, patch_variance: Vec::new() }
    }

    /// Adds a frame.
    pub fn add(&mut self, frame: &Plane<u16>) {
        self.sum.data.iter_mut().zip(&frame.data).for_each(|(s, &v)| *s += f32::from(v));
        self.frames += 1;
        if let Geometry::Patches { card_width } = self.look.geometry {
            // A chart that cannot be measured is refused with words when its mean is.
            let variances = chart::variances(self.camera, card_width, frame).unwrap_or_default();
            self.patch_variance.resize(patches::COUNT, 0.0);
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

/// A figure with its value, standard deviation, and scale.
type Found = (Figure, f64, f64, Scale);

/// The figures of a picture.
///
/// # Errors
/// A thing that is not where its scene has it.
pub fn figures(camera: &Camera, look: &Look, picture: &Picture) -> Result<Vec<Found>> {
    match &look.geometry {
        Geometry::Edge { angle_deg, horizontal } => {
            edge::figures(camera, *angle_deg, *horizontal, picture)
        }
        Geometry::Patches { card_width } => {
            chart::figures(camera, *card_width, picture, look.lux.is_some())
        }
        Geometry::Dots(dots) => Ok(dots::figures(camera, dots, picture)),
    }
}

/// The statistics of the looks of a design. A picture in which its thing is not found gives none.
pub fn battery(camera: &Camera, design: &Design, pictures: &[Picture]) -> Vec<Statistic> {
    let mut out = Vec::new();
    for (i, (look, picture)) in design.looks.iter().zip(pictures).enumerate() {
        for (figure, value, sd, scale) in figures(camera, look, picture).unwrap_or_default() {
            if value.is_finite() && sd.is_finite() && (look.lux.is_some() || !figure.is_level()) {
                let (place, what) = (Place::Look(i), What::Of(figure));
                out.push(Statistic { place, what, value, sd, scale });
            }
        }
    }
    out
}

impl Figure {
    /// Whether it says how much light there was.
    pub fn is_level(self) -> bool {
        matches!(self, Self::EdgeLevel(..) | Self::Ground(..) | Self::PatchMean(..))
    }
}

/// The channel that is sampled most densely: that of most pixels.
pub fn densest(camera: &Camera) -> usize {
    let cfa = &camera.sensor.cfa;
    let count = |letter: char| cfa.letters.iter().filter(|l| **l == letter).count();
    let channels = cfa.channels();
    // The first of equals.
    (0..channels.len()).rev().max_by_key(|&c| count(channels[c])).unwrap_or(0)
}
