//! Shapes: what no effect of the catalogue describes, with its place and its amount.
//!
//! Each shape has a detector, in a file of its own, that reads the moments of both halves of a set.
//! It fits the shape to the frames to fit, by least squares or likelihood, confirms it in the
//! held-out frames, and compares it with the nearest effects of the catalogue. What it finds is
//! subtracted from the moments, or the statistics that show it are left out, and the search names
//! effects in the rest: so no effect of the catalogue is named in place of a shape, and none is
//! missed because of one.
//!
//! A shape has the status `proposed` in the report. A stage of the sensor model simulates it
//! (`[[effect]] kind = "empirical"`): the improved camera has that stage, and is evaluated with it
//! on the frames as they were measured.

#[cfg(test)]
mod bench;
mod blocks;
mod dark_law;
pub(crate) mod detectors;
mod droop;
mod line_noise;
mod lines;
mod outliers;
mod parts;
mod profile;
mod seam;
mod seen;
mod serial;
pub(crate) mod shown;
pub(crate) mod stage;
pub(crate) mod start_up;
mod steps;
mod stitch;
mod view;
mod wave;

use self::seen::Seen;
use self::view::View;
use crate::data::design::Design;
use crate::finding::Finding;
use crate::statistics::statistic::Key;
use crate::statistics::temporal::Temporal;
use camrig_camera::Camera;
use camrig_camera::empirical::Empirical;

/// False-alarm rate of a detector per set, corrected for multiple comparisons: with some ten
/// detectors 1 in 100 sets, before the held-out frames are compared.
const FALSE_ALARMS: f64 = 1e-3;

/// A shape that was found.
pub(crate) trait Shape {
    /// Subtracts it from the moments of a half.
    fn subtract(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]);

    /// Whether a statistic shows it although it was subtracted: its scatter, or its law.
    fn shows_in(&self, _design: &Design, _key: &Key) -> bool {
        false
    }

    /// The stages that simulate it. Amounts that they model instead of the camera's own parameters
    /// are subtracted from those.
    fn stages(&self, camera: &mut Camera, design: &Design) -> Vec<Empirical>;

    /// How it appears in some moments, as a curve or a map.
    fn seen(&self, view: &View<'_>) -> Option<Seen>;

    /// Its findings: one for each of its parts.
    fn findings(&self) -> Vec<Finding>;
}

/// Boxes what a detector found.
fn shapes<S: Shape + 'static>(found: impl IntoIterator<Item = S>) -> Vec<Box<dyn Shape>> {
    found.into_iter().map(|shape| Box::new(shape) as Box<dyn Shape>).collect()
}
