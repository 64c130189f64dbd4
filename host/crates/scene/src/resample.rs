//! Pixels of an image resampled exactly to the cells of a grid.

use super::Grid;
use camrig_base::Plane;

/// Exact area-weighted means of `image`, one sensor width wide and centred, over the grid's cells.
pub fn resample(image: &Plane<f32>, grid: &Grid) -> Plane<f32> {
    let scale = image.width as f64; // pixels per sensor width
    let columns = weights((grid.left + 0.5) * scale, grid.cell * scale, grid.width, image.width);
    let top = grid.top * scale + image.height as f64 / 2.0;
    let rows = weights(top, grid.cell * scale, grid.height, image.height);
    let mut result = Plane::filled(grid.width, grid.height, 0.0f32);
    let mut across = vec![0.0f32; grid.width];
    let mut held = None; // the image row whose means over the columns `across` holds
    for (y, (first, row_weights)) in rows.iter().enumerate() {
        for (i, &down) in row_weights.iter().enumerate() {
            let source = first + i;
            if held != Some(source) {
                let row = image.row(source);
                for (value, (first, weights)) in across.iter_mut().zip(&columns) {
                    *value = weights.iter().zip(&row[*first..]).map(|(w, v)| w * v).sum();
                }
                held = Some(source);
            }
            result.row_mut(y).iter_mut().zip(&across).for_each(|(r, v)| *r += down * v);
        }
    }
    result
}

/// For each of `cells` cells of length `cell` from `start`, in pixels: the first pixel under the
/// cell, and the shares of the cell that lie over this pixel and the following ones. A share
/// outside the image counts for its edge pixel.
fn weights(start: f64, cell: f64, cells: usize, pixels: usize) -> Vec<(usize, Vec<f32>)> {
    let end = pixels as f64;
    (0..cells)
        .map(|i| {
            let (a, b) = (start + i as f64 * cell, start + (i + 1) as f64 * cell);
            let first = a.clamp(0.0, end - 1.0).floor() as usize;
            let last = ((b.clamp(0.0, end).ceil() as usize).max(1) - 1).max(first);
            let parts = (first..=last).map(|pixel| {
                let from = if pixel == 0 { a } else { a.max(pixel as f64) };
                let to = if pixel + 1 == pixels { b } else { b.min(pixel as f64 + 1.0) };
                ((to - from).max(0.0) / cell) as f32
            });
            (first, parts.collect())
        })
        .collect()
}
