//! Errors of the library as an exception.

use camrig::{Error, ErrorKind};
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

pyo3::create_exception!(
    camrig,
    CamrigError,
    PyException,
    "What is wrong, where, and what would be right: attributes kind, what, where, help, code."
);

/// The library's results as Python's.
pub trait OrRaise<T> {
    /// The value, or the exception.
    fn or_raise(self) -> PyResult<T>;
}

impl<T> OrRaise<T> for camrig::Result<T> {
    fn or_raise(self) -> PyResult<T> {
        self.map_err(|error| raised(&error))
    }
}

/// The exception of an error.
pub fn raised(error: &Error) -> PyErr {
    Python::attach(|py| {
        let exception = CamrigError::new_err(error.to_string());
        let value = exception.value(py);
        let set = |name: &str, text: Option<&str>| value.setattr(name, text);
        let all = [
            ("kind", Some(word(error.kind()))),
            ("what", Some(error.what())),
            ("where", error.place()),
            ("help", error.remedy()),
            ("code", error.code().map(|code| code.name())),
        ];
        match all.into_iter().try_for_each(|(name, text)| set(name, text)) {
            Ok(()) => exception,
            Err(other) => other,
        }
    })
}

fn word(kind: ErrorKind) -> &'static str {
    match kind {
        ErrorKind::Input => "input",
        ErrorKind::Io => "io",
        ErrorKind::Unsupported => "unsupported",
        ErrorKind::Limit => "limit",
        ErrorKind::Disagreement => "disagreement",
        _ => "internal",
    }
}
