//! The link between a host and a camera rig: packets, framing, and the state machine of each end.
//!
//! A rig is a device that computes what an image sensor would read out: it receives the light of a
//! frame as spectral rows and answers with raw rows. The principal type is
//! [`Device`](device::Device), the rig's end, for which a firmware implements a
//! [`Model`](device::Model); the other end is [`Host`](host::Host). The link is sans-IO: bytes and
//! the time go in, bytes and events come out. Nothing here reads a port or a clock, allocates, or
//! knows what a sensor is. Layers, from bottom to top:
//!
//! * [`framing`] separates packets on a byte stream or in reports of USB HID (human interface
//!   device);
//! * [`wire`] is the packet: header, body, CRC-32C;
//! * [`message`] is what control packets say, [`registers`] the register map of the sensor;
//! * [`packing`] lays raw samples out as MIPI CSI-2 does;
//! * [`device`] is the end that answers, [`host`] the end that asks and repairs losses.
//!
//! **Units.** Exposure in seconds, or in lines in the registers; temperature in °C; samples in
//! digital numbers (DN); the host's clock in microseconds; sizes in bytes, pixels and rows as
//! named.
//!
//! **What is lost is computed again, not stored.** A raw row is a function of the camera, the
//! frame's announcement and the spectral rows around it. So a device keeps no output: a host that
//! misses a row sends its spectral rows again, in the same session or, after a dropped cable, in a
//! new one.
//!
//! **Credit.** Each end may have a fixed number of packets under way beyond the newest that the
//! other has acknowledged; every packet acknowledges. So no buffer on the way has to hold more
//! than credit times packet size, and the 64 unread HID reports that Linux queues are never
//! exceeded.
//!
//! **Trust.** Lengths and positions from outside are checked against what was agreed. A packet
//! with a wrong CRC, an old counter or another session's number is dropped and counted.
//!
//! # Example
//! A host connects to a device, both in one process. `examples/smallest_device.rs` goes on from
//! here to a whole frame.
//! ```
//! use camrig_rig_link::device::{Begun, Device, Model};
//! use camrig_rig_link::host::{Event, FrameIo, Host, Limits, Poll};
//! use camrig_rig_link::message::*;
//! use camrig_rig_link::registers::Registers;
//!
//! /// A device without a sensor.
//! struct Nothing;
//!
//! impl Model for Nothing {
//!     fn capabilities(&self) -> Capabilities {
//!         Capabilities { firmware: "nothing 1.0".try_into().unwrap(), ..Default::default() }
//!     }
//!     fn camera_piece(&mut self, _offset: u32, _piece: &[u8]) -> Result<(), Refusal> {
//!         Ok(())
//!     }
//!     fn camera_end(&mut self) -> Result<(), Refusal> {
//!         Ok(())
//!     }
//!     fn begin(&mut self, _: &FrameBegin, _: Exposure, _: &Registers) -> Result<Begun, Refusal> {
//!         Err(Refusal::NoCamera)
//!     }
//!     fn units(&mut self, _row: u16, _first: u16, _units: &[u8]) {}
//!     fn raw_row(&mut self, _row: u16, _out: &mut [u8]) {}
//! }
//!
//! /// A host that sends no frames.
//! struct NoFrame;
//!
//! impl FrameIo for NoFrame {
//!     fn spectral(&mut self, _row: u16, _first: u16, _out: &mut [u8]) {}
//!     fn raw_row(&mut self, _row: u16) -> &mut [u8] {
//!         &mut []
//!     }
//!     fn camera(&mut self, _offset: u32, _out: &mut [u8]) {}
//! }
//!
//! let mut host = Host::new(Limits::default(), [0; 1]);
//! let mut device = Device::<64>::new(600, 32);
//! let mut packet = [0; 600];
//! host.connect(1);
//! let Poll::Send(bytes) = host.poll(0, &mut NoFrame, &mut packet) else { panic!() };
//! device.receive(&packet[..bytes], &mut Nothing);
//! let bytes = device.transmit(&mut packet, &mut Nothing).unwrap();
//! let event = host.receive(100, &packet[..bytes], &mut NoFrame);
//! assert_eq!(event, Some(Event::Connected));
//! assert_eq!(host.device().unwrap().firmware, "nothing 1.0");
//! ```

#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

/// Where the texts of [`message`] come from.
pub use heapless;

pub mod device;
mod effect_set;
pub mod framing;
pub mod host;
pub mod message;
pub use camrig_packing as packing;
pub mod registers;
pub mod wire;
