//! `camrig simulate`: scene to raw.

use super::arguments::{self, FrameArgs, positive};
use crate::camera::Camera;
use crate::optics::Options;
use crate::render::{self, Exposure, IrradianceCube};
use crate::rig::{FrameRequest, Rig};
use crate::scene::{self, Illuminant, LightLevel, LitScene, Quantity, photometry};
use crate::{Error, Result};
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// Scene to raw: spectral scene, lens, sensor
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig simulate --camera mt9t012 --scene colorchecker --lux 300 --exposure 20ms -o chart.dng\n  \
    camrig simulate --camera my.toml --scene cube.npy --exposure 10ms -o picture.png")]
pub struct Args {
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    frames: FrameArgs,
    /// Also keep the irradiance on the sensor, for `camrig expose`
    #[arg(long, value_name = "FILE")]
    save_irradiance: Option<PathBuf>,
}

/// Camera, scene and light.
#[derive(clap::Args, Debug)]
pub struct ViewArgs {
    /// Camera file, or a preset: mt9t012, mt9v024, mobile
    #[arg(long, value_name = "C")]
    pub camera: String,
    /// Built-in chart (colorchecker, slanted-edge:angle=5, uniform:0.18, ...) or a scene file
    #[arg(long, value_name = "S")]
    pub scene: String,
    /// Light on a reflectance scene: D65, A, F11, D5000K, blackbody:3200, or a CSV
    #[arg(long, default_value = "D65", value_name = "I")]
    pub illuminant: String,
    /// Scene illuminance, lx (300 unless given for a reflectance scene)
    #[arg(long, value_parser = positive, value_name = "X", allow_negative_numbers = true)]
    #[arg(conflicts_with = "luminance")]
    pub lux: Option<f64>,
    /// Luminance of a perfect white, cd/m²
    #[arg(long, value_parser = positive, value_name = "L", allow_negative_numbers = true)]
    pub luminance: Option<f64>,
    /// Cells per pixel and direction in the optics stage; chosen by error otherwise
    #[arg(long, value_name = "S")]
    pub oversample: Option<usize>,
    /// Run the optics stage even where its result is in the cache (~/.cache/camrig/optics)
    #[arg(long)]
    pub no_cache: bool,
}

/// What the optics stage gave, and what it was made from.
pub struct View {
    /// The camera.
    pub camera: Camera,
    /// The light, where the scene is one of reflectances.
    pub light: Option<Illuminant>,
    /// Irradiance on the sensor.
    pub cube: IrradianceCube,
    /// Figures of the optics stage.
    pub optics: crate::optics::Report,
    /// Whether they came from the cache.
    pub cached: bool,
}

const DEFAULT_LUX: f64 = 300.0;

impl ViewArgs {
    /// Runs the optics stage.
    pub fn view(&self) -> Result<View> {
        let camera = Camera::load(&self.camera)?;
        let aspect = f64::from(camera.sensor.width) / f64::from(camera.sensor.height);
        let scene = scene::open_filling(&self.scene, aspect)?;
        scene.notes().iter().for_each(|note| eprintln!("note: {note}"));
        let bands = scene.bands();
        let (light, lux, white) = match scene.quantity() {
            Quantity::Reflectance => {
                let light = Illuminant::parse(&self.illuminant)?;
                let level = match (self.lux, self.luminance) {
                    (_, Some(l)) => LightLevel::Luminance(l),
                    (lux, None) => LightLevel::Lux(lux.unwrap_or(DEFAULT_LUX)),
                };
                let white = photometry::white_radiance(&light, level, &bands)?;
                (Some(light), Some(level.white_luminance() * std::f64::consts::PI), white)
            }
            Quantity::Radiance => {
                if self.lux.is_some() || self.luminance.is_some() {
                    return Err(Error::input(format!("a light level for {:?}", self.scene)).help(
                        "this scene holds radiance, light included; leave --lux and --luminance out",
                    ));
                }
                (None, None, vec![1.0; bands.count])
            }
        };
        let lit = LitScene { scene: &*scene, white };
        let options = Options { oversample: self.oversample, ..Options::default() };
        let bar = arguments::progress("optics", bands.count as u64);
        let made_of = format!("scene {}, lens of {}", self.scene, camera.name);
        let illuminant = light.as_ref().map(|l| l.name.clone());
        let about = render::About { lux, illuminant, made_of };
        let directory = if self.no_cache { None } else { crate::optics::content::directory() };
        let rendered = render::cache::irradiance(
            &camera,
            &lit,
            &options,
            about,
            directory.as_deref(),
            |done, _| bar.set_position(done as u64),
        )
        .map_err(|e| e.at(&self.scene))?;
        bar.finish_and_clear();
        if rendered.hit {
            eprintln!("note: optics from the cache (--no-cache runs them again)");
        }
        let render::cache::Rendered { cube, report: optics, hit: cached } = rendered;
        Ok(View { camera, light, cube, optics, cached })
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let mut sink = args.frames.sink()?;
    let View { camera, light, cube, optics, cached } = args.view.view()?;
    if let Some(path) = &args.save_irradiance {
        cube.save(path, args.frames.force)?;
    }
    let exposure = Exposure::new(&camera, &cube.header, 1.0)?;
    expose_frames(&args.frames, &camera, &exposure, &cube, light.as_ref(), &mut sink)?;
    let written = sink.finish()?;
    let object = json!({
        "camera": camera.name,
        "frames": written,
        "optics": {
            "oversample": optics.oversample.iter().max(),
            "margin_pixels": optics.margin_pixels,
            "step_error": optics.step_error,
            "cached": cached,
        },
    });
    arguments::report(&written, object, args.frames.json);
    Ok(ExitCode::SUCCESS)
}

/// Takes the frames and writes them.
pub fn expose_frames(
    args: &FrameArgs,
    camera: &Camera,
    exposure: &Exposure,
    cube: &IrradianceCube,
    light: Option<&Illuminant>,
    sink: &mut arguments::FrameSink,
) -> Result<()> {
    let mut rig = args.rig.as_deref().map(Rig::open).transpose()?;
    if let Some(rig) = &mut rig {
        rig.set_camera(exposure)?;
    }
    let bar = arguments::progress("frames", u64::from(args.frames));
    for i in 0..args.frames {
        let settings = args.settings(camera, i);
        let before = if i > 0 { Some(cube) } else { None };
        let frame = match &mut rig {
            None => exposure.frame(cube, before, &settings, args.arith)?,
            Some(rig) => {
                let request = FrameRequest {
                    settings,
                    arithmetic: args.arith,
                    collapse: false,
                    lit_before: before.is_some(),
                    by_registers: false,
                };
                rig.frame(cube, exposure, &request)?.to_raw(exposure)?
            }
        };
        let description = format!(
            "{}; sensor seed {}, frame {}",
            cube.header.made_of, camera.sensor.seed, settings.frame
        );
        let mut info = render::dng_info(camera, &settings, light, &description)?;
        if args.opcodes {
            let corrections = render::corrections(camera, &settings)?;
            (info.opcode_list1, info.opcode_list2) = (corrections.list1, corrections.list2);
        }
        sink.write(&frame, &info)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(())
}
