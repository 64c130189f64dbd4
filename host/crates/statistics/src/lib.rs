//! From the frames of a capture set to statistics: moments over time and over the sensor, maps,
//! figures of targets, and the battery of statistics made of them.
//!
//! The same functions take measured frames and those of a model, so that whatever the measurement
//! itself does to a figure is in both. Values are in DN of the frames unless their documentation
//! says otherwise; light is in electrons per pixel, frequencies in cycles per pixel.
//!
//! 1. [`data`]: the stacks of a capture set, how they were taken, which half they belong to.
//! 2. [`temporal`], [`maps`], [`targets`]: moments per pixel and per frame, maps over the sensor,
//!    figures of edges, dots and charts.
//! 3. [`battery`]: every [`Statistic`] of a half, each with its [`Key`] and its standard deviation.
//!
//! ```
//! use camrig_statistics::numerics::tails;
//!
//! // The logarithm of how often a normal deviate is above 1.96 standard deviations.
//! assert!((tails::ln_upper(1.96) - 0.025_f64.ln()).abs() < 1e-3);
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod battery;
pub mod codes;
mod collect;
pub mod data;
mod levels;
pub mod light_scatter;
pub mod maps;
pub mod noise;
pub mod numerics;
mod patterns;
pub mod ratios;
pub mod read;
pub mod shading;
pub mod spatial;
pub mod statistic;
pub mod targets;
pub mod temporal;

pub use statistic::{Figure, Key, Place, Scale, Statistic, Values, What};
