//! bayerlink, version 2: raw frames in the pixels of a display link, for receivers behind HDMI or
//! DVI. Source: PROTOCOL.md of github.com/bayerlink/bayerlink, whose text leaves implementations
//! free.
//!
//! ```text
//! line 0           48 bytes of header, then zeros
//! line 1 ..        one line of the camera each, packed, zeros after it
//! further lines    zeros
//! ```
//! A line has three bytes for each of the display's pixels. Samples are packed as V4L2's formats of
//! 8, 10, 12, 14 (packed as CSI-2 packs them) and 16 bits say, under whose four-character codes.

use super::pixel_format::Layout;
use super::{Frames, PixelFormat};
use camrig_base::{Cfa, Error, RawFrame, Result};
use std::fmt;

/// Width and height of displays, pixels, from which the smallest that holds a frame is chosen.
const MODES: [(usize, usize); 6] =
    [(1280, 720), (1920, 1080), (2560, 1440), (3840, 2160), (4096, 2160), (7680, 4320)];
const HEADER_BYTES: usize = 48;

/// The display whose pixels carry the frames: the smallest usual one, if no size is given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Display(pub Option<(usize, usize)>);

impl Display {
    /// Reads `WIDTHxHEIGHT`, of at least the header's width.
    pub fn parse(text: &str) -> Option<Self> {
        let (width, height) = text.split_once('x')?;
        let (width, height) = (width.parse().ok()?, height.parse().ok()?);
        let is_display = (HEADER_BYTES / 3..=1 << 15).contains(&width) && height <= 1 << 15;
        is_display.then_some(Self(Some((width, height))))
    }

    /// Its size for a frame.
    ///
    /// # Errors
    /// A frame that it does not hold.
    pub fn size(self, frame: &RawFrame) -> Result<(usize, usize)> {
        let bytes = (frame.width * frame.bits as usize).div_ceil(8);
        let holds = |(width, height): (usize, usize)| bytes <= 3 * width && frame.height < height;
        let sizes = self.0.as_ref().map_or(&MODES[..], std::slice::from_ref);
        sizes.iter().copied().find(|size| holds(*size)).ok_or_else(|| {
            let (width, height) = (bytes.div_ceil(3), frame.height + 1);
            Error::limit(format!(
                "{} lines of {} samples of {} bits on a display link",
                frame.height, frame.width, frame.bits
            ))
            .help(format!(
                "it takes a display of {width}x{height} at least: --to bayerlink:WIDTHxHEIGHT"
            ))
        })
    }
}

impl fmt::Display for Display {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some((width, height)) => write!(f, "bayerlink:{width}x{height}"),
            None => f.write_str("bayerlink"),
        }
    }
}

/// How samples are packed, and V4L2's four-character code of that.
fn layout(cfa: &Cfa, bits: u32) -> Result<(PixelFormat, [u8; 4])> {
    let layout = if bits == 8 || bits == 16 { Layout::Words } else { Layout::Mipi };
    let pixels = PixelFormat { cfa: cfa.clone(), bits, layout };
    // The protocol assigns none to 14 bits without filters.
    let code = pixels.four_characters().filter(|code| code != b"Y14P").ok_or_else(|| {
        Error::unsupported(format!("{bits} bits of a pattern {cfa} on a display link")).help(
            "Bayer patterns of 8, 10, 12, 14 or 16 bits, grey of 8, 10, 12 or 16: bayerlink has \
             no code for others",
        )
    })?;
    Ok((pixels, code))
}

/// The bytes of a display's pixels with a frame, whose number counts new frames.
///
/// # Errors
/// Patterns and bits without a code, lines that are not whole groups of samples, a frame that the
/// display does not hold.
pub fn encode(frame: &RawFrame, display: Display, number: u32) -> Result<Vec<u8>> {
    let (pixels, code) = layout(&frame.cfa, frame.bits)?;
    let (width, height) = display.size(frame)?;
    let line = 3 * width;
    let mut bytes = Vec::with_capacity(line * height);
    bytes.extend(b"BYLK");
    bytes.extend([2, 0, HEADER_BYTES as u8, 0]); // version, bytes of the header
    bytes.extend(code);
    for value in [frame.width as u32, frame.height as u32, number, 0] {
        bytes.extend(value.to_le_bytes()); // the last: flags
    }
    bytes.extend([0, 0, 1, 0]); // source, stripe 0 of 1
    for value in [0, frame.height as u32, 0] {
        bytes.extend(value.to_le_bytes()); // the stripe's first line, all lines
    }
    let check = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes);
    bytes.extend(check.to_le_bytes());
    bytes.resize(line, 0);
    bytes.extend(pixels.encode(&Frames::from_raw(frame), Some(line))?);
    bytes.resize(line * height, 0);
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(cfa: &str, bits: u32) -> RawFrame {
        RawFrame {
            width: 16,
            height: 8,
            bits,
            cfa: Cfa::parse(cfa).unwrap(),
            black_level_dn: 0.0,
            white_level_dn: ((1u32 << bits) - 1) as u16,
            data: (0..128).collect(),
        }
    }

    /// Header and lines by the protocol's text; the check sum is that of zlib.
    #[test]
    fn a_frame_lies_in_the_displays_pixels() {
        let display = Display::parse("16x12").unwrap();
        let bytes = encode(&frame("BGGR", 12), display, 7).unwrap();
        assert_eq!(bytes.len(), 16 * 12 * 3);
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        assert_eq!((word(0), word(4)), (0x4B4C_5942, 48 << 16 | 2));
        assert_eq!(&bytes[8..12], b"pBCC");
        let fields = [12, 16, 20, 24, 28, 32, 36, 40].map(word);
        assert_eq!(fields, [16, 8, 7, 0, 1 << 16, 0, 8, 0]);
        assert_eq!(word(44), 0x07CA_F80E);
        // Samples 16 to 19: their upper bits are 1, the lower in the third byte, first sample low.
        assert_eq!(bytes[2 * 48..][..6], [1, 1, 0x10, 1, 1, 0x32]);
        assert!(bytes[48 + 24..2 * 48].iter().chain(&bytes[9 * 48..]).all(|byte| *byte == 0));
    }

    #[test]
    fn the_smallest_display_is_chosen_and_what_none_holds_is_refused() {
        let of = |width: usize, height: usize| {
            let frame =
                RawFrame { width, height, data: vec![0; width * height], ..frame("mono", 12) };
            Display(None).size(&frame)
        };
        assert_eq!(of(752, 480).unwrap(), (1280, 720));
        assert_eq!(of(2028, 1078).unwrap(), (1920, 1080));
        assert_eq!(of(1920, 1080).unwrap(), (2560, 1440));
        let said = of(20000, 100).unwrap_err().to_string();
        assert!(said.contains("10000x101"), "{said}");
        for (cfa, bits) in [("RCCC", 12), ("mono", 14), ("RGGB", 9)] {
            let said = encode(&frame(cfa, bits), Display(None), 0).unwrap_err().to_string();
            assert!(said.contains("no code"), "{said}");
        }
        for text in ["", "16", "15x9", "16x", "99999x9"] {
            assert_eq!(Display::parse(text), None, "{text}");
        }
    }
}
