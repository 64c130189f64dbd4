//! A folder of pictures or cubes as a sequence, in natural order of their names.
//!
//! A folder may also be one cube, with a picture per band (as in the CAVE set). Files that are no
//! pictures of bands make it a sequence, and so do pictures with colours, which bands do not have.
//! Numbered grey pictures are bands where something says their wavelengths, or where they are 31;
//! otherwise they may be either, and `kind=sequence` or `kind=cube` must say which.

use super::{SceneFrame, SceneSequence};
use crate::images::{self, Bands};
use crate::{open_file, stored};
use camrig_base::numbers::counted;
use camrig_base::{Error, Result, natural_order};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// What a folder is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// One scene.
    Cube,
    /// A scene per file.
    Sequence,
}

/// Endings of scenes, of which each row is one kind.
const ENDINGS: [&[&str]; 9] = [
    &["png"],
    &["jpg", "jpeg"],
    &["tif", "tiff"],
    &["exr"],
    &["hdr"],
    &["npy"],
    &["npz"],
    &["mat"],
    &["h5", "hdf5", "hdf", "he5"],
];
/// Endings of files that belong to scenes: sidecars, and the data of ENVI headers.
const BESIDE: [&str; 7] = ["toml", "img", "dat", "raw", "bsq", "bil", "bip"];
/// Endings of pictures that may be bands.
const OF_BANDS: [&str; 3] = ["png", "tif", "tiff"];
/// Names in a message.
const NAMED: usize = 5;

/// What the options of a folder's name say: its kind, and what belongs to its files.
pub(super) fn kind_of_options(options: &str) -> Result<(Option<Kind>, String)> {
    let (mut kind, mut rest) = (None, Vec::new());
    for option in options.split(',') {
        match option.trim().strip_prefix("kind=").map(str::trim) {
            None => rest.push(option),
            Some("sequence") => kind = Some(Kind::Sequence),
            Some("cube") => kind = Some(Kind::Cube),
            Some(other) => {
                return Err(Error::input(format!("kind={other}"))
                    .help("a folder is kind=sequence or kind=cube"));
            }
        }
    }
    Ok((kind, rest.join(",")))
}

/// The options without the kind, for what reads the folder as a cube.
pub(crate) fn of_cube(options: &str) -> Result<String> {
    Ok(kind_of_options(options)?.1)
}

/// Whether a folder is one scene or a sequence of them.
///
/// # Errors
/// Pictures that may be either, or that cannot be read.
pub fn kind(folder: &Path, options: &str) -> Result<Kind> {
    let (said, options) = kind_of_options(options)?;
    if let Some(said) = said {
        return Ok(said);
    }
    if folder.join(stored::DESCRIPTION).exists() {
        return Ok(Kind::Cube);
    }
    let ambiguous = || {
        Error::input("numbered grey pictures may be the bands of a cube or frames of a sequence")
            .at(folder.display())
            .help(
                "say kind=sequence behind its name, or kind=cube with the wavelengths: \
                 start_nm=400,step_nm=10",
            )
    };
    let files = list(folder)?.files;
    let may_be_band = |file: &PathBuf| images::has_ending(file, &OF_BANDS);
    if !files.is_empty() && !files.iter().any(may_be_band) {
        return Ok(Kind::Sequence);
    }
    match images::bands_in(folder, &options)? {
        Bands::Yes => Ok(Kind::Cube),
        Bands::Perhaps => Err(ambiguous()),
        // An empty folder is no cube either, which is said where it is opened as one.
        Bands::No if files.is_empty() => Ok(Kind::Cube),
        Bands::No => Ok(Kind::Sequence),
    }
}

/// The scenes of a folder that is a sequence, as one opens them; none of any other scene.
///
/// # Errors
/// Those of [`kind`] and [`Folder::open`].
pub fn files(spec: &str) -> Result<Option<Vec<String>>> {
    let (path, options) = crate::file_and_options(spec);
    if !path.is_dir() || kind(path, options)? == Kind::Cube {
        return Ok(None);
    }
    let Folder { files, options, .. } = Folder::open(path, options, None)?;
    Ok(Some(files.iter().map(|file| self::spec(file, &options)).collect()))
}

/// The scenes of a folder.
pub(super) struct Listed {
    /// In natural order.
    pub files: Vec<PathBuf>,
    /// Names of other files.
    pub others: Vec<String>,
}

/// The scenes of a folder in natural order. Hidden files do not count.
pub(super) fn list(folder: &Path) -> Result<Listed> {
    let failed = |e| Error::io("read", folder, e);
    let mut listed = Listed { files: Vec::new(), others: Vec::new() };
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let name = name_of(&path);
        if name.starts_with('.') || path.is_dir() {
            continue;
        }
        match ending(&path) {
            Some(_) => listed.files.push(path),
            None => listed.others.push(name),
        }
    }
    listed.files.sort_by_cached_key(|path| natural_order(&name_of(path)));
    listed.others.sort();
    Ok(listed)
}

