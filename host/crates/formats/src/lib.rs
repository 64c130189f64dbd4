//! File formats of raw frames: readers and writers, one module per format. The principal type is
//! [`Frames`]: what a file holds.
//!
//! Readers and writers are pure functions between bytes and [`Frames`], which holds samples in
//! digital numbers (DN) and what the file says about them ([`Facts`]: bits per sample, colour
//! filter pattern, black and white level in DN). [`camrig_base::output`] writes the bytes to disk.
//! The format of a file is recognised by its content, never by its name, except for headerless
//! packed raw, which has no header to go by ([`pixel_format`]).
//!
//! Every writer is deterministic: it reads no clock and no host name. No reader trusts a length
//! it finds: sizes are checked against the bytes present before anything is allocated.
//!
//! | format | module | frames | facts it carries |
//! | --- | --- | --- | --- |
//! | DNG | [`dng`] | one | all, with colour matrices and corrections |
//! | 16-bit TIFF | [`tiff16`] | any number | all |
//! | NumPy array | [`npy`] | any number | none |
//! | PGM, PAM | [`pgm`] | any number | all |
//! | PNG | [`mod@png`] | one | all |
//! | FITS | [`fits`] | any number | all |
//! | CSI-2 packets | [`csi2`] | any number | bits |
//! | MCAP recording | [`mod@mcap`] | any number, grey and Bayer | all |
//! | Y4M video, written alone | [`y4m`] | any number, without colour filters | bits |
//! | V4L2 pixels | [`pixel_format`] | any number | bits and pattern, in the file's name |
//!
//! All but the last two may be compressed by gzip. [`live`] writes frames one after another.
//! [`Facts::notes`] has the assumptions of a reader, [`Format::leaves_out`] what a format cannot
//! carry. A format whose feature is switched off is refused.
//!
//! # Example
//! A frame of 4 x 2 pixels, 10 bits, as a TIFF file's bytes and back:
//! ```
//! use camrig_base::{Cfa, RawFrame};
//! use camrig_formats::{Format, Frames, decode};
//!
//! let frame = RawFrame {
//!     width: 4,
//!     height: 2,
//!     bits: 10,
//!     cfa: Cfa::parse("RGGB")?,
//!     black_level_dn: 64.0,
//!     white_level_dn: 1023,
//!     data: vec![64, 70, 500, 1023, 65, 71, 501, 1022], // DN, row by row
//! };
//! let bytes = Format::Tiff.encode(&Frames::from_raw(&frame))?;
//! assert_eq!(Format::sniff(&bytes), Some(Format::Tiff));
//! assert_eq!(decode(&bytes)?.raw(0)?, frame);
//!
//! // The same samples packed as MIPI CSI-2 sends 10 bits: four pixels in five bytes.
//! let packed = Format::parse("SRGGB10P")?.encode(&Frames::from_raw(&frame))?;
//! assert_eq!(packed.len(), 10);
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod bayerlink;
mod cfa_codes;
pub mod color;
pub mod csi2;
#[cfg(feature = "tiff")]
pub mod dng;
mod dng_info;
mod dng_read;
pub mod exif;
mod facts;
pub mod fits;
mod full_scale;
mod gzip;
#[cfg_attr(not(feature = "tiff"), allow(dead_code, reason = "stacks of TIFF alone"))]
mod ifd;
pub mod live;
mod ljpeg;
#[cfg(feature = "mcap")]
pub mod mcap;
mod narrow;
pub mod npy;
pub mod opcodes;
pub mod pgm;
pub mod pixel_format;
#[cfg(feature = "png")]
pub mod png;
pub mod preview;
#[cfg_attr(not(feature = "mcap"), allow(dead_code, reason = "messages of recordings alone"))]
mod ros;
mod taken;
#[cfg(test)]
mod tests;
#[cfg(feature = "tiff")]
pub mod tiff16;
mod tiff_samples;
pub mod wide;
pub mod y4m;

pub use bayerlink::Display;
use camrig_base::{Dn, Error, ErrorCode, Plane, RawFrame, Result};
pub use dng_info::{ColorMatrix, DngInfo};
pub use facts::Facts;
pub use pixel_format::PixelFormat;
use std::fmt;
use std::path::Path;
pub use taken::{Said, Taken};

