//! The options that state what a camera looks at: camera, scene and light, and how the optics are
//! computed.

use super::arguments::{self, CameraArgs, DeviceArgs, duration, frames_per_s, positive};
use super::notes::Notes;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_light::LightLevel;
use camrig_optics::{Options, content};
use camrig_render::{Motion, OpticsOutput, OpticsPath, OpticsStage};
use camrig_scene_files::sequence::{self, Reading};
use std::time::Duration;

/// Camera, scene and light.
#[derive(clap::Args, Debug)]
pub struct ViewArgs {
    #[command(flatten)]
    pub camera: CameraArgs,
    /// Built-in chart (colorchecker, slanted-edge:angle=5, uniform:0.18, ...), a scene file, a
    /// picture or render (photo.png:as=reflectance, render.exr:primaries=acescg), or a sequence: a
    /// folder of these, video (clip.y4m), or a stream of video or camrig-frames/1 from standard
    /// input (-) or from a socket on which camrig listens (tcp://127.0.0.1:PORT, unix:PATH)
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub scene: String,
    /// Light on a reflectance scene: D65, A, F11, D5000K, blackbody:3200, or a CSV [default: D65]
    #[arg(long, value_name = "I")]
    pub illuminant: Option<String>,
    /// Scene illuminance, lx [default: 300 for a reflectance scene]. A radiance picture is scaled
    /// so that its white (1, or its brightest percentile) is a perfect white in this light; other
    /// radiance scenes so that their mean is 18 % grey
    #[arg(long, value_parser = positive, value_name = "X", allow_negative_numbers = true)]
    #[arg(conflicts_with = "luminance")]
    pub lux: Option<f64>,
    /// Luminance of a perfect white, cd/m²
    #[arg(long, value_parser = positive, value_name = "L", allow_negative_numbers = true)]
    pub luminance: Option<f64>,
    /// Irradiance on a reflectance scene from 300 to 1100 nm, W/m², for lamps that the eye does not
    /// see
    #[arg(long, value_parser = positive, value_name = "W", allow_negative_numbers = true)]
    #[arg(conflicts_with_all = ["lux", "luminance"])]
    pub scene_irradiance: Option<f64>,
    /// Cells per pixel and direction in the optics stage [default: chosen by error]
    #[arg(long, value_name = "S")]
    pub oversample: Option<usize>,
    /// Mean fraction of the light that interpolating PSFs over the field may misplace [default:
    /// 0.01]
    #[arg(long, value_name = "PART", value_parser = positive)]
    pub psf_tolerance: Option<f64>,
    /// How light gets from scene to sensor: bands (one by one), components (12 at once; edges
    /// within some 1e-3 of white), or live (one component per channel, fastest). A note and --json
    /// give their difference from bands
    #[arg(long, value_name = "PATH", default_value = "bands")]
    pub path: OpticsPath,
    /// Move the scene: pixels per frame, to the right and down
    #[arg(long, value_name = "DX,DY", value_parser = pair, allow_hyphen_values = true)]
    pub motion: Option<[f64; 2]>,
    /// Rolling shutter: fraction of the frame period in which the rows are read, 0 to 1
    #[arg(
        long,
        value_name = "PART",
        value_parser = part,
        default_value_t = 0.0,
        requires = "motion"
    )]
    pub rolling: f64,
    #[command(flatten)]
    pub sequence: SequenceArgs,
    #[command(flatten)]
    pub device: DeviceArgs,
    /// Run the optics stage even if its result is cached (~/.cache/camrig/optics)
    #[arg(long)]
    pub no_cache: bool,
}

/// Reads two numbers.
pub fn pair(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|v| v.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y]) if x.is_finite() && y.is_finite() => Ok([x, y]),
        _ => Err(format!("{text:?}: use two numbers, for instance 4,-0.5")),
    }
}

/// Reads a number from 0 to 1.
pub fn part(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|v| (0.0..=1.0).contains(v));
    value.ok_or_else(|| format!("{text:?}: use a number from 0 to 1"))
}

impl ViewArgs {
    /// A still scene seen by an unchanged camera, with the default options.
    pub fn still(
        camera: CameraArgs,
        scene: String,
        illuminant: Option<&str>,
        lux: Option<f64>,
        device: DeviceArgs,
    ) -> Self {
        Self {
            camera,
            scene,
            illuminant: illuminant.map(str::to_owned),
            lux,
            luminance: None,
            scene_irradiance: None,
            oversample: None,
            psf_tolerance: None,
            path: OpticsPath::Bands,
            motion: None,
            rolling: 0.0,
            sequence: SequenceArgs::default(),
            device,
            no_cache: false,
        }
    }

