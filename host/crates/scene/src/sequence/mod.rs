//! Scenes that change with time: frames of a scene with their time stamps.
//!
//! A [`SceneSequence`] gives [`SceneFrame`]s in order of time, each with the scene that is to be
//! seen from its time stamp on. [`Playback`] says which of them is shown at a time, [`Timeline`]
//! which the rows of a sensor see during an exposure, and how much of each.

pub mod between;
pub mod playback;
mod rounds;
pub mod timeline;

pub use between::Between;
pub use playback::{Moment, Playback};
pub use rounds::{Counts, Rounds};
pub use timeline::Timeline;

use super::cube::Cube;
use camrig_base::{Error, Result};
use camrig_light::LightLevel;

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

/// What a stream says that is asked to go back.
pub fn no_rewind(name: &str) -> Error {
    Error::unsupported(format!("{name} over and over"))
        .help("a stream goes by once; keep it in a file, or let its writer repeat it")
}
