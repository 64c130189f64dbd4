//! A map over pixels as means over square blocks, and templates fitted to them.

use camrig_base::Plane;
use camrig_base::median::median;

/// Side of a block, pixels: small against the smooth structure that is fitted, and enough pixels
/// (256) for a mean whose noise is a sixteenth of theirs.
pub(super) const SIDE: usize = 16;

/// The mean of a block, in the map's unit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    /// Centre across, -1 at the left edge to 1 at the right one.
    pub(super) u: f64,
    /// Centre down, -1 at the top edge to 1 at the bottom one.
    pub(super) v: f64,
    /// The mean.
    pub(super) mean: f64,
}

/// Means over all whole blocks, row by row. Pixels further than `clip` (the map's unit) from the
/// median of their block count as that far.
pub(super) fn block_means(plane: &Plane<f32>, clip: f64) -> Vec<Block> {
    let (w, h) = (plane.width, plane.height);
    let clip = clip as f32;
    let (mut out, mut pixels) = (Vec::new(), Vec::with_capacity(SIDE * SIDE));
    let centre = |block: usize, size: usize| {
        (block as f64 * SIDE as f64 + SIDE as f64 / 2.0) / size as f64 * 2.0 - 1.0
    };
    for by in 0..h / SIDE {
        for bx in 0..w / SIDE {
            pixels.clear();
            for row in plane.data.chunks(w).skip(by * SIDE).take(SIDE) {
                pixels.extend_from_slice(&row[bx * SIDE..(bx + 1) * SIDE]);
            }
            let middle = median(&mut pixels, f32::total_cmp);
            let sum: f64 =
                pixels.iter().map(|&p| f64::from(p.clamp(middle - clip, middle + clip))).sum();
            let mean = sum / (SIDE * SIDE) as f64;
            out.push(Block { u: centre(bx, w), v: centre(by, h), mean });
        }
    }
    out
}

/// A template fitted to block means by least squares, both without their own mean.
pub(super) struct Template {
    /// The factor of the template, in the map's unit.
    pub(super) amplitude: f64,
    /// By how much the sum of squares falls, in the map's unit squared.
    pub(super) fall: f64,
}

/// Fits `template`, a function of u and v, to block means.
pub(super) fn fit_template(blocks: &[Block], template: impl Fn(f64, f64) -> f64) -> Template {
    let n = blocks.len() as f64;
    let t: Vec<f64> = blocks.iter().map(|b| template(b.u, b.v)).collect();
    let (mt, mb) = (t.iter().sum::<f64>() / n, blocks.iter().map(|b| b.mean).sum::<f64>() / n);
    let (mut tb, mut tt) = (0.0, 0.0);
    for (t, b) in t.iter().zip(blocks) {
        tb += (t - mt) * (b.mean - mb);
        tt += (t - mt).powi(2);
    }
    // A template that is the same everywhere fits nothing.
    let tt = tt.max(f64::MIN_POSITIVE);
    Template { amplitude: tb / tt, fall: tb * tb / tt }
}
