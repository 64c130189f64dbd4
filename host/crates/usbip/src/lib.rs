//! A USB video camera in software. Linux' vhci-hcd makes a USB device of a byte stream (USB/IP);
//! the device is a camera of the USB Video Class 1.0 with one bulk endpoint, so that uvcvideo
//! drives it: exposure time in units of 100 µs, gain as the sensor's code, frame rate.
//!
//! Whatever implements [`camrig_gige::Camera`] is what it shows. [`Device`] has no socket and no
//! clock: messages and times in, messages out. [`Server`] gives it both.
//!
//! Bayer and monochrome formats of 16 bits (at full scale) and 8 bits are offered, and of a sensor
//! of 10 bits with RGGB filters those packed as MIPI packs them: uvcvideo knows no others.
//!
//! Beside the camera there may be an [`Adapter`] to an I2C bus, which Linux' i2c-tiny-usb drives:
//! whatever implements [`embedded_hal::i2c::I2c`] is on it.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod adapter;
mod descriptors;
mod device;
pub mod protocol;
mod serve;

pub use adapter::Adapter;
pub use device::Device;
pub use serve::Server;
