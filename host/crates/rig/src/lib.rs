//! Rigs: sensor models on another device, reached over a link and fed with irradiance.
//!
//! A [`Rig`] at an address (`emulator:`, `tcp://`, `serial://`, `hid://`) takes a sensor and an
//! irradiance cube (W m⁻² nm⁻¹ per band and pixel) and returns raw rows in digital numbers: the
//! same bytes as this process would compute. Lost or damaged packets are requested again, and
//! broken links are reopened. Its registers have the addresses of MIPI CCS and act with the delay
//! of a sensor.
//!
//! ```
//! use camrig_rig::Rig;
//!
//! let mut rig = Rig::open("emulator:")?;
//! assert!(rig.device().max_width >= 4096); // pixels
//! rig.write_register(0x0202, 800)?; // coarse integration time, lines
//! assert_eq!(rig.read_register(0x0202)?, 800);
//! # Ok::<(), camrig_base::Error>(())
//! ```
//!
//! * [`transport`]: one trait for all links; [`emulator`], [`tcp`], and with the features of these
//!   names `serial` and `hid`, open them;
//! * [`client`]: a [`client::Rig`] takes a camera and frames, and repairs and resumes;
//! * [`stage`]: frames from a rig or from this process;
//! * [`feed`]: a cube's rows as they go over the link;
//! * [`faults`]: frames that are lost, late or wrong by a schedule;
//! * [`script`]: register writes of a control loop, frame by frame;
//! * [`serve`]: the emulator as a server, its rows in parallel; `log` (a feature): the log of a
//!   firmware in words.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod client;
pub mod emulator;
pub mod faults;
pub mod feed;
mod held;
#[cfg(feature = "hid")]
pub mod hid;
mod inbox;
mod list;
#[cfg(feature = "log")]
pub mod log;
pub mod mirror;
#[cfg(feature = "serial")]
mod platform;
pub mod remembering;
pub mod script;
#[cfg(feature = "serial")]
pub mod serial;
pub mod serve;
pub mod stage;
pub mod tcp;
pub mod token;
pub mod transport;
pub mod trigger;
mod url;

pub use client::{FrameRequest, Rig, RigFrame};
pub use faults::Faults;
pub use list::{Found, USB_ID, list};
pub use mirror::Mirror;
pub use stage::SensorStage;
pub use token::Token;
pub use url::Url;
