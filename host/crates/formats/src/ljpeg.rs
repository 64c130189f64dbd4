//! Lossless JPEG (process 14, SOF3), the compression of the samples of most DNG files.
//!
//! Source: ITU-T T.81 (1992), annexes B (markers), C and F.2.2 (Huffman codes), H (lossless
//! prediction). Crates with permissive licences decode one or three components at most; cameras
//! store rows of a colour filter array as two, so that neighbours of one colour predict each
//! other.

use super::truncated;
use camrig_base::{Error, Result};

/// Longest Huffman code, bits (T.81 C.1).
const LONGEST: usize = 16;
/// Fewest bits that a sample takes: a Huffman code has at least one.
const FEWEST_BITS: usize = 1;

/// The samples of an image of `most` of them or fewer, row by row, in the order of the stream:
/// components of a pixel side by side; and how many are in a row.
///
/// # Errors
/// Other processes of JPEG, subsampled components, more samples than `most` or than the bytes can
/// hold, a damaged or truncated stream.
pub(super) fn decode(bytes: &[u8], most: usize) -> Result<(Vec<u16>, usize)> {
    let mut header = Header::default();
    let scan = header.read(bytes)?;
    let components = header.components.len();
    let samples = header.columns.saturating_mul(header.rows).saturating_mul(components);
    if samples == 0 || samples > most || samples > scan.len().saturating_mul(8 / FEWEST_BITS) {
        return Err(damaged(format!(
            "{} x {} pixels of {components} samples in {} bytes, where {most} samples belong",
            header.columns,
            header.rows,
            scan.len()
        )));
    }
    Ok((header.samples(scan, samples)?, header.columns * components))
}

fn damaged(what: impl std::fmt::Display) -> Error {
    Error::input(format!("lossless JPEG: {what}")).help("the file is damaged; get it again")
}

/// A Huffman table: values in the order of their codes.
#[derive(Clone, Default)]
struct Huffman {
    /// Per length in bits, the first code that is too large for it, moved up to 16 bits.
    ends: [u32; LONGEST + 1],
    /// Per length, what to add to a code of that length to get the index of its value.
    shifts: [i32; LONGEST + 1],
    values: Vec<u8>,
}

impl Huffman {
    /// From a table specification (T.81 B.2.4.2): numbers of codes per length, then the values.
    fn new(counts: &[u8], values: &[u8]) -> Self {
        let mut table = Self { values: values.to_vec(), ..Self::default() };
        let (mut code, mut index) = (0u32, 0i32);
        for (length, &count) in (1..).zip(counts) {
            table.shifts[length] = index - code as i32;
            code += u32::from(count);
            index += i32::from(count);
            table.ends[length] = code << (LONGEST - length);
            code <<= 1;
        }
        table
    }
}

/// What the markers before the samples say.
#[derive(Default)]
struct Header {
    columns: usize,
    rows: usize,
    bits: u32,
    /// Identifiers of the components, and the Huffman table of each.
    components: Vec<(u8, usize)>,
    tables: [Option<Huffman>; 4],
    /// Pixels between restart markers; 0 for none.
    restart: usize,
    predictor: u8,
    /// Low bits that were dropped (point transform).
    shift: u32,
}

