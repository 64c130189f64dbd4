//! The options of a chart: `KEY=VALUE,...`. Some charts take the first value without its key.

use camrig_base::{Error, Result};
use std::ops::RangeInclusive;

/// Options that the chart has not read yet, and the keys that it has asked for.
pub struct Options {
    given: Vec<(String, String)>,
    known: Vec<&'static str>,
    used: Vec<String>,
}

impl Options {
    pub fn parse(text: &str) -> Result<Self> {
        let mut given: Vec<(String, String)> = Vec::new();
        for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            let (key, value) = part.split_once('=').unwrap_or(("", part));
            let (key, value) = (key.trim().to_string(), value.trim().to_string());
            if key.is_empty() && !given.is_empty() {
                return Err(Error::input(format!("option {part:?} has no key"))
                    .help("write options as KEY=VALUE, separated by commas"));
            }
            if given.iter().any(|(k, _)| *k == key) {
                return Err(Error::input(format!("option {key:?} is given twice")));
            }
            given.push((key, value));
        }
        Ok(Self { given, known: Vec::new(), used: Vec::new() })
    }

    fn take(&mut self, key: &str) -> Option<String> {
        let index = self.given.iter().position(|(k, _)| k == key)?;
        Some(self.given.remove(index).1)
    }

    /// A number in a range.
    pub fn number(
        &mut self,
        key: &'static str,
        default: f64,
        range: RangeInclusive<f64>,
    ) -> Result<f64> {
        self.known.push(key);
        let value = self.take(key).map_or(Ok(default), |text| in_range(key, &text, range))?;
        self.used.push(format!("{key}={value}"));
        Ok(value)
    }

    /// Like [`Self::number`]; the value may also stand alone as the first option.
    pub fn first_or_number(
        &mut self,
        key: &'static str,
        default: f64,
        range: RangeInclusive<f64>,
    ) -> Result<f64> {
        match self.take("") {
            Some(text) => {
                self.known.push(key);
                let value = in_range(key, &text, range)?;
                self.used.push(format!("{key}={value}"));
                Ok(value)
            }
            None => self.number(key, default, range),
        }
    }

    /// One of several words, the first of which is the default.
    pub fn word(&mut self, key: &'static str, words: &[&'static str]) -> Result<&'static str> {
        self.known.push(key);
        let Some(text) = self.take(key) else {
            self.used.push(format!("{key}={}", words[0]));
            return Ok(words[0]);
        };
        let word = words.iter().find(|w| **w == text).copied().ok_or_else(|| {
            Error::input(format!("{key}={text}")).help(format!("use {}", words.join(" or ")))
        })?;
        self.used.push(format!("{key}={word}"));
        Ok(word)
    }

    /// The options that the chart has read, with their values, given or not.
    pub fn used(&self) -> &[String] {
        &self.used
    }

    /// Refuses options that the chart did not read.
    pub fn finish(self) -> Result<()> {
        let Some((key, value)) = self.given.first() else { return Ok(()) };
        let known = self.known.join(", ");
        if key.is_empty() {
            return Err(Error::input(format!("option {value:?} has no key"))
                .help(format!("the options are {known}, as KEY=VALUE")));
        }
        let nearest = camrig_base::toml_text::nearest(key, self.known.iter().copied());
        Err(Error::input(format!("unknown option {key:?}; did you mean {nearest}?"))
            .help(format!("the options are {known}")))
    }
}

fn in_range(key: &str, text: &str, range: RangeInclusive<f64>) -> Result<f64> {
    text.parse().ok().filter(|v| range.contains(v)).ok_or_else(|| {
        Error::input(format!("{key}={text}")).help(format!(
            "{key} is a number from {} to {}",
            range.start(),
            range.end()
        ))
    })
}
