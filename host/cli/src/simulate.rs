//! `camrig simulate`: scene to raw.

use super::arguments::{self, FrameArgs};
use super::notes::Notes;
use super::scene_lights::SceneLights;
use super::taking::{Sensor, Subject, expose_frames};
use super::times::TimeArgs;
use super::view_args::ViewArgs;
use camrig_base::{Error, Result};
use camrig_camera::{Camera, Window};
use camrig_exposure::CubeHeader;
use camrig_optics::{Misplaced, NodeReport};
use camrig_render::OpticsOutput;
use camrig_report::simulation;
use serde_json::{Value, json};
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
    /// Also save the irradiance on the sensor, for `camrig expose`
    #[arg(long, value_name = "FILE")]
    save_irradiance: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    arguments::report(&written(args)?, args.frames.json);
    Ok(ExitCode::SUCCESS)
}

/// Writes the frames; what they are, for `--json`.
pub fn written(args: &Args) -> Result<Value> {
    let until_over = args.view.sequence.is_sequence(&args.view.scene)?;
    if until_over && args.save_irradiance.is_some() {
        return Err(Error::unsupported("--save-irradiance of a sequence").help(
            "irradiance is saved for one scene: give a single file of the folder as --scene; \
             convert video to pictures first (ffmpeg -i clip.y4m %04d.png). rig stream \
             --irradiance takes a folder of saved files",
        ));
    }
    let frames = FrameArgs { until_over, ..args.frames.clone() };
    let readout = &frames.readout;
    if readout.adds_charge() && args.view.motion.is_some() {
        return Err(Error::unsupported("charge binning of a moving scene")
            .help("bin digitally, or omit --motion: its pixels are single ones"));
    }
    let mut camera = readout.camera(args.view.camera.load()?)?;
    let mut sink = frames.sink(&camera)?;
    camera.first_frame = frames.first_number();
    let times = args.time.times(&camera, frames.fps)?;
    let told = Notes::default();
    let (mut lights, first) = SceneLights::open(&args.view, &camera, frames.fps, times, told)?;
    if frames.hdr.is_some() && lights.change_within_frames() {
        return Err(Error::unsupported(
            "two exposures in one frame of light that changes with time",
        )
        .help("omit --hdr, or use steady light"));
    }
    let OpticsOutput { light, cube, optics, cached, lens_traced, collapse, shown, .. } = first;
    if let Some(path) = &args.save_irradiance {
        if !lights.stand_still() {
            eprintln!(
                "note: {} contains the still scene in steady light, unlike the frames",
                path.display()
            );
        }
        cube.save(path, frames.force)?;
    }
    let sensor = Sensor::in_light(&camera, &cube.header, 1.0, &frames.readout)?;
    if matches!(sensor, Sensor::Several(_)) && lights.change_within_frames() && until_over {
        return Err(Error::unsupported("several windows in one frame of a sequence in time")
            .help(
                "use a still scene with --lamp, one with --motion, or simulate one capture with \
             --capture",
            ));
    }
    let exposure_s = frames.exposure_s(&camera, sensor.first(), &cube)?;
    let (illuminant, first) = (light.as_ref(), &cube);
    let subject = Subject { camera: &camera, sensor: &sensor, exposure_s, illuminant, first };
    let mut next = |frame, windows: &[Window]| lights.in_windows(frame, windows, &cube);
    let taken = expose_frames(&frames, &subject, &mut next, &mut sink)?;
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
    Ok(json!({
        "camera": camera.name,
        "frames": written,
        "exposure_s": exposure_s,
        "noise": camera.sensor.kept_noise.name(),
        "scene_frames": lights.counts(),
        "timing": lights.timing(exposure_s)?,
        "optics": {
            "path": args.view.path.name(),
            "collapse": collapse,
            "scene_cropped": shown.map(|s| json!({
                "scene_aspect": s.content_aspect,
                "frame_aspect": s.frame_aspect,
                "shown_width": s.width(),
                "shown_height": s.height(),
            })),
            "oversample": optics.oversample.iter().max(),
            "margin_pixels": optics.margin_pixels,
            "step_error": optics.step_error,
            "psf": optics.nodes,
            "device": optics.device.as_deref().unwrap_or("cpu"),
            "cached": cached,
            "lens_traced": lens_traced,
        },
        "notes": lights.notes(),
    }))
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
