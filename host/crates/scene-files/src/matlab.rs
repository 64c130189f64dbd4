//! MATLAB files of version 5 (`save -v6`, `-v7`, and `scipy.io.savemat`): arrays, text and
//! structs.
//!
//! Format: MathWorks, "MAT-File Format", level 5. Sparse arrays and objects, which scenes do not
//! have, are skipped; arrays with imaginary parts are refused, and skipped in structs. Lengths in
//! the file are never trusted: every read is bounded by the bytes present, nesting by
//! [`MAX_DEPTH`].

use super::strided::Sample;
use camrig_base::{Error, Result};
use flate2::read::ZlibDecoder;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// Structs within structs that are parsed; deeper ones are skipped. ISETCam's scenes have three
/// levels.
const MAX_DEPTH: usize = 16;

/// A value of a MATLAB file.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Value {
    /// A real numeric array, the first index fastest.
    Array(Array),
    /// Text.
    Text(String),
    /// The first element of a struct array: field names and values.
    Struct(Vec<(String, Value)>),
    /// A value of another class.
    Other,
}

/// A numeric array with its samples as stored, little-endian.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Lengths of the axes, the fastest first.
    pub shape: Vec<usize>,
    /// Type of the stored samples (MATLAB stores doubles that are small integers as such).
    pub sample: Sample,
    /// The samples.
    pub bytes: Vec<u8>,
}

impl Array {
    /// All samples as numbers.
    pub fn numbers(&self) -> Vec<f64> {
        self.bytes.chunks_exact(self.sample.bytes()).map(|raw| self.sample.number(raw)).collect()
    }

    /// An array of doubles.
    pub fn doubles(shape: Vec<usize>, values: impl IntoIterator<Item = f64>) -> Self {
        let bytes = values.into_iter().flat_map(f64::to_le_bytes).collect();
        Self { shape, sample: Sample::F64, bytes }
    }
}

impl Value {
    /// A field of a struct.
    pub fn field(&self, name: &str) -> Option<&Value> {
        match self {
            Value::Struct(fields) => fields.iter().find(|(n, _)| n == name).map(|(_, v)| v),
            _ => None,
        }
    }

    /// The array, where the value is one.
    pub fn array(&self) -> Option<&Array> {
        match self {
            Value::Array(array) => Some(array),
            _ => None,
        }
    }
}

/// Whether a file is of version 5; one of version 7.3 is an HDF5 file.
pub fn is_version_5(path: &Path) -> Result<bool> {
    let mut start = Vec::new();
    File::open(path)
        .and_then(|file| file.take(HEADER_BYTES as u64).read_to_end(&mut start))
        .map_err(|e| Error::io("read", path, e))?;
    let end = start.get(HEADER_BYTES - 4..);
    Ok(matches!(end, Some([0, 1, b'I', b'M'] | [1, 0, b'M', b'I'])))
}

/// Bytes before the first variable; the last four tell version and byte order.
const HEADER_BYTES: usize = 128;
/// Bytes of a variable that hold at least its type, shape and name.
const HEAD_BYTES: u64 = 4096;

/// Reads the named variables of a file.
pub fn read(path: &Path, wanted: &[&str]) -> Result<Vec<(String, Value)>> {
    let mut variables = Vec::new();
    each(
        path,
        |name| wanted.contains(&name),
        |matrix| {
            let (name, value) = parse_matrix(matrix, wanted, 0)?;
            if wanted.contains(&name.as_str()) {
                variables.push((name, value));
            }
            Ok(())
        },
    )?;
    Ok(variables)
}

/// Names and shapes, rows first, of the numeric arrays of a file.
pub fn list(path: &Path) -> Result<Vec<(String, Vec<usize>)>> {
    let mut arrays = Vec::new();
    each(
        path,
        |_| false,
        |matrix| {
            if matrix.is_empty() {
                return Ok(());
            }
            let Head { class, shape, name, .. } = Cursor(matrix).head()?;
            if NUMERIC.contains(&class) {
                arrays.push((name, shape));
            }
            Ok(())
        },
    )?;
    Ok(arrays)
}

