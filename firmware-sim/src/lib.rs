//! The device of a camera rig: the sensor model of `camrig-sensor-core` behind the link of
//! `camrig-rig-link`.
//!
//! A rig receives a camera and then, frame by frame, spectral rows (irradiance in W m⁻² nm⁻¹ per
//! band, or mean photo-electrons per second), and answers with packed raw rows in digital numbers
//! (DN). The same code is the emulator on a workstation and the firmware of a microcontroller. No
//! allocator: whoever starts a rig hands it its [`Memory`], whose sizes are the rig's limits. From
//! top to bottom:
//!
//! - [`mod@serve`]: reads packets from an `embedded_io` link and writes the answers;
//! - [`rig`]: what a rig holds between frames: its camera and the frame's settings;
//! - [`running`]: a frame in progress: spectral rows in, raw rows out;
//! - [`camera`]: a camera as bytes on the link.
//!
//! # Example
//! A rig for rows of 64 pixels takes a camera, as it would over the link, and says what it can do.
//! ```
//! use camrig_firmware_sim::{Memory, Rig, RowMemory, camera};
//! use camrig_rig_link::device::Model;
//! use camrig_sensor_core::arith::BLOCK;
//! use camrig_sensor_core::config::{Pattern, SensorConfig};
//! use camrig_sensor_core::effects::{read_noise::ReadNoise, shot_noise::ShotNoise};
//!
//! // Rows for one effect that reads its neighbours; on a microcontroller these are statics.
//! let mut float = ([[0.0; BLOCK]; 7], [[0.0; 16]; 4]);
//! let mut fixed = ([[Default::default(); BLOCK]; 7], [[Default::default(); 16]; 4]);
//! let (mut mantissas, mut exponents, mut crosstalk) = ([0; 64], [0; 4], [0.0; 16]);
//! let mut rig = Rig::new(
//!     "example 1.0",
//!     Memory {
//!         float: RowMemory { rows: &mut float.0, sums: &mut float.1 },
//!         fixed: RowMemory { rows: &mut fixed.0, sums: &mut fixed.1 },
//!         mantissas: &mut mantissas,
//!         exponents: &mut exponents,
//!         crosstalk: &mut crosstalk,
//!         max_bands: 31,
//!     },
//! );
//! let sensor = SensorConfig {
//!     width: 64,
//!     height: 48,
//!     pattern: Pattern { width: 1, height: 1, channels: [0].into_iter().collect() },
//!     channels: 1,
//!     bands: 1,
//!     first_band_nm: 550.0,
//!     band_step_nm: 10.0,
//!     response: [1e6].into_iter().collect(),
//!     full_well_e: 10_000.0,
//!     bits: 12,
//!     black_level_dn: 64.0,
//!     seed: 1,
//!     table: Default::default(),
//!     effects: [ShotNoise {}.into(), ReadNoise { read_e: 2.0, read_e_post: 0.0 }.into()]
//!         .into_iter()
//!         .collect(),
//! };
//! let mut bytes = [0; 256];
//! let length = camera::encode(&sensor, None, &mut bytes).expect("it fits");
//! rig.camera_piece(0, &bytes[..length])?;
//! rig.camera_end()?;
//! assert_eq!(rig.capabilities().max_width, 64);
//! # Ok::<(), camrig_rig_link::message::Refusal>(())
//! ```
//! Over a link, [`serve_rig`] does this and all the rest, until the link is closed.

#![no_std]
#![forbid(unsafe_code)]

pub mod camera;
pub mod memory;
pub mod rig;
pub mod running;
pub mod serve;

pub use memory::{Memory, RowMemory};
pub use rig::Rig;
pub use serve::{Buffers, Dispatch, Plain, ServeError, serve, serve_rig};
