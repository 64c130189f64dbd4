//! The data set of a sweep on disk, filled by any number of processes in any order.
//!
//! ```text
//! DIR/batch.json               what is being made, of which inputs, by which version
//! DIR/frames/000/000042.dng    picture 42
//! DIR/frames/000/000042.json   its parameters, digest and figures
//! DIR/frames/000/000042.clean.npy, .labels.json, .mask.png    where the sweep file asks for them
//! DIR/tars/000000.tar          pictures 0 to N - 1, instead of their files but for the records,
//!                              where the sweep file has `pictures_per_tar = N`
//! DIR/manifest.jsonl           all of these in order: the data set is complete
//! DIR/figures.csv              figures of all pictures, where the sweep file has [figures]
//! DIR/figures.html             the same as a page, by whoever draws pages
//! ```
//!
//! Files appear whole, a picture's record and what is beside it before the picture: where the
//! picture is, all are. So a picture is done exactly if its file or its tar file is there, a kill
//! loses at most the work on pictures under way, and two processes that make the same picture make
//! the same bytes. A tar file is made when the last of its pictures is there, and then their files
//! go.

use super::figures::{self, Figures, Wanted};
use super::{Sweep, tars};
use camrig_base::output::write_file;
use camrig_base::{Error, Result};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::fs;
use std::io::{ErrorKind, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A data set under way.
pub struct Dataset {
    directory: PathBuf,
    extension: String,
    pictures: u64,
    per_tar: Option<u64>,
    wanted: Wanted,
}

/// What one picture has.
pub struct Sample {
    /// The frame's file.
    pub frame: Vec<u8>,
    /// Files beside it, by their endings.
    pub beside: Vec<(&'static str, Vec<u8>)>,
    /// What it was made of.
    pub parameters: Value,
    /// Its figures.
    pub figures: Figures,
}

/// Pictures in one folder: few enough for tools that list a folder to stay quick.
const PER_FOLDER: u64 = 1000;

impl Dataset {
    /// Begins the data set of a sweep in a directory, or goes on with it.
    ///
    /// # Errors
    /// A directory that holds something else, or a data set begun from other inputs.
    pub fn open(directory: &Path, sweep: &Sweep) -> Result<Self> {
        let mut text = serde_json::to_string_pretty(&description(sweep)?).unwrap_or_default();
        text.push('\n');
        let place = directory.join("batch.json");
        if !place.exists() {
            let occupied =
                fs::read_dir(directory).is_ok_and(|mut entries| entries.next().is_some());
            if occupied {
                return Err(Error::input(format!("{} holds something else", directory.display()))
                    .help(
                        "give a new or empty directory, or that of the same sweep to go on with \
                         it",
                    ));
            }
            fs::create_dir_all(directory).map_err(|e| Error::io("create", directory, e))?;
            if let Err(error) = write_file(&place, false, text.as_bytes())
                && !place.exists()
            {
                return Err(error);
            }
        }
        let there = fs::read_to_string(&place).map_err(|e| Error::io("read", &place, e))?;
        if there != text {
            return Err(differs(&there, &text).at(directory.display()));
        }
        Ok(Self {
            directory: directory.to_path_buf(),
            extension: sweep.files.clone(),
            pictures: sweep.pictures(),
            per_tar: sweep.pictures_per_tar.map(u64::from),
            wanted: sweep.figures.clone(),
        })
    }

    /// The tar file that a picture goes to, if any, and the pictures in it.
    fn tar(&self, index: u64) -> Option<(PathBuf, Range<u64>)> {
        let number = index / self.per_tar?;
        let first = number * self.per_tar?;
        let place = self.directory.join(format!("tars/{number:06}.tar"));
        Some((place, first..(first + self.per_tar?).min(self.pictures)))
    }

    /// Files of a picture that are there, its record last.
    fn files(&self, index: u64) -> impl Iterator<Item = PathBuf> {
        let endings = [&self.extension[..], "clean.npy", "labels.json", "mask.png", "json"];
        endings.map(|ending| self.place(index, ending)).into_iter().filter(|path| path.exists())
    }

    fn place(&self, index: u64, extension: &str) -> PathBuf {
        self.directory.join(relative(index, extension))
    }

    /// Whether a picture is done.
    pub fn has(&self, index: u64) -> bool {
        self.place(index, &self.extension).exists()
            || self.tar(index).is_some_and(|(tar, _)| tar.exists())
    }

    /// Number of pictures done.
    pub fn done(&self) -> u64 {
        (0..self.pictures).filter(|&i| self.has(i)).count() as u64
    }

    /// Writes a picture, what is beside it, and its record.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn put(&self, index: u64, sample: Sample) -> Result<()> {
        let Sample { frame, beside, parameters, figures } = sample;
        let mut record = json!({
            "index": index,
            "file": relative(index, &self.extension),
            "sha256": hex(&Sha256::digest(&frame)),
            "bytes": frame.len(),
            "parameters": parameters,
            "channels": figures.channels,
        });
        if !figures.picture.is_empty() {
            record["figures"] = figures.picture.into();
        }
        let folder = self.place(index, "");
        let folder = folder.parent().unwrap_or(&self.directory);
        fs::create_dir_all(folder).map_err(|e| Error::io("create", folder, e))?;
        for (ending, bytes) in &beside {
            let sha256 = hex(&Sha256::digest(bytes));
            record["beside"][ending] =
                json!({ "file": relative(index, ending), "sha256": sha256 });
            put_once(&self.place(index, ending), bytes)?;
        }
        if let Some((tar, _)) = self.tar(index) {
            let tar = tar.strip_prefix(&self.directory).unwrap_or(&tar).to_string_lossy();
            record["tar"] = json!(tar);
        }
        put_once(&self.place(index, "json"), format!("{record}\n").as_bytes())?;
        put_once(&self.place(index, &self.extension), &frame)
    }

    /// Makes the tar files of which some of these pictures are a part and all are there, and
    /// removes the files that are in them.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn pack(&self, pictures: Range<u64>) -> Result<()> {
        let mut next = pictures.start;
        while next < pictures.end {
            let Some((tar, inside)) = self.tar(next) else { break };
            next = inside.end;
            if !tar.exists() {
                if !inside.clone().all(|index| self.place(index, &self.extension).exists()) {
                    continue;
                }
                let folder = self.directory.join("tars");
                fs::create_dir_all(&folder).map_err(|e| Error::io("create", &folder, e))?;
                let files: Vec<PathBuf> =
                    inside.clone().flat_map(|index| self.files(index)).collect();
                // Another process may have made it meanwhile, and removed what is in it.
                match tars::write(&tar, &files) {
                    Err(_) if tar.exists() => {}
                    outcome => outcome?,
                }
            }
            // The record stays: the manifest is made of it.
            let kept = |path: &PathBuf, index| *path == self.place(index, "json");
            for index in inside {
                for path in self.files(index).filter(|path| !kept(path, index)) {
                    match fs::remove_file(&path) {
                        Err(e) if e.kind() != ErrorKind::NotFound => {
                            return Err(Error::io("remove", &path, e));
                        }
                        _ => {}
                    }
                }
            }
        }
        Ok(())
    }

    /// Writes the manifest if every picture is there. Returns how many are.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn complete(&self) -> Result<u64> {
        self.pack(0..self.pictures)?;
        let done = self.done();
        if done == self.pictures {
            let mut manifest = Vec::new();
            for index in 0..self.pictures {
                let path = self.place(index, "json");
                let record = fs::read(&path).map_err(|e| Error::io("read", &path, e))?;
                manifest.extend_from_slice(&record);
            }
            if self.wanted.is_named() {
                let table = figures::table(&records(&manifest), &self.wanted);
                put_once(&self.directory.join("figures.csv"), table.as_bytes())?;
            }
            put_once(&self.directory.join("manifest.jsonl"), &manifest)?;
        }
        Ok(done)
    }

    /// Writes `figures.html` as `page` draws it from the records of the pictures, if the sweep
    /// file has `[figures]` and the data set is complete. Returns where it is.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn draw(&self, page: impl FnOnce(&[Value]) -> String) -> Result<Option<PathBuf>> {
        let manifest = self.directory.join("manifest.jsonl");
        if !self.wanted.is_named() || !manifest.exists() {
            return Ok(None);
        }
        let manifest = fs::read(&manifest).map_err(|e| Error::io("read", &manifest, e))?;
        let place = self.directory.join("figures.html");
        put_once(&place, page(&records(&manifest)).as_bytes())?;
        Ok(Some(place))
    }
}

