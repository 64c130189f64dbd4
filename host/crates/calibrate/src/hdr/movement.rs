//! What moved between exposures, and what only looks as if it had: an exposure whose black or time
//! is a little off as a whole.

use super::super::exposures::Exposure;
use super::noise::{Noise, SIDE, Seen, load};
use super::{Flag, Shots};
use camrig_base::Cfa;
use camrig_base::median::median;
use camrig_base::{Error, ErrorCode, Result};
use camrig_vector::vectorised;
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;

/// A systematic difference between exposures that is no movement, relative: what differs over the
/// field and over the curve is beyond a [`Departure`].
const ALLOWANCE: f32 = 0.05;
/// Codes are whole DN: half a DN of the exposure and half a DN of what it is compared with.
const STEPS_DN: f32 = 1.0;
/// Half of the neighbourhood's edge.
pub(super) const AROUND: usize = 4;
/// The neighbourhood's edge.
const SPAN: usize = 2 * AROUND + 1;

/// What each exposure sees where nothing moved.
pub(super) struct Still {
    noise: Noise,
    /// Per row of the pattern and exposure the line of each column.
    lines: Vec<Vec<[Vec<f32>; 2]>>,
}

impl Still {
    /// From a sample of the pixels.
    ///
    /// # Errors
    /// An exposure whose light contradicts its time.
    pub(super) fn measure(shots: &Shots<'_>, cfa: &Cfa, noise: Noise, limit: f32) -> Result<Self> {
        let samples = Samples::of(shots, cfa);
        samples.check_times(limit)?;
        let departures = samples.departures(noise);
        let width = shots.size().0;
        let lines = (0..cfa.height).map(|y| {
            let column = |d: &[Departure], f: fn(&Departure) -> f64| {
                (0..width).map(|x| f(&d[cfa.channel(x, y)]) as f32).collect()
            };
            let line = |d: &Vec<Departure>| [column(d, |d| d.offset_dn), column(d, |d| d.slope)];
            departures.iter().map(line).collect()
        });
        Ok(Self { noise, lines: lines.collect() })
    }

    /// Room for the neighbourhoods of a run of rows.
    pub(super) fn around(&self, width: usize, height: usize) -> Around<'_> {
        let rows = || std::array::from_fn(|_| vec![0.0; width]);
        let padded = || vec![0.0; width + 2 * AROUND];
        Around {
            still: self,
            height,
            chi_square: rows(),
            freedom: rows(),
            padded: [padded(), padded()],
        }
    }
}

/// χ² and degrees of freedom of the last [`SPAN`] rows, summed over as many columns.
pub(super) struct Around<'a> {
    still: &'a Still,
    height: usize,
    chi_square: [Vec<f32>; SPAN],
    freedom: [Vec<f32>; SPAN],
    padded: [Vec<f32>; 2],
}

impl Around<'_> {
    /// The rows that tell of `count` rows from `first` on.
    pub(super) fn rows(&self, first: usize, count: usize) -> Range<usize> {
        first.saturating_sub(AROUND)..(first + count + AROUND).min(self.height)
    }

    /// Whether all rows about `y` have been added when `last` was the last.
    pub(super) fn knows(&self, y: usize, last: usize) -> bool {
        (y + AROUND).min(self.height - 1) <= last
    }

    /// Adds row `y`, whose merged values are `radiance`.
    pub(super) fn add(&mut self, y: usize, seen: &[Seen<'_>], radiance: &[f32]) {
        let lines = &self.still.lines[y % self.still.lines.len()];
        let [chi, free] = self.padded.each_mut().map(|p| &mut p[AROUND..][..radiance.len()]);
        disagreement(self.still.noise, seen, lines, radiance, chi, free);
        sum_columns(&self.padded[0], &mut self.chi_square[y % SPAN]);
        sum_columns(&self.padded[1], &mut self.freedom[y % SPAN]);
    }

    /// Flags where exposures disagree with the merged frame within 9 x 9 pixels about row `y`: the
    /// mean χ² per degree of freedom is above 1.5 by six of its own standard deviations.
    pub(super) fn find_moved(&self, y: usize, flags: &mut [u8]) {
        let rows =
            || (y.saturating_sub(AROUND)..(y + AROUND + 1).min(self.height)).map(|y| y % SPAN);
        let chi: Vec<&[f32]> = rows().map(|y| &self.chi_square[y][..]).collect();
        let free: Vec<&[f32]> = rows().map(|y| &self.freedom[y][..]).collect();
        flag_moved(&chi, &free, flags);
    }
}

