//! The light of targets: mean photo-electrons of every pixel, one run of the optics stage for each
//! scene and each camera that images it differently.

use crate::data::design::Target;
use camrig_base::{Plane, Result};
use camrig_camera::{Camera, SensorModel};
use camrig_light::LightLevel;
use camrig_optics::Options;
use camrig_render::{DEFAULT_LUX, SceneLight, SimulatedSensor, scene_irradiance, scene_notes};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// Illuminance for which electrons are kept, lx; others are in proportion.
const LUX: f64 = DEFAULT_LUX;
/// Samples kept in all: 256 MiB.
const MAX_SAMPLES: usize = 64 << 20;

/// Photo-electrons per second and pixel of a scene at `LUX`.
pub type Electrons = Arc<Plane<f32>>;

/// Light of targets, kept while there is room.
#[derive(Default)]
pub struct Lights {
    kept: Mutex<(Kept, u64)>,
}

/// By what the light depends on (see [`depends_on`]): when it was last asked for, and the
/// electrons.
type Kept = BTreeMap<String, (u64, Electrons)>;

impl Lights {
    /// Photo-electrons per second and pixel of every target at `LUX`, to be multiplied by
    /// [`share`]. Cameras that differ only in effects of the sensor share them.
    ///
    /// # Errors
    /// Those of rendering.
    pub fn of(&self, camera: &Camera, targets: &[Target]) -> Result<Vec<Electrons>> {
        targets.iter().map(|t| self.one(camera, t)).collect()
    }

    fn one(&self, camera: &Camera, target: &Target) -> Result<Electrons> {
        let key = depends_on(camera, target);
        if let Ok(mut kept) = self.kept.lock() {
            kept.1 += 1;
            let now = kept.1;
            if let Some(entry) = kept.0.get_mut(&key) {
                entry.0 = now;
                return Ok(entry.1.clone());
            }
        }
        let light = light_on(target);
        let cube = scene_irradiance(camera, &target.scene, &light, &Options::default(), |_, _| ())
            .map_err(|e| e.at(format!("capture {:?}", target.stack.id)))?
            .cube;
        let sensor = SimulatedSensor::new(camera, &cube.header)?;
        let electrons = Arc::new(sensor.electrons(&cube, &camera.settings(0, 1.0, Some(1.0)))?);
        if let Ok(mut kept) = self.kept.lock() {
            let now = kept.1;
            kept.0.insert(key, (now, electrons.clone()));
            while kept.0.len() > 1 && kept.0.len() * electrons.data.len() > MAX_SAMPLES {
                let oldest = kept.0.iter().min_by_key(|e| e.1.0).map(|e| e.0.clone());
                oldest.and_then(|key| kept.0.remove(&key));
            }
        }
        Ok(electrons)
    }
}

/// The light on a target: a scene of radiance has its own; one of reflectances has `LUX` unless
/// given otherwise.
fn light_on(target: &Target) -> SceneLight<'_> {
    let level = target.lux.map(|_| LightLevel::Lux(LUX));
    SceneLight { illuminant: target.illuminant.as_deref(), level }
}

/// What a user should know of the scenes of targets, their light, and the lens and the tables of a
/// camera that images them, each once.
///
/// # Errors
/// Scenes and lenses that cannot be read.
pub fn notes(camera: &Camera, targets: &[Target]) -> Result<Vec<String>> {
    let mut all = Vec::new();
    for target in targets {
        for note in scene_notes(camera, &target.scene, &light_on(target))
            .map_err(|e| e.at(format!("capture {:?}", target.stack.id)))?
        {
            if !all.contains(&note) {
                all.push(note);
            }
        }
    }
    Ok(all)
}

