//! Packets: header with error-correcting code, payload with checksum.

use super::data_type;
use camrig_base::{Error, Result};

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

/// What stands at a place of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Found<'a> {
    /// Its place, bytes from the begin.
    pub at: usize,
    /// The packet, unless it is lost.
    pub packet: Option<Packet<'a>>,
    /// What is wrong with it.
    pub fault: Option<Fault>,
}

/// What is wrong with a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A bit of the header, which its code corrects.
    HeaderBit,
    /// More bits of the header: the packet is lost.
    Header {
        /// Bytes up to the next packet.
        lost: usize,
    },
    /// The checksum of the payload does not hold.
    Checksum,
    /// The next packet does not follow where the header says: the packet is lost.
    WordCount {
        /// Bytes of the payload by the header.
        stated: usize,
        /// Bytes up to the next packet.
        lost: usize,
    },
    /// The stream ends within the packet.
    Truncated {
        /// Bytes that are missing.
        missing: usize,
    },
}

impl Packet<'_> {
    /// Bytes of the whole packet.
    pub(super) fn bytes(&self) -> usize {
        match self.data_type < data_type::FIRST_LONG {
            true => HEADER,
            false => HEADER + self.payload.len() + FOOTER,
        }
    }
}

/// Bytes of a header, and of the checksum after a payload.
const HEADER: usize = 4;
const FOOTER: usize = 2;
/// Headers in a row, each where the one before says, from which packets are believed to begin where
/// none was expected: the code of one holds by chance once in 256 places.
const HEADERS_IN_A_ROW: usize = 4;

/// Iterator over the packets of a stream. After a packet that is lost it goes on with the first
/// place from which packets follow one another; the lanes of a link mark that place, bytes do not.
pub struct Packets<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Packets<'a> {
    /// Packets of `bytes` from the start.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// Whether packets follow one another from a place, up to the end or for long enough.
    pub(super) fn begin_at(&self, mut at: usize) -> bool {
        let mut before = None;
        for _ in 0..HEADERS_IN_A_ROW {
            let header = self.bytes.get(at..).and_then(<[u8]>::first_chunk::<HEADER>);
            let sound = header.and_then(|header| correct(*header)).filter(|(_, wrong)| !wrong);
            let Some(([id, low, high], _)) = sound else { return false };
            at += HEADER;
            if id & 0x3F >= data_type::FIRST_LONG {
                at += usize::from(u16::from_le_bytes([low, high])) + FOOTER;
            } else if before == header {
                // Zeros are Frame Starts; no sender repeats one.
                return false;
            }
            if at == self.bytes.len() {
                return true;
            }
            before = header;
        }
        true
    }

    /// Where packets go on after a header, and whether what lies between is a payload whose
    /// checksum holds; the end of the stream if nowhere. By chance the last bytes of a payload are
    /// a short packet's header, so that the second place counts too.
    fn next_begin(&self, header: usize) -> (usize, bool) {
        let begin = header + HEADER;
        let longest = begin + usize::from(u16::MAX) + FOOTER;
        let places = begin..self.bytes.len().min(longest);
        let mut begins = places.filter(|&at| self.begin_at(at)).take(2).peekable();
        let first = *begins.peek().unwrap_or(&self.bytes.len());
        let holds = |at: &usize| {
            let end = at.checked_sub(FOOTER).filter(|end| *end > begin);
            end.is_some_and(|end| {
                checksum(&self.bytes[begin..end]).to_le_bytes() == self.bytes[end..*at]
            })
        };
        begins.find(holds).map_or((first, false), |at| (at, true))
    }

    /// What stands at the present place, and where the next packet begins.
    fn read(&self) -> (Option<Packet<'a>>, Option<Fault>, usize) {
        let rest = &self.bytes[self.at..];
        let cut = |needed: usize| {
            let missing = needed - rest.len();
            (None, Some(Fault::Truncated { missing }), self.bytes.len())
        };
        let Some(header) = rest.first_chunk::<HEADER>() else { return cut(HEADER) };
        let Some(([id, low, high], corrected)) = correct(*header) else {
            let (next, _) = self.next_begin(self.at);
            return (None, Some(Fault::Header { lost: next - self.at }), next);
        };
        let value = u16::from_le_bytes([low, high]);
        let (virtual_channel, data_type) = (id >> 6, id & 0x3F);
        let mut packet = Packet { virtual_channel, data_type, value, payload: &rest[..0] };
        let fault = corrected.then_some(Fault::HeaderBit);
        if data_type < data_type::FIRST_LONG {
            return (Some(packet), fault, self.at + HEADER);
        }
        let stated = usize::from(value);
        let whole = HEADER + stated + FOOTER;
        let end = self.at + whole;
        packet.payload = rest.get(HEADER..HEADER + stated).unwrap_or_default();
        let footer = rest.get(HEADER + stated..whole);
        if footer == Some(&checksum(packet.payload).to_le_bytes()) {
            return (Some(packet), fault, end);
        }
        let (next, is_payload) = self.next_begin(self.at);
        let goes_on = footer.is_some() && (end == self.bytes.len() || self.begin_at(end));
        match () {
            () if goes_on && !is_payload => (Some(packet), Some(Fault::Checksum), end),
            () if next == self.bytes.len() && footer.is_none() => cut(whole),
            () => (None, Some(Fault::WordCount { stated, lost: next - self.at }), next),
        }
    }
}

impl<'a> Iterator for Packets<'a> {
    type Item = Found<'a>;

    fn next(&mut self) -> Option<Self::Item> {
        let at = self.at;
        let (packet, fault, next) = (at < self.bytes.len()).then(|| self.read())?;
        self.at = next;
        Some(Found { at, packet, fault })
    }
}

/// Packets that are written, of one virtual channel or several.
#[derive(Default)]
pub(super) struct Writer {
    pub bytes: Vec<u8>,
}

impl Writer {
    pub fn short(&mut self, virtual_channel: u8, data_type: u8, value: u16) {
        let begin = self.bytes.len();
        self.bytes.extend([0; HEADER]);
        self.header(begin, virtual_channel, data_type, value);
    }

    /// Writes a header where bytes are.
    pub fn header(&mut self, at: usize, virtual_channel: u8, data_type: u8, value: u16) {
        let id = virtual_channel << 6 | data_type;
        let [low, high] = value.to_le_bytes();
        self.bytes[at..at + HEADER].copy_from_slice(&[id, low, high, ecc(id, value)]);
    }

    pub fn long(&mut self, virtual_channel: u8, data_type: u8, payload: &[u8]) -> Result<()> {
        let length = u16::try_from(payload.len()).map_err(|_| {
            Error::limit(format!("a CSI-2 payload of {} bytes", payload.len()))
                .help("65535 at most")
        })?;
        self.short(virtual_channel, data_type, length);
        self.bytes.extend(payload);
        self.bytes.extend(checksum(payload).to_le_bytes());
        Ok(())
    }
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
}
