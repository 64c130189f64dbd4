//! HDF5 files, which MATLAB files of version 7.3 are: arrays and structs (groups), read with
//! `hdf5-pure`.

use super::cube::BandSource;
use super::matlab::{Array, Value};
use super::strided::{self, Bytes, Sample, Strided};
use camrig_base::{Error, Plane, Result};
use hdf5_pure::{
    AttrValue, ChunkIndex, DType, Dataset, Datatype, DatatypeByteOrder, File, FormatError,
};
use hdf5_pure::{Group, Layout, ReadSeekSource, Source};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

fn refused(error: hdf5_pure::Error) -> Error {
    use FormatError as Of;
    let said = format!("not a readable HDF5 file: {error}");
    let unsupported = |said: String| {
        Error::unsupported(said).help(
            "rewrite it with h5repack -f NONE -l CONTI, or with h5py's libver='earliest' and gzip",
        )
    };
    match error {
        hdf5_pure::Error::Format(
            Of::InvalidLayoutVersion(_)
            | Of::InvalidChunkIndexType(_)
            | Of::ChunkedReadError(_)
            | Of::UnsupportedFilter(_)
            | Of::UnsupportedZfp(_)
            | Of::UnsupportedVirtualLayout
            | Of::UnsupportedExternalStorage,
        ) => unsupported(said),
        // Bytes that scale-offset left, which are no whole number of samples.
        hdf5_pure::Error::Format(Of::FilterError(of)) if of.starts_with("shuffle") => {
            unsupported(said)
        }
        hdf5_pure::Error::Format(Of::SignatureNotFound) => Error::input(said).help(
            "a .mat file is read in versions 5 and 7.3, which is HDF5; one of version 4: save -v7",
        ),
        _ => Error::input(said).help(
            "the file is damaged, or newer than what is read: write it again with h5repack or \
             h5py's libver='earliest'; a .mat file: save -v7",
        ),
    }
}

/// A file without its links by path in groups of the old kind. The library takes them for damage;
/// in groups of the new kind it passes over them, too. An array that such a link leads to has a
/// name of its own, except in another file.
struct WithoutLinks(ReadSeekSource<std::fs::File>);

