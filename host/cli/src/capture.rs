//! `camrig capture`: simulates a complete capture set.

use super::arguments::{CameraArgs, arithmetic, broken_link, progress};
use super::readout::ReadoutArgs;
use super::times::{self, LampArgs};
use camrig_base::Result;
use camrig_base::numbers::counted;
use camrig_capture::{plan, take};
use camrig_render::Arithmetic;
use std::path::PathBuf;
use std::process::ExitCode;

/// Simulate a complete capture set: dark, flat, edge and chart stacks of a plan
#[derive(clap::Args, Debug)]
#[command(after_help = "Built-in plans: diagnosis, optics, emva, ptc, paper. Examples:\n  \
    camrig capture --camera mt9v024 --plan ptc -o captures\n  \
    camrig measure ptc captures\n  \
    camrig capture --camera mt9v024 --size 128,128 --plan ptc --rig emulator: -o from-rig\n  \
    camrig capture --camera mt9v024 --set sensor.timing.line_time_us=20 --plan ptc \\\n    \
        --lamp mains:hz=100,depth=0.05 -o flicker")]
pub struct Args {
    #[command(flatten)]
    camera: CameraArgs,
    /// Built-in plan or plan file
    #[arg(long, value_name = "P")]
    plan: String,
    /// Directory of the capture set
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Number of the first frame, the seed of the set's temporal noise
    #[arg(long, default_value_t = 0, value_name = "K")]
    frame_seed: u32,
    /// Frames per stack [default: those of the plan]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Simulate a smaller sensor with the same pixels
    #[arg(long, value_name = "W,H", value_parser = side_lengths)]
    size: Option<(u32, u32)>,
    #[command(flatten)]
    lamps: LampArgs,
    #[command(flatten)]
    readout: ReadoutArgs,
    /// Arithmetic of the sensor stage
    #[arg(long, value_parser = arithmetic(), default_value_t)]
    arith: Arithmetic,
    /// Take the frames with a rig, with the same bytes: emulator:, tcp://HOST:PORT, serial://...,
    /// hid://...
    #[arg(long, value_name = "URL")]
    rig: Option<String>,
    /// Replace an existing set
    #[arg(long)]
    force: bool,
}

fn side_lengths(text: &str) -> Result<(u32, u32), String> {
    let sides: Option<(u32, u32)> = text
        .split_once([',', 'x'])
        .and_then(|(w, h)| Some((w.trim().parse().ok()?, h.trim().parse().ok()?)));
    sides
        .filter(|s| s.0 > 0 && s.1 > 0)
        .ok_or_else(|| format!("{text:?}: use for instance 256,192"))
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let mut camera = args.camera.load()?;
    if let Some((width, height)) = args.size {
        camera.sensor.width = width.min(camera.sensor.width);
        camera.sensor.height = height.min(camera.sensor.height);
    }
    let camera = args.readout.camera(camera)?;
    let mut shots = plan::load(&args.plan)?;
    if let Some(frames) = args.frames {
        shots.iter_mut().for_each(|s| s.frames = frames);
    }
    let total: u64 = shots.iter().map(|s| u64::from(s.frames)).sum();
    let bar = progress("frames", total);
    // The set can refer to a preset by name; a file may later be moved relative to the set.
    let lamps = args.lamps.of(&camera)?;
    times::refuse_regions(&lamps, "a capture set")?;
    let options = take::TakeOptions {
        camera_name: args.camera.preset().filter(|_| !args.readout.adds_charge()),
        force: args.force,
        first_frame: args.frame_seed,
        arithmetic: args.arith,
        readout: args.readout.readout(),
        lamps: Some(&lamps),
        rig: args.rig.as_deref(),
        told: Some(|note| eprintln!("note: {note}")),
        link_broken: Some(broken_link),
    };
    take::take(&camera, &shots, &args.output, &options, || bar.inc(1))?;
    bar.finish_and_clear();
    let (frames, stacks) = (counted(total as usize, "frame"), counted(shots.len(), "stack"));
    eprintln!("wrote {frames} in {stacks} to {}", args.output.display());
    Ok(ExitCode::SUCCESS)
}
