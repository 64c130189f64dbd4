//! One pass over the frames of a stack: the level of each frame and the histogram of codes.

use super::band::Band;
use camrig_base::copies::Print;
use camrig_base::{Plane, Result};
use camrig_captures::{Capture, CaptureSet, Role};
use rayon::prelude::*;

/// Number of codes of 16-bit samples.
const CODES: usize = 1 << 16;
/// Share of the samples at either end of the first frame's histogram that is ignored when its
/// width is measured, so that defective pixels do not determine it.
const TAILS: f64 = 0.01;
/// Samples are clipped to this many widths beyond these ends, so that particles do not shift a
/// frame's level; a lamp or an offset that changes by less does.
const REACH: f64 = 3.0;

/// Most pixels of the middle rows of a stack that are kept, and most frames of them: enough for a
/// variance to 0.2 %.
const MAX_SAMPLE_PIXELS: usize = 1 << 14;
const MAX_SAMPLE_FRAMES: usize = 64;

/// Summary of a dark or flat stack.
pub struct Scan {
    /// Index of the capture in its set.
    pub capture: usize,
    /// Its frames in order of time.
    pub frames: Vec<Frame>,
    /// Number of samples of each code.
    pub codes: Vec<u64>,
    /// Its middle rows, for estimates of the variance.
    pub sample: Band,
}

/// Summary of a frame.
pub struct Frame {
    /// Fingerprint shared only by copies; `None` where distinct frames may be equal.
    pub print: Option<Print>,
    /// Mean of its samples for each position in the colour filter pattern, DN, outliers clipped.
    pub levels: Vec<f64>,
}

impl Scan {
    /// Reads a stack once.
    ///
    /// # Errors
    /// Files that cannot be read.
    pub fn read(set: &CaptureSet, index: usize) -> Result<Self> {
        let cfa = set.cfa();
        let pattern = (cfa.width, cfa.height);
        let (width, height) = (set.sensor.width, set.sensor.height);
        // Whole periods of the pattern.
        let rows = (MAX_SAMPLE_PIXELS / width).clamp(cfa.height, height.max(cfa.height));
        let first = (height.saturating_sub(rows) / 2) / cfa.height * cfa.height;
        let (mut kept, mut codes) = (Vec::new(), vec![0; CODES]);
        let mut frames: Vec<Frame> = Vec::new();
        let mut bounds: Option<Vec<Bounds>> = None;
        set.for_each_batch(&set.captures[index], |planes| {
            let bounds = bounds.get_or_insert_with(|| bounds_of(&planes[0], pattern));
            frames.par_extend(planes.par_iter().map(|plane| Frame::of(plane, pattern, bounds)));
            for plane in planes {
                plane.data.iter().for_each(|&v| codes[usize::from(v)] += 1);
                if kept.len() < MAX_SAMPLE_FRAMES {
                    let rows = plane.data.chunks(width).skip(first).take(rows);
                    kept.push(rows.flatten().copied().collect::<Vec<u16>>());
                }
            }
            Ok(())
        })?;
        Ok(Self { capture: index, frames, codes, sample: Band::of(width, first, &kept) })
    }

    /// Mean level of a frame over all pixels, DN.
    pub fn level(&self, frame: usize) -> f64 {
        let levels = &self.frames[frame].levels;
        levels.iter().sum::<f64>() / levels.len() as f64
    }

    /// Mean level of all frames for each position in the colour filter pattern, DN.
    pub fn site_levels(&self) -> Vec<f64> {
        let sites = self.frames.first().map_or(0, |f| f.levels.len());
        let n = self.frames.len().max(1) as f64;
        (0..sites).map(|s| self.frames.iter().map(|f| f.levels[s]).sum::<f64>() / n).collect()
    }

    /// Mean level of all frames and pixels, DN.
    pub fn mean(&self) -> f64 {
        let levels = self.site_levels();
        levels.iter().sum::<f64>() / levels.len().max(1) as f64
    }

    /// The code below which this share of the samples lies.
    pub fn quantile(&self, share: f64) -> u16 {
        let all: u64 = self.codes.iter().sum();
        let mut left = (share * all as f64) as u64;
        let reached = |&n: &u64| match left.checked_sub(n) {
            Some(rest) => {
                left = rest;
                false
            }
            None => true,
        };
        self.codes.iter().position(reached).map_or(u16::MAX, |code| code as u16)
    }

    /// Share of samples at or above `white`.
    pub fn saturated(&self, white: u16) -> f64 {
        let all: u64 = self.codes.iter().sum();
        self.codes[usize::from(white)..].iter().sum::<u64>() as f64 / all.max(1) as f64
    }
}

impl Frame {
    fn of(plane: &Plane<u16>, (across, down): (usize, usize), bounds: &[Bounds]) -> Self {
        let mut sums = vec![0.0; across * down];
        let mut counts = vec![0usize; across * down];
        for (y, row) in plane.data.chunks(plane.width).enumerate() {
            let first = y % down * across;
            for (x, &v) in row.iter().enumerate() {
                let site = first + x % across;
                sums[site] += f64::from(v).clamp(bounds[site].low, bounds[site].high);
                counts[site] += 1;
            }
        }
        let levels = sums.iter().zip(&counts).map(|(s, &n)| s / n.max(1) as f64).collect();
        Self { print: Print::of(plane, across), levels }
    }
}

/// The range that samples are clipped to, DN.
struct Bounds {
    low: f64,
    high: f64,
}

/// The bounds for each position in the pattern.
fn bounds_of(plane: &Plane<u16>, (across, down): (usize, usize)) -> Vec<Bounds> {
    (0..across * down)
        .map(|site| {
            let rows = plane.data.chunks(plane.width).skip(site / across).step_by(down);
            let mut values: Vec<u16> =
                rows.flat_map(|r| r.iter().skip(site % across).step_by(across)).copied().collect();
            if values.is_empty() {
                return Bounds { low: 0.0, high: f64::from(u16::MAX) };
            }
            let end = (TAILS * values.len() as f64) as usize;
            let last = values.len() - 1 - end;
            let low = f64::from(*values.select_nth_unstable(end).1);
            let high = f64::from(*values.select_nth_unstable(last).1);
            let reach = REACH * (high - low + 1.0);
            Bounds { low: low - reach, high: high + reach }
        })
        .collect()
}

/// The dark and flat stacks of a set, with their index.
pub fn darks_and_flats(set: &CaptureSet) -> impl Iterator<Item = (usize, &Capture)> {
    let captures = set.captures.iter().enumerate();
    captures.filter(|(_, c)| matches!(c.role, Role::Dark | Role::Flat))
}
