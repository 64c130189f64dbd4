//! Packets as frames.

use super::packet::Fault;
use super::{Packet, Packets, RAW, Raw, data_type};
use crate::{Facts, Frames};
use camrig_base::{Dn, Error, Plane, Result};
use std::collections::BTreeMap;
use std::fmt;

/// What a packet stream holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Stream<S = u16> {
    /// Its virtual channels with frames, by their number.
    pub channels: Vec<Channel<S>>,
    /// What is wrong with it, in its order.
    pub faults: Vec<Damaged>,
}

/// What a virtual channel holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel<S = u16> {
    /// Its number, 0 to 3.
    pub virtual_channel: u8,
    /// The image lines, assembled to frames.
    pub frames: Frames<S>,
    /// Frame numbers as the stream gives them: 1 to 65535, then 1 again; 0 where not in use, and
    /// of a frame without Frame Start.
    pub frame_numbers: Vec<u16>,
    /// Payloads of the embedded data lines of each frame.
    pub embedded: Vec<Vec<Vec<u8>>>,
}

/// Something wrong in a stream, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damaged {
    /// Byte of the stream.
    pub at: usize,
    /// Virtual channel; that of the packet before, where a packet is lost.
    pub virtual_channel: u8,
    /// Frame of the channel, counted from 0.
    pub frame: usize,
    /// Image line, counted from 0.
    pub row: Option<usize>,
    /// What is wrong.
    pub wrong: Wrong,
}

/// What is wrong in a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrong {
    /// A packet.
    Packet(Fault),
    /// A line number without its line.
    NoPacket,
    /// A line of another length than most.
    Length {
        /// Its bytes.
        found: usize,
        /// Bytes of the others.
        usual: usize,
    },
    /// A line of another data type than most.
    DataType {
        /// Its data type.
        found: u8,
        /// That of the others.
        usual: u8,
    },
    /// A frame of fewer lines than the longest.
    Lines {
        /// Its lines.
        found: usize,
        /// Those of the longest.
        usual: usize,
    },
    /// An image line before a Frame Start.
    NoFrameStart,
    /// No Frame End before the next Frame Start, or the end of the stream.
    NoFrameEnd,
}

impl Damaged {
    /// Whether nothing is lost: an error that was corrected.
    pub fn is_corrected(&self) -> bool {
        self.wrong == Wrong::Packet(Fault::HeaderBit)
    }
}

impl fmt::Display for Damaged {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.virtual_channel > 0 {
            write!(f, "virtual channel {}, ", self.virtual_channel)?;
        }
        write!(f, "frame {}", self.frame)?;
        if let Some(row) = self.row {
            write!(f, ", row {row}")?;
        }
        write!(f, " (byte {}): ", self.at)?;
        match self.wrong {
            Wrong::Packet(Fault::HeaderBit) => write!(f, "one wrong bit in a header, corrected"),
            Wrong::Packet(Fault::Header { lost }) => {
                write!(f, "more than one wrong bit in a header, {lost} bytes lost")
            }
            Wrong::Packet(Fault::Checksum) => write!(f, "the checksum does not hold"),
            Wrong::Packet(Fault::WordCount { stated, lost }) => write!(
                f,
                "the word count {stated} is wrong: packets go on after {lost} bytes, which are lost"
            ),
            Wrong::Packet(Fault::Truncated { missing }) => {
                write!(f, "the stream is truncated, {missing} bytes of a packet are missing")
            }
            Wrong::NoPacket => write!(f, "no packet between Line Start and Line End"),
            Wrong::Length { found, usual } => write!(f, "a line of {found} bytes, not {usual}"),
            Wrong::DataType { found, usual } => {
                write!(f, "a line of data type {found:#04x}, not {usual:#04x}")
            }
            Wrong::Lines { found, usual } => write!(f, "{found} lines, not {usual}"),
            Wrong::NoFrameStart => write!(f, "image lines without a Frame Start"),
            Wrong::NoFrameEnd => write!(f, "no Frame End"),
        }
    }
}