impl Header {
    /// Reads markers up to the scan; returns the bytes of the scan and what follows.
    fn read<'a>(&mut self, bytes: &'a [u8]) -> Result<&'a [u8]> {
        let mut rest = bytes.strip_prefix(&[0xFF, 0xD8]).ok_or_else(|| {
            Error::unsupported("compressed samples that are no JPEG")
                .help("convert the file to an uncompressed DNG first")
        })?;
        loop {
            let [0xFF, marker, after @ ..] = rest else { return Err(damaged("no marker")) };
            if *marker == 0xFF {
                rest = &rest[1..]; // fill bytes (B.1.1.2)
                continue;
            }
            let length = match after {
                [high, low, ..] => usize::from(u16::from_be_bytes([*high, *low])),
                _ => return Err(truncated(2, after.len()).at("lossless JPEG")),
            };
            let segment = after
                .get(2..length.max(2))
                .ok_or_else(|| truncated(length, after.len()).at("lossless JPEG"))?;
            rest = &after[length.max(2)..];
            match marker {
                0xC3 => self.frame(segment)?,
                0xC4 => self.huffman(segment)?,
                0xDD => {
                    let [high, low, ..] = segment else { return Err(damaged("a short DRI")) };
                    self.restart = usize::from(u16::from_be_bytes([*high, *low]));
                }
                0xDA => {
                    self.scan(segment)?;
                    return Ok(rest);
                }
                0xC0..=0xCF => {
                    return Err(Error::unsupported(format!(
                        "a JPEG that is not lossless (process SOF{})",
                        marker - 0xC0
                    ))
                    .help("its samples are no raw DN; use the raw image of the file"));
                }
                _ => {} // application data, comments
            }
        }
    }

    fn frame(&mut self, segment: &[u8]) -> Result<()> {
        let [bits, y1, y0, x1, x0, count, components @ ..] = segment else {
            return Err(damaged("a short frame header"));
        };
        self.bits = u32::from(*bits);
        self.rows = usize::from(u16::from_be_bytes([*y1, *y0]));
        self.columns = usize::from(u16::from_be_bytes([*x1, *x0]));
        if !(2..=16).contains(&self.bits) || !(1..=4).contains(count) {
            return Err(damaged(format!("{count} components of {bits} bits")));
        }
        if components.len() != 3 * usize::from(*count) {
            return Err(damaged("a short frame header"));
        }
        if components.chunks(3).any(|c| c[1] != 0x11) {
            return Err(Error::unsupported("a lossless JPEG with subsampled components"));
        }
        self.components = components.chunks(3).map(|c| (c[0], 0)).collect();
        Ok(())
    }

    fn huffman(&mut self, mut segment: &[u8]) -> Result<()> {
        while let [place, rest @ ..] = segment {
            let counts = rest.get(..LONGEST).ok_or_else(|| damaged("a short Huffman table"))?;
            let total: usize = counts.iter().map(|&n| usize::from(n)).sum();
            let values = rest.get(LONGEST..LONGEST + total);
            let values = values.ok_or_else(|| damaged("a short Huffman table"))?;
            let slot = self.tables.get_mut(usize::from(*place));
            *slot.ok_or_else(|| damaged(format!("Huffman table {place}")))? =
                Some(Huffman::new(counts, values));
            segment = &rest[LONGEST + total..];
        }
        Ok(())
    }

    fn scan(&mut self, segment: &[u8]) -> Result<()> {
        let count = self.components.len();
        if count == 0 || segment.len() != 4 + 2 * count || usize::from(segment[0]) != count {
            return Err(Error::unsupported("a lossless JPEG of several scans")
                .help("convert the file to an uncompressed DNG first"));
        }
        for ((id, table), chosen) in self.components.iter_mut().zip(segment[1..].chunks(2)) {
            *table = usize::from(chosen[1] >> 4);
            if chosen[0] != *id || self.tables.get(*table).is_none_or(Option::is_none) {
                return Err(damaged(format!("no Huffman table {table}")));
            }
        }
        self.predictor = segment[1 + 2 * count];
        self.shift = u32::from(segment[3 + 2 * count] & 15);
        if !(1..=7).contains(&self.predictor) || self.shift >= self.bits {
            return Err(damaged(format!("predictor {}, shift {}", self.predictor, self.shift)));
        }
        if !self.restart.is_multiple_of(self.columns.max(1)) {
            return Err(Error::unsupported("a lossless JPEG with restarts within a row"));
        }
        Ok(())
    }

    fn samples(&self, scan: &[u8], count: usize) -> Result<Vec<u16>> {
        let tables: Vec<&Huffman> =
            self.components.iter().filter_map(|c| self.tables[c.1].as_ref()).collect();
        let n = tables.len();
        let width = self.columns * n;
        let restart_rows = self.restart / self.columns;
        let first = 1i32 << (self.bits - self.shift - 1);
        let mut bits = Bits { bytes: scan, pool: 0, filled: 0 };
        let mut data = vec![0u16; count];
        let mut seen = 0u16;
        for y in 0..self.rows {
            let (above, row) = data[..(y + 1) * width].split_at_mut(y * width);
            let restarts = restart_rows > 0 && y > 0 && y.is_multiple_of(restart_rows);
            if restarts {
                bits.restart()?;
            }
            // The first row of an interval is predicted from the left (H.1.2.1).
            let above = if y == 0 || restarts { None } else { above.get((y - 1) * width..) };
            for x in 0..width {
                let left = (x >= n).then(|| i32::from(row[x - n]));
                let predicted = match (above, left) {
                    (None, None) => first,
                    (None, Some(left)) => left,
                    (Some(above), None) => i32::from(above[x]),
                    (Some(above), Some(left)) => {
                        let corner = i32::from(above[x - n]);
                        self.predict(left, i32::from(above[x]), corner)
                    }
                };
                row[x] = (predicted + bits.difference(tables[x % n])?) as u16; // modulo 2^16
                seen |= row[x];
            }
        }
        if u32::from(seen) >> (self.bits - self.shift) != 0 {
            return Err(damaged(format!("samples of more than {} bits", self.bits)));
        }
        if self.shift > 0 {
            data.iter_mut().for_each(|v| *v <<= self.shift);
        }
        Ok(data)
    }

    /// Table H.1, from the neighbours a (left), b (above) and c (above left).
    fn predict(&self, a: i32, b: i32, c: i32) -> i32 {
        match self.predictor {
            1 => a,
            2 => b,
            3 => c,
            4 => a + b - c,
            5 => a + ((b - c) >> 1),
            6 => b + ((a - c) >> 1),
            _ => (a + b) >> 1,
        }
    }
}

