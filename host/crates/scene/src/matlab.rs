//! MATLAB files of version 5 (`save -v6`, `-v7`, and `scipy.io.savemat`): arrays, text and
//! structs.
//!
//! Format: MathWorks, "MAT-File Format", level 5. Sparse arrays, objects and imaginary parts,
//! which scenes do not have, are skipped. Lengths in the file are never trusted: every read is
//! bounded by the bytes present, nesting by [`MAX_DEPTH`].

use super::strided::Sample;
use camrig_base::{Error, Result};
use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::Path;

/// Structs within structs that are parsed; deeper ones are skipped. ISETCam's scenes have three
/// levels.
const MAX_DEPTH: usize = 16;

/// A value of a MATLAB file.
#[derive(Clone, Debug, PartialEq)]
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

/// Whether the first bytes of a file are those of a version 5 file.
pub fn is_version_5(start: &[u8]) -> bool {
    start.len() >= 128 && matches!(&start[124..128], [0, 1, b'I', b'M'] | [1, 0, b'M', b'I'])
}

/// Reads the named variables of a file.
pub fn read(path: &Path, wanted: &[&str]) -> Result<Vec<(String, Value)>> {
    let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
    let mut file = BufReader::new(file);
    let mut header = [0; 128];
    let cut_off = |e: std::io::Error| Error::io("read", path, e).help("the file is cut off");
    file.read_exact(&mut header).map_err(cut_off)?;
    if header[124..128] == [1, 0, b'M', b'I'] {
        return Err(
            Error::unsupported("a big-endian MATLAB file").help("save it again with -v7 or -v7.3")
        );
    }
    let mut variables = Vec::new();
    loop {
        let mut tag = [0; 8];
        match file.read_exact(&mut tag) {
            Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => return Ok(variables),
            other => other.map_err(cut_off)?,
        }
        let [kind, length] = [0, 4].map(|i| u32_at(&tag, i));
        let mut element = (&mut file).take(u64::from(length));
        let mut bytes = Vec::new();
        let read = match kind {
            COMPRESSED => ZlibDecoder::new(&mut element).read_to_end(&mut bytes),
            _ => element.read_to_end(&mut bytes),
        };
        read.map_err(cut_off)?;
        let left = element.limit();
        let matrix = match kind {
            COMPRESSED => {
                // Bytes of the element behind the zlib stream belong to no variable.
                std::io::copy(&mut element, &mut std::io::sink()).map_err(cut_off)?;
                Cursor(&bytes).element()?.1
            }
            _ if left > 0 => {
                return Err(Error::input(format!("the last variable lacks {left} bytes"))
                    .help("the file is cut off"));
            }
            MATRIX => &bytes,
            _ => continue,
        };
        let (name, value) = parse_matrix(matrix, wanted, 0)?;
        if wanted.contains(&name.as_str()) {
            variables.push((name, value));
        }
    }
}

/// Element type of a variable.
const MATRIX: u32 = 14;
/// Element type of a variable compressed by zlib.
const COMPRESSED: u32 = 15;

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
}

/// Parses the content of a matrix element. At depth 0 a variable that is not wanted is not parsed.
fn parse_matrix(bytes: &[u8], wanted: &[&str], depth: usize) -> Result<(String, Value)> {
    if bytes.is_empty() || depth > MAX_DEPTH {
        return Ok((String::new(), Value::Other));
    }
    let mut cursor = Cursor(bytes);
    let flags = cursor.element()?.1;
    if flags.len() < 4 {
        return Err(Error::input("an array without flags").help("the MATLAB file is damaged"));
    }
    let class = flags[0];
    let (kind, shape) = cursor.element()?;
    let shape: Vec<usize> = numbers(kind, shape)?.into_iter().map(|n| n as usize).collect();
    let name = text(cursor.element()?.1);
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
        6..=13 => {
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
        _ => {
            return Err(Error::unsupported(format!("MATLAB samples of type {kind}"))
                .help("use single, double, or integers of up to 32 bits"));
        }
    })
}