/// The records of a manifest.
fn records(manifest: &[u8]) -> Vec<Value> {
    let lines = manifest.split(|b| *b == b'\n').filter(|line| !line.is_empty());
    lines.filter_map(|line| serde_json::from_slice(line).ok()).collect()
}

fn relative(index: u64, extension: &str) -> String {
    format!("frames/{:03}/{index:06}.{extension}", index / PER_FOLDER)
}

/// Writes a file that another process may have written already, with the same bytes.
fn put_once(path: &Path, bytes: &[u8]) -> Result<()> {
    if path.exists() {
        return Ok(());
    }
    match write_file(path, false, bytes) {
        Err(_) if path.exists() => Ok(()),
        outcome => outcome,
    }
}

/// What a data set is made of. No date, no host name: the same from every process that works on
/// it.
fn description(sweep: &Sweep) -> Result<Value> {
    let mut inputs = Vec::new();
    for path in &sweep.inputs {
        let mut digest = Sha256::new();
        hash(path, &mut digest)?;
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned());
        inputs.push(json!({ "name": name, "sha256": hex(&digest.finalize()) }));
    }
    Ok(json!({
        "format": "batch/1",
        "camrig": env!("CARGO_PKG_VERSION"),
        "pictures": sweep.pictures(),
        "inputs": inputs,
        "one_again": "camrig batch SWEEP --only INDEX -o DIR, SWEEP a file with the text \"sweep\" \
                      where its inputs are",
        "sweep": sweep.text,
    }))
}

