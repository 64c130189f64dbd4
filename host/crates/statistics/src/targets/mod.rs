//! What is measured in captures of targets: slanted edges, grids of dots, ColorCheckers.
//!
//! The frames of a target are reduced to a [`Picture`]: their mean, and for a ColorChecker the
//! scatter within the patches of each frame. [`battery`] computes the statistics, of measured and
//! simulated frames alike, so that any bias of the measurement (sampling through a colour filter
//! array, the window on the edge, the square on a patch) is in both.

mod chart;
mod dots;
mod edge;
mod figures;
mod measured;
mod patches;
mod picture;

pub use dots::RINGS;
pub use figures::{battery, figures};
pub use measured::MeasuredFigure;
pub use picture::{Picture, PictureCollector, densest_channel};
