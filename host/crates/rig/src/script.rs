//! Scripts of a control loop: which registers are written when, in a stream of frames.
//!
//! ```toml
//! format = "rig-script/1"
//!
//! [[write]]
//! before_frame = 0            # counted from the first frame of the stream
//! exposure_s = 0.010
//! analog_gain = 1.0
//!
//! [[write]]
//! before_frame = 5
//! registers = { "0x0202" = 800, "0x0204" = 512 }
//! ```
//!
//! What is written before frame n shows with frame n only at the start of a stream: while it runs
//! a write takes effect with the delay of the rig's sensor, see the rig's registers.

use super::Rig;
use super::client::whole_lines;
use camrig_base::{Error, Result, mistakes};
use camrig_rig_link::registers::UNITY_GAIN_CODE;
use camrig_rig_link::registers::address::{
    ANALOG_GAIN, COARSE_INTEGRATION_TIME, FRAME_LENGTH_LINES, LINE_LENGTH_NS,
};
use schemars::{JsonSchema, Schema, schema_for};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Which registers are written when, in a stream of frames.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct File {
    /// `"rig-script/1"`.
    format: String,
    /// The writes, in the order of their frames.
    write: Vec<Entry>,
}

/// What is written before a frame.
#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Entry {
    /// The frame, counted from the first of the stream, which is 0. While frames run a write
    /// takes effect with the delay of the rig's sensor.
    before_frame: u32,
    /// Exposure time, s, rounded to the rig's lines. One longer than the frame lengthens the frame.
    exposure_s: Option<f64>,
    /// Gain before the converter.
    analog_gain: Option<f64>,
    /// Registers by address, such as `{ "0x0202" = 800 }`.
    #[serde(default)]
    registers: BTreeMap<String, u32>,
}

/// The JSON schema of a script.
pub fn schema() -> Schema {
    schema_for!(File)
}

/// Register writes in the order of their frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Script {
    writes: Vec<(u32, Write)>,
}

/// One write.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Write {
    /// Exposure, s: turned into lines by the rig's line time. One that is longer than the frame
    /// lengthens the frame, as drivers do.
    Exposure(f64),
    /// Analog gain: turned into the gain code.
    Gain(f64),
    /// A register by its address.
    Register(u16, u32),
}

impl Script {
    /// Reads a script.
    ///
    /// # Errors
    /// Unknown keys, values that no register takes, writes that go back in time.
    pub fn load(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io("read", path, e))?;
        Self::parse(&text).map_err(|e| e.at(path.display()))
    }

    fn parse(text: &str) -> Result<Self> {
        let file: File = mistakes::read(text)?;
        if file.format != "rig-script/1" {
            return Err(Error::unsupported(format!("script format {:?}", file.format))
                .help("this program reads format = \"rig-script/1\""));
        }
        let mut writes: Vec<(u32, Write)> = Vec::new();
        for entry in &file.write {
            let frame = entry.before_frame;
            if writes.last().is_some_and(|(last, _)| *last > frame) {
                return Err(Error::input(format!(
                    "before_frame = {frame} comes after a later one"
                ))
                .help("list [[write]] tables in the order of their frames"));
            }
            let positive = |name: &str, v: f64| match v > 0.0 && v.is_finite() {
                true => Ok(v),
                false => Err(Error::input(format!("{name} = {v}")).help("use values above zero")),
            };
            if let Some(s) = entry.exposure_s {
                writes.push((frame, Write::Exposure(positive("exposure_s", s)?)));
            }
            if let Some(g) = entry.analog_gain {
                writes.push((frame, Write::Gain(positive("analog_gain", g)?)));
            }
            for (name, &value) in &entry.registers {
                let address =
                    name.strip_prefix("0x").and_then(|h| u16::from_str_radix(h, 16).ok());
                let address = address.or_else(|| name.parse().ok()).ok_or_else(|| {
                    Error::input(format!("register {name:?}"))
                        .help("name registers by their address, for instance \"0x0202\"")
                })?;
                writes.push((frame, Write::Register(address, value)));
            }
        }
        Ok(Self { writes })
    }

    /// What is written before a frame.
    pub fn before(&self, frame: u32) -> impl Iterator<Item = Write> + '_ {
        self.writes.iter().filter(move |(at, _)| *at == frame).map(|(_, write)| *write)
    }
}

impl Write {
    /// Writes to a rig.
    ///
    /// # Errors
    /// A value that the register does not take, with its limit.
    pub fn apply(self, rig: &mut Rig) -> Result<()> {
        match self {
            Self::Register(address, value) => rig.write_register(address, value),
            Self::Gain(gain) => rig.write_register(ANALOG_GAIN, gain_code(gain)?),
            Self::Exposure(exposure_s) => {
                let lines = lines(exposure_s, rig.read_register(LINE_LENGTH_NS)?)?;
                let frame = rig.register_if_there(FRAME_LENGTH_LINES)?;
                if frame.is_some_and(|frame| frame < lines) {
                    rig.write_register(FRAME_LENGTH_LINES, lines)?;
                }
                rig.write_register(COARSE_INTEGRATION_TIME, lines)
            }
        }
    }
}

/// Largest value of the rig's exposure, gain and frame length registers, which have 16 bits.
const MOST: u32 = 0xffff;