/// First bytes of an MCAP file.
const MCAP_MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// A stack of raw frames of one size, with what is known about them.
#[derive(Clone, Debug, PartialEq)]
pub struct Frames<S = u16> {
    /// DN per pixel, frame by frame in order of time; at least one frame, all of one size.
    pub planes: Vec<Plane<S>>,
    /// What the file says about its samples.
    pub facts: Facts<S>,
}

/// A file format of raw frames.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Format {
    /// Digital negative: one frame with its colour metadata.
    Dng,
    /// 16-bit grey TIFF, one page per frame.
    Tiff,
    /// NumPy array, H x W or N x H x W, `<u2`.
    Npy,
    /// Portable grey map (`P5`; `P2` and `P7` are read), one image after another.
    Pgm,
    /// 16-bit grey PNG, one frame.
    Png,
    /// FITS image, 16 bits with BZERO; several frames along the third axis.
    Fits,
    /// MIPI CSI-2 packet stream as it leaves the receiver's lane merger.
    Csi2,
    /// MCAP recording of ROS 2 images.
    Mcap,
    /// YUV4MPEG2, grey video of a sensor without colour filters; written, not read.
    Y4m,
    /// Pixels of a display link that carry raw frames, one display after another; written, not
    /// read.
    Bayerlink(Display),
    /// Headerless pixels in a V4L2 format, one frame after another.
    Raw(PixelFormat),
}

impl<S: Dn> Frames<S> {
    /// A stack of one frame, with everything the frame says about itself.
    pub fn from_raw(frame: &RawFrame<S>) -> Self {
        Self { planes: vec![frame.plane()], facts: Facts::of(frame) }
    }

    /// Width of the frames, pixels.
    pub fn width(&self) -> usize {
        self.planes[0].width
    }

    /// Height of the frames, pixels.
    pub fn height(&self) -> usize {
        self.planes[0].height
    }
}

impl Frames {
    /// Gives samples of a DNG with a black level for each place of its pattern one level, the
    /// largest: those of the others are lifted by the difference, rounded to whole DN, so that
    /// nothing is cut off below.
    pub fn level_blacks(&mut self) {
        let (Some(levels), Some(cfa)) = (self.facts.black_levels_that_differ(), &self.facts.cfa)
        else {
            return;
        };
        if levels.len() != cfa.width * cfa.height {
            return;
        }
        let largest = levels.iter().copied().fold(0.0, f64::max);
        let lifts: Vec<u16> = levels.iter().map(|l| (largest - l).round() as u16).collect();
        for plane in &mut self.planes {
            for (i, dn) in plane.data.iter_mut().enumerate() {
                let (x, y) = (i % plane.width, i / plane.width);
                *dn = dn.saturating_add(lifts[y % cfa.height * cfa.width + x % cfa.width]);
            }
        }
        let lifted = levels.iter().zip(&lifts).map(|(level, lift)| level + f64::from(*lift));
        let level = lifted.sum::<f64>() / levels.len() as f64;
        self.facts.black_level_dn = Some(level);
        if let Some(dng) = &mut self.facts.dng {
            dng.black_levels_dn.clear();
        }
    }

