//! Some rows of all frames of a stack, pixel by pixel, so that a pixel's time series is contiguous.

use camrig_base::Result;
use camrig_captures::{Capture, CaptureSet};
use std::ops::Range;

/// Most samples of a band: 64 MiB, and twice as much for their residuals.
const MAX_SAMPLES: usize = 1 << 25;

/// Rows of all frames of a stack: all frames of a pixel, then those of the next.
pub struct Band {
    /// Columns.
    pub width: usize,
    /// The first row.
    pub first_row: usize,
    /// Number of frames.
    pub frames: usize,
    /// Samples, DN.
    pub samples: Vec<u16>,
}

impl Band {
    /// From the rows of each frame.
    pub fn of(width: usize, first_row: usize, rows: &[Vec<u16>]) -> Self {
        let (frames, pixels) = (rows.len(), rows.first().map_or(0, Vec::len));
        let mut samples = vec![0; frames * pixels];
        for (i, frame) in rows.iter().enumerate() {
            let slots = samples.iter_mut().skip(i).step_by(frames);
            slots.zip(frame).for_each(|(s, &v)| *s = v);
        }
        Self { width, first_row, frames, samples }
    }

    /// Reads rows of a stack.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub fn read(set: &CaptureSet, capture: &Capture, rows: &Range<usize>) -> Result<Self> {
        let width = set.sensor.width;
        let mut kept = Vec::new();
        set.for_each_batch(capture, |planes| {
            kept.extend(
                planes.iter().map(|p| p.data[rows.start * width..rows.end * width].to_vec()),
            );
            Ok(())
        })?;
        Ok(Self::of(width, rows.start, &kept))
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.samples.len() / self.frames.max(1)
    }
}

/// Divides the rows of a frame into bands of whole periods of the colour filter pattern.
pub fn bands(width: usize, height: usize, frames: usize, period: usize) -> Vec<Range<usize>> {
    let most = (MAX_SAMPLES / (width * frames.max(1))).max(1);
    let rows = (most / period).max(1) * period;
    (0..height).step_by(rows).map(|y| y..(y + rows).min(height)).collect()
}
