//! What a diagnosis may be asked for.

use crate::candidates::CATALOGUE;
use camrig_base::{Error, Result};
use std::fmt;

/// Options of [`diagnose()`](crate::diagnose) and [`compare()`](crate::compare).
///
/// ```
/// use camrig_diagnose::{Options, Progress};
///
/// let show = |progress: Progress<'_>| {
///     if let Progress::Trying(what) = progress {
///         eprintln!("trying {what}");
///     }
/// };
/// let options = Options::default()
///     .with_region([16, 16, 128, 96])
///     .without(["full-well"])?
///     .with_progress(&show);
/// # Ok::<(), camrig_base::Error>(())
/// ```
#[derive(Clone, Default)]
#[non_exhaustive]
pub struct Options<'a> {
    /// Uses only a region of the frames: first column, first row, width, height, pixels.
    pub region: Option<[usize; 4]>,
    /// Effects left out of the catalogue, by kind.
    pub without: Vec<String>,
    /// Called with what the diagnosis is doing, by several threads at once.
    pub progress: Option<&'a (dyn Fn(Progress<'_>) + Sync)>,
}

/// What a diagnosis is doing.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Progress<'a> {
    /// So many more of the frames in `total` were checked for what is not the sensor's steady
    /// behaviour.
    Checked {
        /// Frames since the last report.
        frames: usize,
        /// Frames in all.
        total: usize,
    },
    /// So many more of the frames in `total` were measured.
    Measured {
        /// Frames since the last report.
        frames: usize,
        /// Frames in all.
        total: usize,
    },
    /// A note for people on the camera file or the captures; it is also in the report.
    Note(&'a str),
    /// The search is trying an effect of the catalogue, or is at another step that takes time.
    Trying(&'a str),
}

impl<'a> Options<'a> {
    /// The same for a region of the frames: first column, first row, width, height, pixels.
    #[must_use]
    pub fn with_region(self, region: [usize; 4]) -> Self {
        Self { region: Some(region), ..self }
    }

    /// The same with effects left out of the catalogue, by kind.
    ///
    /// # Errors
    /// A kind that the diagnosis does not know.
    pub fn without(mut self, kinds: impl IntoIterator<Item = impl Into<String>>) -> Result<Self> {
        let known = CATALOGUE.map(|entry| entry.0);
        for kind in kinds.into_iter().map(Into::into) {
            if !known.contains(&kind.as_str()) {
                return Err(Error::input(format!("no effect {kind:?} is looked for"))
                    .help(camrig_base::toml_text::did_you_mean(&kind, &known)));
            }
            self.without.push(kind);
        }
        Ok(self)
    }

    /// The same with a callback for progress.
    #[must_use]
    pub fn with_progress(self, progress: &'a (dyn Fn(Progress<'_>) + Sync)) -> Self {
        Self { progress: Some(progress), ..self }
    }

    pub(crate) fn report(&self, progress: Progress<'_>) {
        if let Some(report) = self.progress {
            report(progress);
        }
    }
}

impl fmt::Debug for Options<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { region, without, progress } = self;
        let mut s = f.debug_struct("Options");
        s.field("region", region).field("without", without);
        s.field("progress", &progress.is_some()).finish()
    }
}
