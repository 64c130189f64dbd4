//! Light that a lens spreads far, on pixels as large as it is smooth.
//!
//! What lies in the wings of an OTF changes little from pixel to pixel. It is computed on a grid
//! whose pixels are several of the sensor's wide, so that it can be followed to the other end of
//! the frame, and interpolated at the sensor's pixels (Catmull-Rom, exact for quadratic
//! polynomials).

use super::fourier;
use super::sampling::{self, Layout};
use super::{Otf, SensorGrid};
use camrig_base::{Plane, Result};
use rayon::prelude::*;
use std::ops::{AddAssign, Mul};

/// Bound on the error at a sharp step that the cells under the wings of an OTF may cause, relative
/// to the step.
const WINGS_ERROR: f64 = 2e-4;
/// Sides of the larger pixels that are tried, in the sensor's pixels.
const SIDES: [usize; 4] = [16, 8, 4, 2];

/// The grid for one of the wings of an OTF.
#[derive(Clone, Copy, Debug)]
pub struct Wide {
    /// The frame, in larger pixels.
    pub grid: SensorGrid,
    /// Its padded frame.
    pub layout: Layout,
    fine: SensorGrid,
    side: usize,
}

impl Wide {
    /// The coarsest grid on which the light of `wings`, those of some bands, is right across the
    /// sensor's pixels to [`WINGS_ERROR`] of a step in the scene; it is followed for the longer
    /// side of the frame at most.
    ///
    /// # Errors
    /// When no grid keeps that.
    pub fn new(fine: &SensorGrid, wings: &[&Otf<'_>]) -> Result<Self> {
        let aperture = fine.aperture_um();
        let keeps = |side: usize| {
            let pitch = fine.pitch_um * side as f64;
            let error =
                |w: &Otf<'_>| sampling::step_error(1, pitch, aperture, w.cutoff_per_mm, &w.at);
            wings.iter().all(|w| error(w) <= WINGS_ERROR)
        };
        let side = SIDES.into_iter().find(|&side| keeps(side)).unwrap_or(1);
        let grid = SensorGrid {
            width: fine.width.div_ceil(side),
            height: fine.height.div_ceil(side),
            pitch_um: fine.pitch_um * side as f64,
            // The photosensitive square stays the sensor's.
            fill_factor: fine.fill_factor / (side * side) as f64,
        };
        let mut cells = 1;
        if side == 1 {
            for w in wings {
                let (pitch, cutoff) = (grid.pitch_um, w.cutoff_per_mm);
                let (own, _) = sampling::oversample(WINGS_ERROR, pitch, aperture, cutoff, &w.at)?;
                cells = cells.max(own);
            }
        }
        let spread = wings.iter().fold(0.0f64, |m, w| m.max(w.spread_um));
        let furthest = grid.width.max(grid.height) as f64 * grid.pitch_um;
        let layout = fourier::layout(&grid, cells, spread.min(furthest));
        Ok(Self { grid, layout, fine: *fine, side })
    }

    /// Margin around the frame, in the sensor's pixels.
    pub fn margin_pixels(&self) -> usize {
        self.layout.margin * self.side
    }

    /// Adds a plane of larger pixels to one of the sensor's.
    pub fn add_to<T>(&self, sum: &mut Plane<T>, far: &Plane<T>)
    where
        T: Copy + Send + Sync + From<f32> + Mul<Output = T> + AddAssign,
    {
        let across = taps(self.fine.width, self.side, self.grid.width);
        let down = taps(self.fine.height, self.side, self.grid.height);
        let rows = sum.data.par_chunks_mut(self.fine.width).zip(down);
        rows.for_each_init(
            || vec![T::from(0.0); self.grid.width],
            |between, (row, taps)| {
                between.fill(T::from(0.0));
                for (j, weight) in taps {
                    let line = &far.data[j * self.grid.width..][..self.grid.width];
                    let weight = T::from(weight);
                    between.iter_mut().zip(line).for_each(|(b, v)| *b += weight * *v);
                }
                for (value, taps) in row.iter_mut().zip(&across) {
                    taps.iter().for_each(|&(i, weight)| *value += T::from(weight) * between[i]);
                }
            },
        );
    }
}

/// For each of `fine` pixels, the larger pixels along an axis that it is interpolated from, and
/// their weights; beyond the outermost centres the line through them goes on.
fn taps(fine: usize, side: usize, coarse: usize) -> Vec<[(usize, f32); 4]> {
    let at = |k: usize| {
        let place = (k as f64 + 0.5 - 0.5 * fine as f64) / side as f64 + 0.5 * coarse as f64 - 0.5;
        if coarse == 1 {
            return [(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)];
        }
        let first = (place.floor().max(0.0) as usize).min(coarse - 2);
        let t = (place - first as f64) as f32;
        let inside = first > 0 && first + 2 < coarse && (0.0..=1.0).contains(&t);
        if !inside {
            return [(first, 1.0 - t), (first + 1, t), (0, 0.0), (0, 0.0)];
        }
        let (t2, t3) = (t * t, t * t * t);
        [
            (first - 1, 0.5 * (2.0 * t2 - t - t3)),
            (first, 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0)),
            (first + 1, 0.5 * (4.0 * t2 - 3.0 * t3 + t)),
            (first + 2, 0.5 * (t3 - t2)),
        ]
    };
    (0..fine).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quadratic_polynomials_are_kept_and_lines_go_on_beyond_the_outermost_centres() {
        for (fine, side) in [(203usize, 16usize), (64, 8), (31, 4), (9, 2), (7, 1)] {
            let coarse = fine.div_ceil(side);
            let x = |i: usize| (i as f64 + 0.5 - 0.5 * coarse as f64) * side as f64;
            for (k, taps) in taps(fine, side, coarse).iter().enumerate() {
                let at = k as f64 + 0.5 - 0.5 * fine as f64;
                let sum = |f: &dyn Fn(f64) -> f64| -> f64 {
                    taps.iter().map(|&(i, weight)| f64::from(weight) * f(x(i))).sum()
                };
                let line = sum(&|x| 3.0 + 0.1 * x);
                assert!((line - (3.0 + 0.1 * at)).abs() < 1e-4, "{fine}/{side}, {k}: {line}");
                // Four pixels on.
                if taps[3].1 != 0.0 {
                    let square = sum(&|x| x * x);
                    assert!((square - at * at).abs() < 1e-2, "{fine}/{side}, {k}: {square}");
                }
            }
        }
    }
}
