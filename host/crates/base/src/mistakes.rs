//! All mistakes of a TOML file at once.
//!
//! A deserialiser stops at the first mistake. Here it runs again on a copy of the file in which
//! that mistake is mended in some way that the deserialiser takes, a key removed or a value
//! replaced by one of another type, until nothing is left to say. What is mended is only looked
//! at: a file with a mistake gives no value.

use crate::{Error, Result, toml_text};
use serde::de::DeserializeOwned;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer};

/// Most mistakes that are told: more say only that this is another kind of file. It bounds the
/// work too, as each takes a few passes over the file.
const MOST: usize = 20;

/// Values of every type, of which one is taken in place of a wrong or missing one; lists of the
/// lengths that points and rectangles have.
const STAND_INS: &str = "\
    a = 1\nb = 1.0\nc = true\nd = ''\ne = ['']\nf = [1]\ng = {}\nh = [1, 1]\ni = [1, 1, 1]\n\
    j = [1, 1, 1, 1]\n";

/// Place of the stand-ins, beyond any file: tells complaints about them from others.
const NOWHERE: Range<usize> = usize::MAX - 1..usize::MAX;

type Table<'a> = Spanned<DeTable<'a>>;

/// Reads a TOML file.
///
/// # Errors
/// [`all`] the mistakes of [`find`].
pub fn read<T: DeserializeOwned>(text: &str) -> Result<T> {
    find(text).map_err(all)
}

/// Reads a TOML file, or says every mistake with its line and key.
///
/// # Errors
/// Up to 20 mistakes: those of TOML itself, or keys that are unknown or missing and values of
/// wrong types.
pub fn find<T: DeserializeOwned>(text: &str) -> std::result::Result<T, Vec<Error>> {
    let (mut table, syntax) = DeTable::parse_recoverable(text);
    if !syntax.is_empty() {
        return Err(syntax.iter().take(MOST).map(|e| toml_text::error(text, e)).collect());
    }
    let mut mistake = match T::deserialize(Deserializer::from(table.clone())) {
        Ok(value) => return Ok(value),
        Err(mistake) => mistake,
    };
    let mut found = vec![said(text, &table, &mistake)];
    while found.len() < MOST {
        let Some((mended, next)) = mended::<T>(&table, &mistake) else { break };
        table = mended;
        let Some(next) = next else { break };
        found.push(said(text, &table, &next));
        mistake = next;
    }
    Err(found)
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

/// A mistake with its line and, where it is a value's, the key.
fn said(text: &str, table: &Table<'_>, mistake: &toml::de::Error) -> Error {
    let error = toml_text::error(text, mistake);
    let key = mistake.span().and_then(|span| path_to(table.get_ref(), &span, false)?.pop());
    match key {
        Some(Step::Key(key)) if is_about_a_value(mistake) => {
            Error::input(format!("{key}: {}", error.what())).at(error.place().unwrap_or_default())
        }
        _ => error,
    }
}

fn is_about_a_value(mistake: &toml::de::Error) -> bool {
    let message = mistake.message().trim_start();
    !message.starts_with("unknown field") && !message.starts_with("missing field")
}

/// A table with a mistake mended, and the mistake that shows then, if any; `None` where nothing
/// that is known mends it.
fn mended<'a, T: DeserializeOwned>(
    table: &Table<'a>,
    mistake: &toml::de::Error,
) -> Option<(Table<'a>, Option<toml::de::Error>)> {
    let span = mistake.span()?;
    let message = mistake.message().trim();
    let root = table.span() == span;
    let missing = message.strip_prefix("missing field `").and_then(|m| m.split('`').next());
    let tables = missing.is_some();
    let path = if root { Vec::new() } else { path_to(table.get_ref(), &span, tables)? };
    let mut copies = Vec::new();
    if !message.starts_with("unknown field") {
        let with = |value: DeValue<'a>| {
            let mut copy = table.clone();
            put(copy.get_mut(), &path, missing, Spanned::new(NOWHERE, value))?;
            Some(copy)
        };
        // The names of an enumeration, which its own complaint about another word tells.
        let nameless = with(DeValue::String("".into()))?;
        let complaint = T::deserialize(Deserializer::from(nameless)).err();
        let named = complaint.as_ref().map_or("", |e| e.message());
        let words = named.split('`').skip(1).step_by(2);
        let words = words.map(|word| DeValue::String(word.to_owned().into()));
        let stand_ins = DeTable::parse(STAND_INS).ok()?.into_inner();
        let stand_ins = stand_ins.into_iter().map(|(_, value)| placeless(value.into_inner()));
        copies.extend(stand_ins.chain(words).filter_map(with));
    }
    if missing.is_none() {
        let mut copy = table.clone();
        copies.extend(remove(copy.get_mut(), &path).map(|()| copy));
    }
    copies.into_iter().find_map(|copy| {
        let next = T::deserialize(Deserializer::from(copy.clone())).err();
        let moved_on = next.as_ref().is_none_or(|next| is_another(next, mistake, &path));
        moved_on.then_some((copy, next))
    })
}

