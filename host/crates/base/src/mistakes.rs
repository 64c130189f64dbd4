//! All mistakes of a TOML file at once.
//!
//! A deserialiser stops at the first mistake. Here the file is compared with the JSON schema of the
//! type that it is read into, which finds unknown and missing keys, values of wrong types, and
//! numbers out of range in one pass.

pub use crate::schema_check::of_value;
use crate::{Error, Result, schema_check, toml_text};
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value;
use toml::de::{DeTable, Deserializer};

/// Largest number of mistakes in a message: more say only that this is another kind of file.
const MAX_MISTAKES: usize = 20;

/// Reads a TOML file.
///
/// ```
/// #[derive(serde::Deserialize, schemars::JsonSchema)]
/// #[serde(deny_unknown_fields)]
/// struct Stack {
///     frames: u32,
///     exposure_s: f64,
/// }
///
/// let error = camrig_base::mistakes::read::<Stack>("frames = 'two'\nexposure = 0.1\n").err();
/// let text = error.unwrap().to_string();
/// assert!(text.contains("line 1, key \"frames\": frames = 'two' (use a whole number"));
/// assert!(text.contains("line 2: unknown key \"exposure\" (did you mean \"exposure_s\"?"));
/// ```
///
/// # Errors
/// [`all`] the mistakes of [`find`].
pub fn read<T: DeserializeOwned + JsonSchema>(text: &str) -> Result<T> {
    find(text).map_err(all)
}

/// Reads a TOML file, or returns every mistake with its line and key.
///
/// # Errors
/// Up to 20 mistakes: those of TOML itself, or keys that are unknown or missing and values of
/// wrong types or out of range.
pub fn find<T: DeserializeOwned + JsonSchema>(text: &str) -> std::result::Result<T, Vec<Error>> {
    let schema = schemars::schema_for!(T).to_value();
    let (value, mistakes) = compare(text, &schema);
    value.filter(|_| mistakes.is_empty()).ok_or(mistakes)
}

/// The value of a TOML file where it has the form of its type, and every mistake by the type's
/// schema: a number out of range is a mistake, but leaves a value.
pub fn compare<T: DeserializeOwned>(text: &str, schema: &Value) -> (Option<T>, Vec<Error>) {
    let (table, syntax) = DeTable::parse_recoverable(text);
    let mut mistakes: Vec<Error> = syntax.iter().map(|e| toml_text::error(text, e)).collect();
    let mut value = None;
    if mistakes.is_empty() {
        mistakes = schema_check::mistakes(text, table.get_ref(), schema);
        match T::deserialize(Deserializer::from(table)) {
            Ok(read) => value = Some(read),
            // What no schema can say.
            Err(e) if mistakes.is_empty() => mistakes.push(toml_text::error(text, &e)),
            Err(_) => {}
        }
    }
    mistakes.truncate(MAX_MISTAKES);
    (value, mistakes)
}

/// Several mistakes, or values that are missing, as one error; one as it is.
#[must_use]
pub fn all(mut mistakes: Vec<Error>) -> Error {
    if mistakes.len() == 1 {
        return mistakes.remove(0);
    }
    let mut text = format!("{} things to put right", mistakes.len());
    for mistake in &mistakes {
        text += "\n  ";
        if let Some(place) = mistake.place() {
            text += &format!("{place}: ");
        }
        text += mistake.what();
        if let Some(help) = mistake.remedy() {
            text += &format!(" ({help})");
        }
    }
    Error::input(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize, JsonSchema, PartialEq)]
    #[serde(rename_all = "lowercase")]
    enum Kind {
        Dark,
        Flat,
    }

    #[derive(Debug, Deserialize, JsonSchema, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct Stack {
        kind: Kind,
        #[schemars(range(min = 0.5), extend("unit" = "s", "usual" = "1 to 10"))]
        seconds: f64,
        frames: Option<u32>,
        size: [u32; 2],
        #[schemars(extend("of_kind" = "flat", "needed" = true))]
        lux: Option<f64>,
    }

    #[derive(Debug, Deserialize, JsonSchema, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct Whole {
        name: String,
        stack: Vec<Stack>,
    }

    fn told(text: &str) -> Vec<String> {
        let found = find::<Whole>(text).unwrap_err();
        found.iter().map(|e| e.to_string().replace('\n', "")).collect()
    }

    #[test]
    fn a_file_without_mistakes_is_read() {
        let text = "name = 'a'\n[[stack]]\nkind = 'flat'\nseconds = 1\nsize = [1, 2]\nlux = 9\n";
        let whole: Whole = read(text).unwrap();
        assert_eq!(whole.stack[0].kind, Kind::Flat);
    }

    #[test]
    fn all_mistakes_are_told_each_with_its_line() {
        let told = told(
            "nam = 'a'\n[[stack]]\nkind = 'drak'\nseconds = 0.1\nsize = [1, 2]\n[[stack]]\n\
             kind = 'dark'\nframes = '3'\nseconds = true\nsize = [1, 'x']\nsise = 3\nlux = 1\n",
        );
        let expected = [
            ("unknown key \"nam\"", "line 1  help: did you mean \"name\"? known: name, stack"),
            ("key \"name\" is missing", "text"),
            ("kind = 'drak'", "line 3, key \"kind\" of [[stack]]  help: use \"dark\", \"flat\""),
            (
                "seconds = 0.1",
                "line 4, key \"seconds\" of [[stack]]  help: use a number from 0.5 s",
            ),
            ("frames = '3'", "line 8, key \"frames\" of [[stack]]  help: use a whole number"),
            ("seconds = true", "line 9"),
            ("size = 'x'", "line 10"),
            ("unknown key \"sise\"", "line 11  help: did you mean \"size\"?"),
            ("key \"lux\" means nothing for kind = \"dark\"", "line 12"),
        ];
        for (told, (what, rest)) in told.iter().zip(expected) {
            assert!(told.starts_with(what) && told.contains(rest), "{told}");
        }
        assert_eq!(told.len(), expected.len(), "{told:#?}");
    }

    #[test]
    fn missing_keys_are_told_together_and_what_is_usual() {
        let missing = told("name = 'a'\n[[stack]]\nkind = 'flat'\n");
        assert_eq!(missing.len(), 3, "{missing:#?}");
        let expected = "key \"stack.seconds\" is missing  where: line 2  help: number from 0.5 s; \
                        usually 1 to 10";
        assert!(missing.iter().any(|t| t == expected), "{missing:#?}");
        let syntax = told("name = \n[stack\nother = = 3\n");
        assert!(syntax.len() >= 2, "{syntax:#?}");
        let one = all(find::<Whole>("name = 'a'\nstack = []\nx = 1\n").unwrap_err());
        assert!(one.what().starts_with("unknown key"), "{one}");
        let two = all(find::<Whole>("name = 1\nstack = []\nx = 1\n").unwrap_err()).to_string();
        assert!(
            two.starts_with("2 things to put right\n  line 1, key \"name\": name = 1 (use text)"),
            "{two}"
        );
    }

    /// A file of another kind ends after so many.
    #[test]
    fn mistakes_are_bounded() {
        let text: String = (0..1000).map(|i| format!("k{i} = {i}\n")).collect();
        assert_eq!(told(&text).len(), MAX_MISTAKES);
    }
}
