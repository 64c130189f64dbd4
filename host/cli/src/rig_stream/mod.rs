//! `camrig rig stream`: frames of irradiance to a rig, raw frames back.

mod light;
pub(super) mod output;
pub(super) mod pace;
pub(super) mod record;
mod report;

use super::arguments::{
    self, CameraArgs, DeviceArgs, arithmetic, duration, frames_per_s, gain, positive,
};
use super::live;
use super::readout::ReadoutArgs;
use super::rig_frames::{FaultArgs, RigFrames};
use super::scene_lights::SceneLights;
use super::times::{self, TimeArgs};
use super::view_args::{self, SequenceArgs};
use crate::stop::Stoppable;
use camrig_base::{ErrorCode, Result};
use camrig_camera::Camera;
use camrig_exposure::IrradianceCube;
use camrig_render::{Arithmetic, OpticsPath, SimulatedSensor};
use camrig_rig::script::{Script, Write, exposure_cut, settings_held};
use camrig_rig::trigger::Trigger;
use camrig_rig::{FrameRequest, Rig};
use camrig_rig_link::registers::address;
use indicatif::ProgressBar;
use light::Light;
use output::{Output, Takes};
use pace::Pace;
use report::{Outcome, Record};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Send irradiance to a rig frame by frame, and receive raw frames
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig rig stream tcp://127.0.0.1:7420 --camera mt9v024 --irradiance a.irr \\\n    \
        --exposure 20ms --frames 100\n  \
    camrig rig stream serial:///dev/ttyACM0 --camera mt9v024 --scene dots --exposure 5ms \\\n    \
        --fps 2 -o out.csi2\n  \
    camrig rig stream emulator: --camera mt9v024 --scene ramp --script loop.toml --json\n  \
    camrig rig stream emulator: --camera mt9v024 --scene dots --exposure 5ms --frames 20 \\\n    \
        --faults faults.txt --fault-log faults.jsonl -o out.csi2\n  \
    camrig rig stream emulator: --camera mt9v024 --set sensor.timing.line_time_us=20 \\\n    \
        --scene ramp --lamp mains:hz=100,depth=0.3 --script loop.toml -o flicker.csi2\n  \
    camrig rig stream emulator: --camera mt9v024 --scene dots --motion 2,0 --exposure 5ms \\\n    \
        --frames 90 -o - --to SRGGB16 | ffmpeg -f rawvideo -pixel_format bayer_rggb16le \\\n    \
        -video_size 752x480 -i - dots.mp4\n\n\
    A script:\n  \
    format = \"rig-script/1\"\n  \
    [[write]]\n  \
    before_frame = 5\n  \
    exposure_s = 0.02            # or analog_gain, or registers = { \"0x0202\" = 800 }")]
