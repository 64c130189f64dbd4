//! What is wrong with a TOML file, by the JSON schema of the type that it is read into.
//!
//! Apart from the keywords of JSON Schema that `schemars` derives, a property may have these, given
//! by `#[schemars(extend("unit" = "mm", ...))]`: `unit` and `usual` for messages; `of_kind`, the
//! word of the table's key `kind` that the key belongs to, and with it `needed`, where that kind
//! cannot do without it.

use crate::schema_words::{alternatives, in_words, resolved, type_of, words};
use crate::{Error, toml_text};
use serde_json::Value;
use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

/// Every mistake, in the order of the file.
pub(crate) fn mistakes(text: &str, file: &DeTable<'_>, schema: &Value) -> Vec<Error> {
    let mut check = Check { text, root: schema, found: Vec::new() };
    check.table(&Place::default(), file, schema);
    check.found.sort_by_key(|(offset, _)| *offset);
    check.found.into_iter().map(|(_, mistake)| mistake).collect()
}

/// What is wrong with the value of a key, given in TOML, by the schema of the key, a part of
/// `root`.
#[must_use]
pub fn of_value(key: &str, value: &str, root: &Value, property: &Value) -> Option<Error> {
    let text = format!("{key:?} = {value}");
    let file = DeTable::parse(&text).ok()?;
    let mut check = Check { text: &text, root, found: Vec::new() };
    check.value(&Place::default(), key, file.get_ref().get(key)?, property);
    let (_, mistake) = check.found.into_iter().next()?;
    Some(Error::input(mistake.what()).help(mistake.remedy().unwrap_or_default()))
}

struct Check<'a> {
    text: &'a str,
    root: &'a Value,
    /// Mistakes with their offsets in the text.
    found: Vec<(usize, Error)>,
}

/// Where a table or value is.
#[derive(Clone, Default)]
struct Place {
    /// Keys from the top of the file, such as `sensor.noise`.
    path: String,
    /// Header of the table, such as `[sensor.noise]` or `[[stack]]`; empty at the top.
    header: String,
    /// Offset of the table's header.
    offset: usize,
}

impl Place {
    fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_string() } else { format!("{}.{key}", self.path) }
    }

    fn table(&self, key: &str, offset: usize) -> Self {
        let path = self.path_of(key);
        Self { header: format!("[{path}]"), path, offset }
    }

    fn element(&self, key: &str, offset: usize) -> Self {
        let path = self.path_of(key);
        Self { header: format!("[[{path}]]"), path, offset }
    }
}

impl<'a> Check<'a> {
    fn table(&mut self, place: &Place, table: &DeTable<'_>, schema: &'a Value) {
        let kind = table.get("kind").and_then(|kind| kind.get_ref().as_str());
        let properties = schema["properties"].as_object();
        for (key, value) in table {
            let (name, offset) = (key.get_ref().as_ref(), key.span().start);
            match properties.and_then(|all| all.get(name)) {
                Some(property) if of_another_kind(property, kind) => {
                    let what = format!(
                        "key {name:?} means nothing for kind = {:?}",
                        kind.unwrap_or_default()
                    );
                    let mistake = Error::input(what).help("remove it, or change the kind");
                    self.add(offset, mistake.at(self.key(place, name, offset)));
                }
                Some(property) => self.value(place, name, value, property),
                None => match &schema["additionalProperties"] {
                    Value::Bool(false) => {
                        let known = properties.into_iter().flatten().map(|(key, _)| &key[..]);
                        let help = toml_text::did_you_mean(name, &known.collect::<Vec<_>>());
                        let mistake = Error::input(format!("unknown key {name:?}")).help(help);
                        self.add(offset, mistake.at(self.line(offset)));
                    }
                    of_any_name => self.value(place, name, value, of_any_name),
                },
            }
        }
        let required = schema["required"].as_array();
        let required =
            |name: &str| required.is_some_and(|keys| keys.iter().any(|key| key == name));
        for (name, property) in properties.into_iter().flatten() {
            let needed =
                required(name) || property["needed"] == true && !of_another_kind(property, kind);
            if needed && !table.contains_key(&name[..]) {
                self.missing(place, name, property);
            }
        }
    }

    /// A key that is missing; of a table, the keys that must be in it.
    fn missing(&mut self, place: &Place, name: &str, property: &'a Value) {
        let schema = resolved(self.root, property);
        if schema["required"].as_array().is_some_and(|keys| !keys.is_empty()) {
            let inner = Place { offset: place.offset, ..place.table(name, 0) };
            return self.table(&inner, &DeTable::new(), schema);
        }
        let usual = property["usual"].as_str().map_or(String::new(), |u| format!("; usually {u}"));
        let help = format!("{}{usual}", in_words(self.root, property, ""));
        let mistake = Error::input(format!("key {:?} is missing", place.path_of(name))).help(help);
        let at_the_top = place.header.is_empty();
        let mistake = if at_the_top { mistake } else { mistake.at(self.line(place.offset)) };
        self.add(place.offset, mistake);
    }

