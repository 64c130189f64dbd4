//! The JSON schema of a camera file, for editors that complete and check TOML by a schema.

use super::EffectKind;
use super::keys::DECLARED;
use serde_json::{Map, Value, json};

/// The schema (JSON Schema draft 2020-12).
#[must_use]
pub fn schema() -> Value {
    let mut all = DECLARED.clone();
    describe(&mut all);
    let effects: Vec<Value> = EffectKind::all().map(effect).collect();
    all["properties"]["effect"]["items"] = json!({ "oneOf": effects });
    all
}

/// Puts what is known of keys, beyond the keywords of JSON Schema, into their descriptions.
fn describe(schema: &mut Value) {
    match schema {
        Value::Array(all) => all.iter_mut().for_each(describe),
        Value::Object(all) => {
            all.values_mut().for_each(describe);
            for (annotation, words) in
                [("unit", "Unit"), ("usual", "Usual"), ("without", "Left out")]
            {
                let Some(text) = all.get(annotation).and_then(Value::as_str) else { continue };
                let doc = all.get("description").and_then(Value::as_str).unwrap_or_default();
                let doc = format!("{doc} {words}: {text}.");
                all.insert("description".into(), doc.into());
            }
            if let (Some(Value::Bool(true)), Some(Value::String(kind))) =
                (all.get("needed"), all.get("of_kind"))
            {
                let doc = all.get("description").and_then(Value::as_str).unwrap_or_default();
                let doc = format!("{doc} Needed where kind = \"{kind}\".");
                all.insert("description".into(), doc.into());
            }
            let is_annotation = |key: &str, value: &Value| match key {
                "unit" | "usual" | "without" | "of_kind" => value.is_string(),
                "needed" => value.is_boolean(),
                "order" => value.is_array(),
                _ => false,
            };
            all.retain(|key, value| !is_annotation(key, value));
        }
        _ => {}
    }
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
    if entry.acts != "optics" {
        let on = "Of a sensor with several captures, those that have it: names of captures where it \
                  acts on the voltage, else of photodiodes. Left out: all.";
        let names = json!({ "type": "array", "items": { "type": "string" }, "description": on });
        properties.insert("on".into(), names);
    }
    json!({
        "type": "object",
        "description": entry.doc.trim(),
        "additionalProperties": false,
        "properties": properties,
        "required": required,
    })
}
