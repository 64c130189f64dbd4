//! Sequences of scenes in files and streams.
//!
//! [`open`] finds them: a folder of pictures or cubes ([`folder`]), one that is still being written
//! ([`watch`]), video as YUV4MPEG2 from a file or a pipe ([`y4m`]), and frames that another program
//! makes while they are taken ([`frames`]).

pub mod folder;
pub mod frames;
mod header;
mod pipe;
mod socket;
pub mod watch;
pub mod y4m;
mod ycbcr;

use camrig_base::{Error, Result};
use camrig_scene::sequence::{FrameLight, SceneFrame, SceneSequence};
use std::io::{Cursor, Read};
use std::path::Path;
use std::time::Duration;

/// Longest silence of a stream unless another is asked for.
const STALL: Duration = Duration::from_secs(5);

/// How a sequence is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Its frames per second, where they are not its own.
    pub rate_hz: Option<f64>,
    /// A folder is still being written: how long to wait for its next frame.
    pub watch: Option<Duration>,
    /// Longest silence of a stream between the bytes of its frames.
    pub stall: Duration,
}

impl Default for Reading {
    fn default() -> Self {
        Self { rate_hz: None, watch: None, stall: STALL }
    }
}

/// Whether `spec` names a sequence, and not a single scene. Nothing of a stream is
/// read for it.
///
/// # Errors
/// A folder that may be a cube or a sequence; a folder to be watched that is none.
pub fn is_sequence(spec: &str, reading: &Reading) -> Result<bool> {
    let (path, options) = super::file_and_options(spec);
    if reading.watch.is_some() && !path.is_dir() {
        return Err(Error::input(format!("{spec:?} is no folder to be watched"))
            .help("only a folder of pictures or cubes is read while it is written"));
    }
    if is_stream(spec) || !path.is_dir() {
        return Ok(is_stream(spec) || is_video(path));
    }
    Ok(reading.watch.is_some() || folder::kind(path, options)? == folder::Kind::Sequence)
}

/// Whether `spec` names video or a stream, whose frames have no names of their own.
#[must_use]
pub fn passes_by(spec: &str) -> bool {
    is_stream(spec) || is_video(super::file_and_options(spec).0)
}

/// Opens what `spec` names as a sequence; none where that is a single scene.
///
/// # Errors
/// Those of [`is_sequence`]; a stream that is none, or comes too late.
pub fn open(spec: &str, reading: &Reading) -> Result<Option<Box<dyn SceneSequence>>> {
    if !is_sequence(spec, reading)? {
        return Ok(None);
    }
    if is_stream(spec) {
        return stream(spec, reading).map(Some);
    }
    let (path, options) = super::file_and_options(spec);
    if !path.is_dir() {
        let video = y4m::Video::of_file(path, options, reading);
        return Ok(Some(Box::new(video.map_err(|e| e.at(path.display()))?)));
    }
    Ok(Some(match reading.watch {
        Some(wait) => Box::new(watch::Watched::open(path, options, reading.rate_hz, wait)?),
        None => Box::new(folder::Folder::open(path, options, reading.rate_hz)?),
    }))
}

/// Whether a file's name is that of video.
pub(super) fn is_video(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("y4m"))
}

/// Opens a stream, which says by its first bytes what it is.
fn stream(spec: &str, reading: &Reading) -> Result<Box<dyn SceneSequence>> {
    let (name, options, mut pipe) = match socket::is_socket(spec) {
        true => (spec, "", pipe::Pipe::new(socket::connected(spec)?, reading.stall)),
        false => {
            let options = spec.strip_prefix("-:").unwrap_or("");
            ("standard input", options, pipe::Pipe::new(std::io::stdin(), reading.stall))
        }
    };
    let begin = pipe::read_up_to(&mut pipe, header::MAGIC.len() as u64)
        .map_err(|e| pipe::broken(&e).at(name))?;
    let frames = begin == header::MAGIC;
    let source: Box<dyn Read + Send> = Box::new(Cursor::new(begin).chain(pipe));
    if !frames {
        let video = y4m::Video::new(name, source, options, reading.rate_hz);
        return Ok(Box::new(video.map_err(|e| e.at(name))?));
    }
    if !options.is_empty() || reading.rate_hz.is_some() {
        return Err(Error::input("options or a frame rate of camrig-frames/1")
            .at(name)
            .help("its messages say all of it themselves; leave them out"));
    }
    Ok(Box::new(frames::Frames::new(name, source)))
}

/// Whether a scene's name is that of standard input or a socket.
pub(super) fn is_stream(spec: &str) -> bool {
    spec == "-" || spec.starts_with("-:") || socket::is_socket(spec)
}
