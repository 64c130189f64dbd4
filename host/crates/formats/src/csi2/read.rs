//! Packets as frames.

use super::{Packet, Packets, RAW, Raw, data_type};
use crate::{Facts, Frames};
use camrig_base::{Dn, Error, Plane, Result};

/// What a packet stream holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Stream<S = u16> {
    /// Its virtual channels with image lines, by their number.
    pub channels: Vec<Channel<S>>,
    /// Number of packet headers with a corrected bit.
    pub corrected_headers: usize,
}

/// What a virtual channel holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel<S = u16> {
    /// Its number, 0 to 3.
    pub virtual_channel: u8,
    /// The image lines, assembled to frames.
    pub frames: Frames<S>,
    /// Frame numbers as the stream gives them: 1 to 65535, then 1 again; 0 where not in use.
    pub frame_numbers: Vec<u16>,
    /// Payloads of the embedded data lines of each frame.
    pub embedded: Vec<Vec<Vec<u8>>>,
}

/// Whether bytes begin with a Frame Start and another packet, both without an error.
pub(crate) fn is_stream(bytes: &[u8]) -> bool {
    let mut packets = Packets::new(bytes);
    let mut next = || packets.next()?.ok().filter(|packet| !packet.corrected);
    let first = next().is_some_and(|p| p.data_type == data_type::FRAME_START);
    first && next().is_some()
}

/// Whether the first image line has samples of more than 16 bits.
pub(crate) fn is_wide(bytes: &[u8]) -> bool {
    let packets = Packets::new(bytes).map_while(Result::ok);
    let mut raws = packets.filter_map(|packet| raw(&packet));
    raws.next().is_some_and(|raw| raw.bits > u16::BITS)
}