    /// The optics stage for these options.
    pub fn optics_stage(&self) -> Result<OpticsStage> {
        let level = (self.lux.map(LightLevel::Lux))
            .or(self.luminance.map(LightLevel::Luminance))
            .or(self.scene_irradiance.map(LightLevel::Irradiance));
        let cache = if self.no_cache { None } else { content::directory() };
        let motion =
            self.motion.map(|velocity_pixels| Motion { velocity_pixels, rolling: self.rolling });
        Ok(OpticsStage {
            scene: self.scene.clone(),
            illuminant: self.illuminant.clone(),
            level,
            options: Options {
                oversample: self.oversample,
                misplaced_light: self.psf_tolerance.unwrap_or(Options::default().misplaced_light),
                device: self.device.device.open()?,
                ..Options::default()
            },
            cache,
            motion,
            path: self.path,
        })
    }

    /// Loads the camera and runs the optics stage.
    pub fn view(&self) -> Result<(Camera, OpticsOutput)> {
        let camera = self.camera.load()?;
        let view = self.view_with(&camera, &mut Notes::default())?;
        Ok((camera, view))
    }

    /// Runs the optics stage for a camera.
    pub fn view_with(&self, camera: &Camera, told: &mut Notes) -> Result<OpticsOutput> {
        let optics_stage = self.optics_stage()?;
        let bar = arguments::progress("optics", 0);
        told.wait_for(|| format!("computing {}", self.scene));
        let view = optics_stage.run(camera, |done, bands| {
            bar.set_length(bands as u64);
            bar.set_position(done as u64);
            told.wait_for(|| format!("computing {}: {done} of {bands} bands", self.scene));
        })?;
        bar.finish_and_clear();
        told.tell(view.notes.iter().cloned());
        tell_optics(&view, told);
        if view.cached {
            eprintln!("note: optics from the cache (--no-cache runs them again)");
        }
        Ok(view)
    }
}

/// Prints how the optics were computed.
pub fn tell_optics(view: &OpticsOutput, told: &Notes) {
    if let Some(warning) = view.optics.nodes.and_then(|nodes| nodes.warning()) {
        told.warn(&warning);
    }
    if let Some(device) = &view.optics.device {
        eprintln!("note: optics on {device}");
    }
}

/// How a changing scene is read and shown.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct SequenceArgs {
    /// Frame rate of a sequence, frames/s (24, 29.97, 30000/1001), if it does not state one
    #[arg(long, value_name = "HZ", value_parser = frames_per_s)]
    pub scene_rate: Option<f64>,
    /// Repeat a sequence endlessly
    #[arg(long = "loop")]
    pub repeats: bool,
    /// Take the files of a folder while another program writes them, until a file called `end`
    /// appears or nothing new has arrived for the time given by --wait
    #[arg(long)]
    pub watch: bool,
    /// How long --watch waits for the next file, s or with a unit [default: 60 s]
    #[arg(long, value_name = "TIME", value_parser = seconds, requires = "watch")]
    pub wait: Option<f64>,
    /// Longest silence of a stream, s or with a unit [default: 5 s]
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub stall: Option<f64>,
}

/// Default of the time that a watched folder may stay unchanged, s. A trade-off: renderers take
/// minutes for a frame, but one that was stopped should not be waited for much longer.
const WAIT_S: f64 = 60.0;

/// Reads seconds, with a unit or without.
fn seconds(text: &str) -> Result<f64, String> {
    text.parse::<f64>().map_or_else(|_| duration(text), |_| duration(&format!("{text}s")))
}

impl SequenceArgs {
    /// How a sequence is read with these options.
    pub fn reading(&self) -> Reading {
        let usual = Reading::default();
        Reading {
            rate_hz: self.scene_rate,
            watch: self.watch.then(|| Duration::from_secs_f64(self.wait.unwrap_or(WAIT_S))),
            stall: self.stall.map_or(usual.stall, Duration::from_secs_f64),
        }
    }

    /// Whether the scene of that name is a sequence. Refuses options of a sequence for a still
    /// scene.
    pub fn is_sequence(&self, scene: &str) -> Result<bool> {
        if sequence::is_sequence(scene, &self.reading())? {
            return Ok(true);
        }
        let given = [
            (self.scene_rate.is_some(), "--scene-rate"),
            (self.repeats, "--loop"),
            (self.watch, "--watch"),
            (self.stall.is_some(), "--stall"),
        ];
        match given.into_iter().find(|(given, _)| *given) {
            None => Ok(false),
            Some((_, flag)) => Err(Error::input(format!("{flag} for {scene:?}, a still scene"))
                .help("it applies to a folder of pictures or cubes, or to video")),
        }
    }
}
