//! Images compressed in tiles (FITS Standard 4.0, section 10.1): a table whose rows are tiles,
//! each a descriptor of bytes in the heap behind the table.

use super::header::{Header, Image};
use super::{Stored, rice};
use crate::{gzip, truncated};
use camrig_base::{Error, Result};

/// Columns that hold a tile in one of the forms a writer may choose for it.
const COLUMNS: [&str; 3] = ["COMPRESSED_DATA", "GZIP_COMPRESSED_DATA", "UNCOMPRESSED_DATA"];
/// Values of a block of Rice coding where the header does not say (section 10.4.1, table 37).
const RICE_BLOCK: usize = 32;
/// Longest block that is taken: writers use 16 or 32.
const LONGEST_RICE_BLOCK: usize = 256;
/// Most values that a byte can encode: 1032 with gzip (the limit of Deflate), fewer with Rice
/// coding, whose blocks of equal values take 3 bits or more.
const MAX_PER_BYTE: usize = 1032;
/// Axes of an image: columns, rows, frames.
const AXES: usize = 3;

/// The values of a compressed image.
///
/// # Errors
/// Compressions other than Rice and gzip of integers, damaged or truncated tiles.
pub(super) fn read(header: &Header, image: &Image, data: &[u8]) -> Result<Stored> {
    let table = Table::of(header, image, data)?;
    if image.bitpix < 0 || image.bitpix > 32 {
        return Err(Error::unsupported(format!(
            "a FITS image of compressed values of BITPIX {}",
            image.bitpix
        ))
        .help("floats are rounded by their compression; funpack writes them plain"));
    }
    let total = image.axes.iter().fold(1usize, |n, &axis| n.saturating_mul(axis));
    if total / MAX_PER_BYTE > data.len() {
        return Err(truncated(total / MAX_PER_BYTE, data.len()));
    }
    let mut values = vec![0i64; total];
    let counts: [usize; AXES] = std::array::from_fn(|a| image.axes[a].div_ceil(table.tile[a]));
    let tiles = counts.iter().fold(1usize, |n, &c| n.saturating_mul(c));
    if tiles != table.rows {
        return Err(Error::input(format!("{} tiles where {tiles} belong", table.rows))
            .at("compressed FITS image"));
    }
    for index in 0..tiles {
        let place =
            [index % counts[0], index / counts[0] % counts[1], index / (counts[0] * counts[1])];
        let first: [usize; AXES] = std::array::from_fn(|a| place[a] * table.tile[a]);
        let sides: [usize; AXES] =
            std::array::from_fn(|a| table.tile[a].min(image.axes[a] - first[a]));
        let tile = table
            .values(image, index, sides.iter().product())
            .map_err(|e| e.at(format!("tile {index} of a compressed FITS image")))?;
        for (line, from) in tile.chunks_exact(sides[0]).enumerate() {
            let (y, z) = (first[1] + line % sides[1], first[2] + line / sides[1]);
            let start = (z * image.axes[1] + y) * image.axes[0] + first[0];
            values[start..start + sides[0]].copy_from_slice(from);
        }
    }
    Ok(Stored::Integers(values))
}

/// The table of tiles.
struct Table<'a> {
    data: &'a [u8],
    rows: usize,
    row_bytes: usize,
    /// Position of the heap in the data.
    heap: usize,
    /// Per column of [`COLUMNS`], offset in the row, and bytes of each half of its descriptor.
    columns: [Option<(usize, usize)>; COLUMNS.len()],
    tile: [usize; AXES],
    compression: String,
    rice_block: usize,
    rice_bits: u32,
}