pub struct Args {
    /// Address of the rig
    url: String,
    #[command(flatten)]
    camera: CameraArgs,
    /// Scene, or a sequence: a folder of pictures or cubes, video (clip.y4m), or a stream of video
    /// or camrig-frames/1 from standard input (-) or from a socket on which camrig listens
    /// (tcp://127.0.0.1:PORT, unix:PATH)
    #[arg(
        long,
        value_name = "S",
        allow_hyphen_values = true,
        required_unless_present = "irradiance",
        conflicts_with = "irradiance"
    )]
    scene: Option<String>,
    /// Light on a reflectance scene [default: D65]
    #[arg(long, value_name = "I", conflicts_with = "irradiance")]
    illuminant: Option<String>,
    /// Scene illuminance, lx; a radiance scene is scaled to it
    #[arg(long, value_parser = positive, value_name = "X", conflicts_with = "irradiance")]
    lux: Option<f64>,
    #[command(flatten)]
    sequence: SequenceArgs,
    #[command(flatten)]
    time: TimeArgs,
    #[command(flatten)]
    device: DeviceArgs,
    /// Move the scene: pixels per frame, to the right and down
    #[arg(
        long,
        value_name = "DX,DY",
        value_parser = view_args::pair,
        allow_hyphen_values = true,
        requires = "scene"
    )]
    motion: Option<[f64; 2]>,
    /// Rolling shutter: fraction of the frame period in which the rows are read, 0 to 1
    #[arg(
        long,
        value_name = "PART",
        value_parser = view_args::part,
        default_value_t = 0.0,
        requires = "motion"
    )]
    rolling: f64,
    /// How light gets from scene to sensor: bands, or, faster, components or live (see `camrig
    /// simulate --help`)
    #[arg(long, value_name = "PATH", default_value = "bands", requires = "scene")]
    path: OpticsPath,
    /// Irradiance saved by `camrig simulate --save-irradiance`, or a directory of such files: one
    /// per frame, repeated in turn, in natural order of their names
    #[arg(long, value_name = "FILE|DIR")]
    irradiance: Option<PathBuf>,
    /// Exposure time; otherwise set by the rig's registers
    #[arg(
        long,
        value_parser = duration,
        allow_hyphen_values = true,
        value_name = "TIME",
        required_unless_present_any = ["by_registers", "script"]
    )]
    exposure: Option<f64>,
    /// Use exposure and gain from the rig's registers
    #[arg(long, conflicts_with_all = ["exposure", "gain"])]
    by_registers: bool,
    /// Script of register writes, each before the frame it names; implies --by-registers
    #[arg(long, value_name = "FILE", conflicts_with_all = ["exposure", "gain"])]
    script: Option<PathBuf>,
    /// Analog gain [default: that of the camera file]
    #[arg(long, value_parser = gain, value_name = "G")]
    gain: Option<f64>,
    /// Number of frames [default: 10, or those of a sequence]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Number of the first frame
    #[arg(long, default_value_t = 0, value_name = "K")]
    frame_seed: u32,
    #[command(flatten)]
    readout: ReadoutArgs,
    /// Arithmetic of the rig's sensor stage
    #[arg(long, value_parser = arithmetic(), default_value_t)]
    arith: Arithmetic,
    /// Send mean electrons instead of spectral bands: fewer bytes, 2⁻¹⁷ more rounding
    #[arg(long)]
    collapse: bool,
    /// Frame rate, frames/s (30, 30000/1001). The exit status is 1 if less than 97 % of it was
    /// reached; with --json, see `pace_kept` instead
    #[arg(long, value_parser = frames_per_s, value_name = "F")]
    fps: Option<f64>,
    /// Write each frame as soon as it arrives to a file, a named pipe or - (standard output;
    /// figures then go to standard error). A file ends with a complete frame however the stream
    /// ends
    #[arg(short, long, value_name = "OUT", allow_hyphen_values = true)]
    output: Option<PathBuf>,
    /// Output format, if the name does not determine it: csi2 (default for -), mcap (recording of
    /// ROS 2 images with CameraInfo; times from --fps, or measured), pgm, y4m (sensors without
    /// colour filters), bayerlink (pixels of a display link, or bayerlink:WIDTHxHEIGHT), or the
    /// V4L2 name of headerless pixels. csi2 has an embedded data line in each frame and numbers
    /// frames by the sensor's counter, so that lost frames leave a gap. Headerless pixels are
    /// scaled if they have another bit depth than the sensor: from 10 bits, SRGGB16 is shifted left
    /// by 6 and SRGGB8 right by 2
    #[arg(long, value_name = "FORMAT", requires = "output")]
    to: Option<String>,
    /// Do not return the raw rows: the rig sends them out through its own raw output (DVP, CSI,
    /// FPGA), and the link carries a receipt for each
    #[arg(long, conflicts_with_all = ["output", "roi", "binning", "faults"])]
    rows_stay: bool,
    #[command(flatten)]
    faults: FaultArgs,
    /// Replace existing output
    #[arg(long)]
    force: bool,
    /// Print one JSON object at the end; takes some 80 bytes of memory per frame until then
    #[arg(long)]
    json: bool,
}

/// Default number of frames of a scene without an end.
const FRAMES: u32 = 10;

/// Performs a script's writes before a frame; prints the settings of the first frame, and where the
/// frame length limits the exposure.
fn write_registers(
    rig: &mut Rig,
    script: Option<&Script>,
    frame: u32,
    by_registers: bool,
) -> Result<()> {
    const CUTTING: [u16; 2] = [address::COARSE_INTEGRATION_TIME, address::FRAME_LENGTH_LINES];
    let mut look = by_registers && frame == 0;
    for write in script.into_iter().flat_map(|script| script.before(frame)) {
        write.apply(rig).map_err(|e| e.at(format!("script, before frame {frame}")))?;
        look |= matches!(write, Write::Register(at, _) if CUTTING.contains(&(at & !1)));
    }
    if by_registers
        && frame == 0
        && let Some(held) = settings_held(rig)?
    {
        eprintln!("note: settings from the rig's registers: {held}");
    }
    if look && let Some(cut) = exposure_cut(rig)? {
        eprintln!("note: before frame {frame}: {cut}");
    }
    Ok(())
}