    /// Frame `index`, counted from 0, as a raw frame. A white level that the file does not say is
    /// full scale.
    ///
    /// # Errors
    /// No frame of that index; bits, colour filter pattern or black level that the file does not
    /// carry; samples beyond the bits.
    pub fn raw(&self, index: usize) -> Result<RawFrame> {
        let plane = self.planes.get(index).ok_or_else(|| {
            Error::input(format!("frame {index}"))
                .help(format!("the file has {} frame(s), counted from 0", self.planes.len()))
        })?;
        let missing = |name: &str| {
            Error::input(format!("the file does not say its {name}"))
                .help("give what the file does not say")
                .with_code(ErrorCode::MissingFacts)
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
    /// A format by its name: dng, tiff, npy, pgm, png, fits, csi2, mcap, y4m, bayerlink (with
    /// `:WIDTHxHEIGHT` of a display), or a V4L2 pixel format.
    ///
    /// # Errors
    /// A name that is none of these.
    pub fn parse(name: &str) -> Result<Self> {
        Ok(match name.to_ascii_lowercase().as_str() {
            "dng" => Self::Dng,
            "tif" | "tiff" => Self::Tiff,
            "npy" => Self::Npy,
            "pgm" => Self::Pgm,
            "png" => Self::Png,
            "fits" | "fit" => Self::Fits,
            "csi2" => Self::Csi2,
            "mcap" => Self::Mcap,
            "y4m" => Self::Y4m,
            "bayerlink" => Self::Bayerlink(Display::default()),
            on_display if on_display.starts_with("bayerlink:") => {
                let size = on_display.trim_start_matches("bayerlink:");
                Self::Bayerlink(Display::parse(size).ok_or_else(|| {
                    Error::input(format!("a display of {size:?}"))
                        .help("WIDTHxHEIGHT in pixels, for instance bayerlink:1920x1080")
                })?)
            }
            _ => Self::Raw(PixelFormat::parse(name).map_err(|_| {
                Error::unsupported(format!("raw format {name:?}")).help(
                    "use dng, tiff, npy, pgm, png, fits, csi2, mcap, y4m, bayerlink, or a V4L2 or \
                     GenICam pixel format like SGRBG10P",
                )
            })?),
        })
    }

    /// The format that a file name asks for by its extension. Headerless pixels (`.raw`, `.bin`)
    /// say their layout in the name (`flat_640x480_SGRBG10P.raw`).
    ///
    /// # Errors
    /// An extension that is not known, or headerless pixels without a pixel format in the name.
    pub fn from_path(path: &Path) -> Result<Self> {
        if PixelFormat::is_headerless(path) {
            return Ok(Self::Raw(PixelFormat::from_file_name(path)?.0));
        }
        Self::parse(path.extension().and_then(|e| e.to_str()).unwrap_or("")).map_err(|_| {
            Error::unsupported(format!("no raw format is known by the name {}", path.display()))
                .help(
                    "end the name in .dng .tiff .npy .pgm .png .fits .csi2 .mcap .y4m, or, \
                 headerless, like NAME_640x480_SGRBG10P.raw",
                )
        })
    }

    /// The format of some bytes, by their first bytes; `None` where these do not tell (headerless
    /// raw never does).
    pub fn sniff(bytes: &[u8]) -> Option<Self> {
        match bytes {
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => Some(Self::Npy),
            [0x89, b'P', b'N', b'G', ..] => Some(Self::Png),
            [b'P', b'2' | b'5' | b'7', b, ..] if b.is_ascii_whitespace() => Some(Self::Pgm),
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => {
                Some(if ifd::is_dng(bytes) { Self::Dng } else { Self::Tiff })
            }
            _ if bytes.starts_with(b"SIMPLE  =") => Some(Self::Fits),
            _ if bytes.starts_with(MCAP_MAGIC) => Some(Self::Mcap),
            _ if csi2::is_stream(bytes) => Some(Self::Csi2),
            _ => None,
        }
    }

    /// What a file of this format does not say although a reader would take it to: a sentence each
    /// for a person.
    pub fn leaves_out(&self, facts: &Facts) -> Vec<String> {
        let of_pixels = match self {
            Self::Raw(pixels) => pixels.leaves_out(facts),
            _ => None,
        };
        let levels = facts.black_levels_that_differ().filter(|_| *self != Self::Dng);
        let black = levels.map(|levels| {
            let each: Vec<String> = levels.iter().map(f64::to_string).collect();
            format!(
                "black levels differ by place of the pattern, {} DN, and {self} has one for all: \
                 their mean (a DNG keeps them)",
                each.join(", ")
            )
        });
        of_pixels.into_iter().chain(black).collect()
    }

    /// Whether frames of this format follow one another, so that each can be written when it is
    /// there ([`live`]).
    pub fn is_stream(&self) -> bool {
        matches!(
            self,
            Self::Pgm | Self::Csi2 | Self::Mcap | Self::Y4m | Self::Bayerlink(_) | Self::Raw(_)
        )
    }

    /// The bytes of a file of this format.
    ///
    /// # Errors
    /// Several frames for a format that holds one, facts that the format needs and the frames do
    /// not carry, samples beyond the bits, sizes that the format cannot express.
    pub fn encode(&self, frames: &Frames) -> Result<Vec<u8>> {
        if matches!(self, Self::Dng | Self::Png) && frames.planes.len() != 1 {
            return Err(Error::unsupported(format!(
                "{} frames for a format that holds one",
                frames.planes.len()
            ))
            .help("write .npy, .tiff, .fits, .csi2 or .raw, or choose one")
            .with_code(ErrorCode::SeveralFrames));
        }
        match self {
            #[cfg(feature = "tiff")]
            Self::Dng => {
                let info = frames.facts.dng.clone().unwrap_or_default();
                dng::encode(&frames.raw(0)?, &info)
            }
            #[cfg(feature = "tiff")]
            Self::Tiff => tiff16::encode(frames),
            Self::Npy => npy::encode(frames),
            Self::Pgm => pgm::encode(frames),
            #[cfg(feature = "png")]
            Self::Png => png::encode(frames),
            Self::Fits => fits::encode(frames),
            Self::Csi2 => csi2::encode(frames),
            #[cfg(feature = "mcap")]
            Self::Mcap => mcap::encode(frames),
            Self::Y4m => y4m::encode(frames),
            Self::Bayerlink(display) => {
                let mut bytes = Vec::new();
                for (number, i) in (0..).zip(0..frames.planes.len()) {
                    bytes.extend(bayerlink::encode(&frames.raw(i)?, *display, number)?);
                }
                Ok(bytes)
            }
            Self::Raw(pixels) => pixels.encode(frames, None),
            #[cfg(not(all(feature = "mcap", feature = "png", feature = "tiff")))]
            other => Err(left_out(other)),
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Dng => "dng",
            Self::Tiff => "tiff",
            Self::Npy => "npy",
            Self::Pgm => "pgm",
            Self::Png => "png",
            Self::Fits => "fits",
            Self::Csi2 => "csi2",
            Self::Mcap => "mcap",
            Self::Y4m => "y4m",
            Self::Bayerlink(display) => return display.fmt(f),
            Self::Raw(pixels) => return pixels.fmt(f),
        })
    }
}

/// The error for a format whose feature is switched off.
#[cfg(not(all(feature = "gzip", feature = "mcap", feature = "png", feature = "tiff")))]
fn left_out(format: impl fmt::Display) -> Error {
    Error::unsupported(format!("{format}: this build leaves it out"))
        .help("build camrig-formats with its default features")
}

/// Reads frames from the bytes of any self-describing format, also within gzip.
///
/// # Errors
/// Bytes of no known format, or a file that is damaged or uses what the reader does not support.
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    let unpacked;
    let bytes = if gzip::is_gzip(bytes) {
        unpacked = gzip::inflate(bytes, gzip::LARGEST)?;
        &unpacked
    } else {
        bytes
    };
    if let Some((kind, maker)) = maker_raw(bytes) {
        return Err(Error::unsupported(format!(
            "a raw file of a maker's own format: {kind}, {maker}"
        ))
        .help(
            "convert it to DNG first, with Adobe DNG Converter or `dnglab convert IN OUT.dng`",
        ));
    }
    let frames = match Format::sniff(bytes) {
        Some(Format::Dng) => dng_read::decode(bytes),
        #[cfg(feature = "tiff")]
        Some(Format::Tiff) => tiff16::decode(bytes),
        Some(Format::Npy) => npy::decode(bytes),
        Some(Format::Pgm) => pgm::decode(bytes),
        #[cfg(feature = "png")]
        Some(Format::Png) => png::decode(bytes),
        Some(Format::Fits) => fits::decode(bytes),
        Some(Format::Csi2) => csi2::decode(bytes),
        #[cfg(feature = "mcap")]
        Some(Format::Mcap) => mcap::decode(bytes),
        Some(Format::Raw(_) | Format::Y4m | Format::Bayerlink(_)) | None => {
            Err(Error::unsupported("not in a known raw format").help(
                "known by content: DNG, TIFF, NPY, PGM and PAM (P2, P5, P7), PNG, FITS, CSI-2 \
             packets, MCAP; headerless raw needs a name like NAME_640x480_SGRBG10P.raw",
            ))
        }
        #[cfg(not(all(feature = "mcap", feature = "png", feature = "tiff")))]
        Some(other) => Err(left_out(&other)),
    }?;
    debug_assert!(!frames.planes.is_empty());
    Ok(frames)
}

