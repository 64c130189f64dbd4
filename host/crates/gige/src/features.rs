//! The features in GenICam's XML (schema 1.1), under the names of its Standard Features Naming
//! Convention; faults, which it has none for, in a category of their own.
//!
//! The schema fixes the order of the elements of a node. What the device itself changes is not
//! cached.

use crate::camera::{Sensor, UNITY_GAIN_CODE};
use crate::memory::{bootstrap, feature};
use crate::pixel::PixelFormat;
use std::fmt::Write as _;

/// Limits of the packet size, bytes with all headers.
pub const PACKET_SIZES: std::ops::RangeInclusive<u32> = 576..=16_000;
/// Shortest heartbeat, ms.
pub const MIN_HEARTBEAT_MS: u32 = 500;
/// Steps of the region: no row of any packed format ends within a byte, and no colour moves.
pub const WIDTH_STEP: u32 = 4;
/// See [`WIDTH_STEP`].
pub const STEP: u32 = 2;
/// Values of `AcquisitionMode`.
pub const ACQUISITION_MODES: [(&str, u32); 3] =
    [("Continuous", 0), ("SingleFrame", 1), ("MultiFrame", 2)];
/// Values of `TestPattern`, codes of MIPI CCS.
pub const TEST_PATTERNS: [(&str, u32); 4] =
    [("Off", 0), ("Solid", 1), ("ColorBar", 2), ("PN9", 4)];
/// Values of `FaultNextFrame`.
pub const FAULTS: [(&str, u32); 5] =
    [("None", 0), ("Drop", 1), ("CorruptRow", 2), ("StuckCounter", 3), ("Late", 4)];
const OFF_ON: [(&str, u32); 2] = [("Off", 0), ("On", 1)];

/// A sensor's limits as features have them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Line time, µs.
    pub line_us: f64,
    /// Shortest frame, lines.
    pub min_frame_lines: u16,
}

impl Limits {
    /// Those of a sensor.
    pub fn of(sensor: &Sensor) -> Self {
        Self {
            line_us: f64::from(sensor.line_ns) * 1e-3,
            min_frame_lines: sensor.min_frame_lines.max(1),
        }
    }

    /// An exposure in µs as the nearest whole number of lines; `None` beyond 1 to 65535.
    pub fn exposure_lines(&self, exposure_us: f64) -> Option<u16> {
        whole(exposure_us / self.line_us, 1)
    }

    /// An exposure of whole lines, µs.
    pub fn exposure_us(&self, lines: u16) -> f64 {
        f64::from(lines) * self.line_us
    }

    /// A frame rate as the nearest frame length; `None` beyond the sensor's.
    pub fn frame_lines(&self, rate_hz: f64) -> Option<u16> {
        whole(1e6 / (rate_hz * self.line_us), self.min_frame_lines)
    }

    /// Frame rate of a frame length, Hz.
    pub fn frame_rate(&self, lines: u16) -> f64 {
        1e6 / self.exposure_us(lines)
    }
}

/// A gain in dB as the nearest code; `None` beyond 1 to 65535.
pub fn gain_code(gain_db: f64) -> Option<u16> {
    whole(f64::from(UNITY_GAIN_CODE) * libm::pow(10.0, gain_db / 20.0), 1)
}

/// Gain of a code, dB.
pub fn gain_db(code: u16) -> f64 {
    20.0 * libm::log10(f64::from(code) / f64::from(UNITY_GAIN_CODE))
}

fn whole(value: f64, least: u16) -> Option<u16> {
    let value = value.round();
    (f64::from(least)..=f64::from(u16::MAX)).contains(&value).then_some(value as u16)
}

/// How a feature is read and written.
enum Kind<'a> {
    /// A register, from a least value to a fixed one or one by a formula, in steps.
    Integer { min: u32, max: Max, step: u32 },
    /// Bits of a register; GenICam counts them from the highest.
    Bits { first: u32, last: u32, min: u32, max: u32 },
    /// A floating-point feature in a unit.
    Float { min: f64, max: f64, unit: &'a str },
    /// Names for values of a register.
    Names(Vec<(&'a str, u32)>),
    /// Writes a value into a register; into one bit of it if that is given.
    Command { value: u32, bit: Option<u32> },
    /// A text of so many bytes.
    Text(u32),
}

enum Max {
    Value(u32),
    /// What another feature leaves of the sensor's columns or rows, in whole steps. By its
    /// register: the features limit each other, and their nodes must not depend on each other.
    Rest {
        all: u32,
        of: &'static str,
    },
}

/// A feature in its category.
struct Feature<'a> {
    category: &'a str,
    name: &'a str,
    address: u32,
    about: &'a str,
    writable: bool,
    /// Not while streaming.
    locked: bool,
    kind: Kind<'a>,
}

fn feature<'a>(
    category: &'a str,
    name: &'a str,
    address: u32,
    about: &'a str,
    kind: Kind<'a>,
) -> Feature<'a> {
    Feature { category, name, address, about, writable: true, locked: false, kind }
}

