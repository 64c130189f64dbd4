//! Moments of a stack of frames: per pixel over time, and over the pixels of a channel.
//!
//! Frames are read once, strip by strip (`strips`). For each pixel, the samples and their squares
//! are summed as integers, so that the moments do not depend on batches or threads. Frames stored
//! uncompressed need only the memory of the current strips, independent of the length of the stack.

use super::codes::BitsSeen;
use super::cut_off::CutOff;
use super::moments::Moments;
use super::site::Site;
use super::sums::Sums;
use camrig_base::{Error, Result};
use camrig_captures::{Batches, Capture, CaptureSet, Role};

/// Moments of a stack of frames and, on request, its mean frame.
#[derive(Clone, Debug)]
pub struct Stack {
    /// Width of the frames, pixels.
    pub width: usize,
    /// Height of the frames, pixels.
    pub height: usize,
    /// Number of frames.
    pub frames: usize,
    /// Positions of the colour filter pattern.
    pub sites: Vec<Site>,
    /// Sum of the samples of each pixel, DN; empty where only moments were read.
    pub sum: Vec<u32>,
    /// Mean of each frame, DN, per site.
    pub frame_means: Vec<Vec<f64>>,
    /// Moments of each site.
    pub moments: Vec<Moments>,
    /// Bits in which the samples vary.
    pub seen: BitsSeen,
    /// Whether the samples of a dark are cut off, and where.
    pub cut_off: Option<CutOff>,
    /// For each frame, a hash of its sums, equal for copies.
    pub(super) marks: Vec<u64>,
}

impl Stack {
    /// Reads all frames of `capture`, and keeps the sums of the pixels' samples.
    ///
    /// # Errors
    /// Those of [`CaptureSet::for_each_batch`], and frames smaller than the filter pattern.
    pub fn read(set: &CaptureSet, capture: &Capture) -> Result<Self> {
        Self::stream(set, capture, true)
    }

    /// Reads all frames of `capture` for their moments alone.
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
            return Err(Error::limit(format!("frames of {width} x {height} are too small")).help(
                "measuring needs at least two periods of the filter pattern in each direction",
            ));
        }
        let place = |e: Error| e.at(format!("capture {:?}", capture.id));
        let mut batches = Batches::new(&set.sensor, capture);
        let sites = Site::all(&cfa);
        let mut sums = Sums::new(width, height, sites.clone(), set.sensor.white_level_dn);
        let mut cut_off = None;
        while !batches.is_empty() {
            let frames = batches.next_batch().map_err(place)?;
            if capture.role == Role::Dark && sums.frames == 0 {
                cut_off = CutOff::of(&frames[0], cfa.height).map_err(place)?;
            }
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
            seen: sums.seen,
            cut_off,
            marks: std::mem::take(&mut sums.marks),
            sum: if keep { sums.into_pixel_sums() } else { Vec::new() },
        })
    }

    /// Mean over the frames of a pixel, DN.
    pub fn mean_at(&self, x: usize, y: usize) -> f64 {
        f64::from(self.sum[y * self.width + x]) / self.frames as f64
    }

    /// Moments of a channel: those of its sites, pooled (see [`Moments::pool`]).
    pub fn channel_moments(&self, channel: usize) -> Moments {
        let of: Vec<Moments> = (0..self.sites.len())
            .filter(|&i| self.sites[i].channel == channel)
            .map(|i| self.moments[i])
            .collect();
        Moments::pool(&of)
    }
}
