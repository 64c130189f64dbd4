//! The shift between two exposures of the same view.
//!
//! Found on one phase of the colour filter pattern in the middle of the frame, by the least mean
//! absolute difference of ln signal over whole cells, refined by a parabola. Only pixels that are
//! usable in both exposures count, so different exposures compare.

use crate::Plane;

/// Largest shift searched, cells in each direction.
const REACH: isize = 8;
/// A shift must lower the difference below this part of what no shift leaves.
const DECISIVE: f64 = 0.8;
/// Largest window compared, cells a side.
const WINDOW: usize = 384;

/// Shift of the second view against the first in pixels, by (x, y); `None` where too few pixels are usable in
/// both. `rates` are linear signals per second at an index of a frame of that size, NaN where they do not count.
/// `cell` is the edge of the colour filter pattern.
pub fn shift(
    (frame_width, frame_height): (usize, usize),
    rates: [&dyn Fn(usize) -> f32; 2],
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
    let [still, moved] = rates.map(|rate| {
        Plane::from_fn(w + 2 * reach, h + 2 * reach, |x, y| {
            let value = rate((top + y) * cell * frame_width + (left + x) * cell);
            if value > 0.0 { libm::logf(value) } else { f32::NAN }
        })
    });
    let (left, top) = (reach, reach);
    let cost = |dx: isize, dy: isize| -> Option<f64> {
        let (mut sum, mut count) = (0.0f64, 0usize);
        for y in top..top + h {
            let from = left.checked_add_signed(dx)?;
            let other = &moved.row(y.checked_add_signed(dy)?)[from..from + w];
            for (a, b) in still.row(y)[left..left + w].iter().zip(other) {
                let difference = (a - b).abs();
                if !difference.is_nan() {
                    sum += f64::from(difference);
                    count += 1;
                }
            }
        }
        (count * 10 > w * h).then(|| sum / count as f64)
    };
    let mut best = (f64::INFINITY, 0, 0);
    for dy in -REACH..=REACH {
        for dx in -REACH..=REACH {
            let cost = cost(dx, dy)?;
            if cost < best.0 {
                best = (cost, dx, dy);
            }
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
