//! Taking a plan's stacks with a simulated camera.

use super::plan::Shot;
use camrig_base::Bands;
use camrig_base::output::OutputDir;
use camrig_base::{Error, RawFrame, Result};
use camrig_camera::{Camera, FrameClock};
use camrig_captures::manifest::ManifestWriter;
use camrig_captures::{Capture, CapturedScene, Light, Role, SensorFacts, Uniformity};
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_formats::{Format, Frames};
use camrig_light::photometry::HC;
use camrig_light::{Lamps, LightLevel};
use camrig_optics::Options;
use camrig_render::readout::Readout;
use camrig_render::{Arithmetic, SceneInLight, SceneIrradiance, SceneLight, SimulatedSensor};
use camrig_render::{lamp_rows, scene_irradiance};
use camrig_rig::SensorStage;
use camrig_sensor_core::config::FrameSettings;
use std::collections::BTreeSet;
use std::path::Path;

/// Mean signal of a flat as a fraction of saturation where the plan gives none: the point at
/// which EMVA 1288 measures non-uniformity.
const DEFAULT_FILL: f64 = 0.5;

/// Share of saturated samples beyond which a stack that is not meant to saturate is refused. A
/// trade: clipping bends means and variances from the first clipped sample on, but hot pixels
/// saturate in any light, and a stack must not be refused for them.
const MAX_SATURATED: f64 = 1e-3;

/// How a plan is taken.
#[derive(Clone, Copy, Debug, Default)]
pub struct TakeOptions<'a> {
    /// What the set names as its camera: a preset, or a path relative to the set.
    pub camera_name: Option<&'a str>,
    /// Replace an existing set.
    pub force: bool,
    /// Number of the first frame.
    pub first_frame: u32,
    /// Arithmetic of the sensor stage.
    pub arithmetic: Arithmetic,
    /// What is read of each frame.
    pub readout: Readout,
    /// Lamps on flats and targets, for cameras whose rows have their times; each stack begins at
    /// their time 0.
    pub lamps: Option<&'a Lamps>,
    /// Address of the rig that takes the frames; this process unless given.
    pub rig: Option<&'a str>,
    /// Hears what a user should know of scenes, lights and the camera's tables, each once.
    pub told: Option<fn(&str)>,
    /// Hears of links to the rig that broke and are opened again.
    pub link_broken: Option<fn(&Error)>,
}