/// An exposure (s) in lines of a line time (ns).
fn lines(exposure_s: f64, line_ns: u32) -> Result<u32> {
    if let Some(lines) = whole_lines(exposure_s, line_ns) {
        return Ok(lines.into());
    }
    let shortest = f64::from(line_ns) * 1e-9;
    let longest = f64::from(MOST) * shortest;
    let limit = if exposure_s < shortest {
        format!("the shortest is one line, {shortest:.9} s")
    } else {
        format!("the longest is {MOST} lines of {shortest:.9} s, {longest:.6} s")
    };
    Err(Error::limit(format!("an exposure of {exposure_s} s is beyond the rig's limit: {limit}"))
        .help("stay within it, or write another line time to register 0x3000"))
}

/// The code of a gain.
fn gain_code(gain: f64) -> Result<u32> {
    let unity = f64::from(UNITY_GAIN_CODE);
    let code = (gain * unity).round();
    if (1.0..=f64::from(MOST)).contains(&code) {
        return Ok(code as u32);
    }
    let (least, most) = (1.0 / unity, f64::from(MOST) / unity);
    let what = format!("a gain of {gain} is beyond the rig's limits, {least:.4} to {most:.3}");
    Err(Error::limit(what).help("stay within them"))
}

/// What the frame length does to the exposure as last written, where it cuts it.
///
/// # Errors
/// A link that fails.
pub fn exposure_cut(rig: &mut Rig) -> Result<Option<String>> {
    let lines = rig.register_if_there(COARSE_INTEGRATION_TIME)?;
    let frame = rig.register_if_there(FRAME_LENGTH_LINES)?;
    Ok(lines.zip(frame).filter(|(lines, frame)| lines > frame).map(|(lines, frame)| {
        format!(
            "the exposure of {lines} lines is cut to the frame length of {frame} lines \
             (register {FRAME_LENGTH_LINES:#06x})"
        )
    }))
}

/// Exposure and gain that the registers hold, in words; `None` of a rig without them.
///
/// # Errors
/// A link that fails.
pub fn settings_held(rig: &mut Rig) -> Result<Option<String>> {
    let mut held = [0; 3];
    for (value, at) in held.iter_mut().zip([COARSE_INTEGRATION_TIME, LINE_LENGTH_NS, ANALOG_GAIN])
    {
        match rig.register_if_there(at)? {
            Some(there) => *value = u64::from(there),
            None => return Ok(None),
        }
    }
    let [lines, line_ns, code] = held;
    let exposure_ms = (lines * line_ns) as f64 / 1e6;
    let gain = code as f64 / f64::from(UNITY_GAIN_CODE);
    Ok(Some(format!("{exposure_ms} ms ({lines} lines of {line_ns} ns) at gain {gain}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn writes_come_at_their_frames() {
        let script = Script::parse(
            "format = 'rig-script/1'\n[[write]]\nbefore_frame = 0\nexposure_s = 0.01\n\
             [[write]]\nbefore_frame = 5\nanalog_gain = 2\nregisters = { '0x0202' = 800 }\n",
        )
        .unwrap();
        assert_eq!(script.before(0).collect::<Vec<_>>(), [Write::Exposure(0.01)]);
        assert_eq!(script.before(1).count(), 0);
        let fifth = [Write::Gain(2.0), Write::Register(0x0202, 800)];
        assert_eq!(script.before(5).collect::<Vec<_>>(), fifth);
    }

    /// The emulator's line time is 10 µs, its frame 2000 lines.
    #[test]
    fn an_exposure_longer_than_the_frame_lengthens_the_frame() {
        let mut rig = Rig::open("emulator:").unwrap();
        Write::Exposure(0.015).apply(&mut rig).unwrap();
        let read = |rig: &mut Rig| {
            [COARSE_INTEGRATION_TIME, FRAME_LENGTH_LINES].map(|a| rig.read_register(a).unwrap())
        };
        assert_eq!(read(&mut rig), [1500, 2000]);
        Write::Exposure(0.03).apply(&mut rig).unwrap();
        assert_eq!(read(&mut rig), [3000, 3000]);
        assert_eq!(exposure_cut(&mut rig).unwrap(), None);
        rig.write_register(FRAME_LENGTH_LINES, 2500).unwrap();
        let said = exposure_cut(&mut rig).unwrap().unwrap();
        assert!(said.contains("3000 lines is cut") && said.contains("2500 lines"), "{said}");
        let held = settings_held(&mut rig).unwrap().unwrap();
        assert_eq!(held, "30 ms (3000 lines of 10000 ns) at gain 1");
    }

    #[test]
    fn what_no_register_takes_is_refused_with_the_limit() {
        let said = |e: Error| e.to_string();
        assert_eq!(lines(0.02, 10_000).unwrap(), 2000);
        assert!(said(lines(0.7, 10_000).unwrap_err()).contains("0.655350 s"));
        assert!(said(lines(4e-6, 10_000).unwrap_err()).contains("one line"));
        assert_eq!(gain_code(2.5).unwrap(), 640);
        assert!(said(gain_code(300.0).unwrap_err()).contains("255.996"));
        assert!(said(gain_code(1e-4).unwrap_err()).contains("0.0039"));
    }

    #[test]
    fn wrong_scripts_are_refused() {
        let said = |body: &str| {
            let text = format!("format = 'rig-script/1'\n[[write]]\n{body}");
            Script::parse(&text).unwrap_err().to_string()
        };
        assert!(said("before_frame = 1\nexposure_s = -1").contains("above zero"));
        assert!(said("before_frame = 1\nexposure = 1").contains("exposure_s"));
        assert!(said("before_frame = 1\nregisters = { x = 1 }").contains("0x0202"));
        let back =
            "before_frame = 3\nanalog_gain = 1\n[[write]]\nbefore_frame = 1\nanalog_gain = 1";
        assert!(said(back).contains("order"));
    }
}
