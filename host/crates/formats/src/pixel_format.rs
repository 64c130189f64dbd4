//! Headerless raw pixels, named as Linux V4L2, libcamera and GenICam name them.
//!
//! `SGRBG10P` is a GRBG Bayer pattern, 10 bits packed as MIPI sends them; without the `P` each
//! sample is a little-endian 16-bit word (8 bits: a byte). `Y10P`, `Y12`, ... are without colour
//! filters. Other names ([`PixelFormat::parse`]) stand for the same layouts or for the packings of
//! machine vision ([`Layout`]). The file name carries pixel format and size:
//! `flat_640x480_SGRBG10P.raw`.

mod layout;
mod names;
mod pisp;

pub use layout::Layout;

use super::{Facts, Frames, area, check_range, full_scale, truncated};
use camrig_base::{Cfa, Error, ErrorCode, Plane, Result};
use std::fmt;
use std::path::Path;

/// A headerless layout of raw pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PixelFormat {
    /// One of the four Bayer patterns, or mono.
    pub cfa: Cfa,
    /// Bits per sample: 8, 10, 12, 14 or 16.
    pub bits: u32,
    /// How samples lie in bytes.
    pub layout: Layout,
}

impl PixelFormat {
    /// Reads a name of V4L2 (`SRGGB8`, `SGRBG10`, `SBGGR12P`, `Y16`, `GREY`) or its four-character
    /// code (`pRAA`), of libcamera (`SRGGB10_CSI2P`, `R10`), of GenICam (`BayerRG12p`,
    /// `Mono12Packed`) or FFmpeg (`bayer_rggb16le`, `gray12be`). A name of words with `_BE` behind
    /// it has the high byte first.
    ///
    /// # Errors
    /// A name that is none of these.
    pub fn parse(name: &str) -> Result<Self> {
        names::find(name).ok_or_else(|| {
            Error::unsupported(format!("pixel format {name:?}")).help(
                "use V4L2's names: S + RGGB, GRBG, GBRG or BGGR, or Y, + 8, 10, 12, 14 or 16, + P \
                 for MIPI-packed, for instance SGRBG10P; or GenICam's, for instance BayerRG12p",
            )
        })
    }

    /// V4L2's four-character code of it; `None` where V4L2 has none.
    pub fn four_characters(&self) -> Option<[u8; 4]> {
        names::code(self)
    }

    /// Whether a file of this name is headerless: `.raw` and `.bin`.
    pub fn is_headerless(path: &Path) -> bool {
        let headerless =
            |e: &std::ffi::OsStr| e.eq_ignore_ascii_case("raw") || e.eq_ignore_ascii_case("bin");
        path.extension().is_some_and(headerless)
    }

    /// Pixel format, and width and height in pixels where given, from the words of a file name,
    /// separated by `_`.
    ///
    /// # Errors
    /// No word that is a pixel format, or one of a compressed kind; words of two pixel formats or
    /// sizes.
    pub fn from_file_name(path: &Path) -> Result<(Self, Option<(usize, usize)>)> {
        let stem = path.file_stem().and_then(|s| s.to_str()).unwrap_or("");
        let size = |word: &str| {
            let (w, h) = word.split_once('x')?;
            Some((w.parse::<usize>().ok()?, h.parse::<usize>().ok()?))
        };
        let words: Vec<&str> = stem.split('_').collect();
        let mut formats: Vec<(usize, String, Self)> = Vec::new();
        let mut end = words.len();
        while let Some(last) = end.checked_sub(1) {
            // Some names have underscores: SRGGB10_CSI2P, BGGR_PISP_COMP1.
            let found = (0..3).rev().find_map(|before| {
                let first = last.checked_sub(before)?;
                let name = words[first..=last].join("_");
                names::find(&name).map(|format| (first, name, format))
            });
            end = found.as_ref().map_or(last, |(first, ..)| *first);
            formats.extend(found.map(|(_, name, format)| (last, name, format)));
        }
        let Some((last, name, pixels)) = formats.first() else {
            return Err(Error::input(format!("no pixel format in the name {path:?}"))
                .help("name it like NAME_640x480_SGRBG10P.raw, or give the pixel format"));
        };
        if let Some(kind) = words.get(last + 1).filter(|word| names::is_other_layout(word)) {
            return Err(Error::unsupported(format!("pixel format {}_{kind}", words[*last]))
                .help("pixels in words, MIPI-packed, and packed as GenICam does are read"));
        }
        if let Some((_, other, _)) = formats.iter().find(|(.., format)| format != pixels) {
            return Err(ambiguous(path, "pixel formats", [other, name]));
        }
        let sizes: Vec<(&str, (usize, usize))> =
            words.iter().filter_map(|word| Some((*word, size(word)?))).collect();
        let Some((word, size)) = sizes.first() else { return Ok((pixels.clone(), None)) };
        if let Some((other, _)) = sizes.iter().find(|(_, other)| other != size) {
            return Err(ambiguous(path, "sizes", [word, other]));
        }
        Ok((pixels.clone(), Some(*size)))
    }

