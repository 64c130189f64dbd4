//! NumPy `.npy` arrays: H x W, or N x H x W for a stack.
//!
//! The writer makes version 1.0, `<u2`, C order, byte for byte as `numpy.save` does. The reader
//! takes unsigned and signed integers of 1 to 8 bytes whose values fit in 16 bits, in C or Fortran
//! order.

use super::{Facts, Frames, area, truncated};
use camrig_base::{Error, Plane, Result};
use std::io::{Cursor, Read, Seek};

/// Frames as `.npy` bytes; one frame is H x W, several are N x H x W.
pub fn encode(frames: &Frames) -> Result<Vec<u8>> {
    let (width, height) = (frames.width(), frames.height());
    let shape = match frames.planes.len() {
        1 => format!("({height}, {width})"),
        n => format!("({n}, {height}, {width})"),
    };
    let mut bytes = header("<u2", &shape);
    for plane in &frames.planes {
        bytes.extend(plane.data.iter().flat_map(|dn| dn.to_le_bytes()));
    }
    Ok(bytes)
}

/// The header of an array in C order: magic, version 1.0 and dictionary, padded with spaces so
/// that the data begin at a multiple of 64 bytes. `descr` is NumPy's name of the samples' type
/// (`<u2`), `shape` a tuple of the axes' lengths (`(2, 480, 640)`).
pub fn header(descr: &str, shape: &str) -> Vec<u8> {
    let mut text =
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}").into_bytes();
    let padded = (10 + text.len() + 1).next_multiple_of(64) - 10;
    text.resize(padded - 1, b' ');
    text.push(b'\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text);
    bytes
}

/// The content of a header, checked against the length of the file.
pub struct Layout {
    /// Number of frames.
    pub count: usize,
    /// Rows.
    pub height: usize,
    /// Columns.
    pub width: usize,
    /// Whether the first index runs fastest (Fortran order).
    pub fortran: bool,
    /// Type of the samples.
    pub sample: Sample,
    /// Position of the first sample in the file, bytes.
    pub offset: u64,
}

/// A type of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sample {
    /// 8-bit unsigned.
    U8,
    /// 16-bit unsigned, little-endian.
    U16,
    /// 16-bit unsigned, big-endian.
    U16Big,
    /// Other little-endian integers: number of bytes, and whether they are signed.
    Wide(usize, bool),
}

impl Sample {
    /// Bytes per sample.
    pub fn size(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::U16Big => 2,
            Self::Wide(size, _) => size,
        }
    }

    /// The samples in some bytes, DN.
    fn read(self, bytes: &[u8]) -> Result<Vec<u16>> {
        Ok(match self {
            Self::U8 => bytes.iter().map(|&b| u16::from(b)).collect(),
            Self::U16 => bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect(),
            Self::U16Big => {
                bytes.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect()
            }
            Self::Wide(size, signed) => {
                let value = |b: &[u8]| {
                    let mut word = [if signed && b[size - 1] > 127 { 0xff } else { 0 }; 16];
                    word[..size].copy_from_slice(b);
                    i128::from_le_bytes(word)
                };
                let narrow = |value: i128| {
                    u16::try_from(value).map_err(|_| {
                        Error::input(format!("value {value}")).help("raw DN are 0 to 65535")
                    })
                };
                bytes.chunks_exact(size).map(|b| narrow(value(b))).collect::<Result<_>>()?
            }
        })
    }
}

impl Layout {
    /// Reads a header; `length` is that of the whole file, bytes.
    ///
    /// # Errors
    /// A damaged header, an array of other than two or three axes or of other samples, a file
    /// shorter than its header says.
    pub fn read(file: &mut (impl Read + Seek), length: u64) -> Result<Self> {
        let broken = |e: std::io::Error| Error::input(format!("NPY header: {e}"));
        // npyz allocates the length that versions 2 and 3 state before it reads.
        let mut start = [0; 12];
        file.read_exact(&mut start).map_err(broken)?;
        if start[6] >= 2 {
            let stated = u32::from_le_bytes([start[8], start[9], start[10], start[11]]);
            let needed = u64::from(stated) + 12;
            if needed > length {
                return Err(truncated(needed as usize, length as usize));
            }
        }
        file.rewind().map_err(broken)?;
        let header = npyz::NpyHeader::from_reader(&mut *file).map_err(broken)?;
        let (count, height, width) = match *header.shape() {
            [height, width] => (1, height, width),
            [count, height, width] => (count, height, width),
            _ => {
                return Err(Error::unsupported(format!("an array of shape {:?}", header.shape()))
                    .help("frames are H x W or N x H x W"));
            }
        };
        let descr = header.dtype().descr();
        let sample = match descr.trim_matches('\'') {
            "|u1" => Sample::U8,
            "<u2" => Sample::U16,
            ">u2" => Sample::U16Big,
            "<i2" => Sample::Wide(2, true),
            "<u4" => Sample::Wide(4, false),
            "<i4" => Sample::Wide(4, true),
            "<u8" => Sample::Wide(8, false),
            "<i8" => Sample::Wide(8, true),
            other => {
                return Err(Error::unsupported(format!("an array of type {other}"))
                    .help("raw DN are 16-bit unsigned: array.astype('<u2')"));
            }
        };
        let (width, height, count) = (width as usize, height as usize, count as usize);
        let offset = file.stream_position().map_err(broken)?;
        let needed = area(width, height)?.saturating_mul(sample.size()).saturating_mul(count);
        if count == 0 {
            return Err(Error::input("an array of no frames"));
        }
        let there = length.saturating_sub(offset);
        if needed as u64 > there {
            return Err(truncated(needed, there as usize));
        }
        let fortran = header.order() == npyz::Order::Fortran;
        Ok(Self { count, height, width, fortran, sample, offset })
    }
}

/// Reads `.npy` bytes.
///
/// # Errors
/// Those of [`Layout::read`], and values that are not DN from 0 to 65535.
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    let layout = Layout::read(&mut Cursor::new(bytes), bytes.len() as u64)?;
    let Layout { width, height, count, sample, .. } = layout;
    let pixels = width * height;
    let samples = &bytes[layout.offset as usize..][..pixels * count * sample.size()];
    let mut data = sample.read(samples)?;
    if layout.fortran {
        // The first index runs fastest: the sample at frame n, row y, column x stands at
        // n + count (y + height x).
        let at = |i: usize| i / pixels + count * (i % pixels / width + height * (i % width));
        data = (0..data.len()).map(|i| data[at(i)]).collect();
    }
    let planes = data.chunks_exact(pixels);
    let planes = planes.map(|data| Plane { width, height, data: data.to_vec() }).collect();
    let bits = (sample == Sample::U8).then_some(8);
    Ok(Frames { planes, facts: Facts { bits, ..Facts::default() } })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What `numpy.save` of `numpy.asfortranarray([[1, 2, 3], [4, 5, 6]], '>u2')` writes.
    #[test]
    fn fortran_order_and_big_endian_are_read() {
        let dictionary = "{'descr': '>u2', 'fortran_order': True, 'shape': (2, 3), }";
        let mut bytes = b"\x93NUMPY\x01\0".to_vec();
        bytes.extend((dictionary.len() as u16 + 1).to_le_bytes());
        bytes.extend(dictionary.as_bytes());
        bytes.push(b'\n');
        bytes.extend([1u16, 4, 2, 5, 3, 6].iter().flat_map(|v| v.to_be_bytes()));
        let frames = decode(&bytes).unwrap();
        assert_eq!((frames.width(), frames.height()), (3, 2));
        assert_eq!(frames.planes[0].data, [1, 2, 3, 4, 5, 6]);
    }
}
