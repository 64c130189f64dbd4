//! Data sets of many pictures. A [`Sweep`] is a grid of cameras, scenes, lights (lx), exposures
//! (s), gains and seeds; [`run`] renders a [`Shard`] of it into a [`Dataset`], a folder with a
//! manifest.
//!
//! A picture depends on the sweep file, its place in the grid and the kind of device alone: not on
//! the shard it was made in, the threads, or what was there already. See [`sweep`] for the file
//! and [`dataset`] for what is on disk.
//!
//! # Example
//! ```
//! use camrig_batch::{Shard, Sweep};
//!
//! let path = std::env::temp_dir().join(format!("camrig-batch-{}.toml", std::process::id()));
//! let text = "format = 'sweep/1'\n[grid]\ncamera = 'mt9t012'\nscene = ['colorchecker', 'ramp']\n\
//!     lux = [10, 100, 1000]\nexposure_s = 0.01\n";
//! std::fs::write(&path, text)?;
//! let sweep = Sweep::load(&path)?;
//! std::fs::remove_file(&path)?;
//! assert_eq!(sweep.pictures(), 6);
//! assert_eq!((sweep.picture(4).lux, sweep.picture(4).exposure_s), (Some(100.0), 0.01));
//! assert_eq!(Shard::parse("2/3")?.pictures(6), 2..4);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod dataset;
pub mod draws;
pub mod figures;
mod labels;
pub mod sweep;
mod tars;

pub use dataset::Dataset;
use dataset::Sample;
pub use sweep::{Picture, Sweep};

use camrig_base::{Error, Result, npy};
use camrig_camera::Camera;
use camrig_formats::{Facts, Format, Frames};
use camrig_light::LightLevel;
use camrig_measure::dark_stack;
use camrig_optics::{Device, Options};
use camrig_render::places::Places;
use camrig_render::{self as render, OpticsOutput, OpticsPath, OpticsStage, SimulatedSensor};
use camrig_sensor_core::effects::Class;
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::PathBuf;
use sweep::{Clean, CleanUnit, Named};

/// One of `count` equal parts of a sweep, counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which part.
    pub number: u64,
    /// Parts in all.
    pub count: u64,
}

impl Shard {
    /// The whole sweep.
    pub const WHOLE: Self = Self { number: 1, count: 1 };

