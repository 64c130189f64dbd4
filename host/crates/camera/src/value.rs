//! Values of keys of a camera file, and changes of them.

use super::{Error, Result};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The value of a key: a number, a truth value, a word or a list.
///
/// ```
/// use camrig_camera::Value;
///
/// assert_eq!(Value::from(320).as_f64(), Some(320.0));
/// assert_eq!(Value::from("mono").as_str(), Some("mono"));
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Value(pub(crate) toml::Value);

impl Value {
    /// The number, whole or not, if it is one.
    #[must_use]
    pub fn as_f64(&self) -> Option<f64> {
        self.0.as_float().or(self.0.as_integer().map(|i| i as f64))
    }

    /// The text, if it is one.
    #[must_use]
    pub fn as_str(&self) -> Option<&str> {
        self.0.as_str()
    }
}

/// As in a TOML file.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

macro_rules! values {
    ($($of:ty),+) => {
        $(impl From<$of> for Value {
            fn from(value: $of) -> Self {
                Self(value.into())
            }
        })+
    };
}

values!(i64, i32, u32, f64, f32, bool, &str, String);

impl<T: Into<Self>> From<Vec<T>> for Value {
    fn from(values: Vec<T>) -> Self {
        Self(toml::Value::Array(values.into_iter().map(|value| value.into().0).collect()))
    }
}

/// A key of a camera file, by its path, and the value that it is to have: `sensor.noise.read_e`,
/// or `effect.KIND.KEY` for the effect of that kind, which is added where the file has none.
///
/// ```
/// use camrig_camera::{Camera, Change};
///
/// let changes = [Change::new("sensor.cfa", "mono"), Change::new("sensor.qe", 0.5)];
/// let camera = Camera::load_with("mt9v024", changes)?;
/// assert!(camera.sensor.cfa.is_mono());
///
/// let from_text: Change = "sensor.noise.read_e = 2.5".parse()?;
/// assert_eq!(from_text, Change::new("sensor.noise.read_e", 2.5));
/// # Ok::<(), camrig_base::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// The key's path.
    pub key: String,
    /// Its value.
    pub value: Value,
}

impl Change {
    /// A key with its value.
    pub fn new(key: impl Into<String>, value: impl Into<Value>) -> Self {
        Self { key: key.into(), value: value.into() }
    }
}

impl<K: Into<String>, V: Into<Value>> From<(K, V)> for Change {
    fn from((key, value): (K, V)) -> Self {
        Self::new(key, value)
    }
}

impl From<&Change> for Change {
    fn from(change: &Change) -> Self {
        change.clone()
    }
}

/// Reads `KEY=VALUE`: the value in TOML's syntax, or a bare word as a text.
impl FromStr for Change {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let (key, value) = text.split_once('=').ok_or_else(|| {
            Error::input(format!(
                "{text:?}: write KEY=VALUE, for instance sensor.noise.read_e=2.5"
            ))
        })?;
        let (key, value) = (key.trim(), value.trim());
        let parsed = toml::from_str::<toml::Table>(&format!("v = {value}"));
        let parsed = parsed.ok().and_then(|mut table| table.remove("v"));
        Ok(Self::new(key, parsed.map_or_else(|| value.into(), Value)))
    }
}