pub(super) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The number of the kind of scene that a file's ending says.
fn ending(path: &Path) -> Option<usize> {
    let ending = path.extension()?.to_str()?.to_ascii_lowercase();
    ENDINGS.iter().position(|kind| kind.contains(&ending.as_str()))
}

/// Refuses scenes of several kinds, of which one may be the preview of another.
pub(super) fn check_one_kind(folder: &Path, files: &[PathBuf]) -> Result<()> {
    let mut kinds: BTreeMap<&str, usize> = BTreeMap::new();
    for kind in files.iter().filter_map(|file| ending(file)) {
        *kinds.entry(ENDINGS[kind][0]).or_default() += 1;
    }
    if kinds.len() <= 1 {
        return Ok(());
    }
    let counted: Vec<String> =
        kinds.iter().map(|(kind, count)| format!("{count} of .{kind}")).collect();
    Err(Error::input(format!("scenes of several kinds in one folder: {}", counted.join(", ")))
        .at(folder.display())
        .help("keep the frames of a sequence, all of one kind, in a folder of their own"))
}

/// The number at the end of a file's stem, and what comes before it.
pub(super) fn numbered(path: &Path) -> Option<(String, u64)> {
    let stem = path.file_stem()?.to_str()?;
    let text = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    Some((text.to_owned(), stem[text.len()..].parse().ok()?))
}

/// A name as one opens it.
pub(super) fn spec(path: &Path, options: &str) -> String {
    match options {
        "" => path.display().to_string(),
        options => format!("{}:{options}", path.display()),
    }
}

/// Times of frame `number` at a frame rate: whole numbers where there is none.
pub(super) fn times(number: u64, rate_hz: Option<f64>) -> (f64, Option<f64>) {
    let at = |number: u64| number as f64 / rate_hz.unwrap_or(1.0);
    (at(number), Some(at(number + 1)))
}

/// A folder of scenes.
pub struct Folder {
    name: String,
    files: Vec<PathBuf>,
    options: String,
    rate_hz: Option<f64>,
    next: usize,
    notes: Vec<String>,
}

impl Folder {
    /// The sequence of a folder; `options` are those of each of its files.
    ///
    /// # Errors
    /// A folder without scenes, or with scenes of several kinds.
    pub fn open(folder: &Path, options: &str, rate_hz: Option<f64>) -> Result<Self> {
        let options = kind_of_options(options)?.1;
        let Listed { files, others } = list(folder)?;
        check_one_kind(folder, &files)?;
        if files.is_empty() {
            return Err(Error::input("a folder without pictures or cubes").at(folder.display()));
        }
        let mut notes = Vec::new();
        let beside = |name: &String| {
            let ending = Path::new(name).extension().and_then(|e| e.to_str()).unwrap_or("");
            BESIDE.contains(&ending.to_ascii_lowercase().as_str())
        };
        let left: Vec<String> = others.into_iter().filter(|name| !beside(name)).collect();
        if !left.is_empty() {
            notes.push(format!("files that are no scenes were left out: {}", some(&left)));
        }
        notes.extend(missing(&files));
        let name = folder.display().to_string();
        Ok(Self { name, files, options, rate_hz, next: 0, notes })
    }
}