    /// Reads `3/64`.
    ///
    /// # Errors
    /// Anything but K/N with K from 1 to N.
    pub fn parse(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(number, count)| {
            Some(Self { number: number.trim().parse().ok()?, count: count.trim().parse().ok()? })
        });
        parts
            .filter(|s| (1..=s.count).contains(&s.number))
            .ok_or_else(|| format!("{text:?}: use K/N with K from 1 to N, for instance 3/64"))
    }

    /// The pictures of this part of `total` pictures. They are neighbours in the grid, so that
    /// most of them share the optics stage.
    pub fn pictures(self, total: u64) -> Range<u64> {
        // Through 128 bits: a product of two 64-bit numbers.
        let end = |k: u64| (u128::from(total) * u128::from(k) / u128::from(self.count)) as u64;
        end(self.number - 1)..end(self.number)
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

/// Makes those of some pictures that are not there yet, the optics on `device`. Results of the
/// optics stage are kept in the folder `cache`, where one is given; `progress` is called once for
/// each of these pictures, `tell` with each note for the user, once.
///
/// # Errors
/// What rendering or the disk refuses; pictures made so far stay.
pub fn run(
    sweep: &Sweep,
    dataset: &Dataset,
    pictures: Range<u64>,
    device: Device,
    cache: Option<PathBuf>,
    progress: impl Fn() + Sync,
    mut tell: impl FnMut(&str),
) -> Result<()> {
    let mut told = BTreeSet::new();
    let mut darks = Darks::default();
    let pictures: Vec<Picture<'_>> = pictures.map(|i| sweep.picture(i)).collect();
    for group in pictures.chunk_by(|a, b| a.same_view(b)) {
        let missing: Vec<&Picture<'_>> = group.iter().filter(|p| !dataset.has(p.index)).collect();
        (missing.len()..group.len()).for_each(|_| progress());
        let Some(first) = missing.first() else { continue };
        let camera = Camera::load_with(&first.camera.spec, &first.camera.changes)?;
        let camera = render::with_filter_angles(camera)?;
        let optics_stage = OpticsStage {
            scene: first.scene.spec.clone(),
            illuminant: sweep.names_light.then(|| first.illuminant.spec.clone()),
            level: sweep.base_lux().map(LightLevel::Lux),
            options: Options { oversample: sweep.oversample, device, ..Options::default() },
            cache: cache.clone(),
            motion: None,
            path: OpticsPath::Bands,
        };
        let view = optics_stage.run(&camera, |_, _| ())?;
        for note in view.notes.iter().cloned().chain(of_clean(sweep, &camera)) {
            if told.insert(note.clone()) {
                tell(&note);
            }
        }
        darks.take(sweep, &camera, &view, &missing)?;
        let labels = labels_of(first.scene, &camera)?;
        missing.par_iter().try_for_each(|picture| {
            let mut sample = take(sweep, &camera, &view, picture, &darks)
                .map_err(|e| e.at(format!("picture {}", picture.index)))?;
            sample.beside.extend(labels.iter().cloned());
            dataset.put(picture.index, sample)?;
            progress();
            Ok::<(), Error>(())
        })?;
        dataset.pack(first.index..group[group.len() - 1].index + 1)?;
    }
    Ok(())
}

/// The labels of a scene as a camera sees them.
fn labels_of(scene: &Named, camera: &Camera) -> Result<Vec<(&'static str, Vec<u8>)>> {
    if scene.labels.is_empty() {
        return Ok(Vec::new());
    }
    let size = camrig_scene_files::open_file(&scene.spec)?.size();
    let places = Places::new(camera, size)?;
    let frame = (camera.sensor.width as usize, camera.sensor.height as usize);
    labels::carried(&scene.labels, &places, size, frame)
}

/// What dark frames of a picture depend on, in words: camera, sensor seed, exposure and gain.
type DarkKey = String;

/// Dynamic ranges of channels, dB, by what they depend on: scenes and light levels share them.
#[derive(Default)]
struct Darks(BTreeMap<DarkKey, Vec<camrig_measure::Value>>);

impl Darks {
    fn key(picture: &Picture<'_>) -> DarkKey {
        let Picture { camera, sensor_seed, exposure_s, analog_gain, .. } = picture;
        format!("{camera:?} {sensor_seed:?} {exposure_s:?} {analog_gain:?}")
    }

    /// Takes the dark frames of pictures that are not there yet.
    fn take(
        &mut self,
        sweep: &Sweep,
        camera: &Camera,
        view: &OpticsOutput,
        pictures: &[&Picture<'_>],
    ) -> Result<()> {
        for picture in pictures.iter().filter(|_| sweep.figures.takes_dark()) {
            if let Entry::Vacant(place) = self.0.entry(Self::key(picture)) {
                let ranges = dynamic_ranges_db(sweep, camera, view, picture)
                    .map_err(|e| e.at(format!("dark frames of picture {}", picture.index)))?;
                place.insert(ranges);
            }
        }
        Ok(())
    }
}

/// What the expected signal of `[clean]` lacks of a camera's mean signal.
fn of_clean(sweep: &Sweep, camera: &Camera) -> Option<String> {
    sweep.clean.as_ref()?;
    let entries = camera.effects.iter().map(|effect| effect.entry());
    let bend: Vec<&str> =
        entries.filter(|entry| entry.class == Class::Response).map(|entry| entry.kind).collect();
    (!bend.is_empty()).then(|| {
        format!("clean: the signal before {}, which change the mean of frames", bend.join(", "))
    })
}

/// Dynamic range of each channel, dB, from two frames without light, of numbers that no picture of
/// a sweep has.
fn dynamic_ranges_db(
    sweep: &Sweep,
    camera: &Camera,
    view: &OpticsOutput,
    picture: &Picture<'_>,
) -> Result<Vec<camrig_measure::Value>> {
    let camera = of_picture(camera, picture);
    let unlit = SimulatedSensor::in_light(&camera, &view.cube.header, 0.0)?;
    let take = |number| {
        let settings = camera.settings(number, picture.exposure_s, picture.analog_gain);
        unlit.frame_with(
            &view.cube,
            &settings,
            camrig_render::FrameOptions {
                arithmetic: sweep.arithmetic,
                ..camrig_render::FrameOptions::default()
            },
        )
    };
    let gain = camera.settings(0, picture.exposure_s, picture.analog_gain).analog_gain;
    let dn_per_e = f64::from(unlit.config.dn_per_e(gain));
    let channels = dark_stack::channels_of(&[take(u32::MAX)?, take(u32::MAX - 1)?])?;
    Ok(channels.iter().map(|c| c.dynamic_range_db(dn_per_e)).collect())
}

/// The camera with the picture's sensor.
fn of_picture(camera: &Camera, picture: &Picture<'_>) -> Camera {
    let mut camera = camera.clone();
    if let Some(seed) = picture.sensor_seed {
        camera.sensor.seed = seed;
    }
    camera
}

fn take(
    sweep: &Sweep,
    camera: &Camera,
    view: &OpticsOutput,
    picture: &Picture<'_>,
    darks: &Darks,
) -> Result<Sample> {
    let camera = of_picture(camera, picture);
    let mut header = match picture.lux {
        Some(lux) => view.header_at(lux)?,
        None => view.cube.header.clone(),
    };
    // As the sweep file names it: where it lies must not show in the picture's bytes.
    header.made_of = format!("scene {}, lens of {}", picture.scene.name, camera.name);
    let sensor = SimulatedSensor::new(&camera, &header)?;
    let settings = camera.settings(picture.frame, picture.exposure_s, picture.analog_gain);
    let before = (picture.burst > 0).then_some(&view.cube);
    let frame = sensor.frame_with(
        &view.cube,
        &settings,
        camrig_render::FrameOptions {
            before,
            arithmetic: sweep.arithmetic,
            ..camrig_render::FrameOptions::default()
        },
    )?;
    let info =
        render::frame_info(&camera, &settings, view.light.as_ref(), &header, sweep.opcodes)?;
    let scene = &picture.scene.name;
    let ranges = darks.0.get(&Darks::key(picture));
    let figures = figures::of(&frame, ranges.map(Vec::as_slice), &info, scene, &sweep.figures)?;
    let facts = Facts { dng: Some(info), ..Facts::of(&frame) };
    let format = Format::parse(&sweep.files)?;
    let bytes = format.encode(&Frames { facts, ..Frames::from_raw(&frame) })?;
    let mut beside = Vec::new();
    if let Some(Clean { unit }) = sweep.clean {
        let mut clean = sensor.electrons(&view.cube, &settings)?;
        if unit == CleanUnit::Dn {
            let dn_per_e = sensor.config.dn_per_e(settings.analog_gain);
            let black_dn = frame.black_level_dn as f32;
            clean.data.iter_mut().for_each(|v| *v = black_dn + dn_per_e * *v);
        }
        let mut file = Vec::new();
        npy::write(&mut file, &format!("({}, {})", clean.height, clean.width), &clean.data)
            .map_err(|e| Error::input(e.to_string()))?;
        beside.push(("clean.npy", file));
    }
    let parameters = parameters(&camera, &header, picture, settings.analog_gain);
    Ok(Sample { frame: bytes, beside, parameters, figures })
}

/// The values of a picture by which it differs from the others of its sweep.
fn parameters(
    camera: &Camera,
    header: &render::CubeHeader,
    picture: &Picture<'_>,
    analog_gain: f32,
) -> Value {
    let variant = &picture.camera;
    let changes: Map<String, Value> =
        variant.changes.iter().map(|c| (c.key.clone(), json!(c.value))).collect();
    json!({
        "camera": variant.name,
        "camera_keys": changes,
        "scene": picture.scene.name,
        "illuminant": header.illuminant.is_some().then_some(&picture.illuminant.name),
        "lux": header.lux,
        "exposure_s": picture.exposure_s,
        "analog_gain": analog_gain,
        "sensor_seed": camera.sensor.seed,
        "frame": picture.frame,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_cover_a_sweep_once() {
        for (total, count) in [(0, 3), (1, 7), (100, 7), (64, 64), (10, 64)] {
            let mut next = 0;
            for number in 1..=count {
                let part = Shard { number, count }.pictures(total);
                assert_eq!(part.start, next);
                next = part.end;
            }
            assert_eq!(next, total);
        }
        assert_eq!(Shard::parse("3/64"), Ok(Shard { number: 3, count: 64 }));
        for wrong in ["0/3", "4/3", "3", "a/b", "-1/3"] {
            assert!(Shard::parse(wrong).is_err(), "{wrong}");
        }
    }
}
