//! Packed raw samples as MIPI CSI-2 sends them and V4L2 stores them.
//!
//! Layouts (MIPI CSI-2, "Raw data formats"; Linux V4L2 `SRGGB10P`, `SRGGB12P`, `SRGGB14P`):
//!
//! | format | group | bytes |
//! |---|---|---|
//! | RAW8 | 1 sample | the sample |
//! | RAW10 | 4 samples | 4 bytes of upper 8 bits, the 2 low bits of each, first sample lowest |
//! | RAW12 | 2 samples | 2 bytes of upper 8 bits, the 4 low bits of each, first sample lowest |
//! | RAW14 | 4 samples | 4 bytes of upper 8 bits, the 6 low bits of each, first sample lowest |
//! | RAW16 | 1 sample | upper byte, then lower byte |
//!
//! CSI-2 sends 16 bits with the most significant byte first; memory formats hold them
//! little-endian ([`Packing::Le16`]).
//!
//! A row whose width is not a multiple of the group is padded with zero samples. No function here
//! panics: a buffer of the wrong size is an error.
//!
//! ```
//! use camrig_packing::{Packing, pack_row, unpack_row};
//!
//! let mut bytes = [0; 5];
//! pack_row(Packing::Raw10, &[1023, 0, 512, 1], &mut bytes).unwrap();
//! assert_eq!(bytes, [255, 0, 128, 0, 0b01_00_00_11]);
//! let mut samples = [0; 4];
//! unpack_row(Packing::Raw10, &bytes, &mut samples).unwrap();
//! assert_eq!(samples, [1023, 0, 512, 1]);
//! ```
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

use core::fmt;

/// How samples of a row are laid out in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Packing {
    /// 8 bits in one byte.
    Raw8,
    /// 10 bits, four samples in five bytes.
    Raw10,
    /// 12 bits, two samples in three bytes.
    Raw12,
    /// 14 bits, four samples in seven bytes.
    Raw14,
    /// 16 bits, most significant byte first.
    Raw16,
    /// One sample in a little-endian 16-bit word.
    Le16,
}

/// The buffer of a packed row does not have the size that the row needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WrongSize {
    /// Bytes that the row needs.
    pub needed: usize,
    /// Bytes of the buffer.
    pub found: usize,
}

impl fmt::Display for WrongSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "the buffer of the packed row has {} bytes, the row needs {} (Packing::row_bytes)",
            self.found, self.needed
        )
    }
}

impl core::error::Error for WrongSize {}

impl Packing {
    /// The packed format of `bits` bits per sample, if there is one.
    pub const fn of_bits(bits: u32) -> Option<Self> {
        Some(match bits {
            8 => Self::Raw8,
            10 => Self::Raw10,
            12 => Self::Raw12,
            14 => Self::Raw14,
            16 => Self::Raw16,
            _ => return None,
        })
    }

    /// Bits per sample of the format.
    pub const fn bits(self) -> u32 {
        match self {
            Self::Raw8 => 8,
            Self::Raw10 => 10,
            Self::Raw12 => 12,
            Self::Raw14 => 14,
            Self::Raw16 | Self::Le16 => 16,
        }
    }

    /// Number of samples and of bytes in a group.
    pub const fn group(self) -> (usize, usize) {
        match self {
            Self::Raw8 => (1, 1),
            Self::Raw10 => (4, 5),
            Self::Raw12 => (2, 3),
            Self::Raw14 => (4, 7),
            Self::Raw16 | Self::Le16 => (1, 2),
        }
    }

    /// Bytes of a row of `width` samples, without padding beyond the last group; saturating.
    pub const fn row_bytes(self, width: usize) -> usize {
        let (samples, bytes) = self.group();
        width.div_ceil(samples).saturating_mul(bytes)
    }
}

/// Packs a row of samples (DN). `out` must have exactly [`Packing::row_bytes`] bytes. Bits of a
/// sample above those of the format are lost.
///
/// # Errors
/// [`WrongSize`] if `out` has another size.
pub fn pack_row(packing: Packing, row: &[u16], out: &mut [u8]) -> Result<(), WrongSize> {
    check(packing, row.len(), out.len())?;
    match packing {
        Packing::Raw8 => pack(row, out, |[a]| [a as u8]),
        Packing::Raw16 => pack(row, out, |[a]| a.to_be_bytes()),
        Packing::Le16 => pack(row, out, |[a]| a.to_le_bytes()),
        Packing::Raw10 => pack(row, out, |[a, b, c, d]| {
            let low = (a & 3) | (b & 3) << 2 | (c & 3) << 4 | (d & 3) << 6;
            [(a >> 2) as u8, (b >> 2) as u8, (c >> 2) as u8, (d >> 2) as u8, low as u8]
        }),
        Packing::Raw12 => pack(row, out, |[a, b]| {
            [(a >> 4) as u8, (b >> 4) as u8, ((a & 15) | (b & 15) << 4) as u8]
        }),
        Packing::Raw14 => pack(row, out, |[a, b, c, d]| {
            let low = [a, b, c, d].map(|s| u32::from(s & 63));
            let low = low[0] | low[1] << 6 | low[2] << 12 | low[3] << 18;
            let [e, f, g, _] = low.to_le_bytes();
            [(a >> 6) as u8, (b >> 6) as u8, (c >> 6) as u8, (d >> 6) as u8, e, f, g]
        }),
    }
    Ok(())
}

