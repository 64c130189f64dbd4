//! From frames to statistics: moments over time and over the sensor, maps, figures of targets, and
//! the battery of statistics made of them.
//!
//! The same functions take measured frames and those of a model, so that whatever the measurement
//! itself does to a figure is in both.

pub mod battery;
pub mod codes;
mod collect;
mod levels;
pub mod light_scatter;
pub mod maps;
pub mod noise;
mod patterns;
pub mod ratios;
pub mod read;
pub mod shading;
pub mod spatial;
pub mod statistic;
pub mod targets;
pub mod temporal;

pub use statistic::{Figure, Key, Place, Scale, Statistic, Values, What};
