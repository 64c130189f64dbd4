//! Values drawn at random: `[random]` of a sweep file.
//!
//! The value of a key depends on the seed, the key's name and the place of the picture in the sweep
//! alone: other keys, the order of the work and its parts change nothing. Its source is the first
//! 53 bits of SHA-256 of `SEED/PLACE/KEY`, as a fraction of 1.

use camrig_base::{Error, Result};
use camrig_camera::Value;
use schemars::JsonSchema;
use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

/// Keys that take values at random.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Random {
    /// Draws for each combination of the grid.
    #[serde(default = "one")]
    #[schemars(range(min = 1))]
    count: u32,
    /// Another seed gives other values.
    #[serde(default)]
    seed: u64,
    /// Keys of the grid or of the camera file, each with `{ range = [A, B] }` (even),
    /// `{ log-range = [A, B] }` (even in the logarithm) or `{ choice = [...] }`.
    keys: BTreeMap<String, Draw>,
}

fn one() -> u32 {
    1
}

/// How a value is drawn.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Draw {
    /// Evenly between two numbers.
    Range([f64; 2]),
    /// Evenly in the logarithm between two numbers above zero.
    LogRange([f64; 2]),
    /// One of a list.
    #[schemars(with = "Vec<serde_json::Value>")]
    Choice(Vec<Value>),
}

/// Nothing is drawn.
impl Default for Random {
    fn default() -> Self {
        Self { count: 1, seed: 0, keys: BTreeMap::new() }
    }
}

impl Random {
    /// Draws for each combination.
    pub fn count(&self) -> usize {
        self.count as usize
    }

    /// Checks every key.
    ///
    /// # Errors
    /// No draws, empty choices, invalid ranges.
    pub fn check(&self) -> Result<()> {
        if self.count == 0 {
            return Err(Error::input("count = 0").at("[random]").help("take at least one draw"));
        }
        for (key, draw) in &self.keys {
            let good = match draw {
                Draw::Range([from, to]) => from.is_finite() && to.is_finite() && from <= to,
                Draw::LogRange([from, to]) => *from > 0.0 && to.is_finite() && from <= to,
                Draw::Choice(values) => !values.is_empty(),
            };
            if !good {
                return Err(Error::input(format!("{draw:?}")).at(format!("random key {key:?}")).help(
                    "the lower end comes first, that of log-range is above zero, and a choice has \
                     one value or more",
                ));
            }
        }
        Ok(())
    }

    /// How a key is drawn.
    pub fn get(&self, key: &str) -> Option<&Draw> {
        self.keys.get(key)
    }

    /// Keys that are drawn, and how.
    pub fn draws(&self) -> impl Iterator<Item = (&String, &Draw)> {
        self.keys.iter()
    }

    /// The value of a key at a place of the sweep, if it is drawn.
    pub fn value(&self, key: &str, place: u64) -> Option<Value> {
        Some(match self.get(key)? {
            Draw::Range([from, to]) => Value::from(from + (to - from) * self.part(key, place)),
            Draw::LogRange([from, to]) => {
                Value::from(from * libm::pow(to / from, self.part(key, place)))
            }
            Draw::Choice(values) => values[self.one_of(key, place, values.len())].clone(),
        })
    }

    /// A number from 0 to `count` - 1.
    pub fn one_of(&self, key: &str, place: u64, count: usize) -> usize {
        ((self.part(key, place) * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// From 0 to below 1.
    fn part(&self, key: &str, place: u64) -> f64 {
        let digest = Sha256::digest(format!("{}/{place}/{key}", self.seed));
        let bits = digest.iter().take(8).fold(0u64, |bits, &byte| bits << 8 | u64::from(byte));
        (bits >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(text: &str) -> Random {
        toml::from_str(text).unwrap()
    }

    /// Of 10000 draws, mean and standard deviation of an even distribution, and each value of a
    /// choice as often: within 5 standard errors.
    #[test]
    fn draws_are_even_and_each_key_has_its_own() {
        let all = "seed = 4\n[keys]\na = { range = [2, 6] }\nb = { log-range = [1, 100] }\n\
                   c = { choice = ['x', 'y', 'z'] }\n";
        let draws = random(all);
        let n = 10_000;
        let numbers = |key: &str| -> Vec<f64> {
            let value = |place| draws.value(key, place).and_then(|v| v.as_f64());
            (0..n).map(|place| value(place).unwrap()).collect()
        };
        let (a, b) = (numbers("a"), numbers("b"));
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        let error = 4.0 / 12f64.sqrt() / (n as f64).sqrt();
        assert!((mean(&a) - 4.0).abs() < 5.0 * error, "{}", mean(&a));
        let logs: Vec<f64> = b.iter().map(|b| b.log10()).collect();
        assert!((mean(&logs) - 1.0).abs() < 2.5 * error, "{}", mean(&logs));
        let both: Vec<f64> = a.iter().zip(&logs).map(|(a, l)| (a - 4.0) * (l - 1.0)).collect();
        assert!(mean(&both).abs() < 5.0 * 2.0 / 3.0 / (n as f64).sqrt(), "{}", mean(&both));
        let xs = (0..n).filter(|&p| draws.value("c", p).unwrap().as_str() == Some("x")).count();
        let error = (n as f64 * 2.0 / 9.0).sqrt();
        assert!((xs as f64 - n as f64 / 3.0).abs() < 5.0 * error, "{xs}");
        // Another key beside it changes nothing, another seed does.
        let alone = random("seed = 4\n[keys]\na = { range = [2, 6] }\n");
        assert_eq!(alone.value("a", 7), draws.value("a", 7));
        let other = random(&all.replace("= 4", "= 5"));
        assert_ne!(other.value("a", 7), draws.value("a", 7));
    }
}
