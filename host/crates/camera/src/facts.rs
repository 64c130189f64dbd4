//! Facts on image sensors, each with its source: the table `presets/sensors.csv`.
//!
//! A sensor has one fact for each parameter, of one operating mode at unity gain, and perhaps the
//! read noise at another gain. [`crate::draft`] makes camera files of them.

use super::{builtin, csv_reader};
use serde::Deserialize;
use std::sync::LazyLock;

/// One value of a sensor, as its source has it.
#[derive(Clone, Debug, Deserialize)]
pub struct Fact {
    /// Type number of the sensor, lower case.
    pub sensor: String,
    /// Name of the parameter, such as `full_well`.
    pub parameter: String,
    /// The value.
    pub value: String,
    /// Unit of the value; empty where it has none.
    pub unit: String,
    /// Gain, conversion gain or bit depth that the value belongs to.
    pub mode: String,
    /// Temperature or wavelength of the value, how it was derived, doubts.
    pub condition: String,
    /// `measured`, `datasheet`, `quoted`, `derived` or `typical`.
    pub grade: String,
    /// `direct`, `second-hand`, or `none` for a value without a source.
    pub via: String,
    /// Title and address, or repository and path.
    pub source: String,
}

impl Fact {
    /// The value as a number, where it is one.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        self.value.parse().ok()
    }

    /// The bits of the converter that the value belongs to, where its mode names them (`12 bit`).
    #[must_use]
    pub fn bits(&self) -> Option<u32> {
        let before = self.mode.split_once(" bit").or(self.mode.split_once("-bit"))?.0;
        before.rsplit([' ', ',']).next()?.parse().ok()
    }

    /// The temperature of the value, °C, where its condition begins with one (`25 C`).
    #[must_use]
    pub fn temperature_c(&self) -> Option<f64> {
        self.condition.split_once(" C")?.0.parse().ok()
    }

    /// The analog gain of the value, where its mode names one (`analogue gain 16`, `24 dB`).
    #[must_use]
    pub fn gain(&self) -> Option<f64> {
        let first = self.mode.split(',').next()?;
        if let Some(db) = first.strip_suffix(" dB") {
            return Some(libm::pow(10.0, db.parse::<f64>().ok()? / 20.0));
        }
        first.strip_prefix("analogue gain ")?.parse().ok()
    }
}

/// All that is known of a sensor.
#[derive(Clone, Copy, Debug)]
pub struct Sensor {
    facts: &'static [Fact],
}

static FACTS: LazyLock<Vec<Fact>> = LazyLock::new(|| {
    let text = builtin::file("sensors.csv").unwrap_or_default();
    // A test reads the table: no line of it is wrong.
    csv_reader(text).deserialize().filter_map(Result::ok).collect()
});

impl Sensor {
    /// Every sensor, in the order of the table: by class.
    pub fn all() -> impl Iterator<Item = Self> {
        FACTS.chunk_by(|a, b| a.sensor == b.sensor).map(|facts| Self { facts })
    }

    /// The sensor of a name.
    #[must_use]
    pub fn of(name: &str) -> Option<Self> {
        Self::all().find(|sensor| sensor.name() == name)
    }

    /// Its name, the type number in lower case.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.facts.first().map_or("", |fact| &fact.sensor)
    }

    /// All facts, in the order of the table.
    #[must_use]
    pub fn facts(&self) -> &'static [Fact] {
        self.facts
    }

    /// The first fact of a parameter.
    #[must_use]
    pub fn fact(&self, parameter: &str) -> Option<&'static Fact> {
        self.facts.iter().find(|fact| fact.parameter == parameter)
    }

    /// The value of a parameter as text; empty where nothing is known.
    #[must_use]
    pub fn text(&self, parameter: &str) -> &'static str {
        self.fact(parameter).map_or("", |fact| &fact.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_read_and_complete() {
        let text = builtin::file("sensors.csv").unwrap();
        let lines = text.lines().filter(|l| !l.starts_with('#')).count() - 1;
        assert_eq!(FACTS.len(), lines);
        for fact in FACTS.iter() {
            assert!(["direct", "second-hand", "none"].contains(&&*fact.via), "{fact:?}");
            assert!(fact.via != "none" || fact.grade == "typical", "no source: {fact:?}");
            assert!(!fact.source.is_empty(), "{fact:?}");
            // A dark current without its temperature is no fact.
            let cold = fact.parameter != "dark_current" || fact.temperature_c().is_some();
            assert!(cold, "{fact:?}");
        }
    }

    #[test]
    fn modes_and_conditions_are_understood() {
        let imx477 = Sensor::of("imx477").unwrap();
        let gains: Vec<_> =
            imx477.facts().iter().filter(|f| f.parameter == "read_noise").collect();
        assert_eq!((gains[0].gain(), gains[1].gain()), (Some(1.0), Some(16.0)));
        assert_eq!(imx477.fact("system_gain").unwrap().bits(), Some(12));
        let gsense = Sensor::of("gsense400bsi").unwrap();
        assert_eq!(gsense.fact("black_level").unwrap().bits(), Some(16));
        assert_eq!(gsense.fact("dark_current").unwrap().temperature_c(), Some(30.0));
        let db = Sensor::of("imx250").unwrap().facts().iter().filter_map(Fact::gain).next_back();
        assert!((db.unwrap() - 15.849).abs() < 1e-3);
    }
}
