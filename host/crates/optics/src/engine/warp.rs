//! Resampling a plane along a smooth mapping, sixteen values at a time.
//!
//! The mapping is evaluated every [`BLOCK`] cells; between, places lie on a straight line through
//! the source plane. Catmull-Rom interpolation (four taps, exact for quadratic polynomials) is
//! done in two passes: down the columns, at the height where the line crosses each, then along the
//! line (Catmull and Smith 1980, "3-D transformations of images in scanline order", SIGGRAPH 14,
//! 279). That is a quarter of the loads of sixteen taps per value.
//!
//! Within a block, neighbouring values come from neighbouring columns except where the line steps
//! over a row or column. A pass runs once for each step that occurs, and lanes on another step add
//! 0, so that all loads are contiguous.

use camrig_base::Plane;
use camrig_vector::vectorised;

/// Cells between exact evaluations of the mapping. A distortion of 10 % at the end of 1000 cells
/// bends by some 1e-4 cells per cell², which leaves (16/2)²/2 of that: 0.003 cells.
pub const BLOCK: usize = 16;

/// Source columns that one block reads, from the one before its first place on.
const COLUMNS: usize = 32;

/// Cells that a source plane needs beyond the outermost places, on every side: two for the taps,
/// one row for the slope of a line over those columns, one of reserve.
pub const APRON: usize = 4;

/// Further cells that it needs on the right: blocks read whole registers.
pub const RIGHT: usize = COLUMNS;

/// Fills `values` from the places that `mesh` gives every [`BLOCK`] values, columns and rows of
/// `plane`, sample centres at whole numbers.
#[vectorised]
pub fn resample(plane: &Plane<f32>, mesh: &[(f64, f64)], values: &mut [f32]) {
    for (ends, block) in mesh.windows(2).zip(values.chunks_mut(BLOCK)) {
        let step = |a: f64, b: f64| (b - a) / BLOCK as f64;
        let step = (step(ends[0].0, ends[1].0), step(ends[0].1, ends[1].1));
        if fits(step, block.len()) {
            line(plane, ends[0], step, block);
            continue;
        }
        // Places far apart, or a line too steep to cross columns: a value at a time.
        for (i, value) in block.iter_mut().enumerate() {
            let place = (ends[0].0 + step.0 * i as f64, ends[0].1 + step.1 * i as f64);
            line(plane, place, (1.0, 0.0), std::slice::from_mut(value));
        }
    }
}

/// Whether the columns under `count` places can be held, and the line crosses them at a slope of
/// at most 1/4: the second pass sees frequencies along the line, by that much higher.
fn fits((dx, dy): (f64, f64), count: usize) -> bool {
    dx > 0.0 && dy.abs() <= 0.25 * dx && dx * count as f64 + 5.0 <= COLUMNS as f64
}

/// Values at even steps along a line.
#[inline(always)]
fn line(plane: &Plane<f32>, (x, y): (f64, f64), (dx, dy): (f64, f64), values: &mut [f32]) {
    // Whole cells apart from what changes, so that f32 holds the rest to 1e-6.
    let left = x.floor() - 1.0;
    let places: [f32; BLOCK] = std::array::from_fn(|i| (x - left + dx * i as f64) as f32);
    let columns = places[values.len() - 1] as usize + 3;
    let slope = dy / dx;
    let height = |column: usize| y + (column as f64 - (x - left)) * slope;
    let (start, end) = (height(0), height(columns - 1));
    let top = start.min(end).floor();
    let highest = (start.max(end) - top) as f32;
    let heights: [f32; COLUMNS] =
        std::array::from_fn(|k| ((height(k) - top) as f32).clamp(0.0, highest));

    let mut crossed = [0.0f32; BLOCK + COLUMNS + BLOCK];
    for step in 0..=highest as usize {
        let at = (top as usize + step - 1) * plane.width + left as usize;
        let row = |m: usize| &plane.data[at + m * plane.width..][..COLUMNS];
        let rows = [row(0), row(1), row(2), row(3)];
        for k in 0..COLUMNS {
            let taps = [rows[0][k], rows[1][k], rows[2][k], rows[3][k]];
            crossed[BLOCK + k] += interpolated(taps, heights[k] - step as f32);
        }
    }

    // Value i has its taps from column i + shift on.
    let shift = |i: usize| places[i] as isize - 1 - i as isize;
    let shifts = (0..values.len()).map(shift);
    let (low, high) = shifts.fold((isize::MAX, isize::MIN), |(a, b), s| (a.min(s), b.max(s)));
    let mut sums = [0.0f32; BLOCK];
    for shift in low..=high {
        let at = (BLOCK as isize + shift) as usize;
        let columns = &crossed[at..at + BLOCK + 3];
        for i in 0..BLOCK {
            let taps = [columns[i], columns[i + 1], columns[i + 2], columns[i + 3]];
            sums[i] += interpolated(taps, places[i] - (i as isize + 1 + shift) as f32);
        }
    }
    values.copy_from_slice(&sums[..values.len()]);
}

