//! Replicates: frames of a model under the conditions of a capture set, as another sensor of the
//! same make would give them, by `sensor-core` itself.

use super::light::{self, Electrons};
use crate::data::design::{Condition, Design, Stack, Target};
use crate::statistics::read::{batches, min_stacks_per_thread};
use crate::statistics::targets::{Picture, PictureCollector};
use crate::statistics::temporal::{Collector, Temporal};
use camrig_base::{Bands, Error, Plane, Result};
use camrig_camera::Camera;
use camrig_exposure::rows::rows;
use camrig_sensor_core::arith::{Arith, BLOCK, Block, Float, blocks};
use camrig_sensor_core::config::{FrameSettings, SensorConfig};
use camrig_sensor_core::effects::{Effect, Needs};
use camrig_sensor_core::pipeline::MeanRows;
use rayon::prelude::*;
use std::borrow::Cow;

/// What bias frames, of no exposure, are simulated with, s: dark current gives nothing in it.
const SHORTEST_S: f32 = 1e-9;

/// The sensor of a camera that makes a replicate of a stack, with whose first frame it starts;
/// `seed` names the sensor and its noise. It is given photo-electrons, so that its bands do not
/// matter. Particles are left out of the frames, and so they are of the model.
fn sensor(camera: &Camera, stack: &Stack, seed: u64) -> Result<SensorConfig> {
    if camera.chain().iter().any(|e| e.entry().needs == Needs::EarlierFrames) {
        return Err(Error::unsupported(
            "persistence in the model of captures, whose frames before are not known",
        )
        .help("remove the effect from the camera file"));
    }
    let band = Bands { start_nm: 550.0, step_nm: 10.0, count: 1 };
    let mut config = camera.clone().starting_at(stack.first_number).sensor_config(&band)?;
    config.effects.retain(|e| !matches!(e, Effect::ParticleHits(_)));
    config.seed = seed;
    Ok(config)
}

/// Settings of a frame of a stack, by its number among those of its capture.
fn settings(stack: &Stack, frame: usize) -> FrameSettings {
    FrameSettings::new((stack.exposure_s as f32).max(SHORTEST_S))
        .with_frame(stack.first_number.wrapping_add(frame as u32))
        .with_gain(stack.analog_gain as f32)
        .with_temperature(stack.temperature_c as f32)
}

/// Moments of every dark and flat stack of a design, simulated; with `planes` also their power
/// over two frequencies. `seed` names the sensor and its noise.
///
/// # Errors
/// A model that the sensor refuses.
pub fn simulate(
    camera: &Camera,
    design: &Design,
    seed: u64,
    planes: bool,
) -> Result<Vec<Temporal>> {
    let pixels = (camera.sensor.width * camera.sensor.height) as usize;
    let least = min_stacks_per_thread(design, pixels);
    let conditions = design.conditions.par_iter().with_min_len(least);
    let simulated = conditions.map(|c| {
        let config = sensor(camera, &c.stack, seed)?;
        moments(&config, c, design.white_level_dn, planes)
    });
    simulated.collect()
}

fn moments(
    config: &SensorConfig,
    condition: &Condition,
    full_scale_dn: u16,
    planes: bool,
) -> Result<Temporal> {
    let (w, h) = (config.width as usize, config.height as usize);
    let mut collector = Collector::new(w, h, full_scale_dn, planes);
    let light = EvenLight::new(config, condition);
    let stack = &condition.stack;
    let simulated = |i: usize| frame(config, &light, stack, i);
    for batch in batches(stack.frames) {
        // Where frames are few and large, processors share the frames of a stack.
        let frames: Result<Vec<_>> = batch.into_par_iter().map(simulated).collect();
        collector.add(&frames?);
    }
    Ok(collector.finish().without_border(&config.pattern))
}

/// A frame of a stack.
fn frame(
    config: &SensorConfig,
    light: &EvenLight,
    stack: &Stack,
    frame: usize,
) -> Result<Plane<u16>> {
    let (w, h) = (config.width as usize, config.height as usize);
    let settings = settings(stack, stack.skip + frame);
    let share = stack.variation.light_of(frame) as f32;
    let config = with_offset(config, stack.variation.offset_of(frame));
    let mut plane = Plane { width: w, height: h, data: vec![0; w * h] };
    rows::<Float>(&config, &settings, &mut light.of_frame(share), 0, &mut plane.data)?;
    Ok(plane)
}

