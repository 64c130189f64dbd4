//! Diagnosis: where do a model and captures disagree, which effect is missing, and is the model better with it?
//!
//! 1. [`design`]: which frames are fitted, which only judge.
//! 2. [`temporal`], [`spatial`], [`maps`]: moments of dark and flat stacks; [`looks`]: pictures of edges, dots and charts;
//!    [`statistics`]: the battery made of them.
//! 3. [`replicate`]: the same stacks of the model, by `sensor-core` itself; [`prediction`]: mean and scatter of
//!    every statistic, deviations, deviance, gap.
//! 4. [`candidates`]: what each effect of the catalogue would have to be; [`session`], [`search`]: which earn their place.
//! 5. [`verdict`]: what is said of it, and of what is left where it is; [`improved`]: the camera file with what was found.
//!
//! The **gap** is the mean over statistics of the squared deviation of the held-out frames from the model, in
//! units of what a replicate of the model scores against other replicates: 1.0 is as good as the right model can be.

pub mod allowance;
pub mod candidates;
mod channels;
pub mod design;
mod errors;
pub mod evidence;
pub mod improved;
mod lanes;
pub mod looks;
pub mod maps;
pub mod measures;
pub mod model;
pub mod plausible;
pub mod prediction;
mod ratios;
pub mod replicate;
mod revise;
pub mod search;
pub mod session;
pub mod shading;
mod simulated;
pub mod spatial;
mod spectrum;
pub mod statistics;
pub mod tails;
pub mod temporal;
pub mod verdict;
mod whereabouts;
pub mod words;