/// The bits of a scan, without stuffed bytes; ends at a marker.
struct Bits<'a> {
    bytes: &'a [u8],
    /// The next bits, the first one highest.
    pool: u64,
    filled: usize,
}

impl Bits<'_> {
    fn fill(&mut self) {
        while self.filled <= 48 {
            let byte = match self.bytes {
                [0xFF, 0, rest @ ..] => {
                    self.bytes = rest;
                    0xFF
                }
                [0xFF, ..] | [] => return,
                [byte, rest @ ..] => {
                    self.bytes = rest;
                    *byte
                }
            };
            self.pool |= u64::from(byte) << (56 - self.filled);
            self.filled += 8;
        }
    }

    fn take(&mut self, count: usize) -> Result<u32> {
        if count > self.filled {
            return Err(damaged("the samples end early"));
        }
        let value = if count == 0 { 0 } else { self.pool >> (64 - count) };
        self.pool <<= count;
        self.filled -= count;
        Ok(value as u32)
    }

    /// The next difference (T.81 F.2.2.1, H.2.2): a Huffman code for its size, then its bits.
    fn difference(&mut self, table: &Huffman) -> Result<i32> {
        self.fill();
        let next = (self.pool >> 48) as u32;
        let length = (1..=LONGEST).find(|&l| next < table.ends[l]);
        let length = length.ok_or_else(|| damaged("an unknown Huffman code"))?;
        let index = self.take(length)? as i32 + table.shifts[length];
        let size = usize::try_from(index).ok().and_then(|i| table.values.get(i));
        let size = usize::from(*size.ok_or_else(|| damaged("an unknown Huffman code"))?);
        match size {
            0 => Ok(0),
            1..=15 => {
                let value = self.take(size)? as i32;
                Ok(if value < 1 << (size - 1) { value - (1 << size) + 1 } else { value })
            }
            16 => Ok(32768),
            _ => Err(damaged(format!("a difference of {size} bits"))),
        }
    }

    /// Goes on behind the next restart marker.
    fn restart(&mut self) -> Result<()> {
        (self.pool, self.filled) = (0, 0);
        match self.bytes {
            [0xFF, 0xD0..=0xD7, rest @ ..] => {
                self.bytes = rest;
                Ok(())
            }
            _ => Err(damaged("no restart marker where one belongs")),
        }
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
pub(super) use tests::encode;
