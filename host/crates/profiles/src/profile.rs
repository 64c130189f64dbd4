//! A sensor's register map.
//!
//! Equations, with the code c of a field: line time = line length / pixel clock; exposure = (c /
//! `per_line` lines + fine clocks) times 2^shift; gain by its [`Law`]; frame time = frame length
//! times line time.

use crate::field::{Condition, Field, Memory, number};
use camrig_base::{Error, Result, mistakes};
use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

const FORMAT: &str = "sensor-profile/1";
/// Longest delay of a written value, frames.
pub(crate) const MAX_DELAY: u32 = 4;

/// The profiles that this crate has, by their names.
const BUILTIN: [(&str, &str); 8] = [
    ("ar0144", include_str!("../profiles/ar0144.toml")),
    ("ar0234", include_str!("../profiles/ar0234.toml")),
    ("ccs", include_str!("../profiles/ccs.toml")),
    ("imx219", include_str!("../profiles/imx219.toml")),
    ("imx477", include_str!("../profiles/imx477.toml")),
    ("mt9v034", include_str!("../profiles/mt9v034.toml")),
    ("ov5647", include_str!("../profiles/ov5647.toml")),
    ("ov7670", include_str!("../profiles/ov7670.toml")),
];

/// A sensor's register map.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// `"sensor-profile/1"`.
    format: String,
    /// Name of the sensor.
    pub name: String,
    /// Where the map is from.
    pub sources: Vec<String>,
    /// I2C addresses, 7 bits; the first is usual.
    pub i2c: Vec<u8>,
    /// Bits of a register's address: 8 or 16.
    pub address_bits: u32,
    /// Bits of the register at an address: 8 or 16.
    pub register_bits: u32,
    /// Of registers of 16 bits: where the low byte is written and read that follows a high byte
    /// alone.
    pub low_byte_at: Option<u16>,
    /// Clock, line and frame length.
    pub timing: Timing,
    /// Exposure time.
    pub exposure: Exposure,
    /// Gain before the converter.
    pub analog_gain: Gain,
    /// Gain of the numbers.
    pub digital_gain: Option<Gain>,
    /// Size of the image that is read out.
    pub size: Option<Size>,
    /// When the sensor does what.
    pub state: State,
    /// Test patterns.
    pub test_pattern: Option<TestPattern>,
    /// Registers that cannot be written, by the address of the first: their values.
    pub identity: BTreeMap<String, Vec<u16>>,
    /// Registers at power-on and after a reset, by the address of the first; others are 0.
    pub reset: BTreeMap<String, Vec<u16>>,
    /// Readout modes, and the registers that select them.
    #[serde(default)]
    pub mode: Vec<Mode>,
}

/// A length: the sum of fields and a constant.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Length {
    /// The fields.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub fields: Vec<Field>,
    /// What is added to them.
    #[serde(default)]
    pub plus: u32,
    /// The sensor takes at least this.
    #[serde(default)]
    pub min: u32,
}

/// Clock, line and frame length.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Timing {
    /// Pixel clock, Hz, times the multiplier and divided by the divider.
    #[schemars(extend("unit" = "Hz"))]
    pub pixel_clock_hz: f64,
    /// Field of the multiplier.
    #[schemars(with = "Option<String>")]
    pub multiplier: Option<Field>,
    /// Multipliers by the value of that field; without them the value itself.
    #[serde(default)]
    pub multipliers: Vec<u32>,
    /// Field of the divider: it divides by its value plus 1.
    #[schemars(with = "Option<String>")]
    pub divider: Option<Field>,
    /// Line length, pixel clocks.
    pub line_length: Length,
    /// Frame length, lines.
    pub frame_length: Length,
    /// Frames until a frame length acts; the next frame is 1.
    #[schemars(range(min = 1, max = 4))]
    pub frame_length_delay: u32,
}

