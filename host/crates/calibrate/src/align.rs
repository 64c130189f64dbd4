//! The shift between two exposures of the same view.
//!
//! Found on one phase of the colour filter pattern in the middle of the frame, by the least mean
//! absolute difference of ln signal over whole cells, less what the exposures differ by as a
//! whole, refined by a parabola. Only pixels that are usable in both exposures count, so different
//! exposures compare.

use camrig_vector::vectorised;
use rayon::prelude::*;

/// Largest shift searched, cells in each direction.
const REACH: isize = 8;
/// A shift must lower the difference below this part of what no shift leaves.
const DECISIVE: f64 = 0.8;
/// Largest window compared, cells a side.
const WINDOW: usize = 384;

/// Shift of the second view against the first in pixels, by (x, y); `None` where too few pixels
/// are usable in both. `rates` are linear signals per second at an index of a frame of that size,
/// NaN where they do not count. `cell` is the edge of the colour filter pattern.
pub fn shift(
    (frame_width, frame_height): (usize, usize),
    rates: [&(dyn Fn(usize) -> f32 + Sync); 2],
    cell: usize,
) -> Option<[f64; 2]> {
    let (width, height) = (frame_width / cell, frame_height / cell);
    let reach = REACH as usize;
    if width <= 2 * reach + 8 || height <= 2 * reach + 8 {
        return None;
    }
    let (w, h) = ((width - 2 * reach).min(WINDOW), (height - 2 * reach).min(WINDOW));
    // Cells of the window and of what it may be shifted over.
    let (left, top) = ((width - w) / 2 - reach, (height - h) / 2 - reach);
    let stride = w + 2 * reach;
    let [still, mut moved] = rates.map(|rate| {
        let mut values = vec![0.0; stride * (h + 2 * reach)];
        values.par_chunks_mut(stride).enumerate().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                let value = rate((top + y) * cell * frame_width + (left + x) * cell);
                *out = if value > 0.0 { libm::logf(value) } else { f32::NAN };
            }
        });
        values
    });
    // What the exposures differ by as a whole (a time that is not exact, a lamp) is no shift.
    let both = still.iter().zip(&moved).map(|(a, b)| b - a);
    let mut apart: Vec<f32> = both.filter(|d| !d.is_nan()).collect();
    if !apart.is_empty() {
        let middle = apart.len() / 2;
        let apart = *apart.select_nth_unstable_by(middle, f32::total_cmp).1;
        moved.iter_mut().for_each(|v| *v -= apart);
    }
    let cost = |dx: isize, dy: isize| -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0.0);
        for y in reach..reach + h {
            let from = y.checked_add_signed(dy)? * stride + reach.checked_add_signed(dx)?;
            let row = [&still[y * stride + reach..][..w], &moved[from..][..w]];
            let (of_row, usable) = difference(row);
            sum += of_row;
            count += usable;
        }
        (count * 10.0 > (w * h) as f64).then(|| sum / count)
    };
    let mut best = (f64::INFINITY, 0, 0);
    let side = 2 * REACH + 1;
    let shifts = (0..side * side).into_par_iter().map(|i| (i % side - REACH, i / side - REACH));
    let costs: Vec<_> =
        shifts.map(|(dx, dy)| Some((cost(dx, dy)?, dx, dy))).collect::<Option<_>>()?;
    for shift in costs {
        if shift.0 < best.0 {
            best = shift;
        }
    }
    let (least, dx, dy) = best;
    // On a view without detail every shift is as good: none is believed that gains too little.
    if least > DECISIVE * cost(0, 0)? {
        return Some([0.0; 2]);
    }
    let refine = |before: Option<f64>, after: Option<f64>| match (before, after) {
        (Some(a), Some(b)) if a + b > 2.0 * least => (a - b) / (2.0 * (a + b - 2.0 * least)),
        _ => 0.0,
    };
    let inside = |d: isize| d.abs() < REACH;
    let x = if inside(dx) { refine(cost(dx - 1, dy), cost(dx + 1, dy)) } else { 0.0 };
    let y = if inside(dy) { refine(cost(dx, dy - 1), cost(dx, dy + 1)) } else { 0.0 };
    Some([(dx as f64 + x) * cell as f64, (dy as f64 + y) * cell as f64])
}

/// Sum of the absolute differences of a row's values that are usable in both, and how many these
/// are.
#[vectorised]
fn difference([a, b]: [&[f32]; 2]) -> (f64, f64) {
    const LANES: usize = 32;
    let (mut sum, mut count) = ([0.0f32; LANES], [0.0f32; LANES]);
    for (a, b) in a.chunks(LANES).zip(b.chunks(LANES)) {
        for (((a, b), sum), count) in a.iter().zip(b).zip(&mut sum).zip(&mut count) {
            let difference = (a - b).abs();
            let usable = !difference.is_nan();
            *sum += if usable { difference } else { 0.0 };
            *count += if usable { 1.0 } else { 0.0 };
        }
    }
    (sum.iter().map(|&v| f64::from(v)).sum(), count.iter().map(|&v| f64::from(v)).sum())
}
