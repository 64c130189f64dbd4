//! Values of wider types as DN: whole numbers from 0 to 65535 and nothing else.

use camrig_base::{Error, Result};

/// An integer.
pub(super) fn integer(value: i128) -> Result<u16> {
    u16::try_from(value)
        .map_err(|_| Error::input(format!("value {value}")).help("raw DN are 0 to 65535"))
}

/// A floating-point number.
pub(super) fn float(value: f64) -> Result<u16> {
    if value.fract() == 0.0 && (0.0..=65535.0).contains(&value) {
        return Ok(value as u16);
    }
    Err(Error::input(format!("value {value}"))
        .help("raw DN are whole numbers from 0 to 65535; scaled or calibrated data are not raw"))
}
