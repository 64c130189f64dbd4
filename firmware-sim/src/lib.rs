//! The rig's device: the sensor model of `sensor-core` behind the link of `rig-link`.
//!
//! The same code is the emulator on a workstation and the firmware of a microcontroller. No allocator:
//! whoever starts a rig hands it its [`Memory`]. From top to bottom:
//!
//! - [`mod@serve`]: reads packets from an `embedded_io` link and writes the answers;
//! - [`rig`]: what a rig holds between frames: its camera and the frame's settings;
//! - [`running`]: a frame in progress: spectral rows in, raw rows out;
//! - [`camera`]: a camera as bytes on the link.

#![no_std]
#![forbid(unsafe_code)]

pub mod camera;
pub mod rig;
pub mod running;
pub mod serve;

pub use rig::{Memory, Rig, RowMemory};
pub use serve::{Buffers, Dispatch, Plain, ServeError, serve, serve_rig};