/// Writes variables as a version 5 file, each compressed (as MATLAB's `save -v7`).
pub fn write(path: &Path, variables: &[(&str, Value)]) -> Result<()> {
    let failed = |e: std::io::Error| Error::io("write", path, e);
    let mut out = std::io::BufWriter::new(File::create(path).map_err(failed)?);
    let mut header = [b' '; 128];
    let about = b"MATLAB 5.0 MAT-file, written by camrig";
    header[..about.len()].copy_from_slice(about);
    header[116..124].fill(0);
    header[124..].copy_from_slice(&[0, 1, b'I', b'M']);
    out.write_all(&header).map_err(failed)?;
    for (name, value) in variables {
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::fast());
        packed.write_all(&matrix(name, value)).map_err(failed)?;
        let packed = packed.finish().map_err(failed)?;
        let length = u32::try_from(packed.len()).map_err(|_| {
            Error::limit(format!("variable {name:?} is larger than a version 5 file can hold"))
                .help("export a scene of fewer pixels, or to ENVI")
        })?;
        out.write_all(&COMPRESSED.to_le_bytes()).map_err(failed)?;
        out.write_all(&length.to_le_bytes()).map_err(failed)?;
        out.write_all(&packed).map_err(failed)?;
    }
    out.flush().map_err(failed)
}

/// One element with its tag and padding.
fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = kind.to_le_bytes().to_vec();
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(8), 0);
    bytes
}

/// A matrix element of a value.
fn matrix(name: &str, value: &Value) -> Vec<u8> {
    let int32 = |values: &[usize]| -> Vec<u8> {
        values.iter().flat_map(|&n| (n as i32).to_le_bytes()).collect()
    };
    let (class, shape, content) = match value {
        Value::Array(array) => {
            let (class, kind) = if array.sample == Sample::F32 { (7u8, 7) } else { (6, 9) };
            let data = match array.sample {
                Sample::F32 | Sample::F64 => element(kind, &array.bytes),
                _ => {
                    let doubles: Vec<u8> =
                        array.numbers().into_iter().flat_map(f64::to_le_bytes).collect();
                    element(kind, &doubles)
                }
            };
            (class, array.shape.clone(), data)
        }
        Value::Text(text) => {
            let codes: Vec<u16> = text.encode_utf16().collect();
            let data: Vec<u8> = codes.iter().flat_map(|c| c.to_le_bytes()).collect();
            (4, vec![1, codes.len()], element(4, &data))
        }
        Value::Struct(fields) => {
            let mut content = Vec::new();
            // A field name length as a small element, then names of 32 bytes each.
            content.extend([5, 0, 4, 0, 32, 0, 0, 0]);
            let mut names = Vec::new();
            for (name, _) in fields {
                let mut padded = [0; 32];
                let kept = name.len().min(31);
                padded[..kept].copy_from_slice(&name.as_bytes()[..kept]);
                names.extend(padded);
            }
            content.extend(element(1, &names));
            for (_, value) in fields {
                content.extend(matrix("", value));
            }
            (2, vec![1, 1], content)
        }
        Value::Other => (6, vec![0, 0], element(9, &[])),
    };
    let mut body = element(6, &[class, 0, 0, 0, 0, 0, 0, 0]);
    body.extend(element(5, &int32(&shape)));
    body.extend(element(1, name.as_bytes()));
    body.extend(content);
    element(MATRIX, &body)
}

#[cfg(test)]
mod tests {
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
        assert!(is_version_5(&std::fs::read(&path).unwrap()));
        let got = read(&path, &["wave", "comment", "basis"]).unwrap();
        let expected: Vec<_> = example().into_iter().map(|(n, v)| (n.to_string(), v)).collect();
        assert_eq!(got, expected);
        assert_eq!(read(&path, &["comment"]).unwrap().len(), 1);
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
