//! `camrig rig record`: rigs that take frames on one trigger, in one recording.

use super::output::Takes;
use super::pace::Pace;
use super::report::Outcome;
use super::{Opened, Taken};
use crate::arguments;
use crate::readout::ReadoutArgs;
use crate::stop::Stoppable;
use camrig_base::numbers::counted;
use camrig_base::output::LiveOutput;
use camrig_base::{Error, RawFrame, Result};
use camrig_formats::mcap::{CameraInfo, Recorded, Recording};
use camrig_render::SimulatedSensor;
use camrig_rig::RigFrame;
use camrig_rig::trigger::{Together, Triggered};
use clap::Parser;
use indicatif::ProgressBar;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;
use std::time::Instant;

/// Record several rigs that take frames on one trigger
///
/// Each camera has its own rig, scene and options, and its own clock: it begins so long after the
/// trigger as the file says. The recording (MCAP, ROS 2) has the images and figures of all cameras
/// under their names, stamped with the time at which each exposure begins.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig rig record pair.toml -o pair.mcap --log pair.jsonl\n\n\
    A file of cameras:\n  \
    format = \"rig-cameras/1\"\n  \
    fps = 30\n  \
    frames = 60\n  \
    [[camera]]\n  \
    name = \"left\"              # topics /left/image_raw and /left/camera_info\n  \
    options = [\"--camera\", \"mt9v024\", \"--scene\", \"dots\", \"--exposure\", \"5ms\"]\n  \
    [[camera]]\n  \
    name = \"right\"\n  \
    rig = \"tcp://127.0.0.1:7420\" # the emulator, if left out\n  \
    offset_s = 0.001           # or jitter_s, drift_ppm\n  \
    options = [\"--camera\", \"mt9v024\", \"--scene\", \"dots\", \"--exposure\", \"5ms\"]")]
pub struct Args {
    /// File of cameras
    cameras: PathBuf,
    /// Recording (.mcap), or - for standard output
    #[arg(short, long, value_name = "OUT", allow_hyphen_values = true)]
    output: PathBuf,
    /// Write when each frame was triggered and when it began, a JSON object on a line
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Replace existing output
    #[arg(long)]
    force: bool,
    /// Print one JSON object at the end
    #[arg(long)]
    json: bool,
}

/// The options of a camera, as after `camrig rig stream`.
#[derive(Parser)]
#[command(name = "options", no_binary_name = true, disable_help_flag = true)]
struct Line {
    #[command(flatten)]
    args: super::Args,
}

/// What a camera gives to the recording.
enum Given {
    /// A frame of its facts, and its figures: it can begin.
    Ready(RawFrame, CameraInfo),
    /// The next frame, and when it began, s after the first trigger; none of one that was dropped.
    Frame(Option<(RawFrame, f64)>),
}

/// A camera's end of the recording.
struct Recorder<'a> {
    readout: &'a ReadoutArgs,
    like: Option<(RawFrame, CameraInfo)>,
    given: SyncSender<Given>,
    start: Receiver<Instant>,
}

/// The recording's end of a camera.
struct Camera<'a> {
    name: &'a str,
    trigger: camrig_rig::trigger::Trigger,
    given: Receiver<Given>,
    start: SyncSender<Instant>,
    dropped: u64,
}

/// What a camera says when the recording has ended before it.
fn ended<T>(_: T) -> Error {
    Error::input("the recording has ended")
}

impl Takes for Recorder<'_> {
    fn begin(&mut self) -> Result<Instant> {
        if let Some((like, figures)) = self.like.take() {
            self.given.send(Given::Ready(like, figures)).map_err(ended)?;
        }
        self.start.recv().map_err(ended)
    }

    fn take(&mut self, frame: &RigFrame, sensor: &SimulatedSensor, time_s: f64) -> Result<()> {
        let raw = match frame.dropped {
            true => None,
            false => Some((self.readout.readout().of(frame.to_raw(sensor)?)?, time_s)),
        };
        self.given.send(Given::Frame(raw)).map_err(ended)
    }

    fn has_packets(&self) -> bool {
        false
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let together = Together::load(&args.cameras)?;
    let at = |camera: &Triggered, e: Error| {
        e.at(format!("{}, camera {:?}", args.cameras.display(), camera.name))
    };
    let options = together.cameras.iter().map(|c| options(c).map_err(|e| at(c, e)));
    let options = options.collect::<Result<Vec<_>>>()?;
    let mut output = LiveOutput::create(&args.output, args.force)?;
    let log = args.log.as_ref().map(|path| LiveOutput::create(path, args.force));
    let mut log = log.transpose()?;
    let (taken, recorded) = thread::scope(|scope| {
        let (mut works, mut cameras) = (Vec::new(), Vec::new());
        for (camera, args) in together.cameras.iter().zip(&options) {
            // A frame ahead of the others, so that none waits for who writes.
            let (given, frames) = sync_channel(1);
            let (start, starts) = sync_channel(1);
            let recorder = Recorder { readout: &args.readout, like: None, given, start: starts };
            let work = move || take(camera, args, together.frames, recorder);
            works.push((camera, scope.spawn(work)));
            cameras.push(Camera {
                name: &camera.name,
                trigger: camera.trigger,
                given: frames,
                start,
                dropped: 0,
            });
        }
        let recorded = record(&mut cameras, together.frames, &mut output, log.as_mut());
        let dropped: Vec<u64> = cameras.iter().map(|camera| camera.dropped).collect();
        drop(cameras); // who still takes frames ends
        let taken = works.into_iter().map(|(camera, work)| match work.join() {
            Ok(taken) => taken.map_err(|e| at(camera, e)),
            Err(panic) => std::panic::resume_unwind(panic),
        });
        let taken: Vec<Result<Pace>> = taken.collect();
        (taken, recorded.map(|frames| (frames, dropped)))
    });
    // A camera that failed ended the others, whose errors say only that.
    let is_cause = |e: &Error| e.what() != ended(()).what();
    let (mut paces, mut others) = (Vec::new(), Vec::new());
    for taken in taken {
        match taken {
            Err(cause) if is_cause(&cause) => return Err(cause),
            Err(other) => others.push(other),
            Ok(pace) => paces.push(pace),
        }
    }
    let (frames, dropped) = recorded?;
    if let (true, Some(other)) = (paces.len() < together.cameras.len(), others.pop()) {
        return Err(other);
    }
    let places = || together.cameras.iter().zip(&paces).zip(&dropped);
    for ((camera, pace), _) in places() {
        pace.said().iter().for_each(|said| eprintln!("{}: {said}", camera.name));
    }
    if args.json {
        let cameras = places().map(|((camera, pace), dropped)| {
            json!({
                "name": camera.name,
                "frames": pace.frames(),
                "frames_dropped": dropped,
                "frames_late": pace.late(),
                "rate_hz": pace.frames_per_s(),
            })
        });
        println!("{}", json!({ "frames": frames, "cameras": cameras.collect::<Vec<Value>>() }));
    } else {
        let cameras = counted(together.cameras.len(), "camera");
        eprintln!("{} of {cameras} in {}", counted(frames, "frame"), args.output.display());
    }
    Ok(())
}

