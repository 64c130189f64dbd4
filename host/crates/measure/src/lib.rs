//! Figures of sensors and lenses from raw frames: photon transfer ([`ptc`]), EMVA 1288 ([`emva`]),
//! edge MTF after ISO 12233 ([`mtf`]), positional crosstalk ([`crosstalk`]), colour patches
//! ([`patches`]), profiles ([`profile`]).
//!
//! Input are capture sets ([`camrig_captures::CaptureSet`]: stacks of raw frames in digital
//! numbers, DN, with exposure in seconds, gain and light) or single frames. Output are figures in
//! the units of EMVA 1288 (e⁻, DN, DN/e⁻, e⁻/s), most of them with a standard error ([`Value`]).
//! No camera model is involved: measured and simulated frames are treated alike.
//!
//! # Example
//! System gain and dark noise of synthetic frames with 0.5 DN/e⁻ and a read noise of 3 e⁻:
//! ```
//! use camrig_base::Plane;
//! use camrig_captures::CaptureSet;
//! use camrig_formats::{Facts, Frames, npy};
//! use camrig_measure::ptc;
//! use rand_distr::{Distribution, Normal, Poisson};
//! use rand_xoshiro::{Xoshiro256PlusPlus, rand_core::SeedableRng};
//!
//! let (gain, black) = (0.5, 64.0); // DN/e⁻, DN
//! let (width, height) = (96, 64);
//! let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
//! let mut frame = |signal_e: f64| {
//!     let read = Normal::new(0.0, 3.0).unwrap();
//!     let light = Poisson::new(signal_e.max(1e-9)).unwrap();
//!     Plane::from_fn(width, height, |_, _| {
//!         let e: f64 = light.sample(&mut random) + read.sample(&mut random);
//!         (e * gain + black).round() as u16
//!     })
//! };
//! let folder = tempfile::tempdir().unwrap();
//! let mut manifest = format!(
//!     "format = \"captures/1\"\n[sensor]\nwidth = {width}\nheight = {height}\nbits = 12\n\
//!      cfa = \"mono\"\nblack_level_dn = {black}\n"
//! );
//! for (id, signal_e) in [("dark", 0.0), ("low", 500.0), ("middle", 2000.0), ("high", 4000.0)] {
//!     let planes = (0..8).map(|_| frame(signal_e)).collect();
//!     let bytes = npy::encode(&Frames { planes, facts: Facts::default() })?;
//!     std::fs::write(folder.path().join(format!("{id}.npy")), bytes).unwrap();
//!     let role = if signal_e > 0.0 { "flat" } else { "dark" };
//!     manifest += &format!(
//!         "[[capture]]\nid = \"{id}\"\nrole = \"{role}\"\nfiles = \"{id}.npy\"\n\
//!          exposure_s = 0.01\n"
//!     );
//! }
//! std::fs::write(folder.path().join("captures.toml"), manifest).unwrap();
//!
//! let figures = ptc::measure(&CaptureSet::load(folder.path())?)?.figures;
//! let k = figures.system_gain_dn_per_e.unwrap();
//! assert!((k.value - gain).abs() < 4.0 * k.std_error, "{k:?}");
//! let read = figures.read_noise_e.unwrap();
//! assert!((read.value - 3.0).abs() < 4.0 * read.std_error, "{read:?}");
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod codes;
pub mod compare;
mod copies;
pub mod correlation;
pub mod coupling;
pub mod crosstalk;
pub mod cut_off;
pub mod dark;
pub mod dark_stack;
pub mod emva;
pub mod fit;
pub mod gains;
pub mod ladder;
pub mod maps;
pub mod moments;
pub mod mtf;
pub mod patches;
pub mod picture;
pub mod profile;
pub mod ptc;
pub mod rates;
mod remarks;
pub mod response;
pub mod rounding;
pub mod site;
pub mod spatial;
pub mod spectrogram;
pub mod stack;
mod strips;
mod sums;
pub mod transfer;
pub mod value;

pub use value::Value;

#[cfg(test)]
pub(crate) mod synthetic;
