//! What the header of a table's column says: a name, and a unit in brackets, behind a stroke or
//! behind a comma; and the lines `# key: value` of a table that say what its header does not.

use crate::{Error, Result};

/// Words of the column of wavelengths, with which a header that is not divided into columns
/// begins.
const WAVELENGTH: [&str; 9] =
    ["wavelength", "wavelengths", "wave", "length", "wl", "lambda", "λ", "nm", "um"];
/// Adjectives that do not change what a quantity is.
const ADJECTIVES: [&str; 11] = [
    "abs.",
    "absolute",
    "average",
    "calibrated",
    "corrected",
    "mean",
    "measured",
    "optical",
    "spectral",
    "total",
    "typical",
];
/// Adjectives of values up to a factor.
const RELATIVE: [&str; 6] = ["arbitrary", "normalised", "normalized", "rel", "rel.", "relative"];

/// The header of a column.
pub struct Column<'a> {
    pub header: &'a str,
    name: String,
    pub unit: Option<String>,
}

impl<'a> Column<'a> {
    pub fn of(header: &'a str) -> Self {
        let header = header.trim();
        let text = header.replace("(λ)", "").replace("(lambda)", "");
        let text = text.trim();
        let split = [in_brackets(text), text.rsplit_once(" / "), text.rsplit_once(", ")];
        let (name, unit) = match split.into_iter().flatten().next() {
            Some((name, unit)) => (name, Some(unit)),
            None => match without_percent(text) {
                Some(name) => (name, Some("%")),
                None => (text, None),
            },
        };
        let unit = unit.map(|unit| unit.trim().to_string());
        Self { header, name: name.trim().to_string(), unit }
    }

    /// The name as written, without the unit.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The whole header in small letters.
    pub fn whole(&self) -> String {
        plain(self.header)
    }

    /// The names to look for in a list, from the name to what is left of it without adjectives, in
    /// small letters; and whether those say that the values are relative.
    pub fn spellings(&self) -> impl Iterator<Item = (String, bool)> {
        let (mut rest, mut is_relative) = (plain(&self.name), false);
        let mut names = vec![(rest.clone(), false)];
        while let Some((first, others)) = rest.split_once(' ') {
            is_relative |= RELATIVE.contains(&first);
            if !ADJECTIVES.contains(&first) && !RELATIVE.contains(&first) {
                break;
            }
            rest = others.to_string();
            names.push((rest.clone(), is_relative));
        }
        names.into_iter()
    }
}

/// A name in small letters, with single blanks and no other marks than `-`, `/` and brackets.
fn plain(name: &str) -> String {
    let letters =
        name.to_lowercase().replace('_', " ").replace(['−', '–'], "-").replace("₁₀", "10");
    letters.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The text before the brackets at its end, and in them.
fn in_brackets(text: &str) -> Option<(&str, &str)> {
    let mut depth = 0;
    if !text.ends_with([')', ']']) {
        return None;
    }
    for (i, c) in text.char_indices().rev() {
        depth += match c {
            ')' | ']' => 1,
            '(' | '[' => -1,
            _ => 0,
        };
        if depth == 0 {
            return Some((&text[..i], &text[i + 1..text.len() - 1]));
        }
    }
    None
}

/// The name in `%T`, `QE%`, `QE %` and `qe_percent`.
fn without_percent(text: &str) -> Option<&str> {
    let endings = ["%", "_percent", " percent", "_pct"].iter();
    let name = endings.filter_map(|end| text.strip_suffix(end)).next();
    // `50 %` is a number of its own.
    let name = name.filter(|name| !name.trim_end().ends_with(|c: char| c.is_ascii_digit()));
    name.or_else(|| text.strip_prefix('%'))
}

/// What is left of a header of a wavelength and a value without the words of the wavelength.
pub fn without_wavelength(header: &str) -> &str {
    let mut rest = header.trim();
    loop {
        let brackets =
            rest.strip_prefix(['(', '[']).and_then(|inner| inner.split_once([')', ']']));
        let end = rest.find([' ', '\t', '(', '[', ',', ';', '_']).unwrap_or(rest.len());
        let is_wavelength = WAVELENGTH.contains(&&*rest[..end].to_lowercase());
        rest = match brackets {
            Some((_, behind)) => behind,
            None if is_wavelength => &rest[end..],
            None => return rest,
        };
        rest = rest.trim_start_matches([' ', '\t', ',', ';', '_']);
    }
}

/// What the lines `# key: value` of a table say, with a colon or `=` and with quotes or without.
#[derive(Default)]
pub struct Keys {
    /// What the curves are outside their wavelengths, and the line that says it.
    pub outside: Option<(usize, String)>,
    /// The unit of the values, in place of what the header says of them.
    pub unit: Option<String>,
    /// The name of the column that is meant.
    pub column: Option<String>,
}

impl Keys {
    pub fn of(text: &str) -> Result<Self> {
        let mut keys = Self::default();
        for (i, line) in text.lines().enumerate() {
            let Some(said) = line.trim().strip_prefix('#') else { continue };
            let Some((key, value)) = said.split_once([':', '=']) else { continue };
            let value = value.trim().trim_matches('"').to_string();
            let twice = match key.trim() {
                "outside" => keys.outside.replace((i + 1, value)).is_some(),
                "unit" => keys.unit.replace(value).is_some(),
                "column" => keys.column.replace(value).is_some(),
                _ => false,
            };
            if twice {
                return Err(Error::input(format!("the key {:?} again", key.trim()))
                    .at(format!("line {}", i + 1))
                    .help("give each key once"));
            }
        }
        Ok(keys)
    }
}
