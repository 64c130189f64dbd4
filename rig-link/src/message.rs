//! Control messages, in the encoding of the `postcard` crate, and what they carry.
//!
//! Enums only grow at their ends: the number of a variant on the link is its position. A message
//! that this version does not know is answered with [`Nack::Unsupported`] and otherwise ignored.
//! Structs have the fields of the protocol's version and gain none.
//!
//! # Error codes
//! A device refuses with a [`Nack`]; its [`code`](Nack::code) names it for programs:
//! `no-session`, `no-transfer`, `unsupported`, `register`, or that of a [`Refusal`]: `no-camera`,
//! `bad-camera`, `camera-too-long`, `effects`, `too-wide`, `too-many-bands`, `wrong-shape`,
//! `arithmetic`, `codec`, `packing`, `exposure`, `captures`.

pub use crate::effect_set::EffectSet;
use core::fmt;
use heapless::String;
use serde::{Deserialize, Serialize};

/// Versions of the protocol that this crate speaks, oldest and newest.
pub const VERSIONS: (u8, u8) = (1, 2);

/// First bytes of every Hello.
pub const MAGIC: [u8; 6] = *b"camrig";

/// Longest control message, bytes (a test encodes the largest).
pub const CONTROL_BYTES: usize = 160;

/// Bytes of a row's receipt, where raw rows stay with the device: the CRC-32C of the packed row
/// that left by its own interface, little-endian.
pub const RECEIPT_BYTES: usize = 4;

/// The host's first message: opens a session and ends any other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hello {
    /// [`MAGIC`].
    pub magic: [u8; 6],
    /// Oldest version that the host speaks.
    pub oldest: u8,
    /// Newest version that the host speaks.
    pub newest: u8,
    /// Longest packet that the host accepts, bytes.
    pub packet_bytes: u16,
    /// Packets that the device may send beyond the newest that the host has acknowledged.
    pub credit: u16,
}

/// The device's answer to [`Hello`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HelloReply {
    /// The version that both use from now on; 0 if there is none.
    pub version: u8,
    /// Oldest version that the device speaks.
    pub oldest: u8,
    /// Newest version that the device speaks.
    pub newest: u8,
    /// What the device can do; `None` if there is no common version.
    pub device: Option<Capabilities>,
}

impl HelloReply {
    /// Whether a host can use it: a version of both ends, and limits within which packets fit; or
    /// none of these, where there is no version of both ends.
    pub(crate) fn is_sound(&self) -> bool {
        let both = self.oldest.max(VERSIONS.0)..=self.newest.min(VERSIONS.1);
        match &self.device {
            None => both.is_empty() && self.version == 0,
            Some(device) => {
                let fits = usize::from(device.packet_bytes) >= MIN_PACKET_BYTES;
                both.contains(&self.version) && fits && device.credit > 0
            }
        }
    }
}

/// Least limit of a device's packets, bytes: an announcement of a frame has to fit.
const MIN_PACKET_BYTES: usize = 64;

/// What a device can do.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Capabilities {
    /// Name and version of the firmware.
    pub firmware: String<40>,
    /// Longest packet that the device accepts, bytes.
    pub packet_bytes: u16,
    /// Packets that the host may send beyond the newest that the device has acknowledged.
    pub credit: u16,
    /// Longest row, pixels.
    pub max_width: u16,
    /// Largest number of spectral bands.
    pub max_bands: u16,
    /// Longest camera ([`ToHost::Camera`]), bytes.
    pub max_camera: u32,
    /// Arithmetics that the device has, as a bit set of `1 <<` [`NumberFormat`].
    pub arithmetics: u8,
    /// Row codecs that the device reads, as a bit set of `1 <<` [`Codec`], whether it reads groups of
    /// high dynamic range in them ([`WIDE_GROUPS`]), and light of several captures
    /// ([`SEVERAL_CAPTURES`]).
    pub codecs: u8,
    /// Memory of the device's rows and buffers, bytes.
    pub memory_bytes: u32,
    /// Effects of the sensor model that the firmware has.
    pub effects: EffectSet,
    /// Identity of the camera that the device holds; 0 for none.
    pub camera: u64,
}

/// Bit of [`Capabilities::codecs`] of a device that reads units whose exponent is 112 to 127, as
/// groups of high dynamic range have it.
pub const WIDE_GROUPS: u8 = 1 << 7;

/// Bit of [`Capabilities::codecs`] of a device that takes cameras which read each pixel several
/// times, merges and compands them (version 2).
pub const SEVERAL_CAPTURES: u8 = 1 << 6;

/// Number format of the device's sensor model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum NumberFormat {
    /// IEEE 754 single precision.
    F32,
    /// Fixed point.
    Fixed,
}