/// The options of a camera.
fn options(camera: &Triggered) -> Result<super::Args> {
    let words = std::iter::once(&camera.rig).chain(&camera.options);
    let line = Line::try_parse_from(words).map_err(|e| {
        let text = e.to_string();
        let what = text.lines().next().unwrap_or_default().trim_start_matches("error: ");
        Error::input(what).help("options are those of `camrig rig stream`")
    })?;
    let mut args = line.args;
    for (is_given, name) in [
        (args.output.is_some(), "--output"),
        (args.fps.is_some(), "--fps"),
        (args.frames.is_some(), "--frames"),
        (args.rows_stay, "--rows-stay"),
        (args.json, "--json"),
    ] {
        if is_given {
            return Err(Error::input(format!("{name} of one of several cameras"))
                .help("the recording has one for all: leave it out"));
        }
    }
    args.fps = Some(camera.trigger.fps);
    Ok(args)
}

/// Takes the frames of a camera.
fn take(
    camera: &Triggered,
    args: &super::Args,
    count: u32,
    mut recorder: Recorder<'_>,
) -> Result<Pace> {
    let mut opened = Opened::of(args)?;
    let sensor = &opened.sensors[0];
    let pixels = sensor.config.width as usize * sensor.config.height as usize;
    let like = args.readout.readout().of(sensor.raw_frame(vec![0; pixels], 1.0))?;
    recorder.like = Some((like, args.readout.figures(&opened.camera)?));
    let mut taken = Taken { pace: Pace::new(Some(camera.trigger)), outcome: Outcome::default() };
    opened.frames(args, count, Some(&mut recorder), &mut taken, &ProgressBar::hidden())?;
    taken.pace.finish();
    Ok(taken.pace)
}

/// Records so many frames of each camera, those of a trigger in the order in which they began, and
/// returns how many there were.
fn record(
    cameras: &mut [Camera<'_>],
    count: u32,
    output: &mut LiveOutput,
    mut log: Option<&mut LiveOutput>,
) -> Result<usize> {
    let stop = Stoppable::new();
    let mut ready = Vec::new();
    for camera in cameras.iter() {
        match camera.given.recv() {
            Ok(Given::Ready(like, figures)) => ready.push((like, figures)),
            _ => return Ok(0), // it failed, and says why
        }
    }
    let topics = ready.iter().zip(cameras.iter());
    let topics = topics.map(|((like, figures), camera)| Recorded {
        name: camera.name,
        like,
        info: Some(*figures),
    });
    let mut recording = Recording::of(&topics.collect::<Vec<_>>())?;
    let start = Instant::now();
    for camera in cameras.iter() {
        camera.start.send(start).map_err(ended)?;
    }
    let bar = arguments::frames_bar(count);
    let mut frames = 0;
    'triggers: for trigger in 0..u64::from(count) {
        if stop.is_asked() {
            break;
        }
        let mut of_trigger = Vec::new();
        for (i, camera) in cameras.iter_mut().enumerate() {
            match camera.given.recv() {
                Ok(Given::Frame(Some((raw, begin_s)))) => of_trigger.push((i, Some(raw), begin_s)),
                Ok(_) => {
                    camera.dropped += 1;
                    of_trigger.push((i, None, camera.trigger.begin_s(trigger)));
                }
                Err(_) => break 'triggers, // its scene is over, or it failed
            }
        }
        of_trigger.sort_by(|a, b| a.2.total_cmp(&b.2));
        for (i, raw, begin_s) in of_trigger {
            if let Some(log) = &mut log {
                let line = json!({
                    "frame": trigger,
                    "camera": cameras[i].name,
                    "trigger_s": cameras[i].trigger.trigger_s(trigger),
                    "begin_s": begin_s,
                    "dropped": raw.is_none(),
                });
                log.push(format!("{line}\n").as_bytes())?;
            }
            let Some(raw) = raw else { continue };
            let stamp_ns = (begin_s * 1e9).round() as u64;
            output.push(&recording.frame_of(i, &raw, stamp_ns)?)?;
            frames += 1;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    output.push(&recording.finish()?)?;
    Ok(frames)
}