/// The kind and the maker of a raw file that is no DNG, by its content.
fn maker_raw(bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    let at = |place: usize, mark: &[u8]| bytes.get(place..).is_some_and(|b| b.starts_with(mark));
    let marks: [(usize, &[u8], _); 6] = [
        (8, b"CR\x02", ("CR2", "Canon")),
        (4, b"ftypcrx ", ("CR3", "Canon")),
        (0, b"FUJIFILMCCD-RAW", ("RAF", "Fujifilm")),
        (0, b"IIU\0", ("RW2", "Panasonic")),
        (0, b"IIR", ("ORF", "Olympus")),
        (0, b"MMOR", ("ORF", "Olympus")),
    ];
    let marked = marks.into_iter().find(|(place, mark, _)| at(*place, mark));
    // The others are TIFF files whose first directory names the maker and holds a preview.
    marked.map(|(_, _, kind)| kind).or_else(|| {
        let maker = ifd::maker_of_previews(bytes)?.to_ascii_uppercase();
        let tiffs = [
            ("NIKON", ("NEF", "Nikon")),
            ("SONY", ("ARW", "Sony")),
            ("PENTAX", ("PEF", "Pentax")),
            ("SAMSUNG", ("SRW", "Samsung")),
        ];
        tiffs.into_iter().find(|(name, _)| maker.starts_with(name)).map(|(_, kind)| kind)
    })
}

