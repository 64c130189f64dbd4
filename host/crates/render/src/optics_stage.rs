//! The optics stage as a person asks for it: a scene by name, its light, its movement, and whether
//! results are kept on disk. It gives irradiance on the sensor, W m⁻² nm⁻¹ per band and pixel.

use super::collapse::{CollapseReport, OpticsPath};
use super::lighting::{SceneInLight, SceneLight, frame_aspect};
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_light::{Illuminant, LightLevel, photometry};
use camrig_optics::{Options, Report};
use camrig_scene::Shown;
use std::path::PathBuf;

/// Movement of a whole scene over the frames of a sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// To the right and down, pixels per frame.
    pub velocity_pixels: [f64; 2],
    /// Part of the frame period in which a rolling shutter reads its rows; 0 for a global shutter.
    pub rolling: f64,
}

/// A scene and its light, ready to be seen by a camera.
#[derive(Clone, Debug)]
pub struct OpticsStage {
    /// A chart, a spectral cube or a scene directory.
    pub scene: String,
    /// The light on a scene of reflectances, [`super::DEFAULT_ILLUMINANT`] unless given; one of
    /// radiance has its own and takes none.
    pub illuminant: Option<String>,
    /// How much of it: on a scene of reflectances 300 lx unless given; one of radiance is scaled to
    /// it, see [`super::MEAN_REFLECTANCE`].
    pub level: Option<LightLevel>,
    /// Options of the optics engine.
    pub options: Options,
    /// Directory in which results are kept, if any.
    pub cache: Option<PathBuf>,
    /// How the scene moves, if it does.
    pub motion: Option<Motion>,
    /// How light comes from the scene to the sensor.
    pub path: OpticsPath,
}

/// What the optics stage gave, and what it was made from.
pub struct OpticsOutput {
    /// The light, where the scene is one of reflectances.
    pub light: Option<Illuminant>,
    /// Irradiance on the sensor.
    pub cube: IrradianceCube,
    /// Figures of the optics engine.
    pub optics: Report,
    /// Whether they came from the cache.
    pub cached: bool,
    /// Whether the scene's bands were joined to fewer, or to electrons.
    pub rebinned: bool,
    /// Whether a lens was traced for them now.
    pub lens_traced: bool,
    /// What a fast path leaves out, where one was taken.
    pub collapse: Option<CollapseReport>,
    /// Which part of a scene of another shape the frame shows.
    pub shown: Option<Shown>,
    /// What a user should know about the scene and the lens.
    pub notes: Vec<String>,
}

impl OpticsStage {
    /// The scene in its light, in the bands that `camera` sees.
    pub(crate) fn open(&self, camera: &Camera) -> Result<SceneInLight> {
        let light = SceneLight { illuminant: self.illuminant.as_deref(), level: self.level };
        Ok(SceneInLight::open(&self.scene, frame_aspect(camera), &light)?.seen_by(camera))
    }
}

impl OpticsOutput {
    /// The cube's header for another level of the same light: the samples serve them all.
    ///
    /// # Errors
    /// A scene of radiance that was not scaled to a level.
    pub fn header_at(&self, lux: f64) -> Result<CubeHeader> {
        let header = &self.cube.header;
        let level = match (&self.light, header.lux) {
            (Some(light), _) if !self.rebinned => {
                let bands = header.spectral_bands();
                let white = photometry::white_radiance(light, LightLevel::Lux(lux), &bands)?;
                white.iter().fold(0.0f64, |m, &w| m.max(w))
            }
            (_, Some(own)) => header.level * lux / own,
            (_, None) => return Err(Error::input("the scene is in its own light")),
        };
        Ok(CubeHeader { level, lux: Some(lux), ..header.clone() })
    }
}
