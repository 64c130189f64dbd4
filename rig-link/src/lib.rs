//! The link between a host and a sensor rig: packets, framing, and the state machine of each end.
//!
//! Sans-IO: bytes and the time go in, bytes and events come out; nothing here reads a port or a
//! clock, allocates, or knows what a sensor is. Layers, bottom to top:
//! * [`framing`] tells packets apart on a byte stream or in HID reports;
//! * [`wire`] is the packet: header, body, CRC-32C;
//! * [`message`] is what control packets say, [`registers`] the sensor's register map;
//! * [`packing`] lays raw samples out as MIPI does;
//! * [`device`] answers, [`host`] asks and repairs.
//!
//! **What gets lost is made again, not stored.** A raw row is a function of the camera, the frame's
//! announcement and the spectral rows around it, so a device keeps no output: a host that misses
//! a row sends its spectral rows again, in the same session or, after a dropped cable, in a new one.
//!
//! **Credit.** Each end may have so many packets under way beyond the newest that the other has
//! acknowledged; every packet acknowledges. So no buffer on the way has to be larger than credit
//! times packet size, and Linux's queue of 64 unread HID reports is never overrun.
//!
//! **Trust.** Lengths and positions from outside are checked against what was agreed; a packet
//! with a wrong CRC, an old counter or another session's number is dropped and counted.

#![no_std]
#![forbid(unsafe_code)]

pub mod device;
pub mod framing;
pub mod host;
pub mod message;
pub mod packing;
pub mod registers;
pub mod wire;
