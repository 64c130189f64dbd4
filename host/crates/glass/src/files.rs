//! Catalogue files (`.agf`) in folders.

use crate::Catalogue;
use crate::text::read_text;
use camrig_base::{Error, Result};
use std::path::{Path, PathBuf};

/// Largest catalogue that is read, bytes; makers' own have up to 2 MB.
const LARGEST: u64 = 64 << 20;

/// `glasses` and those of the catalogues in the folder of `lens`.
///
/// # Errors
/// A catalogue that cannot be read, or is too large to be one.
pub fn beside(lens: &Path, glasses: &Catalogue) -> Result<Catalogue> {
    let mut glasses = glasses.clone();
    for path in catalogues(lens.parent().unwrap_or(Path::new(""))) {
        add(&mut glasses, &path)?;
    }
    Ok(glasses)
}

/// Adds the glasses of a catalogue under its file's name.
///
/// # Errors
/// A catalogue that cannot be read, or is too large to be one.
pub fn add(glasses: &mut Catalogue, path: &Path) -> Result<()> {
    let size = std::fs::metadata(path).map_err(|e| Error::io("read", path, e))?.len();
    if size > LARGEST {
        return Err(Error::limit(format!("a glass catalogue of {} MiB", size >> 20))
            .at(path.display())
            .help(format!("catalogues have up to {} MiB", LARGEST >> 20)));
    }
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    glasses.insert_agf(&name, &read_text(path)?);
    Ok(())
}

/// The catalogue at `path`, or those in the folder at `path`.
///
/// # Errors
/// Nothing there, or a folder without a catalogue.
pub fn named(path: &Path) -> Result<Vec<PathBuf>> {
    let found = std::fs::metadata(path).map_err(|e| Error::io("read", path, e))?;
    if !found.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    match catalogues(path) {
        none if none.is_empty() => Err(Error::input("no glass catalogue in the folder")
            .at(path.display())
            .help("catalogues are files in the AGF format, named *.agf")),
        some => Ok(some),
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// In UTF-16 with CR LF, as makers write them; n = 1.5 by formula 2.
    #[test]
    fn a_lens_file_finds_the_catalogue_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let agf = "CC own\r\nNM OWN 2 500600 1.5 60 0 1 0\r\nCD 1.25 0 0 0 0 0\r\nLD 0.4 0.7\r\n";
        let bytes: Vec<u8> = "\u{feff}"
            .encode_utf16()
            .chain(agf.encode_utf16())
            .flat_map(u16::to_le_bytes)
            .collect();
        std::fs::write(folder.path().join("Melts.AGF"), bytes).unwrap();
        let lens = folder.path().join("lens.zmx");
        let find = |makers: &[&str]| {
            let makers: Vec<String> = makers.iter().map(|m| (*m).to_owned()).collect();
            let glasses = beside(&lens, &Catalogue::default()).unwrap();
            glasses.find("OWN", &makers).unwrap()
        };
        assert!((find(&["melts"]).glass.index(550.0).unwrap() - 1.5).abs() < 1e-15);
        assert_eq!(find(&["melts"]).note, None);
        assert!(find(&["schott"]).note.unwrap().contains("MELTS"));
        assert!(find(&["schott"]).glass.index(900.0).is_err());
    }
}
