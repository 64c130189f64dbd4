//! `camrig rig stream`: frames of irradiance to a rig, raw frames back.

use super::arguments::{self, DeviceArgs, arithmetic, duration, positive};
use super::rig_pace::Pace;
use super::simulate::ViewArgs;
use camrig_base::output;
use camrig_base::{Error, Plane, RawFrame, Result};
use camrig_camera::Camera;
use camrig_exposure::IrradianceCube;
use camrig_formats::{Format, Frames, csi2};
use camrig_render::{Arithmetic, SimulatedSensor};
use camrig_rig::script::{Script, Write, exposure_cut};
use camrig_rig::stage::{changing_light, remembering};
use camrig_rig::{FrameRequest, Rig, RigFrame, feed::Feed};
use camrig_rig_link::message::Fault;
use camrig_rig_link::registers::address;
use serde_json::{Value, json};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Send frames of irradiance, take raw frames back
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig rig stream tcp://127.0.0.1:7420 --camera mt9v024 --irradiance a.irr --exposure 20ms \
    --frames 100\n  \
    camrig rig stream serial:///dev/ttyACM0 --camera mt9v024 --scene dots --exposure 5ms --fps 2 \
    -o out.csi2\n  \
    camrig rig stream emulator: --camera mt9v024 --scene ramp --script loop.toml --frames 20 \
    --json\n\n\
    A script:\n  \
    format = \"rig-script/1\"\n  \
    [[write]]\n  \
    before_frame = 5\n  \
    exposure_s = 0.02            # or analog_gain, or registers = { \"0x0202\" = 800 }")]
pub struct Args {
    /// Address of the rig
    url: String,
    /// Camera file or preset
    #[arg(long, value_name = "C")]
    camera: String,
    /// Scene to look at
    #[arg(
        long,
        value_name = "S",
        required_unless_present = "irradiance",
        conflicts_with = "irradiance"
    )]
    scene: Option<String>,
    /// Light on a reflectance scene (D65 unless given)
    #[arg(long, value_name = "I", conflicts_with = "irradiance")]
    illuminant: Option<String>,
    /// Scene illuminance, lx; a radiance scene is scaled to it
    #[arg(long, value_parser = positive, value_name = "X", conflicts_with = "irradiance")]
    lux: Option<f64>,
    #[command(flatten)]
    device: DeviceArgs,
    /// Irradiance kept by `camrig simulate --save-irradiance`, or a directory of them: one for
    /// each frame, over and over, in the order of the numbers in their names
    #[arg(long, value_name = "FILE|DIR")]
    irradiance: Option<PathBuf>,
    /// Integration time; the rig's registers decide unless given
    #[arg(
        long,
        value_parser = duration,
        allow_hyphen_values = true,
        value_name = "TIME",
        required_unless_present_any = ["by_registers", "script"]
    )]
    exposure: Option<f64>,
    /// Take exposure and gain from the rig's registers
    #[arg(long, conflicts_with_all = ["exposure", "gain"])]
    by_registers: bool,
    /// Write registers as this script says, before the frames it names; implies --by-registers
    #[arg(long, value_name = "FILE", conflicts_with_all = ["exposure", "gain"])]
    script: Option<PathBuf>,
    /// Analog gain; the camera file's unless given
    #[arg(long, value_parser = positive, value_name = "G")]
    gain: Option<f64>,
    /// Frames to send
    #[arg(
        long,
        default_value_t = 10,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    frames: u32,
    /// Number of the first frame
    #[arg(long, default_value_t = 0, value_name = "K")]
    frame_seed: u32,
    /// Arithmetic of the rig's sensor stage
    #[arg(long, value_parser = arithmetic(), default_value_t)]
    arith: Arithmetic,
    /// Send mean electrons instead of spectral bands: less to send, 2⁻¹⁷ more rounding
    #[arg(long)]
    collapse: bool,
    /// Pace to this frame rate, frames per second. Ends with status 1 where less than 97 % of it
    /// was reached; with --json, `pace_kept` says so instead
    #[arg(long, value_parser = positive, value_name = "F")]
    fps: Option<f64>,
    /// Keep the frames as a CSI-2 stream with embedded data lines; the frame numbers are those of
    /// the sensor's counter, so that lost frames leave a gap
    #[arg(short, long, value_name = "FILE.csi2")]
    output: Option<PathBuf>,
    /// Replace existing output
    #[arg(long)]
    force: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Where the frames' light comes from.
