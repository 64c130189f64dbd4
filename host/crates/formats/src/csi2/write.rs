//! Frames as packets.

use super::packet::Writer;
use super::{RAW, Raw, data_type};
use crate::{Frames, check_range};
use camrig_base::{Dn, Error, Plane, Result};

/// How frames are written as packets.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Options {
    /// Virtual channel, 0 to 3.
    pub virtual_channel: u8,
    /// Whether Line Start and Line End packets enclose every image line.
    pub line_packets: bool,
    /// Payloads of the embedded data lines of each frame; frames beyond the list have none.
    pub embedded: Vec<Vec<Vec<u8>>>,
    /// Frame numbers, from whose gaps a receiver sees that a frame was lost; frames beyond the list
    /// are numbered by their place, from 1.
    pub numbers: Vec<u16>,
}

/// A frame on its virtual channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Sent<'a, S = u16> {
    /// The samples, DN.
    pub plane: &'a Plane<S>,
    /// Bits per sample.
    pub bits: u32,
    /// Virtual channel, 0 to 3.
    pub virtual_channel: u8,
    /// Rows that it is late: how many rows of a frame that is not are sent before its first.
    pub late_rows: usize,
    /// Payloads of its embedded data lines.
    pub embedded: Vec<Vec<u8>>,
}

/// Frames as packets on virtual channel 0, without line packets and embedded data.
///
/// # Errors
/// Those of [`encode_together`].
pub fn encode<S: Dn>(frames: &Frames<S>) -> Result<Vec<u8>> {
    encode_with(frames, &Options::default())
}

/// Frames as packets, one after the other.
///
/// # Errors
/// Those of [`encode_together`].
pub fn encode_with<S: Dn>(frames: &Frames<S>, options: &Options) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    for (index, plane) in frames.planes.iter().enumerate() {
        let counted = (index % 65535 + 1) as u16;
        let number = options.numbers.get(index).copied().unwrap_or(counted);
        let sent = Sent {
            plane,
            bits: frames.facts.bits.unwrap_or(S::MAX_BITS),
            virtual_channel: options.virtual_channel,
            late_rows: 0,
            embedded: options.embedded.get(index).cloned().unwrap_or_default(),
        };
        bytes.extend(encode_together(&[sent], number, options.line_packets)?);
    }
    Ok(bytes)
}

/// The frames of one exposure as packets, all with the same number: their rows in turn, each frame
/// so many rows late as it says.
///
/// # Errors
/// Bits per sample other than 8, 10, 12, 14, 16, 20 or 24; lines that are not whole groups of
/// samples or exceed 65535 bytes, as CSI-2 demands; a virtual channel above 3, or two frames on
/// one; samples beyond the bits.
pub fn encode_together<S: Dn>(
    frames: &[Sent<'_, S>],
    number: u16,
    line_packets: bool,
) -> Result<Vec<u8>> {
    let raws = frames.iter().map(checked).collect::<Result<Vec<Raw>>>()?;
    for (i, frame) in frames.iter().enumerate() {
        let channel = frame.virtual_channel;
        if frames[..i].iter().any(|other| other.virtual_channel == channel) {
            return Err(Error::input(format!("two frames at once on virtual channel {channel}"))
                .help("give each capture a virtual channel of its own, 0 to 3"));
        }
    }
    let mut writer = Writer::default();
    let ends = frames.iter().map(|frame| frame.late_rows + frame.plane.height);
    for time in 0..ends.max().unwrap_or(0) {
        for (frame, raw) in frames.iter().zip(&raws) {
            let (channel, height) = (frame.virtual_channel, frame.plane.height);
            let Some(y) = time.checked_sub(frame.late_rows).filter(|y| *y < height) else {
                continue;
            };
            if y == 0 {
                writer.short(channel, data_type::FRAME_START, number);
                for payload in &frame.embedded {
                    writer.long(channel, data_type::EMBEDDED, payload)?;
                }
            }
            let line = raw.pack(frame.plane.row(y));
            let line =
                line.map_err(|e| Error::internal(format!("a line of {} bytes", e.needed)))?;
            let line_number = (y % 65535 + 1) as u16;
            if line_packets {
                writer.short(channel, data_type::LINE_START, line_number);
            }
            writer.long(channel, raw.data_type, &line)?;
            if line_packets {
                writer.short(channel, data_type::LINE_END, line_number);
            }
            if y + 1 == height {
                writer.short(channel, data_type::FRAME_END, number);
            }
        }
    }
    Ok(writer.bytes)
}

/// How the samples of a frame are packed.
fn checked<S: Dn>(frame: &Sent<'_, S>) -> Result<Raw> {
    let &Sent { plane, bits, virtual_channel, .. } = frame;
    let raw = RAW.iter().find(|raw| raw.bits == bits).ok_or_else(|| {
        Error::unsupported(format!("{bits} bits per sample for CSI-2"))
            .help("8, 10, 12, 14, 16, 20 or 24")
    })?;
    let (samples, bytes) = raw.group();
    let fits = plane.width / samples * bytes <= usize::from(u16::MAX);
    if !plane.width.is_multiple_of(samples) || !fits {
        let lines = format!("lines of {} samples of {bits} bits for CSI-2", plane.width);
        return Err(Error::limit(lines)
            .help(format!("a line is a multiple of {samples} samples and at most 65535 bytes")));
    }
    if virtual_channel > 3 {
        return Err(Error::input(format!("virtual channel {virtual_channel}")).help("0 to 3"));
    }
    check_range(&plane.data, bits)?;
    Ok(*raw)
}
