//! What operating systems do differently. Pseudo-terminals of the rig's emulator apart, nothing
//! else in camrig names an operating system.

use std::fs::{File, Permissions};
use std::io;
use std::path::Path;

/// Fills `bytes` from `offset` of a file on, without moving where others read.
///
/// # Errors
/// A file that ends before, and what the operating system refuses.
#[cfg(unix)]
pub fn read_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

/// Fills `bytes` from `offset` of a file on. Moves the file's position, which nothing here relies
/// on.
///
/// # Errors
/// A file that ends before, and what the operating system refuses.
#[cfg(windows)]
pub fn read_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        let n = std::os::windows::fs::FileExt::seek_read(file, bytes, offset)?;
        if n == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        bytes = &mut bytes[n..];
        offset += n as u64;
    }
    Ok(())
}

/// Bytes that a widened pipe holds: a frame of 640 x 480 in 16 bits, and what an unprivileged
/// process may ask of Linux (`/proc/sys/fs/pipe-max-size`).
#[cfg(target_os = "linux")]
const PIPE_BYTES: usize = 1 << 20;

/// Lets a pipe hold whole frames, so that writer and reader change turns less often. Anything else
/// than a pipe, and a system that does not allow it, stays as it is.
#[cfg(target_os = "linux")]
pub(crate) fn widen_pipe(file: &impl std::os::fd::AsFd) {
    let _ = rustix::pipe::fcntl_setpipe_size(file, PIPE_BYTES);
}

/// Lets a pipe hold whole frames; nothing to be done on this system.
#[cfg(not(target_os = "linux"))]
pub(crate) fn widen_pipe<T>(_file: &T) {}

/// The permissions of any new file or directory, less the user's mask; `None` where the operating
/// system has no such thing.
pub(crate) fn default_permissions(directory: bool) -> Option<Permissions> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        Some(Permissions::from_mode(if directory { 0o777 } else { 0o666 }))
    }
    #[cfg(not(unix))]
    {
        let _ = directory;
        None
    }
}

/// Opens a new file without a name for writing (`O_TMPFILE`): it is gone when it is closed, or its
/// process killed, unless [`give_name`] was called.
///
/// # Errors
/// File systems and operating systems without such files.
pub(crate) fn create_nameless(folder: &Path) -> io::Result<File> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{Mode, OFlags, open};
        let mode = Mode::from_raw_mode(0o666); // less the user's mask
        let file = open(folder, OFlags::TMPFILE | OFlags::WRONLY | OFlags::CLOEXEC, mode)?;
        Ok(file.into())
    }
    #[cfg(not(target_os = "linux"))]
    {
        let _ = folder;
        Err(io::ErrorKind::Unsupported.into())
    }
}

/// Gives a file of [`create_nameless`] a name.
///
/// # Errors
/// A name that is taken, and what the operating system refuses.
pub(crate) fn give_name(file: &File, path: &Path) -> io::Result<()> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{AtFlags, CWD, linkat};
        use std::os::fd::AsRawFd;
        let open_file = format!("/proc/self/fd/{}", file.as_raw_fd());
        Ok(linkat(CWD, open_file, CWD, path, AtFlags::SYMLINK_FOLLOW)?)
    }
    #[cfg(not(target_os = "linux"))]
    {
        let _ = (file, path);
        Err(io::ErrorKind::Unsupported.into())
    }
}
