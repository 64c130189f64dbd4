//! MIPI CSI-2 packets as bytes: what a receiver delivers after merging the lanes of a D-PHY link.
//!
//! A frame consists of Frame Start, embedded data lines, image lines (one long packet each, on
//! request between Line Start and Line End) and Frame End. Source: MIPI CSI-2 v1.3, chapter 9
//! (packet header, ECC, CRC) and 11 (data types); 2-bit virtual channels.
//!
//! The reader corrects single-bit errors of packet headers, as the ECC allows, and refuses worse
//! ones and payloads with a wrong CRC.

use super::{Facts, Frames, check_range, truncated};
use camrig_base::{Error, Plane, Result};
use camrig_packing::{Packing, pack_row, unpack_row};

/// Data types: the low six bits of a packet's first byte.
mod data_type {
    pub const FRAME_START: u8 = 0x00;
    pub const FRAME_END: u8 = 0x01;
    pub const LINE_START: u8 = 0x02;
    pub const LINE_END: u8 = 0x03;
    /// Packets of lower data types are short.
    pub const FIRST_LONG: u8 = 0x10;
    pub const EMBEDDED: u8 = 0x12;
}

/// Data types of RAW8, RAW10, RAW12, RAW14 and RAW16, and their packing.
const RAW: [(u8, Packing); 5] = [
    (0x2A, Packing::Raw8),
    (0x2B, Packing::Raw10),
    (0x2C, Packing::Raw12),
    (0x2D, Packing::Raw14),
    (0x2E, Packing::Raw16),
];

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

/// What a packet stream holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Stream {
    /// The image lines, assembled to frames.
    pub frames: Frames,
    /// Frame numbers as the stream gives them: 1 to 65535, then 1 again; 0 where not in use.
    pub frame_numbers: Vec<u16>,
    /// Payloads of the embedded data lines of each frame.
    pub embedded: Vec<Vec<Vec<u8>>>,
    /// Number of packet headers with a corrected bit.
    pub corrected_headers: usize,
}

/// One packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// Virtual channel, 0 to 3.
    pub virtual_channel: u8,
    /// Data type, 6 bits.
    pub data_type: u8,
    /// Frame or line number of a short packet, payload length in bytes of a long one.
    pub value: u16,
    /// Payload of a long packet, empty for a short one.
    pub payload: &'a [u8],
    /// Whether a bit of the header was corrected.
    pub corrected: bool,
}

/// Parity of the header's 24 bits for each of the six ECC bits (CSI-2 v1.3, table 6).
const ECC_MASKS: [u32; 6] = [0xF1_2CB7, 0xF2_555B, 0x74_9A6D, 0xB8_E38E, 0xDF_03F0, 0xEF_FC00];

/// ECC of a packet header: its data identifier and its 16-bit field.
pub fn ecc(data_identifier: u8, value: u16) -> u8 {
    let header = u32::from(value) << 8 | u32::from(data_identifier);
    let parity = |mask: u32| ((header & mask).count_ones() & 1) as u8;
    ECC_MASKS.iter().enumerate().fold(0, |ecc, (bit, &mask)| ecc | parity(mask) << bit)
}

/// Checksum (CRC-16) of a payload, sent least significant byte first.
pub fn checksum(payload: &[u8]) -> u16 {
    crc::Crc::<u16>::new(&crc::CRC_16_MCRF4XX).checksum(payload)
}

/// A header with a single-bit error corrected, and whether it had one. `None` for more errors.
fn correct(header: [u8; 4]) -> Option<([u8; 3], bool)> {
    let [id, low, high, found] = header;
    let syndrome = (ecc(id, u16::from_le_bytes([low, high])) ^ found) & 0x3F;
    if syndrome.count_ones() <= 1 {
        // Nothing wrong, or one bit of the ECC itself.
        return Some(([id, low, high], syndrome != 0));
    }
    let bit = (0..24).find(|&bit| {
        let column = |mask: &u32| (mask >> bit & 1) as u8;
        ECC_MASKS.iter().enumerate().fold(0, |s, (i, m)| s | column(m) << i) == syndrome
    })?;
    let mut fixed = [id, low, high];
    fixed[bit / 8] ^= 1 << (bit % 8);
    Some((fixed, true))
}

