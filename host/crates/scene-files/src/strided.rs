//! Cubes whose samples lie at regular distances in a file or in memory: NPY, NPZ, ENVI and
//! uncompressed parts of other formats.

use super::cube::BandSource;
use camrig_base::{Error, Plane, Result};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::PathBuf;

/// Type of the samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Sample {
    /// Unsigned 8 bit.
    U8,
    /// Signed 8 bit.
    I8,
    /// Signed 16 bit.
    I16,
    /// Unsigned 16 bit.
    U16,
    /// Signed 32 bit.
    I32,
    /// Unsigned 32 bit.
    U32,
    /// Signed 64 bit.
    I64,
    /// Unsigned 64 bit.
    U64,
    /// IEEE half.
    F16,
    /// IEEE single.
    F32,
    /// IEEE double.
    F64,
}

impl Sample {
    /// Bytes per sample.
    pub fn bytes(self) -> usize {
        match self {
            Sample::U8 | Sample::I8 => 1,
            Sample::I16 | Sample::U16 | Sample::F16 => 2,
            Sample::I32 | Sample::U32 | Sample::F32 => 4,
            Sample::F64 | Sample::I64 | Sample::U64 => 8,
        }
    }

    /// The sample in the first bytes of `raw`, little-endian, as a double.
    pub fn number(self, raw: &[u8]) -> f64 {
        match self {
            Sample::U8 => f64::from(raw[0]),
            Sample::I8 => f64::from(raw[0].cast_signed()),
            Sample::I16 => f64::from(i16::from_le_bytes([raw[0], raw[1]])),
            Sample::U16 => f64::from(u16::from_le_bytes([raw[0], raw[1]])),
            Sample::F16 => f64::from(half_to_f32(u16::from_le_bytes([raw[0], raw[1]]))),
            Sample::I32 => f64::from(i32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]])),
            Sample::U32 => f64::from(u32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]])),
            Sample::F32 => f64::from(f32::from_le_bytes([raw[0], raw[1], raw[2], raw[3]])),
            Sample::F64 => f64::from_le_bytes(eight(raw)),
            // Beyond 2⁵³ the nearest double.
            Sample::I64 => i64::from_le_bytes(eight(raw)) as f64,
            Sample::U64 => u64::from_le_bytes(eight(raw)) as f64,
        }
    }

    /// The sample in the first bytes of `raw`, in either byte order.
    pub(super) fn read(self, raw: &[u8], big_endian: bool) -> f64 {
        if !big_endian {
            return self.number(raw);
        }
        let mut swapped = [0; 8];
        let n = self.bytes();
        swapped[..n].copy_from_slice(&raw[..n]);
        swapped[..n].reverse();
        self.number(&swapped)
    }
}

fn eight(raw: &[u8]) -> [u8; 8] {
    [raw[0], raw[1], raw[2], raw[3], raw[4], raw[5], raw[6], raw[7]]
}

/// IEEE 754 binary16 to binary32, exact.
fn half_to_f32(bits: u16) -> f32 {
    let magnitude = u32::from(bits & 0x7fff);
    let value = if magnitude >= 0x7c00 {
        f32::from_bits(0x7f80_0000 | (magnitude & 0x3ff) << 13)
    } else {
        // Shift into place and correct the exponent bias by a multiplication, which also
        // normalises subnormals.
        f32::from_bits(magnitude << 13) * f32::from_bits((254 - 15) << 23)
    };
    if bits & 0x8000 == 0 { value } else { -value }
}

/// The bytes of a cube.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Bytes {
    /// In a file, read as needed.
    File(PathBuf),
    /// In memory.
    Memory(Vec<u8>),
}

/// How samples are arranged: distances in samples from one index to the next.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// Columns of the scene.
    pub width: usize,
    /// Rows of the scene.
    pub height: usize,
    /// Bands.
    pub bands: usize,
    /// Distance from a column to the next.
    pub column: usize,
    /// Distance from a row to the next.
    pub row: usize,
    /// Distance from a band to the next.
    pub band: usize,
}

impl Layout {
    /// The layout of a packed array whose axes are named from the slowest to the fastest by the
    /// letters `y`, `x` and `b` (band), with their lengths.
    ///
    /// # Errors
    /// Axes that are not these three letters.
    pub fn packed(axes: &str, lengths: [usize; 3]) -> Result<Self> {
        let place = |axis: char| axes.find(axis).filter(|_| axes.len() == 3);
        let (Some(y), Some(x), Some(b)) = (place('y'), place('x'), place('b')) else {
            return Err(Error::input(format!("axes {axes:?}"))
                .help("name the three axes from slowest to fastest: yxb, byx, ybx, bxy, ..."));
        };
        // A cube whose strides overflow is too large for any memory, which its size shows later.
        let stride =
            |axis: usize| lengths[axis + 1..].iter().fold(1usize, |n, &l| n.saturating_mul(l));
        Ok(Self {
            width: lengths[x],
            height: lengths[y],
            bands: lengths[b],
            column: stride(x),
            row: stride(y),
            band: stride(b),
        })
    }
}

/// A cube of samples at regular distances.
#[derive(Clone, Debug)]
pub struct Strided {
    bytes: Bytes,
    offset: u64,
    sample: Sample,
    big_endian: bool,
    layout: Layout,
    scale: f32,
}

