//! Scenes that change with time: frames of a scene with their time stamps.
//!
//! A [`SceneSequence`] gives [`SceneFrame`]s in order of time, each with the scene that is to be
//! seen from its time stamp on. [`open`] finds them: a folder of pictures or cubes ([`folder`]),
//! one that is still being written ([`watch`]), video as YUV4MPEG2 from a file or a pipe ([`y4m`]),
//! and frames that another program makes while they are taken ([`frames`]).
//! [`Playback`] says which of them is shown at a time, [`Timeline`] which the rows of a sensor see
//! during an exposure, and how much of each.

pub mod between;
pub mod folder;
pub mod frames;
mod header;
mod natural;
mod pipe;
pub mod playback;
mod rounds;
mod socket;
pub mod timeline;
pub mod watch;
pub mod y4m;
mod ycbcr;

pub use between::Between;
pub use natural::natural;
pub use playback::{Moment, Playback};
pub use rounds::{Counts, Rounds};
pub use timeline::Timeline;

use super::cube::Cube;
use camrig_base::{Error, Result};
use camrig_light::LightLevel;
use std::io::{Cursor, Read};
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
    /// The light that it states itself, the same for all frames of a sequence.
    pub light: FrameLight,
    /// Whether it has nothing to do with the frame before: the light jumps.
    pub cut: bool,
    open: Box<dyn FnOnce() -> Result<Cube> + Send>,
}

/// The light that a frame states.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameLight {
    /// How much of it.
    pub level: Option<LightLevel>,
    /// The illuminant of a reflectance.
    pub illuminant: Option<String>,
}

impl SceneFrame {
    /// A frame whose scene `open` gives: decoded only where it is shown.
    pub fn new(
        number: u64,
        (start_s, end_s): (f64, Option<f64>),
        name: String,
        open: impl FnOnce() -> Result<Cube> + Send + 'static,
    ) -> Self {
        let light = FrameLight::default();
        Self { number, start_s, end_s, name, light, cut: false, open: Box::new(open) }
    }

    /// The same frame in a light that it states.
    #[must_use]
    pub fn with_light(self, light: FrameLight) -> Self {
        Self { light, ..self }
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

/// Opens what `spec` names as a sequence; none where that is one scene that stands still.
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
