//! Scenes that change with time: frames of a scene with their time stamps.
//!
//! A [`SceneSequence`] gives [`SceneFrame`]s in order of time, each with the scene that is to be
//! seen from its time stamp on. [`open`] finds them: a folder of pictures or cubes ([`folder`]),
//! one that is still being written ([`watch`]), video as YUV4MPEG2 from a file or a pipe ([`y4m`]).
//! [`Playback`] says which of them is shown at a time.
//!
//! This is the seam to all that knows of time: what shows a scene that stands still during a
//! frame asks a playback, what integrates over an exposure takes the frames with their stamps.

pub mod folder;
mod natural;
mod pipe;
pub mod playback;
pub mod watch;
pub mod y4m;
mod ycbcr;

pub use natural::natural;
pub use playback::{Counts, Moment, Playback};

use super::cube::Cube;
use camrig_base::{Error, Result};
use std::path::Path;
use std::time::Duration;

/// One frame of a scene: what is seen from its time stamp on.
pub struct SceneFrame {
    /// Its number in the sequence, from 0 on.
    pub number: u64,
    /// Time from which it is shown, s, on the clock of the sequence. In a sequence without time
    /// stamps ([`SceneSequence::is_timed`]) the number.
    pub start_s: f64,
    /// Time from which it is shown no more, where that is known before the next frame is there.
    pub end_s: Option<f64>,
    /// What names it: a file with its options, or its number in a stream.
    pub name: String,
    open: Box<dyn FnOnce() -> Result<Cube> + Send>,
}

impl SceneFrame {
    /// A frame whose scene `open` gives: decoded only where it is shown.
    pub fn new(
        number: u64,
        (start_s, end_s): (f64, Option<f64>),
        name: String,
        open: impl FnOnce() -> Result<Cube> + Send + 'static,
    ) -> Self {
        Self { number, start_s, end_s, name, open: Box::new(open) }
    }

    /// The scene.
    ///
    /// # Errors
    /// A file or samples that are none; the error names the frame.
    pub fn open(self) -> Result<Cube> {
        (self.open)().map_err(|e| e.at(self.name))
    }
}

/// Frames of a scene in order of time.
pub trait SceneSequence: Send {
    /// What it is, for messages: a folder, or where a stream comes from.
    fn name(&self) -> &str;

    /// Whether its frames have time stamps. Without them, each frame of a sensor shows the next.
    fn is_timed(&self) -> bool;

    /// The next frame; none after the last.
    ///
    /// # Errors
    /// What cannot be read, with the number or name of the frame.
    fn next_frame(&mut self) -> Result<Option<SceneFrame>>;

    /// Goes back to the first frame.
    ///
    /// # Errors
    /// A stream, which has gone by.
    fn rewind(&mut self) -> Result<()> {
        Err(no_rewind(self.name()))
    }

    /// What was assumed or left out since it was last asked.
    fn notes(&mut self) -> Vec<String>;
}

fn no_rewind(name: &str) -> Error {
    Error::unsupported(format!("{name} over and over"))
        .help("a stream goes by once; keep it in a file, or let its writer repeat it")
}

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

/// Whether `spec` names a sequence, and not one scene that stands still. Nothing of a stream is
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
    if !path.is_dir() {
        return Ok(is_stream(spec) || is_video(path));
    }
    Ok(reading.watch.is_some() || folder::kind(path, options)? == folder::Kind::Sequence)
}

/// Opens what `spec` names as a sequence; none where that is one scene that stands still.
///
/// # Errors
/// Those of [`is_sequence`]; a stream that is none, or comes too late.
pub fn open(spec: &str, reading: &Reading) -> Result<Option<Box<dyn SceneSequence>>> {
    if !is_sequence(spec, reading)? {
        return Ok(None);
    }
    let (path, options) = super::file_and_options(spec);
    if !path.is_dir() {
        let sequence = match is_stream(spec) {
            true => y4m::Video::of_stdin(options, reading),
            false => y4m::Video::of_file(path, options, reading),
        };
        return Ok(Some(Box::new(sequence.map_err(|e| e.at(stream_name(path)))?)));
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

/// Whether a scene's name is that of standard input.
pub(super) fn is_stream(spec: &str) -> bool {
    spec == "-" || spec.starts_with("-:")
}

fn stream_name(path: &Path) -> String {
    if path == Path::new("-") { "standard input".into() } else { path.display().to_string() }
}
