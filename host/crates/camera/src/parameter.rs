//! Numbers of an `[[effect]]` table.

use camrig_base::{Error, Result};
use camrig_sensor_core::effects::Parameter;

/// A parameter of an `[[effect]]` table.
pub(crate) fn number(table: &toml::Table, kind: &str, parameter: &Parameter) -> Result<f32> {
    let key = parameter.key;
    let range = || {
        format!(
            "{key} is {} ({}), {} to {}",
            parameter.doc.trim(),
            parameter.unit,
            parameter.min,
            parameter.max
        )
    };
    let number = match table.get(key) {
        Some(v) => v.as_float().or(v.as_integer().map(|i| i as f64)).map(|v| v as f32),
        None => parameter.default,
    };
    match number {
        Some(v) if (parameter.min..=parameter.max).contains(&v) => Ok(v),
        Some(v) => Err(Error::input(format!("{key} = {v} of {:?}", kind)).help(range())),
        None if table.contains_key(key) => {
            Err(Error::input(format!("{key} of {:?} is no number", kind)).help(range()))
        }
        None => Err(Error::input(format!("key {key:?} of {:?} is missing", kind)).help(range())),
    }
}
