//! Standard output that may be closed, or whose disk may be full.
//!
//! The standard library's `println!` panics then. Here it unwinds with the error as its payload,
//! without the words of a panic, so that outputs under way are cleaned up, and [`guard`] makes it
//! an [`Error`] again. A reader that has enough and closes its end is none: the program ends
//! quietly.

use camrig_base::{Error, Result};
use std::any::Any;
use std::io::{self, Write};
use std::panic::{self, AssertUnwindSafe};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Writes to standard output; an error ends the command that [`guard`] runs.
pub fn print(what: std::fmt::Arguments<'_>) {
    if let Err(error) = io::stdout().lock().write_fmt(what) {
        panic::resume_unwind(Box::new(failed(error)));
    }
}

static QUIET: AtomicBool = AtomicBool::new(false);

/// From here on, errors and warnings alone are printed on standard error.
pub fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Whether only errors and warnings are printed on standard error.
pub fn quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Writes a line to standard error.
pub fn tell(what: std::fmt::Arguments<'_>) {
    let line = what.to_string();
    if !quiet() || ["error", "warning"].iter().any(|kind| line.starts_with(kind)) {
        std::eprintln!("{line}");
    }
}

/// Runs a command; a failed write to standard output becomes its error.
pub fn guard<T>(command: impl FnOnce() -> Result<T>) -> Result<T> {
    let done = panic::catch_unwind(AssertUnwindSafe(command));
    let outcome =
        done.unwrap_or_else(|payload: Box<dyn Any + Send>| match payload.downcast::<Error>() {
            Ok(error) => Err(*error),
            Err(payload) => panic::resume_unwind(payload),
        })?;
    io::stdout().flush().map_err(failed)?;
    Ok(outcome)
}

fn failed(error: io::Error) -> Error {
    Error::io("write", Path::new("standard output"), error)
}

/// Ends this program as other programs end when nobody reads their output, if that is the error: by
/// SIGPIPE where there are signals.
pub fn end_if_unread(error: &Error) {
    let cause = std::error::Error::source(error).and_then(|e| e.downcast_ref::<io::Error>());
    if cause.is_some_and(|cause| cause.kind() == io::ErrorKind::BrokenPipe) {
        #[cfg(unix)]
        let _ = signal_hook::low_level::emulate_default_handler(signal_hook::consts::SIGPIPE);
        std::process::exit(0);
    }
}
