//! Cubes whose samples lie at regular distances in a file or in memory: NPY, NPZ, ENVI and
//! uncompressed parts of other formats.

use super::cube::BandSource;
pub use camrig_base::Sample;
use camrig_base::{Error, Plane, Result};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::PathBuf;

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

/// The lengths of the three axes of an array that is called `name`, without further ones of length
/// 1.
///
/// # Errors
/// Fewer axes, or more.
pub(super) fn three_axes(name: &str, shape: &[usize]) -> Result<[usize; 3]> {
    let long = shape.iter().copied().filter(|&n| shape.len() == 3 || n != 1);
    <[usize; 3]>::try_from(long.collect::<Vec<usize>>()).map_err(|_| {
        let name = if name.is_empty() { "an array".into() } else { format!("array {name:?}") };
        Error::input(format!("{name} of shape {shape:?}"))
            .help("a spectral cube has three axes: rows, columns, bands")
    })
}

/// A cube of samples at regular distances.
#[derive(Clone, Debug)]
pub struct Strided {
    bytes: Bytes,
    offset: u64,
    sample: Sample,
    big_endian: bool,
    layout: Layout,
}

impl Strided {
    /// A cube that begins `offset` bytes into `bytes`.
    ///
    /// # Errors
    /// An empty cube, or fewer bytes than it takes.
    pub fn new(
        bytes: Bytes,
        offset: u64,
        sample: Sample,
        big_endian: bool,
        layout: Layout,
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
        Ok(Self { bytes, offset, sample, big_endian, layout })
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
                let value = self.sample.read(sample, self.big_endian) as f32;
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
                let cube = Strided::new(bytes, 5, Sample::U16, big_endian, layout).unwrap();
                for band in 0..b {
                    let plane = cube.read(band).unwrap();
                    let expected = Plane::from_fn(w, h, |x, y| value(x, y, band).into());
                    assert_eq!(plane, expected, "{axes}");
                }
            }
        }
    }

    #[test]
    fn cut_off_data_are_refused() {
        let layout = Layout::packed("yxb", [4, 4, 2]).unwrap();
        let new = |bytes, layout| Strided::new(bytes, 0, Sample::F32, false, layout);
        let message = new(Bytes::Memory(vec![0; 127]), layout).unwrap_err().to_string();
        assert!(message.contains("127 bytes of data where 128"), "{message}");
        let huge = Layout { width: usize::MAX, height: usize::MAX, ..layout };
        assert!(new(Bytes::Memory(vec![]), huge).is_err());
        assert!(new(Bytes::Memory(vec![]), Layout { width: 0, ..layout }).is_err());
        assert!(Layout::packed("yxz", [1; 3]).is_err() && Layout::packed("yyxb", [1; 3]).is_err());
    }
}
