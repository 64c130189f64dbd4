//! The optics stage as a person asks for it: a scene by name, its light, its movement, and whether
//! results are kept on disk. It gives irradiance on the sensor, W m⁻² nm⁻¹ per band and pixel.

use super::cache;
use super::collapse::{CollapseReport, OpticsPath};
use super::kept_optics::KeptOptics;
use super::lighting::{SceneInLight, SceneLight, frame_aspect, frame_height};
use super::motion_stage::{Motion, MotionStage};
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_light::lamp::Region;
use camrig_light::{Illuminant, LightLevel, photometry};
use camrig_optics::{Options, Report};
use camrig_scene::part::Part;
use std::path::PathBuf;
use std::sync::Arc;

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
    /// What a user should know about the scene and the lens.
    pub notes: Vec<String>,
}

impl OpticsStage {
    /// What falls on the sensor of `camera`, of a scene that moves in its first frame; `progress`
    /// hears of bands done and bands in all.
    ///
    /// # Errors
    /// A scene, light or lens that cannot be read; an illuminant for a scene that holds radiance.
    pub fn run(
        &self,
        camera: &Camera,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        match self.motion {
            Some(_) => MotionStage::open(self, camera)?.run_frame(camera, 0, progress),
            None => self.run_opened(camera, self.open(camera)?, progress),
        }
    }

    /// What falls on the sensor from a part of the scene alone.
    ///
    /// # Errors
    /// Those of [`OpticsStage::run`].
    pub fn run_part(&self, camera: &Camera, region: Region) -> Result<OpticsOutput> {
        let (mut opened, rebinned) = self.open(camera)?;
        let height = frame_height(camera);
        opened.scene = Arc::new(Part { scene: opened.scene, region, height });
        // It is seen once: nothing to keep.
        let once = Self { cache: None, ..self.clone() };
        once.run_opened(camera, (opened, rebinned), |_, _| ())
    }

    /// The scene in its light, and whether its bands were joined to fewer.
    pub(crate) fn open(&self, camera: &Camera) -> Result<(SceneInLight, bool)> {
        let light = SceneLight { illuminant: self.illuminant.as_deref(), level: self.level };
        let opened = SceneInLight::open(&self.scene, frame_aspect(camera), &light)?;
        let count = opened.scene.bands().count;
        let opened = opened.binned_for(camera);
        let rebinned = opened.scene.bands().count != count;
        Ok((opened, rebinned))
    }

    fn run_opened(
        &self,
        camera: &Camera,
        (opened, rebinned): (SceneInLight, bool),
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        if self.path != OpticsPath::Bands {
            let mut optics = KeptOptics::new(self);
            return optics.see(camera, &opened, rebinned, progress).map_err(|e| e.at(&self.scene));
        }
        let directory = self.cache.as_deref();
        let about = opened.about(camera);
        let cache::Rendered { cube, report, hit, traced, notes: of_lens } =
            cache::irradiance(camera, &opened.lit(), &self.options, about, directory, progress)
                .map_err(|e| e.at(&self.scene))?;
        let mut notes = opened.notes(camera);
        notes.extend(of_lens);
        let light = opened.illuminant;
        Ok(OpticsOutput {
            light,
            cube,
            optics: report,
            cached: hit,
            rebinned,
            lens_traced: traced,
            collapse: None,
            notes,
        })
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
