//! The light of a stream: a still scene, irradiance files in turn, or a changing scene.

use super::Args;
use crate::expose;
use crate::notes::Notes;
use crate::scene_lights::SceneLights;
use crate::view_args::ViewArgs;
use camrig_base::{Error, Result, natural_order};
use camrig_camera::Camera;
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_render::SimulatedSensor;
use camrig_rig::remembering::remembering;
use camrig_rig::stage::changing_light;
use std::path::{Path, PathBuf};

/// The source of the frames' light.
pub struct Light {
    /// Irradiance of the frames, repeated in turn; that of frame 0 for a changing scene.
    pub cubes: Vec<IrradianceCube>,
    /// The frames of a scene after the first.
    pub scene: Option<SceneLights>,
    /// Notes about irradiance files.
    told: Notes,
}

impl Light {
    /// The light that the arguments ask for.
    pub fn open(args: &Args, camera: &Camera) -> Result<Self> {
        if let Some(scene) = &args.scene {
            let still = ViewArgs::still(
                args.camera.clone(),
                scene.clone(),
                args.illuminant.as_deref(),
                args.lux,
                args.device,
            );
            let view = ViewArgs {
                motion: args.motion,
                rolling: args.rolling,
                path: args.path,
                sequence: args.sequence.clone(),
                ..still
            };
            let times = args.time.times(camera, args.fps)?;
            let (scene, first) =
                SceneLights::open(&view, camera, args.fps, times, Notes::default())?;
            let cubes = vec![first.cube];
            return Ok(Self { cubes, scene: Some(scene), told: Notes::default() });
        }
        if args.time.is_given() {
            return Err(Error::unsupported("--lamp and --between of irradiance files")
                .help("they need a scene (--scene)"));
        }
        let path = args
            .irradiance
            .as_ref()
            .ok_or_else(|| Error::input("neither scene nor irradiance"))?;
        let mut told = Notes::default();
        let cubes = match path.is_dir() {
            true => folder(path, camera, &mut told)?,
            false => vec![expose::open(path, camera, &mut told)?],
        };
        let same = cubes.windows(2).all(|w| {
            let of = |h: &CubeHeader| (h.width, h.height, h.spectral_bands());
            of(&w[0].header) == of(&w[1].header)
        });
        if cubes.is_empty() || !same {
            return Err(Error::disagreement(
                "irradiance files of different sizes or bands, or none",
            )
            .at(path.display())
            .help(format!("give files made for {}", camera.name)));
        }
        Ok(Self { cubes, scene: None, told })
    }

    /// A sensor for each of the cubes.
    ///
    /// # Errors
    /// A cube of another size than the sensor's; changing light with an effect that has a memory.
    pub fn sensors(&self, camera: &Camera) -> Result<Vec<SimulatedSensor>> {
        let sensors = self.cubes.iter().map(|c| SimulatedSensor::new(camera, &c.header));
        let sensors = sensors.collect::<Result<Vec<_>>>()?;
        if !self.stands_still()
            && let Some(effect) = remembering(&sensors[0]).next()
        {
            return Err(changing_light(effect));
        }
        Ok(sensors)
    }

    /// Notes about the light, the lens and the camera's tables.
    pub fn notes(&self) -> &[String] {
        self.scene.as_ref().map_or(self.told.all(), SceneLights::notes)
    }

    /// Whether it is a sequence, which has an end.
    pub fn is_sequence(&self) -> bool {
        self.scene.as_ref().is_some_and(SceneLights::is_sequence)
    }

    /// Whether all frames have the same light.
    pub fn stands_still(&self) -> bool {
        self.cubes.len() == 1 && self.scene.as_ref().is_none_or(SceneLights::stand_still)
    }
}

/// The irradiance files of a folder in natural order. Other files are skipped with a note.
fn folder(path: &Path, camera: &Camera, told: &mut Notes) -> Result<Vec<IrradianceCube>> {
    let failed = |e| Error::io("read", path, e);
    let entries = std::fs::read_dir(path).map_err(failed)?;
    let mut files = Vec::new();
    for entry in entries {
        files.push(entry.map_err(failed)?.path());
    }
    files.retain(|file| file.is_file());
    let name =
        |file: &PathBuf| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    files.sort_by_cached_key(|file| natural_order(&name(file)));
    let (mut cubes, mut left_out) = (Vec::new(), Vec::new());
    for file in &files {
        match IrradianceCube::open(file) {
            Ok(cube) => cubes.push(expose::checked(cube, file, camera, told)?),
            Err(error) if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("irr")) => {
                return Err(error);
            }
            Err(_) => left_out.push(file.display().to_string()),
        }
    }
    if !left_out.is_empty() {
        eprintln!("note: skipped, not irradiance: {}", left_out.join(", "));
    }
    Ok(cubes)
}
