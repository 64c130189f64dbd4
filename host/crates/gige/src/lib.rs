//! A GigE Vision camera in software: discovery, registers and control (GVCP), images with repeats
//! of lost packets (GVSP), and the XML that names its features (GenICam).
//!
//! Whatever implements [`Camera`] is what the device shows. [`Device`] has no socket and no clock:
//! datagrams and times in, datagrams out. [`Server`] gives it both. It is written from the
//! behaviour of public clients (Aravis, telegenic, viva-genicam, EMVA's GenApi) and the public
//! register definitions of GigE Vision 2.0.
//!
//! ```
//! use camrig_gige::gvcp::{self, Request};
//! use camrig_gige::{Device, Pattern, Sensor, Timing};
//! use std::net::{Ipv4Addr, SocketAddrV4};
//! use std::time::Duration;
//!
//! let sensor = Sensor {
//!     model: "card".into(),
//!     serial: "1".into(),
//!     width: 64,
//!     height: 48,
//!     pattern: Pattern::BayerRg,
//!     bits: 12,
//!     line_ns: 10_000,
//!     min_frame_lines: 48,
//!     timing: Timing { exposure_lines: 1000, frame_lines: 3333, gain_code: 256 },
//! };
//! let mut device = Device::new(sensor, Ipv4Addr::LOCALHOST, 0);
//! let host = SocketAddrV4::new(Ipv4Addr::LOCALHOST, 5000);
//! let hello = gvcp::request(gvcp::code::DISCOVERY, 1, false, &[]);
//! let answer = device.receive(Duration::ZERO, host, &hello).unwrap();
//! assert_eq!(gvcp::parse_acknowledgement(&answer).unwrap().2.len(), 0xF8);
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod acquisition;
mod camera;
mod device;
mod features;
pub mod gvcp;
pub mod gvsp;
mod memory;
mod pixel;
pub mod running;
mod serve;
mod stream;

pub use camera::{
    Camera, Order, Pace, Region, STUCK_COUNTER, Sensor, Taken, Timing, UNITY_GAIN_CODE,
};
pub use device::{Device, Next};
pub use pixel::{Pattern, PixelFormat};
pub use serve::{Server, Summary};
