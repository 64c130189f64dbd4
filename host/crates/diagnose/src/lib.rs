//! Diagnosis: where do a camera model and captures disagree, which effect is missing, and is the
//! model better with it?
//!
//! [`diagnose()`] takes a camera and a capture set and returns a [`Diagnosis`] with its
//! [`Report`]; [`compare()`] only compares both. Each stage uses only those before it:
//!
//! 1. [`camrig_clean`] removes from the frames what is not the sensor's steady behaviour.
//! 2. [`data`] divides them into frames to fit and held-out frames.
//! 3. [`measured`]: moments of dark and flat stacks, maps, figures of edges, dots and charts, and
//!    the [`statistics`] computed from them. What was measured never changes.
//! 4. [`model`]: replicates of the same stacks simulated by `sensor-core` itself; mean and scatter
//!    of every statistic, deviations, deviance.
//! 5. [`evidence`], [`candidates`]: how large each effect of the catalogue would have to be.
//! 6. `names`: each effect by its own statistic, which the search may start from.
//! 7. [`search`]: forward selection and backward elimination; standard errors.
//! 8. [`shapes`]: what no effect of the catalogue describes. They are subtracted from what was
//!    measured, and the search names effects in the rest.
//! 9. [`verdict`]: the report, statistics in words, the camera file with what was found.
//!
//! The **gap** is the mean over statistics of the squared deviation of the held-out frames from
//! the model, in units of what a replicate of the model scores against other replicates: 1.0 is as
//! good as the right model can be. The **deviance** is twice the negative log-likelihood but for a
//! constant: its fall is the evidence for an effect.
//!
//! ```no_run
//! use camrig_diagnose::{Options, diagnose};
//!
//! # fn main() -> camrig_base::Result<()> {
//! let camera = camrig_camera::Camera::load("camera.toml")?;
//! let set = camrig_captures::CaptureSet::load("captures".as_ref())?;
//! let diagnosis = diagnose(&camera, set, &Options::default())?;
//! for step in &diagnosis.report.steps {
//!     println!("{} ({}): gap {:.2}", step.effect, step.status.word(), step.gap_after);
//! }
//! std::fs::write("improved.toml", diagnosis.improved_file("camera.toml")?.text).unwrap();
//! # Ok(())
//! # }
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod candidates;
mod diagnosis;
pub mod evidence;
mod explanation;
pub mod finding;
pub mod measured;
pub mod model;
mod names;
mod options;
pub mod report;
pub mod search;
pub mod shapes;
pub mod verdict;

pub use camrig_statistics as statistics;
pub use camrig_statistics::{data, numerics};
pub use diagnosis::{Diagnosis, compare, diagnose};
pub use measured::Measured;
pub use options::{Options, Progress};
pub use report::{Comparison, Report};
pub use search::Outcome;
