//! Numbers that are spread over bits of registers, written as data sheets do: `0x3500[3:0] 0x3501`.

use camrig_base::{Error, Result};
use serde::Deserialize;
use std::collections::BTreeMap;

/// What registers hold, by their addresses; 0 where nothing is.
pub type Memory = BTreeMap<u16, u16>;

/// Bits of one register.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Slice {
    address: u16,
    /// Highest and lowest bit; all if there are none.
    bits: Option<(u32, u32)>,
}

/// A number whose bits are in registers, the highest first.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(try_from = "String")]
pub struct Field(Vec<Slice>);

/// A field with a certain value: `0x0100[0] = 1`.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(try_from = "String")]
pub struct Condition {
    field: Field,
    value: u32,
}

/// Longest field, bits.
const MAX_BITS: u32 = 32;

/// Reads a number, decimal or 0x.
pub(crate) fn number(text: &str) -> Option<u32> {
    let text = text.trim();
    text.strip_prefix("0x")
        .map_or_else(|| text.parse().ok(), |hex| u32::from_str_radix(hex, 16).ok())
}

fn slice(text: &str) -> Option<Slice> {
    let (address, bits) = match text.split_once('[') {
        None => (text, None),
        Some((address, bits)) => {
            let bits = bits.strip_suffix(']')?;
            let (high, low) = bits.split_once(':').unwrap_or((bits, bits));
            let (high, low) = (high.parse().ok()?, low.parse().ok()?);
            (address, Some((high, low)).filter(|_| low <= high && high < u16::BITS))
        }
    };
    let address = number(address)?.try_into().ok()?;
    (bits.is_some() || !text.contains('[')).then_some(Slice { address, bits })
}

impl TryFrom<String> for Field {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        let slices: Option<Vec<Slice>> = text.split_whitespace().map(slice).collect();
        slices.filter(|slices| !slices.is_empty()).map(Self).ok_or_else(|| {
            Error::input(format!("{text:?} names no bits of registers"))
                .help("write addresses from the highest bits down: \"0x3500[3:0] 0x3501\"")
        })
    }
}

impl TryFrom<String> for Condition {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        let (field, value) = text.split_once('=').unwrap_or((&text, ""));
        let value = number(value).ok_or_else(|| {
            Error::input(format!("{text:?} is no condition")).help("write \"0x0100[0] = 1\"")
        })?;
        Ok(Self { field: field.to_string().try_into()?, value })
    }
}

impl Field {
    /// Its value in registers of so many bits.
    pub fn read(&self, memory: &Memory, register_bits: u32) -> u32 {
        self.0.iter().fold(0, |value, slice| {
            let (high, low) = slice.bits.unwrap_or((register_bits - 1, 0));
            let bits = high + 1 - low;
            let held = u32::from(memory.get(&slice.address).copied().unwrap_or(0));
            value << bits | held >> low & ((1 << bits) - 1)
        })
    }

    /// Whether it is within registers of so many bits, and not too long.
    pub(crate) fn fits(&self, register_bits: u32) -> bool {
        let bits = |slice: &Slice| slice.bits.unwrap_or((register_bits - 1, 0));
        let sum: u32 = self.0.iter().map(|slice| bits(slice).0 + 1 - bits(slice).1).sum();
        sum <= MAX_BITS && self.0.iter().all(|slice| bits(slice).0 < register_bits)
    }

    /// Whether it has bits at an address.
    pub(crate) fn is_at(&self, address: u16) -> bool {
        self.0.iter().any(|slice| slice.address == address)
    }
}

impl Condition {
    /// Whether it holds.
    pub fn holds(&self, memory: &Memory, register_bits: u32) -> bool {
        self.field.read(memory, register_bits) == self.value
    }

    /// The field that decides.
    pub(crate) fn field(&self) -> &Field {
        &self.field
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(text: &str) -> Result<Field> {
        text.to_string().try_into()
    }

    #[test]
    fn bits_follow_each_other_from_the_highest() {
        let memory = Memory::from([(0x07, 0x3F), (0x10, 0xA5), (0x04, 0x42), (0x0B, 0x8001)]);
        let exposure = field("0x07[5:0] 0x10 0x04[1:0]").unwrap();
        assert_eq!(exposure.read(&memory, 8), 0x3F << 10 | 0xA5 << 2 | 2);
        assert_eq!(field("0x0B[14:0]").unwrap().read(&memory, 16), 1);
        assert_eq!(field("0x99").unwrap().read(&memory, 8), 0, "nothing was written there");
        assert!(exposure.fits(8) && !field("0x0B[14:0]").unwrap().fits(8));
        assert!(!field("1 2 3 4 5").unwrap().fits(8), "40 bits");
    }

    #[test]
    fn conditions_are_values_of_fields() {
        let stream = Condition::try_from("0x301B[2] = 1".to_string()).unwrap();
        assert!(stream.holds(&Memory::from([(0x301B, 0x0C)]), 8));
        assert!(!stream.holds(&Memory::new(), 8));
    }

    #[test]
    fn what_names_no_bits_is_refused() {
        for text in ["", "x", "0x10[", "0x10[3:5]", "0x10[16]", "0x10000", "0x10[1:0"] {
            assert!(field(text).unwrap_err().to_string().contains("0x3501"), "{text}");
        }
        assert!(Condition::try_from("0x0100".to_string()).is_err());
    }
}
