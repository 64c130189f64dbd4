//! `ZOO`: zoom positions. `ZOO n` says how many there are, `ZOO THI S5 1.2 3.4 5.6` gives a command
//! a value for each. The commands of the chosen position are read in place of those lines.

use super::File;
use super::known::{Known, known};
use super::lexer::{Command, Kind, Word};
use camrig_base::{Error, Result};

/// Most positions: more than any zoom lens file has.
const MOST: usize = 1000;

/// The positions of a file and which is read.
#[derive(Default)]
pub(super) struct Zoom {
    count: usize,
    wanted: Option<String>,
    /// Titles of the positions, where the file gives them.
    titles: Vec<String>,
    /// The first solve whose value in the file is kept, and its line.
    solve: Option<(usize, String)>,
}

impl Zoom {
    /// Reads this position, by its number or title; `None`: the first.
    pub(super) fn of(commands: &[Command], wanted: Option<&str>) -> Self {
        let mut zoom = Self { wanted: wanted.map(str::to_owned), ..Self::default() };
        commands.iter().for_each(|command| zoom.take_titles(command));
        zoom
    }

    /// `ZOO TIT 'A' 'B'`, or `TIT Z2 "B"`.
    fn take_titles(&mut self, Command { keyword, words, .. }: &Command) {
        // Marks that are doubled leave empty words.
        let texts = |words: &[Word]| -> Vec<String> {
            words.iter().filter(|w| !w.text.is_empty()).map(|w| w.text.clone()).collect()
        };
        match (keyword.as_str(), &words[..]) {
            ("ZOO", [title, rest @ ..]) if is_title(&title.text) => {
                self.titles.extend(texts(rest));
            }
            ("TIT" | "TITLE", [place, rest @ ..]) => {
                let Some(position) = position_of(place) else { return };
                self.titles.resize(self.titles.len().max(position), String::new());
                self.titles[position - 1] = texts(rest).join(" ");
            }
            _ => {}
        }
    }

    /// The number of the position that is read, from 1.
    fn position(&self) -> Result<usize> {
        let Some(wanted) = &self.wanted else { return Ok(1) };
        let count = self.count.max(1);
        let titled = self.titles.iter().position(|title| title.eq_ignore_ascii_case(wanted));
        let number = wanted.parse().ok().or(titled.map(|i| i + 1));
        number.filter(|n| (1..=count).contains(n)).ok_or_else(|| {
            let known = match count {
                1 => "the file has one configuration; leave the choice out".to_owned(),
                _ if self.titles.is_empty() => format!("the file has zoom positions 1 to {count}"),
                _ => format!("the file has zoom positions 1 to {count}: {:?}", self.titles),
            };
            Error::input(format!("no configuration \"{wanted}\"")).help(known)
        })
    }

    /// Remembers a solve of which the value in the file, that of the first position, is kept.
    pub(super) fn keeps(&mut self, solve: &str, line: usize) {
        self.solve.get_or_insert((line, solve.to_owned()));
    }

    /// Checks the choice at the end of the file, and says what was taken.
    pub(super) fn check(&self, notes: &mut Vec<String>) -> Result<()> {
        let position = self.position()?;
        if let (Some((line, solve)), 2..) = (&self.solve, position) {
            return Err(Error::unsupported(format!(
                "zoom position {position}: {solve} is not solved again for it, and its value in \
                 the file is that of position 1"
            ))
            .at(format!("line {line}"))
            .help("remove the solve, and give its value in each position: ZOO THI S3 1.2 3.4"));
        }
        if self.count > 1 {
            notes.push(format!("zoom position {position} of {} is taken", self.count));
        }
        Ok(())
    }

    /// Sets the number of positions.
    fn set_count(&mut self, word: &Word) -> Result<()> {
        let count = word.text.parse().ok().filter(|n| (1..=MOST).contains(n));
        self.count = count.ok_or_else(|| {
            Error::input(format!("ZOO {}", word.text))
                .help(format!("it is the number of zoom positions, 1 to {MOST}"))
        })?;
        Ok(())
    }
}

impl File {
    /// `ZOO n`, or `ZOO command value value ...`.
    pub(super) fn zoom(&mut self, command: &Command) -> Result<()> {
        let words = &command.words;
        if words.first().is_some_and(|word| is_title(&word.text)) {
            return Ok(());
        }
        if let [word] = &words[..] {
            return self.zoom.set_count(word);
        }
        let Some((name, rest)) = words.split_first() else {
            return Err(Error::input("ZOO has no value").help("the line is cut short"));
        };
        let keyword = name.text.to_ascii_uppercase();
        if known(&keyword) == Known::Harmless {
            return Ok(());
        }
        let count = self.zoom.count;
        let is_qualifier = |w: &&Word| w.kind == Kind::Label || is_place(&w.text);
        let qualifiers = rest.iter().take_while(is_qualifier).count();
        let (qualifiers, values) = rest.split_at(qualifiers);
        if count < 2 || values.len() != count {
            return Err(Error::input(format!(
                "ZOO {keyword} has {} values for {count} zoom positions",
                values.len()
            ))
            .help("ZOO n comes first; then each zoomed command has n values"));
        }
        let value = values[self.zoom.position()? - 1].clone();
        let words = qualifiers.iter().cloned().chain([value]).collect();
        let chosen = Command { line: command.line, keyword, words, open_quote: false };
        self.command(&chosen)
    }
}

fn is_title(word: &str) -> bool {
    ["TIT", "TITLE"].iter().any(|name| word.eq_ignore_ascii_case(name))
}

/// The zoom position that a word names (Z2).
pub(super) fn position_of(word: &Word) -> Option<usize> {
    let number = word.text.strip_prefix(['Z', 'z']).filter(|_| word.kind == Kind::Plain)?;
    number.parse().ok().filter(|n| (1..=MOST).contains(n))
}

/// Whether a word names a surface (S3, SO, SI) or a field (F2).
fn is_place(text: &str) -> bool {
    let text = text.to_ascii_uppercase();
    let numbered = |letter| text.strip_prefix(letter).is_some_and(|n| n.parse::<u32>().is_ok());
    matches!(text.as_str(), "SO" | "SI") || numbered('S') || numbered('F')
}