impl Strided {
    /// A cube that begins `offset` bytes into `bytes`; samples are multiplied by `scale`.
    ///
    /// # Errors
    /// An empty cube, or fewer bytes than it takes.
    pub fn new(
        bytes: Bytes,
        offset: u64,
        sample: Sample,
        big_endian: bool,
        layout: Layout,
        scale: f32,
    ) -> Result<Self> {
        let sizes = [layout.width, layout.height, layout.bands];
        let count = sizes
            .iter()
            .try_fold(sample.bytes() as u64, |product, &n| product.checked_mul(n as u64));
        let Some(needed) = count.filter(|&n| n > 0).and_then(|n| n.checked_add(offset)) else {
            let [w, h, b] = sizes;
            return Err(Error::limit(format!("a cube of {w} x {h} pixels and {b} bands")));
        };
        let present = match &bytes {
            Bytes::File(path) => {
                std::fs::metadata(path).map_err(|e| Error::io("read", path, e))?.len()
            }
            Bytes::Memory(memory) => memory.len() as u64,
        };
        if present < needed {
            let error = Error::input(format!("{present} bytes of data where {needed} are needed"))
                .help("the file is cut off, or its header gives a wrong size or sample type");
            return Err(match &bytes {
                Bytes::File(path) => error.at(path.display()),
                Bytes::Memory(_) => error,
            });
        }
        Ok(Self { bytes, offset, sample, big_endian, layout, scale })
    }
}

impl BandSource for Strided {
    fn size(&self) -> (usize, usize) {
        (self.layout.width, self.layout.height)
    }

    fn bands(&self) -> usize {
        self.layout.bands
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        let Layout { width, height, column, row, .. } = self.layout;
        let mut plane = Plane::filled(width, height, 0.0f32);
        // Reads along the axis whose samples lie closer together.
        let transposed = column > row;
        let (lines, line_step, count, step) =
            if transposed { (width, column, height, row) } else { (height, row, width, column) };
        let bytes = self.sample.bytes();
        let run = ((count - 1) * step + 1) * bytes;
        let mut buffer = vec![0; run];
        let mut file = match &self.bytes {
            Bytes::File(path) => {
                Some((path, File::open(path).map_err(|e| Error::io("open", path, e))?))
            }
            Bytes::Memory(_) => None,
        };
        for line in 0..lines {
            let start = band * self.layout.band + line * line_step;
            let start = self.offset + (start * bytes) as u64;
            let raw = match (&mut file, &self.bytes) {
                (Some((path, file)), _) => {
                    file.seek(SeekFrom::Start(start))
                        .and_then(|_| file.read_exact(&mut buffer))
                        .map_err(|e| Error::io("read", path, e))?;
                    &buffer[..]
                }
                (None, Bytes::Memory(memory)) => &memory[start as usize..start as usize + run],
                (None, Bytes::File(_)) => &[],
            };
            for (i, sample) in raw.chunks(step * bytes).enumerate() {
                let value = self.sample.read(sample, self.big_endian) as f32 * self.scale;
                let (x, y) = if transposed { (line, i) } else { (i, line) };
                plane.data[y * width + x] = value;
            }
        }
        Ok(plane)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_exact() {
        for (bits, value) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0001, 2f32.powi(-24)),
            (0x03ff, 1023.0 * 2f32.powi(-24)),
            (0x3555, 0.333_251_95),
            (0x0000, 0.0),
        ] {
            assert_eq!(half_to_f32(bits), value);
        }
        assert!(half_to_f32(0x7e00).is_nan() && half_to_f32(0xfc00) == f32::NEG_INFINITY);
    }

    #[test]
    fn every_order_of_axes_gives_the_same_cube() {
        let (w, h, b) = (3, 2, 4);
        let value = |x: usize, y: usize, band: usize| (100 * band + 10 * y + x) as u16;
        for axes in ["yxb", "ybx", "byx", "bxy", "xyb", "xby"] {
            let length = |c: char| match c {
                'x' => w,
                'y' => h,
                _ => b,
            };
            let lengths: Vec<usize> = axes.chars().map(length).collect();
            let lengths = [lengths[0], lengths[1], lengths[2]];
            let layout = Layout::packed(axes, lengths).unwrap();
            let mut samples = vec![0u16; w * h * b];
            for band in 0..b {
                for y in 0..h {
                    for x in 0..w {
                        samples[band * layout.band + y * layout.row + x * layout.column] =
                            value(x, y, band);
                    }
                }
            }
            for big_endian in [false, true] {
                let mut memory = vec![7; 5];
                memory.extend(
                    samples
                        .iter()
                        .flat_map(|s| if big_endian { s.to_be_bytes() } else { s.to_le_bytes() }),
                );
                let bytes = Bytes::Memory(memory);
                let cube = Strided::new(bytes, 5, Sample::U16, big_endian, layout, 0.5).unwrap();
                for band in 0..b {
                    let plane = cube.read(band).unwrap();
                    let expected = Plane::from_fn(w, h, |x, y| f32::from(value(x, y, band)) * 0.5);
                    assert_eq!(plane, expected, "{axes}");
                }
            }
        }
    }

    #[test]
    fn cut_off_data_are_refused() {
        let layout = Layout::packed("yxb", [4, 4, 2]).unwrap();
        let new = |bytes, layout| Strided::new(bytes, 0, Sample::F32, false, layout, 1.0);
        let message = new(Bytes::Memory(vec![0; 127]), layout).unwrap_err().to_string();
        assert!(message.contains("127 bytes of data where 128"), "{message}");
        let huge = Layout { width: usize::MAX, height: usize::MAX, ..layout };
        assert!(new(Bytes::Memory(vec![]), huge).is_err());
        assert!(new(Bytes::Memory(vec![]), Layout { width: 0, ..layout }).is_err());
        assert!(Layout::packed("yxz", [1; 3]).is_err() && Layout::packed("yyxb", [1; 3]).is_err());
    }
}
