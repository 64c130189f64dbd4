//! `[[effect]]` tables: from key and value to a stage.

use crate::{Error, Result, toml_text};
use sensor_core::effects::{Effect, Entry};

/// Reads one `[[effect]]` table. Errors name the key.
pub fn read_effect(table: &toml::Table) -> Result<Effect> {
    let kind = table.get("kind").and_then(toml::Value::as_str).ok_or_else(|| {
        Error::input("key \"kind\" is missing").help("kind = \"row-temporal-noise\", for instance")
    })?;
    let entry = Effect::CATALOGUE.iter().find(|e| e.kind == kind).ok_or_else(|| {
        let known: Vec<&str> = Effect::CATALOGUE.iter().map(|e| e.kind).collect();
        Error::input(format!("unknown effect {kind:?}")).help(toml_text::did_you_mean(kind, &known))
    })?;
    let keys: Vec<&str> = entry.parameters.iter().map(|p| p.key).collect();
    if let Some(key) = table.keys().find(|k| *k != "kind" && !keys.contains(&k.as_str())) {
        return Err(Error::input(format!("unknown key {key:?} of {kind:?}"))
            .help(toml_text::did_you_mean(key, &keys)));
    }
    let values: Result<Vec<f32>> =
        entry.parameters.iter().map(|p| value(table, entry, p)).collect();
    Effect::new(entry.id, &values?)
        .ok_or_else(|| Error::input(format!("values of {kind:?} do not fit together")))
}

fn value(
    table: &toml::Table,
    entry: &Entry,
    parameter: &sensor_core::effects::Parameter,
) -> Result<f32> {
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
        Some(v) => Err(Error::input(format!("{key} = {v} of {:?}", entry.kind)).help(range())),
        None if table.contains_key(key) => {
            Err(Error::input(format!("{key} of {:?} is no number", entry.kind)).help(range()))
        }
        None => {
            Err(Error::input(format!("key {key:?} of {:?} is missing", entry.kind)).help(range()))
        }
    }
}
