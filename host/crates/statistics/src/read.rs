//! The frames of a capture set, reduced to moments and pictures as they are read.

use super::targets::{Picture, PictureCollector};
use super::temporal::{Collector, Temporal};
use crate::data::design::{Design, Target};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_clean::Cleaned;
use camrig_sensor_core::config::Pattern;
use rayon::prelude::*;

/// Frames of a stack that are held in memory at once, at most: batches share a mean, and each
/// costs a degree of freedom.
const BATCH: usize = 32;

/// Pixels of all stacks of a half whose moments are made side by side: while they are made they
/// take some 60 bytes per pixel, for every processor.
const SIDE_BY_SIDE: usize = 1 << 22;

/// How many stacks of a design, of a sensor of so many pixels, one processor takes after another:
/// 1, or all of them where frames are large.
pub fn in_turn(design: &Design, pixels: usize) -> usize {
    if pixels.saturating_mul(design.conditions.len()) > SIDE_BY_SIDE { usize::MAX } else { 1 }
}

/// Start and size of the batches of a stack, as equal as possible, so that none is a single frame.
pub fn batches(frames: usize) -> Vec<(usize, usize)> {
    let count = frames.div_ceil(BATCH).max(1);
    let (size, more) = (frames / count, frames % count);
    let mut start = 0;
    (0..count)
        .map(|i| {
            let size = size + usize::from(i < more);
            start += size;
            (start - size, size)
        })
        .collect()
}

/// The picture of every target, from the set's frames. `progress` hears how many were read.
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

/// Moments of every dark and flat stack of a design, from the set's frames of a sensor with this
/// colour filter pattern; with `planes` also their power over two frequencies. `progress` hears
/// how many frames were read.
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
        .with_min_len(in_turn(design, s.width * s.height))
        .map(|c| {
            let c = &c.stack;
            let mut collector = Collector::new(s.width, s.height, s.bits, planes);
            let sizes = batches(c.frames);
            let (mut seen, mut held, mut next) = (0, Vec::new(), 0);
            set.for_each_batch(c.capture, |frames| {
                for frame in frames {
                    if seen >= c.skip && seen < c.skip + c.frames {
                        held.push(frame.clone());
                        if sizes.get(next).is_some_and(|b| b.1 == held.len()) {
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
