//! Alternatives in a TOML file: a key that takes one value, a list, or a range of numbers.

use crate::{Error, Result};
use serde::Deserialize;

/// One value or a list.
#[derive(Clone, Debug, Deserialize, schemars::JsonSchema)]
#[serde(untagged)]
#[non_exhaustive]
pub enum Alternatives<T> {
    /// One value.
    One(T),
    /// A list of values.
    List(Vec<T>),
}

impl<T> Alternatives<T> {
    /// The values, of which an empty list has none.
    pub fn as_slice(&self) -> &[T] {
        match self {
            Self::One(value) => std::slice::from_ref(value),
            Self::List(values) => values,
        }
    }
}

impl<T: Clone> Alternatives<T> {
    /// The values, at least one.
    ///
    /// # Errors
    /// An empty list.
    pub fn values(&self) -> Result<Vec<T>> {
        not_empty(self.as_slice().to_vec())
    }
}

/// A number, a list, or `{ from, to, count }`.
#[derive(Clone, Debug, Deserialize, schemars::JsonSchema)]
#[serde(untagged)]
#[non_exhaustive]
pub enum Numbers {
    /// One number.
    One(f64),
    /// A list of numbers.
    List(Vec<f64>),
    /// Evenly spaced numbers.
    Range(Range),
}

/// `{ from = 0.001, to = 0.1, count = 5, spacing = "log" }`, both ends included.
#[derive(Clone, Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Range {
    /// First value.
    from: f64,
    /// Last value.
    to: f64,
    /// How many values.
    count: usize,
    /// How they are spaced.
    #[serde(default)]
    spacing: Spacing,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
enum Spacing {
    /// Equal differences.
    #[default]
    Linear,
    /// Equal ratios.
    Log,
}

/// Most values of a range. A trade: more than a sweep needs along one axis, and a count with a
/// digit too many is refused before it fills the memory.
const MAX_VALUES: usize = 100_000;

impl Numbers {
    /// The values, at least one, all finite.
    ///
    /// # Errors
    /// An empty list, a value that is not finite, a range of no values or more than 100000, and a
    /// logarithmic range that does not lie above zero.
    pub fn values(&self) -> Result<Vec<f64>> {
        let values = match self {
            Self::One(v) => vec![*v],
            Self::List(v) => not_empty(v.clone())?,
            Self::Range(range) => range.values()?,
        };
        match values.iter().find(|v| !v.is_finite()) {
            Some(v) => Err(Error::input(format!("the value {v}")).help("use finite numbers")),
            None => Ok(values),
        }
    }
}

impl Range {
    fn values(&self) -> Result<Vec<f64>> {
        let Self { from, to, count, spacing } = *self;
        let log = spacing == Spacing::Log;
        if !(1..=MAX_VALUES).contains(&count) || log && !(from > 0.0 && to > 0.0) {
            return Err(Error::input(format!("a range from {from} to {to} of {count} values"))
                .help(format!(
                    "count is 1 to {MAX_VALUES}; the ends of a logarithmic range are above zero"
                )));
        }
        let steps = (count - 1).max(1) as f64;
        Ok((0..count)
            .map(|i| match () {
                // The ends are what was written, not what rounding makes of them.
                () if i == 0 => from,
                () if i == count - 1 => to,
                () if log => from * libm::pow(to / from, i as f64 / steps),
                () => from + (to - from) * i as f64 / steps,
            })
            .collect())
    }
}

fn not_empty<T>(values: Vec<T>) -> Result<Vec<T>> {
    if values.is_empty() {
        return Err(Error::input("an empty list").help("give one value or more"));
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(text: &str) -> Result<Vec<f64>> {
        let table: std::collections::BTreeMap<String, Numbers> =
            toml::from_str(&format!("v = {text}")).map_err(|e| Error::input(e.to_string()))?;
        table["v"].values()
    }

    #[test]
    fn one_several_and_ranges() {
        assert_eq!(values("3").unwrap(), [3.0]);
        assert_eq!(values("[1, 2.5]").unwrap(), [1.0, 2.5]);
        assert_eq!(values("{ from = 0, to = 1, count = 3 }").unwrap(), [0.0, 0.5, 1.0]);
        let log = values("{ from = 0.001, to = 0.1, count = 3, spacing = 'log' }").unwrap();
        assert!((log[1] - 0.01).abs() < 1e-15 && (log[0], log[2]) == (0.001, 0.1), "{log:?}");
        for wrong in ["[]", "{ from = 0, to = 1, count = 0 }", "nan"] {
            assert!(values(wrong).is_err(), "{wrong}");
        }
        assert!(values("{ from = 0, to = 1, count = 3, spacing = 'log' }").is_err());
        assert!(values("{ from = 0, to = 1, count = 99999999999 }").is_err());
    }
}
