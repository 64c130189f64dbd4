//! Writing MATLAB files of version 5.

use super::matlab::{COMPRESSED, MATRIX, Value};
use super::strided::Sample;
use camrig_base::{Error, Result};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::fs::File;
use std::io::Write;
use std::path::Path;

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
pub(super) fn matrix(name: &str, value: &Value) -> Vec<u8> {
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
