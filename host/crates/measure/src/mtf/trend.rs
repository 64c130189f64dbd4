//! The slow trend of both sides of an edge: uneven light, taken off the samples before the edge
//! spread function.
//!
//! An even side of the target is not even in the frame: relative illumination (cos⁴), shading and
//! the lamp change its level slowly over the region. The derivative of that would count as tails of
//! the lens, the more the larger the region: ISO 12233 asks for even light or a correction of it
//! before the analysis. At a distance d from the edge and t along it, both from the edge's middle,
//! each side is
//!
//! v = L + b·d + c·d² + e·t + f·t² + g·d·t ± T/|d|,
//!
//! fitted by least squares to the samples of the mean of all frames that lie further from the edge
//! than [`NEAR`] blurs (where the region is small, than a third of its reach). T, one for both
//! sides, are the tails that diffraction spreads, which fall as 1/d: they are fitted beside the
//! trend so that it does not take them, and stay. Everything else but L is taken off, in proportion
//! to the share of either side in a sample, unless the fit without it is as good but for noise.
//!
//! What is taken off is light that changes over the whole region by a parabola. Tails of a lens
//! that end within the region stay. Veiling glare, and tails wider than the region, are an even or
//! slowly changing light on both sides: an edge shows no more of them than the height that its
//! sides lack, so they are not in its response (ISO 9358 measures them).

use super::line::EdgeLine;
use super::{Rows, Sample};
use camrig_linear::{Matrix, Vector, solve_positive};
use std::f64::consts::FRAC_1_SQRT_2;

/// Standard deviations of the blurred step that fits best from the edge on which samples count for
/// the trend.
const NEAR: f64 = 6.0;
/// Most of the distance from the edge to the region's border that is left out.
const MAX_NEAR: f64 = 1.0 / 3.0;
/// χ² of ten degrees of freedom that chance exceeds once in 1000 edges: a trend with less is noise.
const UNEVEN: f64 = 29.6;
/// Terms of a side's trend.
const TERMS: usize = 5;
/// Unknowns: the levels, the tails, the trends.
const UNKNOWNS: usize = 3 + 2 * TERMS;

/// The trend of both sides.
pub struct Trend {
    /// Distances that the terms are scaled by, pixels.
    scale: f64,
    /// Terms of the side before and the one after the edge, DN.
    sides: [[f64; TERMS]; 2],
}

/// Place of a sample: distance from the edge and along it, pixels.
fn place(s: &Sample, line: &EdgeLine) -> (f64, f64) {
    let d = (s.across - line.at(s.along)) / libm::hypot(line.slope(s.along), 1.0);
    (d, s.along - line.centre().1)
}

impl Trend {
    /// The trend of samples, where they have one; `step` is the distance between those of a row,
    /// and `reach` the distance from the edge that all rows reach, pixels.
    pub fn of(rows: &Rows, line: &EdgeLine, step: f64, reach: f64) -> Option<Self> {
        let near = (NEAR * line.blur).min(MAX_NEAR * reach).max(step);
        let along = rows.iter().flatten().map(|s| place(s, line).1.abs()).fold(0.0, f64::max);
        let scale = along.max(reach);
        let (mut normal, mut target) =
            (Matrix::zeros(UNKNOWNS, UNKNOWNS), Vector::zeros(UNKNOWNS));
        let (mut squares, mut samples) = (0.0, 0.0);
        for s in rows.iter().flatten() {
            let (d, t) = place(s, line);
            if d.abs() < near {
                continue;
            }
            let side = usize::from(d > 0.0);
            let mut x = [0.0; UNKNOWNS];
            (x[side], x[2]) = (1.0, near / d);
            x[3 + TERMS * side..][..TERMS].copy_from_slice(&terms(d / scale, t / scale));
            for i in 0..UNKNOWNS {
                target[i] += x[i] * s.value;
                (0..UNKNOWNS).for_each(|j| normal[(i, j)] += x[i] * x[j]);
            }
            (squares, samples) = (squares + s.value * s.value, samples + 1.0);
        }
        // What a fit by the first of the unknowns leaves.
        let fit = |unknowns: usize| {
            let normal = normal.view((0, 0), (unknowns, unknowns)).into_owned();
            let target = target.rows(0, unknowns).into_owned();
            let found = solve_positive(normal, &target)?;
            let left: f64 = squares - found.dot(&target);
            Some((found, left.max(0.0)))
        };
        let ((_, even), (found, uneven)) = (fit(3)?, fit(UNKNOWNS)?);
        let variance = uneven / (samples - UNKNOWNS as f64);
        let terms = |side: usize| std::array::from_fn(|k| found[3 + TERMS * side + k]);
        (even - uneven > UNEVEN * variance).then(|| Self { scale, sides: [terms(0), terms(1)] })
    }

    /// Takes the trend off the samples of an edge.
    pub fn take_off(&self, rows: &mut Rows, line: &EdgeLine) {
        for s in rows.iter_mut().flatten() {
            let (d, t) = place(s, line);
            let after = 0.5 * libm::erfc(-d / line.blur * FRAC_1_SQRT_2);
            let x = terms(d / self.scale, t / self.scale);
            let of = |side: usize| x.iter().zip(self.sides[side]).map(|(x, c)| x * c).sum::<f64>();
            s.value -= (1.0 - after) * of(0) + after * of(1);
        }
    }
}

fn terms(d: f64, t: f64) -> [f64; TERMS] {
    [d, d * d, t, t * t, d * t]
}
