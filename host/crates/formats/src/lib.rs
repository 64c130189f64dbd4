//! File formats of raw frames: readers and writers, one file per format.
//!
//! Readers and writers are pure functions between bytes and [`Frames`]; [`output`] puts bytes on
//! the disk whole or not at all. Reading dispatches on content, never on the name, except for
//! headerless packed raw, which has no content to go by ([`pixel_format`]).
//!
//! Every writer is deterministic (no clock, no host name), and no reader trusts a length it finds:
//! sizes are checked against the bytes that are there before anything is allocated.

pub mod color;
pub mod csi2;
pub mod dng;
mod dng_read;
mod facts;
pub mod fits;
mod ifd;
pub mod npy;
pub mod opcodes;
pub mod pgm;
pub mod pixel_format;
pub mod png;
pub mod preview;
#[cfg(test)]
mod tests;
pub mod tiff16;

use camrig_base::{Error, Plane, RawFrame, Result};
pub use dng::DngInfo;
pub use facts::Facts;
pub use pixel_format::PixelFormat;
use std::path::Path;

/// A stack of raw frames of one size, with what is known about them.
#[derive(Clone, Debug, PartialEq)]
pub struct Frames {
    /// DN per pixel, frame by frame in order of time; at least one frame, all of one size.
    pub planes: Vec<Plane<u16>>,
    /// What the file says about its samples.
    pub facts: Facts,
}

/// A file format of raw frames.
#[derive(Clone, Debug, PartialEq)]
pub enum Format {
    /// Digital negative: one frame with its colour metadata.
    Dng,
    /// 16-bit grey TIFF, a page per frame.
    Tiff,
    /// NumPy array, H x W or N x H x W, `<u2`.
    Npy,
    /// Portable grey map (`P5`), images back to back.
    Pgm,
    /// 16-bit grey PNG, one frame.
    Png,
    /// FITS primary image, 16 bits with BZERO, NAXIS3 frames.
    Fits,
    /// MIPI CSI-2 packet stream as it leaves the lane merger.
    Csi2,
    /// Headerless pixels in a V4L2 format, frames back to back.
    Raw(PixelFormat),
}

impl Frames {
    /// One frame with all that is known about it.
    pub fn from_raw(frame: &RawFrame) -> Self {
        let plane = Plane { width: frame.width, height: frame.height, data: frame.data.clone() };
        Self { planes: vec![plane], facts: Facts::of(frame) }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.planes[0].width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.planes[0].height
    }

    /// Frame `index` as a raw frame; an error names the facts that the file does not carry.
    pub fn raw(&self, index: usize) -> Result<RawFrame> {
        let plane = self.planes.get(index).ok_or_else(|| {
            Error::input(format!("frame {index}"))
                .help(format!("the file has {} frame(s), counted from 0", self.planes.len()))
        })?;
        let missing = |name: &str| {
            Error::input(format!("the file does not say its {name}"))
                .help("give what the file does not say")
                .with_code("missing-facts")
        };
        let facts = &self.facts;
        let bits = facts.bits.ok_or_else(|| missing("bits per sample"))?;
        let frame = RawFrame {
            width: plane.width,
            height: plane.height,
            bits,
            cfa: facts.cfa.clone().ok_or_else(|| missing("colour filter pattern"))?,
            black_level_dn: facts.black_level_dn.ok_or_else(|| missing("black level"))?,
            white_level_dn: facts.white_level_dn.unwrap_or(full_scale(bits)),
            data: plane.data.clone(),
        };
        check_range(&frame.data, bits)?;
        Ok(frame)
    }
}

impl Format {
    /// A format by its name: dng, tiff, npy, pgm, png, fits, csi2, or a V4L2 pixel format.
    pub fn parse(name: &str) -> Result<Self> {
        Ok(match name.to_ascii_lowercase().as_str() {
            "dng" => Self::Dng,
            "tif" | "tiff" => Self::Tiff,
            "npy" => Self::Npy,
            "pgm" => Self::Pgm,
            "png" => Self::Png,
            "fits" | "fit" => Self::Fits,
            "csi2" => Self::Csi2,
            _ => Self::Raw(PixelFormat::parse(name).map_err(|_| {
                Error::input(format!("raw format {name:?}")).help(
                    "use dng, tiff, npy, pgm, png, fits, csi2, or a V4L2 pixel format like SGRBG10P",
                )
            })?),
        })
    }

    /// The format that a file name asks for. Headerless pixels (`.raw`, `.bin`) say their layout
    /// in the name (`flat_640x480_SGRBG10P.raw`).
    pub fn from_path(path: &Path) -> Result<Self> {
        if PixelFormat::is_headerless(path) {
            return Ok(Self::Raw(PixelFormat::from_file_name(path)?.0));
        }
        Self::parse(path.extension().and_then(|e| e.to_str()).unwrap_or("")).map_err(|_| {
            Error::input(format!("no raw format is known by the name {}", path.display())).help(
                "end the name in .dng .tiff .npy .pgm .png .fits .csi2, or, headerless, like \
                 NAME_640x480_SGRBG10P.raw",
            )
        })
    }

