//! Headerless raw pixels, named as Linux V4L2 names them.
//!
//! `SGRBG10P` is a GRBG Bayer pattern, 10 bits packed as MIPI sends them; without the `P` each
//! sample is a little-endian 16-bit word (8 bits: a byte). `Y10P`, `Y12`, ... are without colour
//! filters. The file name carries pixel format and size: `flat_640x480_SGRBG10P.raw`.

use super::{Facts, Frames, area, check_range, truncated};
use camrig_base::{Cfa, Error, Plane, Result};
use camrig_rig_link::packing::{Packing, pack_row, unpack_row};
use std::fmt;
use std::path::Path;

/// A headerless layout of raw pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PixelFormat {
    /// One of the four Bayer patterns, or mono.
    pub cfa: Cfa,
    /// Bits per sample: 8, 10, 12, 14 or 16.
    pub bits: u32,
    /// Whether samples are packed as MIPI CSI-2 sends them, instead of in 16-bit words.
    pub packed: bool,
}

impl PixelFormat {
    /// Reads a V4L2 name: `SRGGB8`, `SGRBG10`, `SBGGR12P`, `Y16`, `GREY`, ...
    ///
    /// # Errors
    /// A name that V4L2 does not have.
    pub fn parse(name: &str) -> Result<Self> {
        let bad = || {
            Error::unsupported(format!("pixel format {name:?}")).help(
                "use V4L2's names: S + RGGB, GRBG, GBRG or BGGR, or Y, + 8, 10, 12, 14 or 16, + P \
                 for MIPI-packed; for instance SGRBG10P",
            )
        };
        let upper = name.to_ascii_uppercase();
        let upper = if upper == "GREY" { "Y8".into() } else { upper };
        let (body, packed) = upper.strip_suffix('P').map_or((&upper[..], false), |b| (b, true));
        let digits = body.trim_end_matches(|c: char| c.is_ascii_digit()).len();
        let bits = body[digits..].parse().map_err(|_| bad())?;
        let cfa = match &body[..digits] {
            "Y" => "mono",
            "SRGGB" => "RGGB",
            "SGRBG" => "GRBG",
            "SGBRG" => "GBRG",
            "SBGGR" => "BGGR",
            _ => return Err(bad()),
        };
        // 8 and 16 bits fill their bytes: V4L2 has no packed names for them.
        if Packing::of_bits(bits).is_none() || (packed && matches!(bits, 8 | 16)) {
            return Err(bad());
        }
        Ok(Self { cfa: Cfa::parse(cfa)?, bits, packed })
    }

    /// Whether a file of this name is headerless: `.raw` and `.bin`.
    pub fn is_headerless(path: &Path) -> bool {
        path.extension().is_some_and(|e| e == "raw" || e == "bin")
    }

    /// Pixel format, and width and height in pixels where given, from the words of a file name,
    /// separated by `_`.
    ///
    /// # Errors
    /// No word that is a pixel format.
    pub fn from_file_name(path: &Path) -> Result<(Self, Option<(usize, usize)>)> {
        let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or("");
        let size = |word: &str| {
            let (w, h) = word.split_once('x')?;
            Some((w.parse().ok()?, h.parse().ok()?))
        };
        let words = || stem.split('_');
        let pixels = words().rev().find_map(|w| Self::parse(w).ok()).ok_or_else(|| {
            Error::input(format!("no pixel format in the name {path:?}"))
                .help("name it like NAME_640x480_SGRBG10P.raw, or give the pixel format")
        })?;
        Ok((pixels, words().rev().find_map(size)))
    }

    /// The layout of a row.
    pub fn packing(&self) -> Packing {
        match (self.packed, self.bits) {
            (_, 8) => Packing::Raw8,
            (true, 10) => Packing::Raw10,
            (true, 12) => Packing::Raw12,
            (true, 14) => Packing::Raw14,
            _ => Packing::Le16,
        }
    }

    /// Frames as pixels one after another, rows without padding.
    ///
    /// # Errors
    /// Frames of another colour filter pattern, samples beyond the bits.
    pub fn encode(&self, frames: &Frames) -> Result<Vec<u8>> {
        self.check(&frames.facts)?;
        let packing = self.packing();
        let row_bytes = packing.row_bytes(frames.width());
        let mut bytes = vec![0; row_bytes * frames.height() * frames.planes.len()];
        let rows = frames.planes.iter().flat_map(|p| p.data.chunks_exact(p.width));
        for plane in &frames.planes {
            check_range(&plane.data, self.bits)?;
        }
        for (out, row) in bytes.chunks_exact_mut(row_bytes).zip(rows) {
            pack_row(packing, row, out).map_err(wrong_size)?;
        }
        Ok(bytes)
    }

