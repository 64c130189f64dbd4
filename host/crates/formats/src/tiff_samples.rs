//! Samples of a TIFF or DNG directory, in strips or tiles: uncompressed, in words or packed, or as
//! lossless JPEG.

use super::ifd::{Ifd, Tiff};
use super::{area, ljpeg, narrow, truncated};
use camrig_base::{Error, Plane, Result};

/// Compression: none.
const UNCOMPRESSED: u64 = 1;
/// Compression: JPEG, which for samples of more than 8 bits is lossless.
const JPEG: u64 = 7;

/// SampleFormat: unsigned, which is the default; undefined samples are read like those (TIFF 6.0).
const UNSIGNED: [u64; 2] = [1, 4];
/// SampleFormat: signed, in two's complement.
const SIGNED: u64 = 2;
/// SampleFormat: floating point.
const FLOAT: u64 = 3;

/// The stored samples of a directory of one sample per pixel.
pub(super) fn read(file: &Tiff, raw: &Ifd) -> Result<Plane<u16>> {
    let width = need(raw, 256, "ImageWidth")? as usize;
    let height = need(raw, 257, "ImageLength")? as usize;
    let (bits, per_pixel) = (raw.uint(258).unwrap_or(16), raw.uint(277).unwrap_or(1));
    let compression = raw.uint(259).unwrap_or(UNCOMPRESSED);
    if ![UNCOMPRESSED, JPEG].contains(&compression) {
        let name = match compression {
            8 | 32946 => " (Deflate, of floating-point DNGs)",
            34892 => " (lossy JPEG)",
            52546 => " (JPEG XL)",
            _ => "",
        };
        return Err(Error::unsupported(format!("a DNG with compression {compression}{name}"))
            .help("uncompressed and lossless JPEG are read; convert it to one of them first"));
    }
    let format = raw.uint(339).unwrap_or(UNSIGNED[0]);
    if format != SIGNED && !UNSIGNED.contains(&format) {
        let name = if format == FLOAT { " (floating point)" } else { "" };
        return Err(Error::unsupported(format!(
            "a raw image of samples of {bits} bits in SampleFormat {format}{name}"
        ))
        .help("integers of 8 to 16 bits are read; convert it to them first"));
    }
    if !(8..=16).contains(&bits) || per_pixel != 1 {
        return Err(Error::unsupported(format!(
            "a raw image of {per_pixel} samples of {bits} bits per pixel"
        ))
        .help("one sample of 8 to 16 bits is read"));
    }
    check_order(raw)?;
    check_fill_order(raw.uint(266).unwrap_or(1))?;
    let mut plane = stored(file, raw, (width, height), (bits as usize, compression))?;
    if format == SIGNED {
        for sample in &mut plane.data {
            *sample = narrow::integer(signed(*sample, bits as u32).into())
                .map_err(|e| e.at("signed samples (SampleFormat 2)"))?;
        }
    }
    Ok(plane)
}

/// Refuses rows and columns that are stored in another order than they lie (DNG 1.2 to 1.7).
fn check_order(raw: &Ifd) -> Result<()> {
    for (tag, name) in [
        (50974, "SubTileBlockSize"),
        (50975, "RowInterleaveFactor"),
        (52547, "ColumnInterleaveFactor"),
    ] {
        let values = raw.uints(tag).unwrap_or_default();
        if let Some(value) = values.iter().find(|value| **value != 1) {
            return Err(Error::unsupported(format!(
                "a raw image of interleaved samples ({name} {value})"
            ))
            .at(format!("{name} (tag {tag})"))
            .help(
                "samples are read that are stored in the order of rows and columns: convert it \
                 with Adobe DNG Converter, or save it without interleaving",
            ));
        }
    }
    Ok(())
}

/// Refuses bytes whose lowest bit is the first (FillOrder 2).
pub(super) fn check_fill_order(order: u64) -> Result<()> {
    match order {
        1 => Ok(()),
        _ => {
            Err(Error::unsupported(format!("a raw image with reversed bits (FillOrder {order})"))
                .at("FillOrder (tag 266)")
                .help("save it with FillOrder 1, for instance with tiffcp -f msb2lsb"))
        }
    }
}

/// A note of an orientation that viewers apply and a raw frame does not: a frame turned as a
/// picture would have another pattern.
pub(super) fn orientation(value: u64) -> Option<String> {
    let shown = match value {
        2 => "mirrored left to right",
        3 => "turned by 180 degrees",
        4 => "mirrored top to bottom",
        5 => "with rows and columns exchanged",
        6 => "turned clockwise by 90 degrees",
        7 => "with rows and columns exchanged, turned by 180 degrees",
        8 => "turned counterclockwise by 90 degrees",
        _ => return None, // as stored, or not known
    };
    Some(format!(
        "the file is to be shown {shown} (Orientation {value}): its rows and columns stay as \
         stored, and what is written from them does not say so"
    ))
}

/// The field of a directory, of which it must have one.
fn need(raw: &Ifd, tag: u16, name: &str) -> Result<u64> {
    raw.uint(tag).ok_or_else(|| Error::input(format!("a raw image without {name}")))
}

/// The value of a sample in two's complement.
fn signed(sample: u16, bits: u32) -> i16 {
    let above = u16::BITS - bits;
    (sample << above) as i16 >> above
}