impl Feature<'_> {
    fn read_only(self) -> Self {
        Self { writable: false, ..self }
    }

    fn locked(self) -> Self {
        Self { locked: true, ..self }
    }

    /// Writes the node and the register behind it.
    fn xml(&self, out: &mut String) {
        let Self { name, about, address, .. } = self;
        let locked = if self.locked { "<pIsLocked>TLParamsLocked</pIsLocked>" } else { "" };
        let head = format!("Name=\"{name}\" NameSpace=\"Standard\"><ToolTip>{about}</ToolTip>");
        let head = format!("{head}{locked}");
        let value = format!("<pValue>{name}Register</pValue>");
        let mut register = ("IntReg", 4, "<Sign>Unsigned</Sign>", String::new());
        let node = match &self.kind {
            Kind::Integer { min, max, step } => {
                let max = match max {
                    Max::Value(max) => format!("<Max>{max}</Max>"),
                    Max::Rest { all, of } => {
                        let _ = writeln!(
                            out,
                            "<IntSwissKnife Name=\"{name}Limit\"><pVariable Name=\"OTHER\">\
                             {of}Register</pVariable><Formula>({all} - OTHER) / {step} * {step}\
                             </Formula></IntSwissKnife>"
                        );
                        format!("<pMax>{name}Limit</pMax>")
                    }
                };
                format!("<Integer {head}{value}<Min>{min}</Min>{max}<Inc>{step}</Inc></Integer>")
            }
            Kind::Bits { first, last, min, max } => {
                register.0 = "MaskedIntReg";
                register.3 = format!("<LSB>{last}</LSB><MSB>{first}</MSB>");
                format!("<Integer {head}{value}<Min>{min}</Min><Max>{max}</Max></Integer>")
            }
            Kind::Float { min, max, unit } => {
                (register.0, register.1, register.2) = ("FloatReg", 8, "");
                let range = format!("<Min>{min}</Min><Max>{max}</Max>");
                format!("<Float {head}{value}{range}<Unit>{unit}</Unit></Float>")
            }
            Kind::Names(names) => {
                let entries: String = (names.iter())
                    .map(|(entry, value)| {
                        format!(
                            "<EnumEntry Name=\"{entry}\" NameSpace=\"Standard\"><Value>{value}\
                             </Value></EnumEntry>"
                        )
                    })
                    .collect();
                format!("<Enumeration {head}{entries}{value}</Enumeration>")
            }
            Kind::Command { value: number, bit } => {
                if let Some(bit) = bit {
                    (register.0, register.3) = ("MaskedIntReg", format!("<Bit>{bit}</Bit>"));
                }
                let number = format!("<CommandValue>{number}</CommandValue>");
                format!("<Command {head}{value}{number}</Command>")
            }
            Kind::Text(bytes) => {
                let access = if self.writable { "RW" } else { "RO" };
                let _ = writeln!(
                    out,
                    "<StringReg {head}<Address>0x{address:X}</Address><Length>{bytes}</Length>\
                     <AccessMode>{access}</AccessMode><pPort>Device</pPort>\
                     <Cachable>NoCache</Cachable></StringReg>"
                );
                return;
            }
        };
        let _ = writeln!(out, "{node}");
        let access = match (&self.kind, self.writable) {
            // What cannot be read back is done when it is written; a register that shares its bits
            // with others must be.
            (Kind::Command { bit: None, .. }, _) => "WO",
            (_, true) => "RW",
            (_, false) => "RO",
        };
        write_register(out, &format!("{name}Register"), *address, access, &register);
    }
}

/// Writes the node of a register: kind, bytes, sign and bits.
fn write_register(
    out: &mut String,
    name: &str,
    address: u32,
    access: &str,
    (kind, length, sign, bits): &(&str, u32, &str, String),
) {
    let _ = writeln!(
        out,
        "<{kind} Name=\"{name}\"><Address>0x{address:X}</Address><Length>{length}</Length>\
         <AccessMode>{access}</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>{bits}\
         {sign}<Endianess>BigEndian</Endianess></{kind}>"
    );
}

