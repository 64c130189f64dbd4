//! YUV4MPEG2 (`.y4m`), the uncompressed video of the mjpegtools that players and encoders read: a
//! line of text, then frames, each after the word `FRAME`. Source: yuv4mpeg(5); `Cmono10` and the
//! other depths of grey, `XCOLORRANGE` as FFmpeg's `libavformat/yuv4mpegenc.c` writes them.
//!
//! It has grey pictures and those of YCbCr, and nothing for a colour filter pattern: only frames
//! of a sensor without one are written. 8, 9, 10, 12 and 16 bits have a name; samples of others
//! are written as 16 bits at full scale ([`crate::live`]).

use super::{Facts, Frames, check_range};
use camrig_base::{Error, RawFrame, Result};

/// Depths of grey that have a name, bits.
const DEPTHS: [u32; 5] = [8, 9, 10, 12, 16];

/// The depth as which samples of `bits` bits are written.
pub fn depth(bits: u32) -> u32 {
    if DEPTHS.contains(&bits) { bits } else { 16 }
}

/// The line before the first frame. Without a frame rate (frames per second) it is said to be
/// unknown, as 0:0.
///
/// # Errors
/// Frames with colour filters; a depth without a name.
pub fn header(
    width: usize,
    height: usize,
    facts: &Facts,
    frames_per_s: Option<f64>,
) -> Result<Vec<u8>> {
    if let Some(cfa) = facts.cfa.as_ref().filter(|cfa| !cfa.is_mono()) {
        return Err(Error::unsupported(format!("Y4M of a sensor with colour filters ({cfa})"))
            .help(
                "it has no colour filter patterns; use headerless pixels, such as SRGGB8, or csi2",
            ));
    }
    let bits = facts.bits.unwrap_or(16);
    let depth = match bits {
        8 => String::new(),
        _ if DEPTHS.contains(&bits) => bits.to_string(),
        _ => {
            return Err(Error::unsupported(format!("{bits} bits per sample for Y4M"))
                .help("8, 9, 10, 12 or 16"));
        }
    };
    let rate = match frames_per_s {
        None => "0:0".into(),
        Some(whole) if whole.fract() == 0.0 => format!("{whole}:1"),
        Some(rate) => format!("{}:1000", (rate * 1000.0).round().max(1.0)),
    };
    let text =
        format!("YUV4MPEG2 W{width} H{height} F{rate} Ip A1:1 Cmono{depth} XCOLORRANGE=FULL\n");
    Ok(text.into_bytes())
}

/// A frame behind the header: samples of more than 8 bits take two bytes, low byte first.
///
/// # Errors
/// Samples beyond the bits.
pub fn frame(samples: &[u16], bits: u32) -> Result<Vec<u8>> {
    check_range(samples, bits)?;
    let mut bytes = b"FRAME\n".to_vec();
    if bits == 8 {
        bytes.extend(samples.iter().map(|&dn| dn as u8));
    } else {
        bytes.extend(samples.iter().flat_map(|dn| dn.to_le_bytes()));
    }
    Ok(bytes)
}

/// A whole stream of frames.
///
/// # Errors
/// Those of [`header`] and [`frame`].
pub fn encode(frames: &Frames) -> Result<Vec<u8>> {
    let mut bytes = header(frames.width(), frames.height(), &frames.facts, None)?;
    for plane in &frames.planes {
        bytes.extend(frame(&plane.data, frames.facts.bits.unwrap_or(16))?);
    }
    Ok(bytes)
}

/// The line before a frame of a live stream.
pub(crate) fn live_header(like: &RawFrame, frames_per_s: Option<f64>) -> Result<Vec<u8>> {
    header(like.width, like.height, &Facts::of(like), frames_per_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Cfa;

    fn grey(bits: u32) -> RawFrame {
        RawFrame {
            width: 2,
            height: 2,
            bits,
            cfa: Cfa::parse("mono").unwrap(),
            black_level_dn: 0.0,
            white_level_dn: 255,
            data: vec![1, 2, 3, 255],
        }
    }

    #[test]
    fn streams_are_laid_out_as_published() {
        let bytes = encode(&Frames::from_raw(&grey(8))).unwrap();
        let head = b"YUV4MPEG2 W2 H2 F0:0 Ip A1:1 Cmono XCOLORRANGE=FULL\n";
        assert_eq!(bytes, [&head[..], b"FRAME\n\x01\x02\x03\xff"].concat());
        let bytes = encode(&Frames::from_raw(&grey(10))).unwrap();
        let head = b"YUV4MPEG2 W2 H2 F0:0 Ip A1:1 Cmono10 XCOLORRANGE=FULL\n";
        assert_eq!(bytes, [&head[..], b"FRAME\n\x01\0\x02\0\x03\0\xff\0"].concat());
        for (rate, text) in [(30.0, " F30:1 "), (29.97, " F29970:1000 ")] {
            let head = live_header(&grey(12), Some(rate)).unwrap();
            assert!(String::from_utf8(head).unwrap().contains(text));
        }
    }

    #[test]
    fn a_mosaic_is_not_passed_off_as_a_grey_picture() {
        let bayer = RawFrame { cfa: Cfa::parse("RGGB").unwrap(), ..grey(8) };
        let said = encode(&Frames::from_raw(&bayer)).unwrap_err().to_string();
        assert!(said.contains("colour filters (RGGB)"), "{said}");
        assert!(encode(&Frames::from_raw(&grey(14))).is_err());
        assert_eq!([8, 10, 11, 14].map(depth), [8, 10, 16, 16]);
    }
}
