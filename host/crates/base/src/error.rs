//! The one error type of the library and the program.
//!
//! Which constructor to use: [`Error::input`] when something a person wrote or supplied is wrong
//! (say what is wrong, where, and what would be right); [`Error::io`] when the operating system
//! refused. Both end the program with exit status 2. "The comparison says no" is not an error: a
//! command returns exit status 1 for it.

use std::fmt;
use std::path::Path;

/// Result with this crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What went wrong, where, and what would be right.
#[derive(Debug)]
pub struct Error {
    what: String,
    place: Option<String>,
    help: Option<String>,
    source: Option<Box<dyn std::error::Error + Send + Sync>>,
}

impl Error {
    /// Something supplied by a person is wrong. `what` names the value and what is wrong with it.
    pub fn input(what: impl Into<String>) -> Self {
        Self { what: what.into(), place: None, help: None, source: None }
    }

    /// The operating system refused an operation on `path`. `doing` reads like "write".
    pub fn io(doing: &str, path: &Path, source: std::io::Error) -> Self {
        let what = format!("cannot {doing} {}: {source}", path.display());
        Self { what, place: None, help: None, source: Some(Box::new(source)) }
    }

    /// Adds where it is wrong: a file with a line, a key, an option.
    #[must_use]
    pub fn at(mut self, place: impl fmt::Display) -> Self {
        let place = place.to_string();
        self.place = Some(match self.place {
            Some(inner) if inner.starts_with(&place) => inner, // said already
            Some(inner) => format!("{place}, {inner}"),
            None => place,
        });
        self
    }

    /// Adds what would be right.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.what)?;
        if let Some(place) = &self.place {
            write!(f, "\n  where: {place}")?;
        }
        if let Some(help) = &self.help {
            write!(f, "\n  help: {help}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.source.as_ref().map(|s| s.as_ref() as _)
    }
}