/// Features of the image.
fn image<'a>(sensor: &Sensor, formats: &'a [PixelFormat]) -> Vec<Feature<'a>> {
    const CATEGORY: &str = "ImageFormatControl";
    let integer = |min, max, step| Kind::Integer { min, max, step };
    let formats = formats.iter().map(|f| (f.name.as_str(), f.code)).collect();
    let part = |name, address, about, min, step, all, of| {
        feature(CATEGORY, name, address, about, integer(min, Max::Rest { all, of }, step)).locked()
    };
    let (columns, rows) = (sensor.width, sensor.height);
    vec![
        part("Width", feature::WIDTH, "Columns sent", WIDTH_STEP, WIDTH_STEP, columns, "OffsetX"),
        part("Height", feature::HEIGHT, "Rows sent", STEP, STEP, rows, "OffsetY"),
        part("OffsetX", feature::OFFSET_X, "First column", 0, STEP, columns, "Width"),
        part("OffsetY", feature::OFFSET_Y, "First row", 0, STEP, rows, "Height"),
        feature(
            CATEGORY,
            "PixelFormat",
            feature::PIXEL_FORMAT,
            "Layout of the pixels; other depths than the sensor's are at full scale",
            Kind::Names(formats),
        )
        .locked(),
        feature(
            CATEGORY,
            "TestPattern",
            feature::TEST_PATTERN,
            "Samples from the sensor's generator in place of the picture",
            Kind::Names(TEST_PATTERNS.to_vec()),
        ),
        feature(
            CATEGORY,
            "TestPatternValue",
            feature::TEST_VALUE,
            "DN of the solid test pattern",
            integer(0, Max::Value((1 << sensor.bits.min(16)) - 1), 1),
        ),
    ]
}

/// Features of exposure and triggers.
fn acquisition(limits: Limits) -> Vec<Feature<'static>> {
    const CATEGORY: &str = "AcquisitionControl";
    let names = |names: &[(&'static str, u32)]| Kind::Names(names.to_vec());
    let command = |value| Kind::Command { value, bit: None };
    let float = |min, max, unit| Kind::Float { min, max, unit };
    let of = |name, address, about, kind| feature(CATEGORY, name, address, about, kind);
    let exposures = [1, u16::MAX].map(|lines| limits.exposure_us(lines));
    let rates = [u16::MAX, limits.min_frame_lines].map(|lines| limits.frame_rate(lines));
    vec![
        of(
            "AcquisitionMode",
            feature::ACQUISITION_MODE,
            "How many frames an acquisition has",
            names(&ACQUISITION_MODES),
        ),
        of("AcquisitionStart", feature::ACQUISITION, "Begins an acquisition", command(1)),
        of("AcquisitionStop", feature::ACQUISITION, "Ends it", command(0)),
        of(
            "AcquisitionFrameCount",
            feature::ACQUISITION_FRAMES,
            "Frames of an acquisition of MultiFrame",
            Kind::Integer { min: 1, max: Max::Value(0xffff), step: 1 },
        ),
        of(
            "AcquisitionFrameRate",
            feature::FRAME_RATE,
            "Frames in a second, in whole lines; a longer exposure lowers it",
            float(rates[0], rates[1], "Hz"),
        ),
        of(
            "ExposureTime",
            feature::EXPOSURE_US,
            "In whole lines; acts with the sensor's delay while it streams",
            float(exposures[0], exposures[1], "us"),
        ),
        of(
            "TriggerSelector",
            feature::TRIGGER_SELECTOR,
            "What a trigger begins",
            names(&[("FrameStart", 0)]),
        ),
        of("TriggerMode", feature::TRIGGER_MODE, "Whether frames wait for it", names(&OFF_ON)),
        of(
            "TriggerSource",
            feature::TRIGGER_SOURCE,
            "Where it comes from",
            names(&[("Software", 0)]),
        ),
        of("TriggerSoftware", feature::TRIGGER_SOFTWARE, "Triggers a frame", command(1)),
        feature(
            "AnalogControl",
            "Gain",
            feature::GAIN_DB,
            "Analog gain, in steps of 1/256; acts with the sensor's delay while it streams",
            float(gain_db(1), gain_db(u16::MAX), "dB"),
        ),
    ]
}

/// Features of the link and the device.
fn link() -> Vec<Feature<'static>> {
    const CATEGORY: &str = "TransportLayerControl";
    let integer = |min, max| Kind::Integer { min, max: Max::Value(max), step: 1 };
    let of = |name, address, about, kind| feature(CATEGORY, name, address, about, kind);
    let text = |name, address, about, bytes| {
        feature("DeviceControl", name, address, about, Kind::Text(bytes)).read_only()
    };
    let (min, max) = (*PACKET_SIZES.start(), *PACKET_SIZES.end());
    vec![
        text("DeviceVendorName", bootstrap::VENDOR, "Maker", 32),
        text("DeviceModelName", bootstrap::MODEL, "Model", 32),
        text("DeviceVersion", bootstrap::DEVICE_VERSION, "Version", 32),
        text("DeviceSerialNumber", bootstrap::SERIAL, "Serial number", 16),
        of("PayloadSize", feature::PAYLOAD_BYTES, "Bytes of an image", integer(0, u32::MAX))
            .read_only(),
        of("TLParamsLocked", feature::LOCKED, "1 while streaming", integer(0, 1)),
        of(
            "GevSCPSPacketSize",
            bootstrap::PACKET_SIZE,
            "Bytes of a packet with all headers",
            Kind::Bits { first: 16, last: 31, min, max },
        )
        .locked(),
        of(
            "GevSCPSFireTestPacket",
            bootstrap::PACKET_SIZE,
            "Sends one packet of this size",
            Kind::Command { value: 1, bit: Some(0) },
        ),
        of("GevSCPD", bootstrap::PACKET_DELAY, "Delay between packets, ns", integer(0, u32::MAX)),
        of(
            "GevHeartbeatTimeout",
            bootstrap::HEARTBEAT_MS,
            "Longest silence of the application in control, ms",
            integer(MIN_HEARTBEAT_MS, u32::MAX),
        ),
    ]
}

