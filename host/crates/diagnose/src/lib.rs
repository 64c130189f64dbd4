//! Diagnosis: where do a camera model and captures disagree, which effect is missing, and is the
//! model better with it?
//!
//! The diagnosis is a pipeline; each stage uses only those before it.
//!
//! 0. [`camrig_clean`]: what in the captures is not the sensor's steady behaviour, found and taken
//!    off before anything is measured.
//! 1. [`data`]: which frames are fitted, which are held out, and how they were taken.
//! 2. [`statistics`]: moments of dark and flat stacks, maps, figures of edges, dots and charts,
//!    and the battery of statistics made of them.
//! 3. [`model`]: replicates of the same stacks by `sensor-core` itself; mean and scatter of every
//!    statistic, deviations, deviance.
//! 4. [`evidence`], [`candidates`]: how large each effect of the catalogue would have to be.
//! 5. [`search`]: forward selection and backward elimination; standard errors.
//! 6. [`verdict`]: the [`report`], statistics in words, the camera file with the effects found.
//!
//! What no effect of the catalogue describes (a [`finding`]) is sought by `camrig-shapes`, which
//! searches for names in what it leaves.
//!
//! The **gap** is the mean over statistics of the squared deviation of the held-out frames from
//! the model, in units of what a replicate of the model scores against other replicates: 1.0 is as
//! good as the right model can be. The **deviance** is twice the negative log-likelihood but for a
//! constant: its fall is the evidence for an effect.
//!
//! ```no_run
//! use camrig_diagnose::{Session, data::design, search, verdict};
//!
//! # fn main() -> camrig_base::Result<()> {
//! let camera = camrig_camera::Camera::load("camera.toml")?;
//! let set = camrig_captures::CaptureSet::load("captures".as_ref())?;
//! let cleaned = camrig_clean::Cleaned::new(set, &Default::default())?;
//! let camera = camrig_diagnose::data::codes::camera_of(&camera, &cleaned);
//! let set = cleaned.set();
//! let counts = set.captures.iter().map(|c| set.count(c)).collect::<Result<Vec<_>, _>>()?;
//! let halves = design::divide(&camera, set, &counts)?;
//! let session = Session::open(&camera, &cleaned, halves, &|_frames| ())?;
//! let outcome = search::run(&session, &camera, &[], &|_kind| ())?;
//! let report = verdict::report(&session, &outcome);
//! for step in &report.steps {
//!     println!("{} ({}): gap {:.2}", step.effect, step.status.word(), step.gap_after);
//! }
//! # Ok(())
//! # }
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod candidates;
pub mod evidence;
pub mod finding;
pub mod model;
pub mod report;
pub mod search;
pub mod verdict;

pub use camrig_statistics as statistics;
pub use camrig_statistics::{data, numerics};
pub use report::Report;
pub use search::{Outcome, Session};
