//! Real image sensors as their registers: where exposure, gain, frame and line length, flips and
//! test patterns are, what their codes mean, and after how many frames they act. The maps are data,
//! in TOML ([`Profile`]); a [`Sensor`] with such a map answers on I2C as
//! [`embedded_hal::i2c::I2c`], so that a driver can be run against it, and says what each frame is
//! taken with.
//!
//! ```
//! use camrig_profiles::{Profile, Sensor};
//! use embedded_hal::i2c::I2c;
//!
//! let mut sensor = Sensor::new(Profile::builtin("imx219").unwrap());
//! let mut id = [0; 2];
//! sensor.write_read(0x10, &[0x00, 0x00], &mut id)?;
//! assert_eq!(id, [0x02, 0x19]);
//! sensor.write(0x10, &[0x01, 0x5A, 0x03, 0xE8])?; // 1000 lines of 3448 clocks at 182.4 MHz
//! sensor.write(0x10, &[0x01, 0x57, 128])?; // 256 / (256 - 128)
//! sensor.write(0x10, &[0x01, 0x00, 1])?;
//! let frame = sensor.next_frame().unwrap();
//! assert_eq!(frame.exposure_s, 1000.0 * 3448.0 / 182.4e6);
//! assert_eq!(frame.analog_gain, 2.0);
//! # Ok::<(), camrig_profiles::Nack>(())
//! ```
//! Registers that a map does not name hold what is written to them, and are 0 before: sensors have
//! hundreds of them, which drivers write without effect on what is modelled here. No automatic
//! exposure is modelled: frames say so where the sensor would use its own
//! ([`Frame::is_automatic`]).
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod field;
mod profile;
mod sensor;

pub use field::{Condition, Field, Memory};
pub use profile::{Gain, Law, Profile};
pub use sensor::{Frame, Nack, Sensor};
