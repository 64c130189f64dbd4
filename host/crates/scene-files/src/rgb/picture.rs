//! A picture as its file has it: samples, and what the file says of their colours and light.

use camrig_base::{Error, Result};
use camrig_light::colour::space::{Chromaticities, Space};
use camrig_light::colour::transfer::Transfer;
use std::path::Path;

/// Most pixels of a picture: with the spectra's places 3.5 GiB of memory.
pub const MAX_PIXELS: usize = 1 << 27;
/// Most bits of pixels in a byte of a file: compressed by 1032, the most that deflate does. Sizes
/// beyond it are lies.
const MAX_BITS_PER_BYTE: u64 = 8 * 1032;

/// Samples of red, green and blue, interleaved.
#[non_exhaustive]
pub enum Samples {
    /// Whole numbers up to `most`.
    Codes {
        /// The samples.
        data: Vec<u16>,
        /// The number that means 1.
        most: u16,
    },
    /// Real numbers.
    Floats(Vec<f32>),
}

/// What a file says of its colours.
#[non_exhaustive]
pub enum Said {
    /// Nothing.
    Nothing,
    /// This.
    Space(Space),
    /// Something that is not understood, in words.
    Unknown(String),
    /// Something that must not be passed over.
    Refused(Error),
}

impl Said {
    /// Linear colours of the chromaticities that `by` states of red, green, blue and white. Zeros,
    /// which ImageMagick writes where it knows none, are no statement.
    pub fn of_linear(by: &str, primaries: &Chromaticities) -> Self {
        if primaries.as_flattened().iter().all(|v| *v == 0.0) {
            return Self::Unknown(format!("{by} of zeros alone"));
        }
        let space = Space::of(&format!("{by}, linear"), primaries, Transfer::Linear);
        space.map_or_else(|error| Self::Refused(error.at(by)), Self::Space)
    }
}

/// A decoded picture.
pub struct Picture {
    /// Width and height in pixels.
    pub size: (usize, usize),
    /// Its samples, row by row.
    pub samples: Samples,
    /// What the file says of its colours.
    pub said: Said,
    /// Where row 0 and column 0 lie, as EXIF numbers it: 1 is top and left.
    pub orientation: u8,
    /// Luminance of a white of components 1, cd/m², where the file says it.
    pub white_luminance: Option<f64>,
    /// What was understood.
    pub understood: Vec<String>,
    /// What was assumed or ignored.
    pub notes: Vec<String>,
}

/// Refuses sizes that memory or the file's bytes cannot hold.
pub fn check_size(path: &Path, (width, height): (usize, usize)) -> Result<()> {
    check_pixels([width, height])?;
    check_bytes(path, (width, height), 1)
}

/// Refuses sizes that the file's bytes cannot hold where a pixel has at least so many bits.
pub fn check_bytes(path: &Path, (width, height): (usize, usize), bits: usize) -> Result<()> {
    let bytes = std::fs::metadata(path).map_err(|e| Error::io("read", path, e))?.len();
    let all = width.saturating_mul(height).saturating_mul(bits) as u64;
    if all > bytes.saturating_mul(MAX_BITS_PER_BYTE) {
        return Err(Error::input(format!("{width} x {height} pixels in a file of {bytes} bytes"))
            .help("the file is cut off, or its header is wrong"));
    }
    Ok(())
}

/// The number of pixels of a size; refuses sizes that memory cannot hold.
pub fn check_pixels([width, height]: [usize; 2]) -> Result<usize> {
    let what = || format!("a picture of {width} x {height} pixels");
    match width.checked_mul(height) {
        Some(0) => Err(Error::input(what())),
        Some(pixels) if pixels <= MAX_PIXELS => Ok(pixels),
        _ => Err(Error::limit(what()).help(format!("at most {MAX_PIXELS} pixels are read"))),
    }
}

