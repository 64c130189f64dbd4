//! The header of a message of `camrig-frames/1`: 256 bytes, as `docs/frames.md` lists them.

use crate::Quantity;
use camrig_base::{Error, Result};
use camrig_light::LightLevel;
use camrig_light::colour::space::{ACESCG, Chromaticities, REC2020, Space};
use camrig_light::colour::transfer::Transfer;
use crc::{CRC_32_ISCSI, Crc};

/// Bytes of a header without its extension.
pub(super) const BYTES: usize = 256;
/// What a message begins with.
pub(super) const MAGIC: &[u8; 8] = b"CRFRAME1";
/// CRC-32C (RFC 3720).
pub(super) const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISCSI);

/// Most bytes of a header with its extension.
const MOST: u32 = 1 << 16;
/// Most bytes of a payload.
const MAX_PAYLOAD: u64 = 1 << 32;
/// Most columns and rows, and most channels.
const MAX_SIDE: u32 = 65_535;
const MAX_CHANNELS: u32 = 1024;

const END: u32 = 2;
const LUX: u32 = 4;
const LUMINANCE: u32 = 8;
const CHECKSUM: u32 = 32;
const CUT: u32 = 1;
/// A flag that says something which is not applied.
const POSE: u32 = 16;
const SLOT: u32 = 64;

/// Samples of a payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sample {
    U8,
    U16,
    F16,
    F32,
}

impl Sample {
    pub fn bytes(self) -> u64 {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::F16 => 2,
            Self::F32 => 4,
        }
    }
}

/// What the channels are.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Colour {
    /// Bands of these wavelengths, nm.
    Bands(Vec<f64>),
    /// Grey, or red, green and blue.
    Space(Box<Space>),
}

/// What must be the same in all messages of a stream.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shape {
    pub width: usize,
    pub height: usize,
    pub channels: usize,
    pub sample: Sample,
    pub planar: bool,
    pub quantity: Quantity,
    pub colour: Colour,
    /// Bytes from one row to the next, and from one plane to the next.
    pub row_bytes: u64,
    pub plane_bytes: u64,
    pub scale: f64,
    pub level: Option<LightLevel>,
    pub illuminant: Option<String>,
}

/// A header that makes sense.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Header {
    pub number: u64,
    pub time_s: f64,
    /// How long the frame is shown, where that is known.
    pub duration_s: Option<f64>,
    /// None of the message that ends a stream.
    pub frame: Option<Shape>,
    pub payload: u64,
    pub payload_crc: Option<u32>,
    /// Whether it has nothing to do with the frame before.
    pub cut: bool,
    /// Whether it has a pose, which is not applied.
    pub has_pose: bool,
}

/// Numbers of a header by their place.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn bytes<const N: usize>(&self, at: usize) -> [u8; N] {
        std::array::from_fn(|i| self.0[at + i])
    }
    fn u16(&self, at: usize) -> u16 {
        u16::from_le_bytes(self.bytes(at))
    }
    fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.bytes(at))
    }
    fn u64(&self, at: usize) -> u64 {
        u64::from_le_bytes(self.bytes(at))
    }
    fn f32(&self, at: usize) -> f64 {
        f32::from_le_bytes(self.bytes(at)).into()
    }
    fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.bytes(at))
    }
}

fn wrong(what: impl std::fmt::Display, at: usize) -> Error {
    Error::input(what.to_string())
        .at(format!("byte {at} of its header"))
        .help("docs/frames.md has what each byte means")
}

/// Bytes of the extension that follow the first 256, which must be whole and undamaged.
pub(super) fn extension(head: &[u8; BYTES]) -> Result<usize> {
    let fields = Fields(head);
    if &head[..8] != MAGIC {
        return Err(wrong("no message of camrig-frames/1 begins here", 0));
    }
    if fields.u32(252) != CRC.checksum(&head[..252]) {
        return Err(wrong("a header whose checksum is wrong", 252));
    }
    let bytes = fields.u32(8);
    if bytes < BYTES as u32 || bytes > MOST || bytes % 64 != 0 {
        return Err(wrong(format!("a header of {bytes} bytes"), 8));
    }
    Ok(bytes as usize - BYTES)
}

