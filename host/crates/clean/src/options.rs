//! Options of an inspection.

use std::fmt;

/// Options of [`Cleaned::new`](crate::Cleaned::new) and
/// [`Cleaned::inspect`](crate::Cleaned::inspect).
#[derive(Clone, Copy, Default)]
#[non_exhaustive]
pub struct Options<'a> {
    /// Called with the number of frames just read. Each frame is read several times.
    pub progress: Option<&'a (dyn Fn(usize) + Sync)>,
}

impl<'a> Options<'a> {
    /// The same with a callback for progress.
    #[must_use]
    pub fn with_progress(self, progress: &'a (dyn Fn(usize) + Sync)) -> Self {
        Self { progress: Some(progress) }
    }

    /// Reports that so many frames were read.
    pub(crate) fn report(&self, frames: usize) {
        if let Some(progress) = self.progress {
            progress(frames);
        }
    }
}

impl fmt::Debug for Options<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Options").field("progress", &self.progress.is_some()).finish()
    }
}
