//! Pixels of an image resampled exactly to the cells of a grid.

use super::Grid;
use camrig_base::Plane;

/// Exact area-weighted means of `image`, one sensor width wide and centred, over the grid's cells.
pub fn resample(image: &Plane<f32>, grid: &Grid) -> Plane<f32> {
    let scale = image.width as f64; // pixels per sensor width
    let columns =
        Shares::new((grid.left + 0.5) * scale, grid.cell * scale, grid.width, image.width);
    let top = grid.top * scale + image.height as f64 / 2.0;
    let rows = Shares::new(top, grid.cell * scale, grid.height, image.height);
    let mut result = Plane::filled(grid.width, grid.height, 0.0f32);
    let mut across = vec![0.0f32; grid.width];
    let mut held = None; // the image row whose means over the columns `across` holds
    for (y, first) in rows.first.iter().enumerate() {
        for tap in 0..rows.taps(y) {
            let source = first + tap;
            if held != Some(source) {
                columns.means(image.row(source), &mut across);
                held = Some(source);
            }
            let down = rows.of_tap[tap][y];
            result.row_mut(y).iter_mut().zip(&across).for_each(|(r, v)| *r += down * v);
        }
    }
    result
}

/// Shares of cells that lie over pixels. A share outside the image counts for its edge pixel.
struct Shares {
    /// The first pixel under each cell.
    first: Vec<usize>,
    /// Per pixel from there on, the share of each cell; 0 beyond its last.
    of_tap: Vec<Vec<f32>>,
}

impl Shares {
    /// Of `cells` cells of length `cell` from `start`, in pixels.
    fn new(start: f64, cell: f64, cells: usize, pixels: usize) -> Self {
        let end = pixels as f64;
        let mut shares = Self { first: Vec::with_capacity(cells), of_tap: Vec::new() };
        for i in 0..cells {
            let (a, b) = (start + i as f64 * cell, start + (i + 1) as f64 * cell);
            let first = a.clamp(0.0, end - 1.0).floor() as usize;
            let last = ((b.clamp(0.0, end).ceil() as usize).max(1) - 1).max(first);
            shares.first.push(first);
            for pixel in first..=last {
                let from = if pixel == 0 { a } else { a.max(pixel as f64) };
                let to = if pixel + 1 == pixels { b } else { b.min(pixel as f64 + 1.0) };
                if shares.of_tap.len() <= pixel - first {
                    shares.of_tap.push(vec![0.0; cells]);
                }
                shares.of_tap[pixel - first][i] = ((to - from).max(0.0) / cell) as f32;
            }
        }
        shares
    }

    /// Pixels under a cell.
    fn taps(&self, cell: usize) -> usize {
        self.of_tap.iter().rposition(|shares| shares[cell] != 0.0).map_or(0, |last| last + 1)
    }

    /// The mean over each cell of a row of pixels.
    fn means(&self, row: &[f32], means: &mut [f32]) {
        means.fill(0.0);
        for (tap, shares) in self.of_tap.iter().enumerate() {
            for ((mean, first), share) in means.iter_mut().zip(&self.first).zip(shares) {
                // The last pixel stands for those beyond it, whose share is 0.
                *mean += share * row[(first + tap).min(row.len() - 1)];
            }
        }
    }
}
