//! Choices by name: the variants of an enum as files and command lines name them.

use crate::{Error, Result, toml_text};

/// The one of `all` whose name is `text`.
///
/// ```
/// use camrig_base::choice;
///
/// let name = |bits: u32| if bits == 8 { "byte" } else { "word" };
/// assert_eq!(choice::by_name("size", "word", &[8, 16], name).unwrap(), 16);
/// assert!(choice::by_name("size", "wrod", &[8, 16], name).is_err());
/// ```
///
/// # Errors
/// No such name; `what` says of what, and the help has the nearest one.
pub fn by_name<T: Copy>(
    what: &str,
    text: &str,
    all: &[T],
    name: impl Fn(T) -> &'static str,
) -> Result<T> {
    all.iter().copied().find(|&value| name(value) == text).ok_or_else(|| {
        let names: Vec<&str> = all.iter().map(|&value| name(value)).collect();
        Error::input(format!("{what} {text:?}")).help(toml_text::did_you_mean(text, &names))
    })
}
