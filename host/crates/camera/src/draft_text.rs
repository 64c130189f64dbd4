//! The text of a drafted camera file: a comment above each key, and behind the value what it is
//! based on.

use super::draft::{Basis, Draft, Entry};
use super::keys::Key;
use super::typical::rounded;

/// Columns of the text.
const COLUMNS: usize = 100;
/// What the words behind values mean.
const WORDS: &str = "Behind each value stands what it is based on: measured, datasheet or quoted \
    with its source [n], derived from such values, given by whoever made this file, or typical, a \
    rule of thumb.";

impl Draft {
    /// The camera file in TOML.
    #[must_use]
    pub fn text(&self) -> String {
        let sources = self.sources();
        let mut text = comment(&self.about);
        text += "#\n";
        text += &comment(WORDS);
        if !sources.is_empty() {
            text += "#\n";
        }
        for (i, source) in sources.iter().enumerate() {
            text += &comment(&format!("[{}] {source}", i + 1));
        }
        let mut table = "";
        for entry in &self.entries {
            if entry.key.table() != table {
                table = entry.key.table();
                text += &format!("\n[{table}]\n");
            }
            text += &lines(entry, &sources);
        }
        text + &self.tables_of_more()
    }

    /// `[sensor.gains]`, and a table for each effect.
    fn tables_of_more(&self) -> String {
        let mut text = String::new();
        let mut table = "";
        for known in &self.more {
            let (of, key) = known.change.key.rsplit_once('.').unwrap_or_default();
            if of != table {
                table = of;
                text += &match of.strip_prefix("effect.") {
                    Some(kind) => format!("\n[[effect]]\nkind = \"{kind}\"\n"),
                    None => format!("\n[{of}]\n"),
                };
            }
            let value = format!("{key} = {}", known.change.value);
            text += &format!("{value:32} # {}\n", behind(&known.basis));
        }
        text
    }

    /// All sources, in the order of the keys.
    fn sources(&self) -> Vec<&str> {
        let mut sources: Vec<&str> = Vec::new();
        for source in self.entries.iter().map(|e| &e.basis.source[..]).filter(|s| !s.is_empty()) {
            if !sources.contains(&source) {
                sources.push(source);
            }
        }
        sources
    }
}

/// The lines of a key.
fn lines(entry: &Entry, sources: &[&str]) -> String {
    let (key, basis) = (entry.key, &entry.basis);
    let value = format!("{} = {}", key.name(), entry.value);
    if key.table().is_empty() {
        return format!("{value}\n");
    }
    let place = sources.iter().position(|s| *s == basis.source);
    let source = place.map_or(String::new(), |i| format!(" [{}]", i + 1));
    let second_hand = if basis.second_hand && place.is_some() { ", second-hand" } else { "" };
    let mut text = comment(&meaning(key));
    if !basis.note.is_empty() && basis.std_error.is_none() {
        text += &comment(&format!("-> {}", basis.note));
    }
    text + &format!("{value:32} # {}{second_hand}{source}\n", behind(basis))
}

/// The words behind a value.
fn behind(basis: &Basis) -> String {
    match basis.std_error {
        Some(error) => {
            format!("{} ± {}, {}", basis.grade.name(), rounded(error, 2), basis.note)
        }
        None => basis.grade.name().to_string(),
    }
}

/// What a key means, its unit and usual values.
fn meaning(key: &Key) -> String {
    let said = key.unit().is_empty() || key.summary().to_lowercase().contains(key.unit());
    let unit = if said { String::new() } else { format!(", {}", key.unit()) };
    let usual =
        if key.usual().is_empty() { String::new() } else { format!("; usually {}", key.usual()) };
    format!("{}{unit}{usual}.", key.summary())
}

/// Text as lines of a comment.
fn comment(text: &str) -> String {
    let mut out = String::new();
    let mut line = String::from("#");
    for word in text.split_whitespace() {
        if line.len() > 1 && line.chars().count() + 1 + word.chars().count() > COLUMNS {
            out += &line;
            out.push('\n');
            line = String::from("#");
        }
        line.push(' ');
        line += word;
    }
    out + &line + "\n"
}
