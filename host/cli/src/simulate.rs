//! `camrig simulate`: scene to raw.

use super::arguments::{self, CameraArgs, DeviceArgs, FrameArgs, frames_per_s, positive};
use super::frame_sink::FrameSink;
use super::notes::Notes;
use super::scene_lights::{NextLight, SceneLights, SequenceArgs};
use super::times::TimeArgs;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_exposure::{CubeHeader, IrradianceCube};
use camrig_light::{Illuminant, LightLevel};
use camrig_optics::{Misplaced, NodeReport, Options, content};
use camrig_render::SimulatedSensor;
use camrig_render::{self as render, Motion, OpticsOutput, OpticsPath, OpticsStage};
use camrig_report::simulation;
use camrig_rig::SensorStage;
use camrig_sensor_core::config::FrameSettings;
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// Simulate raw frames of a scene: spectral scene, lens, sensor
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig simulate --camera mt9t012 --scene colorchecker --lux 300 --exposure 20ms \
    -o chart.dng\n  \
    camrig simulate --camera my.toml --scene cube.npy --exposure 10ms -o picture.png\n  \
    camrig simulate --camera mt9t012 --scene photo.png --path components --exposure 10ms \
    -o photo.dng\n  \
    camrig simulate --camera mobile --scene slanted-edge --exposure 10ms -o a.npy \
    --report a.html\n  \
    camrig simulate --camera mobile --scene colorchecker --exposure 10ms --noise none \
    -o clean.dng\n  \
    camrig simulate --camera mobile --scene colorchecker --exposure 10ms --bracket -2,0,2 \
    -o bracket\n  \
    camrig simulate --camera mt9v024 --scene dots --exposure 5ms --frames 30 --motion 4,0 \\\n    \
        --rolling 0.8 -o - --to SRGGB16 | \\\n    \
        ffplay -f rawvideo -pixel_format bayer_rggb16le -video_size 752x480 -\n  \
    camrig simulate --camera mt9v024 --set sensor.timing.line_time_us=20 --scene dots \\\n    \
        --exposure 2ms --lamp pulse:hz=90,duty=0.1 --frames 10 -o led\n  \
    camrig simulate --camera mt9v024 --set sensor.timing.line_time_us=20 --scene seq \\\n    \
        --scene-rate 240 --fps 30 --exposure 10ms -o moving")]
