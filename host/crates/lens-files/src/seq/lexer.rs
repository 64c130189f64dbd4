//! The commands of a `.seq` file: lines joined where `&` continues them, split at semicolons into
//! commands, and commands into words, quoted text and labels.

use camrig_base::{Error, Result};

/// One command and the line it starts on.
#[derive(Debug, PartialEq)]
pub(super) struct Command {
    /// Line, from 1.
    pub line: usize,
    /// The command's name, in capitals.
    pub keyword: String,
    /// What follows the name.
    pub words: Vec<Word>,
    /// Whether a quotation mark is not closed: a title may have an apostrophe, nothing else.
    pub open_quote: bool,
}

/// One word of a command.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Word {
    /// Its text, without quotation marks.
    pub text: String,
    /// How it is written.
    pub kind: Kind,
}

/// How a word is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Between blanks.
    Plain,
    /// Between quotation marks.
    Quoted,
    /// As `L'NAME'`: it names what the command belongs to, such as an aperture.
    Label,
}

/// The commands of a file.
///
/// # Errors
/// A file that ends in the middle of a command.
pub(super) fn commands(text: &str) -> Result<Vec<Command>> {
    let mut all = Vec::new();
    let mut parser = Parser::default();
    for (i, line) in text.lines().enumerate() {
        parser.line(line, i + 1, &mut all);
    }
    if parser.continued {
        return Err(Error::input("the last command ends with &")
            .at(format!("line {}", parser.start))
            .help("its continuation is missing: is the file cut short?"));
    }
    Ok(all)
}

#[derive(Default)]
struct Parser {
    words: Vec<Word>,
    word: String,
    /// The quotation mark that is open, and the kind of its word.
    quote: Option<(char, Kind)>,
    open_quote: bool,
    start: usize,
    continued: bool,
}

impl Parser {
    fn line(&mut self, line: &str, number: usize, all: &mut Vec<Command>) {
        if !std::mem::take(&mut self.continued) {
            self.start = number;
        }
        for c in line.chars() {
            match (self.quote, c) {
                (Some((mark, kind)), c) if c == mark => {
                    self.quote = None;
                    let text = std::mem::take(&mut self.word);
                    self.words.push(Word { text, kind });
                }
                (Some(_), c) => self.word.push(c),
                (None, '\'' | '"') => {
                    let label = self.word.eq_ignore_ascii_case("L");
                    if label {
                        self.word.clear();
                    }
                    self.end_word();
                    let kind = if label { Kind::Label } else { Kind::Quoted };
                    self.quote = Some((c, kind));
                }
                (None, ';') => {
                    self.end_command(all);
                    self.start = number;
                }
                (None, '!') => break,
                (None, c) if c.is_whitespace() => self.end_word(),
                (None, c) => self.word.push(c),
            }
        }
        if let Some((_, kind)) = self.quote.take() {
            self.open_quote = true;
            let text = std::mem::take(&mut self.word);
            self.words.push(Word { text, kind });
        } else {
            self.end_word();
            self.continued = self.take_mark();
        }
        if !self.continued {
            self.end_command(all);
        }
    }

    /// Takes the `&` off the end of the line; whether there is one.
    fn take_mark(&mut self) -> bool {
        let Some(last) = self.words.last_mut().filter(|w| w.kind == Kind::Plain) else {
            return false;
        };
        if !last.text.ends_with('&') {
            return false;
        }
        last.text.pop();
        if last.text.is_empty() {
            self.words.pop();
        }
        true
    }

    fn end_word(&mut self) {
        if !self.word.is_empty() {
            let text = std::mem::take(&mut self.word);
            self.words.push(Word { text, kind: Kind::Plain });
        }
    }

    fn end_command(&mut self, all: &mut Vec<Command>) {
        self.end_word();
        let open_quote = std::mem::take(&mut self.open_quote);
        let mut words = std::mem::take(&mut self.words).into_iter();
        if let Some(first) = words.next() {
            all.push(Command {
                line: self.start,
                keyword: first.text.to_ascii_uppercase(),
                words: words.collect(),
                open_quote,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Vec<(usize, String)> {
        let spell = |c: &Command| {
            let words = c.words.iter().map(|w| match w.kind {
                Kind::Plain => w.text.clone(),
                Kind::Quoted => format!("<{}>", w.text),
                Kind::Label => format!("[{}]", w.text),
            });
            (c.line, [vec![c.keyword.clone()], words.collect()].concat().join(" "))
        };
        commands(text).unwrap().iter().map(spell).collect()
    }

    fn expect(text: &str, lines: &[(usize, &str)]) {
        let lines: Vec<_> = lines.iter().map(|(n, t)| (*n, (*t).to_owned())).collect();
        assert_eq!(read(text), lines, "{text}");
    }

    #[test]
    fn lines_are_joined_and_split() {
        expect(
            "wl 656.3&\n 587.6 & ! blue\n 486.1; REF 2\nGO",
            &[(1, "WL 656.3 587.6 486.1"), (3, "REF 2"), (4, "GO")],
        );
        expect("A 1; D&\n -4e-11;;K 0 ! x; y", &[(1, "A 1"), (1, "D -4e-11"), (2, "K 0")]);
        assert!(commands("S 60 5 &\n").is_err());
    }

    #[test]
    fn quotes_hold_what_else_would_split() {
        expect("TITLE 'a; b ! c &'", &[(1, "TITLE <a; b ! c &>")]);
        expect("S 60 6 'NBK7'", &[(1, "S 60 6 <NBK7>")]);
        expect(
            "SLB \"x y\"\nCIR OBS L'SPI DER' 1.4",
            &[(1, "SLB <x y>"), (2, "CIR OBS [SPI DER] 1.4")],
        );
        let open = commands("TITLE Cook's lens\nGO").unwrap();
        assert!(open[0].open_quote && !open[1].open_quote);
    }
}