/// Iterator over the packets of a stream; ends after the first error.
pub struct Packets<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Packets<'a> {
    /// Packets of `bytes` from the start.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    fn read(&mut self) -> Result<Packet<'a>> {
        let rest = &self.bytes[self.at..];
        let short = || truncated(self.at + rest.len() + 1, self.bytes.len());
        let header = rest.first_chunk::<4>().ok_or_else(short)?;
        let ([id, low, high], corrected) = correct(*header).ok_or_else(|| {
            Error::input("a CSI-2 packet header with more than one wrong bit")
                .help("the stream is damaged, or no CSI-2 packet stream")
        })?;
        let value = u16::from_le_bytes([low, high]);
        let (virtual_channel, data_type) = (id >> 6, id & 0x3F);
        let mut payload = &rest[..0];
        if data_type >= data_type::FIRST_LONG {
            let length = usize::from(value);
            payload = rest.get(4..4 + length).ok_or_else(short)?;
            let footer = rest.get(4 + length..6 + length).ok_or_else(short)?;
            if checksum(payload).to_le_bytes() != footer {
                return Err(Error::input("a CSI-2 payload whose checksum does not hold"));
            }
            self.at += length + 2;
        }
        self.at += 4;
        Ok(Packet { virtual_channel, data_type, value, payload, corrected })
    }
}

impl<'a> Iterator for Packets<'a> {
    type Item = Result<Packet<'a>>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.at >= self.bytes.len() {
            return None;
        }
        let at = self.at;
        let packet = self.read().map_err(|e| e.at(format!("byte {at}")));
        if packet.is_err() {
            self.at = self.bytes.len();
        }
        Some(packet)
    }
}

/// Whether bytes begin with a Frame Start and another packet, both without an error.
pub(super) fn is_stream(bytes: &[u8]) -> bool {
    let mut packets = Packets::new(bytes);
    let starts = |p: Option<Result<Packet>>, first: bool| {
        p.is_some_and(|p| {
            p.is_ok_and(|p| !p.corrected && (p.data_type == data_type::FRAME_START) == first)
        })
    };
    starts(packets.next(), true) && starts(packets.next(), false)
}

/// Frames as packets on virtual channel 0, without line packets and embedded data.
///
/// # Errors
/// Those of [`encode_with`].
pub fn encode(frames: &Frames) -> Result<Vec<u8>> {
    encode_with(frames, &Options::default())
}

/// Frames as packets.
///
/// # Errors
/// Bits per sample other than 8, 10, 12, 14 or 16; lines that are not whole groups of samples or
/// exceed 65535 bytes, as CSI-2 demands; a virtual channel above 3; samples beyond the bits.
pub fn encode_with(frames: &Frames, options: &Options) -> Result<Vec<u8>> {
    let bits = frames.facts.bits.unwrap_or(16);
    let raw = RAW.iter().find(|(_, packing)| packing.bits() == bits);
    let &(image, packing) = raw.ok_or_else(|| {
        Error::unsupported(format!("{bits} bits per sample for CSI-2")).help("8, 10, 12, 14 or 16")
    })?;
    let width = frames.width();
    let row_bytes = packing.row_bytes(width);
    if !width.is_multiple_of(packing.group().0) || row_bytes > usize::from(u16::MAX) {
        return Err(Error::limit(format!("lines of {width} samples of {bits} bits for CSI-2"))
            .help(format!(
                "a line is a multiple of {} samples and at most 65535 bytes",
                packing.group().0
            )));
    }
    if options.virtual_channel > 3 {
        return Err(
            Error::input(format!("virtual channel {}", options.virtual_channel)).help("0 to 3")
        );
    }
    let mut writer = Writer { bytes: Vec::new(), virtual_channel: options.virtual_channel };
    let mut line = vec![0; row_bytes];
    for (index, plane) in frames.planes.iter().enumerate() {
        check_range(&plane.data, bits)?;
        let counted = (index % 65535 + 1) as u16;
        let number = options.numbers.get(index).copied().unwrap_or(counted);
        writer.short(data_type::FRAME_START, number);
        for payload in options.embedded.get(index).into_iter().flatten() {
            writer.long(data_type::EMBEDDED, payload)?;
        }
        for (y, row) in plane.data.chunks_exact(width).enumerate() {
            let line_number = (y % 65535 + 1) as u16;
            pack_row(packing, row, &mut line)
                .map_err(|e| Error::internal(format!("a line of {} bytes", e.needed)))?;
            if options.line_packets {
                writer.short(data_type::LINE_START, line_number);
            }
            writer.long(image, &line)?;
            if options.line_packets {
                writer.short(data_type::LINE_END, line_number);
            }
        }
        writer.short(data_type::FRAME_END, number);
    }
    Ok(writer.bytes)
}

