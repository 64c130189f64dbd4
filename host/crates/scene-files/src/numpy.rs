//! Cubes from NumPy files: `.npy` with a sidecar, `.npz` with named arrays.
//!
//! In an `.npz` the cube and its wavelengths are found as in other files of named arrays
//! (module `arrays`), or it is the one with the most bands that have wavelengths. The quantity is
//! in the cube's name if that is `reflectance` or `radiance`.

use super::cube::{BandSource, Cube};
use super::sidecar::{Own, Sidecar};
use super::strided::{Bytes, Layout, Sample, Strided, three_axes};
use super::{arrays, units};
use camrig_base::{Error, Plane, Result, npy};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// A plane as an NPY file of version 1: H x W samples of NumPy's type `kind` (`<f4`), each
/// converted to bytes by `to_bytes`.
pub fn encode<T: Copy, const N: usize>(
    plane: &Plane<T>,
    kind: &str,
    to_bytes: impl Fn(T) -> [u8; N],
) -> Vec<u8> {
    let mut bytes = npy::header(kind, &format!("({}, {})", plane.height, plane.width));
    plane.data.iter().for_each(|&v| bytes.extend(to_bytes(v)));
    bytes
}

/// Bytes of a member of an archive that are read for its header. A header of version 1 is shorter
/// than 64 KiB; longer ones exist only for structured types, which no cube has.
const HEADER_BYTES: u64 = 1 << 16;

/// Reads a two-dimensional NPY file.
///
/// # Errors
/// A file that cannot be read, arrays of other than two axes, samples that are not numbers.
pub fn read_plane(path: &Path) -> Result<Plane<f32>> {
    let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
    let read = || {
        let array = Array::read(std::io::BufReader::new(file))?;
        let [height, width] = array.shape[..] else {
            return Err(Error::input(format!("an array of shape {:?}", array.shape))
                .help("a frame has two axes: rows, columns"));
        };
        let layout = if array.fortran {
            Layout::packed("bxy", [1, width, height])?
        } else {
            Layout::packed("byx", [1, height, width])?
        };
        let (sample, big_endian) = array.sample;
        let bytes = Bytes::File(path.into());
        Strided::new(bytes, array.offset, sample, big_endian, layout)?.read(0)
    };
    read().map_err(|e| e.at(path.display()))
}

/// Opens an `.npy` or `.npz` cube.
pub(super) fn open(path: &Path, sidecar: &Sidecar) -> Result<Cube> {
    let zipped = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npz"));
    if zipped { open_npz(path, sidecar) } else { open_npy(path, sidecar) }
}

fn cube(
    sidecar: &Sidecar,
    array: Array,
    bytes: Bytes,
    name: &str,
    axes: &str,
    mut own: Own,
) -> Result<Cube> {
    let mut lengths = three_axes(name, &array.shape)?;
    let mut axes = sidecar.axes.as_deref().unwrap_or(axes).to_string();
    if array.fortran {
        lengths.reverse();
        axes = axes.chars().rev().collect();
    }
    let layout = Layout::packed(&axes, lengths)?;
    let (sample, big_endian) = array.sample;
    let cube = Strided::new(bytes, array.offset, sample, big_endian, layout)?;
    own.quantity = units::quantity_of(name, false, sidecar)?;
    let array = if name.is_empty() { String::new() } else { format!(" {name:?}") };
    let understood = format!("NumPy array{array}, {axes} from slowest to fastest, {sample:?}");
    own.understood.insert(0, understood);
    sidecar.cube(Box::new(cube), own)
}

/// The header of an array.
struct Array {
    shape: Vec<usize>,
    fortran: bool,
    sample: (Sample, bool),
    offset: u64,
}

impl Array {
    fn read(mut reader: impl Read) -> Result<Self> {
        let npy::Header { descr, fortran, shape, offset } = npy::Header::read(&mut reader)?;
        let sample = Sample::of_numpy(&descr).ok_or_else(|| {
            Error::unsupported(format!("samples of type {descr}"))
                .help("save as real numbers: float16 to float64, or integers")
        })?;
        Ok(Self { shape, fortran, sample, offset })
    }
}

