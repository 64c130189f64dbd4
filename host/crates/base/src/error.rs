//! The error type of the library and the program: its kind, what is wrong, where, and what would
//! be right.
//!
//! Messages are in terms of the library. A program that has other names for the same things, as a
//! command line has its flags, finds out by the error's code what to add.

use crate::ErrorCode;
use std::fmt;
use std::path::Path;

/// Result with this crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// What sort of thing went wrong, so that a program can decide what to do about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// Something a person wrote or supplied is wrong.
    Input,
    /// Valid input that camrig does not handle.
    Unsupported,
    /// More than a stated limit allows: a size, a count, a time.
    Limit,
    /// The operating system or a device refused.
    Io,
    /// Two things that should agree do not: a rig and its host, a model and its captures.
    Disagreement,
    /// A state that only a fault of camrig can explain.
    Internal,
}

/// What is wrong, of which kind it is, where, and what would be right.
///
/// ```
/// use camrig_base::{Error, ErrorKind};
///
/// let error = Error::input("-3 lx").at("scene.toml, line 4").help("use zero or more");
/// assert_eq!(error.kind(), ErrorKind::Input);
/// assert_eq!(error.to_string(), "-3 lx\n  where: scene.toml, line 4\n  help: use zero or more");
/// ```
#[derive(Debug)]
pub struct Error {
    kind: ErrorKind,
    what: String,
    place: Option<String>,
    help: Option<String>,
    code: Option<ErrorCode>,
    source: Option<Box<dyn std::error::Error + Send + Sync>>,
}

impl Error {
    /// An error of a kind. `what` names the value and what is wrong with it.
    pub fn new(kind: ErrorKind, what: impl Into<String>) -> Self {
        Self { kind, what: what.into(), place: None, help: None, code: None, source: None }
    }

    /// Something supplied by a person is wrong.
    pub fn input(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Input, what)
    }

    /// Valid input that camrig does not handle.
    pub fn unsupported(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Unsupported, what)
    }

    /// More than a stated limit allows.
    pub fn limit(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Limit, what)
    }

    /// Two things that should agree do not.
    pub fn disagreement(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Disagreement, what)
    }

    /// A state that only a fault of camrig can explain.
    pub fn internal(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Internal, what).help("this is a fault of camrig: please report it")
    }

    /// A device, a link or the operating system failed in something that concerns no file.
    pub fn device(what: impl Into<String>) -> Self {
        Self::new(ErrorKind::Io, what)
    }

    /// The operating system refused an operation on `path`. `doing` reads like "write".
    pub fn io(doing: &str, path: &Path, source: std::io::Error) -> Self {
        let what = format!("cannot {doing} {}: {source}", path.display());
        Self { source: Some(Box::new(source)), ..Self::new(ErrorKind::Io, what) }
    }

    /// Adds where it is wrong: a file with a line, a key, a stack.
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

    /// Gives the error a code, which stays when its words change.
    #[must_use]
    pub fn with_code(mut self, code: ErrorCode) -> Self {
        self.code = Some(code);
        self
    }

    /// Of which kind it is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    /// What is wrong.
    #[must_use]
    pub fn what(&self) -> &str {
        &self.what
    }

    /// Where it is wrong, outermost first.
    #[must_use]
    pub fn place(&self) -> Option<&str> {
        self.place.as_deref()
    }

    /// The error's code, if it has one.
    #[must_use]
    pub fn code(&self) -> Option<ErrorCode> {
        self.code
    }

    /// What would be right.
    #[must_use]
    pub fn remedy(&self) -> Option<&str> {
        self.help.as_deref()
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
