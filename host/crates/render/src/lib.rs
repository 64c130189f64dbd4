//! Rendering: scene + camera → irradiance cube → raw frames.
//!
//! The optics stage ([`scene_irradiance`], or [`OpticsStage`] with movement and results kept on
//! disk, or [`SequenceStage`] for scenes that change with time) writes an [`IrradianceCube`] once:
//! spectral irradiance per band and pixel on the sensor, W m⁻² nm⁻¹. [`SimulatedSensor`] turns it
//! into raw frames in DN, so that another light level, exposure, gain, frame number or sensor seed
//! never runs the optics again.
//!
//! ```
//! use camrig_camera::Camera;
//! use camrig_optics::Options;
//! use camrig_render::{Arithmetic, SceneLight, SimulatedSensor, scene_irradiance};
//!
//! let mut camera = Camera::load("mt9v024")?;
//! (camera.sensor.width, camera.sensor.height) = (32, 24);
//! let light = SceneLight::lux("D65", 300.0);
//! let options = Options::default();
//! let cube = scene_irradiance(&camera, "uniform:0.18", &light, &options, |_, _| ())?.cube;
//!
//! // Twice the exposure time is twice the signal above black, within noise.
//! let sensor = SimulatedSensor::new(&camera, &cube.header)?;
//! let signal_dn = |exposure_s: f64| -> Result<f64, camrig_base::Error> {
//!     let settings = camera.settings(0, exposure_s, None);
//!     let frame = sensor.frame(&cube, &settings)?;
//!     let sum: f64 = frame.data.iter().map(|&dn| f64::from(dn)).sum();
//!     Ok(sum / frame.data.len() as f64 - frame.black_level_dn)
//! };
//! let ratio = signal_dn(20e-3)? / signal_dn(10e-3)?;
//! assert!((ratio - 2.0).abs() < 0.1, "{ratio}");
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod auto_exposure;
mod binning;
pub mod cache;
mod collapse;
mod corrections;
mod embedded;
mod filter_angles;
pub mod hdr;
mod intrinsics;
mod kept_optics;
mod lamp_rows;
mod lens;
mod lighting;
mod made_for;
mod metadata;
mod motion_stage;
mod optical_effects;
mod optics_stage;
pub mod places;
mod reach;
pub mod readout;
mod run_optics;
mod sequence_stage;
mod traced;

pub use camrig_exposure::{Arithmetic, FrameOptions, SimulatedSensor, Traps};
pub use camrig_exposure::{Chunk, CubeHeader, IrradianceCube, IrradianceWriter};
pub use collapse::{CollapseReport, OpticsPath, light_bands};
pub use corrections::{Corrections, corrections};
pub use embedded::embedded_line;
pub use filter_angles::with_filter_angles;
pub use intrinsics::{Intrinsics, intrinsics};
pub use lamp_rows::lamp_rows;
pub use lens::{lens, lens_notes, sensor_grid};
pub use lighting::{DEFAULT_ILLUMINANT, DEFAULT_LUX, MEAN_REFLECTANCE};
pub use lighting::{SceneInLight, SceneIrradiance, SceneLight, radiance_at};
pub use lighting::{scene_irradiance, scene_notes};
pub use made_for::{MadeFor, check_made_for, made_for, unchecked};
pub use metadata::{describe_merged, dng_info, frame_info, noise_profile};
pub use motion_stage::MotionStage;
pub use optics_stage::{Motion, OpticsOutput, OpticsStage};
pub use reach::{light_beyond_a_chart, missing};
pub use sequence_stage::SequenceStage;

use camrig_base::Result;
use camrig_camera::Camera;
use camrig_light::Illuminant;
use camrig_optics::{self as optics, Options, Report};
use camrig_scene::LitScene;

/// What a cube's header says about its making.
#[derive(Clone, Debug, Default)]
pub struct About {
    /// Scene illuminance, lx.
    pub lux: Option<f64>,
    /// The illuminant.
    pub illuminant: Option<Illuminant>,
    /// Scene and lens in words.
    pub made_of: String,
}

/// The optics stage: what falls on the camera's sensor.
///
/// # Errors
/// A lens that cannot be read or traced; a scene that cannot be rendered.
pub fn irradiance(
    camera: &Camera,
    scene: &LitScene<'_>,
    options: &Options,
) -> Result<(IrradianceCube, Report)> {
    let (cube, report, _) = irradiance_with(camera, scene, options, About::default(), |_, _| ())?;
    Ok((cube, report))
}

/// [`irradiance`] with a header that says how the cube was made, and with progress: bands done, and
/// of how many. Returns notes on the lens, too.
///
/// # Errors
/// Those of [`irradiance`].
pub fn irradiance_with(
    camera: &Camera,
    scene: &LitScene<'_>,
    options: &Options,
    about: About,
    progress: impl FnMut(usize, usize),
) -> Result<(IrradianceCube, Report, Vec<String>)> {
    let grid = sensor_grid(camera);
    let bands = scene.scene.bands();
    let described = lens::Described::new(camera, &bands, about.illuminant.as_ref(), options)?;
    let mut writer = IrradianceWriter::new(CubeHeader {
        lux: about.lux,
        illuminant: about.illuminant.map(|illuminant| illuminant.name),
        light: described.light.clone(),
        made_for: made_for(camera)?,
        ..CubeHeader::new((grid.width, grid.height), &bands, about.made_of)
    })?;
    let notes = described.notes().to_vec();
    let (lens, _) = described.lens(None)?;
    let report = optics::irradiance(scene, &*lens, &grid, options, progress, |_, plane| {
        writer.push(&plane)
    })?;
    Ok((writer.finish()?, report, notes))
}
