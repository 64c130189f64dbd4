//! JSON schemas as pages for people: a table of keys for each table of a file.

use camrig_base::{ErrorCode, schema_words};
use serde_json::Value;

const HEAD: &str = "\
# Reference of files

Made by `camrig schema --markdown` from what the program reads, so that it is never behind it. Keys in **bold** must
be given. Unknown keys are refused. `camrig schema FILE` prints the same as a JSON schema for editors, and
`camrig explain KEY` says more about a key of the camera file.
";

const ERRORS: &str = "
## Error codes

`Error::code` of the library, an `ErrorCode`. The words of a message may change, its code does not. Errors that no program
has to tell apart have none.

| code | meaning |
|---|---|
";

/// The page of several files, by their headings and schemas, and of the codes of errors.
pub fn page(files: &[(&str, Value)]) -> String {
    let mut page = HEAD.to_string();
    for (heading, schema) in files {
        page += &format!("\n## {heading}\n");
        Reference { root: schema, page: &mut page }.table("", schema);
    }
    page += ERRORS;
    for code in ErrorCode::ALL {
        page += &format!("| `{}` | {} |\n", code.name(), code.doc());
    }
    page
}

/// A page in the making, of one schema.
struct Reference<'a> {
    root: &'a Value,
    page: &'a mut String,
}

/// A table of a file inside another: how it is written, and its schema.
type Inner<'a> = (String, &'a Value);

impl<'a> Reference<'a> {
    /// Writes a table, then those in it.
    fn table(&mut self, path: &str, schema: &'a Value) {
        if let Some(text) = schema["description"].as_str() {
            *self.page += &format!("\n{}\n", in_a_line(text));
        }
        let Some(properties) = schema["properties"].as_object() else { return };
        let must = |key: &str| {
            schema["required"].as_array().is_some_and(|r| r.iter().any(|name| name == key))
        };
        let mut keys: Vec<(&String, &Value)> = properties.iter().collect();
        keys.sort_by_key(|(key, _)| !must(key));
        let mut inner = Vec::new();
        *self.page += "\n| key | value | meaning |\n|---|---|---|\n";
        for (key, property) in keys.into_iter().filter(|(_, property)| property["const"].is_null())
        {
            let name = if must(key) { format!("**`{key}`**") } else { format!("`{key}`") };
            let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            let value = self.value(&path, property, &mut inner);
            let meaning = in_a_line(property["description"].as_str().unwrap_or_default());
            let left_out = match &property["default"] {
                Value::Null | Value::Object(_) | Value::Array(_) => String::new(),
                Value::String(nothing) if nothing.is_empty() => String::new(),
                default => format!(" Left out: {}.", bare(default)),
            };
            *self.page += &format!("| {name} | {value} | {meaning}{left_out} |\n");
        }
        for (heading, schema) in inner {
            *self.page += &format!("\n### `{heading}`\n");
            let path = heading.trim_matches(['[', ']']).to_string();
            match schema["oneOf"].as_array() {
                Some(kinds) => kinds.iter().for_each(|kind| self.kind(&heading, kind)),
                None => self.table(&path, schema),
            }
        }
    }

    /// Writes a table that has one of several kinds.
    fn kind(&mut self, heading: &str, schema: &'a Value) {
        let kind = bare(&schema["properties"]["kind"]["const"]);
        *self.page += &format!("\n#### `{heading}` with `kind = \"{kind}\"`\n");
        self.table(heading.trim_matches(['[', ']']), schema);
    }

    /// What a key may be; tables go to `inner`.
    fn value(&self, path: &str, property: &'a Value, inner: &mut Vec<Inner<'a>>) -> String {
        let schema = self.resolved(property);
        let items = self.resolved(&schema["items"]);
        let values = self.resolved(&schema["additionalProperties"]);
        let (heading, found) = match () {
            () if schema["properties"].is_object() => (format!("[{path}]"), schema),
            () if items["properties"].is_object()
                || items["oneOf"][0]["properties"].is_object() =>
            {
                (format!("[[{path}]]"), items)
            }
            () if values["properties"].is_object() => (format!("[{path}.NAME]"), values),
            () => return schema_words::in_words(self.root, property, "`"),
        };
        let words = format!("table `{heading}`");
        inner.push((heading, found));
        words
    }

    /// A schema without references and without "or nothing".
    fn resolved<'v>(&self, schema: &'v Value) -> &'v Value
    where
        'a: 'v,
    {
        schema_words::resolved(self.root, schema)
    }
}

/// A value without quotation marks, and whole numbers without a point.
fn bare(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => {
            number.as_f64().unwrap_or_default().to_string()
        }
        other => other.to_string(),
    }
}

fn in_a_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}
