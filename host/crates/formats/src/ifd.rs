//! The directories of a TIFF file in memory, classic or BigTIFF.
//!
//! The `tiff` crate opens a file only if it knows the photometric interpretation of its first
//! image, which for many DNG files is a colour filter array; this reader takes any directory and
//! leaves its meaning to the caller. Every offset and count is checked against the bytes present.

use super::truncated;
use camrig_base::{Error, Result};
use std::borrow::Cow;
use std::collections::BTreeMap;

/// A TIFF file in memory.
pub(super) struct Tiff<'a> {
    /// The whole file.
    pub bytes: &'a [u8],
    big_endian: bool,
    /// Whether it is a BigTIFF, whose counts and offsets have 64 bits.
    big: bool,
}

/// One directory: its fields by tag number.
pub(super) struct Ifd<'a> {
    fields: BTreeMap<u16, Field<'a>>,
    /// Position of the offset of the next directory.
    end: usize,
    /// Where the directory and all that its fields point at end.
    pub reach: usize,
}

#[derive(Clone, Copy)]
struct Field<'a> {
    kind: u16,
    /// Where its data begin in the file.
    start: usize,
    data: &'a [u8],
    big_endian: bool,
}

/// Whether the first directory has a DNG version, or is a colour filter array by its photometric
/// interpretation.
pub(super) fn is_dng(bytes: &[u8]) -> bool {
    let first = Tiff::open(bytes).and_then(|t| t.ifd(t.first()?));
    first.is_ok_and(|ifd| ifd.uints(50706).is_some() || ifd.uint(262) == Some(32803))
}

/// The maker that the first directory names where it is no DNG's and has others within it.
pub(super) fn maker_of_previews(bytes: &[u8]) -> Option<String> {
    let file = Tiff::open(bytes).ok()?;
    let first = file.ifd(file.first().ok()?).ok()?;
    let is_own = first.uints(330).is_some() && first.uints(50706).is_none();
    first.text(271).filter(|_| is_own)
}

/// A TIFF whose uncompressed directories have no Predictor: TIFF 6.0 knows it of compressed samples
/// only, and readers by libtiff take uncompressed ones as they are. The `tiff` crate would undo it.
pub(super) fn without_idle_predictors(bytes: &[u8]) -> Cow<'_, [u8]> {
    let mut out = Cow::Borrowed(bytes);
    let Ok(file) = Tiff::open(bytes) else { return out };
    let mut next = file.first().ok();
    // No file has more directories than this; a chain that closes on itself ends here.
    for _ in 0..bytes.len() / MIN_DIRECTORY {
        let Some(ifd) = next.and_then(|offset| file.ifd(offset).ok()) else { break };
        let compressed = ifd.uint(259).is_some_and(|compression| compression != 1);
        if let Some(field) = ifd.fields.get(&317).filter(|field| field.kind == 3 && !compressed)
            && ifd.uint(317) > Some(1)
        {
            let one = if file.big_endian { 1u16.to_be_bytes() } else { 1u16.to_le_bytes() };
            out.to_mut()[field.start..field.start + 2].copy_from_slice(&one);
        }
        next = file.next(&ifd).ok().flatten();
    }
    out
}

/// Bytes of a directory without a field.
const MIN_DIRECTORY: usize = 6;

impl<'a> Tiff<'a> {
    /// Checks byte order mark and version.
    pub fn open(bytes: &'a [u8]) -> Result<Self> {
        let big_endian = bytes.starts_with(b"MM");
        let mut file = Self { bytes, big_endian, big: false };
        let marked = big_endian || bytes.starts_with(b"II");
        file.big = match file.u16(2)? {
            42 if marked => false,
            // A BigTIFF says that its offsets have 8 bytes.
            43 if marked && (file.u16(4)?, file.u16(6)?) == (8, 0) => true,
            _ => return Err(Error::unsupported("not a TIFF file")),
        };
        Ok(file)
    }

    /// Offset of the first directory.
    pub fn first(&self) -> Result<usize> {
        self.offset(if self.big { 8 } else { 4 })
    }

    /// Offset of the directory behind another one in the file's chain; `None` behind the last.
    pub fn next(&self, ifd: &Ifd) -> Result<Option<usize>> {
        Ok(Some(self.offset(ifd.end)?).filter(|&offset| offset > 0))
    }

    /// The directory at an offset.
    pub fn ifd(&self, offset: usize) -> Result<Ifd<'a>> {
        // Bytes of the number of fields and of a field.
        let (head, entry) = if self.big { (8, 20) } else { (2, 12) };
        let count = if self.big { self.offset(offset)? } else { self.u16(offset)?.into() };
        let field = |i: usize| offset.saturating_add(head).saturating_add(i.saturating_mul(entry));
        let mut fields = BTreeMap::new();
        let mut reach = field(count);
        for i in 0..count {
            let at = field(i);
            let (tag, kind) = (self.u16(at)?, self.u16(at + 2)?);
            // The TIFF specification: skip unknown types.
            let Some(size) = size_of(kind) else { continue };
            let length = self.offset(at + 4)?.saturating_mul(size);
            // A value that fits in place of its offset is stored there.
            let (place, room) = if self.big { (at + 12, 8) } else { (at + 8, 4) };
            let start = if length <= room { place } else { self.offset(place)? };
            let data = self.slice(start, length).map_err(|e| e.at(format!("TIFF tag {tag}")))?;
            reach = reach.max(start + length);
            fields.insert(tag, Field { kind, start, data, big_endian: self.big_endian });
        }
        Ok(Ifd { fields, end: field(count), reach })
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

    /// An offset or a count: 32 bits, of a BigTIFF 64.
    fn offset(&self, at: usize) -> Result<usize> {
        if self.big {
            return Ok(u64_of(self.slice(at, 8)?, self.big_endian) as usize);
        }
        Ok(u32_of(self.slice(at, 4)?, self.big_endian) as usize)
    }
}

/// Bytes of a value of a type.
fn size_of(kind: u16) -> Option<usize> {
    Some(match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16 | 17 | 18 => 8,
        _ => return None,
    })
}

fn u64_of(b: &[u8], big_endian: bool) -> u64 {
    let (a, b) = (u64::from(u32_of(b, big_endian)), u64::from(u32_of(&b[4..], big_endian)));
    if big_endian { a << 32 | b } else { b << 32 | a }
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
            16 | 18 => f.data.chunks_exact(8).map(|b| u64_of(b, f.big_endian)).collect(),
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
            12 => eights.map(|b| f64::from_bits(u64_of(b, f.big_endian))).collect(),
            6 => f.data.iter().map(|&b| f64::from(b as i8)).collect(),
            8 => f.data.chunks_exact(2).map(|b| f64::from(f.u16(b) as i16)).collect(),
            9 => {
                f.data.chunks_exact(4).map(|b| f64::from(u32_of(b, f.big_endian) as i32)).collect()
            }
            17 => eights.map(|b| u64_of(b, f.big_endian) as i64 as f64).collect(),
            _ => self.uints(tag)?.into_iter().map(|v| v as f64).collect(),
        };
        values.iter().all(|v| v.is_finite()).then_some(values)
    }

    /// The number of values of a field.
    pub fn count(&self, tag: u16) -> Option<usize> {
        let field = self.fields.get(&tag)?;
        Some(field.data.len() / size_of(field.kind)?)
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
