//! A model of a CMOS image sensor, computed row by row: spectral irradiance in, raw digital
//! numbers (DN) out.
//!
//! The principal type is [`Pipeline`](pipeline::Pipeline): it takes a
//! [`SensorConfig`](config::SensorConfig), the [`FrameSettings`](config::FrameSettings) and the
//! mean photo-electrons of a frame, and computes its rows. It runs on workstations and on
//! microcontrollers: no allocator, no files, no lens, no link. From top to bottom:
//!
//! - [`pipeline`]: runs the signal chain row by row, with the few rows of memory that its effects
//!   need.
//! - [`effects`]: the stages of the chain, one file each: shot noise, photo-response
//!   non-uniformity (PRNU), dark current, full well, fixed patterns, read noise, and what else
//!   real sensors show.
//! - [`collect`]: from spectral irradiance to mean photo-electrons, with quantum efficiency and
//!   positional [`crosstalk`] per band.
//! - [`spectral`]: the rows of irradiance in 16-bit block floating point.
//! - [`config`]: what a sensor is, and the settings of a frame.
//! - [`arith`]: the two arithmetics, f32 and fixed point, behind one trait.
//! - [`stream`]: random streams keyed by (sensor seed, stage, frame, row).
//! - [`math`]: elementary functions with the same bits on every machine.
//!
//! # Units
//! | quantity | unit |
//! |---|---|
//! | irradiance on the pixel, per band | W m⁻² nm⁻¹ |
//! | response of a channel to a band | e⁻ s⁻¹ per W m⁻² nm⁻¹ |
//! | signals between collection and converter, input-referred | e⁻ |
//! | exposure | s |
//! | temperature | °C |
//! | analogue gain | 1 (unity gain is 1) |
//! | converter output | DN |
//!
//! # Promises
//! The same configuration, settings and irradiance give the same DN on every machine, in any order
//! of rows. Fixed patterns are functions of the sensor's seed and the position: nothing is stored.
//! Row functions do not panic and do not allocate. Only the effect `exact-shot-noise` breaks the
//! first promise, as it uses the platform's logarithm.
//!
//! # Features
//! The base model is always there. `catalogue` (default) adds every other effect; a firmware with
//! little flash leaves it out and names the effects that it needs, each by the feature of its name
//! (`hot-pixels`, `image-lag`, ...). `texts` (default) keeps the descriptions of effects and
//! parameters. Features only add: no `match` breaks where another crate switches one on.
//!
//! # Errors
//! Whatever is refused is refused before the first row, with a
//! [`ConfigError`](config::ConfigError); [`ConfigError::code`](config::ConfigError::code) names it
//! for programs.
//!
//! # Example
//! A flat field of 500 e⁻ through shot noise and read noise. `examples/row_loop.rs` starts from
//! spectral irradiance instead, as a firmware does.
//! ```
//! use camrig_sensor_core::arith::{BLOCK, Float};
//! use camrig_sensor_core::config::{FrameSettings, SensorConfig};
//! use camrig_sensor_core::effects::{read_noise::ReadNoise, shot_noise::ShotNoise};
//! use camrig_sensor_core::pipeline::{Pipeline, memory_blocks};
//!
//! let read_noise = ReadNoise { read_e: 2.0, read_e_post: 0.0 };
//! let mut sensor = SensorConfig::new(64, 4);
//! sensor.effects = [ShotNoise {}.into(), read_noise.into()].into_iter().collect();
//!
//! let mut memory = [[0.0; BLOCK]; 1];
//! assert_eq!(memory.len(), memory_blocks(&sensor));
//! let settings = FrameSettings::new(0.01);
//! let mut pipeline = Pipeline::<Float>::new(&sensor, &settings, &mut memory)?;
//! let mut flat = |_row: u32, out: &mut [[f32; BLOCK]]| out.fill([500.0; BLOCK]);
//! let mut dn = [0; 64];
//! pipeline.row(2, &mut flat, &mut dn);
//!
//! // 12 bits over a full well of 10 000 e⁻, above a black level of 64 DN.
//! let mean = dn.iter().map(|&d| f32::from(d)).sum::<f32>() / 64.0;
//! assert!((mean - (64.0 + 500.0 * 4095.0 / 10_000.0)).abs() < 8.0);
//! # Ok::<(), camrig_sensor_core::config::ConfigError>(())
//! ```

#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

#[cfg(test)]
extern crate std;

/// Where lists of fixed capacity come from, such as those of [`config::SensorConfig`].
pub use heapless;

pub mod arith;
mod at_gain;
pub mod collect;
pub mod config;
pub mod crosstalk;
#[cfg_attr(not(feature = "catalogue"), allow(dead_code, reason = "only some effects use it"))]
pub mod effects;
pub mod hdr;
pub mod math;
pub mod pipeline;
pub mod spectral;
pub mod stream;