/// Whether bytes begin with packets that follow one another.
pub(crate) fn is_stream(bytes: &[u8]) -> bool {
    Packets::new(bytes).begin_at(0)
}

/// Whether the first image line has samples of more than 16 bits.
pub fn is_wide(bytes: &[u8]) -> bool {
    let mut raws = Packets::new(bytes).filter_map(|found| raw(&found.packet?));
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
    decode_stream(bytes)?.only()
}

/// Reads a whole packet stream: the frames, frame numbers and embedded data of each virtual
/// channel. Packets of other data types (blanking, user-defined) are skipped.
///
/// # Errors
/// Everything in a stream that is wrong and was not corrected; those of [`decode_damaged`].
pub fn decode_stream<S: Dn>(bytes: &[u8]) -> Result<Stream<S>> {
    let stream = decode_damaged(bytes)?;
    let faults = || stream.faults.iter().filter(|fault| !fault.is_corrected());
    match faults().count() {
        0 => Ok(stream),
        count => {
            let said = faults().take(MAX_SAID).map(|fault| format!("\n  {fault}"));
            let rest = count.saturating_sub(MAX_SAID);
            let rest = (rest > 0).then(|| format!("\n  and {rest} more"));
            let said: String = said.chain(rest).collect();
            Err(Error::input(format!("damaged CSI-2 packets:{said}")))
        }
    }
}

/// Faults that a message lists.
const MAX_SAID: usize = 20;

/// Reads a packet stream of which some is wrong, and says what. Lines that are lost are zero;
/// those whose checksum does not hold are as they came.
///
/// # Errors
/// A stream without frames, or with more lost than received; frames of a channel of different
/// sizes, samples of more bits than the type holds.
pub fn decode_damaged<S: Dn>(bytes: &[u8]) -> Result<Stream<S>> {
    let mut readers: [Reader<'_>; 4] = Default::default();
    let mut faults = Vec::new();
    let mut last = 0;
    for found in Packets::new(bytes) {
        let channel = found.packet.map_or(last, |packet| packet.virtual_channel);
        last = channel;
        let reader = &mut readers[usize::from(channel)];
        let place = reader.place(found.at, channel, found.packet.as_ref());
        if let Some(fault) = found.fault {
            faults.push(Damaged { wrong: Wrong::Packet(fault), ..place });
        }
        let wrong = match found.packet {
            Some(packet) => reader.take(found.at, &packet),
            None => {
                reader.lose(found.at, found.fault);
                None
            }
        };
        faults.extend(wrong.map(|wrong| Damaged { wrong, ..place }));
    }
    let mut channels = Vec::new();
    for (number, mut reader) in (0..).zip(readers) {
        if reader.is_open && reader.frames.last().is_some_and(|frame| frame.is_marked) {
            let place = reader.place(bytes.len(), number, None);
            faults.push(Damaged { row: None, wrong: Wrong::NoFrameEnd, ..place });
        }
        // Lines without the begin or end of a frame have strayed from another channel.
        reader.frames.retain(|frame| frame.is_marked);
        let frames = reader.finish(number, &mut faults);
        channels.extend(frames.map_err(|e| e.at(format!("virtual channel {number}")))?);
    }
    if channels.is_empty() {
        let faults = faults.first().map(Damaged::to_string);
        return Err(Error::input("a CSI-2 stream without a whole frame")
            .help(faults.unwrap_or("truncated?".to_string())));
    }
    faults.sort_by_key(|fault| fault.at);
    Ok(Stream { channels, faults })
}

impl<S: Dn> Stream<S> {
    /// The frames of its one virtual channel.
    ///
    /// # Errors
    /// Several virtual channels.
    pub fn only(mut self) -> Result<Frames<S>> {
        if self.channels.len() > 1 {
            return Err(Error::unsupported(format!(
                "virtual channels {} in one CSI-2 stream, where one is read",
                self.numbers()
            ))
            .help("take one out first: camrig convert IN OUT --virtual-channel N"));
        }
        Ok(self.channels.swap_remove(0).frames)
    }

    /// The frames of a virtual channel.
    ///
    /// # Errors
    /// A channel without frames.
    pub fn channel(self, virtual_channel: u8) -> Result<Frames<S>> {
        let numbers = self.numbers();
        let found = self.channels.into_iter().find(|c| c.virtual_channel == virtual_channel);
        found.map(|channel| channel.frames).ok_or_else(|| {
            Error::input(format!("no frames on virtual channel {virtual_channel}"))
                .help(format!("there are frames on {numbers}"))
        })
    }

    fn numbers(&self) -> String {
        let numbers = self.channels.iter().map(|c| c.virtual_channel.to_string());
        numbers.collect::<Vec<_>>().join(", ")
    }
}

/// An image line: its place, and its packing and payload unless it is lost.
struct Line<'a> {
    at: usize,
    found: Option<(&'static Raw, &'a [u8])>,
    /// Bytes of the stream that are lost with it.
    lost: usize,
}