    fn value(&mut self, place: &Place, key: &str, node: &Spanned<DeValue<'_>>, schema: &'a Value) {
        let found = resolved(self.root, schema);
        let words = words(found);
        if let (Some(all), None) = (alternatives(found), &words) {
            return self.one_of(place, key, node, schema, all);
        }
        let type_of = type_of(found);
        let any = type_of.is_empty() && words.is_none();
        let fits = match node.get_ref() {
            DeValue::Table(table) if type_of == "object" => {
                return self.table(&place.table(key, node.span().start), table, found);
            }
            DeValue::Array(list) if type_of == "array" => {
                self.elements(place, key, list, found);
                within(list.len() as f64, &found["minItems"], &found["maxItems"])
            }
            DeValue::String(text) => match words {
                Some(words) => words.contains(&text.as_ref()),
                None => any || type_of == "string",
            },
            DeValue::Integer(digits) => {
                let value = i64::from_str_radix(digits.as_str(), digits.radix());
                any || ["number", "integer"].contains(&type_of)
                    && value.is_ok_and(|v| in_range(v as f64, found))
            }
            DeValue::Float(digits) => {
                let value = digits.as_str().parse();
                any || type_of == "number" && value.is_ok_and(|v| in_range(v, found))
            }
            DeValue::Boolean(_) => any || type_of == "boolean",
            _ => any,
        };
        if !fits {
            self.wrong(place, key, node, schema);
        }
    }

    fn elements(&mut self, place: &Place, key: &str, list: &DeArray<'_>, schema: &'a Value) {
        for (index, node) in list.iter().enumerate() {
            let own = &schema["prefixItems"][index];
            let of = if own.is_null() { &schema["items"] } else { own };
            match node.get_ref() {
                DeValue::Table(table) if type_of(resolved(self.root, of)) == "object" => {
                    let place = place.element(key, node.span().start);
                    self.table(&place, table, resolved(self.root, of));
                }
                _ => self.value(place, key, node, of),
            }
        }
    }

    /// A value of one of several forms. Where it has the form of one but not its content, what is
    /// wrong inside says more than that nothing fits.
    fn one_of(
        &mut self,
        place: &Place,
        key: &str,
        node: &Spanned<DeValue<'_>>,
        schema: &'a Value,
        all: &'a [Value],
    ) {
        let form = match node.get_ref() {
            DeValue::Table(_) => "object",
            DeValue::Array(_) => "array",
            _ => "",
        };
        let mut inside = None;
        for one in all {
            let mut trial = Check { text: self.text, root: self.root, found: Vec::new() };
            trial.value(place, key, node, one);
            if trial.found.is_empty() {
                return;
            }
            if type_of(resolved(self.root, one)) == form && inside.is_none() {
                inside = Some(trial.found);
            }
        }
        match inside {
            Some(found) => self.found.extend(found),
            None => self.wrong(place, key, node, schema),
        }
    }

    fn wrong(&mut self, place: &Place, key: &str, node: &Spanned<DeValue<'_>>, schema: &Value) {
        let span = node.span();
        let value = self.text.get(span.clone()).unwrap_or_default();
        let value = value.lines().next().unwrap_or_default();
        let allowed = in_words(self.root, schema, "");
        let article = ["number", "whole number", "list", "table"];
        let article = article.iter().any(|word| allowed.starts_with(word));
        let help = if article { format!("use a {allowed}") } else { format!("use {allowed}") };
        let mistake = Error::input(format!("{key} = {value}")).help(help);
        self.add(span.start, mistake.at(self.key(place, key, span.start)));
    }

    fn line(&self, offset: usize) -> String {
        format!("line {}", toml_text::line_of(self.text, offset))
    }

    fn key(&self, place: &Place, key: &str, offset: usize) -> String {
        let line = self.line(offset);
        match place.header.as_str() {
            "" => format!("{line}, key {key:?}"),
            header => format!("{line}, key {key:?} of {header}"),
        }
    }

    fn add(&mut self, offset: usize, mistake: Error) {
        self.found.push((offset, mistake));
    }
}

/// Whether a key belongs to tables of another kind.
fn of_another_kind(property: &Value, kind: Option<&str>) -> bool {
    property["of_kind"].as_str().is_some_and(|of| kind != Some(of))
}

fn in_range(value: f64, schema: &Value) -> bool {
    within(value, &schema["minimum"], &schema["maximum"])
}

fn within(value: f64, least: &Value, most: &Value) -> bool {
    least.as_f64().is_none_or(|least| value >= least)
        && most.as_f64().is_none_or(|most| value <= most)
}
