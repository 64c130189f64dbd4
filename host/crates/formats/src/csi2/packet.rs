//! Packets: header with error-correcting code, payload with checksum.

use super::data_type;
use crate::truncated;
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

/// Packets that are written, of one virtual channel or several.
#[derive(Default)]
pub(super) struct Writer {
    pub bytes: Vec<u8>,
}

impl Writer {
    pub fn short(&mut self, virtual_channel: u8, data_type: u8, value: u16) {
        let id = virtual_channel << 6 | data_type;
        let [low, high] = value.to_le_bytes();
        self.bytes.extend([id, low, high, ecc(id, value)]);
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
