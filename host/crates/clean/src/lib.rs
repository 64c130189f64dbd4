//! What is in captures that is not the steady behaviour of their sensor: particle hits, wrong
//! labels of light, copied frames, codes with a step, start-up, drift of the lamp, pixels that
//! change within a stack, frames that a camera processed.
//!
//! [`Cleaned::new`] looks at the dark and flat stacks of a set, without any model of the sensor,
//! and gives the set back with typed [`Finding`]s: which stack, which frames and pixels, how much,
//! how often, and what was done about it. Its frames come out without what was found.
//!
//! Samples are DN, exposures s. Everything is judged at false alarms of one in a thousand sets and
//! kind, the number of samples, pixels, frames and shapes that were looked at counted in; the
//! constants say where each limit comes from.
//!
//! ```
//! use camrig_base::Plane;
//! use camrig_captures::CaptureSet;
//! use camrig_clean::{Cleaned, Kind};
//! use camrig_formats::{Facts, Format, Frames};
//!
//! // Two dark frames, the same bytes.
//! let frame = Plane { width: 8, height: 8, data: (0..64).map(|i| 60 + i * 7 % 5).collect() };
//! let frames = Frames { planes: vec![frame.clone(), frame], facts: Facts::default() };
//! let folder = tempfile::tempdir().unwrap();
//! std::fs::write(folder.path().join("dark.npy"), Format::Npy.encode(&frames)?).unwrap();
//! let manifest = "format = \"captures/1\"\n[sensor]\nwidth = 8\nheight = 8\nbits = 12\n\
//!                 [[capture]]\nid = \"dark\"\nrole = \"dark\"\nfiles = \"dark.npy\"\n\
//!                 exposure_s = 0.01\ntemperature_c = 20\n";
//! std::fs::write(folder.path().join("captures.toml"), manifest).unwrap();
//!
//! let looked = Cleaned::look(CaptureSet::load(folder.path())?, &|_frames| ())?;
//! let found = &looked.findings()[0];
//! assert_eq!((found.kind, found.place.as_str()), (Kind::IdenticalFrames, "dark"));
//! assert_eq!(found.frames, [1]);
//! assert!(looked.refused().is_some());
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod band;
mod blocks;
mod changes;
mod cleaned;
mod codes;
mod completeness;
mod copies;
mod curves;
mod events;
mod finding;
mod hits;
mod inspect;
mod labels;
mod processed;
mod scan;
mod temperature;
#[cfg(test)]
mod tests;
mod transfer;

pub use cleaned::Cleaned;
pub use codes::Step;
pub use curves::{Curve, Shape};
pub use finding::{Done, Finding, Kind, MAX_PIXELS, Rate};