/// How a spectral row is encoded: units of 16 pixels with a shared exponent byte and 16 mantissas
/// of 16 bits, 2.06 bytes per sample. The rounding error is at most 2⁻¹⁷ of the largest of the 16;
/// where a value is below 2⁻¹² of the largest, mantissas are floating-point numbers, and each is
/// right to 2⁻¹² ([`WIDE_GROUPS`]).
/// On a scene of high dynamic range that is at worst 0.012 of a pixel's own noise; 12-bit
/// mantissas would save a quarter of the bytes and make it 0.18.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Codec {
    /// Irradiance, W m⁻² nm⁻¹: the units of one band after those of the other.
    Bfp16,
    /// Mean photo-electrons per second of exposure, e⁻/s, summed over the bands by the host: the
    /// units of one band.
    Electrons16,
}

/// Announces a frame; its spectral rows follow.
///
/// There is no message to resume a frame: raw rows depend only on the camera, this message and the
/// light of the rows, so the host announces the frame again and sends the rows that it still
/// needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameBegin {
    /// The host's number for this announcement, new each time.
    pub transfer: u16,
    /// Frame number: with the camera's seed it determines the temporal noise.
    pub frame: u32,
    /// Rows of the frame.
    pub rows: u16,
    /// Pixels per row.
    pub width: u16,
    /// Spectral bands; of a camera of several captures whose light differs, so many for each.
    pub bands: u16,
    /// How the spectral rows are encoded.
    pub codec: Codec,
    /// Which arithmetic computes the raw rows.
    pub arithmetic: NumberFormat,
    /// Bits per sample of the raw rows, packed by [`crate::packing::Packing::of_bits`]; samples of 20
    /// and 24 bits in two halves, the upper one first. 0: the rows leave by the device's own
    /// interface, packed as that has them, and a raw row on the link is its receipt
    /// ([`RECEIPT_BYTES`]). A device without such an interface refuses it.
    pub raw_bits: u8,
    /// Sensor temperature, degrees Celsius.
    pub temperature_c: f32,
    /// What the sensor saw in the previous frame, for effects such as image lag.
    pub before: Before,
    /// Exposure and gain; `None`: those of the device's registers.
    pub exposure: Option<Exposure>,
}

/// What a sensor saw in the previous frame. [`Self::Dark`] and [`Self::Lit`] are the bytes of the
/// `bool` that was here in older versions, whose devices take no other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Before {
    /// No light.
    Dark,
    /// The light of this frame, for the exposure of this frame.
    Lit,
    /// The light of this frame, for another exposure.
    LitFor {
        /// Exposure time of the previous frame, s.
        exposure_s: f32,
    },
}

/// Exposure time and gain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Exposure {
    /// Exposure time, s.
    pub exposure_s: f32,
    /// Analogue gain, 1 = unity.
    pub analog_gain: f32,
}

impl fmt::Display for Exposure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} s at gain {}", self.exposure_s, self.analog_gain)
    }
}

/// Sizes of a frame on the link, which the device's model confirms after [`FrameBegin`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrameShape {
    /// Rows of the frame.
    pub rows: u16,
    /// Units of a spectral row ([`Codec`]).
    pub units: u16,
    /// Bytes of a unit.
    pub unit_bytes: u16,
    /// Bytes of a packed raw row.
    pub raw_bytes: u16,
    /// Rows above and below that a raw row depends on.
    pub halo: u8,
}

impl FrameShape {
    /// Whether no size is zero and none is beyond the protocol's limits.
    pub fn is_sound(&self) -> bool {
        self.rows > 0
            && self.units > 0
            && self.unit_bytes > 0
            && (1..u16::MAX).contains(&self.raw_bytes)
    }
}

/// The device has begun a frame: what a sensor writes into its embedded data line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameStart {
    /// Echo of [`FrameBegin::transfer`].
    pub transfer: u16,
    /// The sizes on the link.
    pub shape: FrameShape,
    /// The exposure in force.
    pub exposure: Exposure,
    /// The sensor's frame counter.
    pub counter: u16,
    /// Frame number of the temporal noise.
    pub frame: u32,
    /// The camera's seed.
    pub seed: u64,
    /// Test pattern in force (register `test_pattern`).
    pub test_pattern: u16,
    /// Fault requested by the fault register.
    pub fault: Fault,
}

/// A fault that the device was asked to simulate, to test the error handling of an image signal
/// processor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Fault {
    /// None.
    #[default]
    None,
    /// The frame is never delivered.
    DropFrame,
    /// This row is delivered with all its bits inverted.
    CorruptRow(u16),
    /// The frame counter stands still.
    StuckCounter,
    /// The frame is delivered this much later, ms: the host, which has the clock, delays it.
    LateFrame(u16),
}

