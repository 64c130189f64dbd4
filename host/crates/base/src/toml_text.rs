//! Errors in TOML files: which line, which key, what would be right.

use crate::{Error, Result};
use serde::de::DeserializeOwned;
use std::path::Path;
use toml::de::DeTable;

/// Reads a TOML file, with the line in the error.
///
/// # Errors
/// The first mistake of the file; [`crate::mistakes::read`] finds all of them.
pub fn read<T: DeserializeOwned>(text: &str) -> Result<T> {
    toml::from_str(text).map_err(|e| error(text, &e))
}

/// Reads a TOML file from disk, with file and line in the error.
///
/// # Errors
/// A file that cannot be read, and those of [`read`].
pub fn read_file<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(|e| Error::io("read", path, e))?;
    read(&text).map_err(|e| e.at(path.display()))
}

/// An error of the TOML parser, with its line, and the nearest known key for an unknown one.
pub(crate) fn error(text: &str, error: &toml::de::Error) -> Error {
    let message = error.message().trim();
    let mut out = match message.strip_prefix("unknown field `") {
        // serde's message: unknown field `a`, expected one of `b`, `c`
        Some(rest) => {
            let mut quoted = rest.split('`').step_by(2);
            let key = quoted.next().unwrap_or_default();
            let known: Vec<&str> = quoted.filter(|k| !k.trim().is_empty()).collect();
            Error::input(format!("unknown key {key:?}")).help(did_you_mean(key, &known))
        }
        None => Error::input(message),
    };
    if let Some(span) = error.span() {
        out = out.at(format!("line {}", line_of(text, span.start)));
    }
    out
}

/// Jaro-Winkler similarity (0 to 1) above which a known name is offered for an unknown one. A
/// trade: `widht` still finds `width`, and names that share a few letters by chance are not
/// offered.
const SIMILAR: f64 = 0.7;

/// "did you mean": the nearest of the known names, or all of them.
pub fn did_you_mean(name: &str, known: &[&str]) -> String {
    let best = nearest(name, known.iter().copied());
    let all = known.join(", ");
    if strsim::jaro_winkler(name, best) > SIMILAR {
        return format!("did you mean {best:?}? known: {all}");
    }
    format!("known: {all}")
}

/// The candidate that is written most like `word`; the first of several, empty of none.
pub fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> &'a str {
    let mut best = ("", f64::NEG_INFINITY);
    for candidate in candidates {
        let similarity = strsim::jaro_winkler(word, candidate);
        if similarity > best.1 {
            best = (candidate, similarity);
        }
    }
    best.0
}

/// A value to seven significant figures: what an f32 holds.
pub fn seven_figures(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

/// The line, counted from 1, of a byte offset.
pub fn line_of(text: &str, offset: usize) -> usize {
    text.bytes().take(offset).filter(|&b| b == b'\n').count() + 1
}

/// Where a key is, for messages: `line 12, key "qe" of [sensor]`; without the line where the
/// file has no such key. `table` is the path of a table, such as `sensor.noise`.
#[must_use]
pub fn place_of_key(text: &str, table: &str, key: &str) -> String {
    let place = format!("key {key:?} of [{table}]");
    let line = DeTable::parse(text).ok().and_then(|file| {
        let mut inner = table.split('.');
        let table = inner.try_fold(file.get_ref(), |t, name| t.get(name)?.get_ref().as_table())?;
        let (key, _) = table.get_key_value(key)?;
        Some(line_of(text, key.span().start))
    });
    line.map_or(place.clone(), |line| format!("line {line}, {place}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_found_in_their_table() {
        let text = "name = 1\n[sensor]\nwidth = 3\nnoise = { prnu = 0 }\n[lens]\nf = 2\n";
        assert_eq!(place_of_key(text, "sensor", "width"), "line 3, key \"width\" of [sensor]");
        let inline = place_of_key(text, "sensor.noise", "prnu");
        assert_eq!(inline, "line 4, key \"prnu\" of [sensor.noise]");
        assert_eq!(place_of_key(text, "sensor", "f"), "key \"f\" of [sensor]");
    }
}