/// A stand-in whose elements too are beyond any file.
fn placeless(mut value: DeValue<'_>) -> DeValue<'_> {
    if let DeValue::Array(list) = &mut value {
        let element =
            |v: &mut Spanned<DeValue<'_>>| *v = Spanned::new(NOWHERE, v.get_ref().clone());
        list.iter_mut().for_each(element);
    }
    value
}

/// Whether a mistake is another one than that at `path`, which was mended, and none of the
/// mending.
fn is_another(next: &toml::de::Error, mistake: &toml::de::Error, path: &[Step]) -> bool {
    // A key that was removed and must be there is the same mistake in other words.
    let removed = path.last().map(|step| format!("missing field `{step}`"));
    let same = next.span() == mistake.span() && next.message() == mistake.message();
    let removed = removed.is_some_and(|missing| next.message().starts_with(&missing));
    next.span() != Some(NOWHERE) && !same && !removed
}

/// A step from the top of a file to a value.
#[derive(Clone, Debug, PartialEq)]
enum Step {
    Key(String),
    Index(usize),
}

impl std::fmt::Display for Step {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Key(key) => f.write_str(key),
            Self::Index(index) => write!(f, "{index}"),
        }
    }
}

/// The way to the key or value that has this place in the text; with `tables` to a table alone, as
/// the place of its list and of its header may be the same.
fn path_to(table: &DeTable<'_>, span: &Range<usize>, tables: bool) -> Option<Vec<Step>> {
    let into = |value: &Spanned<DeValue<'_>>| path_into(value, span, tables);
    table.iter().find_map(|(key, value)| {
        let mut path = if !tables && key.span() == *span { Vec::new() } else { into(value)? };
        path.insert(0, Step::Key(key.get_ref().to_string()));
        Some(path)
    })
}

fn path_into(
    value: &Spanned<DeValue<'_>>,
    span: &Range<usize>,
    tables: bool,
) -> Option<Vec<Step>> {
    let wanted = !tables || matches!(value.get_ref(), DeValue::Table(_));
    if wanted && value.span() == *span {
        return Some(Vec::new());
    }
    match value.get_ref() {
        DeValue::Table(table) => path_to(table, span, tables),
        DeValue::Array(array) => array.iter().enumerate().find_map(|(index, value)| {
            let mut path = path_into(value, span, tables)?;
            path.insert(0, Step::Index(index));
            Some(path)
        }),
        _ => None,
    }
}

fn key_of<'t, 'a>(table: &'t mut DeTable<'a>, name: &str) -> Option<&'t mut Spanned<DeValue<'a>>> {
    table.iter_mut().find(|(key, _)| key.get_ref() == name).map(|(_, value)| value)
}

/// The value at the end of a way that begins with a key.
fn value_at<'t, 'a>(
    table: &'t mut DeTable<'a>,
    path: &[Step],
) -> Option<&'t mut Spanned<DeValue<'a>>> {
    let (Step::Key(first), rest) = path.split_first()? else { return None };
    rest.iter().try_fold(key_of(table, first)?, |value, step| match (value.get_mut(), step) {
        (DeValue::Table(table), Step::Key(name)) => key_of(table, name),
        (DeValue::Array(array), Step::Index(index)) => array.get_mut(*index),
        _ => None,
    })
}

