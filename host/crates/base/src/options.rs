//! Options that follow a name, `NAME:KEY=VALUE,...`.

use crate::{Error, Result};
use serde::de::DeserializeOwned;
use std::io::ErrorKind;
use std::path::Path;

/// The keys of `options` (`KEY=VALUE,...`) and of a sidecar, a TOML file that need not be there and
/// over which options take precedence; `help` names the keys there are. A number without a key goes
/// on with the value before it: `white=10,20,30,40` is one option.
///
/// # Errors
/// An option without a value, a key or a value that `T` does not have, a sidecar that is no TOML.
pub fn read<T: DeserializeOwned>(sidecar: Option<&Path>, options: &str, help: &str) -> Result<T> {
    let text = sidecar.map(|place| match std::fs::read_to_string(place) {
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(String::new()),
        text => text.map_err(|e| Error::io("read", place, e)),
    });
    let text = text.transpose()?.unwrap_or_default();
    let at = |error: Error| match sidecar {
        Some(place) => error.at(place.display()),
        None => error,
    };
    let mut table: toml::Table =
        text.parse().map_err(|e: toml::de::Error| at(Error::input(e.to_string())))?;
    for option in pieces(options) {
        let Some((key, value)) = option.split_once('=') else {
            return Err(Error::input(format!("option {option:?} has no value"))
                .help(format!("write options as KEY=VALUE; {help}")));
        };
        let value = match value.trim().parse::<f64>() {
            Ok(number) => toml::Value::Float(number),
            Err(_) => toml::Value::String(value.trim().to_string()),
        };
        table.insert(key.trim().to_string(), value);
    }
    toml::from_str(&table.to_string())
        .map_err(|e| at(Error::input(e.message().to_string())).help(help))
}

/// The options, one by one.
fn pieces(options: &str) -> Vec<String> {
    let mut pieces: Vec<String> = Vec::new();
    for piece in options.split(',').map(str::trim).filter(|o| !o.is_empty()) {
        match pieces.last_mut() {
            Some(before) if piece.parse::<f64>().is_ok() => before.push_str(&format!(",{piece}")),
            _ => pieces.push(piece.into()),
        }
    }
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct Keys {
        scale: Option<f64>,
        white: Option<String>,
    }

    #[test]
    fn options_take_precedence_over_the_sidecar_which_need_not_be_there() {
        let folder = tempfile::tempdir().unwrap();
        let sidecar = folder.path().join("cube.toml");
        let read = |options: &str| read::<Keys>(Some(&sidecar), options, "").unwrap();
        assert_eq!(read(""), Keys { scale: None, white: None });
        std::fs::write(&sidecar, "scale = 2.0\nwhite = \"all\"\n").unwrap();
        let white = Some("10,20,30,40".into());
        assert_eq!(read("white=10,20,30,40"), Keys { scale: Some(2.0), white });
        assert_eq!(read("scale=0.5, white=top").scale, Some(0.5));
    }

    #[test]
    fn what_is_no_option_is_refused() {
        for (options, what) in [("scale", "no value"), ("sacle=2", "sacle"), ("scale=x", "x")] {
            let said = read::<Keys>(None, options, "the keys are scale and white").unwrap_err();
            assert!(said.to_string().contains(what), "{said}");
        }
    }
}