/// The frames of a stack, each as `keep` leaves it.
///
/// # Errors
/// A model that the sensor refuses.
pub(crate) fn frames(
    camera: &Camera,
    condition: &Condition,
    seed: u64,
    keep: &(dyn Fn(Plane<u16>) -> Plane<u16> + Sync),
) -> Result<Vec<Plane<u16>>> {
    let config = sensor(camera, &condition.stack, seed)?;
    let light = EvenLight::new(&config, condition);
    let all = (0..condition.stack.frames).into_par_iter();
    all.map(|i| Ok(keep(frame(&config, &light, &condition.stack, i)?))).collect()
}

/// The sensor with its black level moved.
fn with_offset(config: &SensorConfig, offset_dn: f64) -> Cow<'_, SensorConfig> {
    if offset_dn == 0.0 {
        return Cow::Borrowed(config);
    }
    let mut config = config.clone();
    config.black_level_dn = (config.black_level_dn + offset_dn as f32).max(0.0);
    Cow::Owned(config)
}

/// The picture of every target, simulated from its light. Both halves of a capture have the same
/// frames, as one prediction serves both.
///
/// # Errors
/// A model that the sensor refuses.
pub fn pictures(
    camera: &Camera,
    targets: &[Target],
    lights: &[Electrons],
    seed: u64,
) -> Result<Vec<Picture>> {
    let (width, height) = (camera.sensor.width as usize, camera.sensor.height as usize);
    targets
        .par_iter()
        .zip(lights)
        .map(|(target, electrons)| {
            let config = sensor(camera, &target.stack, seed)?;
            let mut collector = PictureCollector::new(camera, target);
            let mut plane = Plane { width, height, data: vec![0; width * height] };
            for frame in 0..target.stack.frames {
                let settings = settings(&target.stack, frame);
                let mut light = SceneLight { electrons, share: light::share(target) as f32 };
                rows::<Float>(&config, &settings, &mut light, 0, &mut plane.data)?;
                collector.add(&plane);
            }
            Ok(collector.finish())
        })
        .collect()
}

/// The same mean photo-electrons for all pixels of a channel: one row for each row of the pattern.
struct EvenLight {
    now: Vec<Vec<Block<f32>>>,
    before: Vec<Vec<Block<f32>>>,
}

/// The same in one frame.
struct EvenFrame<'a> {
    light: &'a EvenLight,
    /// Light of the frame over that of the stack.
    share: f32,
}

impl EvenLight {
    fn new(config: &SensorConfig, condition: &Condition) -> Self {
        let pattern = &config.pattern;
        let row = |means: &[f64], y: usize| {
            let mut row = vec![[0.0; BLOCK]; blocks(config.width as usize)];
            for (x, v) in row.as_flattened_mut().iter_mut().enumerate() {
                let channel = if means.len() == 1 { 0 } else { pattern.channel(x, y) };
                *v = Float::signal(means.get(channel).copied().unwrap_or(0.0) as f32);
            }
            row
        };
        let rows = |means| (0..pattern.height.max(1).into()).map(|y| row(means, y)).collect();
        Self { now: rows(&condition.photo_e), before: rows(&condition.before_e) }
    }

    fn of_frame(&self, share: f32) -> EvenFrame<'_> {
        EvenFrame { light: self, share }
    }
}

impl MeanRows<Float> for EvenFrame<'_> {
    fn mean_row(&mut self, row: u32, out: &mut [Block<f32>]) {
        let now = &self.light.now;
        out.copy_from_slice(&now[row as usize % now.len()]);
        if self.share != 1.0 {
            out.as_flattened_mut().iter_mut().for_each(|e| *e *= self.share);
        }
    }

    fn previous_mean_row(&mut self, row: u32, out: &mut [Block<f32>]) {
        let before = &self.light.before;
        out.copy_from_slice(&before[row as usize % before.len()]);
    }
}

/// The light of a scene; each frame follows one in the same light.
struct SceneLight<'a> {
    electrons: &'a Plane<f32>,
    share: f32,
}

impl MeanRows<Float> for SceneLight<'_> {
    fn mean_row(&mut self, row: u32, out: &mut [Block<f32>]) {
        let width = self.electrons.width;
        let from = row as usize * width;
        let source = &self.electrons.data[from..from + width];
        let out = out.as_flattened_mut();
        out.iter_mut().zip(source).for_each(|(o, &e)| *o = Float::signal(e * self.share));
        out[width..].fill(Float::signal(0.0));
    }

    fn previous_mean_row(&mut self, row: u32, out: &mut [Block<f32>]) {
        self.mean_row(row, out);
    }
}