/// Writes the camera file's line time and frame length, if it has them, to the rig's registers.
fn program_timing(rig: &mut Rig, args: &Args, camera: &Camera) -> Result<()> {
    let Some(times) = args.time.times(camera, args.fps)? else { return Ok(()) };
    let (line_ns, lines) = times.registers();
    times::program(rig, (line_ns, lines))?;
    eprintln!(
        "note: wrote line time and frame length of the camera file to the rig's registers: \
         {line_ns} ns, {lines} lines"
    );
    Ok(())
}

/// A rig, what it is given, and what its frames are.
struct Opened {
    camera: Camera,
    script: Option<Script>,
    rig: Rig,
    light: Light,
    /// A sensor for each of the light's cubes.
    sensors: Vec<SimulatedSensor>,
}

impl Opened {
    /// What the arguments name.
    fn of(args: &Args) -> Result<Self> {
        if args.irradiance.is_some() {
            args.readout.refuse_charge()?;
        }
        let mut camera = args.readout.camera(args.camera.load()?)?;
        camera.first_frame = args.frame_seed;
        let script = args.script.as_deref().map(Script::load).transpose()?;
        let mut rig = Rig::open(&args.url)?;
        rig.on_broken_link(arguments::broken_link);
        tell_injected(&mut rig)?;
        let light = Light::open(args, &camera)?;
        let sensors = light.sensors(&camera)?;
        if args.by_registers || script.is_some() {
            program_timing(&mut rig, args, &camera)?;
        }
        times::frame_period(&camera, args.fps)?.of(args.exposure.unwrap_or(0.0))?;
        Ok(Self { camera, script, rig, light, sensors })
    }