fn cubes(args: &Args, camera: &Camera) -> Result<Vec<IrradianceCube>> {
    if let Some(scene) = &args.scene {
        let illuminant = args.illuminant.as_deref();
        let view = ViewArgs::still(&args.camera, scene.clone(), illuminant, args.lux, args.device);
        return Ok(vec![view.view()?.1.cube]);
    }
    let path =
        args.irradiance.as_ref().ok_or_else(|| Error::input("neither scene nor irradiance"))?;
    let cubes = if path.is_dir() {
        folder(path, camera)?
    } else {
        vec![super::expose::open(path, camera)?]
    };
    let same = cubes.windows(2).all(|w| {
        let (a, b) = (&w[0].header, &w[1].header);
        (a.width, a.height, a.spectral_bands()) == (b.width, b.height, b.spectral_bands())
    });
    if cubes.is_empty() || !same {
        return Err(Error::disagreement("irradiance files of different sizes or bands, or none")
            .at(path.display())
            .help(format!("give files made for {}", camera.name)));
    }
    Ok(cubes)
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
            Ok(cube) => cubes.push(super::expose::checked(cube, file, camera)?),
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

/// Memory for rows in their form on the link, bytes: where all cubes fit, their rows are made once
/// for all frames. A trade: a gibibyte that any workstation has to spare.
const KEPT_BYTES: usize = 1 << 30;

fn feed<'a>(cube: &'a IrradianceCube, sensor: &'a SimulatedSensor, args: &Args) -> Feed<'a> {
    if args.collapse { Feed::collapsed(cube, sensor) } else { Feed::spectral(cube) }
}

/// Refuses a name that is not that of a CSI-2 stream, which is all that is written here.
fn check_name(path: &Path) -> Result<()> {
    if matches!(Format::from_path(path), Ok(Format::Csi2)) {
        return Ok(());
    }
    Err(Error::unsupported("a rig's frames are kept as a CSI-2 stream, not by this name")
        .at(path.display())
        .help("end the name in .csi2; `camrig convert` makes other formats of it"))
}

/// Frames kept for the output, with what goes into the stream beside them.
#[derive(Default)]
struct Kept {
    raws: Vec<RawFrame>,
    embedded: Vec<Vec<Vec<u8>>>,
    numbers: Vec<u16>,
}

impl Kept {
    fn bytes(self) -> Result<Vec<u8>> {
        let first =
            self.raws.first().ok_or_else(|| Error::input("every frame was dropped, as asked"))?;
        let mut frames = Frames::from_raw(first);
        let plane = |raw: RawFrame| Plane { width: raw.width, height: raw.height, data: raw.data };
        frames.planes = self.raws.into_iter().map(plane).collect();
        let options =
            csi2::Options { line_packets: true, embedded: self.embedded, ..Default::default() };
        csi2::encode_numbered(&frames, &options, &self.numbers)
    }
}

/// CSI-2 frame numbers that follow the sensor's counter: 1 for the first frame of the stream, up
/// to 65535 and then 1 again. A lost frame leaves a gap, a counter that is stuck repeats itself.
#[derive(Default)]
struct Numbers {
    counted: u64,
    last: Option<u16>,
}

impl Numbers {
    fn of(&mut self, counter: u16) -> u16 {
        self.counted += u64::from(counter.wrapping_sub(self.last.unwrap_or(counter)));
        self.last = Some(counter);
        (self.counted % u64::from(u16::MAX) + 1) as u16
    }
}

/// Writes what a script has for a frame; says where the frame length cuts the exposure.
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
    if look && let Some(cut) = exposure_cut(rig)? {
        eprintln!("note: before frame {frame}: {cut}");
    }
    Ok(())
}

