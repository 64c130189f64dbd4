//! Finds and corrects everything in a capture set that is not the steady behaviour of its sensor:
//! torn frames, particle hits, wrong labels of light, copied frames, codes with a step, start-up,
//! drift of the lamp, pixels that change within a stack, frames that a camera processed.
//!
//! [`Cleaned`] is a capture set with its [`Finding`]s: which stack, which frames and pixels, how
//! much, how often, and what was done. It reads the frames corrected. No sensor model is needed.
//!
//! Samples are in DN, exposures in s. Each test has a false-alarm rate of 1 in 1000 sets, corrected
//! for multiple comparisons; the source of each limit is stated at its constant.
//!
//! | in reading order | |
//! |---|---|
//! | `cleaned`, `finding`, `corrections`, `options` | the set, its findings, the corrections; options |
//! | `torn` | frames of which a part is of another exposure |
//! | `inspect` | the order of the tests |
//! | `scan`, `band`, `residuals`, `transfer` | data for the tests: levels and codes of frames, time series of pixels, gain |
//! | `codes`, `requantised`, `top_code`, `copies`, `temperature` | steps and top of the codes, identical frames, missing temperatures |
//! | `events`, `particles`, `completeness` | deviations in single frames, whether they are particles, which share is detected |
//! | `changes` | pixels that change within a stack |
//! | `levels`, `labels` | signals that contradict the stated light |
//! | `curves` | start-up, drift of the lamp |
//! | `processed`, `blocks` | filters, demosaicing, lossy compression |
//!
//! ```
//! use camrig_clean::base::{Error, Plane};
//! use camrig_clean::captures::CaptureSet;
//! use camrig_clean::captures::formats::{Facts, Format, Frames};
//! use camrig_clean::{Cleaned, Kind, Options};
//!
//! // Two dark frames with the same bytes.
//! let frame = Plane { width: 8, height: 8, data: (0..64).map(|i| 60 + i * 7 % 5).collect() };
//! let frames = Frames { planes: vec![frame.clone(), frame], facts: Facts::default() };
//! let folder = std::env::temp_dir().join(format!("camrig-clean-{}", std::process::id()));
//! std::fs::create_dir_all(&folder)?;
//! std::fs::write(folder.join("dark.npy"), Format::Npy.encode(&frames)?)?;
//! let manifest = "format = \"captures/1\"\n[sensor]\nwidth = 8\nheight = 8\nbits = 12\n\
//!                 [[capture]]\nid = \"dark\"\nrole = \"dark\"\nfiles = \"dark.npy\"\n\
//!                 exposure_s = 0.01\ntemperature_c = 20\n";
//! std::fs::write(folder.join("captures.toml"), manifest)?;
//!
//! let cleaned = Cleaned::inspect(CaptureSet::load(&folder)?, &Options::default())?;
//! let found = &cleaned.findings()[0];
//! assert_eq!((found.kind, found.place.as_str()), (Kind::IdenticalFrames, "dark"));
//! assert_eq!(found.frames, [1]);
//! // Cleaned::new refuses such a set.
//! assert!(cleaned.refused().is_some());
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod band;
mod blocks;
mod changes;
mod cleaned;
mod codes;
mod completeness;
mod copies;
mod corrections;
mod curves;
mod events;
mod finding;
mod inspect;
mod labels;
mod levels;
mod options;
mod particles;
mod processed;
mod requantised;
mod residuals;
mod scan;
mod temperature;
#[cfg(test)]
mod tests;
mod top_code;
mod torn;
mod transfer;

pub use camrig_base as base;
pub use camrig_captures as captures;
pub use cleaned::Cleaned;
pub use codes::Step;
pub use curves::{CurveShape, FrameCurve};
pub use finding::{Done, Finding, Hit, Kind, MAX_PIXELS, Rate};
pub use options::Options;
