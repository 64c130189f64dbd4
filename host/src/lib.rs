//! camrig: a camera-system simulator for hardware-in-the-loop benches of image signal processors.
//! Spectral scene → lens → sensor → Bayer raw, as a real camera makes it.
//!
//! A facade: each module is a crate of its own (`camrig::scene` is `camrig-scene`), and
//! [`prelude`] has what most programs need. The program `camrig` is the crate
//! `camrig-cli`.
//!
//! | module | takes | gives |
//! |---|---|---|
//! | [`camera`] | a camera file (TOML) or a preset | lens, sensor and effects as checked values |
//! | [`light`] | names of illuminants, lamps; spectra | relative spectra, light over time, colours |
//! | [`scene`], [`scene_files`] | charts, spectral cubes, pictures | spectral radiance, W m⁻² sr⁻¹ nm⁻¹ |
//! | [`prescription`], [`lens`], [`lens_files`], [`optics`] | prescriptions, tables over the field | irradiance, W m⁻² nm⁻¹ |
//! | [`render`], [`exposure`] | irradiance, exposure in seconds, gain | raw frames, DN |
//! | [`rig`] | irradiance, the address of a rig | raw frames of the rig |
//! | [`gige`] | a source of raw frames | a GigE Vision camera on the network |
//! | [`usbip`] | a source of raw frames | a USB video camera that Linux attaches |
//! | [`profiles`] | register maps of sensors, I2C writes | exposure and gain of each frame |
//! | [`captures`], [`capture`] | a manifest and frames; a plan | capture sets |
//! | [`clean`] | a capture set | what is not its sensor's; the frames without it |
//! | [`estimates`] | dark and flat frames | gain, noise, dark current, each with its own error |
//! | [`statistics`] | stacks of frames | figures that a diagnosis compares, with deviations |
//! | [`measure`], [`calibrate`] | capture sets | EMVA 1288 figures, MTF; radiance, spectra |
//! | [`fit`] | dark and flat captures | a camera file, each value with its error |
//! | [`diagnose`] | a camera and capture sets | effects that it lacks, other shapes |
//! | [`validate`] | a camera and capture sets | both compared |
//! | [`formats`], [`output`] | raw frames | DNG, TIFF, FITS, NPY, packed rows |
//! | [`report`], [`batch`] | figures; sweeps | pages; data sets |
//!
//! # Example
//! A grey card under D65 at 300 lx, exposed for 10 ms:
//! ```
//! use camrig::prelude::*;
//! use camrig::{light, render, scene_files};
//!
//! # fn main() -> Result<()> {
//! let camera = Camera::load("mt9v024")?.with_size(64, 48)?;
//!
//! let card = scene_files::open("uniform:0.18")?;
//! let daylight = Illuminant::parse("D65")?;
//! let level = LightLevel::Lux(300.0);
//! let white = light::photometry::white_radiance(&daylight, level, &card.bands())?;
//! let lit = LitScene { scene: &*card, white };
//! let (cube, _) = render::irradiance(&camera, &lit, &Options::default())?;
//!
//! let sensor = SimulatedSensor::new(&camera, &cube.header)?;
//! let settings = camera.settings(0, 0.010, None); // frame 0, seconds, the camera file's gain
//! let frame = sensor.frame(&cube, &settings)?;
//! for channel in frame.channel_means() {
//!     println!("{}: {:.1} DN", channel.name, channel.mean_dn);
//!     assert!(channel.mean_dn > frame.black_level_dn && channel.saturated == 0.0);
//! }
//! # Ok(())
//! # }
//! ```
//! `examples/` has this with a chart and a DNG, a client of a rig, EMVA 1288 figures from frames,
//! and a diagnosis.
//!
//! # Features
//! `report` (pages of figures and plots) and `rig` (rigs at serial ports and on USB, and their
//! logs) are on by default; `gpu` blurs on graphics processors. Each only adds.
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod prelude;

pub use camrig_base::{
    Error, ErrorKind, Plane, RawFrame, Result, alternatives, color, output, toml_text,
};
pub use camrig_batch as batch;
pub use camrig_calibrate as calibrate;
pub use camrig_camera as camera;
pub use camrig_capture as capture;
pub use camrig_captures as captures;
pub use camrig_clean as clean;
pub use camrig_diagnose as diagnose;
pub use camrig_estimates as estimates;
pub use camrig_exposure as exposure;
pub use camrig_fit as fit;
pub use camrig_formats as formats;
pub use camrig_gige as gige;
pub use camrig_glass as glass;
pub use camrig_lens as lens;
pub use camrig_lens_files as lens_files;
pub use camrig_light as light;
pub use camrig_measure as measure;
pub use camrig_optics as optics;
pub use camrig_prescription as prescription;
pub use camrig_profiles as profiles;
pub use camrig_render as render;
#[cfg(feature = "report")]
pub use camrig_report as report;
pub use camrig_rig as rig;
pub use camrig_scene as scene;
pub use camrig_scene_files as scene_files;
pub use camrig_statistics as statistics;
pub use camrig_usbip as usbip;
pub use camrig_validate as validate;
