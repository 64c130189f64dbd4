//! NumPy `.npy` files: their header, and arrays of floating-point numbers.
//!
//! The format is that of NumPy's `numpy.lib.format`: magic and version, the length of a header, the
//! header as a Python dictionary of three keys, and the samples.

use super::{Error, Result};
use std::io::{self, Read, Write};

/// The header of an array, which ends where the samples begin.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// NumPy's name of the samples' type: `<u2`, `|u1`, `>f8`.
    pub descr: String,
    /// Whether the first index runs fastest (Fortran order).
    pub fortran: bool,
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// Position of the first sample in the file, bytes.
    pub offset: u64,
}

/// Longest header, bytes: that of an array of numbers is a hundredth of it.
const MAX_HEADER: u32 = 1 << 16;

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

impl Header {
    /// Reads the header at the start of a file, and nothing behind it.
    ///
    /// # Errors
    /// What is no NPY file, a file that ends within its header, a header that is not of an array of
    /// numbers.
    pub fn read(file: &mut impl Read) -> Result<Self> {
        let fixed = up_to(file, 8)?;
        if !fixed.starts_with(b"\x93NUMPY") || fixed.len() < 8 {
            return Err(Error::input("not a NumPy array"));
        }
        let size = if fixed[6] >= 2 { 4 } else { 2 };
        let mut length = up_to(file, size)?;
        length.resize(4, 0);
        let length = u32::from_le_bytes([length[0], length[1], length[2], length[3]]);
        let start = 8 + size;
        let text = up_to(file, u64::from(length.min(MAX_HEADER)))?;
        if (text.len() as u64) < u64::from(length.min(MAX_HEADER)) {
            return Err(truncated(start + u64::from(length), start + text.len() as u64));
        }
        let parsed =
            std::str::from_utf8(&text).ok().filter(|_| length <= MAX_HEADER).and_then(parse);
        let (descr, fortran, shape) = parsed.ok_or_else(|| {
            Error::unsupported("an NPY header that is not of an array of numbers")
                .help("save the array with numpy.save, without named fields")
        })?;
        Ok(Self { descr, fortran, shape, offset: start + u64::from(length) })
    }

    /// The samples behind the header, from a file of `bytes` bytes in all.
    ///
    /// # Errors
    /// Samples of another type, Fortran order, a file shorter than its header says.
    pub fn samples<T: Sample>(&self, file: &mut impl Read, bytes: u64) -> Result<Vec<T>> {
        let product = self.shape.iter().try_fold(T::SIZE, |a, &n| a.checked_mul(n));
        let needed = product.filter(|&n| (n as u64).saturating_add(self.offset) <= bytes);
        let Some(needed) = needed.filter(|_| !self.fortran) else {
            return Err(Error::input(format!(
                "array of shape {:?} in a file of {bytes} bytes",
                self.shape
            ))
            .help("the file is truncated, or not in C order"));
        };
        let swap = match self.descr.strip_suffix(T::KIND) {
            Some("<") => false,
            Some(">") => true,
            _ => {
                return Err(Error::input(format!("an array of type {}", self.descr))
                    .help(format!("save it as {}: array.astype('<{0}')", T::KIND)));
            }
        };
        let raw = up_to(file, needed as u64)?;
        if raw.len() < needed {
            return Err(truncated(needed as u64, raw.len() as u64));
        }
        Ok(raw.chunks_exact(T::SIZE).map(|bytes| T::from_bytes(bytes, swap)).collect())
    }
}

/// Writes an array in C order, axes as in [`header`].
///
/// # Errors
/// Those of the writer.
pub fn write<T: Sample>(out: &mut impl Write, shape: &str, values: &[T]) -> io::Result<()> {
    out.write_all(&header(&format!("<{}", T::KIND), shape))?;
    values.iter().try_for_each(|value| value.write(out))
}

/// A type of samples: `f32` and `f64`.
pub trait Sample: Copy {
    /// NumPy's name without the byte order.
    const KIND: &'static str;
    /// Bytes.
    const SIZE: usize;
    /// From as many bytes, the least significant first unless they are to be swapped.
    fn from_bytes(bytes: &[u8], swap: bool) -> Self;
    /// Writes the least significant byte first.
    ///
    /// # Errors
    /// Those of the writer.
    fn write(self, out: &mut impl Write) -> io::Result<()>;
}

