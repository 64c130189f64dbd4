//! What moved between exposures, and what only looks as if it had: an exposure whose black or time is a
//! little off as a whole.

use super::super::exposures::Exposure;
use super::noise::{Noise, SIDE, Seen, load, median};
use crate::camera::Cfa;
use crate::{Error, Plane, Result};
use multiversion::multiversion;
use rayon::prelude::*;

/// A systematic difference between exposures that is no movement, relative: what differs over the field and
/// over the curve is beyond a [`Departure`].
const ALLOWANCE: f32 = 0.05;
/// Half of the neighbourhood's edge.
const AROUND: usize = 4;

/// Where exposures disagree with the merged frame within 9 x 9 pixels: the mean χ² per degree of freedom is
/// above 1.5 by six of its own standard deviations.
///
/// # Errors
/// An exposure whose light contradicts its time.
pub(super) fn find(
    exposures: &[Exposure],
    radiance: &Plane<f32>,
    cfa: &Cfa,
    noise: Noise,
    limit: f32,
) -> Result<Vec<bool>> {
    let (width, height) = (radiance.width, radiance.height);
    let departures: Vec<Vec<Departure>> =
        exposures.par_iter().map(|e| Departure::of(e, radiance, cfa)).collect();
    check_times(exposures, &departures, limit)?;
    // Per row of the pattern and exposure the line of each column.
    let lines: Vec<Vec<[Vec<f32>; 2]>> = (0..cfa.height)
        .map(|y| {
            let column = |d: &[Departure], f: fn(&Departure) -> f64| {
                (0..width).map(|x| f(&d[cfa.channel(x, y)]) as f32).collect()
            };
            departures
                .iter()
                .map(|d| [column(d, |d| d.offset_dn), column(d, |d| d.slope)])
                .collect()
        })
        .collect();

    // χ² and degrees of freedom, summed over 9 columns.
    let mut chi_square = vec![0.0; width * height];
    let mut freedom = vec![0.0; width * height];
    let rows = chi_square.par_chunks_mut(width).zip(freedom.par_chunks_mut(width));
    rows.enumerate().for_each_init(
        || [vec![0.0; width + 2 * AROUND], vec![0.0; width + 2 * AROUND]],
        |padded, (y, (chi_square, freedom))| {
            let seen: Vec<Seen<'_>> = exposures.iter().map(|e| Seen::row(e, y)).collect();
            let [chi, free] = padded.each_mut().map(|p| &mut p[AROUND..AROUND + width]);
            disagreement(noise, &seen, &lines[y % cfa.height], radiance.row(y), chi, free);
            sum_around(&padded[0], chi_square);
            sum_around(&padded[1], freedom);
        },
    );
    let mut moved = vec![false; width * height];
    moved.par_chunks_mut(width).enumerate().for_each_init(
        || [vec![0.0; width], vec![0.0; width]],
        |[chi, free], (y, out)| {
            chi.fill(0.0);
            free.fill(0.0);
            for row in y.saturating_sub(AROUND)..(y + AROUND + 1).min(height) {
                let row = row * width..(row + 1) * width;
                chi.iter_mut().zip(&chi_square[row.clone()]).for_each(|(s, v)| *s += v);
                free.iter_mut().zip(&freedom[row]).for_each(|(s, v)| *s += v);
            }
            for ((out, &chi), &free) in out.iter_mut().zip(&*chi).zip(&*free) {
                *out = free > 0.0 && chi / free > 1.5 + 6.0 * (2.0 / free).sqrt();
            }
        },
    );
    Ok(moved)
}

