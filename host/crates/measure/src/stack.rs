//! Moments of a stack of frames: per pixel over time, and over the pixels of a channel.
//!
//! Frames are streamed once, strip of rows by strip (`strips`). Per pixel, integer sums of the
//! samples and of their squares are taken, so the moments do not depend on batches or threads.
//! Frames whose samples lie in their files as they are need the memory of the strips being worked
//! on, whatever the length of the stack.

use super::spatial::{PlaneMoments, SpatialVariance};
use super::sums::Sums;
use camrig_base::Cfa;
use camrig_base::{Error, Result};
use camrig_captures::{Batches, Capture, CaptureSet};

/// One position of the colour filter pattern: the pixels at `(x0 + i step_x, y0 + j step_y)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Site {
    /// First column.
    pub x0: usize,
    /// First row.
    pub y0: usize,
    /// Columns from one pixel to the next.
    pub step_x: usize,
    /// Rows from one pixel to the next.
    pub step_y: usize,
    /// Channel number (see [`Cfa`]).
    pub channel: usize,
}

impl Site {
    /// The sites of a pattern, row-major.
    pub fn all(cfa: &Cfa) -> Vec<Site> {
        let mut sites = Vec::with_capacity(cfa.width * cfa.height);
        for y0 in 0..cfa.height {
            for x0 in 0..cfa.width {
                let channel = cfa.channel(x0, y0);
                sites.push(Site { x0, y0, step_x: cfa.width, step_y: cfa.height, channel });
            }
        }
        sites
    }

    /// Columns of the site's plane in a frame `width` wide.
    pub fn columns(&self, width: usize) -> usize {
        (width + self.step_x - 1 - self.x0) / self.step_x
    }

    /// Rows of the site's plane in a frame `height` high.
    pub fn rows(&self, height: usize) -> usize {
        (height + self.step_y - 1 - self.y0) / self.step_y
    }
}

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
            return Err(Error::input(format!("frames of {width} x {height} are too small"))
                .help("measuring needs at least two periods of the filter pattern each way"));
        }
        let place = |e: Error| e.at(format!("capture {:?}", capture.id));
        let mut batches = Batches::new(&set.sensor, capture);
        let mut sums = Sums::new(width, height, Site::all(&cfa), set.sensor.white_level_dn);
        while !batches.is_empty() {
            let frames = batches.next_batch().map_err(place)?;
            let whole = batches.is_empty() && sums.frames == 0;
            sums.add(&frames, &set.sensor, keep || !whole, whole).map_err(place)?;
        }
        Ok(sums.finish(keep))
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

/// Temporal and spatial moments of the pixels of a site or channel, in DN and DN².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moments {
    /// The mean frame's moments over the pixels of one site (their mean over a channel's sites).
    pub plane: PlaneMoments,
    /// Sites taken together.
    pub sites: usize,
    /// Frames.
    pub frames: usize,
    /// Variance of the frames' means: temporal noise of the mean and drift of the light.
    pub drift: f64,
    /// Mean over pixels of the temporal variance, the frames' drift taken out (EMVA 1288 R4, eq.
    /// 18, for two frames: half the mean square difference less half the squared difference of the
    /// means; this is the same for any number of frames). 0 for one frame.
    pub temporal: f64,
    /// Standard error of `temporal` for Gaussian noise whose variance may differ over pixels.
    pub temporal_error: f64,
    /// Share of samples at 0 DN.
    pub zeros: f64,
    /// Share of samples at or above the white level.
    pub whites: f64,
}

impl Moments {
    /// Mean over pixels and frames, DN.
    pub fn mean(&self) -> f64 {
        self.plane.mean
    }

    /// Pixels.
    pub fn pixels(&self) -> f64 {
        self.plane.pixels() * self.sites as f64
    }

    /// Standard error of the mean from the noise of the frames: temporal noise, or the scatter of
    /// the frames' means where that is larger.
    pub fn mean_error(&self) -> f64 {
        let l = self.frames as f64;
        (self.temporal / (self.pixels() * l)).max(self.drift / l).sqrt()
    }

    /// Variance over pixels of the true pixel means: the temporal remainder taken out.
    pub fn spatial(&self) -> SpatialVariance {
        self.plane.split(self.temporal / self.frames as f64, self.sites)
    }

    /// Sites of one channel taken together: means of the sites' moments. Spatial variances are
    /// those within each site, so a difference between two greens is not non-uniformity.
    pub fn pool(sites: &[Moments]) -> Moments {
        let k = sites.len() as f64;
        let mean_of = |f: fn(&Moments) -> f64| sites.iter().map(f).sum::<f64>() / k;
        Moments {
            plane: PlaneMoments::pool(&sites.iter().map(|m| m.plane).collect::<Vec<_>>()),
            sites: sites.len(),
            frames: sites[0].frames,
            drift: mean_of(|m| m.drift),
            temporal: mean_of(|m| m.temporal),
            temporal_error: sites.iter().map(|m| m.temporal_error.powi(2)).sum::<f64>().sqrt() / k,
            zeros: mean_of(|m| m.zeros),
            whites: mean_of(|m| m.whites),
        }
    }
}