struct Writer {
    bytes: Vec<u8>,
    virtual_channel: u8,
}

impl Writer {
    fn short(&mut self, data_type: u8, value: u16) {
        let id = self.virtual_channel << 6 | data_type;
        let [low, high] = value.to_le_bytes();
        self.bytes.extend([id, low, high, ecc(id, value)]);
    }

    fn long(&mut self, data_type: u8, payload: &[u8]) -> Result<()> {
        let length = u16::try_from(payload.len()).map_err(|_| {
            Error::limit(format!("a CSI-2 payload of {} bytes", payload.len()))
                .help("65535 at most")
        })?;
        self.short(data_type, length);
        self.bytes.extend(payload);
        self.bytes.extend(checksum(payload).to_le_bytes());
        Ok(())
    }
}

/// Reads the frames of a packet stream.
///
/// # Errors
/// Those of [`decode_stream`].
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    Ok(decode_stream(bytes)?.frames)
}

/// Reads a whole packet stream: frames, frame numbers and embedded data. Packets of other data
/// types (blanking, user-defined) are skipped.
///
/// # Errors
/// Damaged packets, packets of several virtual channels, frames without image lines or of
/// different sizes or data types, a stream without a complete frame.
pub fn decode_stream(bytes: &[u8]) -> Result<Stream> {
    let mut stream = Stream {
        frames: Frames { planes: Vec::new(), facts: Facts::default() },
        frame_numbers: Vec::new(),
        embedded: Vec::new(),
        corrected_headers: 0,
    };
    let mut open = None;
    let mut channel = None;
    for packet in Packets::new(bytes) {
        let packet = packet?;
        stream.corrected_headers += usize::from(packet.corrected);
        if *channel.get_or_insert(packet.virtual_channel) != packet.virtual_channel {
            return Err(Error::unsupported("several virtual channels in one CSI-2 stream")
                .help("take them apart first"));
        }
        match packet.data_type {
            data_type::FRAME_START => {
                if open.is_some() {
                    return Err(Error::input("a CSI-2 Frame Start before the last frame's end"));
                }
                stream.frame_numbers.push(packet.value);
                stream.embedded.push(Vec::new());
                open = Some(Plane { width: 0, height: 0, data: Vec::new() });
            }
            data_type::FRAME_END => match open.take() {
                Some(plane) if plane.height > 0 => stream.push(plane)?,
                _ => return Err(Error::input("a CSI-2 frame without image lines")),
            },
            data_type::EMBEDDED => {
                if let Some(lines) = stream.embedded.last_mut().filter(|_| open.is_some()) {
                    lines.push(packet.payload.to_vec());
                }
            }
            other => {
                if let Some(&(_, packing)) = RAW.iter().find(|(data_type, _)| *data_type == other)
                {
                    let plane = open
                        .as_mut()
                        .ok_or_else(|| Error::input("a CSI-2 image line outside a frame"))?;
                    line(plane, packing, packet.payload)?;
                    let bits = stream.frames.facts.bits.get_or_insert(packing.bits());
                    if *bits != packing.bits() {
                        return Err(Error::unsupported(
                            "CSI-2 image lines of different data types",
                        ));
                    }
                }
            }
        }
    }
    if open.is_some() || stream.frames.planes.is_empty() {
        return Err(Error::input("a CSI-2 stream without a whole frame").help("truncated?"));
    }
    Ok(stream)
}

