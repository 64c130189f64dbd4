//! Estimates of what a sensor does, each from the statistic that shows it: gain from the variance
//! over the mean, dark current from the means over exposure, row noise from the row means.
//!
//! [`estimate`] takes the dark and flat stacks of one gain and returns [`Estimates`]. Each figure
//! has its own standard error and stands on its own, whatever else is found in the frames. What
//! leaks into a figure is removed first: torn frames, offsets of frames and sites, light that
//! flickers, pixels that stand out. Extreme pixels do not rule: centres are medians or clipped
//! means, widths come from quantiles.
//!
//! Samples are DN, exposures s. Standard errors are statistical: from the scatter over pixels, rows
//! or frames, from order statistics, or by leaving out one frame at a time.
//!
//! | in reading order | |
//! |---|---|
//! | [`stack`] | frames of one exposure in memory, the sites of the colour filter pattern |
//! | [`robust`] | medians, clipping, quantiles with standard errors |
//! | [`torn`] | frames whose lower rows are of another exposure |
//! | [`bias`] | black level, read noise, noise of rows and frames, offset patterns |
//! | [`rows`] | white and 1/f noise of rows |
//! | [`areas`] | rows, parts of lines and clusters that stand out |
//! | `transfer` | charge that a CCD leaves behind |
//! | [`flat`] | flicker, gain, PRNU, defective columns and areas |
//! | [`prnu`] | the gain's spread over pixels, in its own part and what neighbours share |
//! | [`dark`] | dark current, its pattern, hot pixels, offsets from frame to frame |
//! | [`drift`] | levels that wander from frame to frame, with their memory |
//! | [`gains`] | noise and patterns behind the gain, from the bias at several gains |
//! | [`telegraph`] | pixels that blink: of the read-out, or of the dark current |
//! | [`blinking`] | those of the read-out: how many, how far and between which levels |
//! | [`converter`] | errors of the weights of the converter's bits |
//!
//! ```
//! use camrig_captures::Role;
//! use camrig_estimates::{Sites, Stack, base::Plane, estimate};
//!
//! // Sixteen dark frames at 64 DN, with noise of one DN from a hash of the position.
//! let noise = |x: usize, y: usize, t: usize| {
//!     let mut h = (x + 97 * y + 7919 * t) as u64;
//!     let mut sum = 0;
//!     for _ in 0..12 {
//!         h = (h ^ 0x9e37_79b9).wrapping_mul(0xbf58_476d_1ce4_e5b9);
//!         h ^= h >> 29;
//!         sum += h % 1024;
//!     }
//!     sum as f64 / 1024.0 - 6.0 // twelve uniform numbers: variance 1
//! };
//! let frame = |t| Plane::from_fn(48, 48, |x, y| (64.0 + noise(x, y, t)).round() as u16);
//! let dark = Stack::new("dark", Role::Dark, 0.0, (0..16).map(frame).collect());
//! let found = estimate(&[dark], Sites { across: 1, down: 1 }, 0.5)?;
//! let read_noise = found.bias.read_noise_variance; // DN²
//! assert!((read_noise.value - 1.0).abs() < 0.1);
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod areas;
pub mod bias;
pub mod blinking;
pub mod converter;
pub mod dark;
pub mod drift;
pub mod flat;
pub mod gains;
pub mod prnu;
pub mod robust;
pub mod rows;
pub mod stack;
pub mod telegraph;
pub mod torn;
mod transfer;

pub use camrig_base as base;
pub use stack::{Sites, Stack};

use camrig_base::{Error, Result, Value};
use camrig_captures::Role;
use rayon::prelude::*;
use std::cmp::Ordering;

/// What the stacks of one gain show.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Estimates {
    /// Frames whose rows from some row on are of another exposure.
    pub torn: Vec<torn::Torn>,
    /// Of the dark stack with the shortest exposure.
    pub bias: bias::Bias,
    /// Of each flat stack.
    pub flats: Vec<flat::Flat>,
    /// The parts of the pixels' gain, over all flats; none without light.
    pub prnu: Option<prnu::Prnu>,
    /// DN per electron: the mean over flat stacks and sites.
    pub gain: Option<Value>,
    /// Variance over pixels of the offset at exposure 0, DN²; none where the exposures of the dark
    /// stacks are too near to tell offsets from dark current.
    pub pixel_offsets: Option<Value>,
    /// Of the dark stacks over exposure.
    pub dark_current: Option<dark::DarkCurrent>,
    /// Offsets from frame to frame, pooled over the dark stacks.
    pub frame_offsets: Option<dark::FrameOffsets>,
    /// Pixels that blink.
    pub telegraph: telegraph::Telegraph,
    /// What lies behind the gain; none where all dark stacks have the same.
    pub behind_gain: Option<gains::BehindGain>,
    size: (usize, usize),
}

