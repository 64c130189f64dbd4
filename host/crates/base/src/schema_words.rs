//! What a JSON schema allows, in words: for messages and for the reference of files.

use serde_json::Value;

/// A schema without a reference to another place of `root`, and without "or nothing".
#[must_use]
pub fn resolved<'a>(root: &'a Value, schema: &'a Value) -> &'a Value {
    if let Some(place) = schema["$ref"].as_str() {
        return root.pointer(place.trim_start_matches('#')).unwrap_or(schema);
    }
    match schema["anyOf"].as_array().map(Vec::as_slice) {
        Some([one, nothing]) if nothing["type"] == "null" => resolved(root, one),
        _ => schema,
    }
}

/// The type of a schema: `number`, `table`, ...; of a number or nothing, the number; empty where
/// it has none.
#[must_use]
pub fn type_of(schema: &Value) -> &str {
    match &schema["type"] {
        Value::Array(types) => types[0].as_str(),
        one => one.as_str(),
    }
    .unwrap_or_default()
}

/// The alternatives of a schema that offers some.
#[must_use]
pub fn alternatives(schema: &Value) -> Option<&Vec<Value>> {
    ["anyOf", "oneOf"].iter().find_map(|key| schema[key].as_array())
}

/// The words that a schema allows, where it allows no others.
#[must_use]
pub fn words(schema: &Value) -> Option<Vec<&str>> {
    if let Some(all) = alternatives(schema) {
        let all: Option<Vec<Vec<&str>>> = all.iter().map(words).collect();
        return all.map(|all| all.concat());
    }
    match (&schema["enum"], &schema["const"]) {
        (Value::Array(all), _) => all.iter().map(Value::as_str).collect(),
        (_, Value::String(word)) => Some(vec![word]),
        _ => None,
    }
}

/// What a value may be, such as `number, 0.1 to 1000 µm`. `mark` encloses literal text.
#[must_use]
pub fn in_words(root: &Value, schema: &Value, mark: &str) -> String {
    let unit = schema["unit"].as_str().map_or(String::new(), |unit| format!(" {unit}"));
    with_unit(root, schema, mark, &unit)
}

fn with_unit(root: &Value, schema: &Value, mark: &str, unit: &str) -> String {
    let schema = resolved(root, schema);
    let inner = |schema| with_unit(root, schema, mark, unit);
    if let Some(words) = words(schema) {
        let quoted: Vec<String> = words.iter().map(|w| format!("{mark}\"{w}\"{mark}")).collect();
        return quoted.join(", ");
    }
    if let Some(all) = alternatives(schema) {
        let all = all.iter().filter(|one| one["type"] != "null");
        return all.map(inner).collect::<Vec<_>>().join(", or ");
    }
    if let Some(properties) = schema["properties"].as_object() {
        let keys: Vec<&str> = properties.keys().map(String::as_str).collect();
        return format!("{mark}{{ {} }}{mark}", keys.join(", "));
    }
    match type_of(schema) {
        "number" => format!("number{}{unit}", range(schema)),
        "integer" => format!("whole number{}{unit}", range(schema)),
        "boolean" => "true or false".into(),
        "string" if schema["format"] == "file" => "file".into(),
        "string" => "text".into(),
        "array" => format!("list of: {}", inner(&schema["items"])),
        "object" if schema["additionalProperties"].is_object() => {
            format!("table of: name = {}", inner(&schema["additionalProperties"]))
        }
        "object" => "table".into(),
        _ => "any".into(),
    }
}

/// The least and the largest number of a schema.
#[must_use]
pub fn limits(schema: &Value) -> (Option<f64>, Option<f64>) {
    (schema["minimum"].as_f64(), schema["maximum"].as_f64())
}

fn range(schema: &Value) -> String {
    match limits(schema) {
        (None, None) => String::new(),
        (None, Some(high)) => format!(" up to {high}"),
        (Some(low), None) => format!(" from {low}"),
        (Some(low), Some(high)) => format!(", {low} to {high}"),
    }
}
