//! When the conditions of two captures count as equal.

/// Relative difference of exposure times: the rounding of decimals in a manifest.
pub(crate) const SAME_EXPOSURE: f64 = 1e-6;

/// Difference of temperatures, °C: the sensors' own thermometers are accurate to about 1 °C.
pub(crate) const SAME_TEMPERATURE_C: f64 = 3.0;