/// Hands the content of each variable to `take`: all of it where its name is `wanted`, else its
/// beginning.
fn each(
    path: &Path,
    wanted: impl Fn(&str) -> bool,
    mut take: impl FnMut(&[u8]) -> Result<()>,
) -> Result<()> {
    let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
    let mut file = BufReader::new(file);
    let mut header = [0; HEADER_BYTES];
    let cut_off = |e: std::io::Error| Error::io("read", path, e).help("the file is cut off");
    file.read_exact(&mut header).map_err(cut_off)?;
    if header[124..] == [1, 0, b'M', b'I'] {
        return Err(
            Error::unsupported("a big-endian MATLAB file").help("save it again with -v7 or -v7.3")
        );
    }
    loop {
        let mut tag = [0; 8];
        match file.read_exact(&mut tag) {
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => return Ok(()),
            other => other.map_err(cut_off)?,
        }
        let [kind, length] = [0, 4].map(|i| u32_at(&tag, i));
        let mut element = (&mut file).take(u64::from(length));
        let mut bytes = Vec::new();
        // A damaged head is read whole, so that what is wrong is said.
        let whole = |head: &[u8]| Cursor(head).head().map_or(true, |head| wanted(&head.name));
        if kind == COMPRESSED {
            let mut packed = ZlibDecoder::new(&mut element);
            packed.by_ref().take(HEAD_BYTES).read_to_end(&mut bytes).map_err(cut_off)?;
            if bytes.len() >= 8 && whole(&bytes[8..]) {
                let declared = 8 + u64::from(u32_at(&bytes, 4));
                let left = declared.saturating_sub(bytes.len() as u64);
                packed.take(left).read_to_end(&mut bytes).map_err(cut_off)?;
            }
        } else {
            element.by_ref().take(HEAD_BYTES).read_to_end(&mut bytes).map_err(cut_off)?;
            if whole(&bytes) {
                element.read_to_end(&mut bytes).map_err(cut_off)?;
            }
        }
        // What is left of the element, or lies behind its zlib stream, is not wanted.
        std::io::copy(&mut element, &mut std::io::sink()).map_err(cut_off)?;
        let left = element.limit();
        if left > 0 {
            return Err(Error::input(format!("the last variable lacks {left} bytes"))
                .help("the file is cut off"));
        }
        match kind {
            COMPRESSED if bytes.len() < 8 => {
                return Err(Error::input("an empty variable").help("the file is damaged"));
            }
            COMPRESSED if (bytes.len() as u64) < HEAD_BYTES || whole(&bytes[8..]) => {
                take(Cursor(&bytes).element()?.1)?;
            }
            COMPRESSED => take(&bytes[8..])?,
            MATRIX => take(&bytes)?,
            _ => {}
        }
    }
}

/// Element type of a variable.
pub(super) const MATRIX: u32 = 14;
/// Element type of a variable compressed by zlib.
pub(super) const COMPRESSED: u32 = 15;

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// The unread rest of an element.
struct Cursor<'a>(&'a [u8]);

impl<'a> Cursor<'a> {
    fn take(&mut self, length: usize) -> Result<&'a [u8]> {
        if length > self.0.len() {
            return Err(Error::input(format!(
                "an element of {length} bytes where {} are left",
                self.0.len()
            ))
            .help("the MATLAB file is damaged or cut off"));
        }
        let (head, rest) = self.0.split_at(length);
        self.0 = rest;
        Ok(head)
    }

    /// The next element: its type and data. Elements are padded to 8 bytes; short ones hold their
    /// data within the tag.
    fn element(&mut self) -> Result<(u32, &'a [u8])> {
        let tag = self.take(8)?;
        let word = u32_at(tag, 0);
        if word >> 16 != 0 {
            let length = (word >> 16) as usize;
            let data = &tag[4..];
            return Ok((word & 0xffff, data.get(..length).unwrap_or(data)));
        }
        let length = u32_at(tag, 4) as usize;
        let data = self.take(length)?;
        let padding = (length.next_multiple_of(8) - length).min(self.0.len());
        self.take(padding)?;
        Ok((word, data))
    }

    /// Flags, shape and name of a matrix.
    fn head(&mut self) -> Result<Head> {
        let flags = self.element()?.1;
        if flags.len() < 4 {
            return Err(Error::input("an array without flags").help("the MATLAB file is damaged"));
        }
        let (class, complex) = (flags[0], flags[1] & 8 != 0);
        let (kind, shape) = self.element()?;
        let shape = numbers(kind, shape)?.into_iter().map(|n| n as usize).collect();
        let name = text(self.element()?.1);
        Ok(Head { class, complex, shape, name })
    }
}

/// What a matrix element begins with.
struct Head {
    class: u8,
    /// Whether imaginary parts follow the real ones.
    complex: bool,
    shape: Vec<usize>,
    name: String,
}

/// Classes of arrays of numbers: double, single and integers.
const NUMERIC: std::ops::RangeInclusive<u8> = 6..=15;

