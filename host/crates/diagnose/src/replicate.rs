//! Frames of a model under the conditions of a capture: what another sensor of the same make would give.

use super::design::{BATCH, Condition, Design};
use super::looks::light::{self, Electrons};
use super::looks::{Gatherer, Look, Picture};
use super::temporal::{Collector, Temporal};
use camrig_base::Bands;
use camrig_base::{Plane, Result};
use camrig_camera::Camera;
use camrig_captures::CaptureSet;
use camrig_exposure::rows::rows;
use camrig_sensor_core::arith::{Arith, BLOCK, Block, Float, blocks};
use camrig_sensor_core::config::{FrameSettings, Pattern, SensorConfig};
use camrig_sensor_core::pipeline::MeanRows;
use rayon::prelude::*;

/// Moments of every stack of a design, simulated. `seed` names the sensor and its noise.
pub fn simulate(
    camera: &Camera,
    design: &Design,
    seed: u64,
    planes: bool,
) -> Result<Vec<Temporal>> {
    let band = Bands { start_nm: 550.0, step_nm: 10.0, count: 1 };
    let mut config = camera.sensor_config(&band)?;
    config.seed = seed;
    design.conditions.par_iter().map(|c| stack(&config, c, planes)).collect()
}

fn stack(config: &SensorConfig, condition: &Condition, planes: bool) -> Result<Temporal> {
    let (w, h) = (config.width as usize, config.height as usize);
    let mut collector = Collector::new(w, h, u32::from(config.bits), planes);
    let mut light = EvenLight::new(config, condition);
    let first = first_frame(condition.capture).wrapping_add(condition.skip as u32);
    let mut batch: Vec<Plane<u16>> = Vec::new();
    for (i, size) in batches(condition.frames) {
        batch.clear();
        for frame in i..i + size {
            let settings = FrameSettings {
                frame: first.wrapping_add(frame as u32),
                exposure_s: condition.exposure_s as f32,
                analog_gain: condition.analog_gain as f32,
                temperature_c: condition.temperature_c as f32,
            };
            let mut plane = Plane { width: w, height: h, data: vec![0; w * h] };
            rows::<Float>(config, &settings, &mut light, 0, &mut plane.data)?;
            batch.push(plane);
        }
        collector.add(&batch);
    }
    Ok(collector.finish().without_border(&config.pattern))
}

/// Start and size of the batches of a stack: whole ones, the last one never a single frame.
fn batches(frames: usize) -> Vec<(usize, usize)> {
    let count = frames.div_ceil(BATCH).max(1);
    let (size, more) = (frames / count, frames % count);
    let mut start = 0;
    (0..count)
        .map(|i| {
            let size = size + usize::from(i < more);
            start += size;
            (start - size, size)
        })
        .collect()
}

/// Frames of different captures, or of different halves of one, share no temporal noise; those of one follow each other.
fn first_frame(capture: usize) -> u32 {
    10_000 * (capture as u32 + 1)
}

/// The picture of every look of a design, simulated from its light.
///
/// # Errors
/// A model that the sensor refuses; a picture in which nothing can be measured is none.
pub fn pictures(
    camera: &Camera,
    looks: &[Look],
    lights: &[Electrons],
    seed: u64,
) -> Result<Vec<Picture>> {
    let band = Bands { start_nm: 550.0, step_nm: 10.0, count: 1 };
    let mut config = camera.sensor_config(&band)?;
    config.seed = seed;
    let (width, height) = (config.width as usize, config.height as usize);
    looks
        .par_iter()
        .zip(lights)
        .map(|(look, electrons)| {
            let mut gatherer = Gatherer::new(camera, look);
            let mut plane = Plane { width, height, data: vec![0; width * height] };
            for frame in 0..look.frames {
                let settings = FrameSettings {
                    frame: first_frame(look.capture).wrapping_add(frame as u32),
                    exposure_s: look.exposure_s as f32,
                    analog_gain: look.analog_gain as f32,
                    temperature_c: look.temperature_c as f32,
                };
                let mut light = SceneLight { electrons, share: light::share(look) as f32 };
                rows::<Float>(&config, &settings, &mut light, 0, &mut plane.data)?;
                gatherer.add(&plane);
            }
            Ok(gatherer.finish())
        })
        .collect()
}

/// The same mean photo-electrons for all pixels of a channel: one row for each of the pattern's.
struct EvenLight {
    now: Vec<Vec<Block<f32>>>,
    before: Vec<Vec<Block<f32>>>,
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
}

impl MeanRows<Float> for EvenLight {
    fn mean_row(&mut self, row: u32, out: &mut [Block<f32>]) {
        out.copy_from_slice(&self.now[row as usize % self.now.len()]);
    }

    fn previous_mean_row(&mut self, row: u32, out: &mut [Block<f32>]) {
        out.copy_from_slice(&self.before[row as usize % self.before.len()]);
    }
}

/// The light of a scene; each frame follows one of the same.
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

/// The picture of every look of a design, from the set's frames.
///
/// # Errors
/// Files that cannot be read.
pub fn seen(
    camera: &Camera,
    set: &CaptureSet,
    looks: &[Look],
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Vec<Picture>> {
    looks
        .par_iter()
        .map(|look| {
            let (mut gatherer, mut seen) = (Gatherer::new(camera, look), 0);
            set.for_each_batch(&set.captures[look.capture], |frames| {
                for frame in frames {
                    if (look.skip..look.skip + look.frames).contains(&seen) {
                        gatherer.add(frame);
                    }
                    seen += 1;
                }
                progress(frames.len());
                Ok(())
            })?;
            Ok(gatherer.finish())
        })
        .collect()
}

/// Moments of every stack of a design, from the set's frames of a sensor with this colour filter pattern.
///
/// # Errors
/// Files that cannot be read.
pub fn measure(
    set: &CaptureSet,
    pattern: &Pattern,
    design: &Design,
    planes: bool,
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Vec<Temporal>> {
    let s = &set.sensor;
    design
        .conditions
        .par_iter()
        .map(|c| {
            let mut collector = Collector::new(s.width, s.height, s.bits, planes);
            let sizes = batches(c.frames);
            let (mut seen, mut held, mut next) = (0, Vec::new(), 0);
            set.for_each_batch(&set.captures[c.capture], |frames| {
                for frame in frames {
                    if seen >= c.skip && seen < c.skip + c.frames {
                        held.push(frame.clone());
                        if sizes.get(next).is_some_and(|b| b.1 == held.len()) {
                            collector.add(&held);
                            held.clear();
                            next += 1;
                        }
                    }
                    seen += 1;
                }
                progress(frames.len());
                Ok(())
            })?;
            Ok(collector.finish().without_border(pattern))
        })
        .collect()
}