/// Unpacks a row of samples (DN); the inverse of [`pack_row`]. `bytes` must have exactly
/// [`Packing::row_bytes`] bytes.
///
/// # Errors
/// [`WrongSize`] if `bytes` has another size.
pub fn unpack_row(packing: Packing, bytes: &[u8], row: &mut [u16]) -> Result<(), WrongSize> {
    check(packing, row.len(), bytes.len())?;
    match packing {
        Packing::Raw8 => unpack(bytes, row, |[a]| [a.into()]),
        Packing::Raw16 => unpack(bytes, row, |b| [u16::from_be_bytes(b)]),
        Packing::Le16 => unpack(bytes, row, |b| [u16::from_le_bytes(b)]),
        Packing::Raw10 => unpack(bytes, row, |[a, b, c, d, low]| {
            let join = |upper: u8, i: u32| u16::from(upper) << 2 | u16::from(low >> (2 * i) & 3);
            [join(a, 0), join(b, 1), join(c, 2), join(d, 3)]
        }),
        Packing::Raw12 => unpack(bytes, row, |[a, b, low]| {
            [u16::from(a) << 4 | u16::from(low & 15), u16::from(b) << 4 | u16::from(low >> 4)]
        }),
        Packing::Raw14 => unpack(bytes, row, |[a, b, c, d, e, f, g]| {
            let low = u32::from_le_bytes([e, f, g, 0]);
            let join = |upper: u8, i: u32| u16::from(upper) << 6 | (low >> (6 * i) & 63) as u16;
            [join(a, 0), join(b, 1), join(c, 2), join(d, 3)]
        }),
    }
    Ok(())
}

/// Packs group by group; the last one is padded with zero samples.
#[inline(always)]
fn pack<const S: usize, const B: usize>(
    row: &[u16],
    out: &mut [u8],
    group: impl Fn([u16; S]) -> [u8; B],
) {
    let ((row, rest), out) = (row.as_chunks::<S>(), out.as_chunks_mut::<B>().0);
    for (out, samples) in out.iter_mut().zip(row) {
        *out = group(*samples);
    }
    if let Some(out) = out.get_mut(row.len()) {
        let mut padded = [0; S];
        padded[..rest.len()].copy_from_slice(rest);
        *out = group(padded);
    }
}

/// Unpacks group by group; from the last one only the samples that belong to the row.
#[inline(always)]
fn unpack<const S: usize, const B: usize>(
    bytes: &[u8],
    row: &mut [u16],
    group: impl Fn([u8; B]) -> [u16; S],
) {
    let (bytes, (row, rest)) = (bytes.as_chunks::<B>().0, row.as_chunks_mut::<S>());
    for (samples, bytes) in row.iter_mut().zip(bytes) {
        *samples = group(*bytes);
    }
    if let Some(bytes) = bytes.get(row.len()) {
        rest.copy_from_slice(&group(*bytes)[..rest.len()]);
    }
}

fn check(packing: Packing, width: usize, found: usize) -> Result<(), WrongSize> {
    let needed = packing.row_bytes(width);
    if needed == found { Ok(()) } else { Err(WrongSize { needed, found }) }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::{vec, vec::Vec};

    const ALL: [Packing; 6] = [
        Packing::Raw8,
        Packing::Raw10,
        Packing::Raw12,
        Packing::Raw14,
        Packing::Raw16,
        Packing::Le16,
    ];

    /// Single bits set, from the tables of MIPI CSI-2 and of V4L2's pixfmt-srggb10p/12p/14p pages.
    #[test]
    fn layouts_are_those_of_the_standard() {
        let pack = |packing: Packing, row: &[u16]| {
            let mut out = vec![0xFF; packing.row_bytes(row.len())];
            pack_row(packing, row, &mut out).unwrap();
            out
        };
        assert_eq!(pack(Packing::Raw8, &[0xA5]), [0xA5]);
        assert_eq!(pack(Packing::Raw10, &[0x3FC, 0, 0, 0]), [0xFF, 0, 0, 0, 0]);
        assert_eq!(pack(Packing::Raw10, &[3, 0, 2, 1]), [0, 0, 0, 0, 0b0110_0011]);
        assert_eq!(pack(Packing::Raw12, &[0x123, 0x456]), [0x12, 0x45, 0x63]);
        // V4L2 SRGGB14P: byte 4 is P1[1:0] P0[5:0], byte 5 is P2[3:0] P1[5:2], byte 6 P3[5:0]
        // P2[5:4].
        assert_eq!(
            pack(Packing::Raw14, &[0b000001, 0b000010, 0b010000, 0b100000]),
            [0, 0, 0, 0, 0b1000_0001, 0, 0b1000_0001]
        );
        assert_eq!(pack(Packing::Raw16, &[0x1234]), [0x12, 0x34]);
        assert_eq!(pack(Packing::Le16, &[0x1234]), [0x34, 0x12]);
    }

    #[test]
    fn every_width_comes_back() {
        for packing in ALL {
            for width in 0..23usize {
                let mask = (1u32 << packing.bits()) - 1;
                let row: Vec<u16> = (0..width as u32)
                    .map(|i| (i.wrapping_mul(40503) >> 3 & mask) as u16)
                    .collect();
                let mut bytes = vec![0; packing.row_bytes(width)];
                pack_row(packing, &row, &mut bytes).unwrap();
                let mut back = vec![0; width];
                unpack_row(packing, &bytes, &mut back).unwrap();
                assert_eq!(row, back, "{packing:?} {width}");
            }
        }
    }

    #[test]
    fn a_wrong_size_is_an_error() {
        let error = Err(WrongSize { needed: 10, found: 9 });
        assert_eq!(pack_row(Packing::Raw10, &[0; 5], &mut [0; 9]), error);
        assert_eq!(unpack_row(Packing::Raw10, &[0; 9], &mut [0; 5]), error);
    }
}