/// The table at the end of a way, which may be the whole file.
fn table_at<'t, 'a>(table: &'t mut DeTable<'a>, path: &[Step]) -> Option<&'t mut DeTable<'a>> {
    if path.is_empty() {
        return Some(table);
    }
    match value_at(table, path)?.get_mut() {
        DeValue::Table(table) => Some(table),
        _ => None,
    }
}

/// Removes a key. Elements of lists stay: their neighbours would take their places.
fn remove(table: &mut DeTable<'_>, path: &[Step]) -> Option<()> {
    let (Step::Key(name), above) = path.split_last()? else { return None };
    let table = table_at(table, above)?;
    let others = std::mem::take(table).into_iter().filter(|(key, _)| key.get_ref() != name);
    *table = others.collect();
    Some(())
}

/// Puts a value in place of the one at `path`, or under a key that is missing in the table there.
fn put<'a>(
    table: &mut DeTable<'a>,
    path: &[Step],
    missing: Option<&str>,
    value: Spanned<DeValue<'a>>,
) -> Option<()> {
    match missing {
        None => *value_at(table, path)? = value,
        Some(key) => {
            let key = Spanned::new(NOWHERE, key.to_string().into());
            table_at(table, path)?.insert(key, value);
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(rename_all = "lowercase")]
    enum Kind {
        Dark,
        Flat,
    }

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct Stack {
        kind: Kind,
        seconds: f64,
        frames: Option<u32>,
        size: [u32; 2],
    }

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct Whole {
        name: String,
        stack: Vec<Stack>,
    }

    fn told(text: &str) -> Vec<String> {
        let found = find::<Whole>(text).unwrap_err();
        found.iter().map(|e| format!("{}: {}", e.place().unwrap_or("?"), e.what())).collect()
    }

    #[test]
    fn a_file_without_mistakes_is_read() {
        let text = "name = 'a'\n[[stack]]\nkind = 'flat'\nseconds = 1\nsize = [1, 2]\n";
        let whole: Whole = read(text).unwrap();
        assert_eq!(whole.stack[0].kind, Kind::Flat);
    }

    #[test]
    fn all_mistakes_are_told_each_with_its_line() {
        let told = told(
            "nam = 'a'\n[[stack]]\nkind = 'drak'\nseconds = 1\nsize = [1, 2]\n[[stack]]\n\
             kind = 'dark'\nframes = '3'\nseconds = true\nsize = [1, 'x']\nsise = 3\n",
        );
        for (line, words) in [
            ("line 1", "unknown key \"nam\""),
            ("line 3", "drak"),
            ("line 8", "frames"),
            ("line 9", "seconds"),
            ("line 10", "string \"x\""),
            ("line 11", "unknown key \"sise\""),
        ] {
            let has = |t: &&String| t.starts_with(&format!("{line}:")) && t.contains(words);
            assert_eq!(told.iter().filter(has).count(), 1, "{line} {words}: {told:#?}");
        }
        assert!(told.iter().any(|t| t.contains("missing field `name`")), "{told:#?}");
        assert_eq!(told.len(), 7, "{told:#?}");
    }

    #[test]
    fn missing_keys_and_syntax_are_told_together() {
        let missing = told("name = 'a'\n[[stack]]\n");
        assert_eq!(missing.len(), 3, "{missing:#?}");
        let syntax = told("name = \n[stack\nother = = 3\n");
        assert!(syntax.len() >= 2, "{syntax:#?}");
        let one = all(find::<Whole>("name = 'a'\nstack = []\nx = 1\n").unwrap_err());
        assert!(one.what().starts_with("unknown key"), "{one}");
        let two = all(find::<Whole>("name = 1\nstack = []\nx = 1\n").unwrap_err()).to_string();
        assert!(two.starts_with("2 things to put right\n  line 1: name: "), "{two}");
    }

    /// A file of another kind ends after so many.
    #[test]
    fn mistakes_are_bounded() {
        let text: String = (0..1000).map(|i| format!("k{i} = {i}\n")).collect();
        assert_eq!(told(&text).len(), MOST);
    }
}