macro_rules! sample {
    ($type:ty, $kind:literal, $size:literal) => {
        impl Sample for $type {
            const KIND: &'static str = $kind;
            const SIZE: usize = $size;

            fn from_bytes(bytes: &[u8], swap: bool) -> Self {
                let mut own = [0; $size];
                own.copy_from_slice(bytes);
                if swap { Self::from_be_bytes(own) } else { Self::from_le_bytes(own) }
            }

            fn write(self, out: &mut impl Write) -> io::Result<()> {
                out.write_all(&self.to_le_bytes())
            }
        }
    };
}

sample!(f32, "f4", 4);
sample!(f64, "f8", 8);

/// As many bytes, or what there is of them.
fn up_to(file: &mut impl Read, count: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let read = file.take(count).read_to_end(&mut bytes);
    read.map_err(|e| Error::input(format!("NPY file: {e}")))?;
    Ok(bytes)
}

fn truncated(needed: u64, found: u64) -> Error {
    Error::input(format!("truncated: {needed} bytes needed, {found} there"))
        .help("the file is incomplete or its header is damaged; get it again")
}

/// Type, order and shape of a header's dictionary.
fn parse(text: &str) -> Option<(String, bool, Vec<usize>)> {
    let value = |key: &str| {
        let (_, rest) = text.split_once(&format!("'{key}'"))?;
        Some(rest.trim_start().strip_prefix(':')?.trim_start())
    };
    let (descr, _) = value("descr")?.strip_prefix('\'')?.split_once('\'')?;
    let order = value("fortran_order")?;
    let fortran = order.starts_with("True");
    let (axes, _) = value("shape")?.strip_prefix('(')?.split_once(')')?;
    let axes = axes.split(',').map(str::trim).filter(|axis| !axis.is_empty());
    // Python 2 wrote long integers with an L.
    let shape = axes.map(|axis| axis.trim_end_matches('L').parse().ok()).collect::<Option<_>>()?;
    (fortran || order.starts_with("False")).then(|| (descr.to_string(), fortran, shape))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_are_read_as_they_were_written_and_as_numpy_writes_them() {
        let mut bytes = Vec::new();
        write(&mut bytes, "(2, 1)", &[1.5, -2.0]).unwrap();
        let file = &mut &bytes[..];
        let found = Header::read(file).unwrap();
        assert_eq!((&*found.descr, found.fortran, &*found.shape), ("<f8", false, &[2, 1][..]));
        assert_eq!(found.offset % 64, 0);
        assert_eq!(found.samples::<f64>(file, bytes.len() as u64).unwrap(), [1.5, -2.0]);
        // Another type, another order of bytes, a file cut short.
        let read = |text: &str, data: &[u8]| {
            let mut bytes = b"\x93NUMPY\x02\0".to_vec();
            bytes.extend((text.len() as u32).to_le_bytes());
            bytes.extend(text.as_bytes());
            bytes.extend(data);
            let file = &mut &bytes[..];
            Header::read(file)?.samples::<f32>(file, bytes.len() as u64)
        };
        let text = "{'shape': (1L,), 'fortran_order': False, 'descr': '>f4'}";
        assert_eq!(read(text, &2.5f32.to_be_bytes()).unwrap(), [2.5]);
        let said = |text: &str, data: &[u8]| read(text, data).unwrap_err().to_string();
        assert!(said(text, &[0; 3]).contains("truncated"));
        assert!(said(&text.replace("f4", "f8"), &[0; 8]).contains("type >f8"));
        assert!(said(&text.replace("'>f4'", "[('a', '<f4')]"), &[0; 4]).contains("named fields"));
        assert!(said(&text.replace("False", "True"), &[0; 4]).contains("C order"));
    }

    /// Four stated gigabytes are not allocated.
    #[test]
    fn headers_of_no_array_are_refused() {
        let said = |bytes: &[u8]| Header::read(&mut &*bytes).unwrap_err().to_string();
        assert!(said(b"nonsense").contains("not a NumPy array"));
        let long = said(b"\x93NUMPY\x03\0\xff\xff\xff\xff{'descr': '<u2'");
        assert!(long.contains("truncated: 4294967307 bytes needed"), "{long}");
    }
}
