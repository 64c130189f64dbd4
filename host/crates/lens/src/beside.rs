//! Glass catalogues (`.agf`) that lie beside a lens file.

use super::glass::Catalogue;
use super::text::read_text;
use camrig_base::{Error, Result};
use std::path::{Path, PathBuf};

/// Largest catalogue that is read, bytes; makers' own have up to 2 MB.
const LARGEST: u64 = 64 << 20;

/// `glasses` and those of the catalogues in the folder of `lens`.
///
/// # Errors
/// A catalogue that cannot be read, or is too large to be one.
pub(crate) fn with_catalogues_beside(lens: &Path, glasses: &Catalogue) -> Result<Catalogue> {
    let mut glasses = glasses.clone();
    for path in catalogues(lens.parent().unwrap_or(Path::new(""))) {
        let size = std::fs::metadata(&path).map_err(|e| Error::io("read", &path, e))?.len();
        if size > LARGEST {
            return Err(Error::limit(format!("a glass catalogue of {} MiB", size >> 20))
                .at(path.display())
                .help(format!("catalogues have up to {} MiB", LARGEST >> 20)));
        }
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        glasses.insert_agf(&name, &read_text(&path)?);
    }
    Ok(glasses)
}

/// The catalogues of a folder, by name; a folder that cannot be listed has none.
fn catalogues(folder: &Path) -> Vec<PathBuf> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let is_catalogue = |path: &PathBuf| {
        path.extension().is_some_and(|e| e.eq_ignore_ascii_case("agf")) && path.is_file()
    };
    let mut all: Vec<PathBuf> =
        entries.filter_map(|e| Some(e.ok()?.path())).filter(is_catalogue).collect();
    all.sort();
    all
}