    /// Refuses frames of another pattern, which must not be relabelled silently.
    fn check(&self, facts: &Facts) -> Result<()> {
        if let Some(cfa) = facts.cfa.as_ref().filter(|c| **c != self.cfa) {
            return Err(Error::unsupported(format!("a frame with pattern {cfa} as {self}"))
                .help("choose the pixel format of the frame's own pattern"));
        }
        Ok(())
    }

    /// Frames from pixels one after another, `width` x `height` each. `stride` is the distance
    /// from row to row in bytes, by default the bytes of a row; bytes beyond the row are skipped.
    ///
    /// # Errors
    /// A stride shorter than a row, bytes that are not whole frames, samples beyond the bits.
    pub fn decode(
        &self,
        bytes: &[u8],
        width: usize,
        height: usize,
        stride: Option<usize>,
    ) -> Result<Frames> {
        area(width, height)?;
        let packing = self.packing();
        let row_bytes = packing.row_bytes(width);
        let stride = stride.unwrap_or(row_bytes);
        if stride < row_bytes {
            return Err(Error::input(format!("a stride of {stride} bytes"))
                .help(format!("a row of {width} pixels in {self} takes {row_bytes}")));
        }
        let frame_bytes = stride.saturating_mul(height);
        if bytes.is_empty() || !bytes.len().is_multiple_of(frame_bytes) {
            return Err(truncated(
                bytes.len().max(1).div_ceil(frame_bytes).saturating_mul(frame_bytes),
                bytes.len(),
            )
            .at(format!("frames of {width} x {height} {self}")));
        }
        let planes = bytes
            .chunks_exact(frame_bytes)
            .map(|frame| {
                let mut plane = Plane::filled(width, height, 0);
                for (y, row) in frame.chunks_exact(stride).enumerate() {
                    unpack_row(packing, &row[..row_bytes], plane.row_mut(y))
                        .map_err(wrong_size)?;
                }
                check_range(&plane.data, self.bits)?;
                Ok(plane)
            })
            .collect::<Result<_>>()?;
        let facts =
            Facts { bits: Some(self.bits), cfa: Some(self.cfa.clone()), ..Facts::default() };
        Ok(Frames { planes, facts })
    }

    /// Commands of ffmpeg, GStreamer and V4L2 that show the pixels of `path`, to copy and paste.
    pub fn hints(&self, path: &Path, width: usize, height: usize) -> Vec<String> {
        let path = path.display();
        let order = self.cfa.to_string().to_ascii_lowercase();
        let mono = self.cfa.is_mono();
        let word = if self.bits == 8 { "8" } else { "16le" };
        let mut hints = Vec::new();
        if !self.packed {
            let format = match (mono, self.bits) {
                (true, 8) => "gray".into(),
                (true, bits @ (10 | 12 | 14)) => format!("gray{bits}le"),
                (true, _) => "gray16le".into(),
                _ => format!("bayer_{order}{word}"),
            };
            hints.push(format!(
                "ffmpeg -f rawvideo -pixel_format {format} -video_size {width}x{height} -i {path} \
                 out.png"
            ));
        }
        let caps = match (mono, self.bits) {
            (true, 8) => "video/x-raw,format=GRAY8".into(),
            (true, _) => "video/x-raw,format=GRAY16_LE".into(),
            (_, 8) => format!("video/x-bayer,format={order}"),
            (_, bits) => format!("video/x-bayer,format={order}{bits}le"),
        };
        if !self.packed {
            let size = self.packing().row_bytes(width) * height;
            hints.push(format!(
                "gst-launch-1.0 filesrc location={path} blocksize={size} ! \
                 {caps},width={width},height={height},framerate=1/1 ! ..."
            ));
        }
        hints.push(format!(
            "V4L2 pixel format {self}, bytesperline {}",
            self.packing().row_bytes(width)
        ));
        hints
    }
}

impl fmt::Display for PixelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let packed = if self.packed { "P" } else { "" };
        if self.cfa.is_mono() {
            write!(f, "Y{}{packed}", self.bits)
        } else {
            write!(f, "S{}{}{packed}", self.cfa, self.bits)
        }
    }
}

fn wrong_size(e: camrig_rig_link::packing::WrongSize) -> Error {
    Error::input(format!("a row of {} bytes where {} are needed", e.found, e.needed))
}