/// Parses the content of a matrix element. At depth 0 a variable that is not wanted is not parsed.
fn parse_matrix(bytes: &[u8], wanted: &[&str], depth: usize) -> Result<(String, Value)> {
    if bytes.is_empty() || depth > MAX_DEPTH {
        return Ok((String::new(), Value::Other));
    }
    let mut cursor = Cursor(bytes);
    let Head { class, complex, shape, name } = cursor.head()?;
    if depth == 0 && !wanted.contains(&name.as_str()) {
        return Ok((name, Value::Other));
    }
    let value = match class {
        2 => parse_struct(&mut cursor, depth)?,
        4 => {
            let (kind, data) = cursor.element()?;
            let codes = numbers(kind, data)?.into_iter();
            Value::Text(codes.filter_map(|c| char::from_u32(c as u32)).collect())
        }
        class if NUMERIC.contains(&class) && complex && depth == 0 => {
            return Err(Error::unsupported(format!("array {name:?} with imaginary parts"))
                .help("save its real part, real(x), or its magnitude, abs(x)"));
        }
        class if NUMERIC.contains(&class) && !complex => {
            let (kind, data) = cursor.element()?;
            let sample = sample_of(kind)?;
            let count = shape.iter().try_fold(1usize, |product, &n| product.checked_mul(n));
            if count.and_then(|n| n.checked_mul(sample.bytes())) != Some(data.len()) {
                return Err(Error::input(format!(
                    "array {name:?} of shape {shape:?} has {} bytes",
                    data.len()
                ))
                .help("the MATLAB file is damaged"));
            }
            Value::Array(Array { shape, sample, bytes: data.to_vec() })
        }
        _ => Value::Other,
    };
    Ok((name, value))
}

fn parse_struct(cursor: &mut Cursor, depth: usize) -> Result<Value> {
    let (kind, length) = cursor.element()?;
    let length = numbers(kind, length)?.first().map_or(0, |&n| n as usize);
    let names = cursor.element()?.1;
    let mut fields = Vec::new();
    for name in names.chunks(length.max(1)) {
        let (_, matrix) = cursor.element()?;
        fields.push((text(name), parse_matrix(matrix, &[], depth + 1)?.1));
    }
    Ok(Value::Struct(fields))
}

fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

fn numbers(kind: u32, data: &[u8]) -> Result<Vec<f64>> {
    let sample = sample_of(kind)?;
    Ok(data.chunks_exact(sample.bytes()).map(|raw| sample.number(raw)).collect())
}

fn sample_of(kind: u32) -> Result<Sample> {
    Ok(match kind {
        1 => Sample::I8,
        2 | 16 => Sample::U8,
        3 => Sample::I16,
        4 | 17 => Sample::U16,
        5 => Sample::I32,
        6 | 18 => Sample::U32,
        7 => Sample::F32,
        9 => Sample::F64,
        12 => Sample::I64,
        13 => Sample::U64,
        _ => {
            return Err(Error::unsupported(format!("MATLAB samples of type {kind}"))
                .help("use single, double or integers"));
        }
    })
}

#[cfg(test)]
mod tests {
    use super::super::matlab_write::{matrix, write};
    use super::*;

    fn example() -> Vec<(&'static str, Value)> {
        vec![
            ("wave", Value::Array(Array::doubles(vec![1, 3], [400.0, 410.0, 420.5]))),
            ("comment", Value::Text("a scene, ±1".into())),
            (
                "basis",
                Value::Struct(vec![
                    (
                        "basis".into(),
                        Value::Array(Array::doubles(vec![2, 2], [1.0, 2.0, 3.0, 4.0])),
                    ),
                    ("deep".into(), Value::Struct(vec![("x".into(), Value::Text("y".into()))])),
                ]),
            ),
        ]
    }

    #[test]
    fn what_is_written_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.mat");
        write(&path, &example()).unwrap();
        assert!(is_version_5(&path).unwrap());
        let arrays = list(&path).unwrap();
        assert_eq!(arrays, [("wave".to_string(), vec![1, 3])]);
        let got = read(&path, &["wave", "comment", "basis"]).unwrap();
        let expected: Vec<_> = example().into_iter().map(|(n, v)| (n.to_string(), v)).collect();
        assert_eq!(got, expected);
        assert_eq!(read(&path, &["comment"]).unwrap().len(), 1);
    }

    #[test]
    fn imaginary_parts_are_refused() {
        let mut bytes = matrix("x", &Value::Array(Array::doubles(vec![1, 1], [0.5])));
        // Behind the tags of matrix and flags, and the class.
        bytes[17] |= 8;
        let error = parse_matrix(&bytes[8..], &["x"], 0).unwrap_err().to_string();
        assert!(error.contains("\"x\" with imaginary parts"), "{error}");
    }

    /// Cutting and corrupting a file anywhere gives an error or other values, never a panic.
    #[test]
    fn damage_is_survived() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.mat");
        write(&path, &example()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let mut errors = 0;
        for i in 0..whole.len() {
            std::fs::write(&path, &whole[..i]).unwrap();
            errors += usize::from(read(&path, &["wave", "comment", "basis"]).is_err());
            let mut damaged = whole.clone();
            damaged[i] ^= 0x5a;
            std::fs::write(&path, &damaged).unwrap();
            let _ = read(&path, &["wave", "comment", "basis"]);
        }
        assert!(errors > 128);
        let plain = matrix("basis", &example()[2].1);
        for i in 8..plain.len() {
            for flip in [0x01, 0x5a, 0xff] {
                let mut damaged = plain.clone();
                damaged[i] ^= flip;
                let _ = parse_matrix(&damaged[8..], &["basis"], 0);
                let _ = parse_matrix(&plain[8..i], &["basis"], 0);
            }
        }
    }
}