fn open_npy(path: &Path, sidecar: &Sidecar) -> Result<Cube> {
    let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
    let array = Array::read(std::io::BufReader::new(file))?;
    sidecar.without(&["array"], "an .npy file, which holds one array")?;
    cube(sidecar, array, Bytes::File(path.into()), "", "yxb", Own::default())
}

fn malformed(error: zip::result::ZipError) -> Error {
    Error::input(format!("not an .npz archive: {error}"))
}

/// The arrays of an archive: places in it, names and headers. `others` get the names of what is
/// not read, such as text.
fn members(
    archive: &mut zip::ZipArchive<File>,
    others: &mut Vec<String>,
) -> Result<Vec<(usize, String, Array)>> {
    let mut members = Vec::new();
    for index in 0..archive.len() {
        let mut member = archive.by_index(index).map_err(malformed)?;
        let name = member.name().map_err(malformed)?.trim_end_matches(".npy").to_string();
        let mut start = Vec::new();
        member
            .by_ref()
            .take(HEADER_BYTES)
            .read_to_end(&mut start)
            .map_err(|e| malformed(e.into()))?;
        match Array::read(&start[..]) {
            Ok(array) => members.push((index, name, array)),
            Err(_) => others.push(name),
        }
    }
    Ok(members)
}

fn open_npz(path: &Path, sidecar: &Sidecar) -> Result<Cube> {
    let file = File::open(path).map_err(|e| Error::io("open", path, e))?;
    let mut archive = zip::ZipArchive::new(file).map_err(malformed)?;
    let mut others = Vec::new();
    let members = members(&mut archive, &mut others)?;
    let mut load = |index: usize| -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        archive
            .by_index(index)
            .and_then(|mut member| member.read_to_end(&mut bytes).map_err(Into::into))
            .map_err(|e| malformed(e).help("the archive is damaged or cut off"))?;
        Ok(bytes)
    };
    let list: Vec<(String, Vec<usize>)> =
        members.iter().map(|(_, name, array)| (name.clone(), array.shape.clone())).collect();
    let wanted = sidecar.array.as_deref().or_else(|| arrays::of_most_wavelengths(&list));
    let (of, _) = arrays::choose(&list, wanted)?;
    let member = |name: &str| members.iter().find(|(_, n, _)| n == name);
    let Some((index, _, array)) = member(of) else {
        return Err(Error::input(format!("no array {of:?} in the archive")));
    };
    let lengths = three_axes(of, &array.shape)?;
    let wavelengths = arrays::wavelengths(&list, &lengths, sidecar, |name| {
        let Some((index, _, Array { sample: (sample, big_endian), offset, .. })) = member(name)
        else {
            return Ok(None);
        };
        let bytes = load(*index)?;
        let samples = bytes.get(*offset as usize..).unwrap_or(&[]).chunks_exact(sample.bytes());
        Ok(Some(samples.map(|raw| sample.read(raw, *big_endian)).collect()))
    })?;
    if wavelengths.is_none() && sidecar.given(0).is_none() {
        arrays::refuse_wavelengths_in(&others)?;
    }
    let mut own = Own::default();
    let used = wavelengths.as_ref().map(|(name, _)| name.as_str());
    own.understood.extend(used.map(|name| format!("wavelengths from {name:?}")));
    let left = list.iter().map(|(name, _)| name).chain(&others).map(String::as_str);
    let left: Vec<&str> = left.filter(|name| *name != of && Some(*name) != used).collect();
    if !left.is_empty() {
        own.notes.push(format!("arrays that were not used: {}", left.join(", ")));
    }
    own.nm = wavelengths.map(|(_, nm)| nm);
    let axes = match &own.nm {
        Some(nm) if sidecar.axes.is_none() => arrays::axes_of(of, &lengths, nm.len())?,
        _ => "yxb",
    };
    let bytes = Bytes::Memory(load(*index)?);
    let array = Array { shape: array.shape.clone(), ..*array };
    cube(sidecar, array, bytes, of, axes, own)
}

#[cfg(test)]
mod tests {
    use crate::open as open_scene;
    use camrig_scene::Grid;
    use std::io::Write;