/// The lines of a frame.
#[derive(Default)]
struct Lines<'a> {
    at: usize,
    number: u16,
    /// Whether there is a Frame Start or a Frame End.
    is_marked: bool,
    embedded: Vec<Vec<u8>>,
    lines: Vec<Line<'a>>,
}

/// What is read of a virtual channel.
#[derive(Default)]
struct Reader<'a> {
    frames: Vec<Lines<'a>>,
    /// Whether the last frame has not ended.
    is_open: bool,
}

impl<'a> Reader<'a> {
    /// The place of a packet, or of one that is lost.
    fn place(&self, at: usize, virtual_channel: u8, packet: Option<&Packet<'_>>) -> Damaged {
        let begun = self.frames.last().filter(|_| self.is_open);
        let is_line =
            |packet: &Packet<'_>| packet.data_type == data_type::LINE_END || raw(packet).is_some();
        let is_line = packet.is_none_or(is_line);
        Damaged {
            at,
            virtual_channel,
            frame: self.frames.len() - usize::from(begun.is_some()),
            row: is_line.then(|| begun.map_or(0, |frame| frame.lines.len())),
            wrong: Wrong::NoPacket,
        }
    }

    /// The frame that has begun, or one that begins at a place.
    fn open(&mut self, at: usize) -> &mut Lines<'a> {
        if !self.is_open || self.frames.is_empty() {
            self.frames.push(Lines { at, ..Lines::default() });
            self.is_open = true;
        }
        let last = self.frames.len() - 1;
        &mut self.frames[last]
    }

    /// Takes a packet, and says what is wrong with the order.
    fn take(&mut self, at: usize, packet: &Packet<'a>) -> Option<Wrong> {
        let was_open = self.is_open;
        match packet.data_type {
            data_type::FRAME_START => {
                self.is_open = false;
                let frame = self.open(at);
                (frame.number, frame.is_marked) = (packet.value, true);
                was_open.then_some(Wrong::NoFrameEnd)
            }
            data_type::FRAME_END => {
                self.open(at).is_marked = true;
                self.is_open = false;
                (!was_open).then_some(Wrong::NoFrameStart)
            }
            data_type::LINE_END if was_open => {
                let lines = &mut self.open(at).lines;
                let is_missing = usize::from(packet.value) == lines.len() + 1;
                is_missing.then(|| {
                    lines.push(Line { at, found: None, lost: usize::MAX });
                    Wrong::NoPacket
                })
            }
            data_type::EMBEDDED => {
                if was_open {
                    self.open(at).embedded.push(packet.payload.to_vec());
                }
                None
            }
            _ => raw(packet).and_then(|raw| {
                let found = Some((raw, packet.payload));
                self.open(at).lines.push(Line { at, found, lost: 0 });
                (!was_open).then_some(Wrong::NoFrameStart)
            }),
        }
    }

    /// A packet is lost: an image line, once there are as many embedded lines as before.
    fn lose(&mut self, at: usize, fault: Option<Fault>) {
        let lost = match fault {
            Some(Fault::Header { lost } | Fault::WordCount { lost, .. }) => lost,
            _ => 0,
        };
        let embedded = |frame: &Lines<'_>| frame.embedded.len();
        let before = self.frames.iter().nth_back(1).map_or(0, embedded);
        if self.is_open && self.frames.last().map_or(0, embedded) >= before {
            self.open(at).lines.push(Line { at, found: None, lost });
        }
    }

    /// The frames, and what is wrong with their lines.
    fn finish<S: Dn>(
        mut self,
        virtual_channel: u8,
        faults: &mut Vec<Damaged>,
    ) -> Result<Option<Channel<S>>> {
        let mut kinds = BTreeMap::<(u8, usize), usize>::new();
        let all = || self.frames.iter().flat_map(|frame| &frame.lines);
        for (raw, payload) in all().filter_map(|line| line.found) {
            *kinds.entry((raw.data_type, payload.len())).or_default() += 1;
        }
        let most = kinds.iter().max_by_key(|(_, count)| **count);
        let Some((&(usual_type, usual), &whole)) = most else { return Ok(None) };
        let Some(raw) = RAW.iter().find(|raw| raw.data_type == usual_type) else {
            return Ok(None);
        };
        if raw.bits > S::MAX_BITS {
            return Err(Error::unsupported(format!("samples of {} bits", raw.bits))
                .help("convert them to .npy or .tiff with 32 bits: camrig convert"));
        }
        let (samples, bytes) = raw.group();
        if usual == 0 || !usual.is_multiple_of(bytes) {
            return Err(Error::input(format!("a CSI-2 image line of {usual} bytes"))
                .help(format!("a line is whole groups of {bytes} bytes")));
        }
        // A short packet that is lost is no line.
        for frame in &mut self.frames {
            frame.lines.retain(|line| line.found.is_some() || line.lost >= usual);
        }
        let width = usual / bytes * samples;
        let height = self.frames.iter().map(|frame| frame.lines.len()).max().unwrap_or(0);
        // What a few packets can ask for is bounded by what they bring.
        if self.frames.len() * height > 2 * whole {
            return Err(Error::input(format!(
                "{whole} lines of {usual} bytes, of {} frames of {height} lines",
                self.frames.len()
            ))
            .help("frames of one size are read of which at least half is there"));
        }
        let mut planes = Vec::new();
        for (index, frame) in self.frames.iter().enumerate() {
            let mut data = vec![S::of(0).unwrap_or_default(); width * height];
            let place = Damaged {
                at: frame.at,
                virtual_channel,
                frame: index,
                row: None,
                wrong: Wrong::Lines { found: frame.lines.len(), usual: height },
            };
            if frame.lines.len() < height {
                faults.push(place.clone());
            }
            let rows = data.chunks_mut(width).zip(&frame.lines).enumerate();
            for (row, (samples, line)) in rows {
                let Some((of, payload)) = line.found else { continue };
                let wrong = match () {
                    () if of.data_type != usual_type => {
                        Some(Wrong::DataType { found: of.data_type, usual: usual_type })
                    }
                    () if payload.len() != usual => {
                        Some(Wrong::Length { found: payload.len(), usual })
                    }
                    () => None,
                };
                if let Some(wrong) = wrong {
                    faults.push(Damaged { at: line.at, row: Some(row), wrong, ..place.clone() });
                    continue;
                }
                let values = raw.unpack(payload);
                let values =
                    values.map_err(|e| Error::internal(format!("a line of {} bytes", e.found)))?;
                for (sample, dn) in samples.iter_mut().zip(values) {
                    *sample = S::of(dn.into()).unwrap_or(*sample);
                }
            }
            planes.push(Plane { width, height, data });
        }
        let facts = Facts { bits: Some(raw.bits), ..Facts::default() };
        let (frame_numbers, embedded) =
            self.frames.into_iter().map(|frame| (frame.number, frame.embedded)).unzip();
        let frames = Frames { planes, facts };
        Ok(Some(Channel { virtual_channel, frames, frame_numbers, embedded }))
    }
}
