//! The directories of a classic TIFF file in memory.
//!
//! The `tiff` crate opens a file only if it knows the photometric interpretation of its first
//! image, which for many DNG files is a colour filter array; this reader takes any directory and
//! leaves its meaning to the caller. Every offset and count is checked against the bytes present.

use super::truncated;
use camrig_base::{Error, Result};
use std::collections::BTreeMap;

/// A TIFF file in memory.
pub(super) struct Tiff<'a> {
    /// The whole file.
    pub bytes: &'a [u8],
    big_endian: bool,
}

/// One directory: its fields by tag number.
pub(super) struct Ifd<'a> {
    fields: BTreeMap<u16, Field<'a>>,
}

#[derive(Clone, Copy)]
struct Field<'a> {
    kind: u16,
    data: &'a [u8],
    big_endian: bool,
}

/// Whether the first directory has a DNG version, or is a colour filter array by its photometric
/// interpretation.
pub(super) fn is_dng(bytes: &[u8]) -> bool {
    let first = Tiff::open(bytes).and_then(|t| t.ifd(t.first()?));
    first.is_ok_and(|ifd| ifd.uints(50706).is_some() || ifd.uint(262) == Some(32803))
}

impl<'a> Tiff<'a> {
    /// Checks byte order mark and version.
    pub fn open(bytes: &'a [u8]) -> Result<Self> {
        let big_endian = bytes.starts_with(b"MM");
        let file = Self { bytes, big_endian };
        if !(big_endian || bytes.starts_with(b"II")) || file.u16(2)? != 42 {
            return Err(Error::unsupported("not a classic TIFF file"));
        }
        Ok(file)
    }

    /// Offset of the first directory.
    pub fn first(&self) -> Result<usize> {
        Ok(self.u32(4)? as usize)
    }

    /// The directory at an offset.
    pub fn ifd(&self, offset: usize) -> Result<Ifd<'a>> {
        let count = self.u16(offset)? as usize;
        let mut fields = BTreeMap::new();
        for i in 0..count {
            let at = offset.saturating_add(2 + 12 * i);
            let (tag, kind) = (self.u16(at)?, self.u16(at + 2)?);
            let size = match kind {
                1 | 2 | 6 | 7 => 1,
                3 | 8 => 2,
                4 | 9 | 11 | 13 => 4,
                5 | 10 | 12 => 8,
                _ => continue, // the TIFF specification: skip unknown types
            };
            let length = (self.u32(at + 4)? as usize).saturating_mul(size);
            let start = if length <= 4 { at + 8 } else { self.u32(at + 8)? as usize };
            let data = self.slice(start, length).map_err(|e| e.at(format!("TIFF tag {tag}")))?;
            fields.insert(tag, Field { kind, data, big_endian: self.big_endian });
        }
        Ok(Ifd { fields })
    }

    /// `length` bytes from `start` on, checked.
    pub fn slice(&self, start: usize, length: usize) -> Result<&'a [u8]> {
        let end = start.saturating_add(length);
        self.bytes.get(start..end).ok_or_else(|| truncated(end, self.bytes.len()))
    }

    /// A 16-bit sample in the file's byte order.
    pub fn sample(&self, b: [u8; 2]) -> u16 {
        if self.big_endian { u16::from_be_bytes(b) } else { u16::from_le_bytes(b) }
    }

    fn u16(&self, at: usize) -> Result<u16> {
        let b = self.slice(at, 2)?;
        Ok(self.sample([b[0], b[1]]))
    }

    fn u32(&self, at: usize) -> Result<u32> {
        let b = self.slice(at, 4)?;
        Ok(u32_of(b, self.big_endian))
    }
}

fn u32_of(b: &[u8], big_endian: bool) -> u32 {
    let b = [b[0], b[1], b[2], b[3]];
    if big_endian { u32::from_be_bytes(b) } else { u32::from_le_bytes(b) }
}

impl Ifd<'_> {
    /// All values of an unsigned integer field.
    pub fn uints(&self, tag: u16) -> Option<Vec<u64>> {
        let f = self.fields.get(&tag)?;
        Some(match f.kind {
            1 | 7 => f.data.iter().map(|&b| b.into()).collect(),
            3 => f.data.chunks_exact(2).map(|b| f.u16(b).into()).collect(),
            4 | 13 => f.data.chunks_exact(4).map(|b| u32_of(b, f.big_endian).into()).collect(),
            _ => return None,
        })
    }

    /// The first value of an unsigned integer field.
    pub fn uint(&self, tag: u16) -> Option<u64> {
        self.uints(tag)?.first().copied()
    }

    /// All values of a numeric field; `None` where one is not finite (a zero denominator).
    pub fn floats(&self, tag: u16) -> Option<Vec<f64>> {
        let f = self.fields.get(&tag)?;
        let halves = |b: &[u8]| (u32_of(b, f.big_endian), u32_of(&b[4..], f.big_endian));
        let eights = f.data.chunks_exact(8);
        let values: Vec<f64> = match f.kind {
            5 => eights.map(halves).map(|(n, d)| f64::from(n) / f64::from(d)).collect(),
            10 => eights
                .map(halves)
                .map(|(n, d)| f64::from(n as i32) / f64::from(d as i32))
                .collect(),
            11 => f
                .data
                .chunks_exact(4)
                .map(|b| f32::from_bits(u32_of(b, f.big_endian)).into())
                .collect(),
            12 => eights
                .map(|b| {
                    let (a, b) = halves(b);
                    let (high, low) = if f.big_endian { (a, b) } else { (b, a) };
                    f64::from_bits(u64::from(high) << 32 | u64::from(low))
                })
                .collect(),
            _ => self.uints(tag)?.into_iter().map(|v| v as f64).collect(),
        };
        values.iter().all(|v| v.is_finite()).then_some(values)
    }

    /// The bytes of a field.
    pub fn bytes(&self, tag: u16) -> Option<&[u8]> {
        self.fields.get(&tag).map(|f| f.data)
    }

    /// The text of an ASCII field, up to its NUL.
    pub fn text(&self, tag: u16) -> Option<String> {
        let text = self.bytes(tag)?.split(|&b| b == 0).next()?;
        Some(String::from_utf8_lossy(text).into_owned())
    }
}

impl Field<'_> {
    fn u16(&self, b: &[u8]) -> u16 {
        let b = [b[0], b[1]];
        if self.big_endian { u16::from_be_bytes(b) } else { u16::from_le_bytes(b) }
    }
}