/// Content of a file, or of every file of a directory in name order.
fn hash(path: &Path, digest: &mut Sha256) -> Result<()> {
    let failed = |e| Error::io("read", path, e);
    if path.is_dir() {
        let entries = fs::read_dir(path).map_err(failed)?;
        let mut paths: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
        paths.sort();
        for path in paths {
            digest.update(path.file_name().unwrap_or_default().as_encoded_bytes());
            hash(&path, digest)?;
        }
        return Ok(());
    }
    let mut file = fs::File::open(path).map_err(failed)?;
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer).map_err(failed)? {
            0 => return Ok(()),
            n => digest.update(&buffer[..n]),
        }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// The error that names the input that has changed since the data set was begun.
fn differs(there: &str, now: &str) -> Error {
    let parse = |text: &str| serde_json::from_str::<Value>(text).unwrap_or_default();
    let (there, now) = (parse(there), parse(now));
    let inputs = |of: &Value| of["inputs"].as_array().cloned().unwrap_or_default();
    let changed = inputs(&now).into_iter().find(|input| !inputs(&there).contains(input));
    let what = if there["sweep"] != now["sweep"] {
        "the sweep file is not the one with which this data set was begun".to_string()
    } else if there["camrig"] != now["camrig"] {
        format!("this data set was begun by camrig {}", there["camrig"].as_str().unwrap_or("?"))
    } else if let Some(name) = changed.as_ref().and_then(|input| input["name"].as_str()) {
        format!("{name} has changed since this data set was begun")
    } else {
        "this data set was begun from other inputs".to_string()
    };
    Error::disagreement(what)
        .help("finish it with what it was begun with, or give a new directory")
}