/// A few of many names.
fn some(names: &[String]) -> String {
    let shown = names[..names.len().min(NAMED)].join(", ");
    match names.len().saturating_sub(NAMED) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// Numbers that are missing between those of the files: frames that a renderer did not write would
/// go unnoticed, and what follows comes too early.
fn missing(files: &[PathBuf]) -> Option<String> {
    let numbers: Option<Vec<_>> = files.iter().map(|file| numbered(file)).collect();
    let numbers = numbers?;
    let present: BTreeSet<u64> = numbers.iter().map(|(_, number)| *number).collect();
    let (first, last) = (*present.first()?, *present.last()?);
    let same_text = numbers.iter().all(|(text, _)| *text == numbers[0].0);
    let absent = (last - first).saturating_add(1).saturating_sub(present.len() as u64);
    if !same_text || absent == 0 {
        return None;
    }
    let names = (first..last).filter(|n| !present.contains(n)).take(NAMED);
    let names: Vec<String> = names.map(|n| n.to_string()).collect();
    Some(format!(
        "between {first} and {last}, {} missing ({}{}): what follows is shown that much earlier",
        counted(absent as usize, "number"),
        names.join(", "),
        if absent > NAMED as u64 { ", ..." } else { "" }
    ))
}

impl SceneSequence for Folder {
    fn name(&self) -> &str {
        &self.name
    }

    fn is_timed(&self) -> bool {
        self.rate_hz.is_some()
    }

    fn next_frame(&mut self) -> Result<Option<SceneFrame>> {
        let Some(file) = self.files.get(self.next) else { return Ok(None) };
        let (number, name) = (self.next as u64, spec(file, &self.options));
        self.next += 1;
        let opened = name.clone();
        let open = move || open_file(&opened);
        Ok(Some(SceneFrame::new(number, times(number, self.rate_hz), name, open)))
    }

    fn rewind(&mut self) -> Result<()> {
        self.next = 0;
        Ok(())
    }

    fn notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open_file;
    use std::fs;

    fn png(path: &Path, kind: png::ColorType, pixel: &[u8]) {
        let mut encoder = png::Encoder::new(fs::File::create(path).unwrap(), 4, 3);
        encoder.set_color(kind);
        encoder.write_header().unwrap().write_image_data(&pixel.repeat(12)).unwrap();
    }

    fn grey(path: &Path) {
        png(path, png::ColorType::Grayscale, &[90]);
    }

    fn folder(names: &[&str], make: impl Fn(&Path)) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        names.iter().for_each(|name| make(&dir.path().join(name)));
        dir
    }

    fn numbered_names(count: usize) -> Vec<String> {
        (1..=count).map(|n| format!("x_{n}.png")).collect()
    }

    #[test]
    fn a_folder_of_colours_is_a_sequence_in_natural_order() {
        let colour = |path: &Path| png(path, png::ColorType::Rgb, &[90, 80, 70]);
        let dir = folder(&["a10.png", "a2.png", "a1.png"], colour);
        assert_eq!(kind(dir.path(), "").unwrap(), Kind::Sequence);
        fs::write(dir.path().join("notes.txt"), "").unwrap();
        let mut sequence = Folder::open(dir.path(), "as=reflectance", Some(25.0)).unwrap();
        let notes = sequence.notes().join("\n");
        assert!(notes.contains("left out: notes.txt"), "{notes}");
        assert!(notes.contains("between 1 and 10, 7 numbers missing (3, 4, 5, 6, 7, ...)"));
        for (number, file) in ["a1.png", "a2.png", "a10.png"].iter().enumerate() {
            let frame = sequence.next_frame().unwrap().unwrap();
            let name = format!("{}:as=reflectance", dir.path().join(file).display());
            assert_eq!((frame.name.as_str(), frame.start_s), (&*name, number as f64 / 25.0));
        }
        assert!(sequence.next_frame().unwrap().is_none());
        sequence.rewind().unwrap();
        assert_eq!(sequence.next_frame().unwrap().unwrap().number, 0);
        let said = open_file(&dir.path().display().to_string()).err().unwrap().to_string();
        assert!(said.contains("a sequence, and one scene is wanted"), "{said}");
    }

    #[test]
    fn a_damaged_member_is_named() {
        let dir = folder(&["a1.png"], |path| fs::write(path, b"\x89PNG").unwrap());
        let mut sequence = Folder::open(dir.path(), "", None).unwrap();
        let said = sequence.next_frame().unwrap().unwrap().open().err().unwrap().to_string();
        assert!(said.contains("a1.png"), "{said}");
    }

    /// What is read as a cube today stays one; what may be either is not guessed.
    #[test]
    fn grey_pictures_are_bands_only_where_something_says_so() {
        let of = |count: usize| {
            let names = numbered_names(count);
            folder(&names.iter().map(String::as_str).collect::<Vec<_>>(), grey)
        };
        let (cave, some) = (of(31), of(7));
        assert_eq!(kind(cave.path(), "").unwrap(), Kind::Cube);
        let said = kind(some.path(), "").unwrap_err().to_string();
        assert!(said.contains("kind=sequence") && said.contains("start_nm"), "{said}");
        assert_eq!(kind(some.path(), "start_nm=400,step_nm=50").unwrap(), Kind::Cube);
        assert_eq!(kind(some.path(), "kind=sequence").unwrap(), Kind::Sequence);
        assert_eq!(kind(some.path(), "as=reflectance").unwrap(), Kind::Sequence);
        assert!(kind(some.path(), "kind=film").is_err());
        let spec = format!("{}:kind=cube,start_nm=400,step_nm=50", some.path().display());
        assert_eq!(open_file(&spec).unwrap().size(), (4, 3));
        let nm = folder(&["s420nm.png", "s430nm.png"], grey);
        assert_eq!(kind(nm.path(), "").unwrap(), Kind::Cube);
        assert!(kind(folder(&["f400.png", "f401.png"], grey).path(), "").is_err());
        // Grey pictures in channels are still grey.
        let in_channels = |path: &Path| png(path, png::ColorType::Rgba, &[90, 90, 90, 255]);
        let names = numbered_names(31);
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        assert_eq!(kind(folder(&names, in_channels).path(), "").unwrap(), Kind::Cube);
    }

    #[test]
    fn one_folder_has_one_kind_of_scenes() {
        let dir = folder(&["a.jpg", "b.JPEG"], |path| fs::write(path, "").unwrap());
        assert_eq!(kind(dir.path(), "").unwrap(), Kind::Sequence);
        assert!(Folder::open(dir.path(), "", None).is_ok());
        fs::write(dir.path().join("a.exr"), "").unwrap();
        let said = Folder::open(dir.path(), "", None).err().unwrap().to_string();
        assert!(said.contains("1 of .exr, 2 of .jpg"), "{said}");
        let empty = tempfile::tempdir().unwrap();
        assert_eq!(kind(empty.path(), "").unwrap(), Kind::Cube, "opened and refused as one");
    }
}
