//! Directories of characterised lenses: their `lens.toml` and arrays, whole or not at all.

use camrig_base::{Error, ErrorCode, Result, npy};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::Path;

/// Tables over field heights.
pub(super) const DISK_FORMAT: &str = "camrig-lens/1";
/// Tables over places of the image.
pub(super) const PLANE_FORMAT: &str = "camrig-lens/2";

/// A transmittance of 1, wavelength (nm) and value.
pub(super) fn clear() -> Vec<[f64; 2]> {
    vec![[550.0, 1.0]]
}

/// What every `lens.toml` says first.
#[derive(Deserialize)]
struct FormatOnly {
    format: String,
}

fn lens_toml<T: DeserializeOwned>(dir: &Path) -> Result<T> {
    let path = dir.join("lens.toml");
    let text = std::fs::read_to_string(&path).map_err(|e| Error::io("read", &path, e))?;
    toml::from_str(&text).map_err(|e| Error::internal(e.to_string()).at(path.display()))
}

/// The format that a lens directory says it has.
pub(super) fn format_of(dir: &Path) -> Result<String> {
    Ok(lens_toml::<FormatOnly>(dir)?.format)
}

/// The `lens.toml` of a directory that must be of `format`.
pub(super) fn head<T: DeserializeOwned>(dir: &Path, format: &str) -> Result<T> {
    let found = format_of(dir)?;
    let place = || dir.join("lens.toml").display().to_string();
    if found == PLANE_FORMAT && found != format {
        return Err(Error::unsupported("the lens is not rotationally symmetric")
            .at(place())
            .help("its tables are over places of the image; pictures through it can be made")
            .with_code(ErrorCode::AsymmetricLens));
    }
    if found != format {
        return Err(Error::input(format!("format \"{found}\""))
            .at(place())
            .help(format!("this program reads \"{format}\"")));
    }
    lens_toml(dir)
}

/// Writes `lens.toml`.
pub(super) fn write_head(dir: &Path, head: &impl Serialize) -> Result<()> {
    let path = dir.join("lens.toml");
    let text = toml::to_string(head).map_err(|e| Error::internal(e.to_string()))?;
    std::fs::write(&path, text).map_err(|e| Error::io("write", &path, e))
}

/// Writes a lens directory by `write_files`, whole or not at all; an existing one only with
/// `force`.
pub(super) fn write_directory(
    dir: &Path,
    force: bool,
    write_files: impl FnOnce(&Path) -> Result<()>,
) -> Result<()> {
    if dir.exists() && !force {
        return Err(Error::input(format!("{} exists already", dir.display()))
            .help("choose another name, or replace it")
            .with_code(ErrorCode::OutputExists));
    }
    if dir.exists() && !dir.join("lens.toml").exists() {
        return Err(Error::input(format!("{} is not a lens directory", dir.display()))
            .help("only a lens directory is replaced"));
    }
    let parent = match dir.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let staging = tempfile::tempdir_in(parent).map_err(|e| Error::io("write into", parent, e))?;
    write_files(staging.path())?;
    if dir.exists() {
        std::fs::remove_dir_all(dir).map_err(|e| Error::io("replace", dir, e))?;
    }
    std::fs::rename(staging.keep(), dir).map_err(|e| Error::io("write", dir, e))
}

pub(super) fn write_npy<T: npy::Sample>(path: &Path, shape: &[u64], values: &[T]) -> Result<()> {
    let axes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let write = || -> std::io::Result<()> {
        let mut file = BufWriter::new(File::create(path)?);
        npy::write(&mut file, &format!("({axes})"), values)?;
        file.flush()
    };
    write().map_err(|e| Error::io("write", path, e))
}

/// The shape of an array, and its samples, in C order.
pub(super) fn read_npy<T: npy::Sample>(path: &Path) -> Result<(Vec<usize>, Vec<T>)> {
    let file = File::open(path).map_err(|e| Error::io("read", path, e))?;
    let bytes = file.metadata().map_err(|e| Error::io("read", path, e))?.len();
    let mut file = BufReader::new(file);
    let mut read = || {
        let header = npy::Header::read(&mut file)?;
        let samples = header.samples(&mut file, bytes)?;
        Ok((header.shape, samples))
    };
    read().map_err(|e: Error| e.at(path.display()))
}

/// A table whose axes, named by `axes`, have the lengths `expected`.
pub(super) fn read_table(path: &Path, expected: &[usize], axes: &str) -> Result<Vec<f64>> {
    let (shape, values) = read_npy(path)?;
    if shape != expected {
        return Err(Error::input(format!("array of shape {shape:?}"))
            .at(path.display())
            .help(format!("lens.toml announces {axes} = {expected:?}")));
    }
    Ok(values)
}
