//! Lossy compression in blocks of 8 x 8: coefficients of cosine transforms that lie on steps.
//!
//! For each of the 63 frequencies and each step q, n |mean e^(2πic/q)|² over the n coefficients c
//! is exponentially distributed with mean 1 where there is no step. It is computed for blocks at
//! multiples of 8, where a coder has them, and at three other positions.

use camrig_base::Plane;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Side of a block, pixels.
const SIDE: usize = 8;
/// Range of the steps tested, DN: from the finest that rounding leaves visible to the coarsest of
/// common compression.
const FIRST_STEP: f64 = 1.3;
const LAST_STEP: f64 = 60.0;
/// Number of steps tested, in geometric progression.
const STEPS: usize = 160;
/// Relative range around the step found over which it is refined, and number of parts.
const REFINED_RANGE: f64 = 0.12;
const REFINED_PARTS: usize = 120;
/// Standard deviation of coefficients relative to a step below which all of them round to the same
/// multiple.
const MIN_SPREAD: f64 = 0.45;
/// Most blocks used: enough for steps of a tenth of the noise.
const MAX_BLOCKS: usize = 600;
/// Probability of a false alarm in a set.
const FALSE_ALARM: f64 = 1e-3;
/// Positions of blocks: a coder's, and three that no coder has.
const POSITIONS: [(usize, usize); 4] = [(0, 0), (0, 4), (4, 0), (3, 5)];

/// Coefficients on steps.
#[derive(Clone, Copy, Debug)]
pub struct Blocks {
    /// The step, DN.
    pub step_dn: f64,
    /// n |mean|² at this step.
    pub strength: f64,
    /// The largest at the other positions.
    pub elsewhere: f64,
    /// The value that chance exceeds once in a thousand sets.
    pub limit: f64,
}

/// The strongest step at one position.
#[derive(Clone, Copy)]
struct Peak {
    strength: f64,
    step_dn: f64,
}

const NO_PEAK: Peak = Peak { strength: 0.0, step_dn: 0.0 };

/// Detects frames that were coded in blocks.
pub fn blocks(frames: &[Plane<u16>]) -> Option<Blocks> {
    let limit = libm::log(63.0 * STEPS as f64 * POSITIONS.len() as f64 / FALSE_ALARM);
    let peaks: Vec<Peak> = POSITIONS.iter().map(|p| strongest(frames, *p)).collect();
    let Peak { strength, step_dn } = peaks[0];
    let elsewhere = peaks[1..].iter().map(|p| p.strength).fold(0.0, f64::max);
    // A step of the codes themselves appears at every position.
    let coded = strength > limit && strength > 3.0 * elsewhere;
    coded.then_some(Blocks { step_dn, strength, elsewhere, limit })
}

/// The strongest step with blocks from a position on.
fn strongest(frames: &[Plane<u16>], (top, left): (usize, usize)) -> Peak {
    let coefficients = coefficients(frames, (top, left));
    if coefficients.is_empty() {
        return NO_PEAK;
    }
    let ratio = LAST_STEP / FIRST_STEP;
    let step = |k: usize| FIRST_STEP * libm::pow(ratio, k as f64 / (STEPS as f64 - 1.0));
    let of = |values: &Vec<f64>| {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
        peak(values, (0..STEPS).map(step).filter(|q| sd > MIN_SPREAD * q))
    };
    let best: Vec<Peak> = coefficients.par_iter().map(of).collect();
    let strongest = (0..best.len()).max_by(|&a, &b| best[a].strength.total_cmp(&best[b].strength));
    let Some(k) = strongest.filter(|&k| best[k].strength > 0.0) else { return NO_PEAK };
    // The steps tested are coarse; the true one may also be wider than the widest tested here.
    let parts = REFINED_PARTS as f64;
    let near = (0..=REFINED_PARTS).map(|i| 1.0 + REFINED_RANGE * (2.0 * i as f64 / parts - 1.0));
    let refined = peak(&coefficients[k], near.map(|f| best[k].step_dn * f));
    Peak { strength: best[k].strength, step_dn: refined.step_dn }
}

/// The largest n |mean e^(2πic/q)|² of coefficients c over steps q.
fn peak(values: &[f64], steps: impl Iterator<Item = f64>) -> Peak {
    let powers = steps.map(|q| {
        let (re, im) = values.iter().fold((0.0, 0.0), |(re, im), v| {
            let (s, c) = libm::sincos(TAU * v / q);
            (re + c, im + s)
        });
        Peak { strength: (re * re + im * im) / values.len() as f64, step_dn: q }
    });
    powers.fold(NO_PEAK, |a, b| if b.strength > a.strength { b } else { a })
}

/// The coefficients of each of the 63 frequencies other than zero.
fn coefficients(frames: &[Plane<u16>], (top, left): (usize, usize)) -> Vec<Vec<f64>> {
    let basis: Vec<[f64; SIDE]> = (0..SIDE)
        .map(|k| {
            let norm = (if k == 0 { 1.0 } else { 2.0 } / SIDE as f64).sqrt();
            std::array::from_fn(|i| norm * libm::cos(PI * (2 * i + 1) as f64 * k as f64 / 16.0))
        })
        .collect();
    let mut out = vec![Vec::new(); SIDE * SIDE - 1];
    let mut remaining = MAX_BLOCKS;
    for frame in frames {
        let (w, h) = (frame.width, frame.height);
        for y in (top..(h + 1).saturating_sub(SIDE)).step_by(SIDE) {
            for x in (left..(w + 1).saturating_sub(SIDE)).step_by(SIDE) {
                if remaining == 0 {
                    return out;
                }
                remaining -= 1;
                // Rows first, then columns.
                let rows: Vec<[f64; SIDE]> = (0..SIDE)
                    .map(|v| {
                        let row = &frame.data[(y + v) * w + x..][..SIDE];
                        std::array::from_fn(|k| {
                            row.iter().zip(&basis[k]).map(|(&s, b)| f64::from(s) * b).sum()
                        })
                    })
                    .collect();
                for k in 1..SIDE * SIDE {
                    let (down, across) = (k / SIDE, k % SIDE);
                    let sum = rows.iter().zip(&basis[down]).map(|(r, b)| r[across] * b).sum();
                    out[k - 1].push(sum);
                }
            }
        }
    }
    if remaining == MAX_BLOCKS { Vec::new() } else { out }
}