impl Source for WithoutLinks {
    fn len(&self) -> u64 {
        self.0.len()
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> Result<(), FormatError> {
        self.0.read_at(offset, buffer)
    }

    fn read_metadata_at(&self, offset: u64, length: usize) -> Result<Vec<u8>, FormatError> {
        let mut bytes = self.0.read_metadata_at(offset, length)?;
        leave_out_links(&mut bytes);
        Ok(bytes)
    }
}

/// Takes the links by path out of a node of symbols (HDF5 file format specification 3.0, III.B
/// and III.C); other bytes stay as they are.
fn leave_out_links(node: &mut [u8]) {
    const HEAD: usize = 8;
    /// Bytes of an entry from the type of its cache on, which is 2 for a link by path.
    const TAIL: usize = 24;
    let [b'S', b'N', b'O', b'D', 1, _, low, high, entries @ ..] = node else { return };
    let count = usize::from(u16::from_le_bytes([*low, *high]));
    let size = entries.len().checked_div(count).unwrap_or(0);
    if size <= TAIL || size * count != entries.len() {
        return;
    }
    let is_link = |entry: &[u8]| entry[size - TAIL..][..4] == [2, 0, 0, 0];
    let kept: Vec<u8> = entries.chunks(size).filter(|e| !is_link(e)).flatten().copied().collect();
    let left = ((kept.len() / size) as u16).to_le_bytes();
    node[HEAD..HEAD + kept.len()].copy_from_slice(&kept);
    node[HEAD - 2..HEAD].copy_from_slice(&left);
}

fn opened(path: &Path) -> Result<File> {
    let file = std::fs::File::open(path).map_err(|e| Error::io("open", path, e))?;
    let source = ReadSeekSource::new(file).map_err(|e| refused(e.into()))?;
    File::from_source(WithoutLinks(source)).map_err(refused)
}

/// Whether samples are of half precision, which the library does not convert, and their byte
/// order: whether the big end comes first.
fn half(dataset: &Dataset) -> Result<Option<bool>> {
    match dataset.datatype().map_err(refused)? {
        Datatype::FloatingPoint { size: 4 | 8, .. } => Ok(None),
        Datatype::FloatingPoint { size: 2, byte_order, layout }
            if (layout.exponent_location, layout.exponent_size) == (10, 5)
                && byte_order != DatatypeByteOrder::Vax =>
        {
            Ok(Some(byte_order == DatatypeByteOrder::BigEndian))
        }
        Datatype::FloatingPoint { size, .. } => Err(Error::unsupported(format!(
            "floating-point samples of another kind, {size} bytes"
        ))
        .help("save them as float16, float32 or float64 of IEEE 754")),
        _ => Ok(None),
    }
}

/// Some rows of an array as numbers.
fn doubles(dataset: &Dataset, first: u64, count: u64) -> Result<Vec<f64>> {
    let Some(big_endian) = half(dataset)? else {
        return dataset.read_f64_rows(first, count).map_err(refused);
    };
    let raw = dataset.read_raw_rows(first, count).map_err(refused)?;
    let number = |raw: &[u8]| Sample::F16.read(raw, big_endian);
    Ok(raw.chunks_exact(2).map(number).collect())
}

/// Groups within groups that are read; ISETCam's scenes have three levels.
const MAX_DEPTH: usize = 8;

/// Bytes that a byte of a file unpacks to at most: deflate makes 1032.
const MAX_PACKED: u64 = 1032;
/// Bytes of an array that are read whatever the file's size.
const ALWAYS_READ: u64 = 64 << 20;

/// A dataset, whose lengths are found to be possible in a file of this size: the library takes
/// memory, and time, for what they state before it reads.
fn checked(file_bytes: u64, name: &str, dataset: Dataset) -> Result<Dataset> {
    let impossible = |what: String| {
        Error::input(format!("array {name:?} states {what} in a file of {file_bytes} bytes")).help(
            "the file is damaged or cut off, or mostly unwritten or of equal samples: write it \
                 out, with h5repack -f NONE -l CONTI",
        )
    };
    let sample = dataset.element_size().map_err(refused)?;
    let size_of = |lengths: &[u64]| lengths.iter().fold(sample, |size, n| size.saturating_mul(*n));
    let most = file_bytes.saturating_mul(MAX_PACKED).max(ALWAYS_READ);
    let bytes = size_of(&dataset.shape().map_err(refused)?);
    if bytes > most {
        return Err(impossible(format!("{bytes} bytes")));
    }
    match dataset.layout().map_err(refused)? {
        Layout::Contiguous { size, .. } if size > most => {
            return Err(impossible(format!("{size} bytes in one piece")));
        }
        Layout::Chunked { chunk_shape, index } => {
            // The library does not list the chunks of such an index, nor read them.
            let chunks = match index {
                ChunkIndex::BTreeV2 => Vec::new(),
                _ => dataset.chunks().map_err(refused)?,
            };
            let (count, bytes) = (chunks.len() as u64, size_of(&chunk_shape));
            if bytes.saturating_mul(count) > most {
                return Err(impossible(format!("{count} chunks of {bytes} bytes")));
            }
            for chunk in &chunks {
                if chunk.address.saturating_add(chunk.storage_size) > file_bytes {
                    let (bytes, at) = (chunk.storage_size, chunk.address);
                    return Err(impossible(format!("a chunk of {bytes} bytes at byte {at}")));
                }
            }
        }
        _ => {}
    }
    Ok(dataset)
}

/// A dataset of a file, [`checked`].
fn dataset_of(file: &File, name: &str) -> Result<Dataset> {
    checked(file.file_size(), name, file.dataset(name).map_err(refused)?)
}

/// Reads the named variables except three-dimensional arrays (see [`large`]).
pub fn read(path: &Path, wanted: &[&str]) -> Result<Vec<(String, Value)>> {
    let file = opened(path)?;
    struct_of(&file.root(), 0, Some(wanted), file.file_size())
}

/// The three-dimensional arrays among the named variables, which are read plane by plane.
pub fn large(path: &Path, wanted: &[&str]) -> Result<Vec<(String, Box<dyn BandSource>)>> {
    let file = opened(path)?;
    let names = file.root().datasets().map_err(refused)?;
    let mut found: Vec<(String, Box<dyn BandSource>)> = Vec::new();
    for name in names.into_iter().filter(|n| wanted.contains(&n.as_str())) {
        let shape = file.dataset(&name).and_then(|d| d.shape()).map_err(refused)?;
        let lengths: Vec<usize> = shape.iter().map(|&n| n as usize).collect();
        if lengths.len() == 3 && samples(&lengths[1..]).is_none_or(|n| n > MAX_HELD) {
            return Err(Error::limit(format!("array {name:?} of shape {lengths:?}")));
        }
        // HDF5 lists the slowest axis first: bands, columns, rows.
        if let Ok(lengths) = <[usize; 3]>::try_from(lengths) {
            let planes = Planes::new(path, &name, lengths, true);
            found.push((name, Box::new(planes)));
        }
    }
    Ok(found)
}

struct Planes {
    path: PathBuf,
    name: String,
    width: usize,
    height: usize,
    bands: usize,
    /// Whether the rows of the array are columns of the scene, as in MATLAB's files.
    transposed: bool,
    held: Mutex<Option<Chunk>>,
}

/// Bands that lie in the same chunks of the file, which are decompressed together.
struct Chunk {
    first: usize,
    samples: Vec<f64>,
}

impl Planes {
    /// Of an array whose axes have these lengths: bands, then rows and columns, or transposed
    /// columns and rows.
    fn new(path: &Path, name: &str, lengths: [usize; 3], transposed: bool) -> Self {
        let [bands, a, b] = lengths;
        let (width, height) = if transposed { (a, b) } else { (b, a) };
        let (path, name, held) = (path.into(), name.into(), Mutex::default());
        Self { path, name, width, height, bands, transposed, held }
    }