#[vectorised]
fn flag_moved(chi: &[&[f32]], free: &[&[f32]], flags: &mut [u8]) {
    for first in (0..flags.len()).step_by(SIDE) {
        let (mut sum, mut freedom) = ([0.0f32; SIDE], [0.0f32; SIDE]);
        for (chi, free) in chi.iter().zip(free) {
            let (chi, free) = (load(chi, first, 0.0), load(free, first, 0.0));
            for i in 0..SIDE {
                sum[i] += chi[i];
                freedom[i] += free[i];
            }
        }
        let mut moved = [0; SIDE];
        for i in 0..SIDE {
            // χ²/n > 1.5 + 6 sqrt(2/n)
            let most = 1.5 * freedom[i] + 6.0 * (2.0 * freedom[i]).sqrt();
            let differs = (freedom[i] > 0.0) & (sum[i] > most);
            moved[i] = if differs { Flag::Moved as u8 } else { Flag::Merged as u8 };
        }
        let count = SIDE.min(flags.len() - first);
        flags[first..first + count].copy_from_slice(&moved[..count]);
    }
}

/// Per pixel Σ (x − what the exposure sees of E t)² / variance, and the exposures less one.
#[vectorised]
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
            let (x, usable) = e.usable(first);
            let (offset, slope) = (load(offset, first, 0.0), load(slope, first, 1.0));
            let (seconds, per_frame) = (e.seconds, 1.0 / e.frames);
            for i in 0..SIDE {
                let expected = light[i] * seconds;
                let rest = x[i] - (offset[i] + slope[i] * expected);
                let allowed = ALLOWANCE * expected + STEPS_DN;
                let variance = noise.variance(expected) * per_frame + allowed * allowed;
                sum[i] += usable[i] * (rest * rest / variance);
                count[i] += usable[i];
            }
        }
        for count in &mut count {
            *count = if *count > 0.0 { *count } else { 0.0 };
        }
        let n = SIDE.min(radiance.len() - first);
        chi_square[first..first + n].copy_from_slice(&sum[..n]);
        freedom[first..first + n].copy_from_slice(&count[..n]);
    }
}

/// Sums over the columns about each; `padded` has [`AROUND`] zeros more on either side.
#[vectorised]
fn sum_columns(padded: &[f32], out: &mut [f32]) {
    for first in (0..out.len()).step_by(SIDE) {
        let mut sum = [0.0f32; SIDE];
        for shift in 0..SPAN {
            let values = load(padded, first + shift, 0.0);
            for i in 0..SIDE {
                sum[i] += values[i];
            }
        }
        let count = SIDE.min(out.len() - first);
        out[first..first + count].copy_from_slice(&sum[..count]);
    }
}

/// Some pixels of every exposure.
struct Samples<'a> {
    shots: &'a Shots<'a>,
    cfa: &'a Cfa,
    /// From one pixel to the next.
    step: usize,
    signals: Vec<Vec<f32>>,
}