    /// Frames as pixels one after another. `stride` is the distance from row to row in bytes, by
    /// default the bytes of a row; bytes beyond the row are 0.
    ///
    /// # Errors
    /// Frames of another colour filter pattern, samples beyond the bits, a stride shorter than a
    /// row.
    pub fn encode(&self, frames: &Frames, stride: Option<usize>) -> Result<Vec<u8>> {
        self.check(&frames.facts)?;
        let row_bytes = self.layout.row_bytes(self.bits, frames.width())?;
        let stride = self.stride(stride, row_bytes, frames.width())?;
        let mut bytes = vec![0; stride * frames.height() * frames.planes.len()];
        let rows = frames.planes.iter().flat_map(|p| p.data.chunks_exact(p.width));
        for plane in &frames.planes {
            check_range(&plane.data, self.bits)?;
        }
        for (out, row) in bytes.chunks_exact_mut(stride).zip(rows) {
            self.layout.pack(self.bits, row, &mut out[..row_bytes])?;
        }
        Ok(bytes)
    }

    /// Bytes from row to row.
    fn stride(&self, given: Option<usize>, row_bytes: usize, width: usize) -> Result<usize> {
        /// Longest row of a file that is written or read: 16 MiB.
        const MAX_STRIDE: usize = 1 << 24;
        let stride = given.unwrap_or(row_bytes);
        if given.is_some() && !(row_bytes..=MAX_STRIDE.max(row_bytes)).contains(&stride) {
            return Err(Error::input(format!("a stride of {stride} bytes"))
                .help(format!("a row of {width} pixels in {self} takes {row_bytes}")));
        }
        Ok(stride)
    }

    /// Refuses frames of another pattern, which must not be relabelled silently. Names without
    /// colour filters also serve for patterns that have no name ([`PixelFormat::leaves_out`]).
    fn check(&self, facts: &Facts) -> Result<()> {
        let nameless = self.cfa.is_mono() && facts.cfa.as_ref().is_some_and(|c| !is_bayer(c));
        if let Some(cfa) = facts.cfa.as_ref().filter(|c| **c != self.cfa && !nameless) {
            let help = if is_bayer(cfa) {
                "choose the pixel format of the frame's own pattern"
            } else {
                "no pixel format names this pattern: choose one without colour filters, such as \
                 Y12, and tell readers the pattern"
            };
            return Err(
                Error::unsupported(format!("a frame with pattern {cfa} as {self}")).help(help)
            );
        }
        Ok(())
    }

    /// What the pixels of these facts do not say although their format's name seems to: a colour
    /// filter pattern that has no name.
    pub fn leaves_out(&self, facts: &Facts) -> Option<String> {
        let cfa = facts.cfa.as_ref().filter(|c| self.cfa.is_mono() && !c.is_mono())?;
        Some(format!(
            "the pattern {cfa} is not in the file: {self} has no colour filters, and no pixel \
             format names this pattern; tell it to readers"
        ))
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
        let row_bytes = self.layout.row_bytes(self.bits, width)?;
        let given = stride;
        let stride = self.stride(given, row_bytes, width)?;
        let frame_bytes = stride.saturating_mul(height);
        if bytes.is_empty() || !bytes.len().is_multiple_of(frame_bytes) {
            let padded = given.is_none().then(|| padded_row(bytes.len(), frame_bytes, height));
            return Err(not_whole(bytes.len(), frame_bytes, padded.flatten())
                .at(format!("frames of {width} x {height} {self}")));
        }
        let planes = bytes
            .chunks_exact(frame_bytes)
            .map(|frame| {
                let mut plane = Plane::filled(width, height, 0);
                for (y, row) in frame.chunks_exact(stride).enumerate() {
                    self.layout.unpack(self.bits, &row[..row_bytes], plane.row_mut(y))?;
                }
                check_range(&plane.data, self.bits)?;
                Ok(plane)
            })
            .collect::<Result<_>>()?;
        let notes = match self.layout {
            Layout::Pisp => vec![
                "the Raspberry Pi 5 compressed these samples with loss: in steps of 16 to 512 of \
                 65536, the larger the brighter or the busier a place is, and none below 2048"
                    .to_string(),
            ],
            _ => Vec::new(),
        };
        let (bits, cfa) = (Some(self.bits), Some(self.cfa.clone()));
        let facts = Facts { bits, cfa, notes, ..Facts::default() };
        Ok(Frames { planes, facts })
    }

