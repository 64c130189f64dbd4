//! A file of frames: its metadata, and the levels of its first frame.

use super::sidecar::Sidecar;
use crate::frames::open_with_facts;
use camrig_base::{Plane, Result};
use camrig_formats::Facts;
use std::path::{Path, PathBuf};

/// Number of blocks along each side of the grid of levels.
const BLOCKS: usize = 16;

/// A file of frames.
#[derive(Clone, Debug)]
pub struct FrameFile {
    /// Its name within the folder.
    pub name: PathBuf,
    /// Columns and rows.
    pub size: (usize, usize),
    /// Number of frames.
    pub frames: usize,
    /// Its metadata.
    pub facts: Facts,
    /// The metadata of its sidecar file.
    pub sidecar: Sidecar,
    /// Levels of its first frame.
    pub levels: Levels,
}

/// Levels of a frame, DN.
#[derive(Clone, Debug, PartialEq)]
pub struct Levels {
    /// Mean of all samples.
    pub mean: f64,
    /// Largest sample.
    pub largest: u16,
    /// Means over the four positions in 2 x 2 pixels.
    pub cells: [f64; 4],
    /// Means over a grid of blocks.
    pub blocks: Vec<f64>,
}

impl FrameFile {
    /// Reads the file `name` in `folder`.
    ///
    /// # Errors
    /// Files without raw frames.
    pub fn read(folder: &Path, name: &Path) -> Result<Self> {
        let path = folder.join(name);
        let (frames, facts) = open_with_facts(&path)?;
        let plane = frames[0].plane()?;
        Ok(Self {
            name: name.to_owned(),
            size: (plane.width, plane.height),
            frames: frames.len(),
            facts,
            sidecar: Sidecar::read(&path),
            levels: Levels::of(&plane),
        })
    }
}

impl Levels {
    /// The levels of a frame.
    pub fn of(plane: &Plane<u16>) -> Self {
        let mean_of = |left: usize, top: usize, columns: usize, rows: usize, step: usize| {
            let (mut sum, mut count) = (0u64, 0u64);
            for y in (top..top + rows).step_by(step) {
                for x in (left..left + columns).step_by(step) {
                    sum += u64::from(plane.at(x, y));
                    count += 1;
                }
            }
            sum as f64 / count.max(1) as f64
        };
        let (width, height) = (plane.width, plane.height);
        let cell = |i: usize| {
            let (x, y) = (i % 2, i / 2);
            mean_of(x, y, width.saturating_sub(x), height.saturating_sub(y), 2)
        };
        // Whole periods of the usual patterns in each block.
        let side = |length: usize| (length / BLOCKS / 4 * 4).max(length.min(4));
        let (columns, rows) = (side(width), side(height));
        let across = (width / columns).min(BLOCKS);
        let down = (height / rows).min(BLOCKS);
        let block = |i: usize| mean_of(i % across * columns, i / across * rows, columns, rows, 1);
        Self {
            mean: mean_of(0, 0, width, height, 1),
            largest: plane.data.iter().copied().max().unwrap_or(0),
            cells: [0, 1, 2, 3].map(cell),
            blocks: (0..across * down).map(block).collect(),
        }
    }
}
