//! Choices by name: the variants of an enum as files and command lines name them.

use crate::{Error, Result, toml_text};

/// Gives an enum its names: `ALL`, `name`, [`Display`](std::fmt::Display) and
/// [`FromStr`](std::str::FromStr), whose error has the nearest name.
///
/// ```
/// #[derive(Clone, Copy, Debug, PartialEq)]
/// enum Size {
///     Byte,
///     Word,
/// }
/// camrig_base::choices!(Size, "size": Byte = "byte", Word = "word");
///
/// assert_eq!("word".parse::<Size>()?, Size::Word);
/// assert!("wrod".parse::<Size>().unwrap_err().to_string().contains("did you mean \"word\"?"));
/// # Ok::<(), camrig_base::Error>(())
/// ```
#[macro_export]
macro_rules! choices {
    ($type:ident, $what:literal: $($variant:ident = $name:literal),+ $(,)?) => {
        impl $type {
            /// All choices, in the order of a list for people.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$variant),+];

            /// The name in files and on command lines.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),+ }
            }
        }

        impl std::fmt::Display for $type {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }

        impl std::str::FromStr for $type {
            type Err = $crate::Error;

            fn from_str(text: &str) -> $crate::Result<Self> {
                $crate::choice::by_name($what, text, &Self::ALL, Self::name)
            }
        }
    };
}

/// The one of `all` whose name is `text`.
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
