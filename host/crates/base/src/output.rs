//! Outputs that are written whole or not at all.
//!
//! A file or directory is written next to its final place and gets its name when it is complete;
//! dropping it unfinished (an error, a panic) removes it. On Linux an unfinished file has no name
//! at all (`O_TMPFILE`), so that not even SIGKILL leaves one behind; elsewhere, and on file
//! systems without that, it has a hidden temporary name. What already exists is replaced only when
//! asked to. [`LiveOutput`] is for what is read while it is written: of that, each record is whole.

mod live;

pub use live::LiveOutput;

use crate::{Error, ErrorCode, Result, platform};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{PoisonError, RwLock};
use tempfile::{NamedTempFile, TempDir};

/// Left in every directory that camrig writes: only a directory that has it is ever replaced.
const DIRECTORY_MARK: &str = ".camrig-output";
/// Temporary names begin and end like this; the dot hides them.
const PREFIX: &str = ".camrig-";
const SUFFIX: &str = ".part";
/// Bytes written at a time: enough for the cost of a system call not to matter.
const BUFFER: usize = 1 << 16;

/// A file being written. Nothing is seen under its name before [`OutputFile::finish`].
pub struct OutputFile {
    path: PathBuf,
    target: Target,
    force: bool,
    _listed: Option<Listed>,
}

enum Target {
    /// A file without a name, linked to one on completion.
    Link(io::BufWriter<fs::File>),
    /// A file with a temporary name, renamed on completion.
    Rename(io::BufWriter<NamedTempFile>),
    /// Standard output, a device or a pipe: bytes go straight there.
    Stream(Box<dyn Write + Send>),
}

impl OutputFile {
    /// Opens an output. `-` is standard output. An existing file is replaced only with `force`.
    ///
    /// # Errors
    /// Given here, before any work: a file that exists (without `force`), a directory, and a
    /// folder that is missing or cannot be written.
    pub fn create(path: &Path, force: bool) -> Result<Self> {
        if path.as_os_str() == "-" {
            let target = Target::Stream(Box::new(io::stdout()));
            return Ok(Self { path: path.to_owned(), target, force, _listed: None });
        }
        // A symbolic link stays one: what it points to is replaced.
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        match fs::metadata(&path) {
            Ok(meta) if meta.is_dir() => {
                return Err(Error::input(format!("{} is a directory", path.display()))
                    .help("give the name of a file in it"));
            }
            Ok(meta) if !meta.is_file() => {
                let device = fs::OpenOptions::new().write(true).open(&path);
                let device = device.map_err(|e| Error::io("open", &path, e))?;
                return Ok(Self {
                    path,
                    target: Target::Stream(Box::new(device)),
                    force,
                    _listed: None,
                });
            }
            Ok(_) if !force => return Err(exists(&path)),
            _ => {}
        }
        if let Ok(file) = platform::create_nameless(folder_of(&path)) {
            let target = Target::Link(io::BufWriter::with_capacity(BUFFER, file));
            return Ok(Self { path, target, force, _listed: None });
        }
        let make = || builder(false).tempfile_in(folder_of(&path));
        let (temporary, listed) =
            Listed::create(make, |t| t.path().to_owned()).map_err(|e| cannot_create(&path, e))?;
        let target = Target::Rename(io::BufWriter::with_capacity(BUFFER, temporary));
        Ok(Self { path, target, force, _listed: Some(listed) })
    }

    /// Puts the complete file in its place.
    ///
    /// # Errors
    /// A file that another program has made there meanwhile, unless `force` was given, and what
    /// the operating system refuses.
    pub fn finish(mut self) -> Result<()> {
        self.flush().map_err(|e| Error::io("write", &self.path, e))?;
        let outcome = match self.target {
            Target::Stream(_) => Ok(()),
            Target::Link(writer) => name_file(writer.get_ref(), &self.path, self.force),
            Target::Rename(writer) => {
                writer.into_inner().map_err(io::IntoInnerError::into_error).and_then(|temporary| {
                    let persisted = if self.force {
                        temporary.persist(&self.path)
                    } else {
                        temporary.persist_noclobber(&self.path)
                    };
                    persisted.map(drop).map_err(|e| e.error)
                })
            }
        };
        outcome.map_err(|e| match e.kind() {
            io::ErrorKind::AlreadyExists => exists(&self.path),
            _ => Error::io("write", &self.path, e),
        })
    }
}

/// Names a nameless file. A name can be given only where there is none; to replace, a temporary
/// one is given first.
fn name_file(file: &fs::File, path: &Path, force: bool) -> io::Result<()> {
    match platform::give_name(file, path) {
        Err(e) if force && e.kind() == io::ErrorKind::AlreadyExists => {
            let folder = builder(true).tempdir_in(folder_of(path))?;
            let temporary = folder.path().join("file");
            platform::give_name(file, &temporary)?;
            fs::rename(temporary, path)
        }
        outcome => outcome,
    }
}