/// Per pixel Σ (x − what the exposure sees of E t)² / variance, and the exposures less one.
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn disagreement(
    noise: Noise,
    seen: &[Seen<'_>],
    lines: &[[Vec<f32>; 2]],
    radiance: &[f32],
    chi_square: &mut [f32],
    freedom: &mut [f32],
) {
    for first in (0..radiance.len()).step_by(SIDE) {
        let light = load(radiance, first, 0.0);
        let (mut sum, mut count) = ([0.0f32; SIDE], [-1.0f32; SIDE]);
        for (e, [offset, slope]) in seen.iter().zip(lines) {
            let x = load(e.signals, first, f32::INFINITY);
            let (offset, slope) = (load(offset, first, 0.0), load(slope, first, 1.0));
            for i in 0..SIDE {
                let expected = light[i] * e.seconds;
                let rest = x[i] - (offset[i] + slope[i] * expected);
                let allowed = ALLOWANCE * expected;
                let variance = noise.variance(expected, e.frames) + allowed * allowed;
                let usable = x[i] < f32::INFINITY;
                sum[i] += if usable { rest * rest / variance } else { 0.0 };
                count[i] += if usable { 1.0 } else { 0.0 };
            }
        }
        let n = SIDE.min(radiance.len() - first);
        for i in 0..n {
            chi_square[first + i] = sum[i];
            freedom[first + i] = if count[i] > 0.0 { count[i] } else { 0.0 };
        }
    }
}

/// Sums over the columns about each; `padded` has [`AROUND`] zeros more on either side.
fn sum_around(padded: &[f32], out: &mut [f32]) {
    out.fill(0.0);
    for shift in 0..=2 * AROUND {
        out.iter_mut().zip(&padded[shift..]).for_each(|(s, v)| *s += v);
    }
}

/// Refuses exposures whose light contradicts their time by more than shutters and lamps do.
fn check_times(exposures: &[Exposure], departures: &[Vec<Departure>], limit: f32) -> Result<()> {
    const CONTRADICTION: f64 = 0.2;
    // A black that is off is no contradiction: of full scale.
    const BLACK: f64 = 0.02;
    for (exposure, departures) in exposures.iter().zip(departures) {
        for d in departures {
            let (seen, expected) = (d.seen(d.bright_dn), d.bright_dn);
            let difference = (seen - expected).abs();
            if difference > CONTRADICTION * expected && difference > BLACK * f64::from(limit) {
                let factor = seen / expected;
                return Err(Error::input(format!(
                    "capture {:?} has {factor:.2} times the light that its exposure time of {} s and the \
                     other captures say",
                    exposure.id, exposure.seconds
                ))
                .help(
                    "correct the exposure_s that is wrong, or leave that capture out (--only); a camera that \
                     is not linear needs --response",
                ));
            }
        }
    }
    Ok(())
}

/// What one exposure sees of a channel where the merged frame says s: offset + slope · s.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Departure {
    offset_dn: f64,
    slope: f64,
    /// The median s of the brighter half of the pixels.
    bright_dn: f64,
}

impl Departure {
    fn seen(self, expected: f64) -> f64 {
        self.offset_dn + self.slope * expected
    }

    /// The line of each channel.
    fn of(exposure: &Exposure, radiance: &Plane<f32>, cfa: &Cfa) -> Vec<Self> {
        const SAMPLES: usize = 1 << 16;
        let width = radiance.width;
        // An odd step visits every column and channel.
        let step = (radiance.data.len() / SAMPLES) | 1;
        let mut pairs: Vec<Vec<(f32, f32)>> = vec![Vec::new(); cfa.channels().len()];
        for i in (0..radiance.data.len()).step_by(step) {
            let signal = exposure.signal.data[i];
            if signal.is_finite() {
                let expected = (f64::from(radiance.data[i]) * exposure.seconds) as f32;
                pairs[cfa.channel(i % width, i / width)].push((expected, signal));
            }
        }
        pairs.into_iter().map(Self::line).collect()
    }

    /// Slope from the brighter half of the pairs (s, signal), offset from the darker, each as a median: what moved
    /// is a minority in both, and has no leverage. Fewer pairs than 200 tell nothing.
    fn line(mut pairs: Vec<(f32, f32)>) -> Self {
        const LEAST: usize = 200;
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let (dark, bright) = pairs.split_at(pairs.len() / 2);
        let mut line = Self { offset_dn: 0.0, slope: 1.0, bright_dn: 0.0 };
        if pairs.len() < LEAST || bright[0].0 <= 0.0 {
            return line;
        }
        line.bright_dn = f64::from(bright[bright.len() / 2].0);
        let middle = |values: &mut Vec<f32>| f64::from(median(values));
        for _ in 0..5 {
            let offset = line.offset_dn as f32;
            line.slope = middle(&mut bright.iter().map(|(s, x)| (x - offset) / s).collect());
            let slope = line.slope as f32;
            line.offset_dn = middle(&mut dark.iter().map(|(s, x)| x - slope * s).collect());
        }
        line
    }
}
