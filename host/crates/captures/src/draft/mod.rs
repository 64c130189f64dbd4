//! A manifest from the frames of a folder: which files are one stack, and what each stack is, from
//! what the files say, what lies beside them, their names and their levels.
//!
//! Nothing is made up. Behind each value of [`Draft::text`] stands where it comes from, and
//! [`UNKNOWN`](super::manifest::UNKNOWN) stands where nothing tells a value that a manifest needs.
//!
//! - Exposure, gain, temperature and levels: the file's own fields ([`camrig_formats::Taken`]),
//!   then the metadata beside it (`NAME.json` as libcamera's programs write it), then what the
//!   caller knows, then, of exposures alone, the name (`dark-010ms`).
//! - Role: the file's own word (IMAGETYP of FITS), then the name, then the levels of its first
//!   frame over a grid of blocks.
//! - A stack: frames of one folder whose names differ by a number alone, of one role, exposure,
//!   gain and level. A file of several frames is a stack.

mod beside;
mod file;
mod names;
mod sensor;
mod stacks;
mod text;

use camrig_base::{Cfa, Error, Result};
use camrig_formats::Said;
use file::Seen;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// What the caller knows of frames whose files do not say it.
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

/// A manifest to be, with where its values come from.
#[derive(Clone, Debug)]
pub struct Draft {
    sensor: sensor::Sensor,
    stacks: Vec<stacks::Stack>,
    /// Files that are no frames of the set, each with the reason.
    pub left_out: Vec<(PathBuf, String)>,
    /// What a person should look at.
    pub notes: Vec<String>,
}

/// Deepest folder below the set that is looked into.
const DEEPEST: usize = 8;
/// Endings of files that go with frames and are none.
const BESIDE: [&str; 12] =
    ["toml", "json", "txt", "md", "csv", "html", "htm", "pdf", "xml", "yaml", "yml", "log"];

impl Draft {
    /// Looks at every file in `folder` and below. `each` is called once for each file.
    ///
    /// # Errors
    /// A folder that cannot be read or has no frames, frames of several sizes.
    pub fn of(folder: &Path, known: &Known, each: &(dyn Fn(usize) + Sync)) -> Result<Self> {
        let mut files = Vec::new();
        list(folder, Path::new(""), 0, &mut files)?;
        let look = |name: &PathBuf| {
            let seen = Seen::of(folder, name);
            each(files.len());
            (name.clone(), seen)
        };
        let looked: Vec<_> = files.par_iter().map(look).collect();
        let (mut seen, mut left_out) = (Vec::new(), Vec::new());
        for (name, result) in looked {
            match result {
                Ok(one) => seen.push(one),
                Err(e) => left_out.push((name, e.what().to_string())),
            }
        }
        if seen.is_empty() {
            let read = left_out.iter().map(|(name, why)| format!("\n  {}: {why}", name.display()));
            let read: String = read.collect();
            return Err(Error::input(format!("no frames in {}{read}", folder.display())).help(
                "put raw frames there: DNG, TIFF, FITS, NPY, PGM, grey PNG, CSI-2, MCAP, or \
                 headerless pixels named like NAME_640x480_SGRBG10P.raw",
            ));
        }
        of_one_size(&seen)?;
        let stacks = stacks::of(&seen, known, &files);
        let sensor = sensor::Sensor::of(&seen, &stacks, known);
        let notes = notes(&seen, &stacks);
        Ok(Self { sensor, stacks, left_out, notes })
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

/// A value of the manifest with what it is based on; without a value, why not.
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

/// Names of the files below `folder`, relative to it, in natural order. Hidden ones do not count.
fn list(folder: &Path, inside: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<()> {
    let place = folder.join(inside);
    let failed = |e| Error::io("read", &place, e).help("give the folder of the frames");
    let entries = std::fs::read_dir(&place).map_err(failed)?;
    let mut names: Vec<_> =
        entries.map(|entry| Ok(entry.map_err(failed)?.file_name())).collect::<Result<_>>()?;
    names.sort_by_cached_key(|name| camrig_scene::sequence::natural(&name.to_string_lossy()));
    for name in names.iter().filter(|name| !name.as_encoded_bytes().starts_with(b".")) {
        let path = inside.join(name);
        let whole = folder.join(&path);
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        if whole.is_dir() && depth < DEEPEST {
            list(folder, &path, depth + 1, files)?;
        } else if whole.is_file() && !ending.is_some_and(|e| BESIDE.contains(&&e[..])) {
            files.push(path);
        }
    }
    Ok(())
}

fn of_one_size(seen: &[Seen]) -> Result<()> {
    let mut sizes: Vec<(usize, usize)> = seen.iter().map(|s| s.size).collect();
    sizes.sort_unstable();
    sizes.dedup();
    if let [_] = sizes[..] {
        return Ok(());
    }
    let of = |size: &(usize, usize)| {
        let files: Vec<&Seen> = seen.iter().filter(|s| s.size == *size).collect();
        let first = files[0].name.display();
        format!("{} x {} in {} file(s), such as {first}", size.0, size.1, files.len())
    };
    let sizes: Vec<String> = sizes.iter().map(of).collect();
    Err(Error::disagreement(format!("frames of several sizes: {}", sizes.join("; ")))
        .help("a set has frames of one size; put the others into a folder of their own"))
}

/// Remarks of the readers, each once with its first file, and stacks that contradict their names.
fn notes(seen: &[Seen], stacks: &[stacks::Stack]) -> Vec<String> {
    let mut notes: Vec<String> = Vec::new();
    let mut told: Vec<&String> = Vec::new();
    for one in seen {
        for note in &one.facts.notes {
            if !told.contains(&note) {
                told.push(note);
                notes.push(format!("{}: {note}", one.name.display()));
            }
        }
    }
    notes.extend(stacks.iter().flat_map(|s| s.notes.iter().cloned()));
    notes
}

#[cfg(test)]
mod tests;
