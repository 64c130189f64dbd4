//! Errors in TOML files: which line, which key, what would be right.

use crate::Error;

/// An error of the TOML parser, with its line, and the nearest known key for an unknown one.
pub fn error(text: &str, error: &toml::de::Error) -> Error {
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

/// The line of `key` in a table of the file (`""` for the top, `sensor.noise`, ...), if it is
/// there.
pub fn line_of_key(text: &str, table: &str, key: &str) -> Option<usize> {
    let mut current = String::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if let Some(header) = line.strip_prefix('[') {
            current = header.split(']').next().unwrap_or("").trim_start_matches('[').to_string();
        } else if current.trim() == table
            && let Some((name, _)) = line.split_once('=')
            && name.trim().trim_matches('"') == key
        {
            return Some(number + 1);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_found_in_their_table() {
        let text = "name = 1\n[sensor]\nwidth = 3\n[sensor.noise]\nread_e = 2\n";
        assert_eq!(line_of_key(text, "sensor.noise", "read_e"), Some(5));
        assert_eq!(line_of_key(text, "sensor", "width"), Some(3));
        assert_eq!(line_of_key(text, "", "name"), Some(1));
        assert_eq!(line_of_key(text, "sensor", "read_e"), None);
    }
}