/// What came of a stream, beside its times.
#[derive(Default)]
struct Outcome {
    dropped: u32,
    settings: Vec<Value>,
    kept: Kept,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    args.output.as_deref().map(check_name).transpose()?;
    let camera = Camera::load(&args.camera)?;
    let script = args.script.as_deref().map(Script::load).transpose()?;
    let mut file = args
        .output
        .as_ref()
        .map(|path| output::OutputFile::create(path, args.force))
        .transpose()?;
    let mut rig = Rig::open(&args.url)?;
    rig.on_broken_link(arguments::broken_link);
    tell_injected(&mut rig)?;
    let cubes = cubes(args, &camera)?;
    let sensors = cubes.iter().map(|cube| SimulatedSensor::new(&camera, &cube.header, 1.0));
    let sensors = sensors.collect::<Result<Vec<_>>>()?;
    if cubes.len() > 1
        && let Some(effect) = remembering(&sensors[0]).next()
    {
        return Err(changing_light(effect));
    }
    let before = rig.link_bytes();
    let mut pace = Pace::new(args.fps);
    let outcome = frames(args, &mut rig, &camera, (&cubes, &sensors), script.as_ref(), &mut pace)?;
    let Outcome { dropped, settings, kept } = outcome;
    if let Some(file) = &mut file {
        let path = args.output.clone().unwrap_or_default();
        file.write_all(&kept.bytes()?).map_err(|e| Error::io("write", &path, e))?;
    }
    if let Some(file) = file {
        file.finish()?;
    }
    report(args, &rig, before, &pace, dropped, settings);
    if let Some(said) = pace.said() {
        eprintln!("{said}");
    }
    let failed = !args.json && pace.is_kept() == Some(false);
    Ok(if failed { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// Says what registers from before this stream do to its frames. A rig need not have registers, and
/// one that does not answer about them can still take frames.
fn tell_injected(rig: &mut Rig) -> Result<()> {
    match rig.injected() {
        Ok(None) => Ok(()),
        Ok(Some(held)) => {
            eprintln!(
                "note: the rig's registers hold {held} from before this stream, and its frames \
                 show it"
            );
            Ok(())
        }
        Err(error) if error.code() == Some("rig-not-found") => {
            eprintln!("note: the rig does not answer about its fault and test-pattern registers");
            Ok(())
        }
        Err(error) => Err(error),
    }
}

/// Takes the frames.
fn frames(
    args: &Args,
    rig: &mut Rig,
    camera: &Camera,
    (cubes, sensors): (&[IrradianceCube], &[SimulatedSensor]),
    script: Option<&Script>,
    pace: &mut Pace,
) -> Result<Outcome> {
    let mut feeds: Vec<Feed<'_>> =
        cubes.iter().zip(sensors).map(|(cube, sensor)| feed(cube, sensor, args)).collect();
    if feeds.iter().map(Feed::bytes).sum::<usize>() <= KEPT_BYTES {
        feeds = feeds.into_iter().map(Feed::kept).collect();
    }
    let by_registers = args.by_registers || script.is_some();
    let bar = arguments::progress("frames", args.frames.into());
    let mut out = Outcome::default();
    let mut numbers = Numbers::default();
    // Cubes of one light level have one sensor on the rig; another level is another one.
    let mut level = cubes[0].header.level;
    rig.set_camera(&sensors[0])?;
    pace.start();
    for i in 0..args.frames {
        pace.wait(rig);
        write_registers(rig, script, i, by_registers)?;
        let at = i as usize % cubes.len();
        let request = FrameRequest {
            settings: camera.settings(
                args.frame_seed.wrapping_add(i),
                args.exposure.unwrap_or(1.0),
                args.gain,
            ),
            arithmetic: args.arith,
            collapse: args.collapse,
            lit_before: i > 0 && cubes.len() == 1,
            by_registers,
        };
        pace.begin();
        if level != cubes[at].header.level {
            level = cubes[at].header.level;
            rig.set_camera(&sensors[at])?;
        }
        let frame = rig.frame_from(&mut feeds[at], &sensors[at], &request)?;
        pace.end();
        out.settings.push(frame_settings(&frame));
        let number = numbers.of(frame.start.counter);
        if frame.dropped {
            out.dropped += 1;
        } else if args.output.is_some() {
            out.kept.raws.push(frame.to_raw(&sensors[at])?);
            out.kept.embedded.push(vec![frame.embedded_line()]);
            out.kept.numbers.push(number);
        }
        bar.inc(1);
    }
    pace.finish();
    bar.finish_and_clear();
    Ok(out)
}

/// What the sensor says about a frame: what was in force, and what was done to it.
fn frame_settings(frame: &RigFrame) -> Value {
    let start = &frame.start;
    json!({
        "counter": start.counter,
        "frame": start.frame,
        "exposure_s": start.exposure.exposure_s,
        "analog_gain": start.exposure.analog_gain,
        "dropped": frame.dropped,
        "fault": fault(start.fault),
        "test_pattern": start.test_pattern,
    })
}

/// A fault by name, `null` for none.
fn fault(fault: Fault) -> Value {
    match fault {
        Fault::None => Value::Null,
        Fault::DropFrame => json!({ "kind": "drop-frame" }),
        Fault::CorruptRow(row) => json!({ "kind": "corrupt-row", "row": row }),
        Fault::StuckCounter => json!({ "kind": "stuck-counter" }),
        Fault::LateFrame(ms) => json!({ "kind": "late-frame", "ms": ms }),
    }
}

fn report(
    args: &Args,
    rig: &Rig,
    before: (u64, u64),
    pace: &Pace,
    dropped: u32,
    settings: Vec<Value>,
) {
    let (sent, received) = rig.link_bytes();
    let (sent, received) = (sent.saturating_sub(before.0), received.saturating_sub(before.1));
    let s = rig.statistics();
    let repairs: Value = json!({
        "damaged_packets": s.damaged,
        "rewinds": s.rewinds,
        "timeouts": s.timeouts,
    });
    let [p50, p99, max] = pace.latency_ms([0.5, 0.99, 1.0]);
    let (fps, seconds) = (pace.frames_per_s(), pace.seconds());
    if args.json {
        println!(
            "{}",
            json!({
                "frames": args.frames,
                "dropped_on_request": dropped,
                "seconds": seconds,
                "frames_per_s": fps,
                "fps_asked": args.fps,
                "pace_kept": pace.is_kept(),
                "late_frames": args.fps.map(|_| pace.late()),
                "frame_times": pace.json(),
                "latency_p50_ms": p50,
                "latency_p99_ms": p99,
                "latency_max_ms": max,
                "sent_bytes": sent,
                "received_bytes": received,
                "repairs": repairs,
                "settings": settings,
            })
        );
    } else {
        println!("{} frames in {seconds:.2} s: {fps:.2} frames/s", args.frames);
        println!("latency p50 {p50:.1} ms, p99 {p99:.1} ms, largest {max:.1} ms");
        let rate = |bytes: u64| bytes as f64 / seconds / 1e6;
        println!("sent {:.3} MB/s, received {:.3} MB/s", rate(sent), rate(received));
        if s.damaged + s.rewinds + s.timeouts > 0 {
            println!("repairs: {repairs}");
        }
        if dropped > 0 {
            println!("{dropped} frames were dropped, as the rig's fault register asked");
        }
    }
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

    #[test]
    fn frame_numbers_follow_the_counter() {
        let numbers = |counters: &[u16]| {
            let mut numbers = Numbers::default();
            counters.iter().map(|&c| numbers.of(c)).collect::<Vec<_>>()
        };
        assert_eq!(numbers(&[57, 58, 60, 60, 61]), [1, 2, 4, 4, 5]);
        let mut of = Numbers { counted: 65533, last: Some(65534) };
        assert_eq!([65535, 0, 1].map(|counter| of.of(counter)), [65535, 1, 2]);
    }

    #[test]
    fn only_names_of_csi2_streams_are_taken() {
        assert!(check_name(Path::new("a/x.csi2")).is_ok());
        for name in ["x.dng", "x.npy", "x.raw10", "x_64x48_SGRBG10P.raw", "x", ".csi2"] {
            assert!(check_name(Path::new(name)).is_err(), "{name}");
        }
    }
}
