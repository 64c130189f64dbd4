//! NumPy `.npy` arrays: H x W, or N x H x W for a stack.
//!
//! Written as version 1.0, `<u2`, C order, byte for byte as `numpy.save` does. Read: unsigned and
//! signed integers of 1 to 8 bytes whose values fit in 16 bits, in C or Fortran order.

use super::{Facts, Frames, area, truncated};
use crate::{Error, Plane, Result};

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

/// Magic, version and dictionary, padded with spaces so that the data begin at a multiple of 64.
fn header(descr: &str, shape: &str) -> Vec<u8> {
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

/// Reads `.npy` bytes.
pub fn decode(bytes: &[u8]) -> Result<Frames> {
    // npyz allocates the length that versions 2 and 3 state before it reads.
    if bytes.get(6).is_some_and(|&v| v >= 2) {
        let stated = bytes.get(8..12).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
        let needed = stated.map_or(12, |n| n as usize + 12);
        if needed > bytes.len() {
            return Err(truncated(needed, bytes.len()));
        }
    }
    let mut rest = bytes;
    let header = npyz::NpyHeader::from_reader(&mut rest)
        .map_err(|e| Error::input(format!("NPY header: {e}")))?;
    let (count, height, width) = match *header.shape() {
        [height, width] => (1, height, width),
        [count, height, width] => (count, height, width),
        _ => {
            return Err(Error::input(format!("an array of shape {:?}", header.shape()))
                .help("frames are H x W or N x H x W"));
        }
    };
    let descr = header.dtype().descr();
    let descr = descr.trim_matches('\'');
    let (sample_size, read): (usize, fn(&[u8]) -> i128) = match descr {
        "|u1" => (1, |b| b[0].into()),
        "<u2" => (2, |b| u16::from_le_bytes([b[0], b[1]]).into()),
        ">u2" => (2, |b| u16::from_be_bytes([b[0], b[1]]).into()),
        "<i2" => (2, |b| i16::from_le_bytes([b[0], b[1]]).into()),
        "<u4" => (4, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]).into()),
        "<i4" => (4, |b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]).into()),
        "<u8" => (8, |b| b.try_into().map_or(-1, |b| u64::from_le_bytes(b).into())),
        "<i8" => (8, |b| b.try_into().map_or(-1, |b| i64::from_le_bytes(b).into())),
        other => {
            return Err(Error::input(format!("an array of type {other}"))
                .help("raw DN are 16-bit unsigned: array.astype('<u2')"));
        }
    };
    let (width, height, count) = (width as usize, height as usize, count as usize);
    let pixels = area(width, height)?;
    let needed = pixels.saturating_mul(sample_size).saturating_mul(count);
    if count == 0 {
        return Err(Error::input("an array of no frames"));
    }
    if needed > rest.len() {
        return Err(truncated(needed, rest.len()));
    }
    let samples = rest[..needed].chunks_exact(sample_size).map(|b| {
        let value = read(b);
        u16::try_from(value)
            .map_err(|_| Error::input(format!("value {value}")).help("raw DN are 0 to 65535"))
    });
    let mut data = samples.collect::<Result<Vec<u16>>>()?;
    if header.order() == npyz::Order::Fortran {
        // The first index runs fastest: the sample at frame n, row y, column x stands at
        // n + count (y + height x).
        let at = |i: usize| i / pixels + count * (i % pixels / width + height * (i % width));
        data = (0..data.len()).map(|i| data[at(i)]).collect();
    }
    let planes = data.chunks_exact(pixels);
    let planes = planes.map(|data| Plane { width, height, data: data.to_vec() }).collect();
    let bits = if sample_size == 1 { Some(8) } else { None };
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
