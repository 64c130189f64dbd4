//! Noise of the exposures, and the weighted mean that it asks for.

use super::super::exposures::Exposure;
use crate::{Error, Result};
use multiversion::multiversion;

/// Variance of a pixel of one frame: read² + K · signal, DN.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Noise {
    /// Variance per signal, DN (the system gain, DN per electron).
    pub gain_dn: f64,
    /// Variance without light, DN².
    pub read_dn2: f64,
}

/// Pixels of one exposure: signals in DN, infinite where saturated.
#[derive(Clone, Copy)]
pub(super) struct Seen<'a> {
    pub(super) seconds: f32,
    pub(super) frames: f32,
    pub(super) signals: &'a [f32],
}

impl<'a> Seen<'a> {
    /// Some pixels of an exposure.
    pub(super) fn one(exposure: &Exposure, signals: &'a [f32]) -> Self {
        Self { seconds: exposure.seconds as f32, frames: exposure.frames as f32, signals }
    }

    /// A row of an exposure.
    pub(super) fn row(exposure: &'a Exposure, y: usize) -> Self {
        Self::one(exposure, exposure.signal.row(y))
    }
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

impl Noise {
    /// Variance of the mean of `frames` frames at a signal.
    #[inline(always)]
    pub(super) fn variance(self, signal: f32, frames: f32) -> f32 {
        let light = if signal > 0.0 { signal } else { 0.0 };
        (self.read_dn2 as f32 + self.gain_dn as f32 * light) / frames
    }

    /// Merges pixels: value, DN/s, and standard deviation, infinite where no exposure can be used.
    pub(super) fn merge(self, seen: &[Seen<'_>], value: &mut [f32], sigma: &mut [f32]) {
        merge(self, seen, value, sigma);
    }

    /// Measures the noise on neighbouring exposures: the shorter one's difference from what the
    /// longer one says, in 24 classes of signal, its variance from the median absolute difference
    /// (which what moved does not change), fitted by a line.
    pub fn measure(exposures: &[Exposure], limit_dn: f32) -> Result<Self> {
        const CLASSES: usize = 24;
        // Per class: weight, signal and variance of one frame, summed over pairs.
        let (mut a, mut b, mut c, mut d, mut e) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for pair in exposures.windows(2) {
            let (short, long) = (&pair[0], &pair[1]);
            let ratio = short.seconds / long.seconds;
            let mut classes: Vec<Vec<f32>> = vec![Vec::new(); CLASSES];
            let mut signals = [0.0f64; CLASSES];
            let top = (f64::from(limit_dn) * ratio) as f32;
            // An odd step visits every column and channel; a million differences are plenty.
            let step = (short.signal.data.len() >> 20) | 1;
            let both = short.signal.data.iter().zip(&long.signal.data).step_by(step);
            for (&x, &y) in both {
                let expected = y * ratio as f32;
                if x.is_finite() && y.is_finite() && expected < top {
                    // Narrower classes in the dark, where most of a wide range lies.
                    let class = ((expected / top).max(0.0).sqrt() * CLASSES as f32) as usize;
                    let class = class.min(CLASSES - 1);
                    classes[class].push(x - expected);
                    signals[class] += f64::from(expected);
                }
            }
            for (index, mut differences) in classes.into_iter().enumerate() {
                if differences.len() < 100 {
                    continue;
                }
                let count = differences.len() as f64;
                let centre = median(&mut differences);
                differences.iter_mut().for_each(|v| *v = (*v - centre).abs());
                let deviation = 1.4826 * f64::from(median(&mut differences));
                let signal = (signals[index] / count).max(0.0);
                // variance = read² (1/n + ratio²/m) + K signal (1/n + ratio/m)
                let p = 1.0 / short.frames as f64 + ratio * ratio / long.frames as f64;
                let q = signal * (1.0 / short.frames as f64 + ratio / long.frames as f64);
                let variance = deviation * deviation;
                // A variance from n values is uncertain by its own size.
                let weight = count / (variance + p / 12.0).powi(2);
                a += weight * p * p;
                b += weight * p * q;
                c += weight * q * q;
                d += weight * p * variance;
                e += weight * q * variance;
            }
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
#[multiversion(targets("x86_64+avx512f+avx512vl", "x86_64+avx2", "aarch64+neon"))]
fn merge(noise: Noise, seen: &[Seen<'_>], value: &mut [f32], sigma: &mut [f32]) {
    for first in (0..value.len()).step_by(SIDE) {
        let (mut signal, mut time) = ([0.0f32; SIDE], [0.0f32; SIDE]);
        for e in seen {
            let x = load(e.signals, first, f32::INFINITY);
            for i in 0..SIDE {
                let usable = x[i] < f32::INFINITY;
                signal[i] += if usable { x[i] * e.frames } else { 0.0 };
                time[i] += if usable { e.seconds * e.frames } else { 0.0 };
            }
        }
        let (mut weighted, mut weights) = ([0.0f32; SIDE], [0.0f32; SIDE]);
        for e in seen {
            let x = load(e.signals, first, f32::INFINITY);
            for i in 0..SIDE {
                let expected = signal[i] / time[i] * e.seconds;
                let weight = e.seconds / noise.variance(expected, e.frames);
                let usable = x[i] < f32::INFINITY;
                weighted[i] += if usable { x[i] * weight } else { 0.0 };
                weights[i] += if usable { e.seconds * weight } else { 0.0 };
            }
        }
        let count = SIDE.min(value.len() - first);
        for i in 0..count {
            let seen = weights[i] > 0.0;
            value[first + i] = if seen { weighted[i] / weights[i] } else { 0.0 };
            sigma[first + i] = if seen { 1.0 / weights[i].sqrt() } else { f32::INFINITY };
        }
    }
}

/// The median; reorders.
pub(super) fn median(values: &mut [f32]) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}
