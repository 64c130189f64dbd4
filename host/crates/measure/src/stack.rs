//! Moments of a stack of frames: per pixel over time, and over the pixels of a channel.
//!
//! Frames are streamed once, strip of rows by strip (`strips`). Per pixel, integer sums of the
//! samples and of their squares are taken, so the moments do not depend on batches or threads.
//! Frames whose samples lie in their files as they are need the memory of the strips being worked
//! on, whatever the length of the stack.

use super::moments::Moments;
use super::site::Site;
use super::sums::Sums;
use camrig_base::{Error, Result};
use camrig_captures::{Batches, Capture, CaptureSet};

/// A stack of frames: its moments and, where asked for, its mean frame.
#[derive(Clone, Debug)]
pub struct Stack {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Number of frames.
    pub frames: usize,
    /// Positions of the colour filter pattern.
    pub sites: Vec<Site>,
    /// Per pixel, sum of the samples; empty where only moments were asked for.
    pub sum: Vec<u32>,
    /// Per site, mean of each frame.
    pub frame_means: Vec<Vec<f64>>,
    /// Per site.
    pub moments: Vec<Moments>,
}

impl Stack {
    /// Streams all frames of `capture`, and keeps the sum of its samples per pixel.
    ///
    /// # Errors
    /// What [`CaptureSet::for_each_batch`] refuses, and a frame smaller than the filter pattern.
    pub fn read(set: &CaptureSet, capture: &Capture) -> Result<Self> {
        Self::stream(set, capture, true)
    }

    /// Streams all frames of `capture` for the moments alone.
    ///
    /// # Errors
    /// Those of [`Stack::read`].
    pub fn read_moments(set: &CaptureSet, capture: &Capture) -> Result<Self> {
        Self::stream(set, capture, false)
    }

    fn stream(set: &CaptureSet, capture: &Capture, keep: bool) -> Result<Self> {
        let (width, height) = (set.sensor.width, set.sensor.height);
        let cfa = set.cfa();
        if width < 2 * cfa.width || height < 2 * cfa.height {
            return Err(Error::limit(format!("frames of {width} x {height} are too small"))
                .help("measuring needs at least two periods of the filter pattern each way"));
        }
        let place = |e: Error| e.at(format!("capture {:?}", capture.id));
        let mut batches = Batches::new(&set.sensor, capture);
        let sites = Site::all(&cfa);
        let mut sums = Sums::new(width, height, sites.clone(), set.sensor.white_level_dn);
        while !batches.is_empty() {
            let frames = batches.next_batch().map_err(place)?;
            let whole = batches.is_empty() && sums.frames == 0;
            sums.add(&frames, &set.sensor, keep || !whole, whole).map_err(place)?;
        }
        let moments = sums.moments();
        Ok(Self {
            width,
            height,
            frames: sums.frames,
            frame_means: sums.frame_means(),
            moments,
            sites,
            sum: if keep { sums.into_pixel_sums() } else { Vec::new() },
        })
    }

    /// Mean over the frames at a pixel, DN.
    pub fn mean_at(&self, x: usize, y: usize) -> f64 {
        f64::from(self.sum[y * self.width + x]) / self.frames as f64
    }

    /// Moments of every site of a channel, taken together (see [`Moments::pool`]).
    pub fn channel_moments(&self, channel: usize) -> Moments {
        let of: Vec<Moments> = (0..self.sites.len())
            .filter(|&i| self.sites[i].channel == channel)
            .map(|i| self.moments[i])
            .collect();
        Moments::pool(&of)
    }
}