    /// The format that bytes are in, as far as they tell (headerless raw never does).
    pub fn sniff(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => Some(Self::Npy),
            [0x89, b'P', b'N', b'G', ..] => Some(Self::Png),
            [b'P', b'5', ..] => Some(Self::Pgm),
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => {
                Some(if ifd::is_dng(bytes) { Self::Dng } else { Self::Tiff })
            }
            _ if bytes.starts_with(b"SIMPLE  =") => Some(Self::Fits),
            _ if csi2::is_stream(bytes) => Some(Self::Csi2),
            _ => None,
        }
    }

    /// Frames in this format's bytes. A format of one frame refuses several.
    pub fn encode(&self, frames: &Frames) -> Result<Vec<u8>> {
        if matches!(self, Self::Dng | Self::Png) && frames.planes.len() != 1 {
            return Err(Error::input(format!(
                "{} frames for a format that holds one",
                frames.planes.len()
            ))
            .help("choose one, or write .npy, .tiff, .fits, .csi2 or .raw")
            .with_code("several-frames"));
        }
        match self {
            Self::Dng => {
                let info = frames.facts.dng.clone().unwrap_or_default();
                dng::encode(&frames.raw(0)?, &info)
            }
            Self::Tiff => tiff16::encode(frames),
            Self::Npy => npy::encode(frames),
            Self::Pgm => pgm::encode(frames),
            Self::Png => png::encode(frames),
            Self::Fits => fits::encode(frames),
            Self::Csi2 => csi2::encode(frames),
            Self::Raw(pixels) => pixels.encode(frames),
        }
    }
}

/// Reads frames from bytes in any self-describing format.
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    let frames = match Format::sniff(bytes) {
        Some(Format::Dng) => dng_read::decode(bytes),
        Some(Format::Tiff) => tiff16::decode(bytes),
        Some(Format::Npy) => npy::decode(bytes),
        Some(Format::Pgm) => pgm::decode(bytes),
        Some(Format::Png) => png::decode(bytes),
        Some(Format::Fits) => fits::decode(bytes),
        Some(Format::Csi2) => csi2::decode(bytes),
        Some(Format::Raw(_)) | None => Err(Error::input("not in a known raw format").help(
            "known by content: DNG, TIFF, NPY, PGM (P5), PNG, FITS, CSI-2 packets; headerless raw \
             needs a name like NAME_640x480_SGRBG10P.raw",
        )),
    }?;
    debug_assert!(!frames.planes.is_empty());
    Ok(frames)
}

/// Reads frames from a file: by content, or headerless raw by its name.
pub fn read(path: &Path) -> Result<Frames> {
    let bytes = read_bytes(path)?;
    let frames = if PixelFormat::is_headerless(path) {
        PixelFormat::from_file_name(path).and_then(|(pixels, size)| {
            let (width, height) = size.ok_or_else(|| {
                Error::input("headerless pixels of unknown size")
                    .help("name the file like NAME_640x480_SGRBG10P.raw")
            })?;
            pixels.decode(&bytes, width, height, None)
        })
    } else {
        decode(&bytes)
    };
    frames.map_err(|e| e.at(path.display()))
}

/// The bytes of a file, or of standard input for `-`.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    if path.as_os_str() == "-" {
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut std::io::stdin().lock(), &mut bytes)
            .map_err(|e| Error::io("read", path, e))?;
        return Ok(bytes);
    }
    std::fs::read(path).map_err(|e| Error::io("read", path, e))
}

/// The largest DN of `bits` bits.
pub(crate) fn full_scale(bits: u32) -> u16 {
    ((1u32 << bits.clamp(1, 16)) - 1) as u16
}

/// Refuses bits that no sample here can have, and DN beyond them.
pub(crate) fn check_range(data: &[u16], bits: u32) -> Result<()> {
    if !(1..=16).contains(&bits) {
        return Err(Error::input(format!("{bits} bits per sample")).help("use 1 to 16"));
    }
    let top = full_scale(bits);
    match data.iter().position(|&dn| dn > top) {
        Some(i) => Err(Error::input(format!("DN {} in a frame of {bits} bits", data[i]))
            .at(format!("sample {i}"))
            .help(format!("samples must not exceed {top}; is the number of bits right?"))),
        None => Ok(()),
    }
}

/// The number of samples of a frame, refused where it would overflow or is nothing.
pub(crate) fn area(width: usize, height: usize) -> Result<usize> {
    width.checked_mul(height).filter(|&n| n > 0 && n <= isize::MAX as usize / 8).ok_or_else(|| {
        Error::input(format!("a frame of {width} x {height} pixels"))
            .help("width and height must be at least 1 and fit in memory")
    })
}

/// The error for a file that ends before what it promised.
pub(crate) fn truncated(needed: usize, found: usize) -> Error {
    Error::input(format!("truncated: {needed} bytes needed, {found} there"))
        .help("the file is incomplete or its header is damaged; get it again")
}
