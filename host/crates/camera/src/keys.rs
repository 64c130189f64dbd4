//! The keys of a camera file with meaning, unit and range, as the declaration in `file.rs` has
//! them: for documentation, editors and drafts.
//!
//! Keys of effects are in the catalogue of effects ([`super::EffectKind`]).

use super::Value;
use super::file::CameraFile;
use camrig_base::schema_words::{in_words, limits, resolved, type_of};
use camrig_base::{Error, toml_text};
use schemars::schema_for;
use serde_json::Value as Json;
use std::sync::LazyLock;

/// A key of a camera file outside the effects.
#[derive(Debug)]
pub struct Key {
    path: String,
    doc: String,
    required: bool,
    schema: &'static Json,
}

static KEYS: LazyLock<Vec<Key>> = LazyLock::new(|| {
    let mut keys = Vec::new();
    collect("", &DECLARED, true, &mut keys);
    keys
});

/// The schema of a camera file with the annotations of its declaration.
pub(crate) static DECLARED: LazyLock<Json> = LazyLock::new(|| schema_for!(CameraFile).to_value());

/// The keys of a table in the order of its declaration, then those of the tables in it. Those of a
/// table that a file may lack are not required.
fn collect(table: &str, schema: &'static Json, table_required: bool, keys: &mut Vec<Key>) {
    let names = schema["order"].as_array().into_iter().flatten().filter_map(Json::as_str);
    let mut tables = Vec::new();
    for name in names {
        let property = &schema["properties"][name];
        let inner = resolved(&DECLARED, property);
        let path = if table.is_empty() { name.to_string() } else { format!("{table}.{name}") };
        let required = schema["required"].as_array();
        let required = table_required && required.is_some_and(|r| r.iter().any(|key| key == name));
        if inner["properties"].is_object() {
            tables.push((path, inner, required));
        } else if type_of(inner) != "array" {
            let doc = property["description"].as_str().unwrap_or_default();
            let doc = doc.split_whitespace().collect::<Vec<_>>().join(" ");
            keys.push(Key { path, doc, required, schema: property });
        }
    }
    tables.iter().for_each(|(path, inner, required)| collect(path, inner, *required, keys));
}

impl Key {
    /// Every key, in the order of a camera file.
    #[must_use]
    pub fn all() -> &'static [Self] {
        &KEYS
    }

    /// The key of a path such as `sensor.noise.read_e`.
    #[must_use]
    pub fn of(path: &str) -> Option<&'static Self> {
        KEYS.iter().find(|key| key.path == path)
    }

    /// Table and name, such as `sensor.noise.read_e`.
    #[must_use]
    pub fn path(&self) -> &str {
        &self.path
    }

    /// Its table, such as `sensor.noise`; empty at the top of the file.
    #[must_use]
    pub fn table(&self) -> &str {
        self.path.rsplit_once('.').map_or("", |(table, _)| table)
    }

    /// Its name in the table.
    #[must_use]
    pub fn name(&self) -> &str {
        self.path.rsplit_once('.').map_or(&self.path, |(_, name)| name)
    }

    /// Meaning.
    #[must_use]
    pub fn doc(&self) -> &str {
        &self.doc
    }

    /// The first sentence of its meaning, without the full stop.
    #[must_use]
    pub fn summary(&self) -> &str {
        self.doc.split_once(". ").map_or(&self.doc[..], |(first, _)| first).trim_end_matches('.')
    }

    /// Unit; empty where it has none.
    #[must_use]
    pub fn unit(&self) -> &str {
        self.schema["unit"].as_str().unwrap_or_default()
    }

    /// Usual values of real cameras; empty where there are none.
    #[must_use]
    pub fn usual(&self) -> &str {
        self.schema["usual"].as_str().unwrap_or_default()
    }

    /// What holds where the key is left out; `None` for a key that must be given.
    #[must_use]
    pub fn default(&self) -> Option<String> {
        match (&self.schema["without"], &self.schema["default"]) {
            (Json::String(words), _) => Some(words.clone()),
            (_, Json::Null) if self.required => None,
            (_, Json::Null) => Some(match &self.schema["of_kind"] {
                Json::Null => "needed where its table is given".into(),
                kind => format!("needed where kind = {kind}"),
            }),
            (_, Json::String(word)) => Some(word.clone()),
            (_, number) => Some(number.as_f64().map_or(String::new(), |v| v.to_string())),
        }
    }

    /// What its value may be, such as `number, 8 to 16 bits`.
    #[must_use]
    pub fn range(&self) -> String {
        in_words(&DECLARED, self.schema, "")
    }

    /// Least and largest number, where there are limits.
    #[must_use]
    pub fn limits(&self) -> (Option<f64>, Option<f64>) {
        let schema = resolved(&DECLARED, self.schema);
        match limits(schema) {
            (None, None) => limits(resolved(&DECLARED, &schema["anyOf"][0])),
            limits => limits,
        }
    }

    /// What is wrong with a value, if its type or range is another one.
    pub(crate) fn mistake(&self, value: &Value) -> Option<Error> {
        camrig_base::mistakes::of_value(&self.path, &value.to_string(), &DECLARED, self.schema)
    }

    /// Path, unit and usual values, such as `sensor.height in pixels, usually 480 to 6000`.
    fn with_usual(&self) -> String {
        let unit =
            if self.unit().is_empty() { String::new() } else { format!(" in {}", self.unit()) };
        let usual = self.usual();
        let usual = if usual.is_empty() { String::new() } else { format!(", usually {usual}") };
        format!("{}{unit}{usual}", self.path)
    }
}

