//! Drafts a manifest from the frames of a folder: groups files into stacks and finds the
//! conditions of each from metadata, names and levels.
//!
//! Nothing is invented. [`Draft::text`] states the source of each value in a comment, and has
//! [`UNKNOWN`](super::manifest::UNKNOWN) for required values without a source.
//!
//! - Exposure, gain, temperature and levels: from the file's own fields
//!   ([`camrig_formats::Taken`]), otherwise from its sidecar file (`NAME.json` as written by
//!   libcamera's programs), otherwise from the caller, otherwise, for exposures, from the name
//!   (`dark-010ms`).
//! - Role: from the file's own fields (IMAGETYP of FITS), otherwise from the name, otherwise from
//!   the levels of its first frame over a grid of blocks.
//! - A stack: frames of one folder whose names differ only by a number, with the same role,
//!   exposure, gain and level. A file of several frames is a stack.

mod file;
mod names;
mod sensor;
mod sidecar;
mod stacks;
mod text;

use camrig_base::{Cfa, Error, Result};
use camrig_formats::Said;
use file::FrameFile;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Values provided by the caller for frames whose files lack them.
#[derive(Clone, Debug, Default)]
pub struct Known {
    /// Exposure time of all stacks, s.
    pub exposure_s: Option<f64>,
    /// Gain of all stacks before the converter.
    pub analog_gain: Option<f64>,
    /// Temperature of the sensor, °C.
    pub temperature_c: Option<f64>,
    /// Bits of a sample.
    pub bits: Option<u32>,
    /// Colour filter pattern.
    pub cfa: Option<Cfa>,
    /// Mean without light, DN.
    pub black_level_dn: Option<f64>,
    /// Value at which a sample saturates, DN.
    pub white_level_dn: Option<u16>,
    /// Distance of neighbouring pixels, µm.
    pub pitch_um: Option<f64>,
}

/// A drafted manifest, with the sources of its values.
#[derive(Clone, Debug)]
pub struct Draft {
    sensor: sensor::Sensor,
    stacks: Vec<stacks::Stack>,
    /// Files that are not frames of the set.
    pub skipped: Vec<SkippedFile>,
    /// Remarks that a person should check.
    pub notes: Vec<String>,
}

/// A file that is not used.
#[derive(Clone, Debug)]
pub struct SkippedFile {
    /// Its name within the folder.
    pub name: PathBuf,
    /// Why.
    pub reason: String,
}

/// Most levels of folders below the set that are searched.
const MAX_DEPTH: usize = 8;
/// Extensions of files that accompany frames.
const SIDECARS: [&str; 12] =
    ["toml", "json", "txt", "md", "csv", "html", "htm", "pdf", "xml", "yaml", "yml", "log"];

impl Draft {
    /// Drafts a manifest from every file in `folder` and below. `progress` is called after each
    /// file with the number of all files.
    ///
    /// # Errors
    /// A folder that cannot be read or has no frames, frames of several sizes.
    pub fn of(folder: &Path, known: &Known, progress: &(dyn Fn(usize) + Sync)) -> Result<Self> {
        let mut files = Vec::new();
        list(folder, Path::new(""), 0, &mut files)?;
        let read = |name: &PathBuf| {
            let file = FrameFile::read(folder, name);
            progress(files.len());
            (name.clone(), file)
        };
        let read: Vec<_> = files.par_iter().map(read).collect();
        let (mut frames, mut skipped) = (Vec::new(), Vec::new());
        for (name, result) in read {
            match result {
                Ok(file) => frames.push(file),
                Err(e) => skipped.push(SkippedFile { name, reason: e.what().to_string() }),
            }
        }
        if frames.is_empty() {
            let line = |s: &SkippedFile| format!("\n  {}: {}", s.name.display(), s.reason);
            let list: String = skipped.iter().map(line).collect();
            return Err(Error::input(format!("no frames in {}{list}", folder.display())).help(
                "put raw frames there: DNG, TIFF, FITS, NPY, PGM, grey PNG, CSI-2, MCAP, or \
                 headerless pixels named like NAME_640x480_SGRBG10P.raw",
            ));
        }
        check_sizes(&frames)?;
        let stacks = stacks::of(&frames, known, &files);
        let sensor = sensor::Sensor::of(&frames, &stacks, known);
        let notes = notes(&frames, &stacks);
        Ok(Self { sensor, stacks, skipped, notes })
    }

