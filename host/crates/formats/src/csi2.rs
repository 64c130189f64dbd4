//! MIPI CSI-2 packets as bytes: what a receiver delivers after merging the lanes of a D-PHY link.
//!
//! A frame consists of Frame Start, embedded data lines, image lines (one long packet each, on
//! request between Line Start and Line End) and Frame End. Frames of other virtual channels may
//! lie between its packets: sensors with several exposures send each on its own, row by row in
//! turn. Source: MIPI CSI-2 v1.3, chapter 9 (packet header, ECC, CRC) and 11 (data types); 2-bit
//! virtual channels; RAW16, RAW20 and RAW24 of v2.0, whose samples are sent as two of half the
//! bits, the upper half first, packed as RAW8, RAW10 and RAW12 are.
//!
//! The reader takes virtual channels apart and corrects single-bit errors of packet headers, as the
//! ECC allows. Whatever else is wrong, packets or their order, it names by frame and row; it goes
//! on behind it, and gives the frames as a receiver would have them where they are asked for.
//! [`damage`] makes each of these faults.

mod damage;
mod embedded;
mod packet;
mod read;
mod write;

pub use damage::{Damage, damage};
pub use embedded::{Embedded, address};
pub use packet::{Fault, Found, Packet, Packets, checksum, ecc};
pub(super) use read::is_stream;
pub use read::{Channel, Damaged, Stream, Wrong, decode, decode_damaged, decode_stream, is_wide};
pub use write::{Options, Sent, encode, encode_together, encode_with};

use camrig_base::{Dn, Result};
use camrig_packing::{Packing, WrongSize, pack_row, unpack_row};

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

/// How samples of an image line are packed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Raw {
    data_type: u8,
    bits: u32,
    packing: Packing,
    /// Packed values per sample: 1, or 2 of half its bits.
    parts: usize,
}

/// RAW8 to RAW24.
const RAW: [Raw; 7] = [
    Raw { data_type: 0x2A, bits: 8, packing: Packing::Raw8, parts: 1 },
    Raw { data_type: 0x2B, bits: 10, packing: Packing::Raw10, parts: 1 },
    Raw { data_type: 0x2C, bits: 12, packing: Packing::Raw12, parts: 1 },
    Raw { data_type: 0x2D, bits: 14, packing: Packing::Raw14, parts: 1 },
    Raw { data_type: 0x2E, bits: 16, packing: Packing::Raw16, parts: 1 },
    Raw { data_type: 0x2F, bits: 20, packing: Packing::Raw10, parts: 2 },
    Raw { data_type: 0x27, bits: 24, packing: Packing::Raw12, parts: 2 },
];

impl Raw {
    /// Samples and bytes of a group.
    fn group(&self) -> (usize, usize) {
        let (values, bytes) = self.packing.group();
        (values / self.parts, bytes)
    }

    /// The bytes of a line of whole groups.
    fn pack<S: Dn>(&self, row: &[S]) -> Result<Vec<u8>, WrongSize> {
        let half = self.packing.bits();
        let mask = (1u32 << half) - 1;
        let upper_first = |dn: u32| [dn >> half, dn & mask].map(|part| part as u16);
        let whole = |dn: u32| dn as u16;
        let dn = row.iter().map(|dn| (*dn).into());
        let values: Vec<u16> = match self.parts {
            1 => dn.map(whole).collect(),
            _ => dn.flat_map(upper_first).collect(),
        };
        let mut line = vec![0; self.packing.row_bytes(values.len())];
        pack_row(self.packing, &values, &mut line)?;
        Ok(line)
    }

    /// The samples of a line of whole groups.
    fn unpack(&self, line: &[u8]) -> Result<Vec<u32>, WrongSize> {
        let (values, bytes) = self.packing.group();
        let mut row = vec![0u16; line.len() / bytes * values];
        unpack_row(self.packing, line, &mut row)?;
        let sample = |parts: &[u16]| {
            parts.iter().fold(0, |dn, part| dn << self.packing.bits() | u32::from(*part))
        };
        Ok(row.chunks_exact(self.parts).map(sample).collect())
    }
}

#[cfg(test)]
mod tests;