/// Some keys are missing, with units and usual values.
pub(crate) fn are_missing(keys: &[&Key]) -> Error {
    let (what, are) = if keys.len() == 1 { ("key", "is") } else { ("keys", "are") };
    let keys: Vec<String> = keys.iter().map(|key| key.with_usual()).collect();
    Error::input(format!("{what} {are} missing:\n  {}", keys.join("\n  ")))
}

/// The key is none of a camera file.
pub(crate) fn unknown(path: &str) -> Error {
    let nearest = toml_text::nearest(path, KEYS.iter().map(Key::path));
    Error::input(format!("{path:?} is no key of a camera file"))
        .help(format!("did you mean {nearest:?}? `camrig explain` lists the keys"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Camera, Folder, presets};

    #[test]
    fn keys_come_in_the_order_of_a_file_with_what_is_known_of_them() {
        let paths: Vec<&str> = Key::all().iter().map(Key::path).collect();
        assert_eq!(paths[..3], ["name", "lens.kind", "lens.f_number"]);
        assert_eq!(paths[paths.len() - 1], "sensor.hdr.companding.rounding");
        for key in Key::all() {
            assert!(!key.doc().is_empty() && key.doc().ends_with('.'), "{key:?}");
        }
        let key = |path| Key::of(path).unwrap();
        assert_eq!(key("sensor.bits").range(), "whole number, 8 to 16 bits");
        let fraction = "number, 0 to 1 electrons per photon, or file";
        assert_eq!(key("sensor.qe").range(), fraction);
        assert_eq!(key("sensor.qe").limits(), (Some(0.0), Some(1.0)));
        assert_eq!(key("sensor.width").default(), None);
        assert_eq!(key("sensor.noise.dark_doubling_c").default().as_deref(), Some("7"));
        assert_eq!(key("sensor.timing.shutter").default().as_deref(), Some("rolling"));
        let by_kind = key("lens.f_number").default().unwrap();
        assert_eq!(by_kind, "needed where kind = \"diffraction-limited\"");
    }

    #[test]
    fn the_ranges_are_those_that_are_checked() {
        for key in Key::all() {
            let (low, high) = key.limits();
            let outside = low.map(|v| v - 1.0).into_iter().chain(high.map(|v| 2.0 * v + 1.0));
            for value in outside {
                let change = [(key.path(), value)];
                let error = Camera::load_with("mt9t012", change).unwrap_err().to_string();
                assert!(error.contains(key.name()), "{}: {error}", key.path());
            }
            for value in low.into_iter().chain(high) {
                let whole = Value::from(value as i64);
                let value = if key.range().contains("whole") { whole } else { value.into() };
                assert!(key.mistake(&value).is_none(), "{} = {value}", key.path());
            }
        }
    }

    #[test]
    fn missing_keys_are_told_at_once_with_unit_and_usual_values() {
        let said =
            |text: &str| Camera::parse(text, "x", &Folder::BuiltIn).unwrap_err().to_string();
        let text = said("[lens]\nkind = 'diffraction-limited'\n[sensor]\nwidth = 64\nbist = 10\n");
        let needed = |k: &&Key| k.default().is_none() && k.table().starts_with("sensor");
        for key in Key::all().iter().filter(needed) {
            let path = format!("\"{}\"", key.path());
            assert_eq!(text.contains(&path), key.name() != "width", "{path}: {text}");
        }
        for line in [
            "line 1: key \"lens.f_number\" is missing (number, 0.5 to 128; usually 1.4 to 16)",
            "line 3: key \"sensor.height\" is missing (whole number, 1 to 32768 pixels; usually 480",
            "line 5: unknown key \"bist\" (did you mean \"bits\"?",
            "help: `camrig explain` says",
        ] {
            assert!(text.contains(line), "{line}: {text}");
        }
        let traced = said("[lens]\nkind = 'prescription'\n[sensor]\n");
        assert!(traced.contains("lens.file") && !traced.contains("lens.f_number"), "{traced}");
        for preset in presets::NAMES {
            assert!(Camera::load(preset).is_ok());
        }
    }
}