impl Estimates {
    /// Columns and rows of the frames.
    pub fn size(&self) -> (usize, usize) {
        self.size
    }
}

/// Estimates everything that the dark and flat stacks of one analog gain show: that of the most
/// stacks, of several the lowest. The dark stack with the shortest exposure is the bias, and that
/// of each other gain tells what lies behind the gain; stacks of other roles are ignored. Where no
/// flat shows the gain, shot noise is that of `dn_per_e`.
///
/// # Errors
/// No dark stack with two frames or more; frames of different sizes, or smaller than 16 pixels.
pub fn estimate(stacks: &[Stack], sites: Sites, dn_per_e: f64) -> Result<Estimates> {
    let mut of_gains: Vec<&Stack> = stacks.iter().filter(|s| s.role == Role::Dark).collect();
    of_gains.sort_by(|a, b| a.exposure_s.total_cmp(&b.exposure_s));
    let main = main_gain(stacks);
    let is_main = |s: &&Stack| s.analog_gain == main;
    let darks: Vec<&Stack> = of_gains.iter().copied().filter(is_main).collect();
    let Some(shortest) = darks.first().filter(|s| s.frames.len() >= 2) else {
        return Err(Error::input("no dark stack with two frames or more")
            .help("take some ten dark frames at the shortest exposure"));
    };
    let size = shortest.size();
    if size.0.min(size.1) < 16 || stacks.iter().any(|s| s.size() != size) {
        return Err(Error::input("frames of different sizes, or smaller than 16 pixels"));
    }
    let torn = torn::find(&darks);
    let bias = bias::Bias::of(shortest, sites);
    let longest = darks.last().filter(|s| s.exposure_s > dark::MIN_SPAN * shortest.exposure_s);
    let pixel_offsets = longest
        .and_then(|long| bias::offsets_at_0(shortest, long, torn::holds(&torn, long), sites));
    let flat_stacks = stacks.iter().filter(is_main);
    let flat_stacks = flat_stacks.filter(|s| s.role == Role::Flat && s.frames.len() >= 2);
    let mut gains = prnu::Gains::default();
    let of_flat = |stack: &Stack| {
        let (flat, halves) = flat::Flat::with_gains(stack, &bias, sites);
        gains.add(&flat, stack.frames.len(), &halves);
        flat
    };
    let flats: Vec<flat::Flat> = flat_stacks.map(of_flat).collect();
    let gain = Value::combine(flats.iter().flat_map(|f| f.sites.iter().map(|s| s.gain)));
    let darks: Vec<dark::Dark<'_>> =
        darks.par_iter().map(|stack| dark::Dark::read(stack, &torn)).collect();
    let dn_per_e = gain.map_or(dn_per_e, |g| g.value);
    let dark_current = dark::DarkCurrent::of(&darks, &bias, sites, dn_per_e);
    let frame_offsets = dark::FrameOffsets::of(&darks, &bias, dn_per_e);
    let telegraph = telegraph::Telegraph::of(&darks, &bias, dn_per_e);
    let mut biases = vec![(main, bias.clone())];
    for stack in of_gains.iter().filter(|s| s.frames.len() >= 2) {
        if !biases.iter().any(|(gain, _)| *gain == stack.analog_gain) {
            biases.push((stack.analog_gain, bias::Bias::of(stack, sites)));
        }
    }
    let behind_gain = gains::BehindGain::of(&biases);
    Ok(Estimates {
        torn,
        bias,
        flats,
        prnu: gains.prnu(size.0),
        gain,
        pixel_offsets,
        dark_current,
        frame_offsets,
        telegraph,
        behind_gain,
        size,
    })
}

/// The analog gain of the most stacks, of several the lowest.
fn main_gain(stacks: &[Stack]) -> f64 {
    let count = |gain: f64| stacks.iter().filter(|s| s.analog_gain == gain).count();
    let better = |a: f64, b: f64| match count(b).cmp(&count(a)) {
        Ordering::Greater => b,
        Ordering::Equal => a.min(b),
        Ordering::Less => a,
    };
    stacks.iter().map(|s| s.analog_gain).reduce(better).unwrap_or(1.0)
}

#[cfg(test)]
mod tests;