/// Appends an image line to the frame being read.
fn line(plane: &mut Plane<u16>, packing: Packing, payload: &[u8]) -> Result<()> {
    let (samples, bytes) = packing.group();
    let width = payload.len() / bytes * samples;
    if width == 0
        || !payload.len().is_multiple_of(bytes)
        || (plane.height > 0 && width != plane.width)
    {
        return Err(Error::input(format!("a CSI-2 image line of {} bytes", payload.len()))
            .help("lines of a frame are whole groups of samples and of one length"));
    }
    let start = plane.data.len();
    plane.data.resize(start + width, 0);
    plane.width = width;
    plane.height += 1;
    unpack_row(packing, payload, &mut plane.data[start..])
        .map_err(|e| Error::internal(format!("a line of {} bytes", e.found)))
}

impl Stream {
    fn push(&mut self, plane: Plane<u16>) -> Result<()> {
        let planes = &mut self.frames.planes;
        if planes.first().is_some_and(|p| (p.width, p.height) != (plane.width, plane.height)) {
            return Err(Error::unsupported("CSI-2 frames of different sizes in one stream"));
        }
        planes.push(plane);
        Ok(())
    }
}

/// An embedded data line in the tagged format of MIPI CCS (chapter "Embedded data"; SMIA's
/// simplified 2-byte tags): the register values from which drivers learn the settings of a frame.
///
/// `registers` are pairs of address and value; `bits` are those of the image's samples. For 10 and
/// 12 bits a filler byte 0x55 follows every 4th or 2nd byte, in place of the low bits of pixels.
pub fn ccs_line(registers: &[(u16, u8)], bits: u32) -> Vec<u8> {
    const FORMAT: u8 = 0x0A;
    const ADDRESS_HIGH: u8 = 0xAA;
    const ADDRESS_LOW: u8 = 0xA5;
    const VALUE: u8 = 0x5A;
    const END: u8 = 0x07;
    let mut plain = vec![FORMAT];
    let mut next = None;
    for &(address, value) in registers {
        if next != Some(address) {
            let [high, low] = address.to_be_bytes();
            plain.extend([ADDRESS_HIGH, high, ADDRESS_LOW, low]);
        }
        plain.extend([VALUE, value]);
        next = address.checked_add(1);
    }
    plain.push(END);
    let group = match bits {
        10 => 4,
        12 => 2,
        _ => return plain,
    };
    plain.resize(plain.len().next_multiple_of(group), END);
    plain.chunks(group).flat_map(|bytes| bytes.iter().copied().chain([0x55])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The published examples: CRC of the two 24-byte payloads of the specification's annex, ECC
    /// of a header.
    #[test]
    fn checksums_are_those_of_the_specification() {
        let first = [
            0xFF, 0x00, 0x00, 0x02, 0xB9, 0xDC, 0xF3, 0x72, 0xBB, 0xD4, 0xB8, 0x5A, 0xC8, 0x75,
            0xC2, 0x7C, 0x81, 0xF8, 0x05, 0xDF, 0xFF, 0x00, 0x00, 0x01,
        ];
        assert_eq!(checksum(&first), 0x00F0);
        let second = [
            0xFF, 0x00, 0x00, 0x00, 0x1E, 0xF0, 0x1E, 0xC7, 0x4F, 0x82, 0x78, 0xC5, 0x82, 0xE0,
            0x8C, 0x70, 0xD2, 0x3C, 0x78, 0xE9, 0xFF, 0x00, 0x00, 0x01,
        ];
        assert_eq!(checksum(&second).to_le_bytes(), [0x69, 0xE5]);
        assert_eq!(ecc(0x37, 0x01F0), 0x3F);
    }

    /// Every single-bit error of a header is corrected, every double one of its 24 bits found: the
    /// code has distance 4 over data and ECC.
    #[test]
    fn header_errors_are_corrected_or_found() {
        let header = [0x2B, 0x40, 0x06, ecc(0x2B, 0x0640)];
        for i in 0..30 {
            let mut one = header;
            one[i / 8] ^= 1 << (i % 8);
            assert_eq!(correct(one), Some(([0x2B, 0x40, 0x06], true)), "bit {i}");
            for j in (0..30).filter(|&j| j != i) {
                let mut two = one;
                two[j / 8] ^= 1 << (j % 8);
                assert_eq!(correct(two), None, "bits {i} and {j}");
            }
        }
    }

    fn frames() -> Frames {
        let plane = Plane::from_fn(8, 3, |x, y| (100 * y + x) as u16);
        let facts = Facts { bits: Some(10), ..Facts::default() };
        Frames { planes: vec![plane.clone(), plane], facts }
    }

    #[test]
    fn a_stream_is_laid_out_as_specified() {
        let bytes = encode(&frames()).unwrap();
        assert_eq!(bytes[..4], [0x00, 1, 0, ecc(0, 1)]);
        assert_eq!(bytes[4..8], [0x2B, 10, 0, ecc(0x2B, 10)]);
        assert_eq!(bytes.len(), 2 * (4 + 3 * (4 + 10 + 2) + 4));
        let kinds: Vec<u8> = Packets::new(&bytes).map(|p| p.unwrap().data_type).collect();
        assert_eq!(kinds, [0, 0x2B, 0x2B, 0x2B, 1, 0, 0x2B, 0x2B, 0x2B, 1]);
    }

    #[test]
    fn embedded_lines_channels_and_line_packets_come_back() {
        let line = ccs_line(&[(0x0005, 7), (0x0202, 1), (0x0203, 2)], 10);
        let options = Options {
            virtual_channel: 2,
            line_packets: true,
            embedded: vec![vec![line.clone()], vec![]],
            ..Options::default()
        };
        let mut bytes = encode_with(&frames(), &options).unwrap();
        bytes[0] ^= 0x20;
        let stream = decode_stream(&bytes).unwrap();
        assert_eq!(stream.frames, frames());
        assert_eq!(stream.embedded, options.embedded);
        assert_eq!((stream.frame_numbers, stream.corrected_headers), (vec![1, 2], 1));
    }

    #[test]
    fn frame_numbers_come_back_as_given() {
        let numbered = |numbers: &[u16]| {
            let options = Options { numbers: numbers.to_vec(), ..Options::default() };
            let bytes = encode_with(&frames(), &options).unwrap();
            decode_stream(&bytes).unwrap().frame_numbers
        };
        assert_eq!(numbered(&[7, 9]), [7, 9]);
        assert_eq!(numbered(&[]), [1, 2]);
    }

    #[test]
    fn a_wrong_payload_is_refused() {
        let mut bytes = encode(&frames()).unwrap();
        bytes[9] ^= 1;
        let error = decode(&bytes).unwrap_err().to_string();
        assert!(error.contains("checksum") && error.contains("byte 4"), "{error}");
    }

    /// Tags as libcamera's SMIA parser reads them, with a filler after every 4 bytes.
    #[test]
    fn ccs_lines_have_tags_and_fillers() {
        assert_eq!(
            ccs_line(&[(0x0202, 1), (0x0203, 2)], 10),
            [
                0x0A, 0xAA, 0x02, 0xA5, 0x55, 0x02, 0x5A, 0x01, 0x5A, 0x55, 0x02, 0x07, 0x07,
                0x07, 0x55
            ]
        );
    }
}
