//! The JSON schema of a camera file, for editors that complete and check TOML by a schema.

use super::EffectKind;
use super::keys::{Holds, KEYS, Key};
use serde_json::{Map, Value, json};

/// The schema (JSON Schema draft 2020-12).
pub fn schema() -> Value {
    let mut sensor = table("sensor");
    sensor["properties"]["noise"] = table("sensor.noise");
    sensor["properties"]["timing"] = table("sensor.timing");
    sensor["properties"]["timing"]["required"] = json!(["line_time_us"]);
    if let Some(required) = sensor["required"].as_array_mut() {
        required.push("noise".into());
    }
    let mut all = table("");
    all["$schema"] = "https://json-schema.org/draft/2020-12/schema".into();
    all["title"] = "camrig camera file".into();
    all["properties"]["lens"] = table("lens");
    all["properties"]["sensor"] = sensor;
    all["properties"]["effect"] = json!({
        "type": "array",
        "description": "Effects beyond the base model, in the order of the signal chain.",
        "items": { "oneOf": EffectKind::all().map(effect).collect::<Vec<_>>() },
    });
    all["required"] = json!(["lens", "sensor"]);
    all
}

/// The schema of a table without the tables in it.
fn table(name: &str) -> Value {
    let keys = || KEYS.iter().filter(|k| k.table == name);
    let properties: Map<String, Value> =
        keys().map(|k| (k.name.to_string(), property(k))).collect();
    let required: Vec<&str> = keys().filter(|k| k.default.is_none()).map(|k| k.name).collect();
    json!({
        "type": "object",
        "additionalProperties": false,
        "properties": properties,
        "required": required,
    })
}

fn property(key: &Key) -> Value {
    let number = |low: f64, high: f64| match high.is_finite() {
        true => json!({ "type": "number", "minimum": low, "maximum": high }),
        false => json!({ "type": "number", "minimum": low }),
    };
    let mut property = match key.holds {
        Holds::Number(low, high) => number(low, high),
        Holds::Whole(low, high) => json!({ "type": "integer", "minimum": low, "maximum": high }),
        Holds::NumberOrFile(low, high) => {
            json!({ "anyOf": [number(low, high), { "type": "string" }] })
        }
        Holds::Word(words) => json!({ "enum": words }),
        Holds::WordOrFile(words) => json!({ "type": "string", "examples": words }),
        Holds::File | Holds::Text => json!({ "type": "string" }),
        Holds::Texts => json!({
            "anyOf": [{ "type": "string" }, { "type": "array", "items": { "type": "string" } }]
        }),
        Holds::NumberOrName => {
            json!({ "anyOf": [{ "type": "integer", "minimum": 1 }, { "type": "string" }] })
        }
    };
    let unit = if key.unit.is_empty() { String::new() } else { format!(" Unit: {}.", key.unit) };
    let usual =
        if key.usual.is_empty() { String::new() } else { format!(" Usual: {}.", key.usual) };
    let default = key.default.map(|value| format!(" Left out: {value}.")).unwrap_or_default();
    property["description"] = format!("{}{unit}{usual}{default}", key.doc).into();
    property
}

fn effect(entry: EffectKind) -> Value {
    let mut properties = Map::new();
    properties.insert("kind".into(), json!({ "const": entry.kind }));
    let mut required = vec!["kind"];
    for w in entry.words {
        properties.insert(
            w.key.into(),
            match w.values {
                [] => json!({ "type": "string", "description": w.doc }),
                values => json!({ "enum": values, "description": w.doc }),
            },
        );
        if w.required {
            required.push(w.key);
        }
    }
    for p in entry.parameters {
        let mut property = json!({
            "type": "number",
            "minimum": p.min,
            "maximum": p.max,
            "description": format!("{}. Unit: {}.", p.doc.trim().trim_end_matches('.'), p.unit),
        });
        match p.default {
            Some(default) => property["default"] = default.into(),
            None => required.push(p.key),
        }
        properties.insert(p.key.into(), property);
    }
    json!({
        "type": "object",
        "description": entry.doc.trim(),
        "additionalProperties": false,
        "properties": properties,
        "required": required,
    })
}
