//! Figures of sensors and lenses from raw frames, by the methods of the standards.
//!
//! The input is a [`CaptureSet`](captures::CaptureSet): stacks of raw frames in digital numbers
//! (DN), with exposure in seconds, gain and light. The output are figures in the units of EMVA 1288
//! (e⁻, DN, DN/e⁻, e⁻/s), most of them a [`Value`] with its standard error. No camera model is
//! involved: measured and simulated frames are treated alike.
//!
//! | module | figures |
//! |---|---|
//! | [`ptc`] | photon transfer: gain, read noise, dark current, full well |
//! | [`emva`] | EMVA 1288 release 4.0 |
//! | [`dark_stack`] | offset and noise of one stack of darks, without any metadata |
//! | [`gains`], [`rates`] | noise against gain; signal rates of the filter positions |
//! | [`even`] | signal-to-noise ratio of an even area of one frame |
//! | [`mtf`] | edge MTF, ISO 12233 |
//! | [`coupling`], [`correlation`] | correlation of neighbouring pixels |
//! | [`crosstalk`] | crosstalk against the angle of light |
//! | [`patches`], [`picture`] | patches of a ColorChecker, raw and developed |
//! | [`profile`], [`spectrogram`] | profiles and spectra of rows and columns |
//! | [`figure`] | all of them as JSON, with their units |
//! | [`compare`] | differences of two sets in standard errors |
//!
//! These are built on [`stack`] and [`moments`] (a stack read once in bounded memory), [`ladder`]
//! (dark and flat stacks as levels), [`dark`], [`transfer`] and [`response`] (fits through the
//! levels).
//!
//! # Example
//! System gain and read noise of simulated frames with 0.5 DN/e⁻ and a read noise of 3 e⁻:
//! ```
//! use camrig_measure::base::Plane;
//! use camrig_measure::captures::CaptureSet;
//! use camrig_measure::captures::formats::{Facts, Format, Frames};
//! use camrig_measure::ptc;
//!
//! // Normal variates as sums of twelve uniform ones.
//! let mut state = 1u64;
//! let mut uniform = move || {
//!     state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
//!     (state >> 40) as f64 / (1u64 << 24) as f64
//! };
//! let mut normal = move || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
//!
//! let (gain, black, read_noise_e) = (0.5, 64.0, 3.0f64);
//! let (width, height) = (96, 64);
//! let mut frame = |signal_e: f64| {
//!     Plane::from_fn(width, height, |_, _| {
//!         let electrons = signal_e + (signal_e + read_noise_e.powi(2)).sqrt() * normal();
//!         (electrons * gain + black).round() as u16
//!     })
//! };
//! let folder = std::env::temp_dir().join(format!("camrig-measure-{}", std::process::id()));
//! std::fs::create_dir_all(&folder)?;
//! let mut manifest = format!(
//!     "format = \"captures/1\"\n[sensor]\nwidth = {width}\nheight = {height}\nbits = 12\n\
//!      cfa = \"mono\"\nblack_level_dn = {black}\n"
//! );
//! for (id, signal_e) in [("dark", 0.0), ("low", 500.0), ("middle", 2000.0), ("high", 4000.0)] {
//!     let planes = (0..8).map(|_| frame(signal_e)).collect();
//!     let bytes = Format::Npy.encode(&Frames { planes, facts: Facts::default() })?;
//!     std::fs::write(folder.join(format!("{id}.npy")), bytes)?;
//!     let role = if signal_e > 0.0 { "flat" } else { "dark" };
//!     manifest += &format!(
//!         "[[capture]]\nid = \"{id}\"\nrole = \"{role}\"\nfiles = \"{id}.npy\"\n\
//!          exposure_s = 0.01\n"
//!     );
//! }
//! std::fs::write(folder.join("captures.toml"), manifest)?;
//!
//! let figures = ptc::measure(&CaptureSet::load(&folder)?)?.figures;
//! let k = figures.system_gain_dn_per_e.unwrap();
//! assert!((k.value - gain).abs() < 4.0 * k.std_error, "{k:?}");
//! let read = figures.read_noise_e.unwrap();
//! assert!((read.value - read_noise_e).abs() < 4.0 * read.std_error, "{read:?}");
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod codes;
pub mod compare;
pub mod contrast;
mod copies;
pub mod correlation;
pub mod coupling;
pub mod crosstalk;
pub mod cut_off;
pub mod dark;
pub mod dark_stack;
pub mod emva;
pub mod even;
pub mod figure;
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
mod tolerance;
pub mod transfer;

pub use camrig_base as base;
pub use camrig_base::Value;
pub use camrig_captures as captures;

#[cfg(test)]
pub(crate) mod synthetic;
