//! NumPy `.npy` arrays: H x W, or N x H x W for a stack.
//!
//! The writer makes version 1.0, `<u2` (`<u4` for more than 16 bits), C order, byte for byte as `numpy.save` does. The reader
//! takes integers and floats of 1 to 8 bytes whose values are whole and fit in 16 bits, in either
//! byte order, in C or Fortran order. A last axis of one channel, as image readers give grey
//! frames, is dropped: H x W x 1 is one frame, not H frames of one column. A last axis of two to
//! four after longer ones is refused: it is of colours, or the frames come last.

use super::{Facts, Frames, area, narrow, truncated};
use camrig_base::npy::{Header, header};
use camrig_base::{Dn, Error, Plane, Result, Sample};
use std::io::Read;

/// Frames as `.npy` bytes; one frame is H x W, several are N x H x W.
pub fn encode<S: Dn>(frames: &Frames<S>) -> Result<Vec<u8>> {
    let (width, height) = (frames.width(), frames.height());
    let shape = match frames.planes.len() {
        1 => format!("({height}, {width})"),
        n => format!("({n}, {height}, {width})"),
    };
    let (descr, size) = if S::MAX_BITS == 16 { ("<u2", 2) } else { ("<u4", 4) };
    let mut bytes = header(descr, &shape);
    for dn in frames.planes.iter().flat_map(|plane| &plane.data) {
        let word: u32 = (*dn).into();
        bytes.extend_from_slice(&word.to_le_bytes()[..size]);
    }
    Ok(bytes)
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
    /// Whether their most significant byte comes first.
    pub big_endian: bool,
    /// Position of the first sample in the file, bytes.
    pub offset: u64,
}

impl Layout {
    /// Reads a header; `length` is that of the whole file, bytes.
    ///
    /// # Errors
    /// A damaged header, an array of other than two or three axes or of other samples, a file
    /// shorter than its header says.
    pub fn read(file: &mut impl Read, length: u64) -> Result<Self> {
        let Header { descr, fortran, shape, offset } = Header::read(file)?;
        let (count, height, width) = match shape[..] {
            [height, width] => (1, height, width),
            [height, width, 1] if width > 1 => (1, height, width),
            [height, width, last @ 2..=4] if height.min(width) > last => {
                return Err(Error::unsupported(format!("an array of shape {shape:?}")).help(
                    "it looks like rows x columns x colours; frames are H x W or N x H x W: \
                         np.moveaxis(a, -1, 0) makes frames of it",
                ));
            }
            [count, height, width] | [count, height, width, 1] => (count, height, width),
            _ => {
                return Err(Error::unsupported(format!("an array of shape {shape:?}"))
                    .help("frames are H x W or N x H x W"));
            }
        };
        // Halves have too few bits for DN.
        let known = Sample::of_numpy(&descr).filter(|(sample, _)| *sample != Sample::F16);
        let (sample, big_endian) = known.ok_or_else(|| {
            Error::unsupported(format!("an array of type {descr}"))
                .help("raw DN are 16-bit unsigned: array.astype('<u2')")
        })?;
        let needed = area(width, height)?.saturating_mul(sample.bytes()).saturating_mul(count);
        if count == 0 {
            return Err(Error::input("an array of no frames"));
        }
        let there = length.saturating_sub(offset);
        if needed as u64 > there {
            return Err(truncated(needed, there as usize));
        }
        Ok(Self { count, height, width, fortran, sample, big_endian, offset })
    }
}

/// A sample as DN.
fn dn<S: Dn>(sample: Sample, big_endian: bool, raw: &[u8]) -> Result<S> {
    let value = sample.read(raw, big_endian);
    match sample {
        Sample::F32 | Sample::F64 => narrow::float(value),
        _ => narrow::integer(value as i128),
    }
}