/// From host to device.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum ToDevice {
    /// Begin a frame.
    FrameBegin(FrameBegin),
    /// Abandon the frame in progress.
    Abort,
    /// Read a register.
    RegRead(u16),
    /// Write a register.
    RegWrite(u16, u32),
    /// Send [`Statistics`].
    Statistics,
    /// Read the byte at an address, high byte of a register first.
    ByteRead(u16),
    /// Write the byte at an address.
    ByteWrite(u16, u8),
}

/// From device to host.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum ToHost {
    /// A frame has begun.
    FrameStart(FrameStart),
    /// The frame in progress was abandoned.
    Aborted,
    /// Value of a register, or of the byte at an address, after a read or a write.
    Register(u16, u32),
    /// Counters since power-on.
    Statistics(Statistics),
    /// How much of a camera has arrived.
    Camera {
        /// Which camera.
        id: u64,
        /// Bytes received without a gap from the beginning.
        received: u32,
        /// Whether it is complete, checked and in force.
        ready: bool,
    },
    /// The device refuses.
    Nack(Nack),
}

/// Why the device refuses a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Nack {
    /// It knows no such session: it was switched off and on, or another host has connected.
    NoSession,
    /// It has no such transfer in progress.
    NoTransfer(u16),
    /// It does not know this kind of message.
    Unsupported(u8),
    /// It has no register at this address, or the register does not take this value.
    Register(u16),
    /// Its model cannot do what was asked.
    Refused(Refusal),
}

/// What a device's model cannot do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Refusal {
    /// The device has no camera yet.
    NoCamera,
    /// The camera's bytes do not decode, a value is out of range, the effects are out of order, or
    /// the firmware lacks one of them.
    BadCamera,
    /// The camera has more bytes than there is memory for.
    CameraTooLong {
        /// Largest number of bytes.
        max: u32,
    },
    /// The camera's effects need more neighbouring rows than there is memory for.
    Effects,
    /// Rows are longer than there is memory for.
    TooWide {
        /// Longest row, pixels.
        max: u16,
    },
    /// The frame has more bands than there is memory for.
    TooManyBands {
        /// Largest number of bands.
        max: u16,
    },
    /// The frame's size or bands are not the camera's.
    WrongShape,
    /// The device does not have this arithmetic.
    Arithmetic,
    /// The device does not read this row codec.
    Codec,
    /// The packing does not exist, or has fewer bits per sample than the camera; or 0 bits, and
    /// the device has no interface of its own.
    Packing,
    /// Exposure time or gain is not a positive finite number.
    Exposure,
    /// The camera has more captures than there is memory for.
    Captures {
        /// Largest number of captures.
        max: u8,
    },
}

impl fmt::Display for Nack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSession => f.write_str(
                "the device knows no such session: it was switched off and on, or another host \
                 has connected; connect again",
            ),
            Self::NoTransfer(transfer) => write!(
                f,
                "the device has no transfer {transfer} in progress: announce the frame again"
            ),
            Self::Unsupported(kind) => write!(
                f,
                "the device does not know packet kind {kind} or the message in it: update its \
                 firmware"
            ),
            Self::Register(address) => write!(
                f,
                "register {address:#06x} does not exist, is read-only, or does not take this \
                 value: see registers::address"
            ),
            Self::Refused(refusal) => refusal.fmt(f),
        }
    }
}

impl core::error::Error for Nack {}

impl Nack {
    /// A name for programs, which does not change when the text does.
    pub const fn code(&self) -> &'static str {
        match self {
            Self::NoSession => "no-session",
            Self::NoTransfer(_) => "no-transfer",
            Self::Unsupported(_) => "unsupported",
            Self::Register(_) => "register",
            Self::Refused(refusal) => refusal.code(),
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoCamera => f.write_str("the device has no camera: send one before a frame"),
            Self::BadCamera => f.write_str(
                "the device cannot use the camera: its bytes do not decode, a value is out of \
                 range, its effects are out of order, or the firmware lacks one of them; compare \
                 them with Capabilities::effects",
            ),
            Self::CameraTooLong { max } => write!(
                f,
                "the camera is longer than the {max} bytes that the device has room for: use a \
                 coarser crosstalk table"
            ),
            Self::Effects => f.write_str(
                "the camera's effects read more neighbouring rows than the device has memory for: \
                 leave out some of them",
            ),
            Self::TooWide { max } => write!(
                f,
                "rows are longer than the {max} pixels that the device has memory for: use a \
                 camera with fewer columns"
            ),
            Self::TooManyBands { max } => write!(
                f,
                "there are more spectral bands than the {max} that the device takes: use fewer, \
                 or sum them on the host (Codec::Electrons16)"
            ),
            Self::WrongShape => f.write_str(
                "the frame's rows, width or bands are not those of the camera in force: send the \
                 camera again, or correct the frame",
            ),
            Self::Arithmetic => f.write_str(
                "the device does not compute in this arithmetic: choose one of \
                 Capabilities::arithmetics",
            ),
            Self::Codec => f.write_str(
                "the device does not read this row codec: choose one of Capabilities::codecs",
            ),
            Self::Packing => f.write_str(
                "this packing does not exist, or has fewer bits per sample than the camera: use \
                 8, 10, 12, 14 or 16, and at least the camera's; 20 or 24 of a merged signal of so \
                 many",
            ),
            Self::Exposure => {
                f.write_str("exposure time (s) and analogue gain must be positive finite numbers")
            }
            Self::Captures { max } => write!(
                f,
                "the camera has more captures than the {max} that the device has memory for: use \
                 one of them alone"
            ),
        }
    }
}