/// The samples of the strips or tiles, of a size, and of bits per sample in a compression.
fn stored(
    file: &Tiff,
    raw: &Ifd,
    (width, height): (usize, usize),
    (bits, compression): (usize, u64),
) -> Result<Plane<u16>> {
    let tiled = raw.uint(322).is_some();
    let (columns, rows, offsets, lengths) = if tiled {
        let rows = need(raw, 323, "TileLength")?;
        (need(raw, 322, "TileWidth")?, rows, raw.uints(324), raw.uints(325))
    } else {
        let rows = raw.uint(278).unwrap_or(height as u64).min(height as u64);
        (width as u64, rows, raw.uints(273), raw.uints(279))
    };
    let offsets = offsets.ok_or_else(|| Error::input("a raw image without its samples"))?;
    let (columns, rows) = (columns as usize, rows as usize);
    area(columns, rows)?;
    let needed = width.div_ceil(columns).saturating_mul(height.div_ceil(rows));
    // A sample takes a bit at least, even compressed.
    if offsets.len() < needed || area(width, height)? > file.bytes.len().saturating_mul(8) {
        return Err(truncated(needed, offsets.len()).at("strips or tiles"));
    }
    let chunks = Chunks { columns, rows, bits };
    let mut plane = Plane::filled(width, height, 0);
    if compression == JPEG {
        let lengths = lengths
            .filter(|l| l.len() >= needed)
            .ok_or_else(|| Error::input("compressed samples of unknown length"))?;
        for (index, (offset, length)) in offsets.iter().zip(lengths).take(needed).enumerate() {
            let bytes = file.slice(*offset as usize, length as usize)?;
            chunks
                .lossless(bytes, index, &mut plane)
                .map_err(|e| e.at(format!("{} {index}", if tiled { "tile" } else { "strip" })))?;
        }
    } else {
        for (index, &offset) in offsets.iter().take(needed).enumerate() {
            let length = lengths.as_ref().and_then(|l| l.get(index)).map(|&l| l as usize);
            chunks.plain(file, (offset as usize, length), index, &mut plane)?;
        }
    }
    Ok(plane)
}

/// The strips or tiles of an image.
struct Chunks {
    columns: usize,
    rows: usize,
    bits: usize,
}

impl Chunks {
    /// Left and top of a chunk.
    fn corner(&self, index: usize, plane: &Plane<u16>) -> (usize, usize) {
        let across = plane.width.div_ceil(self.columns);
        (index % across * self.columns, index / across * self.rows)
    }

    /// `at` is where the chunk begins, and its length where the file states one.
    fn plain(
        &self,
        file: &Tiff,
        at: (usize, Option<usize>),
        index: usize,
        plane: &mut Plane<u16>,
    ) -> Result<()> {
        let (left, top) = self.corner(index, plane);
        let count = self.columns.min(plane.width - left);
        let row_bytes = self.columns.saturating_mul(self.bits).div_ceil(8);
        for y in top..(top + self.rows).min(plane.height) {
            let start = (y - top).saturating_mul(row_bytes);
            let used = (count * self.bits).div_ceil(8);
            if let Some(length) = at.1.filter(|&length| start.saturating_add(used) > length) {
                return Err(truncated(start.saturating_add(used), length));
            }
            let bytes = file.slice(at.0.saturating_add(start), used)?;
            unpack(file, self.bits, bytes, &mut plane.row_mut(y)[left..left + count]);
        }
        Ok(())
    }

    /// The stream's samples fill the chunk row by row, whatever the JPEG's own width: many writers
    /// take two rows as one, or two columns as one pixel of two components.
    fn lossless(&self, bytes: &[u8], index: usize, plane: &mut Plane<u16>) -> Result<()> {
        let (left, top) = self.corner(index, plane);
        let (samples, row) = ljpeg::decode(bytes, self.columns.saturating_mul(self.rows))?;
        let rows = self.rows.min(plane.height - top);
        let count = self.columns.min(plane.width - left);
        let stored = samples.len();
        if stored < rows * self.columns || !stored.is_multiple_of(self.columns) {
            return Err(truncated(2 * rows * self.columns, 2 * stored));
        }
        // Rows that are cut off where the image ends, or filled up, are of no whole number.
        let whole = count == self.columns || stored == self.rows * self.columns;
        let narrower = self.columns.is_multiple_of(row) && whole;
        if !row.is_multiple_of(self.columns) && !narrower {
            return Err(Error::unsupported(format!(
                "a lossless JPEG of rows of {row} samples for rows of {}",
                self.columns
            ))
            .help("convert it with Adobe DNG Converter, or to an uncompressed DNG"));
        }
        for (y, row) in samples.chunks_exact(self.columns).take(rows).enumerate() {
            plane.row_mut(top + y)[left..left + count].copy_from_slice(&row[..count]);
        }
        Ok(())
    }
}

/// Unpacks a row: words of 16 bits in the file's byte order, narrower samples most significant bit
/// first.
fn unpack(file: &Tiff, bits: usize, bytes: &[u8], row: &mut [u16]) {
    if bits == 16 {
        row.iter_mut()
            .zip(bytes.chunks_exact(2))
            .for_each(|(s, b)| *s = file.sample([b[0], b[1]]));
        return;
    }
    let (mut pool, mut filled, mut next) = (0u32, 0, bytes.iter());
    for sample in row {
        while filled < bits {
            pool = pool << 8 | u32::from(*next.next().unwrap_or(&0));
            filled += 8;
        }
        filled -= bits;
        *sample = (pool >> filled & ((1 << bits) - 1)) as u16;
    }
}