impl Target {
    fn writer(&mut self) -> &mut dyn Write {
        match self {
            Self::Link(writer) => writer,
            Self::Rename(writer) => writer,
            Self::Stream(writer) => writer,
        }
    }
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.target.writer().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.target.writer().flush()
    }
}

/// Writes `bytes` to `path` whole or not at all. `-` is standard output.
///
/// # Errors
/// Those of [`OutputFile::create`] and [`OutputFile::finish`].
pub fn write_file(path: &Path, force: bool, bytes: &[u8]) -> Result<()> {
    let mut output = OutputFile::create(path, force)?;
    output.write_all(bytes).map_err(|e| Error::io("write", path, e))?;
    output.finish()
}

/// Temporary names of outputs that are not finished. Who writes below one holds it for reading.
static UNFINISHED: RwLock<Vec<PathBuf>> = RwLock::new(Vec::new());

/// A name in [`UNFINISHED`], until it is dropped.
struct Listed(PathBuf);

impl Listed {
    /// Makes a file or a directory and lists its path. A signal in between waits.
    fn create<T>(
        make: impl FnOnce() -> io::Result<T>,
        path: impl FnOnce(&T) -> PathBuf,
    ) -> io::Result<(T, Self)> {
        let mut all = UNFINISHED.write().unwrap_or_else(PoisonError::into_inner);
        let made = make()?;
        let path = path(&made);
        all.push(path.clone());
        Ok((made, Self(path)))
    }
}

impl Drop for Listed {
    fn drop(&mut self) {
        let mut all = UNFINISHED.write().unwrap_or_else(PoisonError::into_inner);
        all.retain(|path| *path != self.0);
    }
}

/// Attempts at removing a directory that others may still be writing into by its path.
const ATTEMPTS: usize = 100;

/// Removes all outputs that are not finished, for a program that a signal ends: nothing is dropped
/// then. Writers that come after it wait for the end.
pub fn remove_unfinished() {
    let mut all = UNFINISHED.write().unwrap_or_else(PoisonError::into_inner);
    for path in all.drain(..) {
        for _ in 0..ATTEMPTS {
            let removed =
                if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
            if removed.is_ok() || !path.exists() {
                break;
            }
        }
    }
    std::mem::forget(all);
}

/// A directory being filled: write into [`OutputDir::path`], then [`OutputDir::finish`].
pub struct OutputDir {
    path: PathBuf,
    temporary: TempDir,
    force: bool,
    _listed: Listed,
}

impl OutputDir {
    /// Opens a directory output. An empty directory may exist already. With `force`, one that
    /// camrig wrote earlier is replaced as a whole; any other is left alone.
    ///
    /// # Errors
    /// A directory that is not to be replaced, a file of that name, and a folder that is missing
    /// or cannot be written.
    pub fn create(path: &Path, force: bool) -> Result<Self> {
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        check_replaceable(&path, force)?;
        let make = || builder(true).tempdir_in(folder_of(&path));
        let (temporary, _listed) =
            Listed::create(make, |t| t.path().to_owned()).map_err(|e| cannot_create(&path, e))?;
        fs::write(temporary.path().join(DIRECTORY_MARK), "")
            .map_err(|e| Error::io("write", &path, e))?;
        Ok(Self { path, temporary, force, _listed })
    }

    /// Where to write the files until then.
    pub fn path(&self) -> &Path {
        self.temporary.path()
    }

    /// Writes one file of the directory; `name` may contain folders.
    ///
    /// # Errors
    /// What the operating system refuses.
    pub fn write(&self, name: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
        // A folder must not come back after `remove_unfinished`.
        let _writing = UNFINISHED.read().unwrap_or_else(PoisonError::into_inner);
        let place = self.path().join(&name);
        let shown = self.path.join(&name);
        if let Some(folder) = place.parent() {
            fs::create_dir_all(folder)
                .map_err(|e| Error::io("create the folder of", &shown, e))?;
        }
        fs::write(&place, bytes).map_err(|e| Error::io("write", &shown, e))
    }

    /// Puts the complete directory in its place.
    ///
    /// # Errors
    /// A directory that another program has filled meanwhile, and what the operating system
    /// refuses.
    pub fn finish(self) -> Result<()> {
        check_replaceable(&self.path, self.force)?;
        let failed = |e| Error::io("write", &self.path, e);
        // Renaming over an empty directory works and is atomic; one with content is moved aside.
        let aside = builder(true).tempdir_in(folder_of(&self.path)).map_err(failed)?;
        let old = aside.path().join("old");
        if is_occupied(&self.path) {
            fs::rename(&self.path, &old).map_err(failed)?;
        }
        if let Err(e) = fs::rename(self.temporary.path(), &self.path) {
            if old.exists() {
                fs::rename(&old, &self.path).map_err(failed)?;
            }
            return Err(failed(e));
        }
        // Renamed away: there is nothing left to remove under the temporary name.
        let _ = self.temporary.keep();
        Ok(())
    }
}