/// Catmull-Rom's cubic between the middle two of four taps at `t` in 0..1; 0 for any other `t`.
#[inline(always)]
#[expect(clippy::manual_range_contains, reason = "no branch between the comparisons: lanes")]
fn interpolated([a, b, c, d]: [f32; 4], t: f32) -> f32 {
    let before = ((-0.5 * t + 1.0) * t - 0.5) * t;
    let here = (1.5 * t - 2.5) * t * t + 1.0;
    let next = ((-1.5 * t + 2.0) * t + 0.5) * t;
    let after = (0.5 * t - 0.5) * t * t;
    let sum = (before * a + here * b) + (next * c + after * d);
    if (t >= 0.0) & (t < 1.0) { sum } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 120;

    /// Largest difference of resampled values from `f` over straight lines of many steps, that
    /// stay in the plane.
    fn worst(f: impl Fn(f64, f64) -> f64) -> f64 {
        let plane = Plane::from_fn(SIDE, SIDE, |x, y| f(x as f64, y as f64) as f32);
        let inside = |(x, y): (f64, f64)| {
            let end = |right: usize| APRON as f64..(SIDE - APRON - right) as f64;
            end(RIGHT).contains(&x) && end(0).contains(&y)
        };
        let (mut worst, mut lines) = (0.0f64, 0);
        for i in 0..3000 {
            // Quasi-random starts and steps, also backwards, steep and stretched ones.
            let part = |irrational: f64| (f64::from(i) * irrational).fract();
            let from = (part(0.618_034) * 120.0, part(0.754_878) * 120.0);
            let step = (part(0.414_214) * 4.0 - 0.5, part(0.732_051) * 3.0 - 1.5);
            let step = if i % 3 == 0 { (0.9 + 0.2 * part(0.236_068), step.1 * 0.2) } else { step };
            let to = |n: f64| (from.0 + step.0 * n, from.1 + step.1 * n);
            let count = 1 + i as usize % BLOCK;
            if !inside(from) || !inside(to(count as f64 - 1.0)) {
                continue;
            }
            lines += 1;
            let mut values = vec![f32::NAN; count];
            resample(&plane, &[from, to(BLOCK as f64)], &mut values);
            for (k, value) in values.iter().enumerate() {
                let (x, y) = to(k as f64);
                worst = worst.max((f64::from(*value) - f(x, y)).abs());
            }
        }
        assert!(lines > 500, "{lines} lines");
        worst
    }

    #[test]
    fn quadratic_polynomials_are_kept_along_any_line() {
        let worst = worst(|x, y| {
            let (x, y) = (x / 60.0 - 1.0, y / 60.0 - 1.0);
            0.3 + x - 0.5 * y + 0.8 * x * x - 0.6 * x * y + 0.4 * y * y
        });
        // f32 places of up to 32 are good to 1e-6 cells, values of order 1 to 1e-7; slopes are
        // 0.05 per cell.
        assert!(worst < 2e-6, "{worst}");
    }

    #[test]
    fn waves_lose_what_four_taps_each_way_take() {
        // Halfway between samples Catmull-Rom passes (9cos(ω/2) − cos(3ω/2))/8 of a wave e^(iωx).
        // The product of two waves loses that once down the columns, and along a line of slope
        // 1/4, where it is the half sum of waves of frequencies ω(1 ± 1/4), as much as those lose.
        let loss = |omega: f64| 1.0 - (9.0 * (omega / 2.0).cos() - (1.5 * omega).cos()) / 8.0;
        let omega = std::f64::consts::TAU / 8.0;
        let bound = loss(omega) + 0.5 * (loss(1.25 * omega) + loss(0.75 * omega));
        let worst = worst(|x, y| (omega * x).sin() * (omega * y).cos());
        println!("waves of 8 cells: {worst:.4}, bound {bound:.4}");
        assert!(worst < bound, "{worst}");
    }
}
