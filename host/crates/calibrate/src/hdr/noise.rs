//! Noise of the exposures, and the weighted mean that it asks for.

use super::Shots;
use camrig_base::median::{SD_PER_MAD, median};
use camrig_base::{Error, Result};
use camrig_vector::vectorised;
use rayon::prelude::*;

/// Variance of a pixel of one frame: read² + K · signal, DN.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Noise {
    /// Variance per signal, DN (the system gain, DN per electron).
    pub gain_dn: f64,
    /// Variance without light, DN².
    pub read_dn2: f64,
}

/// Pixels of one exposure: signals in DN, saturated above `top`.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    pub(super) seconds: f32,
    pub(super) frames: f32,
    pub(super) top: f32,
    pub(super) signals: &'a [f32],
}

/// Pixels that are worked on side by side.
pub(super) const SIDE: usize = 64;

/// The next [`SIDE`] values; beyond the end `fill`.
#[inline(always)]
pub(super) fn load(values: &[f32], first: usize, fill: f32) -> [f32; SIDE] {
    let values = &values[first..];
    match values.first_chunk() {
        Some(whole) => *whole,
        None => {
            let mut out = [fill; SIDE];
            out[..values.len()].copy_from_slice(values);
            out
        }
    }
}

impl Seen<'_> {
    /// The next [`SIDE`] signals, 0 where saturated, and 1 where they are not: sums need no
    /// branches.
    #[inline(always)]
    pub(super) fn usable(&self, first: usize) -> ([f32; SIDE], [f32; SIDE]) {
        let mut signals = load(self.signals, first, f32::INFINITY);
        let mut usable = [0.0; SIDE];
        let top = self.top;
        for i in 0..SIDE {
            usable[i] = if signals[i] <= top { 1.0 } else { 0.0 };
            signals[i] = if signals[i] <= top { signals[i] } else { 0.0 };
        }
        (signals, usable)
    }
}

impl Noise {
    /// Variance of one frame at a signal.
    #[inline(always)]
    pub(super) fn variance(self, signal: f32) -> f32 {
        let light = if signal > 0.0 { signal } else { 0.0 };
        self.read_dn2 as f32 + self.gain_dn as f32 * light
    }

    /// Merges pixels: value, DN/s, and standard deviation, infinite where no exposure can be used.
    pub(super) fn merge(self, seen: &[Seen<'_>], value: &mut [f32], sigma: &mut [f32]) {
        merge(self, seen, value, sigma);
    }

    /// Measures the noise on neighbouring exposures: the shorter one's difference from what the
    /// longer one says, in 24 classes of signal, its variance from the median absolute difference
    /// (which what moved does not change), fitted by a line.
    pub(super) fn measure(shots: &Shots<'_>, limit_dn: f32) -> Result<Self> {
        const CLASSES: usize = 24;
        // Of each pair and class: weight, and what the two unknowns and the variance are
        // multiplied with.
        let pairs = shots.exposures.par_windows(2).map(|pair| {
            let (short, long) = (&pair[0], &pair[1]);
            let ratio = short.seconds / long.seconds;
            let mut classes: Vec<Vec<f32>> = vec![Vec::new(); CLASSES];
            let mut signals = [0.0f64; CLASSES];
            let top = (f64::from(limit_dn) * ratio) as f32;
            // An odd step visits every column and channel; 250 000 differences determine the
            // variance to 1 % per class.
            let step = (short.signal.data.len() >> 18) | 1;
            let both = short.signal.data.iter().zip(&long.signal.data).step_by(step);
            for (&x, &y) in both {
                let expected = y * ratio as f32;
                if x <= shots.top && y <= shots.top && expected < top {
                    // Narrower classes in the dark, where most of a wide range lies.
                    let class = ((expected / top).max(0.0).sqrt() * CLASSES as f32) as usize;
                    let class = class.min(CLASSES - 1);
                    classes[class].push(x - expected);
                    signals[class] += f64::from(expected);
                }
            }
            let of_class = |(mut differences, signal): (Vec<f32>, f64)| {
                if differences.len() < 100 {
                    return None;
                }
                let count = differences.len() as f64;
                let centre = median(&mut differences, f32::total_cmp);
                differences.iter_mut().for_each(|v| *v = (*v - centre).abs());
                let deviation = SD_PER_MAD * f64::from(median(&mut differences, f32::total_cmp));
                let signal = (signal / count).max(0.0);
                // variance = read² (1/n + ratio²/m) + K signal (1/n + ratio/m)
                let p = 1.0 / short.frames as f64 + ratio * ratio / long.frames as f64;
                let q = signal * (1.0 / short.frames as f64 + ratio / long.frames as f64);
                let variance = deviation * deviation;
                // A variance from n values is uncertain by its own size.
                let weight = count / (variance + p / 12.0).powi(2);
                Some((weight, p, q, variance))
            };
            classes.into_iter().zip(signals).filter_map(of_class).collect::<Vec<_>>()
        });
        let classes: Vec<Vec<(f64, f64, f64, f64)>> = pairs.collect();
        let (mut a, mut b, mut c, mut d, mut e) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (weight, p, q, variance) in classes.into_iter().flatten() {
            a += weight * p * p;
            b += weight * p * q;
            c += weight * q * q;
            d += weight * p * variance;
            e += weight * q * variance;
        }
        let determinant = a * c - b * b;
        if a == 0.0 || determinant <= 1e-12 * a * c {
            return Err(Error::input("no two exposures share enough unsaturated pixels")
                .help("shoot exposures a factor of 2 to 8 apart"));
        }
        // Rounding alone gives 1/12; a noise-free series has no more.
        let read = ((c * d - b * e) / determinant).max(1.0 / 12.0);
        let gain = ((e - b * read) / c).max(0.0);
        Ok(Self { gain_dn: gain, read_dn2: read })
    }
}

/// See [`Noise::merge`].
#[vectorised]
fn merge(noise: Noise, seen: &[Seen<'_>], value: &mut [f32], sigma: &mut [f32]) {
    for first in (0..value.len()).step_by(SIDE) {
        let (mut signal, mut time) = ([0.0f32; SIDE], [0.0f32; SIDE]);
        for e in seen {
            let (x, usable) = e.usable(first);
            let (frames, exposed) = (e.frames, e.seconds * e.frames);
            for i in 0..SIDE {
                signal[i] += x[i] * frames;
                time[i] += usable[i] * exposed;
            }
        }
        let mut rate = [0.0f32; SIDE];
        for i in 0..SIDE {
            rate[i] = signal[i] / time[i];
        }
        let (mut weighted, mut weights) = ([0.0f32; SIDE], [0.0f32; SIDE]);
        for e in seen {
            let (x, usable) = e.usable(first);
            let (seconds, exposed) = (e.seconds, e.seconds * e.frames);
            for i in 0..SIDE {
                let weight = exposed / noise.variance(rate[i] * seconds);
                weighted[i] += x[i] * weight;
                weights[i] += usable[i] * (seconds * weight);
            }
        }
        let (mut mean, mut deviation) = ([0.0f32; SIDE], [0.0f32; SIDE]);
        for i in 0..SIDE {
            let seen = weights[i] > 0.0;
            mean[i] = if seen { weighted[i] / weights[i] } else { 0.0 };
            deviation[i] = if seen { 1.0 / weights[i].sqrt() } else { f32::INFINITY };
        }
        let count = SIDE.min(value.len() - first);
        value[first..first + count].copy_from_slice(&mean[..count]);
        sigma[first..first + count].copy_from_slice(&deviation[..count]);
    }
}
