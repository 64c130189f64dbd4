//! Coefficients of cosine transforms in blocks of 8 x 8 that lie on steps: lossy compression.
//!
//! For each of the 63 frequencies and each step q, n |mean e^(2πic/q)|² over the n coefficients c
//! is exponential with the mean 1 where there is no step. It is compared at the blocks' own place
//! and at three others.

use camrig_base::Plane;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Side of a block, pixels.
const SIDE: usize = 8;
/// Steps that are tried, DN: from what rounding leaves visible to the coarsest compression.
const STEPS: (f64, f64, usize) = (1.3, 60.0, 160);
/// Where the step is looked for once one was found: this share around it, in so many parts.
const NEAR: (f64, usize) = (0.12, 120);
/// Coefficients whose standard deviation is below this share of a step all lie on one.
const WIDE: f64 = 0.45;
/// Blocks that are looked at, at most: enough for steps of a tenth of the noise.
const MAX_BLOCKS: usize = 600;
/// Chance of a false alarm in a set.
const FALSE_ALARM: f64 = 1e-3;
/// Places of blocks: their own, and three that no coder has.
const PLACES: [(usize, usize); 4] = [(0, 0), (0, 4), (4, 0), (3, 5)];

/// Coefficients on steps.
#[derive(Clone, Copy, Debug)]
pub struct Blocks {
    /// The step, DN.
    pub step_dn: f64,
    /// n |mean|² there.
    pub strength: f64,
    /// The largest at the other places.
    pub elsewhere: f64,
    /// What chance passes once in a thousand sets.
    pub limit: f64,
}

/// Whether frames were coded in blocks.
pub fn blocks(frames: &[Plane<u16>]) -> Option<Blocks> {
    let limit = libm::log(63.0 * STEPS.2 as f64 * PLACES.len() as f64 / FALSE_ALARM);
    let found: Vec<(f64, f64)> = PLACES.iter().map(|p| strongest(frames, *p)).collect();
    let (strength, step_dn) = found[0];
    let elsewhere = found[1..].iter().map(|f| f.0).fold(0.0, f64::max);
    // A step of the codes themselves shows at every place.
    let own = strength > limit && strength > 3.0 * elsewhere;
    own.then_some(Blocks { step_dn, strength, elsewhere, limit })
}

/// The largest n |mean|² with blocks from a place on, and its step.
fn strongest(frames: &[Plane<u16>], (top, left): (usize, usize)) -> (f64, f64) {
    let coefficients = coefficients(frames, (top, left));
    if coefficients.is_empty() {
        return (0.0, 0.0);
    }
    let (first, last, count) = STEPS;
    let step = |k: usize| first * libm::pow(last / first, k as f64 / (count as f64 - 1.0));
    let of = |values: &Vec<f64>| {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let sd = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
        largest(values, (0..count).map(step).filter(|q| sd > WIDE * q))
    };
    let best: Vec<(f64, f64)> = coefficients.par_iter().map(of).collect();
    let strongest = (0..best.len()).max_by(|&a, &b| best[a].0.total_cmp(&best[b].0));
    let Some(k) = strongest.filter(|&k| best[k].0 > 0.0) else { return (0.0, 0.0) };
    // The steps that are tried are coarse, and the true one may be wider than those tried here.
    let near = (0..=NEAR.1).map(|i| 1.0 + NEAR.0 * (2.0 * i as f64 / NEAR.1 as f64 - 1.0));
    (best[k].0, largest(&coefficients[k], near.map(|f| best[k].1 * f)).1)
}

/// The largest n |mean e^(2πic/q)|² of coefficients c over steps q, and that step.
fn largest(values: &[f64], steps: impl Iterator<Item = f64>) -> (f64, f64) {
    let powers = steps.map(|q| {
        let (re, im) = values.iter().fold((0.0, 0.0), |(re, im), v| {
            let (s, c) = libm::sincos(TAU * v / q);
            (re + c, im + s)
        });
        ((re * re + im * im) / values.len() as f64, q)
    });
    powers.fold((0.0, 0.0), |a: (f64, f64), b| if b.0 > a.0 { b } else { a })
}

/// The coefficients of each of the 63 frequencies but the constant one.
fn coefficients(frames: &[Plane<u16>], (top, left): (usize, usize)) -> Vec<Vec<f64>> {
    let basis: Vec<[f64; SIDE]> = (0..SIDE)
        .map(|k| {
            let norm = (if k == 0 { 1.0 } else { 2.0 } / SIDE as f64).sqrt();
            std::array::from_fn(|i| norm * libm::cos(PI * (2 * i + 1) as f64 * k as f64 / 16.0))
        })
        .collect();
    let mut out = vec![Vec::new(); SIDE * SIDE - 1];
    let mut left_over = MAX_BLOCKS;
    for frame in frames {
        let (w, h) = (frame.width, frame.height);
        for y in (top..(h + 1).saturating_sub(SIDE)).step_by(SIDE) {
            for x in (left..(w + 1).saturating_sub(SIDE)).step_by(SIDE) {
                if left_over == 0 {
                    return out;
                }
                left_over -= 1;
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
    if left_over == MAX_BLOCKS { Vec::new() } else { out }
}