impl Header {
    /// The header in `head`, which [`extension`] has passed, with its extension.
    pub fn parse(head: &[u8; BYTES], extension: &[u8]) -> Result<Self> {
        let fields = Fields(head);
        let flags = fields.u32(12);
        if flags & SLOT != 0 {
            return Err(wrong("a payload in shared memory, which is not read", 12));
        }
        let known = CUT | POSE | END | LUX | LUMINANCE | CHECKSUM;
        if flags & !known != 0 || flags & (LUX | LUMINANCE) == LUX | LUMINANCE {
            return Err(wrong(format!("flags {flags:#x}"), 12));
        }
        let seconds = |ns: i128| ns as f64 / 1e9;
        let duration = fields.u64(32);
        let header = Self {
            number: fields.u64(16),
            time_s: seconds(i64::from_le_bytes(fields.bytes(24)).into()),
            duration_s: (duration > 0).then(|| seconds(duration.into())),
            frame: None,
            payload: fields.u64(80),
            payload_crc: (flags & CHECKSUM != 0).then(|| fields.u32(184)),
            cut: flags & CUT != 0,
            has_pose: flags & POSE != 0,
        };
        if fields.u16(62) != 0 {
            return Err(wrong("a slot of a payload that is in none", 62));
        }
        if let Some(at) = [188, 244, 248].into_iter().find(|&at| fields.u32(at) != 0) {
            return Err(wrong(format!("{} where 0 is due", fields.u32(at)), at));
        }
        if flags & END != 0 {
            return match header.payload {
                0 => Ok(header),
                bytes => Err(wrong(format!("a payload of {bytes} bytes after the end"), 80)),
            };
        }
        let shape = Shape::parse(&fields, flags, extension)?;
        let payload = header.payload;
        let wrong_size = |due: String| wrong(format!("a payload of {payload} bytes{due}"), 80);
        match shape.payload() {
            None => return Err(wrong_size(", whose rows or planes overlap".into())),
            Some(due) if due != payload => {
                return Err(wrong_size(format!(" where {due} are due")));
            }
            Some(_) if payload > MAX_PAYLOAD => {
                return Err(wrong_size(format!(": at most {MAX_PAYLOAD} are read")));
            }
            Some(_) => {}
        }
        Ok(Self { frame: Some(shape), ..header })
    }
}

impl Shape {
    fn parse(fields: &Fields<'_>, flags: u32, extension: &[u8]) -> Result<Self> {
        let limits =
            [("columns", 40, MAX_SIDE), ("rows", 44, MAX_SIDE), ("channels", 48, MAX_CHANNELS)];
        for (what, at, most) in limits {
            let value = fields.u32(at);
            if value == 0 || value > most {
                return Err(wrong(format!("{value} {what}"), at));
            }
        }
        let [width, height, channels] = [40, 44, 48].map(|at| fields.u32(at) as usize);
        crate::rgb::picture::check_pixels([width, height])?;
        let sample = match fields.u16(52) {
            1 => Sample::U8,
            2 => Sample::U16,
            3 => Sample::F16,
            4 => Sample::F32,
            other => return Err(wrong(format!("samples of the kind {other}"), 52)),
        };
        let planar = match fields.u16(54) {
            1 => false,
            2 => true,
            other => return Err(wrong(format!("a layout {other}"), 54)),
        };
        let quantity = match fields.u16(56) {
            1 => Quantity::Reflectance,
            2 => Quantity::Radiance,
            other => return Err(wrong(format!("a quantity {other}"), 56)),
        };
        let colour = colour(fields, channels, extension)?;
        // Radiance of a picture may lack an absolute scale.
        let relative = quantity == Quantity::Radiance && matches!(colour, Colour::Space(_));
        let scale = fields.f64(88);
        if !(scale > 0.0 && scale.is_finite() || scale == 0.0 && relative) {
            return Err(wrong(format!("a scale of {scale}"), 88));
        }
        let level = fields.f64(96);
        let level = match flags & (LUX | LUMINANCE) {
            0 => None,
            _ if !(level > 0.0 && level.is_finite()) => {
                return Err(wrong(format!("a light level of {level}"), 96));
            }
            LUX => Some(LightLevel::Lux(level)),
            _ => Some(LightLevel::Luminance(level)),
        };
        let name: [u8; 32] = fields.bytes(208);
        let end = name.iter().position(|b| *b == 0).unwrap_or(name.len());
        let name = std::str::from_utf8(&name[..end])
            .map_err(|_| wrong("an illuminant whose name is no UTF-8", 208))?;
        Ok(Self {
            width,
            height,
            channels,
            sample,
            planar,
            quantity,
            colour,
            row_bytes: fields.u64(64),
            plane_bytes: fields.u64(72),
            scale,
            level,
            illuminant: (!name.is_empty()).then(|| name.to_owned()),
        })
    }

