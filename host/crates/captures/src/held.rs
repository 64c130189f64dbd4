//! Frames that are in memory, as another program hands them over.

use camrig_base::{Error, Result};
use std::fmt;
use std::sync::Arc;

/// Samples of frames, one after the other, row by row, DN.
pub(crate) type Shared = Arc<dyn AsRef<[u16]> + Send + Sync>;

/// Frames of a capture that are not in files. The samples are shared, not copied.
///
/// ```
/// use camrig_captures::{Capture, Held, Role};
///
/// let frames = Held::new(3, 2, vec![64u16; 4 * 3 * 2])?;
/// assert_eq!(frames.count(), 4);
/// let dark = Capture { held: Some(frames), ..Capture::new("dark", Role::Dark, vec![], 0.01) };
/// assert!(dark.files.is_empty());
/// # Ok::<(), camrig_captures::base::Error>(())
/// ```
#[derive(Clone)]
pub struct Held {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) samples: Shared,
}

impl Held {
    /// Frames of `width` columns and `height` rows.
    ///
    /// # Errors
    /// Samples that are not a whole number of frames, one at least.
    pub fn new(
        width: usize,
        height: usize,
        samples: impl AsRef<[u16]> + Send + Sync + 'static,
    ) -> Result<Self> {
        let count = samples.as_ref().len();
        match width.checked_mul(height) {
            Some(pixels) if pixels > 0 && count > 0 && count % pixels == 0 => {
                Ok(Self { width, height, samples: Arc::new(samples) })
            }
            _ => Err(Error::input(format!("{count} samples in frames of {width} x {height}"))
                .help("give whole frames, one at least")),
        }
    }

    /// The samples, frame after frame.
    #[must_use]
    pub fn samples(&self) -> &[u16] {
        (*self.samples).as_ref()
    }

    /// Number of frames.
    #[must_use]
    pub fn count(&self) -> usize {
        self.samples().len() / (self.width * self.height)
    }
}

impl fmt::Debug for Held {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} frames of {} x {}", self.count(), self.width, self.height)
    }
}

/// Whether the samples are the same ones.
impl PartialEq for Held {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.samples, &other.samples)
    }
}