/// Whether bytes are low and high ones of words in turn: all in odd columns are small, and in even
/// columns of even and of odd rows some are large. Green of a colour filter array is in both.
fn are_halves_of_words<S: Dn>(data: &[S], width: usize) -> bool {
    /// High bytes of 14 bits are below this.
    const HIGH: u32 = 64;
    const LOW: u32 = 128;
    let rows = || data.chunks_exact(width.max(1)).enumerate();
    let largest = |column: usize, parity: usize| {
        let rows = rows().filter(|(y, _)| y % 2 == parity);
        rows.flat_map(|(_, row)| row.iter().skip(column).step_by(2)).max().map(|dn| (*dn).into())
    };
    let small = |parity| largest(1, parity).is_some_and(|v| v < HIGH);
    let large = |parity| largest(0, parity).is_some_and(|v| v >= LOW);
    width.is_multiple_of(2) && small(0) && small(1) && large(0) && large(1)
}

fn words<S: Dn>(bytes: &[u8], word: fn([u8; 2]) -> u16) -> Vec<S> {
    let dn = |pair| S::of(word(pair).into()).unwrap_or_default();
    bytes.as_chunks().0.iter().map(|pair| dn(*pair)).collect()
}

/// Whether samples are of more than 16 bits.
pub(super) fn is_wide(bytes: &[u8]) -> bool {
    let layout = Layout::read(&mut &*bytes, bytes.len() as u64);
    layout.is_ok_and(|layout| layout.sample.bytes() > 2)
}