impl core::error::Error for Refusal {}

impl Refusal {
    /// A name for programs, which does not change when the text does.
    pub const fn code(&self) -> &'static str {
        match self {
            Self::NoCamera => "no-camera",
            Self::BadCamera => "bad-camera",
            Self::CameraTooLong { .. } => "camera-too-long",
            Self::Effects => "effects",
            Self::TooWide { .. } => "too-wide",
            Self::TooManyBands { .. } => "too-many-bands",
            Self::WrongShape => "wrong-shape",
            Self::Arithmetic => "arithmetic",
            Self::Codec => "codec",
            Self::Packing => "packing",
            Self::Exposure => "exposure",
            Self::Captures { .. } => "captures",
        }
    }
}

/// Counters of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Statistics {
    /// Packets received with a correct CRC and a known kind.
    pub packets: u32,
    /// Packets dropped because of their CRC.
    pub damaged: u32,
    /// Packets dropped because a newer one was received before.
    pub stale: u32,
    /// Number of times that a part was out of order.
    pub gaps: u32,
    /// Spectral rows received completely.
    pub rows_in: u32,
    /// Raw rows computed.
    pub rows_out: u32,
    /// Frames begun.
    pub frames: u32,
}

impl Statistics {
    /// All zero.
    pub const fn new() -> Self {
        Self { packets: 0, damaged: 0, stale: 0, gaps: 0, rows_in: 0, rows_out: 0, frames: 0 }
    }
}

/// [`camera_id`] of nothing.
pub(crate) const NO_CAMERA_BYTES: u64 = 0xcbf2_9ce4_8422_2325;

/// Continues a [`camera_id`] with further bytes.
pub(crate) fn continue_camera_id(id: u64, bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(id, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

/// Identity of a camera's bytes: 64-bit FNV-1a.
pub fn camera_id(bytes: &[u8]) -> u64 {
    continue_camera_id(NO_CAMERA_BYTES, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_control_messages_fit() {
        let exposure = Exposure { exposure_s: 1.0, analog_gain: 1.0 };
        let shape = FrameShape {
            rows: u16::MAX,
            units: u16::MAX,
            unit_bytes: u16::MAX,
            raw_bytes: u16::MAX,
            halo: u8::MAX,
        };
        let start = ToHost::FrameStart(FrameStart {
            transfer: u16::MAX,
            shape,
            exposure,
            counter: u16::MAX,
            frame: u32::MAX,
            seed: u64::MAX,
            test_pattern: u16::MAX,
            fault: Fault::CorruptRow(u16::MAX),
        });
        let reply = HelloReply {
            version: 255,
            oldest: 255,
            newest: 255,
            device: Some(Capabilities {
                firmware: "0123456789012345678901234567890123456789".try_into().unwrap(),
                packet_bytes: u16::MAX,
                credit: u16::MAX,
                max_width: u16::MAX,
                max_bands: u16::MAX,
                max_camera: u32::MAX,
                arithmetics: 255,
                codecs: 255,
                memory_bytes: u32::MAX,
                effects: (0..=u8::MAX).collect(),
                camera: u64::MAX,
            }),
        };
        let mut buffer = [0; CONTROL_BYTES];
        postcard::to_slice(&start, &mut buffer).unwrap();
        postcard::to_slice(&reply, &mut buffer).unwrap();
    }

    #[test]
    fn camera_id_is_fnv1a() {
        // Test vectors of the FNV draft (Noll): "" and "foobar".
        assert_eq!(camera_id(b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(camera_id(b"foobar"), 0x8594_4171_f739_67e8);
    }
}