/// Exposure time.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Exposure {
    /// Its field.
    #[schemars(with = "String")]
    pub field: Field,
    /// Codes per line.
    #[serde(default = "one")]
    pub per_line: u32,
    /// Least exposure, codes.
    #[serde(default)]
    pub min: u32,
    /// Field of what is added, pixel clocks.
    #[schemars(with = "Option<String>")]
    pub fine: Option<Field>,
    /// Field of the power of two that exposure and frame length are multiplied by.
    #[schemars(with = "Option<String>")]
    pub shift: Option<Field>,
    /// The frame is longer than the exposure by so many lines at least.
    #[serde(default)]
    pub margin: u32,
    /// A longer exposure makes a longer frame; else it is cut.
    #[serde(default)]
    pub lengthens_frame: bool,
    /// Frames until it acts.
    #[schemars(range(min = 1, max = 4))]
    pub delay: u32,
}

/// A gain.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gain {
    /// Its field.
    #[schemars(with = "String")]
    pub field: Field,
    /// What its code means.
    pub law: Law,
    /// Least and greatest code that the sensor takes; others act as the nearest.
    pub codes: [u32; 2],
    /// Frames until it acts.
    #[schemars(range(min = 1, max = 4))]
    pub delay: u32,
}

/// What a gain's code c means.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    /// (m0 c + c0) / (m1 c + c1), as in MIPI CCS.
    Ratio {
        /// m0.
        m0: i32,
        /// c0.
        c0: i32,
        /// m1.
        m1: i32,
        /// c1.
        c1: i32,
    },
    /// Two for each bit that is set above the lowest four, times 1 + (c mod 16)/16 (OmniVision).
    Doublings {},
    /// By ⌊c/16⌋ a factor and a step; with f = c mod 16 rounded down to whole steps, factor/(1 -
    /// f/32) (onsemi).
    CoarseFine {
        /// Factors.
        factors: Vec<f64>,
        /// Steps of f.
        steps: Vec<u32>,
    },
}

/// Size of the image that is read out.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Size {
    /// Columns.
    #[schemars(with = "String")]
    pub width: Field,
    /// Rows.
    #[schemars(with = "String")]
    pub height: Field,
}

/// When the sensor does what: conditions such as `"0x0100[0] = 1"`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// It takes frames.
    #[schemars(with = "String")]
    pub streams: Condition,
    /// All registers get their values at power-on.
    #[schemars(with = "Option<String>")]
    pub resets: Option<Condition>,
    /// What is written waits, to act together.
    #[schemars(with = "Option<String>")]
    pub holds: Option<Condition>,
    /// What is written to other registers is lost.
    #[schemars(with = "Option<String>")]
    pub locked: Option<Condition>,
    /// Exposure and gain are the program's; else the sensor's own control sets them.
    #[schemars(with = "Option<String>")]
    pub manual: Option<Condition>,
    /// Columns from right to left.
    #[schemars(with = "Option<String>")]
    pub mirrored: Option<Condition>,
    /// Rows from the bottom up.
    #[schemars(with = "Option<String>")]
    pub flipped: Option<Condition>,
}

/// Test patterns.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TestPattern {
    /// Their field; 0 is none.
    #[schemars(with = "String")]
    pub field: Field,
    /// Their names, by the value of the field.
    pub names: BTreeMap<String, u32>,
}

/// A way to read out.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Mode {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Frames/s.
    #[schemars(extend("unit" = "frames/s"))]
    pub fps: f64,
    /// Registers that bring it about, by the address of the first.
    pub registers: BTreeMap<String, Vec<u16>>,
}

fn one() -> u32 {
    1
}

