//! From the frames of a capture set to statistics: moments over time and over the sensor, maps,
//! figures of targets, and the battery of all of them.
//!
//! The same functions take measured frames and those of a model, so that any bias of a measurement
//! is in both. The principal type is [`Statistic`]; [`battery`](battery::battery) computes all of
//! them. Values are in DN of the frames unless stated otherwise; light is in electrons per pixel,
//! frequencies in cycles per pixel.
//!
//! | in reading order | |
//! |---|---|
//! | [`statistic`] | what a statistic is: where, what, value, standard deviation, scale |
//! | [`data`] | the stacks of a capture set, their conditions, and which half they belong to |
//! | [`read`] | frames from files into moments and pictures |
//! | [`temporal`], [`noise`], [`codes`] | moments of a stack over time, and the statistics of its noise and codes |
//! | [`maps`], [`spatial`], [`lines`], [`shading`] | maps made of several stacks, and the statistics of their patterns |
//! | [`ratios`] | ratios of the channels |
//! | [`targets`] | figures of edges, dots and charts |
//! | [`battery`] | all statistics of the dark and flat stacks |
//! | [`allowances`] | uncertainty of the stated light, undetected particle hits |
//! | [`numerics`] | sums, spectra, minima, quantiles of values on a lattice |
//!
//! ```
//! use camrig_statistics::{Place, Scale, Statistic, What, statistic::by_key};
//!
//! // A variance of channel 0 in the first stack, 4.1 DN² ± 2 %.
//! let (place, what) = (Place::Stack(0), What::Variance(0));
//! let found = Statistic { place, what, value: 4.1, sd: 0.02, scale: Scale::Log };
//! let values = by_key(vec![found]);
//! // Compared with a model that predicts 4.0 DN², it deviates by 1.2 standard deviations.
//! let s = values[&(place, what)];
//! let z = (s.scale.of(s.value) - s.scale.of(4.0)) / s.sd;
//! assert!((z - 1.23).abs() < 0.01);
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod allowances;
pub mod battery;
pub mod codes;
mod collect;
pub mod data;
mod levels;
pub mod lines;
pub mod maps;
pub mod noise;
pub mod numerics;
mod patterns;
pub mod quantiles;
pub mod ratios;
pub mod read;
pub mod shading;
pub mod spatial;
pub mod statistic;
pub mod targets;
pub mod temporal;

pub use statistic::{Figure, Key, Place, Scale, Statistic, Values, What};
