//! Outputs that are read while they are written: standard output, named pipes, and files that grow
//! by whole records.
//!
//! A record is there whole or not at all. A file has its name from the first record on; what fails
//! or is interrupted later leaves the records before.

use super::{Listed, cannot_create, exists};
use crate::platform::widen_pipe;
use crate::{Error, Result};
use std::fs;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// An output that is read while it is written.
pub struct LiveOutput {
    path: PathBuf,
    target: Target,
    /// Bytes of whole records.
    bytes: u64,
    records: u64,
}

enum Target {
    /// Standard output, a named pipe or a device.
    Stream(Box<dyn Write + Send>),
    /// A file, and its place among unfinished outputs where it is new and has no record yet.
    File(fs::File, Option<Listed>),
}

impl LiveOutput {
    /// Opens an output. `-` is standard output; a named pipe waits for its reader. An existing
    /// file is replaced only with `force`, and not before the first record.
    ///
    /// # Errors
    /// A file that exists (without `force`), a directory, and a folder that is missing or cannot
    /// be written.
    pub fn create(path: &Path, force: bool) -> Result<Self> {
        let live = |target| Self { path: path.to_owned(), target, bytes: 0, records: 0 };
        if Self::is_stdout(path) {
            widen_pipe(&io::stdout());
            return Ok(live(Target::Stream(Box::new(io::stdout()))));
        }
        let mut options = fs::OpenOptions::new();
        options.write(true);
        match fs::metadata(path) {
            Ok(meta) if meta.is_dir() => {
                Err(Error::input(format!("{} is a directory", path.display()))
                    .help("give the name of a file in it"))
            }
            Ok(meta) if meta.is_file() && !force => Err(exists(path)),
            Ok(meta) => {
                let file = options.open(path).map_err(|e| Error::io("open", path, e))?;
                Ok(live(match meta.is_file() {
                    true => Target::File(file, None),
                    false => {
                        widen_pipe(&file);
                        Target::Stream(Box::new(file))
                    }
                }))
            }
            Err(_) => {
                let make = || options.create_new(true).open(path);
                let (file, listed) = Listed::create(make, |_| path.to_owned())
                    .map_err(|e| cannot_create(path, e))?;
                Ok(live(Target::File(file, Some(listed))))
            }
        }
    }

    /// Whether a path means standard output.
    pub fn is_stdout(path: &Path) -> bool {
        path.as_os_str() == "-"
    }

    /// Whether a path is one that is read while it is written whatever is written to it: standard
    /// output, a named pipe, a device.
    pub fn is_stream(path: &Path) -> bool {
        Self::is_stdout(path) || fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir())
    }

    /// Writes a record, whole.
    ///
    /// # Errors
    /// A reader that has gone, a full disk. What was written of the record to a file is cut off.
    pub fn push(&mut self, record: &[u8]) -> Result<()> {
        let written = match &mut self.target {
            Target::Stream(stream) => stream.write_all(record).and_then(|()| stream.flush()),
            Target::File(file, new) => {
                let first = self.records == 0;
                let begun = if first { file.set_len(0) } else { Ok(()) };
                let written = begun.and_then(|()| file.write_all(record));
                if written.is_err() {
                    let _ = file.set_len(self.bytes);
                    let _ = file.seek(SeekFrom::Start(self.bytes));
                } else {
                    // From here on the file stays.
                    if let Some(listed) = new.take() {
                        drop(listed);
                    }
                }
                written
            }
        };
        written.map_err(|e| self.failed(e))?;
        self.bytes += record.len() as u64;
        self.records += 1;
        Ok(())
    }

    fn failed(&self, error: io::Error) -> Error {
        let gone = error.kind() == io::ErrorKind::BrokenPipe;
        let path =
            if Self::is_stdout(&self.path) { Path::new("standard output") } else { &self.path };
        let error = Error::io("write", path, error);
        let kept = format!("{} written whole before stay", self.records);
        error.help(match gone {
            true => format!("the program that reads it has ended; {kept}"),
            false => kept,
        })
    }

    /// Records written.
    pub fn records(&self) -> u64 {
        self.records
    }
}

impl Drop for LiveOutput {
    fn drop(&mut self) {
        if let Target::File(_, Some(_)) = self.target {
            let _ = fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_has_its_name_from_the_first_record_on() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.csi2");
        drop(LiveOutput::create(&path, false).unwrap());
        assert!(!path.exists(), "nothing was written");
        let mut live = LiveOutput::create(&path, false).unwrap();
        live.push(b"one").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"one", "read while it is open");
        live.push(b"two").unwrap();
        drop(live);
        assert_eq!(fs::read(&path).unwrap(), b"onetwo");
    }

    #[test]
    fn an_existing_file_is_replaced_by_force_and_with_the_first_record() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.csi2");
        fs::write(&path, b"longer than what follows").unwrap();
        let said = LiveOutput::create(&path, false).err().unwrap().to_string();
        assert!(said.contains("exists"), "{said}");
        let mut live = LiveOutput::create(&path, true).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"longer than what follows");
        live.push(b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        let said = LiveOutput::create(dir.path(), true).err().unwrap().to_string();
        assert!(said.contains("is a directory"), "{said}");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_device_that_takes_nothing_is_said_with_what_stays() {
        let mut live = LiveOutput::create(Path::new("/dev/full"), false).unwrap();
        let said = live.push(&[0; 100]).unwrap_err().to_string();
        assert!(said.contains("No space left") && said.contains("0 written whole"), "{said}");
    }
}