impl Profile {
    /// Names of the profiles that this crate has.
    pub fn names() -> impl Iterator<Item = &'static str> {
        BUILTIN.iter().map(|(name, _)| *name)
    }

    /// One of them.
    ///
    /// # Errors
    /// A name that is none of them.
    pub fn builtin(name: &str) -> Result<Self> {
        let found = BUILTIN.iter().find(|(known, _)| *known == name);
        let (_, text) = found.ok_or_else(|| {
            let known: Vec<&str> = Self::names().collect();
            Error::input(format!("no profile of a sensor {name:?}"))
                .help(format!("known are {}", known.join(", ")))
        })?;
        Self::parse(text)
    }

    /// Reads a profile.
    ///
    /// # Errors
    /// A file that cannot be read; unknown keys; fields that registers do not have.
    pub fn load(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io("read", path, e))?;
        Self::parse(&text).map_err(|e| e.at(path.display()))
    }

    /// Reads a profile from the text of a file.
    ///
    /// # Errors
    /// Unknown keys; fields that registers do not have.
    pub fn parse(text: &str) -> Result<Self> {
        let profile: Self = mistakes::read(text)?;
        if profile.format != FORMAT {
            return Err(Error::unsupported(format!("a profile in format {:?}", profile.format))
                .help(format!("this program reads format = {FORMAT:?}")));
        }
        profile.check()?;
        Ok(profile)
    }

    fn check(&self) -> Result<()> {
        let wrong = |what: String, help: &str| Err(Error::input(what).help(help));
        for (key, bits) in
            [("address_bits", self.address_bits), ("register_bits", self.register_bits)]
        {
            if ![8, 16].contains(&bits) {
                return wrong(format!("{key} = {bits}"), "registers have 8 or 16 bits");
            }
        }
        if self.i2c.is_empty() || self.i2c.iter().any(|address| *address > 0x7f) {
            return wrong(
                format!("i2c = {:?}", self.i2c),
                "addresses have 7 bits; give one or more",
            );
        }
        if let Some(field) = self.fields().find(|field| !field.fits(self.register_bits)) {
            let what = format!("{field:?} of registers of {} bits", self.register_bits);
            return wrong(what, "name bits that registers have, 32 in all at most");
        }
        for table in self.tables() {
            self.units(table)?;
        }
        let clock = self.timing.pixel_clock_hz;
        if !(clock > 0.0 && clock.is_finite()) {
            return wrong(format!("pixel_clock_hz = {clock}"), "use a frequency above zero");
        }
        if self.exposure.per_line == 0 {
            return wrong("per_line = 0".into(), "a line is one code or more");
        }
        [Some(&self.analog_gain), self.digital_gain.as_ref()]
            .into_iter()
            .flatten()
            .try_for_each(Gain::check)
    }

    fn tables(&self) -> impl Iterator<Item = &BTreeMap<String, Vec<u16>>> {
        [&self.identity, &self.reset].into_iter().chain(self.mode.iter().map(|m| &m.registers))
    }

    fn fields(&self) -> impl Iterator<Item = &Field> {
        let (timing, exposure, state) = (&self.timing, &self.exposure, &self.state);
        let lengths = timing.line_length.fields.iter().chain(&timing.frame_length.fields);
        let gains = [Some(&self.analog_gain), self.digital_gain.as_ref()].into_iter().flatten();
        let conditions = [&state.resets, &state.holds, &state.locked, &state.manual];
        let conditions = conditions.into_iter().chain([&state.mirrored, &state.flipped]).flatten();
        let size = self.size.iter().flat_map(|size| [&size.width, &size.height]);
        lengths
            .chain(
                [&timing.multiplier, &timing.divider, &exposure.fine, &exposure.shift]
                    .into_iter()
                    .flatten(),
            )
            .chain([&exposure.field])
            .chain(gains.map(|gain| &gain.field))
            .chain(conditions.chain([&state.streams]).map(Condition::field))
            .chain(size)
            .chain(self.test_pattern.iter().map(|pattern| &pattern.field))
    }

    /// Registers one by one of a table by the address of the first.
    fn units(&self, table: &BTreeMap<String, Vec<u16>>) -> Result<Memory> {
        let max = (1u32 << self.register_bits) - 1;
        let mut units = Memory::new();
        for (first, values) in table {
            let end = number(first).map(|first| first as usize + values.len());
            let fits = end.is_some_and(|end| end <= 1 << self.address_bits);
            if !fits || values.iter().any(|value| u32::from(*value) > max) {
                let what = format!("registers {first:?} = {values:?}");
                return Err(Error::input(what).help(format!(
                    "name the first by its address of {} bits, such as \"0x12\"; values have {} bits",
                    self.address_bits, self.register_bits
                )));
            }
            let first = number(first).unwrap_or(0) as u16; // within the address's bits
            units.extend(values.iter().enumerate().map(|(i, value)| (first + i as u16, *value)));
        }
        Ok(units)
    }

    /// Registers at power-on, and those that cannot be written.
    pub(crate) fn power_on(&self) -> (Memory, Memory) {
        // They were checked.
        let [identity, mut reset] =
            [&self.identity, &self.reset].map(|table| self.units(table).unwrap_or_default());
        reset.extend(identity.clone());
        (reset, identity)
    }

    /// Registers that bring a mode about.
    ///
    /// # Errors
    /// None of a profile that was read from a file.
    pub fn mode_registers(&self, mode: &Mode) -> Result<Memory> {
        self.units(&mode.registers)
    }

    /// Pixel clock, Hz.
    pub(crate) fn pixel_clock_hz(&self, memory: &Memory) -> f64 {
        let timing = &self.timing;
        let read = |field: &Option<Field>| {
            field.as_ref().map(|field| field.read(memory, self.register_bits))
        };
        let multiplier = read(&timing.multiplier).map_or(1, |value| {
            let listed = timing.multipliers.get(value as usize);
            listed.copied().unwrap_or(value).max(1)
        });
        let divider = read(&timing.divider).map_or(1.0, |value| f64::from(value) + 1.0);
        timing.pixel_clock_hz * f64::from(multiplier) / divider
    }

    /// A length in clocks or lines.
    pub(crate) fn length(&self, length: &Length, memory: &Memory) -> u64 {
        let fields = length.fields.iter().map(|f| u64::from(f.read(memory, self.register_bits)));
        (fields.sum::<u64>() + u64::from(length.plus)).max(length.min.into())
    }

    /// Whether a condition holds; false if there is none.
    pub(crate) fn is(&self, condition: &Option<Condition>, memory: &Memory) -> bool {
        condition.as_ref().is_some_and(|c| c.holds(memory, self.register_bits))
    }

    /// The factor of a gain.
    pub(crate) fn factor(&self, gain: &Gain, memory: &Memory) -> f64 {
        gain.factor(gain.field.read(memory, self.register_bits))
    }
}