impl<'a> Samples<'a> {
    fn of(shots: &'a Shots<'a>, cfa: &'a Cfa) -> Self {
        const SAMPLES: usize = 1 << 16;
        let (width, height) = shots.size();
        // An odd step visits every column and channel.
        let step = (width * height / SAMPLES) | 1;
        let sample = |e: &Cow<'_, Exposure>| -> Vec<f32> {
            e.signal.data.iter().step_by(step).copied().collect()
        };
        Self { shots, cfa, step, signals: shots.exposures.par_iter().map(sample).collect() }
    }

    /// Refuses an exposure whose light contradicts its time, and so the exposures next to it, by
    /// more than shutters and lamps do.
    fn check_times(&self, limit: f32) -> Result<()> {
        const CONTRADICTION: f64 = 1.2;
        // A black that is off, of either exposure, is no contradiction: of full scale.
        const BLACK: f64 = 0.01;
        let exposures = &self.shots.exposures;
        let pairs = (1..exposures.len()).into_par_iter().map(|i| {
            let ratio = exposures[i].seconds / exposures[i - 1].seconds;
            let expected = |k: usize| (f64::from(self.signals[i - 1][k]) * ratio) as f32;
            let usable = |k: usize| self.signals[i - 1][k] <= self.shots.top;
            self.lines(i, |k| usable(k).then(|| expected(k)))
        });
        let pairs: Vec<Vec<Departure>> = pairs.collect();
        for channel in 0..self.cfa.channels().len() {
            // From each exposure to the next: ln of the factor, and whether no black explains it.
            let apart = |(i, pair): (usize, &Vec<Departure>)| {
                let (expected, seen) = (pair[channel].bright_dn, pair[channel].seen());
                let ratio = exposures[i + 1].seconds / exposures[i].seconds;
                let black = BLACK * (1.0 + ratio) * f64::from(limit);
                let factor = if expected > 0.0 { (seen / expected).max(1e-3) } else { 1.0 };
                (libm::log(factor), (seen - expected).abs() > black)
            };
            let apart: Vec<(f64, bool)> = pairs.iter().enumerate().map(apart).collect();
            let beyond = |d: f64| d.abs() > libm::log(CONTRADICTION);
            let sure = apart.iter().enumerate().filter(|(_, (d, sure))| *sure && beyond(*d));
            let Some((pair, &(most, _))) =
                sure.max_by(|(_, a), (_, b)| a.0.abs().total_cmp(&b.0.abs()))
            else {
                continue;
            };
            // The one of the two that contradicts its other neighbour the other way; at the ends
            // there is none.
            let back = |other: Option<&(f64, bool)>| {
                other.is_some_and(|&(d, _)| beyond(d) && d * most < 0.0)
            };
            let first = pair == 0 && apart.len() > 1 && !back(apart.get(1));
            let earlier = first || (pair > 0 && back(apart.get(pair - 1)));
            let (wrong, factor) = if earlier { (pair, -most) } else { (pair + 1, most) };
            let Exposure { id, seconds, .. } = &*exposures[wrong];
            return Err(Error::disagreement(format!(
                "capture {id:?} has {:.2} times the light that its exposure time of {seconds} s \
                 and the other captures say",
                libm::exp(factor)
            ))
            .help(
                "correct the exposure_s that is wrong, or leave that capture out; a camera that \
                 is not linear needs its response",
            )
            .with_code(ErrorCode::ExposureTime));
        }
        Ok(())
    }

    /// What each exposure sees of the merged frame, per channel.
    fn departures(&self, noise: Noise) -> Vec<Vec<Departure>> {
        let both = self.shots.exposures.iter().zip(&self.signals);
        let seen: Vec<Seen<'_>> = both.map(|(e, signals)| self.shots.pixels(e, signals)).collect();
        let count = self.signals[0].len();
        let mut radiance = vec![0.0; count];
        noise.merge(&seen, &mut radiance, &mut vec![0.0; count]);
        let of_exposure = |i: usize| {
            let seconds = self.shots.exposures[i].seconds;
            self.lines(i, |k| Some((f64::from(radiance[k]) * seconds) as f32))
        };
        (0..self.signals.len()).into_par_iter().map(of_exposure).collect()
    }

    /// The lines of the channels of exposure `i` over what is expected of its samples.
    fn lines(&self, i: usize, expected: impl Fn(usize) -> Option<f32>) -> Vec<Departure> {
        let width = self.shots.size().0;
        let mut pairs: Vec<Vec<(f32, f32)>> = vec![Vec::new(); self.cfa.channels().len()];
        for (k, &signal) in self.signals[i].iter().enumerate() {
            if signal <= self.shots.top
                && let Some(expected) = expected(k)
            {
                let at = k * self.step;
                pairs[self.cfa.channel(at % width, at / width)].push((expected, signal));
            }
        }
        pairs.into_iter().map(Departure::line).collect()
    }
}

/// What one exposure sees of a channel where the others estimate s: offset + slope · s.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Departure {
    offset_dn: f64,
    slope: f64,
    /// The median s of the brighter half of the pixels.
    bright_dn: f64,
}

impl Departure {
    /// At `bright_dn`.
    fn seen(self) -> f64 {
        self.offset_dn + self.slope * self.bright_dn
    }

    /// Slope from the brighter half of the pairs (s, signal), offset from the darker, each as a
    /// median: what moved is a minority in both, and has no leverage. Fewer pairs than 200 tell
    /// nothing.
    fn line(mut pairs: Vec<(f32, f32)>) -> Self {
        const LEAST: usize = 200;
        let mut line = Self { offset_dn: 0.0, slope: 1.0, bright_dn: 0.0 };
        if pairs.len() < LEAST {
            return line;
        }
        let order = |a: &(f32, f32), b: &(f32, f32)| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1));
        let half = pairs.len() / 2;
        pairs.select_nth_unstable_by(half, order);
        let (dark, bright) = pairs.split_at_mut(half);
        if bright[0].0 <= 0.0 {
            return line;
        }
        let half = bright.len() / 2;
        line.bright_dn = f64::from(bright.select_nth_unstable_by(half, order).1.0);
        let middle = |values: &mut Vec<f32>| f64::from(median(values, f32::total_cmp));
        for _ in 0..5 {
            let offset = line.offset_dn as f32;
            line.slope = middle(&mut bright.iter().map(|(s, x)| (x - offset) / s).collect());
            let slope = line.slope as f32;
            line.offset_dn = middle(&mut dark.iter().map(|(s, x)| x - slope * s).collect());
        }
        line
    }
}
