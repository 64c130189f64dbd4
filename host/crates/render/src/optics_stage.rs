//! The optics stage as a person asks for it: a scene by name, its light, its movement, and whether
//! results are kept on disk. It gives irradiance on the sensor, W m⁻² nm⁻¹ per band and pixel.

use super::cache;
use super::lighting::{SceneInLight, SceneLight, frame_aspect};
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_optics::{Options, Report};
use camrig_scene::moving::Moving;
use camrig_scene::{Illuminant, LightLevel, photometry};
use std::path::PathBuf;

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
}

/// Movement of a whole scene over the frames of a sequence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// To the right and down, pixels per frame.
    pub velocity_pixels: [f64; 2],
    /// Part of the frame period in which a rolling shutter reads its rows; 0 for a global shutter.
    pub rolling: f64,
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
    /// Whether the scene's bands were joined to fewer.
    pub rebinned: bool,
    /// Whether a lens was traced for them now.
    pub lens_traced: bool,
    /// What a user should know about the scene and the lens.
    pub notes: Vec<String>,
}

impl OpticsStage {
    /// What falls on the sensor of `camera`; `progress` hears of bands done and bands in all.
    ///
    /// # Errors
    /// A scene, light or lens that cannot be read; an illuminant for a scene that holds radiance.
    pub fn run(
        &self,
        camera: &Camera,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        self.run_frame(camera, 0, progress)
    }

    /// The same at frame `frame` of a sequence in which the scene moves.
    ///
    /// # Errors
    /// Those of [`OpticsStage::run`].
    pub fn run_frame(
        &self,
        camera: &Camera,
        frame: u32,
        progress: impl FnMut(usize, usize),
    ) -> Result<OpticsOutput> {
        let light = SceneLight { illuminant: self.illuminant.as_deref(), level: self.level };
        let opened = SceneInLight::open(&self.scene, frame_aspect(camera), &light)?;
        let count = opened.scene.bands().count;
        let mut opened = opened.binned_for(camera);
        let rebinned = opened.scene.bands().count != count;
        if let Some(Motion { velocity_pixels, rolling }) = self.motion {
            let [width, height] = [camera.sensor.width, camera.sensor.height].map(f64::from);
            let velocity = velocity_pixels.map(|v| v / width);
            let (start, height) = (f64::from(frame), height / width);
            let scene = opened.scene;
            opened.scene = Box::new(Moving { scene, velocity, start, rolling, height });
        }
        // A moving scene is seen once in each place: nothing to keep.
        let directory = self.cache.as_deref().filter(|_| self.motion.is_none());
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
