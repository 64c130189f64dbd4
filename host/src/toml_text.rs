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

/// "did you mean": the nearest of the known names, or all of them.
pub fn did_you_mean(name: &str, known: &[&str]) -> String {
    let likeness = |k: &str| strsim::jaro_winkler(name, k);
    match known.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b))) {
        Some(best) if likeness(best) > 0.7 => {
            format!("did you mean {best:?}? known: {}", known.join(", "))
        }
        _ => format!("known: {}", known.join(", ")),
    }
}

/// The line, counted from 1, of a byte offset.
pub fn line_of(text: &str, offset: usize) -> usize {
    text.bytes().take(offset).filter(|&b| b == b'\n').count() + 1
}

/// The line of `key` in a table of the file (`""` for the top, `sensor.noise`, ...), if it is there.
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