    /// Reads the bands that share chunks with one, as far as memory allows.
    fn chunk_of(&self, band: usize) -> Result<Chunk> {
        let file = opened(&self.path)?;
        let dataset = dataset_of(&file, &self.name)?;
        let shape = dataset.chunk_shape().map_err(refused)?;
        let depth = shape.and_then(|s| s.first().copied()).unwrap_or(1);
        let most = MAX_HELD / (self.width * self.height).max(1);
        let depth = usize::try_from(depth).unwrap_or(1).clamp(1, most.max(1));
        let first = band / depth * depth;
        let count = depth.min(self.bands - first);
        let samples = doubles(&dataset, first as u64, count as u64)?;
        Ok(Chunk { first, samples })
    }
}

impl BandSource for Planes {
    fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    fn bands(&self) -> usize {
        self.bands
    }

    fn read(&self, band: usize) -> Result<Plane<f32>> {
        let Self { width, height, .. } = *self;
        let size = width * height;
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let holds = |c: &Chunk| (c.first..c.first + c.samples.len() / size.max(1)).contains(&band);
        let chunk = match held.take().filter(holds) {
            Some(chunk) => chunk,
            None => self.chunk_of(band)?,
        };
        let from = (band - chunk.first) * size;
        let samples = chunk
            .samples
            .get(from..from + size)
            .ok_or_else(|| Error::input(format!("band {band} of {} is cut off", self.name)))?;
        let at = |x: usize, y: usize| if self.transposed { x * height + y } else { y * width + x };
        let plane = Plane::from_fn(width, height, |x, y| samples[at(x, y)] as f32);
        *held = Some(chunk);
        Ok(plane)
    }
}

/// Names, groups before them, and shapes, slowest axis first, of the numeric arrays of a file.
pub fn list(path: &Path) -> Result<Vec<(String, Vec<usize>)>> {
    let mut arrays = Vec::new();
    list_group(&opened(path)?.root(), "", 0, &mut |name, dataset, kind| {
        let numeric = match kind {
            DType::String
            | DType::Compound(_)
            | DType::Enum(_)
            | DType::Array(..)
            | DType::VariableLengthString
            | DType::ObjectReference => false,
            DType::Other(kind) => matches!(*kind, Datatype::FloatingPoint { .. }),
            _ => true,
        };
        if numeric {
            let shape = dataset.shape().map_err(refused)?;
            arrays.push((name, shape.into_iter().map(|n| n as usize).collect()));
        }
        Ok(())
    })?;
    Ok(arrays)
}

/// The lists of texts of a file, like attributes.
pub fn text_lists(path: &Path) -> Result<Vec<Attribute>> {
    let mut lists = Vec::new();
    list_group(&opened(path)?.root(), "", 0, &mut |name, dataset, kind| {
        let short = dataset.shape().map_err(refused)?.iter().product::<u64>() <= MAX_TEXTS;
        if matches!(kind, DType::String | DType::VariableLengthString) && short {
            let texts = dataset.read_string().map_err(refused)?;
            lists.push(Attribute { name, texts, numbers: None });
        }
        Ok(())
    })?;
    Ok(lists)
}

/// An attribute; its value if that is text, or numbers.
#[derive(Clone)]
pub struct Attribute {
    pub name: String,
    /// Its texts, if it has any.
    pub texts: Vec<String>,
    pub numbers: Option<Vec<f64>>,
}

/// An array's attributes, in order of names, or those of the file; some files keep a factor, an
/// offset, a unit, the value of missing samples or wavelengths there.
pub fn attributes(path: &Path, name: Option<&str>) -> Result<Vec<Attribute>> {
    let file = opened(path)?;
    let all = match name {
        Some(name) => file.dataset(name).and_then(|dataset| dataset.attrs()),
        None => file.root().attrs(),
    };
    let attribute = |(name, value): (String, AttrValue)| Attribute {
        name,
        numbers: numbers_of(&value),
        texts: texts(value),
    };
    let mut found: Vec<Attribute> = all.map_err(refused)?.into_iter().map(attribute).collect();
    found.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(found)
}

/// The numbers of an attribute.
fn numbers_of(value: &AttrValue) -> Option<Vec<f64>> {
    use AttrValue as Of;
    Some(match value {
        Of::F64(v) => vec![*v],
        Of::F32(v) => vec![f64::from(*v)],
        Of::I8(v) => vec![f64::from(*v)],
        Of::U8(v) => vec![f64::from(*v)],
        Of::I16(v) => vec![f64::from(*v)],
        Of::U16(v) => vec![f64::from(*v)],
        Of::I32(v) => vec![f64::from(*v)],
        Of::U32(v) => vec![f64::from(*v)],
        Of::I64(v) => vec![*v as f64],
        Of::F64Array(all) => all.clone(),
        Of::F32Array(all) => all.iter().map(|v| f64::from(*v)).collect(),
        Of::I32Array(all) => all.iter().map(|v| f64::from(*v)).collect(),
        Of::U32Array(all) => all.iter().map(|v| f64::from(*v)).collect(),
        Of::I16Array(all) => all.iter().map(|v| f64::from(*v)).collect(),
        Of::U16Array(all) => all.iter().map(|v| f64::from(*v)).collect(),
        Of::I64Array(all) => all.iter().map(|v| *v as f64).collect(),
        _ => return None,
    })
}

/// The text of an attribute; none of numbers.
fn texts(value: AttrValue) -> Vec<String> {
    use AttrValue as Of;
    match value {
        Of::String(text) | Of::AsciiString(text) => vec![text],
        Of::VarLenString(text) | Of::VarLenAsciiString(text) => vec![text],
        Of::StringSized { value, .. } | Of::AsciiStringSized { value, .. } => vec![value],
        Of::StringArray(all) | Of::AsciiStringArray(all) => all,
        Of::VarLenStringArray(all) | Of::VarLenAsciiStringArray(all) => all,
        _ => Vec::new(),
    }
}

fn list_group(
    group: &Group,
    before: &str,
    depth: usize,
    take: &mut impl FnMut(String, &Dataset, DType) -> Result<()>,
) -> Result<()> {
    for name in group.datasets().map_err(refused)? {
        let dataset = group.dataset(&name).map_err(refused)?;
        take(format!("{before}{name}"), &dataset, dataset.dtype().map_err(refused)?)?;
    }
    // Groups of MATLAB's own, for cells and objects.
    let own = |name: &String| name.starts_with('#');
    for name in group.groups().map_err(refused)?.into_iter().filter(|name| !own(name)) {
        if depth < MAX_DEPTH {
            let inner = group.group(&name).map_err(refused)?;
            list_group(&inner, &format!("{before}{name}/"), depth + 1, take)?;
        }
    }
    Ok(())
}

/// The numbers of a small array.
pub fn numbers(path: &Path, name: &str) -> Result<Vec<f64>> {
    let file = opened(path)?;
    doubles(&dataset_of(&file, name)?, 0, u64::MAX)
}

/// The number of samples of an array, where it can be counted.
fn samples(lengths: &[usize]) -> Option<usize> {
    lengths.iter().try_fold(1usize, |n, &length| n.checked_mul(length))
}

/// Most texts of a list: bands have names, pixels have none.
const MAX_TEXTS: u64 = 1 << 16;
/// Most samples of an array or band that is held in memory: 512 MiB. An array whose bands come
/// first is read band by band.
const MAX_HELD: usize = 1 << 27;

/// An array as a cube; `axes` names its axes, slowest first.
pub fn cube(path: &Path, name: &str, axes: &str) -> Result<Box<dyn BandSource>> {
    let file = opened(path)?;
    let dataset = dataset_of(&file, name)?;
    let shape: Vec<usize> =
        dataset.shape().map_err(refused)?.into_iter().map(|n| n as usize).collect();
    let lengths = strided::three_axes(name, &shape)?;
    let layout = strided::Layout::packed(axes, lengths)?;
    let strided::Layout { width, height, bands, .. } = layout;
    if [width, height, bands].contains(&0) {
        return Err(Error::input(format!("array {name:?} of shape {shape:?} is empty")));
    }
    let small = |lengths: &[usize]| samples(lengths).is_some_and(|n| n <= MAX_HELD);
    if axes.starts_with('b') && shape.len() == 3 && small(&[width, height]) {
        return Ok(Box::new(Planes::new(path, name, lengths, axes == "bxy")));
    }
    if !small(&lengths) {
        return Err(Error::limit(format!("array {name:?} of shape {shape:?}")).help(format!(
            "more than {MAX_HELD} samples are read only where the bands come first; store it so"
        )));
    }
    let (bytes, sample, big_endian) = match half(&dataset)? {
        Some(big_endian) => (dataset.read_raw().map_err(refused)?, Sample::F16, big_endian),
        None => {
            let values = dataset.read_f32().map_err(refused)?;
            (values.into_iter().flat_map(f32::to_le_bytes).collect(), Sample::F32, false)
        }
    };
    let cube = Strided::new(Bytes::Memory(bytes), 0, sample, big_endian, layout)?;
    Ok(Box::new(cube))
}

fn struct_of(
    group: &Group,
    depth: usize,
    wanted: Option<&[&str]>,
    file_bytes: u64,
) -> Result<Vec<(String, Value)>> {
    let keep = |name: &String| wanted.is_none_or(|wanted| wanted.contains(&name.as_str()));
    let mut fields = Vec::new();
    for name in group.datasets().map_err(refused)?.into_iter().filter(keep) {
        let dataset = group.dataset(&name).map_err(refused)?;
        let mut shape: Vec<usize> =
            dataset.shape().map_err(refused)?.into_iter().map(|n| n as usize).collect();
        if shape.len() > 2 || samples(&shape).is_none_or(|n| n > MAX_HELD) {
            continue;
        }
        let dataset = checked(file_bytes, &name, dataset)?;
        shape.reverse();
        // Text and references are not numbers.
        let value = match dataset.read_f64() {
            Ok(numbers) => Value::Array(Array::doubles(shape, numbers)),
            Err(_) => Value::Other,
        };
        fields.push((name, value));
    }
    if depth < MAX_DEPTH {
        for name in group.groups().map_err(refused)?.into_iter().filter(keep) {
            let inner = group.group(&name).map_err(refused)?;
            fields.push((name, Value::Struct(struct_of(&inner, depth + 1, None, file_bytes)?)));
        }
    }
    Ok(fields)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hdf5_pure::FileBuilder;

    #[test]
    fn bands_in_chunks_are_those_of_the_array_in_any_order() {
        let (bands, height, width) = (7, 5, 4);
        let value = |b: usize, y: usize, x: usize| (100 * b + 10 * y + x) as f64;
        let data: Vec<f64> = (0..bands * height * width)
            .map(|i| value(i / (height * width), i / width % height, i % width))
            .collect();
        let mut file = FileBuilder::new();
        file.create_dataset("cube")
            .with_f64_data(&data)
            .with_shape(&[7, 5, 4])
            .with_chunks(&[3, 2, 4])
            .with_shuffle()
            .with_deflate(4);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cube.h5");
        file.write(&path).unwrap();
        let cube = cube(&path, "cube", "byx").unwrap();
        assert_eq!((cube.size(), cube.bands()), ((width, height), bands));
        for band in [5, 0, 6, 1, 2, 4, 3, 6] {
            let plane = cube.read(band).unwrap();
            for (i, &v) in plane.data.iter().enumerate() {
                assert_eq!(f64::from(v), value(band, i / width, i % width), "band {band}");
            }
        }
    }

    /// A file of an array of halves, packed in chunks, and the folder that holds it.
    fn packed(shape: [u64; 3], chunks: [u64; 3]) -> (tempfile::TempDir, File) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cube.h5");
        let mut file = FileBuilder::new();
        file.create_dataset("cube")
            .with_f64_data(&vec![0.5; shape.iter().product::<u64>() as usize])
            .with_shape(&shape)
            .with_chunks(&chunks)
            .with_deflate(1);
        file.write(&path).unwrap();
        let file = File::open_streaming(&path).unwrap();
        (folder, file)
    }