/// Reads `.npy` bytes.
///
/// # Errors
/// Those of [`Layout::read`], and values that are not whole numbers of the samples' type.
pub fn decode<S: Dn>(bytes: &[u8]) -> Result<Frames<S>> {
    let layout = Layout::read(&mut &*bytes, bytes.len() as u64)?;
    let Layout { width, height, count, sample, big_endian, .. } = layout;
    let pixels = width * height;
    let samples = &bytes[layout.offset as usize..][..pixels * count * sample.bytes()];
    let mut data: Vec<S> = match sample {
        Sample::U16 if big_endian => words(samples, u16::from_be_bytes),
        Sample::U16 => words(samples, u16::from_le_bytes),
        _ => {
            let raw = samples.chunks_exact(sample.bytes());
            raw.map(|raw| dn(sample, big_endian, raw)).collect::<Result<_>>()?
        }
    };
    if layout.fortran {
        // The first index runs fastest: the sample at frame n, row y, column x is at
        // n + count (y + height x).
        let at = |i: usize| i / pixels + count * (i % pixels / width + height * (i % width));
        data = (0..data.len()).map(|i| data[at(i)]).collect();
    }
    if sample == Sample::U8 && are_halves_of_words(&data, width) {
        return Err(Error::input("an array of bytes that are halves of 16-bit samples")
            .at(format!("type |u1, rows of {width} bytes"))
            .help(
                "as picamera2 gives raw arrays: save array.view('<u2')[:, :WIDTH], a sample for \
                 each two bytes, without the padding",
            ));
    }
    let planes = data.chunks_exact(pixels);
    let planes = planes.map(|data| Plane { width, height, data: data.to_vec() }).collect();
    let bits = (sample == Sample::U8).then_some(8);
    Ok(Frames { planes, facts: Facts { bits, ..Facts::default() } })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_of_words_are_not_samples() {
        let array = |data: &[u8]| {
            let dictionary = "{'descr': '|u1', 'fortran_order': False, 'shape': (2, 4), }\n";
            let head = [&b"\x93NUMPY\x01\0"[..], &(dictionary.len() as u16).to_le_bytes()];
            [&head.concat()[..], dictionary.as_bytes(), data].concat()
        };
        let words = [0x0140u16, 0x00f0, 0x0190, 0x03c0].map(u16::to_le_bytes).concat();
        let error = decode::<u16>(&array(&words)).unwrap_err().to_string();
        assert!(error.contains("view('<u2')"), "{error}");
        // Eight bits under red light: G R / B G.
        let red = decode::<u16>(&array(&[20, 200, 21, 210, 9, 22, 8, 23])).unwrap();
        assert_eq!(red.facts.bits, Some(8));
        assert!(decode::<u16>(&array(&[200, 20, 210, 21, 22, 9, 23, 8])).is_ok());
    }

    /// What `numpy.save` of `numpy.asfortranarray([[1, 2, 3], [4, 5, 6]], '>u2')` writes.
    #[test]
    fn fortran_order_and_big_endian_are_read() {
        let dictionary = "{'descr': '>u2', 'fortran_order': True, 'shape': (2, 3), }";
        let mut bytes = b"\x93NUMPY\x01\0".to_vec();
        bytes.extend((dictionary.len() as u16 + 1).to_le_bytes());
        bytes.extend(dictionary.as_bytes());
        bytes.push(b'\n');
        bytes.extend([1u16, 4, 2, 5, 3, 6].iter().flat_map(|v| v.to_be_bytes()));
        let frames = decode::<u16>(&bytes).unwrap();
        assert_eq!((frames.width(), frames.height()), (3, 2));
        assert_eq!(frames.planes[0].data, [1, 2, 3, 4, 5, 6]);
    }

    /// What `numpy.save` writes of values of a type.
    fn array(descr: &str, shape: &str, data: impl IntoIterator<Item = u8>) -> Vec<u8> {
        header(descr, shape).into_iter().chain(data).collect()
    }

    #[test]
    fn one_channel_is_no_axis_of_frames() {
        let words = || [1u16, 2, 3, 4, 5, 6].map(u16::to_le_bytes).into_iter().flatten();
        for (shape, size) in [
            ("(2, 3, 1)", (1, 2, 3)),
            ("(1, 2, 3)", (1, 2, 3)),
            ("(1, 2, 3, 1)", (1, 2, 3)),
            ("(2, 3, 1, 1)", (2, 3, 1)),
            ("(6, 1, 1)", (6, 1, 1)),
        ] {
            let frames = decode::<u16>(&array("<u2", shape, words())).unwrap();
            let found = (frames.planes.len(), frames.height(), frames.width());
            assert_eq!(found, size, "{shape}");
            let samples: Vec<u16> = frames.planes.into_iter().flat_map(|p| p.data).collect();
            assert_eq!(samples, [1, 2, 3, 4, 5, 6]);
        }
    }

    #[test]
    fn colours_behind_rows_and_columns_are_refused() {
        let read = |shape: &str, count: usize| decode::<u16>(&array("|u1", shape, vec![0; count]));
        for (shape, count) in [("(5, 6, 3)", 90), ("(5, 4, 2)", 40), ("(5, 6, 4)", 120)] {
            let error = read(shape, count).unwrap_err().to_string();
            assert!(error.contains("moveaxis(a, -1, 0)"), "{shape}: {error}");
        }
        for (shape, count) in [("(3, 5, 6)", 90), ("(9, 2, 2)", 36), ("(5, 6, 5)", 150)] {
            assert!(read(shape, count).is_ok(), "{shape}");
        }
    }

    #[test]
    fn whole_numbers_of_any_type_are_read() {
        let values = [0u16, 300, 65535];
        let read = |descr: &str, data: Vec<u8>| {
            decode::<u16>(&array(descr, "(1, 3)", data)).map(|f| f.planes[0].data.clone())
        };
        let all = |of: &dyn Fn(u16) -> Vec<u8>| values.iter().flat_map(|&v| of(v)).collect();
        for (descr, data) in [
            (">u4", all(&|v| u32::from(v).to_be_bytes().to_vec())),
            (">i4", all(&|v| i32::from(v).to_be_bytes().to_vec())),
            ("<i8", all(&|v| i64::from(v).to_le_bytes().to_vec())),
            ("<f4", all(&|v| f32::from(v).to_le_bytes().to_vec())),
            (">f8", all(&|v| f64::from(v).to_be_bytes().to_vec())),
        ] {
            assert_eq!(read(descr, data).unwrap(), values, "{descr}");
        }
        for (descr, data) in [
            ("<f4", [0.5f32, 1.0, 2.0].map(f32::to_le_bytes).concat()),
            (">i2", [-1i16, 1, 2].map(i16::to_be_bytes).concat()),
            ("<i4", [-1i32, 1, 2].map(i32::to_le_bytes).concat()),
        ] {
            assert!(read(descr, data).is_err(), "{descr}");
        }
    }
}
