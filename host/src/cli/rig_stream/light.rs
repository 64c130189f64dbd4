//! The light of a stream: one scene, irradiance files in turn, or a scene that moves.

use super::Args;
use crate::cli::expose;
use crate::cli::simulate::ViewArgs;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_render::{OpticsStage, SimulatedSensor};
use camrig_rig::stage::{changing_light, remembering};
use std::path::{Path, PathBuf};

/// Where the frames' light comes from.
pub struct Light {
    /// Irradiance of the frames in turn, over and over; of a scene that moves, of frame 0.
    pub cubes: Vec<IrradianceCube>,
    /// A scene that moves.
    moving: Option<OpticsStage>,
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
            let view = ViewArgs { motion: args.motion, rolling: args.rolling, ..still };
            let cubes = vec![view.view()?.1.cube];
            let moving = args.motion.map(|_| view.optics_stage()).transpose()?;
            return Ok(Self { cubes, moving });
        }
        let path = args
            .irradiance
            .as_ref()
            .ok_or_else(|| Error::input("neither scene nor irradiance"))?;
        let cubes =
            if path.is_dir() { folder(path, camera)? } else { vec![expose::open(path, camera)?] };
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
        Ok(Self { cubes, moving: None })
    }

    /// The sensor in front of each of the cubes. Refuses light that changes under one that
    /// remembers it.
    ///
    /// # Errors
    /// A cube of another size than the sensor's, an effect with a memory.
    pub fn sensors(&self, camera: &Camera) -> Result<Vec<SimulatedSensor>> {
        let sensors = self.cubes.iter().map(|c| SimulatedSensor::new(camera, &c.header, 1.0));
        let sensors = sensors.collect::<Result<Vec<_>>>()?;
        if !self.stands_still()
            && let Some(effect) = remembering(&sensors[0]).next()
        {
            return Err(changing_light(effect));
        }
        Ok(sensors)
    }

    /// Whether each frame has the light of the one before.
    pub fn stands_still(&self) -> bool {
        self.cubes.len() == 1 && self.moving.is_none()
    }

    /// Irradiance of a frame after the first, where the scene moves.
    ///
    /// # Errors
    /// Those of [`OpticsStage::run_frame`].
    pub fn moved(&self, camera: &Camera, frame: u32) -> Result<Option<IrradianceCube>> {
        let moving = self.moving.as_ref().filter(|_| frame > 0);
        moving.map(|stage| Ok(stage.run_frame(camera, frame, |_, _| ())?.cube)).transpose()
    }
}

/// The irradiance files of a folder in natural order. Other files are left out with a word.
fn folder(path: &Path, camera: &Camera) -> Result<Vec<IrradianceCube>> {
    let failed = |e| Error::io("read", path, e);
    let entries = std::fs::read_dir(path).map_err(failed)?;
    let mut files = Vec::new();
    for entry in entries {
        files.push(entry.map_err(failed)?.path());
    }
    files.retain(|file| file.is_file());
    let name =
        |file: &PathBuf| file.file_name().unwrap_or_default().to_string_lossy().into_owned();
    files.sort_by_cached_key(|file| natural(&name(file)));
    let (mut cubes, mut left_out) = (Vec::new(), Vec::new());
    for file in &files {
        match IrradianceCube::open(file) {
            Ok(cube) => cubes.push(expose::checked(cube, file, camera)?),
            Err(error) if file.extension().is_some_and(|e| e.eq_ignore_ascii_case("irr")) => {
                return Err(error);
            }
            Err(_) => left_out.push(file.display().to_string()),
        }
    }
    if !left_out.is_empty() {
        eprintln!("note: left out, as they are not irradiance: {}", left_out.join(", "));
    }
    Ok(cubes)
}

/// A name as what it is sorted by: its runs of digits as numbers, which have up to 38 digits here.
fn natural(name: &str) -> Vec<(String, u128)> {
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let text = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let (text, after) = rest.split_at(text);
        let digits = after.find(|c: char| !c.is_ascii_digit()).unwrap_or(after.len());
        let (digits, after) = after.split_at(digits);
        let number = if digits.is_empty() { Ok(0) } else { digits.parse() };
        parts.push((text.to_string(), number.unwrap_or(u128::MAX)));
        rest = after;
    }
    parts.push((name.to_string(), 0));
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_sorted_by_the_numbers_in_them() {
        let mut names = ["b1", "a10.irr", "a2.irr", "a1.irr", "a02.irr", "a"];
        names.sort_by_cached_key(|name| natural(name));
        assert_eq!(names, ["a", "a1.irr", "a02.irr", "a2.irr", "a10.irr", "b1"]);
    }
}