    /// Takes so many frames.
    fn frames(
        &mut self,
        args: &Args,
        count: u32,
        output: Option<&mut dyn Takes>,
        taken: &mut Taken,
        bar: &ProgressBar,
    ) -> Result<()> {
        let Self { camera, script, rig, light, sensors } = self;
        let stream = Stream { args, camera, cubes: &light.cubes, sensors, count };
        stream.frames(rig, script.as_ref(), light.scene.as_mut(), output, taken, bar)
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let mut output = Output::open(args)?;
    let mut opened = Opened::of(args)?;
    if let Some(output) = &mut output {
        output.prepare(args, &opened.camera, &opened.sensors[0])?;
    }
    let before = opened.rig.link_bytes();
    let usual = if opened.light.is_sequence() { u32::MAX } else { FRAMES };
    let count = args.frames.unwrap_or(usual);
    let trigger = args.fps.map(Trigger::steady);
    let mut taken = Taken { pace: Pace::new(trigger), outcome: Outcome::default() };
    let stop = Stoppable::new();
    let takes = output.as_mut().map(|output| output as &mut dyn Takes);
    let bar = arguments::frames_bar(count);
    let ended = opened.frames(args, count, takes, &mut taken, &bar);
    bar.finish_and_clear();
    let Opened { rig, mut light, .. } = opened;
    let Taken { mut pace, mut outcome } = taken;
    pace.finish();
    if let Some(scene) = &mut light.scene {
        scene.tell_end(pace.frames(), args.frames.filter(|_| ended.is_ok() && !stop.is_asked()));
        outcome.scene_frames = scene.counts();
    }
    outcome.notes = light.notes().to_vec();
    outcome.broke_off = ended.is_err();
    if pace.frames() > 0 {
        report::tell(args, &rig, before, &pace, &outcome);
    }
    let finished = output.as_mut().map_or(Ok(()), Output::finish);
    if let Some(output) = &output {
        let whole = output.count();
        let place = live::named(output.path());
        if stop.is_asked() {
            eprintln!("interrupted: {whole} whole frames in {place}");
        } else if ended.is_err() && whole > 0 {
            eprintln!("the stream broke off: {whole} whole frames in {place}");
        } else if ended.is_ok() {
            output.check_any()?;
        }
    }
    ended?;
    finished?;
    if let Some(said) = pace.said() {
        eprintln!("{said}");
    }
    let failed = !args.json && pace.is_kept() == Some(false);
    Ok(if failed { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// Reports registers of an earlier host that affect this stream's frames. A rig need not have
/// registers, and one that does not answer about them can still take frames.
fn tell_injected(rig: &mut Rig) -> Result<()> {
    match rig.injected() {
        Ok(None) => Ok(()),
        Ok(Some(held)) => {
            eprintln!(
                "note: the rig's registers hold {held} from before this stream, which its frames \
                 will show"
            );
            Ok(())
        }
        Err(error) if error.code() == Some(ErrorCode::RigNotFound) => {
            eprintln!("note: the rig does not answer about its fault and test-pattern registers");
            Ok(())
        }
        Err(error) => Err(error),
    }
}

/// The inputs of a stream.
struct Stream<'a> {
    args: &'a Args,
    camera: &'a Camera,
    /// Irradiance of the light.
    cubes: &'a [IrradianceCube],
    /// A sensor for each of the cubes.
    sensors: &'a [SimulatedSensor],
    /// Maximum number of frames.
    count: u32,
}

/// What has been received of a stream, also if it broke off.
struct Taken {
    pace: Pace,
    outcome: Outcome,
}

impl Stream<'_> {
    /// Takes the frames, until there are enough or a signal asks to stop.
    fn frames(
        &self,
        rig: &mut Rig,
        script: Option<&Script>,
        scene: Option<&mut SceneLights>,
        mut output: Option<&mut dyn Takes>,
        taken: &mut Taken,
        bar: &ProgressBar,
    ) -> Result<()> {
        let (args, stop) = (self.args, Stoppable::new());
        let by_registers = args.by_registers || script.is_some();
        let period = times::frame_period(self.camera, args.fps)?;
        let as_packets = output.as_ref().is_some_and(|output| output.has_packets());
        let injection = args.faults.open(&self.sensors[0], as_packets, args.force)?;
        let mut frames =
            RigFrames::new(self.cubes, self.sensors, scene, args.collapse).with_faults(injection);
        frames.begin(rig)?;
        let start = output.as_mut().map(|output| output.begin());
        taken.pace.start(start.transpose()?.unwrap_or_else(Instant::now));
        for i in 0..self.count {
            let script = script.filter(|_| !frames.has_stuck_registers(i));
            write_registers(rig, script, i, by_registers)?;
            if !frames.light(rig, i, args.exposure)? {
                break;
            }
            taken.pace.wait(rig, &stop);
            if stop.is_asked() {
                break;
            }
            let due = taken.pace.due(i.into());
            taken.pace.begin();
            let request = self.request(i, by_registers);
            let asked = (!by_registers).then_some(request.settings);
            let frame = frames.take(rig, i, request)?;
            let time = taken.pace.end();
            if let Some(restored) = &frame.restored {
                eprintln!(
                    "note: in frame {i} the rig restarted with other registers; restored: \
                     {restored}"
                );
            }
            if frame.dropped {
                taken.outcome.dropped += 1;
                let standby = by_registers && rig.read_register(address::MODE_SELECT)? == 0;
                taken.outcome.standby += u64::from(standby);
            }
            period.of(frame.start.exposure.exposure_s.into())?;
            taken.outcome.exposure_missed += u64::from(frames.missed(&frame));
            taken.outcome.count_settings(asked, frame.start.exposure);
            if args.json {
                taken.outcome.records.push(Record::new(&frame, time));
            }
            if let Some(output) = &mut output {
                output.take(&frame, frames.sensor(i), due.unwrap_or(time.begin))?;
            }
            bar.inc(1);
        }
        Ok(())
    }

    /// The request for a frame.
    fn request(&self, frame: u32, by_registers: bool) -> FrameRequest {
        let args = self.args;
        let number = args.frame_seed.wrapping_add(frame);
        FrameRequest {
            arithmetic: args.arith,
            by_registers,
            rows_stay: args.rows_stay,
            ..FrameRequest::new(self.camera.settings(
                number,
                args.exposure.unwrap_or(1.0),
                args.gain,
            ))
        }
    }
}
