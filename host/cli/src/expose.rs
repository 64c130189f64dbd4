//! `camrig expose`: the sensor stage alone.

use super::arguments::{self, CameraArgs, FrameArgs, positive};
use super::notes::Notes;
use super::scene_lights::NextLight;
use super::simulate::{light_of, noise_row};
use super::taking::{Sensor, Subject, expose_frames};
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::IrradianceCube;
use camrig_light::Illuminant;
use camrig_render as render;
use camrig_report::simulation;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Run only the sensor stage on saved irradiance: another exposure, gain, light level or noise
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig simulate --camera mt9t012 --scene colorchecker --exposure 20ms \\\n    \
        -o a.dng --save-irradiance a.irr\n  \
    camrig expose --camera mt9t012 --irradiance a.irr --exposure 40ms --lux 10 -o dark.dng")]
pub struct Args {
    #[command(flatten)]
    camera: CameraArgs,
    /// Irradiance saved by `camrig simulate --save-irradiance`
    #[arg(long, value_name = "FILE")]
    irradiance: PathBuf,
    /// Scene illuminance, lx [default: the one it was computed for]
    #[arg(long, value_parser = positive, value_name = "X", allow_negative_numbers = true)]
    lux: Option<f64>,
    #[command(flatten)]
    frames: FrameArgs,
}

/// Opens irradiance that was made for `camera`, and prints its notes.
pub fn open(path: &Path, camera: &Camera, notes: &mut Notes) -> Result<IrradianceCube> {
    checked(IrradianceCube::open(path)?, path, camera, notes)
}

/// Checks that a cube from `path` was made for `camera`, and prints its notes.
pub fn checked(
    cube: IrradianceCube,
    path: &Path,
    camera: &Camera,
    notes: &mut Notes,
) -> Result<IrradianceCube> {
    render::check_made_for(camera, &cube.header).map_err(|e| e.at(path.display()))?;
    notes.tell_irradiance(camera, &cube.header)?;
    Ok(cube)
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    args.frames.readout.refuse_charge()?;
    let mut camera = args.camera.load()?;
    let mut sink = args.frames.sink(&camera)?;
    camera.first_frame = args.frames.first_number();
    let mut notes = Notes::default();
    let cube = open(&args.irradiance, &camera, &mut notes)?;
    let factor = match (args.lux, cube.header.lux) {
        (None, _) => 1.0,
        (Some(wanted), Some(made_for)) => wanted / made_for,
        (Some(_), None) => {
            return Err(Error::input("--lux for irradiance of unknown illuminance")
                .at(args.irradiance.display())
                .help("omit --lux, or change the exposure"));
        }
    };
    let light = cube.header.illuminant.as_deref().map(Illuminant::parse).transpose()?;
    let sensor = Sensor::in_light(&camera, &cube.header, factor, &args.frames.readout)?;
    let exposure_s = args.frames.exposure_s(&camera, sensor.first(), &cube)?;
    let (illuminant, first) = (light.as_ref(), &cube);
    let subject = Subject { camera: &camera, sensor: &sensor, exposure_s, illuminant, first };
    expose_frames(&args.frames, &subject, &mut |_, _| Ok(vec![NextLight::Same]), &mut sink)?;
    let mut header = cube.header.clone();
    header.lux = args.lux.or(header.lux);
    let mut made_of = vec![("irradiance of", header.made_of.clone())];
    made_of.extend(light_of(&header));
    made_of.extend(args.frames.readout.rows());
    made_of.extend(noise_row(&camera));
    let settings = args.frames.settings(&camera, exposure_s, 0);
    let written = sink.finish(|frames| {
        let title = format!("{} in other light or settings", camera.name);
        simulation::page(&title, &camera, light.as_ref(), &settings, &made_of, frames)
    })?;
    let object = json!({
        "camera": camera.name,
        "frames": written,
        "exposure_s": exposure_s,
        "noise": camera.sensor.kept_noise.name(),
        "notes": notes.all(),
    });
    arguments::report(&object, args.frames.json);
    Ok(ExitCode::SUCCESS)
}
