//! Shapes: what no effect of the catalogue describes, with its place and its amount.
//!
//! A detector per shape reads the moments of both halves of a set, one file each. It estimates
//! from the frames to fit, by least squares or likelihood, asks the held-out frames, and lets the
//! laws of the catalogue that are nearest compete. What it finds is taken out of the moments, or
//! else the statistics that show it are set aside, and the search for names runs on the rest: so
//! a name of the catalogue is neither given to a shape nor withheld because of one.
//!
//! What is found stands in the report with the status `proposed`. A stage of the sensor model runs
//! it (`[[effect]] kind = "empirical"`): the improved camera has it, and is judged with it on the
//! frames as they were measured.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

#[cfg(test)]
mod bench;
mod blocks;
mod dark_law;
mod droop;
mod line_noise;
mod outliers;
mod profile;
mod run;
mod seam;
mod seen;
mod serial;
mod stage;
mod start_up;
mod steps;
mod stitch;
mod view;
mod wave;

use crate::seen::Seen;
use crate::view::View;
use camrig_camera::Camera;
use camrig_camera::empirical::Empirical;
use camrig_diagnose::data::design::Design;
use camrig_diagnose::finding::Finding;
use camrig_diagnose::statistics::statistic::Key;
use camrig_diagnose::statistics::temporal::Temporal;
pub use run::run;

/// False alarms of a detector per set, of what it looks at taken together: with some ten detectors
/// one set of a hundred, before the held-out frames are asked.
const FALSE_ALARMS: f64 = 1e-3;

/// A shape that was found.
trait Shape {
    /// Takes it out of the moments of a half.
    fn take_out(&self, camera: &Camera, design: &Design, stacks: &mut [Temporal]);

    /// Whether a statistic shows it although it was taken out: its scatter, or its law.
    fn sets_aside(&self, _design: &Design, _key: &Key) -> bool {
        false
    }

    /// The stages that run it. What they have in the place of the camera's own figures is taken
    /// from these.
    fn stages(&self, camera: &mut Camera, design: &Design) -> Vec<Empirical>;

    /// What some moments show of it.
    fn seen(&self, view: &View<'_>) -> Option<Seen>;

    /// What it is.
    fn findings(&self) -> Vec<Finding>;
}

/// What a detector found, as shapes of any kind.
fn shapes<S: Shape + 'static>(found: impl IntoIterator<Item = S>) -> Vec<Box<dyn Shape>> {
    found.into_iter().map(|shape| Box::new(shape) as Box<dyn Shape>).collect()
}