fn is_occupied(path: &Path) -> bool {
    fs::read_dir(path).is_ok_and(|mut entries| entries.next().is_some())
}

fn check_replaceable(path: &Path, force: bool) -> Result<()> {
    match fs::metadata(path) {
        Ok(meta) if !meta.is_dir() => {
            Err(Error::input(format!("{} is not a directory", path.display()))
                .help("give another name, or remove it first"))
        }
        Ok(_) if !is_occupied(path) => Ok(()),
        Ok(_) if !force => Err(exists(path)),
        Ok(_) if !path.join(DIRECTORY_MARK).exists() => {
            Err(Error::unsupported(format!("{} was not written by camrig", path.display())).help(
                "only directories that camrig wrote are replaced; remove it yourself or give \
                 another name",
            ))
        }
        _ => Ok(()),
    }
}

/// Temporary files with the permissions that any new file would get.
fn builder(directory: bool) -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PREFIX).suffix(SUFFIX);
    if let Some(permissions) = platform::default_permissions(directory) {
        builder.permissions(permissions);
    }
    builder
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

fn exists(path: &Path) -> Error {
    Error::input(format!("{} exists", path.display()))
        .help("give another name, or ask to replace it")
        .with_code(ErrorCode::OutputExists)
}

fn cannot_create(path: &Path, error: io::Error) -> Error {
    let help = match error.kind() {
        io::ErrorKind::NotFound => "the folder does not exist; create it first",
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "the folder cannot be written to; choose another"
        }
        _ => "check the folder and the space left on its disk",
    };
    // tempfile's errors name the temporary file, which means nothing to the caller.
    let own =
        error.get_ref().and_then(|e| e.source()?.downcast_ref::<io::Error>()?.raw_os_error());
    Error::io("create", path, own.map_or(error, io::Error::from_raw_os_error)).help(help)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_appears_only_when_finished() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.npy");
        let mut output = OutputFile::create(&path, false).unwrap();
        output.write_all(b"half").unwrap();
        output.flush().unwrap();
        assert!(!path.exists());
        let names = || fs::read_dir(dir.path()).unwrap().count();
        if platform::create_nameless(dir.path()).is_ok() {
            assert_eq!(names(), 0, "a kill now would leave nothing behind");
        }
        drop(output);
        assert_eq!(names(), 0, "nothing is left behind");
        write_file(&path, false, b"whole").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
    }

    #[test]
    fn an_existing_file_is_replaced_only_by_force() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        write_file(&path, false, b"first").unwrap();
        let error = write_file(&path, false, b"second").unwrap_err().to_string();
        assert!(error.contains("exists") && error.contains("replace it"), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"first");
        write_file(&path, true, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        // Made by someone else between opening and finishing.
        let race = dir.path().join("race");
        let output = OutputFile::create(&race, false).unwrap();
        fs::write(&race, b"theirs").unwrap();
        assert!(output.finish().is_err());
        assert_eq!(fs::read(&race).unwrap(), b"theirs");
    }

    #[test]
    fn a_missing_folder_and_a_directory_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let error = write_file(&dir.path().join("no/a"), false, b"").unwrap_err().to_string();
        assert!(error.contains("folder does not exist"), "{error}");
        let error = write_file(dir.path(), true, b"").unwrap_err().to_string();
        assert!(error.contains("is a directory"), "{error}");
    }

    #[test]
    fn directories_are_replaced_whole_and_only_our_own() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("set");
        let fill = |force, text: &str| -> Result<()> {
            let output = OutputDir::create(&path, force)?;
            output.write("sub/a.txt", text.as_bytes())?;
            output.finish()
        };
        fs::create_dir(&path).unwrap();
        fill(false, "1").unwrap();
        assert!(fill(false, "2").is_err());
        assert_eq!(fs::read_to_string(path.join("sub/a.txt")).unwrap(), "1");
        fill(true, "2").unwrap();
        assert_eq!(fs::read_to_string(path.join("sub/a.txt")).unwrap(), "2");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "no temporary directory left");
        fs::remove_file(path.join(DIRECTORY_MARK)).unwrap();
        let error = fill(true, "3").unwrap_err().to_string();
        assert!(error.contains("was not written by camrig"), "{error}");
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_is_an_error() {
        let error = write_file(Path::new("/dev/full"), false, b"x").unwrap_err().to_string();
        assert!(error.contains("No space left on device"), "{error}");
    }
}