/// Largest code of a gain.
const MAX_GAIN_CODE: u32 = 0xFFFF;

impl Gain {
    fn check(&self) -> Result<()> {
        let [least, most] = self.codes;
        let listed = match &self.law {
            Law::CoarseFine { factors, steps } => {
                factors.len() == steps.len()
                    && (most >> 4) < factors.len() as u32
                    && steps.iter().all(|step| *step > 0)
            }
            Law::Ratio { .. } | Law::Doublings {} => true,
        };
        let positive = |code| self.factor(code) > 0.0 && self.factor(code).is_finite();
        let few = most <= MAX_GAIN_CODE;
        if least <= most && listed && few && (least..=most).all(positive) {
            return Ok(());
        }
        Err(Error::input(format!("a gain {:?} of codes {least} to {most}", self.law)).help(
            "the least code comes first, the most is 65535 at most, and the law gives a gain \
                 above zero for all",
        ))
    }

    /// The factor that a code means.
    pub fn factor(&self, code: u32) -> f64 {
        let code = code.clamp(self.codes[0], self.codes[1]);
        match &self.law {
            Law::Ratio { m0, c0, m1, c1 } => {
                let [m0, c0, m1, c1] = [m0, c0, m1, c1].map(|v| f64::from(*v));
                let code = f64::from(code);
                (m0 * code + c0) / (m1 * code + c1)
            }
            Law::Doublings {} => {
                f64::from(1u32 << (code >> 4).count_ones()) * (1.0 + f64::from(code & 15) / 16.0)
            }
            Law::CoarseFine { factors, steps } => {
                let coarse = (code >> 4) as usize;
                let (Some(factor), Some(step)) = (factors.get(coarse), steps.get(coarse)) else {
                    return f64::NAN; // refused where profiles are read
                };
                factor / (1.0 - f64::from((code & 15) / step * step) / 32.0)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gain(profile: &str, code: u32) -> f64 {
        Profile::builtin(profile).unwrap().analog_gain.factor(code)
    }

    #[test]
    fn a_gain_is_above_zero_at_every_code_or_refused() {
        let built_in = BUILTIN.iter().find(|(name, _)| *name == "imx219").unwrap().1;
        let law = "{ m0 = 0, c0 = 256, m1 = -1, c1 = 256 }";
        let with = |law: &str, codes: &str| {
            let text = built_in
                .replacen("{ m0 = 0, c0 = 256, m1 = -1, c1 = 256 }", law, 1)
                .replacen("codes = [0, 232]", codes, 1);
            Profile::parse(&text)
        };
        assert!(with(law, "codes = [0, 232]").is_ok());
        // 0.5 and 2 at the ends, infinite in between.
        let between = "{ m0 = 1, c0 = -100, m1 = 1, c1 = -200 }";
        assert!(with(between, "codes = [0, 300]").is_err());
    }

    /// Values by hand from the laws in the data sheets and Linux' drivers.
    #[test]
    fn gains_follow_the_laws_of_their_sensors() {
        for (profile, code, expected) in [
            ("imx219", 0, 1.0),
            ("imx219", 232, 256.0 / 24.0),
            ("imx219", 255, 256.0 / 24.0), // beyond the greatest code
            ("imx477", 512, 2.0),
            ("imx477", 978, 1024.0 / 46.0),
            ("mt9v034", 16, 1.0),
            ("mt9v034", 40, 2.5),
            ("ov5647", 0x3F, 63.0 / 16.0),
            ("ov7670", 0b00_0001_1000, 2.0 * 1.5),
            ("ov7670", 0b01_1111_0000, 32.0),
            ("ccs", 640, 2.5),
            ("ar0144", 0x0D, 1.0 / (1.0 - 13.0 / 32.0)), // 1.684, the least recommended
            ("ar0144", 0x13, 2.0 / (1.0 - 1.0 / 16.0)),
            ("ar0144", 0x20, 4.0 * 1.153125),
            ("ar0144", 0x3F, 8.0 * 1.153125 / (1.0 - 7.0 / 16.0)),
            ("ar0144", 0x40, 16.0 * 1.153125),
            ("ar0234", 0x0D, 1.0 / (1.0 - 13.0 / 32.0)),
            ("ar0234", 0x17, 2.0 / (1.0 - 3.0 / 16.0)), // odd fine codes are those below
            ("ar0234", 0x2F, 4.0 / (1.0 - 15.0 / 32.0)),
            ("ar0234", 0x4F, 16.0 / (1.0 - 3.0 / 8.0)),
        ] {
            let found = gain(profile, code);
            assert!((found / expected - 1.0).abs() < 1e-12, "{profile} {code:#x}: {found}");
        }
    }

    #[test]
    fn mistakes_in_a_profile_are_named() {
        let (_, text) = BUILTIN.iter().find(|(name, _)| *name == "imx219").unwrap();
        let said = |from: &str, to: &str| {
            assert!(text.contains(from), "{from}");
            Profile::parse(&text.replacen(from, to, 1)).unwrap_err().to_string()
        };
        assert!(said("sensor-profile/1", "sensor-profile/9").contains("sensor-profile/1"));
        assert!(said("address_bits = 16", "address_bits = 12").contains("8 or 16"));
        assert!(said("\"0x0157\"", "\"0x0157[9]\"").contains("8 bits"));
        assert!(said("codes = [0, 232]", "codes = [0, 256]").contains("above zero"));
        assert!(said("delay = 2", "delay = 9").contains("delay"));
        assert!(said("[0x10]", "[0x80]").contains("7 bits"));
        assert!(Profile::builtin("imx999").unwrap_err().to_string().contains("imx219"));
    }
}