    /// The file of an array is as long as it is; what is checked is told that it is shorter.
    #[test]
    fn lengths_that_a_file_cannot_hold_are_refused_before_memory_is_taken() {
        let (_folder, file) = packed([9, 1000, 1000], [1, 1000, 1000]);
        let said = |file_bytes: u64| {
            let found = checked(file_bytes, "cube", file.dataset("cube").unwrap());
            found.err().map(|e| e.to_string()).unwrap_or_default()
        };
        assert!(said(10_000).contains("states 72000000 bytes in a file of 10000"));
        assert!(said(file.file_size() / 2).contains("states a chunk of"));
        assert_eq!(said(file.file_size()), "");
    }

    /// Entries as the specification has them: name and header in eight bytes each, the type of
    /// the cache, four bytes of nothing and 16 of cache.
    #[test]
    fn links_by_path_leave_a_node_of_symbols() {
        let entry = |name: u64, header: u64, cache: u32| {
            let head = [name.to_le_bytes(), header.to_le_bytes()].concat();
            [&head[..], &cache.to_le_bytes(), &[0; 20]].concat()
        };
        let (array, link) = (entry(8, 800, 0), entry(16, u64::MAX, 2));
        let head = |count: u8| [b'S', b'N', b'O', b'D', 1, 0, count, 0];
        let mut node = [&head(3)[..], &link, &array, &link].concat();
        leave_out_links(&mut node);
        assert_eq!(node[..48], [&head(1)[..], &array].concat());
        let samples = [&head(3)[..], &link, &array].concat();
        let mut kept = samples.clone();
        leave_out_links(&mut kept);
        assert_eq!(kept, samples);
    }

    #[test]
    fn chunks_larger_than_their_array_are_read_where_the_file_holds_them() {
        let (_folder, file) = packed([1, 2, 2], [1, 3000, 3000]);
        let cube = || file.dataset("cube").unwrap();
        assert!(checked(file.file_size(), "cube", cube()).is_ok());
        let error = checked(10_000, "cube", cube()).err().unwrap().to_string();
        assert!(error.contains("states 1 chunks of 72000000 bytes"), "{error}");
    }
}
