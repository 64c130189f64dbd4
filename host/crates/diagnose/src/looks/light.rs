//! The light of looks: mean photo-electrons of every pixel, one run of the optics stage for each scene and lens.

use super::Look;
use camrig_base::{Plane, Result};
use camrig_camera::Camera;
use camrig_optics::Options;
use camrig_render::{DEFAULT_LUX, SceneLight, SimulatedSensor, scene_irradiance};
use camrig_scene::LightLevel;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// Illuminance for which electrons are kept, lx: what irradiance has beyond it is in proportion.
const LUX: f64 = DEFAULT_LUX;
/// Samples kept in all: 256 MiB.
const MOST: usize = 64 << 20;

/// Photo-electrons per second of a scene at `LUX`.
pub type Electrons = Arc<Plane<f32>>;

/// What a scene through a lens gives, kept while there is room.
#[derive(Default)]
pub struct Lights {
    kept: Mutex<(Kept, u64)>,
}

/// By scene, illuminant and effects of the optics: when last asked for, and the electrons.
type Kept = BTreeMap<String, (u64, Electrons)>;

impl Lights {
    /// Photo-electrons per second of every look at `LUX`, to be multiplied by [`share`]. Cameras that differ in
    /// their sensor's effects alone share them.
    ///
    /// # Errors
    /// Those of rendering.
    pub fn of(&self, camera: &Camera, looks: &[Look]) -> Result<Vec<Electrons>> {
        looks.iter().map(|l| self.one(camera, l)).collect()
    }

    fn one(&self, camera: &Camera, of: &Look) -> Result<Electrons> {
        let key = format!("{} {:?} {:?}", of.scene, of.illuminant, camera.optical_effects);
        if let Ok(mut kept) = self.kept.lock() {
            kept.1 += 1;
            let now = kept.1;
            if let Some(entry) = kept.0.get_mut(&key) {
                entry.0 = now;
                return Ok(entry.1.clone());
            }
        }
        // A scene of radiance has its own light; one of reflectances has LUX unless told otherwise.
        let level = of.lux.map(|_| LightLevel::Lux(LUX));
        let light = SceneLight { illuminant: of.illuminant.as_deref(), level };
        let (cube, _) =
            scene_irradiance(camera, &of.scene, &light, &Options::default(), |_, _| ())
                .map_err(|e| e.at(format!("capture {:?}", of.id)))?;
        let sensor = SimulatedSensor::new(camera, &cube.header, 1.0)?;
        let electrons = Arc::new(sensor.electrons(&cube, &camera.settings(0, 1.0, Some(1.0)))?);
        if let Ok(mut kept) = self.kept.lock() {
            let now = kept.1;
            kept.0.insert(key, (now, electrons.clone()));
            while kept.0.len() > 1 && kept.0.len() * electrons.data.len() > MOST {
                let oldest = kept.0.iter().min_by_key(|e| e.1.0).map(|e| e.0.clone());
                oldest.and_then(|key| kept.0.remove(&key));
            }
        }
        Ok(electrons)
    }
}

/// Photo-electrons in a frame of a look per electron per second at `LUX`.
pub fn share(look: &Look) -> f64 {
    look.exposure_s * look.light * look.lux.unwrap_or(LUX) / LUX
}
