//! Correlation of temporal noise between neighbouring pixels.
//!
//! Shot noise is independent from pixel to pixel. Charge that couples into neighbours after it was
//! collected makes their noise alike: a share α to each of four neighbours leaves a correlation of
//! 2α (first order) at lag 1 and lowers the variance, so that photon transfer underestimates K by
//! about 8α (Moore et al., *Interpixel capacitance in nondestructive detectors*, 2004).

use super::stack::Stack;
use super::strips;
use camrig_base::Value;
use camrig_base::{Error, Result};
use camrig_captures::{Batches, Capture, CaptureSet, StoredFrame};
use camrig_vector::vectorised;
use rayon::prelude::*;

/// Correlation coefficients of the temporal noise of pixels and their neighbours.
#[derive(Clone, Copy, Debug)]
pub struct NoiseCorrelation {
    /// With the neighbour to the right.
    pub right: Value,
    /// With the neighbour below.
    pub below: Value,
}

impl NoiseCorrelation {
    /// Computed from the differences of successive, disjoint pairs of frames of a capture whose
    /// moments are `stack`, less each frame's mean per site of the colour filter pattern. Only as
    /// many pairs are read as a standard error of `enough` needs; 0 reads all.
    ///
    /// # Errors
    /// Fewer than two frames.
    pub fn of(set: &CaptureSet, capture: &Capture, stack: &Stack, enough: f64) -> Result<Self> {
        let samples = (stack.width * stack.height) as f64;
        let mut sums = Sums::default();
        let mut pairs = 0;
        let mut batches = Batches::new(&set.sensor, capture);
        let mut waiting: Option<StoredFrame> = None;
        'frames: while !batches.is_empty() {
            for frame in batches.next_batch()? {
                let Some(before) = waiting.take() else {
                    waiting = Some(frame);
                    continue;
                };
                sums.add(&Sums::of_pair(stack, 2 * pairs, [&before, &frame])?);
                pairs += 1;
                if samples * pairs as f64 * enough * enough >= 1.0 {
                    break 'frames;
                }
            }
        }
        if pairs == 0 {
            return Err(Error::input("one frame has no temporal noise to correlate")
                .at(format!("capture {:?}", capture.id)));
        }
        let (width, height) = (stack.width as f64, stack.height as f64);
        let variance = sums.square / (width * height);
        let coefficient = |products: f64, count: f64| {
            let rho = if variance > 0.0 { products / count / variance } else { 0.0 };
            Value::new(rho, libm::pow(count * pairs as f64, -0.5))
        };
        Ok(Self {
            right: coefficient(sums.right, (width - 1.0) * height),
            below: coefficient(sums.below, width * (height - 1.0)),
        })
    }
}

/// Sums over the pixels of products of deviations, DN².
#[derive(Clone, Copy, Default)]
struct Sums {
    square: f64,
    right: f64,
    below: f64,
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.square += other.square;
        self.right += other.right;
        self.below += other.below;
    }

    /// Sums for the difference of frames `first` and `first + 1`, strip by strip; each strip
    /// includes the row below it.
    fn of_pair(stack: &Stack, first: usize, [a, b]: [&StoredFrame; 2]) -> Result<Self> {
        let (width, height) = (stack.width, stack.height);
        let (step_x, step_y) = (stack.sites[0].step_x, stack.sites[0].step_y);
        let drift: Vec<f32> = (stack.frame_means.iter())
            .map(|means| (means[first + 1] - means[first]) as f32)
            .collect();
        // Per column, for each row of the pattern.
        let drift: Vec<f32> =
            (0..step_y * width).map(|i| drift[i / width * step_x + i % width % step_x]).collect();
        let rows = strips::rows(width, step_y);
        let strips: Vec<Self> = (0..height.div_ceil(rows))
            .into_par_iter()
            .map(|strip| {
                let top = strip * rows;
                let count = rows.min(height - top);
                let with_next = (count + 1).min(height - top);
                let mut samples = vec![0; 2 * with_next * width];
                let (before, after) = samples.split_at_mut(with_next * width);
                a.read_rows(top, before)?;
                b.read_rows(top, after)?;
                let mut deviations = vec![0.0; with_next * width];
                for (y, out) in deviations.chunks_exact_mut(width).enumerate() {
                    let row = y * width..(y + 1) * width;
                    let drift = &drift[y % step_y * width..][..width];
                    deviate(&before[row.clone()], &after[row], drift, out);
                }
                let mut sums = Self::default();
                for y in 0..count {
                    let row = &deviations[y * width..][..width];
                    sums.square += dot(row, row);
                    sums.right += dot(row, &row[1..]);
                    sums.below += dot(row, &deviations[(y + 1) * width..]);
                }
                Ok(sums)
            })
            .collect::<Result<_>>()?;
        let mut sums = Self::default();
        strips.iter().for_each(|s| sums.add(s));
        Ok(sums)
    }
}

#[vectorised]
fn deviate(before: &[u16], after: &[u16], drift: &[f32], out: &mut [f32]) {
    for (((d, &a), &b), &m) in out.iter_mut().zip(before).zip(after).zip(drift) {
        *d = f32::from(b) - f32::from(a) - m;
    }
}

/// Sum of products over the common length of two slices. Sixteen partial sums in f32 lose less
/// than 1e-5 of a row's sum to rounding.
#[vectorised]
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let n = a.len().min(b.len());
    let ((a, a_rest), (b, b_rest)) = (a[..n].as_chunks::<16>(), b[..n].as_chunks::<16>());
    let mut lanes = [0.0f32; 16];
    for (a, b) in a.iter().zip(b) {
        for ((lane, a), b) in lanes.iter_mut().zip(a).zip(b) {
            *lane += a * b;
        }
    }
    let rest = a_rest.iter().zip(b_rest).map(|(a, b)| f64::from(a * b));
    lanes.iter().map(|&l| f64::from(l)).sum::<f64>() + rest.sum::<f64>()
}
