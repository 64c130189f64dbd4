//! How far apart the values of a plane are, and so in which arithmetic it is transformed.
//!
//! The roundings of a transform spread over the whole plane: in f32 up to 3e-7 of its largest
//! value (2e-9 beside a lamp of one cell, 3e-7 beside one of 100 x 100; a test of
//! [`varying`](super::varying) measures it), in f64 1e-15. Where that is more than 0.5 % of the dark
//! cells, which is a range of 17 000 or 84 dB, or of the mean where the others are black, the plane
//! is transformed in f64, in twice the time and memory. So pixels beside a lamp are right to 0.5 %
//! of themselves up to a range of 1e12. Sums without transforms, as graphics processors do them,
//! have no such rounding: no term is negative, and each sum is right to a few 1e-7 of itself.

use camrig_vector::vectorised;

/// Ripple of transforms in f32, relative to the largest value.
pub(super) const RIPPLE: f64 = 3e-7;
/// Greatest share of the dark cells, or of the mean, that the ripple may be.
const MAX_RIPPLE: f64 = 5e-3;
/// Cells of a row that count as one for the darkest, by their brightest: at the edges of things,
/// single cells take any share of the light down to none.
const RUN: usize = 8;

/// The range of cells.
#[derive(Clone, Copy)]
pub struct Range {
    largest: f32,
    /// The least above 0 of all runs.
    darkest: f32,
    sum: f64,
    cells: usize,
}

impl Default for Range {
    fn default() -> Self {
        Self { largest: 0.0, darkest: f32::INFINITY, sum: 0.0, cells: 0 }
    }
}

impl Range {
    /// The range of whole rows.
    pub fn of(cells: &[f32]) -> Self {
        measured(cells)
    }

    /// The range of these cells and others.
    pub fn join(self, other: Self) -> Self {
        Self {
            largest: self.largest.max(other.largest),
            darkest: self.darkest.min(other.darkest),
            sum: self.sum + other.sum,
            cells: self.cells + other.cells,
        }
    }

    /// Whether transforms in f32 would change the dark cells.
    pub fn is_wide(&self) -> bool {
        let ripple = RIPPLE * f64::from(self.largest);
        let mean = self.sum / self.cells.max(1) as f64;
        ripple > MAX_RIPPLE * f64::from(self.darkest) || ripple > MAX_RIPPLE * mean.abs()
    }
}

#[vectorised]
fn measured(cells: &[f32]) -> Range {
    let mut range = Range { cells: cells.len(), ..Range::default() };
    for run in cells.chunks(RUN) {
        let most = run.iter().fold(0.0f32, |m, &v| if v > m { v } else { m });
        range.largest = range.largest.max(most);
        range.darkest = range.darkest.min(if most > 0.0 { most } else { f32::INFINITY });
        range.sum += f64::from(run.iter().sum::<f32>());
    }
    range
}
