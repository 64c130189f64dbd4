//! Reads the frames of a capture set and reduces them to moments and pictures.

use super::targets::{Picture, PictureCollector};
use super::temporal::{Collector, Temporal};
use crate::data::design::{Design, Target};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_clean::Cleaned;
use camrig_sensor_core::config::Pattern;
use rayon::prelude::*;
use std::ops::Range;

/// Most frames of a stack that are in memory at once. The frames of a batch share a mean, which
/// costs a degree of freedom.
const MAX_BATCH: usize = 32;

/// Most pixels, over all stacks of a half, for which moments are computed in parallel: this takes
/// some 60 bytes per pixel and processor.
const MAX_PARALLEL_PIXELS: usize = 1 << 22;

/// Smallest number of stacks of a design that one processor handles: 1, or all of them where frames
/// are large. `pixels` is the number of pixels of the sensor.
pub fn min_stacks_per_thread(design: &Design, pixels: usize) -> usize {
    if pixels.saturating_mul(design.conditions.len()) > MAX_PARALLEL_PIXELS {
        usize::MAX
    } else {
        1
    }
}

/// Divides a stack into batches of nearly equal size, so that none is a single frame.
pub fn batches(frames: usize) -> Vec<Range<usize>> {
    let count = frames.div_ceil(MAX_BATCH).max(1);
    let (size, more) = (frames / count, frames % count);
    let mut start = 0;
    (0..count)
        .map(|i| {
            let size = size + usize::from(i < more);
            start += size;
            start - size..start
        })
        .collect()
}

/// The picture of every target, from the set's frames. `progress` is called with the number of
/// frames just read.
///
/// # Errors
/// Files that cannot be read.
pub fn pictures(
    camera: &Camera,
    set: &Cleaned,
    targets: &[Target],
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Vec<Picture>> {
    targets
        .par_iter()
        .map(|target| {
            let stack = &target.stack;
            let (mut collector, mut seen) = (PictureCollector::new(camera, target), 0);
            set.for_each_batch(stack.capture, |frames| {
                for frame in frames {
                    if (stack.skip..stack.skip + stack.frames).contains(&seen) {
                        collector.add(frame);
                    }
                    seen += 1;
                }
                progress(frames.len());
                Ok(())
            })?;
            Ok(collector.finish())
        })
        .collect()
}

/// Moments of every dark and flat stack of a design, from the set's frames, for a sensor with this
/// colour filter pattern; with `planes` also their two-dimensional power spectrum. `progress` is
/// called with the number of frames just read.
///
/// # Errors
/// Files that cannot be read.
pub fn moments(
    set: &Cleaned,
    pattern: &Pattern,
    design: &Design,
    planes: bool,
    progress: &(dyn Fn(usize) + Sync),
) -> Result<Vec<Temporal>> {
    let s = &set.set().sensor;
    design
        .conditions
        .par_iter()
        .with_min_len(min_stacks_per_thread(design, s.width * s.height))
        .map(|c| {
            let c = &c.stack;
            let mut collector = Collector::new(s.width, s.height, design.white_level_dn, planes);
            let sizes = batches(c.frames);
            let (mut seen, mut held, mut next) = (0, Vec::new(), 0);
            set.for_each_batch(c.capture, |frames| {
                for frame in frames {
                    if seen >= c.skip && seen < c.skip + c.frames {
                        held.push(frame.clone());
                        if sizes.get(next).is_some_and(|b| b.len() == held.len()) {
                            collector.add(&held);
                            held.clear();
                            next += 1;
                        }
                    }
                    seen += 1;
                }
                progress(frames.len());
                Ok(())
            })?;
            Ok(collector.finish().without_border(pattern))
        })
        .collect()
}
