//! How a raw row lies in bytes.

use camrig_rig_link::packing::{Packing, WrongSize, pack_row, unpack_row};
use camrig_sensor_core::hdr::{Output, Readout};

/// Pixels that are packed at a time where a sample is sent in two halves: whole groups of both
/// packings that have halves.
const AT_ONCE: usize = 16;

/// How a raw row lies in bytes: so many rows of samples, each packed, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawRow {
    /// Packing of each.
    pub packing: Packing,
    /// Rows of samples: those of the captures, where they are sent one by one.
    pub rows: usize,
    /// Whether each sample is sent in two halves, the upper one first, as CSI-2 sends RAW20 in those
    /// of RAW10 and RAW24 in those of RAW12.
    pub halves: bool,
}

impl RawRow {
    /// The row of `bits` per sample of a sensor of one capture, or of several with their readout;
    /// `None` where there is no such packing, or it has too few bits. `converter_bits`: most bits of
    /// a converter.
    pub fn new(bits: u8, converter_bits: u8, readout: Option<&Readout>) -> Option<Self> {
        let needed = readout.and_then(Readout::bits).unwrap_or(converter_bits);
        let halves = needed > 16;
        let fits = if halves { bits == needed } else { bits >= needed };
        let each = if halves { bits / 2 } else { bits };
        let rows = match readout {
            Some(readout) if readout.output == Output::Captures => readout.merge.captures(),
            _ => 1,
        };
        let packing = Packing::of_bits(each.into()).filter(|_| fits)?;
        Some(Self { packing, rows, halves })
    }

    /// Bytes of a row of `width` pixels.
    pub const fn bytes(&self, width: usize) -> usize {
        let samples = if self.halves { width.saturating_mul(2) } else { width };
        self.packing.row_bytes(samples).saturating_mul(self.rows)
    }

    /// Packs samples as [`Readout::send`] leaves them: row after row, or the upper halves and then
    /// the lower ones.
    ///
    /// # Errors
    /// Another number of bytes than [`Self::bytes`].
    #[inline(always)]
    pub fn pack(&self, width: usize, samples: &[u16], out: &mut [u8]) -> Result<(), WrongSize> {
        if !self.halves {
            let rows = samples.chunks_exact(width.max(1)).take(self.rows);
            let places = out.chunks_mut(self.packing.row_bytes(width).max(1));
            return rows.zip(places).try_for_each(|(row, out)| pack_row(self.packing, row, out));
        }
        let (upper, lower) = samples.split_at(width.min(samples.len()));
        let lower = lower.get(..upper.len()).unwrap_or_default();
        let halves = upper.chunks(AT_ONCE).zip(lower.chunks(AT_ONCE));
        let places = out.chunks_mut(self.packing.row_bytes(2 * AT_ONCE));
        halves.zip(places).try_for_each(|((upper, lower), out)| {
            let mut both = [0; 2 * AT_ONCE];
            for (pair, halves) in both.as_chunks_mut().0.iter_mut().zip(upper.iter().zip(lower)) {
                *pair = [*halves.0, *halves.1];
            }
            let row = both.get(..2 * upper.len()).unwrap_or(&both);
            pack_row(self.packing, row, out)
        })
    }

    /// Unpacks the rows of samples, one after the other; halves stay side by side.
    ///
    /// # Errors
    /// Another number of bytes than [`Self::bytes`].
    pub fn unpack(&self, packed: &[u8], samples: &mut [u16]) -> Result<(), WrongSize> {
        let width = samples.len() / self.rows.max(1);
        let rows = packed.chunks(self.packing.row_bytes(width).max(1));
        let places = samples.chunks_mut(width.max(1));
        rows.zip(places).try_for_each(|(packed, row)| unpack_row(self.packing, packed, row))
    }
}