pub struct Args {
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    frames: FrameArgs,
    #[command(flatten)]
    time: TimeArgs,
    /// Frame rate of the sensor, frames/s (30, 30000/1001); decides which frame of a sequence is
    /// shown when
    #[arg(long, value_name = "F", value_parser = frames_per_s)]
    fps: Option<f64>,
    /// Also save the irradiance on the sensor, for `camrig expose`
    #[arg(long, value_name = "FILE")]
    save_irradiance: Option<PathBuf>,
}

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
        let level = match (self.lux, self.luminance) {
            (_, Some(luminance)) => Some(LightLevel::Luminance(luminance)),
            (lux, None) => lux.map(LightLevel::Lux),
        };
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
    pub(super) fn view_with(&self, camera: &Camera, told: &mut Notes) -> Result<OpticsOutput> {
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
pub(super) fn tell_optics(view: &OpticsOutput, told: &Notes) {
    if let Some(warning) = view.optics.nodes.and_then(|nodes| nodes.warning()) {
        told.warn(&warning);
    }
    if let Some(device) = &view.optics.device {
        eprintln!("note: optics on {device}");
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let until_over = args.view.sequence.is_sequence(&args.view.scene)?;
    if until_over && args.save_irradiance.is_some() {
        return Err(Error::unsupported("--save-irradiance of a sequence").help(
            "irradiance is saved for one scene: give a single file of the folder as --scene; \
             convert video to pictures first (ffmpeg -i clip.y4m %04d.png). rig stream \
             --irradiance takes a folder of saved files",
        ));
    }
    let frames = FrameArgs { until_over, ..args.frames.clone() };
    let mut sink = frames.sink()?;
    let readout = &frames.readout;
    if readout.adds_charge() && args.view.motion.is_some() {
        return Err(Error::unsupported("charge binning of a moving scene")
            .help("bin digitally, or omit --motion: its pixels are single ones"));
    }
    let mut camera = readout.camera(args.view.camera.load()?)?;
    camera.first_frame = frames.first_number();
    let times = args.time.times(&camera, args.fps)?;
    let told = Notes::default();
    let (mut lights, first) = SceneLights::open(&args.view, &camera, args.fps, times, told)?;
    if frames.hdr.is_some() && lights.change_within_frames() {
        return Err(Error::unsupported(
            "two exposures in one frame of light that changes with time",
        )
        .help("omit --hdr, or use steady light"));
    }
    let OpticsOutput { light, cube, optics, cached, lens_traced, collapse, .. } = first;
    if let Some(path) = &args.save_irradiance {
        if !lights.stand_still() {
            eprintln!(
                "note: {} contains the still scene in steady light, unlike the frames",
                path.display()
            );
        }
        cube.save(path, frames.force)?;
    }
    let sensor = SimulatedSensor::new(&camera, &cube.header)?;
    let exposure_s = frames.exposure_s(&camera, &sensor, &cube)?;
    let of = (&camera, &sensor, exposure_s);
    let mut next = |frame, exposure_s| lights.next(frame, exposure_s, &cube);
    let taken = expose_frames(&frames, of, (&cube, &mut next), light.as_ref(), &mut sink)?;
    lights.tell_end(taken, frames.frames);
    let mut made_of = vec![
        ("scene", args.view.scene.clone()),
        ("camera", camera.name.clone()),
        ("arithmetic", frames.arith.to_string()),
        (
            "cells per pixel and direction",
            optics.oversample.iter().max().unwrap_or(&1).to_string(),
        ),
        ("margin of the optics", format!("{} pixels", optics.margin_pixels)),
    ];
    made_of.extend(optics.nodes.iter().flat_map(psf_rows));
    made_of.extend(optics.device.iter().map(|device| ("optics on", device.clone())));
    made_of.extend(light_of(&cube.header));
    made_of.extend(readout.rows());
    made_of.extend(noise_row(&camera));
    let settings = frames.settings(&camera, exposure_s, 0);
    let written = sink.finish(|frames| {
        let title = format!("{} through {}", args.view.scene, camera.name);
        simulation::page(&title, &camera, light.as_ref(), &settings, &made_of, frames)
    })?;
    let object = json!({
        "camera": camera.name,
        "frames": written,
        "exposure_s": exposure_s,
        "noise": camera.sensor.kept_noise.name(),
        "scene_frames": lights.counts(),
        "timing": lights.timing(exposure_s),
        "optics": {
            "path": args.view.path.name(),
            "collapse": collapse,
            "oversample": optics.oversample.iter().max(),
            "margin_pixels": optics.margin_pixels,
            "step_error": optics.step_error,
            "psf": optics.nodes,
            "device": optics.device.as_deref().unwrap_or("cpu"),
            "cached": cached,
            "lens_traced": lens_traced,
        },
        "notes": lights.notes(),
    });
    arguments::report(&written, object, frames.json);
    Ok(ExitCode::SUCCESS)
}

/// How PSFs were interpolated, for a report.
fn psf_rows(nodes: &NodeReport) -> [(&'static str, String); 2] {
    let percent = |m: &Misplaced| {
        format!(
            "misplaces {:.2} % of the light (mean; {:.2} % at worst)",
            100.0 * m.mean,
            100.0 * m.largest
        )
    };
    [
        (
            "PSFs between nodes",
            format!("{} x {} nodes: {}", nodes.grid.0, nodes.grid.1, percent(&nodes.nodes)),
        ),
        (
            "PSFs between field points of the lens data",
            nodes
                .heights
                .as_ref()
                .map_or("not known".into(), |m| format!("{}, estimated", percent(m))),
        ),
    ]
}

/// The light that irradiance was made with, for a report.
pub fn light_of(header: &CubeHeader) -> Vec<(&'static str, String)> {
    let light = header.illuminant.clone().map(|name| ("illuminant", name));
    let lux = header.lux.map(|lux| ("scene illuminance", format!("{lux} lx")));
    light.into_iter().chain(lux).collect()
}

/// Which noise the frames have if not all of it, for a report.
pub fn noise_row(camera: &Camera) -> Option<(&'static str, String)> {
    camera.sensor.kept_noise.note().map(|note| ("noise", note.to_string()))
}

/// The light of frames 0, 1, ... at their exposures, s.
pub type Lights<'a> = dyn FnMut(u32, f64) -> Result<NextLight> + 'a;

/// Takes and writes the frames of a camera; returns how many. `exposure_s` is the exposure before
/// bracketing; `first` is the irradiance of the first frame, and `next` computes it for frames
/// whose irradiance differs.
pub fn expose_frames(
    args: &FrameArgs,
    (camera, sensor, exposure_s): (&Camera, &SimulatedSensor, f64),
    (first, next): (&IrradianceCube, &mut Lights<'_>),
    illuminant: Option<&Illuminant>,
    sink: &mut FrameSink,
) -> Result<u64> {
    let mut stage = SensorStage::open(args.rig.as_deref(), args.arith)?;
    stage.on_broken_link(arguments::broken_link);
    if let Some(held) = stage.cleared() {
        eprintln!("note: cleared the rig's {held}, left by an earlier host");
    }
    stage.set_camera(sensor)?;
    sink.set_camera(|| args.readout.figures(camera))?;
    let bar = arguments::frames_bar(args.count());
    let mut taken = 0;
    // Irradiance of this frame and of the previous one, unless it is that of the first.
    let (mut changed, mut before) = (None, None);
    for i in 0..args.count() {
        if sink.is_asked_to_stop() {
            break;
        }
        let settings = args.settings(camera, exposure_s, i);
        let mut same = true;
        match next(i, settings.exposure_s.into())? {
            NextLight::Same => {}
            NextLight::Changed(cube) => {
                before = changed.replace(cube);
                same = false;
            }
            NextLight::Over => break,
        }
        let cube = changed.as_ref().unwrap_or(first);
        let before = (i > 0).then(|| if same { cube } else { before.as_ref().unwrap_or(first) });
        let mut take = |settings: &FrameSettings| stage.frame(sensor, cube, before, settings);
        let frame = match args.hdr {
            None => take(&settings)?,
            Some(hdr) => {
                let [long, short] = hdr.frames(settings.frame);
                let exposure_s = settings.exposure_s / hdr.ratio() as f32;
                let long = take(&settings.with_frame(long))?;
                let short = take(&settings.with_frame(short).with_exposure(exposure_s))?;
                hdr.interleave(&long, &short)?
            }
        };
        let info = render::frame_info(camera, &settings, illuminant, &cube.header, args.opcodes)?;
        sink.write(&args.readout.readout().of(frame)?, &info)?;
        taken += 1;
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(taken)
}
