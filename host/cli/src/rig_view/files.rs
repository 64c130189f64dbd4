//! Saved frames and recordings.

use super::super::rig_stream::output::Output;
use crate::view::Frame;
use camrig_base::output::write_file;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_formats::{Facts, Format, Frames};
use camrig_render as render;
use std::path::{Path, PathBuf};

/// Maximum number of names tried for a file.
const MAX_NAMES: u32 = 10_000;

/// Writes a frame as a DNG, as `camrig simulate` does, under an unused name.
///
/// # Errors
/// A folder that is not writable.
pub fn save(frame: &Frame, camera: &Camera, folder: &Path) -> Result<PathBuf> {
    let light = &frame.light;
    let info = render::frame_info(
        camera,
        &frame.settings,
        light.illuminant.as_ref(),
        &light.header,
        false,
    )?;
    let facts = Facts { dng: Some(info), ..Facts::of(&frame.raw) };
    let bytes = Format::Dng.encode(&Frames { facts, ..Frames::from_raw(&frame.raw) })?;
    let path = free(folder, &format!("{}-{:06}", stem(camera), frame.number), "dng")?;
    write_file(&path, false, &bytes)?;
    Ok(path)
}

/// Starts a recording under an unused name.
///
/// # Errors
/// A folder that is not writable, and those of [`Output::recording`].
pub fn record(camera: &Camera, folder: &Path, format: &str, fps: f64) -> Result<Output> {
    let path = free(folder, &format!("{}-recording", stem(camera)), format)?;
    Output::recording(path, fps, camera)
}

/// A camera's name as part of a file name.
fn stem(camera: &Camera) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
    camera.name.chars().map(plain).collect()
}

/// An unused file name in a folder.
fn free(folder: &Path, stem: &str, extension: &str) -> Result<PathBuf> {
    let numbered = (2..MAX_NAMES).map(|n| format!("{stem}-{n}.{extension}"));
    let mut names = std::iter::once(format!("{stem}.{extension}")).chain(numbered);
    let name = names.find(|name| !folder.join(name).exists());
    let full = || {
        Error::limit(format!("there are {MAX_NAMES} files {stem}"))
            .at(folder.display())
            .help("move them elsewhere")
    };
    Ok(folder.join(name.ok_or_else(full)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_one_that_no_file_has() {
        let folder = tempfile::tempdir().unwrap();
        let next = || {
            let path = free(folder.path(), "a-000001", "dng").unwrap();
            write_file(&path, false, b"x").unwrap();
            path.file_name().unwrap().to_string_lossy().into_owned()
        };
        assert_eq!([next(), next(), next()], ["a-000001.dng", "a-000001-2.dng", "a-000001-3.dng"]);
    }
}
