//! The device of a camera rig: the sensor model of `camrig-sensor-core` behind the link of
//! `camrig-rig-link`.
//!
//! The principal type is [`Rig`]. It receives a camera and then, frame by frame, spectral rows
//! (irradiance in W m⁻² nm⁻¹ per band, or mean photo-electrons per second), and answers with
//! packed raw rows in digital numbers (DN). The same code is the emulator on a workstation and the
//! firmware of a microcontroller. No allocator: the firmware hands a rig its [`Memory`], whose
//! sizes are the rig's limits. From top to bottom:
//!
//! - [`mod@serve`]: reads packets from an `embedded_io` link and writes the answers;
//! - [`rig`]: what a rig holds between frames: its camera and the frame's settings;
//! - [`running`]: a frame in progress: spectral rows in, raw rows out;
//! - [`raw_row`]: how a raw row lies in bytes;
//! - [`camera`]: a camera as bytes on the link.
//!
//! # Example
//! A rig for rows of 64 pixels takes a camera, as it would over the link, and says what it can do.
//! ```
//! use camrig_firmware_sim::rig_link::device::Model;
//! use camrig_firmware_sim::sensor_core::arith::BLOCK;
//! use camrig_firmware_sim::sensor_core::config::SensorConfig;
//! use camrig_firmware_sim::sensor_core::effects::shot_noise::ShotNoise;
//! use camrig_firmware_sim::{Memory, Rig, RowMemory, camera};
//!
//! // Rows for one effect that reads its neighbours; on a microcontroller these are statics.
//! let (mut rows, mut sums) = ([[0.0; BLOCK]; 7], [[0.0; 16]; 4]);
//! let (mut mantissas, mut exponents, mut crosstalk) = ([0; 64], [0; 4], [0.0; 16]);
//! let memory = Memory::new(&mut mantissas, &mut exponents, &mut crosstalk, 31)
//!     .with_float(RowMemory { rows: &mut rows, sums: &mut sums });
//! let mut rig = Rig::new("example 1.0", memory);
//!
//! let mut sensor = SensorConfig::new(64, 48);
//! sensor.effects = [ShotNoise {}.into()].into_iter().collect();
//! let mut bytes = [0; 256];
//! let length = camera::encode(&sensor, None, &mut bytes).expect("it fits");
//! rig.camera_piece(0, &bytes[..length])?;
//! rig.camera_end()?;
//! assert_eq!(rig.capabilities().max_width, 64);
//! # Ok::<(), camrig_firmware_sim::rig_link::message::Refusal>(())
//! ```
//! Over a link, [`serve_rig`] does this and all the rest, until the link is closed.

#![no_std]
#![forbid(unsafe_code)]

pub use {camrig_rig_link as rig_link, camrig_sensor_core as sensor_core};

pub mod camera;
pub mod memory;
pub mod raw_row;
pub mod rig;
pub mod running;
pub mod serve;

pub use memory::{CaptureMemory, Memory, RowMemory};
pub use rig::Rig;
pub use serve::{Buffers, Dispatch, Plain, ServeError, serve, serve_rig};