/// Features of what goes wrong on request.
fn faults() -> Vec<Feature<'static>> {
    const CATEGORY: &str = "FaultControl";
    let integer = || Kind::Integer { min: 0, max: Max::Value(0xffff), step: 1 };
    let of = |name, address, about, kind| feature(CATEGORY, name, address, about, kind);
    vec![
        of(
            "FaultNextFrame",
            feature::FAULT,
            "Fault of the next frame; a stuck counter lasts until None",
            Kind::Names(FAULTS.to_vec()),
        ),
        of(
            "FaultArgument",
            feature::FAULT_ARGUMENT,
            "The corrupt row, or the delay in ms",
            integer(),
        ),
        of(
            "FaultPacketLoss",
            feature::PACKET_LOSS,
            "Packets of the stream that are not sent, at random",
            Kind::Float { min: 0.0, max: 100.0, unit: "%" },
        ),
        of(
            "FrameNumber",
            feature::FRAME_NUMBER,
            "Number of the newest frame, from 0",
            Kind::Integer { min: 0, max: Max::Value(u32::MAX), step: 1 },
        )
        .read_only(),
        of("FrameCounter", feature::FRAME_COUNTER, "The sensor's frame counter", integer())
            .read_only(),
    ]
}

/// The XML of a sensor with these pixel formats.
pub fn xml(sensor: &Sensor, formats: &[PixelFormat]) -> String {
    let all: Vec<Feature<'_>> =
        [link(), image(sensor, formats), acquisition(Limits::of(sensor)), faults()]
            .into_iter()
            .flatten()
            .collect();
    let mut categories: Vec<&str> = Vec::new();
    for feature in &all {
        if !categories.contains(&feature.category) {
            categories.push(feature.category);
        }
    }
    let list = |names: &mut dyn Iterator<Item = &str>| -> String {
        names.map(|name| format!("<pFeature>{name}</pFeature>")).collect()
    };
    let mut out = format!(
        "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<RegisterDescription ModelName=\"rig\" \
         VendorName=\"camrig\" ToolTip=\"A simulated camera\" StandardNameSpace=\"GEV\" \
         SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\" \
         MajorVersion=\"1\" MinorVersion=\"0\" SubMinorVersion=\"0\" \
         ProductGuid=\"8a5ee79c-3d0e-4f0c-9e43-7a1b51d1b001\" \
         VersionGuid=\"8a5ee79c-3d0e-4f0c-9e43-7a1b51d1b002\" \
         xmlns=\"http://www.genicam.org/GenApi/Version_1_1\">\n<Category Name=\"Root\" \
         NameSpace=\"Standard\">{}</Category>\n",
        list(&mut categories.iter().copied())
    );
    for category in categories {
        let mut names: Vec<&str> =
            all.iter().filter(|f| f.category == category).map(|f| f.name).collect();
        if category == "ImageFormatControl" {
            names.extend(["SensorWidth", "SensorHeight"]);
        }
        let names = list(&mut names.into_iter());
        let _ = writeln!(
            out,
            "<Category Name=\"{category}\" NameSpace=\"Standard\">{names}</Category>"
        );
    }
    for (name, value) in [("SensorWidth", sensor.width), ("SensorHeight", sensor.height)] {
        let _ = writeln!(
            out,
            "<Integer Name=\"{name}\" NameSpace=\"Standard\"><Value>{value}</Value></Integer>"
        );
    }
    all.iter().for_each(|feature| feature.xml(&mut out));
    out + "<Port Name=\"Device\" NameSpace=\"Standard\"></Port>\n</RegisterDescription>\n"
}