/// All that the photo-electrons of a target depend on, as text: scene, light, lens, effects of the
/// optics, and of the sensor the grid of pixels and its response. Of the rest of the sensor, its
/// noise and its read-out, they do not know.
fn depends_on(camera: &Camera, target: &Target) -> String {
    let SensorModel {
        width,
        height,
        pitch_um,
        fill_factor,
        cfa,
        qe,
        ir_cut,
        filter_angles,
        crosstalk,
        channel_names: _,
        conversion_gain_uv_per_e: _,
        full_well_e: _,
        full_scale_e: _,
        hdr: _,
        streams: _,
        bits: _,
        black_level_dn: _,
        analog_gain: _,
        temperature_c: _,
        seed: _,
        timing: _,
        noise: _,
        kept_noise: _,
        gains: _,
    } = &camera.sensor;
    let scene = (&target.scene, &target.illuminant, target.lux.is_some());
    let optics = (&camera.lens, &camera.optical_effects);
    let filter = (ir_cut, filter_angles);
    let sensor = (width, height, pitch_um, fill_factor, cfa, qe, filter, crosstalk);
    format!("{scene:?} {optics:?} {sensor:?}")
}

/// Photo-electrons in a frame of a target per electron per second at `LUX`.
pub fn share(target: &Target) -> f64 {
    target.stack.exposure_s * target.light * target.lux.unwrap_or(LUX) / LUX
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::design::Stack;
    use crate::data::variation::FrameVariation;
    use camrig_camera::LensKind;
    use camrig_captures::Role;
    use camrig_scene::chart;

    fn edge() -> Target {
        let scene = "slanted-edge".to_string();
        Target {
            stack: Stack {
                capture: 0,
                id: "edge".into(),
                role: Role::Edge,
                skip: 0,
                frames: 1,
                total: 1,
                variation: FrameVariation::default(),
                first_number: 0,
                exposure_s: 0.01,
                analog_gain: 1.0,
                temperature_c: 20.0,
            },
            geometry: chart::geometry(&scene).unwrap().unwrap(),
            scene,
            illuminant: None,
            lux: Some(LUX),
            light: 1.0,
        }
    }

    #[test]
    fn cameras_of_other_lenses_or_pixels_get_other_light_and_of_other_noise_the_same() {
        let mut camera = Camera::load("mt9v024").unwrap();
        (camera.sensor.width, camera.sensor.height) = (32, 24);
        let (lights, targets) = (Lights::default(), [edge()]);
        let of = |camera: &Camera| lights.of(camera, &targets).unwrap().swap_remove(0);
        let first = of(&camera);

        let mut noisy = camera.clone();
        noisy.sensor.noise.read_e *= 2.0;
        assert!(Arc::ptr_eq(&first, &of(&noisy)), "noise does not change the light");

        let mut slower = camera.clone();
        let lens = &mut slower.lens.kind;
        let LensKind::DiffractionLimited { f_number, .. } = lens else { panic!() };
        *f_number *= 2.0;
        // Irradiance on the axis is in proportion to 1/N² but for the 1 of eq. 7's 1 + 4 N².
        let sum = |e: &Electrons| e.data.iter().map(|&v| f64::from(v)).sum::<f64>();
        let ratio = sum(&first) / sum(&of(&slower));
        assert!((ratio - 4.0).abs() < 0.1, "{ratio}");

        let mut smaller = camera.clone();
        smaller.sensor.fill_factor *= 0.5;
        let ratio = sum(&first) / sum(&of(&smaller));
        assert!((ratio - 2.0).abs() < 0.01, "{ratio}");
    }

    #[test]
    fn a_sensor_beyond_the_tables_of_the_lens_is_told_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("small");
        // To an image height of 0.5 mm.
        camrig_optics::Characterisation::example(17, 0.5).write(&path, false).unwrap();
        let mut camera = Camera::load("mt9t012").unwrap();
        camera.lens.kind = LensKind::Characterised(path);
        let all = notes(&camera, &[edge(), edge()]).unwrap();
        let of_lens = all.iter().filter(|note| note.contains("end at 0.500 mm")).count();
        assert_eq!(of_lens, 1, "{all:?}");
    }
}
