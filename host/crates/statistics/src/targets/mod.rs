//! What is measured in captures of targets: slanted edges, grids of dots, ColorCheckers.
//!
//! Of the frames of a target a [`Picture`] is kept: their mean, and for a ColorChecker the scatter
//! within the patches of each. [`battery`] makes statistics of it, from measured frames and from
//! simulated ones alike, so that what the measurement itself does to a figure (sampling through a
//! colour filter array, the window on the edge, the square on a patch) is in both.

mod chart;
mod dots;
mod edge;
mod figures;
mod patches;
mod picture;

pub use dots::RINGS;
pub use figures::{battery, figures};
pub use picture::{Picture, PictureCollector, densest_channel};