impl<'a> Table<'a> {
    fn of(header: &Header, image: &Image, data: &'a [u8]) -> Result<Self> {
        let (row_bytes, rows) = (header.length("NAXIS1")?, header.length("NAXIS2")?);
        let heap = header.length("THEAP").unwrap_or(rows.saturating_mul(row_bytes));
        // By default a tile is a row of the image.
        let mut tile = [image.axes[0], 1, 1];
        for (axis, side) in tile.iter_mut().enumerate() {
            let key = format!("ZTILE{}", axis + 1);
            if header.text(&key).is_some() {
                *side = header.length(&key)?;
            }
        }
        if tile.contains(&0) || image.axes.contains(&0) {
            return Err(Error::input("a compressed FITS image of no size"));
        }
        let mut columns = [None; COLUMNS.len()];
        let mut offset = 0;
        for field in 1..=header.length("TFIELDS")?.min(999) {
            let form = header.text(&format!("TFORM{field}")).unwrap_or("");
            let (bytes, half) = field_bytes(form)?;
            let name = header.text(&format!("TTYPE{field}")).unwrap_or("");
            if let (Some(i), Some(half)) = (COLUMNS.iter().position(|c| *c == name), half) {
                columns[i] = Some((offset, half));
            }
            offset += bytes;
        }
        let parameter = |name: &str| {
            let index = (1..=9).find(|i| header.text(&format!("ZNAME{i}")) == Some(name))?;
            header.length(&format!("ZVAL{index}")).ok()
        };
        let rice_bits = match parameter("BYTEPIX").unwrap_or(4) {
            1 => 8,
            2 => 16,
            4 => 32,
            other => {
                let text = format!("Rice coding of {other} bytes");
                return Err(Error::unsupported(text).help("funpack writes the image plain"));
            }
        };
        Ok(Self {
            data,
            rows,
            row_bytes,
            heap,
            columns,
            tile,
            compression: header.text("ZCMPTYPE").unwrap_or("").to_string(),
            rice_block: parameter("BLOCKSIZE").unwrap_or(RICE_BLOCK).clamp(1, LONGEST_RICE_BLOCK),
            rice_bits,
        })
    }

    /// The bytes of a tile in one of its columns, `None` where it is not stored there.
    fn bytes(&self, index: usize, column: usize) -> Result<Option<&'a [u8]>> {
        let Some((offset, half)) = self.columns[column] else { return Ok(None) };
        let slice = |start: usize, length: usize| {
            let end = start.saturating_add(length);
            self.data.get(start..end).ok_or_else(|| truncated(end, self.data.len()))
        };
        let start = index.saturating_mul(self.row_bytes).saturating_add(offset);
        let number = |at: usize| {
            let bytes = slice(start.saturating_add(at * half), half)?;
            Ok::<_, Error>(bytes.iter().fold(0usize, |n, &b| n << 8 | usize::from(b)))
        };
        let (length, place) = (number(0)?, number(1)?);
        if length == 0 {
            return Ok(None);
        }
        slice(self.heap.saturating_add(place), length).map(Some)
    }

    fn values(&self, image: &Image, index: usize, count: usize) -> Result<Vec<i64>> {
        let integers = |bytes: &[u8]| match image.values(bytes)? {
            Stored::Integers(mut values) if values.len() >= count => {
                values.truncate(count);
                Ok(values)
            }
            _ => Err(truncated(count * image.sample_bytes(), bytes.len())),
        };
        let most = count.saturating_mul(image.sample_bytes());
        if let Some(bytes) = self.bytes(index, 1)? {
            return integers(&gzip::inflate(bytes, most)?);
        }
        let Some(bytes) = self.bytes(index, 0)? else {
            let plain = self.bytes(index, 2)?;
            return integers(plain.ok_or_else(|| Error::input("a tile without data"))?);
        };
        match self.compression.as_str() {
            "RICE_1" | "RICE_ONE" => rice::decode(bytes, count, self.rice_block, self.rice_bits),
            "GZIP_1" => integers(&gzip::inflate(bytes, most)?),
            "GZIP_2" => integers(&unshuffled(&gzip::inflate(bytes, most)?, image.sample_bytes())),
            "NOCOMPRESS" => integers(bytes),
            other => Err(Error::unsupported(format!("FITS compression {other:?}"))
                .help("Rice and gzip are read; funpack writes the image plain")),
        }
    }
}

/// Bytes of a table's field, and of each half of its descriptor where it has one (section 7.3.1).
fn field_bytes(form: &str) -> Result<(usize, Option<usize>)> {
    let digits = form.len() - form.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let count = form[..digits].parse().unwrap_or(1usize);
    let (size, half) = match form[digits..].chars().next() {
        Some('P') => (8, Some(4)),
        Some('Q') => (16, Some(8)),
        Some('L' | 'B' | 'A') => (1, None),
        Some('X') => return Ok((count.div_ceil(8), None)),
        Some('I') => (2, None),
        Some('J' | 'E') => (4, None),
        Some('K' | 'D' | 'C') => (8, None),
        Some('M') => (16, None),
        _ => return Err(Error::input(format!("FITS table field of form {form:?}"))),
    };
    Ok((count.min(1 << 20) * size, half))
}

/// Undoes the order of GZIP_2: all first bytes of the values, then all second ones, ...
fn unshuffled(bytes: &[u8], size: usize) -> Vec<u8> {
    let count = bytes.len() / size;
    (0..count * size).map(|i| bytes[i % size * count + i / size]).collect()
}
