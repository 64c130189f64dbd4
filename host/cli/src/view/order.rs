//! Requests of the page.

use camrig_base::{Error, Result};
use serde::Deserialize;

/// Longest exposure that the page may request, s. A trade-off: long enough for any bench, and a
/// slip does not stop the stream for hours.
pub const LONGEST_EXPOSURE_S: f64 = 60.0;
/// Largest gain that the page may request: that of the rig's gain code, which has 16 bits in steps
/// of 1/256.
const LARGEST_GAIN: f64 = 255.0;
/// Maximum illuminance that the page may request, lx: ten times sunlight.
const MAX_LUX: f64 = 1e6;

/// A message of the page.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Ask {
    /// Send the next message.
    Next(Next),
    /// Save the frame that was sent last.
    Save,
    /// Pass this order to the stream.
    Set(Order),
}

/// What the page has already, and whether it wants samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Next {
    /// Number of the last frame that it has.
    pub seen: u64,
    /// Number of the last event that it has.
    pub event: u64,
    /// Whether it wants the samples of a newer frame: a frozen page does not.
    pub pixels: bool,
}

/// An order to the stream.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Order {
    /// Exposure to write, s.
    ExposureS(f64),
    /// Analog gain to write.
    AnalogGain(f64),
    /// Automatic exposure.
    AutoExposure(bool),
    /// Illuminance of the scene, lx.
    Lux(f64),
    /// Light on the scene, by its name.
    Illuminant(String),
    /// Scene, by its name.
    Scene(String),
    /// Read the registers.
    Registers,
    /// Write a register.
    Register {
        /// Its address.
        address: u16,
        /// Its value.
        value: u32,
    },
    /// Whether frames are recorded.
    Record(bool),
}

impl Order {
    /// Refuses values out of range.
    ///
    /// # Errors
    /// With the range.
    pub fn check(&self) -> Result<()> {
        let limit = |what: &str, v: f64, most: f64, unit: &str| match v > 0.0 && v <= most {
            true => Ok(()),
            false => Err(Error::limit(format!("{what} of {v}{unit}"))
                .help(format!("use values above 0, at most {most}{unit}"))),
        };
        match *self {
            Self::ExposureS(s) => limit("an exposure", s, LONGEST_EXPOSURE_S, " s"),
            Self::AnalogGain(g) => limit("a gain", g, LARGEST_GAIN, ""),
            Self::Lux(lux) => limit("an illuminance", lux, MAX_LUX, " lx"),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_read_and_what_is_none_is_refused() {
        let read = serde_json::from_str::<Ask>;
        let set = |order| Ask::Set(order);
        let next = Next { seen: 7, event: 2, pixels: true };
        for (text, ask) in [
            (r#"{"next":{"seen":7,"event":2,"pixels":true}}"#, Ask::Next(next)),
            (r#""save""#, Ask::Save),
            (r#"{"set":{"exposure_s":0.01}}"#, set(Order::ExposureS(0.01))),
            (r#"{"set":"registers"}"#, set(Order::Registers)),
            (
                r#"{"set":{"register":{"address":514,"value":800}}}"#,
                set(Order::Register { address: 514, value: 800 }),
            ),
        ] {
            assert_eq!(read(text).unwrap(), ask, "{text}");
        }
        for text in ["", "{}", r#"{"set":{"fault":1}}"#, r#"{"next":{"seen":-1}}"#, "[[[["] {
            assert!(read(text).is_err(), "{text}");
        }
    }

    #[test]
    fn values_out_of_range_are_refused_with_the_range() {
        for order in [
            Order::ExposureS(0.0),
            Order::ExposureS(61.0),
            Order::ExposureS(f64::NAN),
            Order::AnalogGain(256.0),
            Order::Lux(-1.0),
        ] {
            assert!(order.check().unwrap_err().to_string().contains("above 0"), "{order:?}");
        }
        assert!(Order::ExposureS(0.01).check().is_ok() && Order::Record(true).check().is_ok());
    }
}