fn raw(packet: &Packet<'_>) -> Option<&'static Raw> {
    RAW.iter().find(|raw| raw.data_type == packet.data_type)
}

/// Reads the frames of a stream of one virtual channel.
///
/// # Errors
/// Those of [`decode_stream`]; several virtual channels.
pub fn decode<S: Dn>(bytes: &[u8]) -> Result<Frames<S>> {
    let mut channels = decode_stream(bytes)?.channels;
    if channels.len() > 1 {
        let numbers: Vec<String> =
            channels.iter().map(|c| c.virtual_channel.to_string()).collect();
        return Err(Error::unsupported(format!(
            "virtual channels {} in one CSI-2 stream, where one is read",
            numbers.join(", ")
        ))
        .help("take one out first: camrig convert IN OUT --virtual-channel N"));
    }
    Ok(channels.swap_remove(0).frames)
}

/// Reads the frames of a virtual channel.
///
/// # Errors
/// Those of [`decode_stream`]; a channel without frames.
pub fn decode_channel<S: Dn>(bytes: &[u8], virtual_channel: u8) -> Result<Frames<S>> {
    let channels = decode_stream(bytes)?.channels;
    let numbers: Vec<String> = channels.iter().map(|c| c.virtual_channel.to_string()).collect();
    let found = channels.into_iter().find(|c| c.virtual_channel == virtual_channel);
    found.map(|channel| channel.frames).ok_or_else(|| {
        Error::input(format!("no frames on virtual channel {virtual_channel}"))
            .help(format!("there are frames on {}", numbers.join(", ")))
    })
}

/// Reads a whole packet stream: the frames, frame numbers and embedded data of each virtual
/// channel. Packets of other data types (blanking, user-defined) are skipped.
///
/// # Errors
/// Damaged packets, frames of a channel without image lines or of different sizes or data types,
/// samples of more bits than the type holds, a stream without a complete frame.
pub fn decode_stream<S: Dn>(bytes: &[u8]) -> Result<Stream<S>> {
    let mut corrected_headers = 0;
    let mut readers: [Reader<S>; 4] = Default::default();
    for packet in Packets::new(bytes) {
        let packet = packet?;
        corrected_headers += usize::from(packet.corrected);
        let channel = packet.virtual_channel;
        let reader = &mut readers[usize::from(channel)];
        reader.take(&packet).map_err(|e| e.at(format!("virtual channel {channel}")))?;
    }
    let of_all =
        (0..).zip(readers).filter(|(_, reader)| reader.open.is_some() || reader.has_any());
    let channels = of_all.map(|(number, reader)| reader.finish(number));
    let channels = channels.collect::<Result<Vec<_>>>()?;
    if channels.is_empty() {
        return Err(no_whole_frame());
    }
    Ok(Stream { channels, corrected_headers })
}

fn no_whole_frame() -> Error {
    Error::input("a CSI-2 stream without a whole frame").help("truncated?")
}

/// What is read of a virtual channel.
#[derive(Default)]
struct Reader<S> {
    /// The frame that has begun.
    open: Option<Plane<S>>,
    planes: Vec<Plane<S>>,
    raw: Option<Raw>,
    numbers: Vec<u16>,
    embedded: Vec<Vec<Vec<u8>>>,
}

impl<S: Dn> Reader<S> {
    fn has_any(&self) -> bool {
        !self.planes.is_empty()
    }

    fn take(&mut self, packet: &Packet<'_>) -> Result<()> {
        match packet.data_type {
            data_type::FRAME_START => {
                if self.open.is_some() {
                    return Err(Error::input("a CSI-2 Frame Start before the last frame's end"));
                }
                self.numbers.push(packet.value);
                self.embedded.push(Vec::new());
                self.open = Some(Plane { width: 0, height: 0, data: Vec::new() });
            }
            data_type::FRAME_END => match self.open.take() {
                Some(plane) if plane.height > 0 => self.push(plane)?,
                _ => return Err(Error::input("a CSI-2 frame without image lines")),
            },
            data_type::EMBEDDED => {
                if let Some(lines) = self.embedded.last_mut().filter(|_| self.open.is_some()) {
                    lines.push(packet.payload.to_vec());
                }
            }
            _ => {
                if let Some(raw) = raw(packet) {
                    self.line(raw, packet.payload)?;
                }
            }
        }
        Ok(())
    }

    /// Appends an image line to the frame being read.
    fn line(&mut self, raw: &Raw, payload: &[u8]) -> Result<()> {
        let plane = self.open.as_mut();
        let plane = plane.ok_or_else(|| Error::input("a CSI-2 image line outside a frame"))?;
        if *self.raw.get_or_insert(*raw) != *raw {
            return Err(Error::unsupported("CSI-2 image lines of different data types"));
        }
        if raw.bits > S::MAX_BITS {
            return Err(Error::unsupported(format!("samples of {} bits", raw.bits))
                .help("convert them to .npy or .tiff with 32 bits: camrig convert"));
        }
        let (samples, bytes) = raw.group();
        let width = payload.len() / bytes * samples;
        if width == 0
            || !payload.len().is_multiple_of(bytes)
            || (plane.height > 0 && width != plane.width)
        {
            return Err(Error::input(format!("a CSI-2 image line of {} bytes", payload.len()))
                .help("lines of a frame are whole groups of samples and of one length"));
        }
        let row = raw.unpack(payload);
        let row = row.map_err(|e| Error::internal(format!("a line of {} bytes", e.found)))?;
        plane.width = width;
        plane.height += 1;
        plane.data.extend(row.into_iter().filter_map(|dn| S::of(dn.into())));
        Ok(())
    }

    fn push(&mut self, plane: Plane<S>) -> Result<()> {
        let size = |p: &Plane<S>| (p.width, p.height);
        if self.planes.first().is_some_and(|first| size(first) != size(&plane)) {
            return Err(Error::unsupported("CSI-2 frames of different sizes in one stream"));
        }
        self.planes.push(plane);
        Ok(())
    }

    fn finish(self, virtual_channel: u8) -> Result<Channel<S>> {
        if self.open.is_some() || self.planes.is_empty() {
            return Err(no_whole_frame());
        }
        let facts = Facts { bits: self.raw.map(|raw| raw.bits), ..Facts::default() };
        let frames = Frames { planes: self.planes, facts };
        let (frame_numbers, embedded) = (self.numbers, self.embedded);
        Ok(Channel { virtual_channel, frames, frame_numbers, embedded })
    }
}
