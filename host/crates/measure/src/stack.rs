//! Moments of a stack of frames: per pixel over time, and over the pixels of a channel.
//!
//! Frames are read once, strip by strip (`strips`). For each pixel, the samples and their squares
//! are summed as integers, so that the moments do not depend on batches or threads. Frames stored
//! uncompressed need only the memory of the current strips, independent of the length of the stack.

use super::codes::CodeCounts;
use super::cut_off::{CutOff, some_rows};
use super::moments::Moments;
use super::site::Site;
use super::sums::Sums;
use camrig_base::{Cfa, Error, RawFrame, Result};
use camrig_captures::{Batches, Capture, CaptureSet, Role, SensorFacts, StoredFrame};
use std::path::Path;
use std::sync::Arc;

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
    /// Codes of rows of the first frame.
    pub codes: CodeCounts,
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

    /// The moments of frames in memory, all of one size and pattern.
    ///
    /// # Errors
    /// No frame, frames smaller than two periods of the pattern or of different sizes.
    pub fn of_frames(frames: &[RawFrame]) -> Result<Self> {
        let first = frames.first().ok_or_else(|| Error::input("no frames"))?;
        let size = |f: &RawFrame| (f.width, f.height);
        if frames.iter().any(|f| size(f) != size(first)) {
            return Err(Error::disagreement("frames of different sizes"));
        }
        let sensor = SensorFacts {
            width: first.width,
            height: first.height,
            bits: first.bits,
            cfa: Some(first.cfa.clone()),
            black_level_dn: Some(first.black_level_dn),
            white_level_dn: first.white_level_dn,
            pitch_um: None,
            window: None,
        };
        let place: Arc<Path> = Path::new("frames in memory").into();
        let stored: Vec<StoredFrame> =
            frames.iter().map(|f| StoredFrame::new(f.plane(), place.clone())).collect();
        let mut sums = Self::sums(&sensor, &first.cfa)?;
        sums.add(&stored, &sensor, false, true)?;
        let codes = CodeCounts::of(&first.data, first.white_level_dn);
        Ok(Self::of_sums(sums, &first.cfa, (codes, None), false))
    }

    /// Empty sums over the frames of a sensor.
    fn sums(sensor: &SensorFacts, cfa: &Cfa) -> Result<Sums> {
        let (width, height) = (sensor.width, sensor.height);
        if width < 2 * cfa.width || height < 2 * cfa.height {
            return Err(Error::limit(format!("frames of {width} x {height} are too small")).help(
                "measuring needs at least two periods of the filter pattern in each direction",
            ));
        }
        Ok(Sums::new(width, height, Site::all(cfa), sensor.white_level_dn))
    }

    fn of_sums(
        mut sums: Sums,
        cfa: &Cfa,
        (codes, cut_off): (CodeCounts, Option<CutOff>),
        keep: bool,
    ) -> Self {
        let [width, height] = sums.size();
        Self {
            width,
            height,
            frames: sums.frames,
            frame_means: sums.frame_means(),
            moments: sums.moments(),
            sites: Site::all(cfa),
            codes,
            cut_off,
            marks: std::mem::take(&mut sums.marks),
            sum: if keep { sums.into_pixel_sums() } else { Vec::new() },
        }
    }

    fn stream(set: &CaptureSet, capture: &Capture, keep: bool) -> Result<Self> {
        let cfa = set.cfa();
        let place = |e: Error| e.at(format!("capture {:?}", capture.id));
        let mut batches = Batches::new(&set.sensor, capture);
        let mut sums = Self::sums(&set.sensor, &cfa)?;
        let (mut codes, mut cut_off) = (CodeCounts::default(), None);
        while !batches.is_empty() {
            let frames = batches.next_batch().map_err(place)?;
            if sums.frames == 0 {
                let rows = some_rows(&frames[0], cfa.height).map_err(place)?;
                codes = CodeCounts::of(&rows, set.sensor.white_level_dn);
                cut_off =
                    Some(&rows).filter(|_| capture.role == Role::Dark).and_then(|r| CutOff::of(r));
            }
            let whole = batches.is_empty() && sums.frames == 0;
            sums.add(&frames, &set.sensor, keep || !whole, whole).map_err(place)?;
        }
        Ok(Self::of_sums(sums, &cfa, (codes, cut_off), keep))
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
