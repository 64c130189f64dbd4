//! Correlation of temporal noise between neighbouring pixels.
//!
//! Shot noise is independent from pixel to pixel. Charge that couples into neighbours after it was
//! collected makes their noise alike: a share α to each of four neighbours leaves a correlation of
//! 2α (first order) at lag 1, and lowers the variance, so that photon transfer finds K too small by
//! about 8α (Moore et al., *Interpixel capacitance in nondestructive detectors*, 2004).

use super::stack::Site;
use super::value::Value;
use crate::captures::{Capture, CaptureSet};
use crate::{Error, Plane, Result};
use rayon::prelude::*;
use serde::Serialize;

/// Neighbours looked at: columns right, rows down.
pub const LAGS: [(usize, usize); 4] = [(1, 0), (0, 1), (1, 1), (2, 0)];

/// Correlation of the temporal noise of pixels and their neighbours at each of [`LAGS`].
#[derive(Clone, Debug, Serialize)]
pub struct NoiseCorrelation {
    /// (columns right, rows down) and the coefficient.
    pub lags: Vec<((usize, usize), Value)>,
}

impl NoiseCorrelation {
    /// From the differences of successive, disjoint pairs of frames, their means taken out per
    /// site of the colour filter pattern.
    ///
    /// # Errors
    /// Fewer than two frames.
    pub fn of(set: &CaptureSet, capture: &Capture) -> Result<Self> {
        let sites = Site::all(&set.cfa());
        let mut sums = vec![[0.0f64; 3]; LAGS.len()];
        let mut earlier: Option<Plane<u16>> = None;
        let mut pairs = 0usize;
        set.for_each_batch(capture, |batch| {
            for frame in batch {
                match earlier.take() {
                    None => earlier = Some(frame.clone()),
                    Some(before) => {
                        add_pair(&before, frame, &sites, &mut sums);
                        pairs += 1;
                    }
                }
            }
            Ok(())
        })?;
        if pairs == 0 {
            return Err(Error::input("one frame has no temporal noise to correlate")
                .at(format!("capture {:?}", capture.id)));
        }
        let (width, height) = (set.sensor.width, set.sensor.height);
        let lags = LAGS.iter().zip(&sums).map(|(&(dx, dy), [ab, aa, bb])| {
            let count = (pairs * (width - dx) * (height - dy)) as f64;
            let scale = (aa * bb).sqrt();
            let rho = if scale > 0.0 { ab / scale } else { 0.0 };
            ((dx, dy), Value::new(rho, 1.0 / count.sqrt()))
        });
        Ok(Self { lags: lags.collect() })
    }

    /// The coefficient at a lag of [`LAGS`].
    pub fn at(&self, lag: (usize, usize)) -> Option<Value> {
        self.lags.iter().find(|l| l.0 == lag).map(|l| l.1)
    }
}

fn add_pair(a: &Plane<u16>, b: &Plane<u16>, sites: &[Site], sums: &mut [[f64; 3]]) {
    let (width, height) = (a.width, a.height);
    let (step_x, step_y) = (sites[0].step_x, sites[0].step_y);
    let difference = |at: usize| f64::from(b.data[at]) - f64::from(a.data[at]);
    let means: Vec<f64> = sites
        .iter()
        .map(|s| {
            let rows = (s.y0..height).step_by(s.step_y);
            let sum: f64 = rows
                .flat_map(|y| (s.x0..width).step_by(s.step_x).map(move |x| y * width + x))
                .map(difference)
                .sum();
            sum / (s.rows(height) * s.columns(width)) as f64
        })
        .collect();
    let centred: Vec<f64> = (0..width * height)
        .into_par_iter()
        .map(|at| {
            let (x, y) = (at % width, at / width);
            difference(at) - means[(y % step_y) * step_x + x % step_x]
        })
        .collect();
    for (sum, (dx, dy)) in sums.iter_mut().zip(LAGS) {
        let rows: Vec<[f64; 3]> = (0..height - dy)
            .into_par_iter()
            .map(|y| {
                let (p, q) = (&centred[y * width..], &centred[(y + dy) * width + dx..]);
                let mut row = [0.0; 3];
                for (p, q) in p.iter().zip(q).take(width - dx) {
                    row[0] += p * q;
                    row[1] += p * p;
                    row[2] += q * q;
                }
                row
            })
            .collect();
        for row in rows {
            for (s, r) in sum.iter_mut().zip(row) {
                *s += r;
            }
        }
    }
}