    fn npy(kind: &str, fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let text =
            format!("{{'descr': '{kind}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
        let padded = (10 + text.len() + 1).next_multiple_of(64) - 10;
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((padded as u16).to_le_bytes());
        bytes.extend(format!("{text:<width$}\n", width = padded - 1).bytes());
        bytes.extend(data);
        bytes
    }

    fn samples(f: impl Fn(usize) -> f32, n: usize) -> Vec<u8> {
        (0..n).flat_map(|i| f(i).to_le_bytes()).collect()
    }

    #[test]
    fn a_cube_and_its_sidecar() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cube.npy");
        let spec = path.to_str().unwrap();
        // 2 rows, 3 columns, 4 bands; the value is 6 rows·columns index · 0.1 + band · 0.01.
        let data = samples(|i| (i / 4) as f32 * 0.1 + (i % 4) as f32 * 0.01, 24);
        std::fs::write(&path, npy("<f4", "False", "(2, 3, 4)", &data)).unwrap();
        let message = open_scene(spec).err().unwrap().to_string();
        assert!(message.contains("wavelengths of the 4 bands"), "{message}");

        std::fs::write(
            path.with_extension("toml"),
            "start_nm = 400\nstep_nm = 100\nscale = 2.0\n",
        )
        .unwrap();
        let scene = open_scene(spec).unwrap();
        let grid = Grid { width: 3, height: 2, left: -0.5, top: -1.0 / 3.0, cell: 1.0 / 3.0 };
        let plane = scene.plane(10, &grid).unwrap(); // 500 nm
        assert!((plane.at(2, 1) - 2.0 * 0.51).abs() < 1e-5, "{plane:?}");
        let notes = scene.notes();
        assert!(notes.len() == 1 && notes[0].contains("cube.toml lies beside it"), "{notes:?}");

        std::fs::write(path.with_extension("toml"), "start_mm = 400\n").unwrap();
        let message = open_scene(spec).err().unwrap().to_string();
        assert!(message.contains("start_mm") && message.contains("cube.toml"), "{message}");
    }

    #[test]
    fn damaged_files_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cube.npy");
        let message = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let error = open_scene(path.to_str().unwrap()).err().unwrap().to_string();
            assert!(error.contains("cube.npy"), "{error}");
            error
        };
        let whole = npy("<f4", "False", "(1, 1, 31)", &samples(|_| 0.5, 31));
        assert!(message(&whole[..whole.len() - 1]).contains("cut off"));
        assert!(message(&whole[..20]).contains("truncated: 128 bytes needed, 20 there"));
        assert!(message(b"nonsense").contains("not a NumPy array"));
        assert!(
            message(&npy("<f4", "False", "(31,)", &samples(|_| 0.5, 31))).contains("three axes")
        );
        assert!(message(&npy("|O", "False", "(1, 1, 31)", &[0; 248])).contains("|O"));
        let path = dir.path().join("cube.npz");
        std::fs::write(&path, b"nonsense").unwrap();
        let error = open_scene(path.to_str().unwrap()).err().unwrap().to_string();
        assert!(error.contains("not an .npz archive"), "{error}");
    }

    #[test]
    fn the_cube_of_an_archive_is_named_where_there_are_several() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cube.npz");
        let mut archive = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
        let mut put = |name: &str, shape: &str, data: &[f32]| {
            archive.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
            let data: Vec<u8> = data.iter().flat_map(|v| v.to_le_bytes()).collect();
            archive.write_all(&npy("<f4", "False", shape, &data)).unwrap();
        };
        put("a.npy", "(3, 1, 2)", &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
        put("b.npy", "(1, 2, 2)", &[1.0; 4]);
        put("fwhm_um.npy", "(2,)", &[0.4, 0.5]);
        put("lambda_um.npy", "(2,)", &[0.5, 0.6]);
        archive.finish().unwrap();
        let open = |options: &str| crate::open_file(&format!("{}{options}", path.display()));
        let error = open("").err().unwrap().to_string();
        assert!(error.contains("array=NAME; the file has a [3, 1, 2], b [1, 2, 2]"), "{error}");
        let cube = open(":array=a").unwrap();
        assert_eq!(cube.band(0).unwrap().data, [0.1, 0.3, 0.5]);
        let understood = cube.understood().join("\n");
        assert!(understood.contains("2 bands, 500 to 600"), "{understood}");
    }
}
