//! A camera pointed at a scene: from what a person names to irradiance on the sensor.

use super::{About, cache};
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_optics::{Options, Report};
use camrig_scene::moving::Moving;
use camrig_scene::{self as scene, Illuminant, LightLevel, LitScene, Quantity, photometry};
use std::path::PathBuf;

/// Scene illuminance where none is asked for, lx.
const DEFAULT_LUX: f64 = 300.0;

/// What is looked at, in which light.
#[derive(Clone, Debug)]
pub struct Sight {
    /// A chart, a spectral cube or a scene directory.
    pub scene: String,
    /// The light on a scene of reflectances.
    pub illuminant: String,
    /// How much of it; 300 lx unless given. A scene of radiance has its own light and takes none.
    pub level: Option<LightLevel>,
    /// Options of the optics stage.
    pub options: Options,
    /// Where results of the optics stage are kept, if anywhere.
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
pub struct View {
    /// The light, where the scene is one of reflectances.
    pub light: Option<Illuminant>,
    /// Irradiance on the sensor.
    pub cube: IrradianceCube,
    /// Figures of the optics stage.
    pub optics: Report,
    /// Whether they came from the cache.
    pub cached: bool,
    /// Whether a lens was traced for them now.
    pub lens_traced: bool,
    /// What a user should know about the scene.
    pub notes: Vec<String>,
}

impl Sight {
    /// Runs the optics stage; `progress` hears of bands done and bands in all.
    ///
    /// # Errors
    /// A scene, light or lens that cannot be.
    pub fn view(&self, camera: &Camera, progress: impl FnMut(usize, usize)) -> Result<View> {
        self.view_at(camera, 0, progress)
    }

    /// The same at frame `frame` of a sequence in which the scene moves.
    ///
    /// # Errors
    /// Those of [`Sight::view`].
    pub fn view_at(
        &self,
        camera: &Camera,
        frame: u32,
        progress: impl FnMut(usize, usize),
    ) -> Result<View> {
        let [width, height] = [camera.sensor.width, camera.sensor.height].map(f64::from);
        let mut scene = scene::open_filling(&self.scene, width / height)?;
        if let Some(Motion { velocity_pixels, rolling }) = self.motion {
            let velocity = velocity_pixels.map(|v| v / width);
            let (start, height) = (f64::from(frame), height / width);
            scene = Box::new(Moving { scene, velocity, start, rolling, height });
        }
        let bands = scene.bands();
        let (light, lux, white) = match scene.quantity() {
            Quantity::Reflectance => {
                let light = Illuminant::parse(&self.illuminant)?;
                let level = self.level.unwrap_or(LightLevel::Lux(DEFAULT_LUX));
                let white = photometry::white_radiance(&light, level, &bands)?;
                (Some(light), Some(level.white_luminance() * std::f64::consts::PI), white)
            }
            Quantity::Radiance if self.level.is_some() => {
                return Err(Error::input(format!("a light level for {:?}", self.scene)).help(
                    "this scene holds radiance, light included; leave lux and luminance out",
                ));
            }
            Quantity::Radiance => (None, None, vec![1.0; bands.count]),
        };
        let about = About {
            lux,
            illuminant: light.as_ref().map(|l| l.name.clone()),
            made_of: format!("scene {}, lens of {}", self.scene, camera.name),
        };
        let lit = LitScene { scene: &*scene, white };
        // A moving scene is seen once in each place: nothing to keep.
        let directory = self.cache.as_deref().filter(|_| self.motion.is_none());
        let cache::Rendered { cube, report, hit, traced } =
            cache::irradiance(camera, &lit, &self.options, about, directory, progress)
                .map_err(|e| e.at(&self.scene))?;
        let notes = scene.notes();
        Ok(View { light, cube, optics: report, cached: hit, lens_traced: traced, notes })
    }
}

impl View {
    /// The cube's header for another level of the same light: the samples serve them all.
    ///
    /// # Errors
    /// A view of a scene that has its own light.
    pub fn header_at(&self, lux: f64) -> Result<CubeHeader> {
        let header = &self.cube.header;
        let light =
            self.light.as_ref().ok_or_else(|| Error::input("the scene has its own light"))?;
        let bands = header.spectral_bands();
        let white = photometry::white_radiance(light, LightLevel::Lux(lux), &bands)?;
        let level = white.iter().fold(0.0f64, |m, &w| m.max(w));
        Ok(CubeHeader { level, lux: Some(lux), ..header.clone() })
    }
}
