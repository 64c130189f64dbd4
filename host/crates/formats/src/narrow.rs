//! Numbers of files as DN: whole numbers that their type holds, and nothing else.

use camrig_base::{Dn, Error, Result};

/// An integer.
pub(super) fn integer<S: Dn>(value: i128) -> Result<S> {
    S::of(value).ok_or_else(|| {
        Error::input(format!("value {value}")).help(format!("raw DN are 0 to {}", largest::<S>()))
    })
}

/// A floating-point number.
pub(super) fn float<S: Dn>(value: f64) -> Result<S> {
    let whole = Some(value).filter(|v| v.fract() == 0.0).and_then(|v| S::of(v as i128));
    whole.ok_or_else(|| {
        Error::input(format!("value {value}")).help(format!(
            "raw DN are whole numbers from 0 to {}; scaled or calibrated data are not raw",
            largest::<S>()
        ))
    })
}

fn largest<S: Dn>() -> u64 {
    (1 << S::MAX_BITS) - 1
}
