//! How the samples of a row lie in its bytes.

use super::pisp;
use crate::Error;
use camrig_base::Result;
use camrig_packing::{Packing, WrongSize, pack_row, unpack_row};

/// How samples lie in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Layout {
    /// A sample in a 16-bit word, low byte first; of 8 bits, in a byte.
    Words,
    /// A sample in a 16-bit word, high byte first.
    WordsBig,
    /// Packed as MIPI CSI-2 sends it: high bits of a group of samples, then their low bits.
    Mipi,
    /// A stream of bits, each sample's lowest bit first (GenICam PFNC 2.x, `p`).
    LowestFirst,
    /// A Raspberry Pi 5's compression with loss; read, not written.
    Pisp,
    /// Two samples in three bytes, the low bits of both in the middle one (GigE Vision,
    /// `Packed`).
    GigE,
}

impl Layout {
    /// Whether samples of `bits` bits have this layout.
    pub(super) fn has(self, bits: u32) -> bool {
        match self {
            Self::Words => matches!(bits, 8 | 10 | 12 | 14 | 16),
            Self::WordsBig => matches!(bits, 10 | 12 | 14 | 16),
            Self::Mipi | Self::LowestFirst => matches!(bits, 10 | 12 | 14),
            Self::GigE => matches!(bits, 10 | 12),
            Self::Pisp => bits == 16,
        }
    }

    /// Layouts that packs rows as the rig's link does.
    fn packing(self, bits: u32) -> Option<Packing> {
        match (self, bits) {
            (Self::Words, 8) => Some(Packing::Raw8),
            (Self::Words, _) => Some(Packing::Le16),
            (Self::WordsBig, _) => Some(Packing::Raw16),
            (Self::Mipi, _) => Packing::of_bits(bits),
            (Self::LowestFirst | Self::GigE | Self::Pisp, _) => None,
        }
    }

    /// Bytes of a row of `width` samples.
    ///
    /// # Errors
    /// Rows that do not end with a byte, in layouts where the next row may begin within it.
    pub(super) fn row_bytes(self, bits: u32, width: usize) -> Result<usize> {
        if let Some(packing) = self.packing(bits) {
            return Ok(packing.row_bytes(width));
        }
        if self == Self::Pisp {
            return Ok(width.next_multiple_of(pisp::GROUP));
        }
        let row_bits = match self {
            Self::GigE => width.saturating_mul(12),
            _ => width.saturating_mul(bits as usize),
        };
        if !row_bits.is_multiple_of(8) {
            return Err(Error::unsupported(format!("rows of {width} pixels, packed")).help(
                "in this packing a row of them ends within a byte, and where the next one \
                       begins differs between cameras; crop to an even number of columns",
            ));
        }
        Ok(row_bits / 8)
    }

    /// Packs a row.
    pub(super) fn pack(self, bits: u32, row: &[u16], out: &mut [u8]) -> Result<()> {
        if let Some(packing) = self.packing(bits) {
            return pack_row(packing, row, out).map_err(wrong_size);
        }
        if self == Self::Pisp {
            return Err(Error::unsupported("writing raw in a Raspberry Pi 5's compression")
                .help("write words, for instance SRGGB16; this compression is read alone"));
        }
        if self == Self::GigE {
            let low_bits = bits - 8;
            let low = |v: u16| (v & ((1 << low_bits) - 1)) as u8;
            for (pair, bytes) in row.chunks(2).zip(out.chunks_exact_mut(3)) {
                let [a, b] = [pair[0], pair.get(1).copied().unwrap_or(0)];
                bytes.copy_from_slice(&[
                    (a >> low_bits) as u8,
                    low(a) | low(b) << 4,
                    (b >> low_bits) as u8,
                ]);
            }
            return Ok(());
        }
        let (mut pool, mut filled, mut bytes) = (0u32, 0, out.iter_mut());
        for &sample in row {
            pool |= u32::from(sample) << filled;
            filled += bits;
            while filled >= 8 {
                if let Some(byte) = bytes.next() {
                    *byte = pool as u8;
                }
                pool >>= 8;
                filled -= 8;
            }
        }
        Ok(())
    }

    /// Unpacks a row.
    pub(super) fn unpack(self, bits: u32, bytes: &[u8], row: &mut [u16]) -> Result<()> {
        if let Some(packing) = self.packing(bits) {
            return unpack_row(packing, bytes, row).map_err(wrong_size);
        }
        if self == Self::Pisp {
            pisp::unpack(bytes, row);
            return Ok(());
        }
        if self == Self::GigE {
            let low_bits = bits - 8;
            let mask = (1u16 << low_bits) - 1;
            for (pair, b) in row.chunks_mut(2).zip(bytes.chunks_exact(3)) {
                let [first, low, second] = [b[0], b[1], b[2]].map(u16::from);
                pair[0] = first << low_bits | (low & mask);
                if let Some(sample) = pair.get_mut(1) {
                    *sample = second << low_bits | (low >> 4 & mask);
                }
            }
            return Ok(());
        }
        let (mut pool, mut filled, mut next) = (0u32, 0, bytes.iter());
        for sample in row {
            while filled < bits {
                pool |= u32::from(*next.next().unwrap_or(&0)) << filled;
                filled += 8;
            }
            *sample = (pool & ((1 << bits) - 1)) as u16;
            pool >>= bits;
            filled -= bits;
        }
        Ok(())
    }
}

fn wrong_size(e: WrongSize) -> Error {
    Error::input(format!("a row of {} bytes where {} are needed", e.found, e.needed))
}