/// Takes every stack of a plan and writes a capture set. Frames are numbered through from
/// `first_frame`, so that no two frames of the set share temporal noise. `progress` hears of every
/// frame done.
///
/// # Errors
/// A plan that saturates without `saturates = true`, what rendering refuses, and a rig that does
/// not answer.
pub fn take(
    camera: &Camera,
    plan: &[Shot],
    directory: &Path,
    options: &TakeOptions<'_>,
    mut progress: impl FnMut(),
) -> Result<()> {
    check_targets(camera, plan)?;
    let mut stage = SensorStage::open(options.rig, options.arithmetic)?;
    if let Some(tell) = options.link_broken {
        stage.on_broken_link(tell);
    }
    let output = OutputDir::create(directory, options.force)?;
    let facts = facts_read(camera, &options.readout)?;
    // Binned frames are not those of the camera file.
    let camera_name = options.camera_name.filter(|_| options.readout.binning.is_none());
    let mut manifest = ManifestWriter::new(facts, camera_name, &camera.name);
    let mut frame_number = options.first_frame;
    let mut told = BTreeSet::new();
    let mut tell = |note: String| {
        if let (Some(tell), true) = (options.told, !told.contains(&note)) {
            tell(&note);
        }
        told.insert(note);
    };
    let mut lit: Option<((String, SceneLight<'_>), IrradianceCube)> = None;
    for shot in plan {
        let mut light = None;
        let even;
        let cube = match shot.role {
            Role::Dark => {
                even = uniform(camera, 550.0, 10.0, 0.0)?;
                &even
            }
            Role::Flat => {
                let (cube, of) = narrow_band(camera, shot).map_err(|e| e.at(place(shot)))?;
                light = Some(of);
                camera.notes(&cube.header.spectral_bands()).into_iter().for_each(&mut tell);
                even = cube;
                &even
            }
            _ => {
                light = Some(shot.light.clone());
                let seen = target(shot);
                if lit.as_ref().is_none_or(|(of, _)| *of != seen) {
                    let (scene, light) = &seen;
                    let SceneIrradiance { cube, notes, .. } =
                        scene_irradiance(camera, scene, light, &Options::default(), |_, _| ())
                            .map_err(|e| e.at(place(shot)))?;
                    notes.into_iter().for_each(&mut tell);
                    lit = Some((seen, cube));
                }
                &lit.as_ref().ok_or_else(|| Error::internal("no irradiance of a target"))?.1
            }
        };
        // Each stack begins with a start of the sensor.
        let camera = &camera.clone().starting_at(frame_number);
        let sensor = SimulatedSensor::new(camera, &cube.header)?;
        stage.set_camera(&sensor)?;
        let mut clock = clock(camera, options.lamps)?;
        let mut lit_before: Option<IrradianceCube> = None;
        let (mut saturated, mut samples) = (0u64, 0u64);
        for i in 0..shot.frames {
            let settings = settings(camera, shot, frame_number);
            frame_number = frame_number.wrapping_add(1);
            let lit = match (&mut clock, options.lamps) {
                (Some(clock), Some(lamps)) => {
                    lamp_rows(cube, &[], &clock.next(settings.exposure_s.into())?, lamps)?
                }
                _ => None,
            };
            let before = (i > 0).then(|| lit_before.as_ref().unwrap_or(cube));
            let frame = stage.frame(&sensor, lit.as_ref().unwrap_or(cube), before, &settings)?;
            lit_before = lit;
            let white = frame.white_level_dn;
            saturated += frame.data.iter().filter(|&&v| v >= white).count() as u64;
            samples += frame.data.len() as u64;
            let frame = options.readout.of(frame)?;
            let bytes = Format::Npy.encode(&Frames::from_raw(&frame))?;
            output.write(format!("{}/{i:04}.npy", shot.id), &bytes)?;
            progress();
        }
        if !shot.saturates && saturated as f64 > MAX_SATURATED * samples as f64 {
            return Err(Error::limit(format!(
                "{:.1} % of the samples are saturated",
                100.0 * saturated as f64 / samples as f64
            ))
            .at(place(shot))
            .help("lower the light or the exposure, or set saturates = true if that is meant"));
        }
        let settings = settings(camera, shot, 0);
        let files = vec![format!("{}/*.npy", shot.id).into()];
        manifest.push(&Capture {
            analog_gain: f64::from(settings.analog_gain),
            temperature_c: Some(f64::from(settings.temperature_c)),
            light,
            scene: shot.scene.clone(),
            ..Capture::new(&shot.id, shot.role, files, shot.exposure_s)
        });
    }
    output.write("captures.toml", manifest.text()?.as_bytes())?;
    output.finish()
}

/// What a reader of the camera's frames needs to know.
pub fn facts(camera: &Camera) -> SensorFacts {
    let s = &camera.sensor;
    let full_scale = ((1u32 << s.bits) - 1) as u16;
    SensorFacts {
        width: s.width as usize,
        height: s.height as usize,
        bits: u32::from(s.bits),
        cfa: Some(s.cfa.clone()),
        // One that depends on the gain is no figure of the whole set.
        black_level_dn: (s.gains.as_ref().is_none_or(|gains| gains.black_level_dn.is_none()))
            .then_some(s.black_level_dn),
        white_level_dn: full_scale,
        pitch_um: Some(s.pitch_um),
        window: None,
    }
}

/// The facts of what is read of the camera's frames.
fn facts_read(camera: &Camera, readout: &Readout) -> Result<SensorFacts> {
    let whole = facts(camera);
    let blank = RawFrame {
        width: whole.width,
        height: whole.height,
        bits: whole.bits,
        cfa: camera.sensor.cfa.clone(),
        black_level_dn: camera.sensor.black_level_dn,
        white_level_dn: whole.white_level_dn,
        data: vec![0; whole.width * whole.height],
    };
    let read = readout.of(blank)?;
    let pitch_um = whole.pitch_um.map(|pitch| pitch * f64::from(readout.side()));
    Ok(SensorFacts { width: read.width, height: read.height, pitch_um, ..whole })
}

/// The times of a stack's rows, where lamps make them count.
fn clock(camera: &Camera, lamps: Option<&Lamps>) -> Result<Option<FrameClock>> {
    let timing = camera.sensor.timing.filter(|_| lamps.is_some_and(|lamps| !lamps.are_steady()));
    timing.map(|timing| FrameClock::new(timing, camera.sensor.height, None)).transpose()
}

fn settings(camera: &Camera, shot: &Shot, frame: u32) -> FrameSettings {
    let mut settings = camera.settings(frame, shot.exposure_s, shot.analog_gain);
    if let Some(t) = shot.temperature_c {
        settings.temperature_c = t as f32;
    }
    settings
}

/// Even narrow-band light of an irradiance, W m⁻², in a band of `width_nm` around `centre_nm`.
pub fn uniform(
    camera: &Camera,
    centre_nm: f64,
    width_nm: f64,
    irradiance_w_m2: f64,
) -> Result<IrradianceCube> {
    let header = CubeHeader::new(
        (camera.sensor.width as usize, camera.sensor.height as usize),
        &Bands { start_nm: centre_nm, step_nm: width_nm, count: 1 },
        format!("even light of {irradiance_w_m2:e} W/m² at {centre_nm} nm"),
    );
    IrradianceCube::uniform(header, &[(irradiance_w_m2 / width_nm) as f32])
}

/// Electrons per second for 1 W m⁻² of narrow-band light, in the channel that gets most.
pub fn electrons_per_second(camera: &Camera, centre_nm: f64, width_nm: f64) -> f64 {
    let band = Bands { start_nm: centre_nm, step_nm: width_nm, count: 1 };
    let response = camera.sensor.response(&band);
    response.iter().map(|r| r[0] / width_nm).fold(0.0, f64::max)
}

fn narrow_band(camera: &Camera, shot: &Shot) -> Result<(IrradianceCube, Light)> {
    let (Some(centre), width) = (shot.light.wavelength_nm, shot.width_nm) else {
        return Err(Error::input("a flat without wavelength_nm"));
    };
    let gain = shot.analog_gain.unwrap_or(camera.sensor.analog_gain);
    let irradiance = match (shot.light.irradiance_w_m2, shot.fill) {
        (Some(irradiance), _) => irradiance,
        (None, fill) => {
            let per_s = electrons_per_second(camera, centre, width);
            if per_s <= 0.0 {
                return Err(Error::disagreement(format!("the camera is blind at {centre} nm"))
                    .help("choose a wavelength within its quantum efficiency"));
            }
            fill.unwrap_or(DEFAULT_FILL) * camera.sensor.saturation_e(gain)
                / (per_s * shot.exposure_s)
        }
    };
    // The irradiance that the cube holds, not the one asked for: it goes into the manifest.
    let held = f64::from((irradiance / width) as f32) * width;
    let area = (camera.sensor.pitch_um * 1e-6).powi(2);
    let light = Light {
        irradiance_w_m2: Some(held),
        photons_per_pixel_per_s: Some(held * area * centre * 1e-9 / HC),
        wavelength_nm: Some(centre),
        width_nm: Some(width),
        uniformity: Uniformity::Flat,
        ..Light::default()
    };
    Ok((uniform(camera, centre, width, irradiance)?, light))
}

/// Scene and light of a shot of a target, which determine its irradiance.
fn target(shot: &Shot) -> (String, SceneLight<'_>) {
    let scene = shot.scene.as_ref().map(CapturedScene::spec).unwrap_or_default();
    let illuminant = shot.light.illuminant.as_deref();
    (scene, SceneLight { illuminant, level: shot.light.lux.map(LightLevel::Lux) })
}

/// Refuses scenes and lights that cannot be rendered before the first frame is taken.
fn check_targets(camera: &Camera, plan: &[Shot]) -> Result<()> {
    let aspect = f64::from(camera.sensor.width) / f64::from(camera.sensor.height);
    let mut last = None;
    for shot in plan.iter().filter(|shot| !matches!(shot.role, Role::Dark | Role::Flat)) {
        let (scene, light) = target(shot);
        if last.as_ref() != Some(&(scene.clone(), light)) {
            SceneInLight::open(&scene, aspect, &light).map_err(|e| e.at(place(shot)))?;
            last = Some((scene, light));
        }
    }
    Ok(())
}

fn place(shot: &Shot) -> String {
    format!("stack {:?}", shot.id)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan;

    /// A scene of radiance, 0.01 W m⁻² sr⁻¹ nm⁻¹ in three bands, and a plan that looks at it.
    fn street(folder: &Path, light: &str) -> Vec<Shot> {
        let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2, 3), }";
        bytes.extend(format!("{header:<117}\n").bytes());
        bytes.extend([0.01f32; 12].iter().flat_map(|v| v.to_le_bytes()));
        let file = folder.join("street.npy");
        std::fs::write(&file, bytes).unwrap();
        plan::parse(&format!(
            "format = \"plan/1\"\n[[stack]]\nid = \"street\"\nrole = \"scene\"\nframes = 1\n\
             exposure_s = 0.01\n{light}\n\
             scene = {{ scene = '{}:quantity=radiance,start_nm=500,step_nm=50' }}\n",
            file.display()
        ))
        .unwrap()
    }

    #[test]
    fn a_level_scales_a_scene_of_radiance_and_an_illuminant_is_refused_before_a_frame() {
        let folder = tempfile::tempdir().unwrap();
        let mut camera = Camera::load("mt9v024").unwrap();
        (camera.sensor.width, camera.sensor.height) = (16, 12);
        let out = folder.path().join("set");
        let taken = |light: &str| {
            let plan = street(folder.path(), light);
            take(&camera, &plan, &out, &TakeOptions::default(), || ())
        };
        for light in
            ["light = { illuminant = \"A\", lux = 20.0 }", "light = { illuminant = \"A\" }"]
        {
            let said = taken(light).unwrap_err().to_string();
            assert!(
                said.contains("stack \"street\"") && said.contains("holds radiance"),
                "{said}"
            );
            assert!(!out.exists(), "{light}");
        }
        taken("").unwrap();
        let manifest = std::fs::read_to_string(out.join("captures.toml")).unwrap();
        assert!(!manifest.contains("lux") && !manifest.contains("illuminant"), "{manifest}");
        // Less light than its own, 730 cd/m².
        let mean = |frame: &str| {
            let raw = std::fs::read(out.join(frame)).unwrap();
            let samples = raw[raw.len() - 2 * 16 * 12..].chunks_exact(2);
            samples.map(|b| f64::from(u16::from_le_bytes([b[0], b[1]]))).sum::<f64>() / 192.0
        };
        let mut means = Vec::new();
        for lux in [100.0, 200.0] {
            std::fs::remove_dir_all(&out).unwrap();
            taken(&format!("light = {{ lux = {lux:?} }}")).unwrap();
            means.push(mean("street/0000.npy"));
            let manifest = std::fs::read_to_string(out.join("captures.toml")).unwrap();
            assert!(manifest.contains(&format!("lux = {lux:?}")), "{manifest}");
        }
        let black = camera.sensor.black_level_dn;
        let ratio = (means[1] - black) / (means[0] - black);
        assert!((ratio - 2.0).abs() < 0.2, "{means:?}");
    }
}