/// Refuses pixels whose width over height is not 1, as what is `said_by` a file; one that makes no
/// sense says nothing.
pub fn check_square(said_by: &str, aspect: f64) -> Result<()> {
    if !(aspect > 0.0 && aspect.is_finite()) || (aspect - 1.0).abs() < 1e-3 {
        return Ok(());
    }
    Err(Error::unsupported(format!("pixels {aspect:.4} times as wide as high ({said_by})"))
        .help("resample it to square pixels, or correct what it says of them"))
}

/// Red, green and blue of interleaved `channels`: 1 is grey, 2 grey with alpha, 4 with alpha.
pub fn three<T: Copy>(data: Vec<T>, channels: usize) -> Vec<T> {
    if channels == 3 {
        return data;
    }
    let colours = if channels < 3 { [0, 0, 0] } else { [0, 1, 2] };
    data.chunks_exact(channels).flat_map(|p| colours.map(|c| p[c])).collect()
}

/// What to say of a picture with `channels`.
pub fn about_channels(channels: usize, notes: &mut Vec<String>) {
    if channels.is_multiple_of(2) {
        notes.push("its opacity (alpha) is not used: colours are taken as they are stored".into());
    }
}

impl Picture {
    /// Turns pixels so that row 0 is the top and column 0 the left.
    pub fn upright<T: Copy>(&self, pixels: Vec<T>) -> ((usize, usize), Vec<T>) {
        turned(self.orientation, self.size, pixels)
    }
}

/// Turns pixels of a size, as stored, so that row 0 is the top and column 0 the left: by an
/// orientation of EXIF and TIFF.
pub fn turned<T: Copy>(
    orientation: u8,
    (width, height): (usize, usize),
    pixels: Vec<T>,
) -> ((usize, usize), Vec<T>) {
    let (right, bottom) = (width - 1, height - 1);
    // The stored pixel of one that is shown at (x, y).
    let stored: fn(usize, usize, usize, usize) -> (usize, usize) = match orientation {
        2 => |x, y, right, _| (right - x, y),
        3 => |x, y, right, bottom| (right - x, bottom - y),
        4 => |x, y, _, bottom| (x, bottom - y),
        5 => |x, y, _, _| (y, x),
        6 => |x, y, _, bottom| (y, bottom - x),
        7 => |x, y, right, bottom| (right - y, bottom - x),
        8 => |x, y, right, _| (right - y, x),
        _ => return ((width, height), pixels),
    };
    let size = if orientation > 4 { (height, width) } else { (width, height) };
    let at = |i: usize| stored(i % size.0, i / size.0, right, bottom);
    let turned = (0..pixels.len()).map(at).map(|(x, y)| pixels[y * width + x]).collect();
    (size, turned)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The eight orientations of EXIF 2.32, 4.6.4: where row 0 and column 0 of the stored picture
    /// lie in the shown one.
    #[test]
    fn every_orientation_is_turned_upright() {
        let stored = vec![1, 2, 3, 4, 5, 6];
        for (orientation, size, shown) in [
            (1, (3, 2), [1, 2, 3, 4, 5, 6]),
            (2, (3, 2), [3, 2, 1, 6, 5, 4]),
            (3, (3, 2), [6, 5, 4, 3, 2, 1]),
            (4, (3, 2), [4, 5, 6, 1, 2, 3]),
            (5, (2, 3), [1, 4, 2, 5, 3, 6]),
            (6, (2, 3), [4, 1, 5, 2, 6, 3]),
            (7, (2, 3), [6, 3, 5, 2, 4, 1]),
            (8, (2, 3), [3, 6, 2, 5, 1, 4]),
        ] {
            let picture = Picture {
                size: (3, 2),
                samples: Samples::Floats(Vec::new()),
                said: Said::Nothing,
                orientation,
                white_luminance: None,
                understood: Vec::new(),
                notes: Vec::new(),
            };
            assert_eq!(picture.upright(stored.clone()), (size, shown.to_vec()), "{orientation}");
        }
    }
}