    /// Bytes of the payload; none where rows or planes overlap, or are too many to count.
    fn payload(&self) -> Option<u64> {
        let in_row = if self.planar { 1 } else { self.channels as u64 };
        let row = (self.width as u64).checked_mul(in_row)?.checked_mul(self.sample.bytes())?;
        let rows = self.row_bytes.checked_mul(self.height as u64)?;
        let planes = if self.planar { self.channels as u64 } else { 1 };
        let fits = self.row_bytes >= row && (!self.planar || self.plane_bytes >= rows);
        let all = if self.planar { self.plane_bytes.checked_mul(planes)? } else { rows };
        fits.then_some(all)
    }
}

fn colour(fields: &Fields<'_>, channels: usize, extension: &[u8]) -> Result<Colour> {
    let kind = fields.u16(58);
    if kind == 0 {
        return Ok(Colour::Bands(wavelengths(fields, channels, extension)?));
    }
    if ![1, 3, 4].contains(&channels) {
        return Err(wrong(format!("{channels} channels of a picture: 1, 3 or 4 are read"), 48));
    }
    let transfer = match fields.u16(60) {
        0 => Transfer::Linear,
        1 => Transfer::Srgb,
        2 => Transfer::Gamma(2.4),
        other => return Err(wrong(format!("a transfer {other}, which is not read"), 60)),
    };
    let chromaticities = || -> Chromaticities {
        std::array::from_fn(|i| [0, 1].map(|xy| fields.f32(104 + 8 * i + 4 * xy)))
    };
    let space = match (kind, &transfer) {
        (1, Transfer::Linear) => Space::linear_srgb(),
        (1, Transfer::Srgb) => Space::srgb(),
        (1, _) => Space::srgb().with(&transfer),
        (2, _) => Space::of("Rec. 2020", &REC2020, transfer)?,
        (3, _) => Space::of("ACEScg", &ACESCG, transfer)?,
        (4, Transfer::Linear) => Space::xyz(),
        (4, _) => return Err(wrong("XYZ that is not linear", 60)),
        (5, _) => Space::of("its own chromaticities", &chromaticities(), transfer)
            .map_err(|e| wrong(e.what(), 104))?,
        _ => return Err(wrong(format!("colours of the kind {kind}"), 58)),
    };
    Ok(Colour::Space(Box::new(space)))
}

fn wavelengths(fields: &Fields<'_>, channels: usize, extension: &[u8]) -> Result<Vec<f64>> {
    let (first, step) = (fields.f64(192), fields.f64(200));
    if !first.is_finite() || !step.is_finite() {
        return Err(wrong(format!("wavelengths from {first} nm in steps of {step} nm"), 192));
    }
    if step != 0.0 {
        return Ok((0..channels).map(|band| first + step * band as f64).collect());
    }
    let list = fields.u32(240) as usize;
    if list != 4 * channels || list > extension.len() {
        return Err(wrong(format!("a list of {list} bytes for {channels} wavelengths"), 240));
    }
    let number = |b: &[u8]| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    Ok(extension[..list].chunks_exact(4).map(number).collect())
}