    /// Number of stacks and of frames in them.
    pub fn count(&self) -> [usize; 2] {
        [self.stacks.len(), self.stacks.iter().map(|s| s.frames).sum()]
    }

    /// Whether there is a stack of this role.
    pub fn has(&self, role: super::Role) -> bool {
        self.stacks.iter().any(|s| s.role.is(&role))
    }
}

/// A value of the manifest with its source; without a value, the reason.
#[derive(Clone, Debug, PartialEq)]
struct Based<T> {
    value: Option<T>,
    on: String,
}

impl<T> Based<T> {
    fn new(value: T, on: impl Into<String>) -> Self {
        Self { value: Some(value), on: on.into() }
    }

    fn unknown(why: impl Into<String>) -> Self {
        Self { value: None, on: why.into() }
    }

    fn is(&self, value: &T) -> bool
    where
        T: PartialEq,
    {
        self.value.as_ref() == Some(value)
    }

    fn map(self, change: impl FnOnce(T) -> T) -> Self {
        Self { value: self.value.map(change), on: self.on }
    }
}

impl<T> From<Said<T>> for Based<T> {
    fn from(said: Said<T>) -> Self {
        Self::new(said.value, said.by)
    }
}

/// Lists the files below `folder`, relative to it, in natural order, without hidden ones.
fn list(folder: &Path, inside: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<()> {
    let place = folder.join(inside);
    let failed = |e| Error::io("read", &place, e).help("give the folder of the frames");
    let entries = std::fs::read_dir(&place).map_err(failed)?;
    let mut names: Vec<_> =
        entries.map(|entry| Ok(entry.map_err(failed)?.file_name())).collect::<Result<_>>()?;
    names.sort_by_cached_key(|name| camrig_base::natural_order(&name.to_string_lossy()));
    for name in names.iter().filter(|name| !name.as_encoded_bytes().starts_with(b".")) {
        let path = inside.join(name);
        let whole = folder.join(&path);
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        if whole.is_dir() && depth < MAX_DEPTH {
            list(folder, &path, depth + 1, files)?;
        } else if whole.is_file() && !ending.is_some_and(|e| SIDECARS.contains(&&e[..])) {
            files.push(path);
        }
    }
    Ok(())
}

fn check_sizes(files: &[FrameFile]) -> Result<()> {
    let mut sizes: Vec<(usize, usize)> = files.iter().map(|s| s.size).collect();
    sizes.sort_unstable();
    sizes.dedup();
    if let [_] = sizes[..] {
        return Ok(());
    }
    let of = |size: &(usize, usize)| {
        let own: Vec<&FrameFile> = files.iter().filter(|s| s.size == *size).collect();
        let first = own[0].name.display();
        format!("{} x {} in {} file(s), such as {first}", size.0, size.1, own.len())
    };
    let sizes: Vec<String> = sizes.iter().map(of).collect();
    Err(Error::disagreement(format!("frames of several sizes: {}", sizes.join("; ")))
        .help("a set has frames of one size; move the others to another folder"))
}

/// Remarks of the readers, each once with its first file, and stacks that contradict their names.
fn notes(files: &[FrameFile], stacks: &[stacks::Stack]) -> Vec<String> {
    let mut notes: Vec<String> = Vec::new();
    let mut reported: Vec<&String> = Vec::new();
    for file in files {
        for note in &file.facts.notes {
            if !reported.contains(&note) {
                reported.push(note);
                notes.push(format!("{}: {note}", file.name.display()));
            }
        }
    }
    notes.extend(stacks.iter().flat_map(|s| s.notes.iter().cloned()));
    notes
}

#[cfg(test)]
mod tests;