    /// Commands of ffmpeg, GStreamer and V4L2 that show the pixels of `path`, to copy and paste.
    pub fn hints(&self, path: &Path, width: usize, height: usize) -> Vec<String> {
        let path = path.display();
        let order = self.cfa.to_string().to_ascii_lowercase();
        let mono = self.cfa.is_mono();
        let end = if self.layout == Layout::WordsBig { "be" } else { "le" };
        let mut hints = Vec::new();
        let row_bytes = self.layout.row_bytes(self.bits, width).unwrap_or(0);
        if matches!(self.layout, Layout::Words | Layout::WordsBig) {
            let format = match (mono, self.bits) {
                (true, 8) => "gray".into(),
                (true, bits @ (10 | 12 | 14)) => format!("gray{bits}{end}"),
                (true, _) => format!("gray16{end}"),
                (_, 8) => format!("bayer_{order}8"),
                _ => format!("bayer_{order}16{end}"),
            };
            let filter = full_scale::filter(self.bits, mono);
            hints.push(format!(
                "ffmpeg -f rawvideo -pixel_format {format} -video_size {width}x{height} -i {path}\
                 {filter} out.png"
            ));
            let caps = match (mono, self.bits) {
                (true, 8) => "video/x-raw,format=GRAY8".into(),
                (true, _) => format!("video/x-raw,format=GRAY16_{}", end.to_uppercase()),
                _ => format!("video/x-bayer,format={order}"),
            };
            let direct =
                (self.bits == 8 || mono && self.bits == 16) && row_bytes.is_multiple_of(4);
            hints.push(if direct {
                format!(
                    "gst-launch-1.0 filesrc location={path} blocksize={} ! \
                 {caps},width={width},height={height},framerate=1/1 ! ...",
                    row_bytes * height
                )
            } else {
                full_scale::through_ffmpeg(&hints[0], width, height)
            });
        }
        let whose = match self.layout {
            Layout::Words | Layout::Mipi => "V4L2 pixel format",
            _ => "pixel format",
        };
        hints.push(format!("{whose} {self}, bytesperline {row_bytes}"));
        hints
    }
}

/// The error for a name in which either of two words may count.
fn ambiguous(path: &Path, what: &str, [one, other]: [&str; 2]) -> Error {
    Error::input(format!("two {what} in the name {path:?}: {one} and {other}")).help(
        "rename the file so that it has one, like NAME_640x480_SGRBG10P.raw; convert takes \
         --from, --width and --height instead of the name's",
    )
}

/// Frames in a file of which the length of padded rows is guessed: more would be a coincidence.
const MAX_GUESSED: usize = 256;

/// Bytes from row to row, less than those of two, with which a file is whole frames; of several
/// the roundest, as rows are padded to multiples of 16, 32, 64, ... bytes.
fn padded_row(length: usize, frame_bytes: usize, height: usize) -> Option<usize> {
    (1..=(length / frame_bytes).min(MAX_GUESSED))
        .filter_map(|frames| {
            let rows = frames * height;
            length.is_multiple_of(rows).then_some(length / rows)
        })
        .filter(|row| row / 2 < frame_bytes / height)
        .max_by_key(|row| row.trailing_zeros())
}

/// The error for bytes that are not whole frames.
fn not_whole(length: usize, frame_bytes: usize, padded: Option<usize>) -> Error {
    if length < frame_bytes {
        return truncated(frame_bytes, length);
    }
    Error::input(format!("{length} bytes are no whole number of frames of {frame_bytes} bytes"))
        .help(match padded {
            Some(row) => format!(
                "are rows padded to {row} bytes? then give that as the stride; or is the file \
                 incomplete, or the size wrong?"
            ),
            None => "are size, pixel format and stride right, and is the file whole?".into(),
        })
        .with_code(ErrorCode::RowPadding)
}

/// Whether a pattern is one of the four that pixel formats name.
fn is_bayer(cfa: &Cfa) -> bool {
    cfa.height == 2 && names::BAYER.iter().any(|name| cfa.to_string() == *name)
}

impl fmt::Display for PixelFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&names::name(self))
    }
}

#[cfg(test)]
mod tests;
