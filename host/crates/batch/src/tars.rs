//! Samples in tar files as WebDataset reads them: members of one sample follow each other and have
//! the same name up to the first dot.

use camrig_base::output::OutputFile;
use camrig_base::{Error, Result};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// Writes files to a tar file under their own names. No date, no owner: the same bytes wherever.
///
/// # Errors
/// What the operating system refuses; a tar file that is there already.
pub fn write(place: &Path, files: &[PathBuf]) -> Result<()> {
    let mut out = OutputFile::create(place, false)?;
    let mut archive = tar::Builder::new(&mut out);
    for path in files {
        add(&mut archive, path).map_err(|e| Error::io("read", path, e))?;
    }
    archive.into_inner().map(drop).map_err(|e| Error::io("write", place, e))?;
    out.finish()
}

fn add(archive: &mut tar::Builder<impl io::Write>, path: &Path) -> io::Result<()> {
    let file = File::open(path)?;
    let mut header = tar::Header::new_ustar();
    header.set_size(file.metadata()?.len());
    header.set_mode(0o644);
    header.set_mtime(0);
    archive.append_data(&mut header, path.file_name().unwrap_or_default(), file)
}