/// Reads frames from a file: by its content, or headerless raw by its name.
///
/// # Errors
/// A file that cannot be read; those of [`decode`]; headerless pixels whose name has no size.
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

/// How the frames of a file were taken. Of FITS and DNG the headers alone are read; of NPY, which
/// does not say it, nothing; every other format is decoded.
///
/// # Errors
/// Those of [`read`]; of the formats whose samples are not decoded, those of the headers.
pub fn taken(path: &Path) -> Result<Taken> {
    let bytes = read_bytes(path)?;
    match Format::sniff(&bytes) {
        Some(Format::Fits) => fits::taken(&bytes).map_err(|e| e.at(path.display())),
        Some(Format::Dng) => Ok(Taken::of_tiff(&bytes)),
        Some(Format::Npy) => Ok(Taken::default()),
        _ => Ok(read(path)?.facts.taken),
    }
}

/// The bytes of a file, or of standard input for `-`.
///
/// # Errors
/// What the operating system says.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    if path.as_os_str() == "-" {
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut std::io::stdin().lock(), &mut bytes)
            .map_err(|e| Error::io("read", path, e))?;
        return Ok(bytes);
    }
    std::fs::read(path).map_err(|e| Error::io("read", path, e))
}

/// The largest DN that `bits` bits express.
pub(crate) fn full_scale(bits: u32) -> u16 {
    ((1u32 << bits.clamp(1, 16)) - 1) as u16
}

/// Refuses a number of bits that the samples' type has not, and samples beyond the bits.
pub(crate) fn check_range<S: Dn>(data: &[S], bits: u32) -> Result<()> {
    if !(1..=S::MAX_BITS).contains(&bits) {
        return Err(Error::unsupported(format!("{bits} bits per sample"))
            .help(format!("use 1 to {}", S::MAX_BITS)));
    }
    let top = ((1u64 << bits) - 1) as u32;
    match data.iter().position(|&dn| dn.into() > top) {
        Some(i) => Err(Error::input(format!("DN {} in a frame of {bits} bits", data[i]))
            .at(format!("sample {i}"))
            .help(format!("samples must not exceed {top}; is the number of bits right?"))),
        None => Ok(()),
    }
}

/// Bytes that a reader or writer may need per sample at most: an `f64` in a conversion. Bounds the
/// size of a frame, so that no product of sizes overflows.
const MAX_BYTES_PER_SAMPLE: usize = 8;

/// The number of samples of a frame; refuses a frame that is empty or too large to address.
pub(crate) fn area(width: usize, height: usize) -> Result<usize> {
    width
        .checked_mul(height)
        .filter(|&n| n > 0 && n <= isize::MAX as usize / MAX_BYTES_PER_SAMPLE)
        .ok_or_else(|| {
            Error::limit(format!("a frame of {width} x {height} pixels"))
                .help("width and height must be at least 1 and fit in memory")
        })
}

/// The error for a file that ends before the bytes its header announces.
pub(crate) fn truncated(needed: usize, found: usize) -> Error {
    Error::input(format!("truncated: {needed} bytes needed, {found} there"))
        .help("the file is incomplete or its header is damaged; get it again")
}
