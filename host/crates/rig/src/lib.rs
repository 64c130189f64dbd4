//! Rigs: sensors that live elsewhere, reached over a link and fed with irradiance.
//!
//! * [`transport`]: one trait for all links; [`emulator`], [`tcp`], [`serial`], [`hid`] open them;
//! * [`client`]: a [`client::Rig`] takes a camera and frames, and repairs and resumes;
//! * [`stage`]: frames from a rig or from this process;
//! * [`feed`]: a cube's rows as they go over the link;
//! * [`script`]: register writes of a control loop, frame by frame;
//! * [`serve`]: the emulator as a server, its rows in parallel; [`log`]: the log of a firmware in words.

pub mod client;
pub mod emulator;
pub mod feed;
pub mod hid;
mod list;
pub mod log;
mod platform;
pub mod script;
pub mod serial;
pub mod serve;
pub mod stage;
pub mod tcp;
pub mod transport;
mod url;

pub use client::{FrameRequest, Rig, RigFrame};
pub use list::{Found, USB_ID, list};
pub use stage::SensorStage;
pub use url::Url;
