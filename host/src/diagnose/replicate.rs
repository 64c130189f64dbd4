//! Frames of a model under the conditions of a capture: what another sensor of the same make would give.

use super::design::{BATCH, Condition, Design};
use super::looks::light::{self, Electrons};
use super::looks::{Gatherer, Look, Picture};
use super::temporal::{Collector, Temporal};
use crate::camera::Camera;
use crate::captures::CaptureSet;
use crate::scene::Bands;
use crate::{Error, Plane, Result};
use multiversion::multiversion;
use rayon::prelude::*;
use sensor_core::arith::{Arith, BLOCK, Block, Float};
use sensor_core::config::{FrameSettings, SensorConfig};
use sensor_core::pipeline::{MeanRows, Pipeline, memory_blocks};

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
    let first = first_frame(condition.capture);
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
            let light = EvenLight { config, now: &condition.photo_e, before: &condition.before_e };
            rows(config, light, &settings, &mut plane.data)?;
            batch.push(plane);
        }
        collector.add(&batch);
    }
    Ok(collector.finish())
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

/// Frames of different captures share no temporal noise; those of one follow each other.
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
                let light = SceneLight { electrons, share: light::share(look) as f32 };
                scene_rows(&config, light, &settings, &mut plane.data)?;
                gatherer.add(&plane);
            }
            Ok(gatherer.finish())
        })
        .collect()
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn scene_rows(
    config: &SensorConfig,
    light: SceneLight<'_>,
    settings: &FrameSettings,
    out: &mut [u16],
) -> Result<()> {
    expose(config, light, settings, out)
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn rows(
    config: &SensorConfig,
    light: EvenLight<'_>,
    settings: &FrameSettings,
    out: &mut [u16],
) -> Result<()> {
    expose(config, light, settings, out)
}

#[inline(always)]
fn expose(
    config: &SensorConfig,
    mut source: impl MeanRows<Float>,
    settings: &FrameSettings,
    out: &mut [u16],
) -> Result<()> {
    let refused = |e| Error::input(format!("the sensor model refuses this configuration: {e:?}"));
    let mut memory = vec![[0.0f32; BLOCK]; memory_blocks(config)];
    let mut pipeline = Pipeline::<Float>::new(config, settings, &mut memory).map_err(refused)?;
    for (y, out) in out.chunks_mut(config.width as usize).enumerate() {
        pipeline.row(y as u32, &mut source, out);
    }
    Ok(())
}

/// The same mean photo-electrons for all pixels of a channel.
struct EvenLight<'a> {
    config: &'a SensorConfig,
    now: &'a [f64],
    before: &'a [f64],
}

impl EvenLight<'_> {
    #[inline(always)]
    fn fill(&self, means: &[f64], row: u32, out: &mut [Block<f32>]) {
        if let [mean] = means {
            out.fill([Float::signal(*mean as f32); BLOCK]);
            return;
        }
        for (x, v) in out.as_flattened_mut().iter_mut().enumerate() {
            let channel = self.config.pattern.channel(x, row as usize);
            *v = Float::signal(means.get(channel).copied().unwrap_or(0.0) as f32);
        }
    }
}

impl MeanRows<Float> for EvenLight<'_> {
    #[inline(always)]
    fn mean_row(&mut self, row: u32, out: &mut [Block<f32>]) {
        self.fill(self.now, row, out);
    }

    #[inline(always)]
    fn previous_mean_row(&mut self, row: u32, out: &mut [Block<f32>]) {
        self.fill(self.before, row, out);
    }
}

/// The light of a scene; each frame follows one of the same.
struct SceneLight<'a> {
    electrons: &'a Plane<f32>,
    share: f32,
}

impl MeanRows<Float> for SceneLight<'_> {
    #[inline(always)]
    fn mean_row(&mut self, row: u32, out: &mut [Block<f32>]) {
        let width = self.electrons.width;
        let from = row as usize * width;
        let source = &self.electrons.data[from..from + width];
        let out = out.as_flattened_mut();
        out.iter_mut().zip(source).for_each(|(o, &e)| *o = Float::signal(e * self.share));
        out[width..].fill(Float::signal(0.0));
    }

    #[inline(always)]
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

/// Moments of every stack of a design, from the set's frames.
///
/// # Errors
/// Files that cannot be read.
pub fn measure(
    set: &CaptureSet,
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
            Ok(collector.finish())
        })
        .collect()
}
