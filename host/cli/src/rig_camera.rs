//! `camrig rig serve --gige` and `--usbip`: the emulator in front of a scene, as a camera on the
//! network (GigE Vision) or on USB (UVC by USB/IP).

use super::arguments::{
    CameraArgs, DeviceArgs, arithmetic, duration, frames_per_s, gain, positive,
};
use super::listen;
use super::notes::Notes;
use super::rig_frames::{FaultArgs, RigFrames};
use super::rig_sensor::{self, Registers};
use super::scene_lights::SceneLights;
use super::times::{self, TimeArgs};
use super::view_args::{self, SequenceArgs, ViewArgs};
use crate::stop::Stoppable;
use camrig_base::numbers::counted;
use camrig_base::{Cfa, Error, Result};
use camrig_camera::Camera;
use camrig_formats::Format;
use camrig_formats::live::{Beside, LiveEncoder};
use camrig_gige::{self as gige, Order, Pace, Pattern, Sensor, Taken, Timing};
use camrig_profiles as profiles;
use camrig_render::readout::Region;
use camrig_render::{Arithmetic, OpticsPath, SimulatedSensor};
use camrig_rig::remembering::remembering;
use camrig_rig::script::Write as Setting;
use camrig_rig::stage::changing_light;
use camrig_rig::{FrameRequest, Rig};
use camrig_rig_link::registers::address;
use camrig_sensor_core::config::FrameSettings;
use camrig_usbip as usbip;
use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{ArgMatches, Command, FromArgMatches};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Frame rate without one asked for or in the camera file, frames/s.
const USUAL_FPS: f64 = 30.0;

/// What the camera sees, and how it begins.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "Camera of --gige and --usbip")]
pub struct Args {
    #[command(flatten)]
    view: OptionalScene,
    #[command(flatten)]
    time: TimeArgs,
    /// Exposure time at the start
    #[arg(
        long,
        requires = "camera_link",
        value_parser = duration,
        allow_hyphen_values = true,
        value_name = "TIME",
        default_value = "10ms"
    )]
    exposure: f64,
    /// Analog gain at the start [default: that of the camera file]
    #[arg(long, requires = "camera_link", value_parser = gain, value_name = "G")]
    gain: Option<f64>,
    /// Frame rate at the start, frames/s [default: that of the camera file's timing, or 30]
    #[arg(long, requires = "camera_link", value_parser = frames_per_s, value_name = "F")]
    fps: Option<f64>,
    /// Registers of a real sensor: exposure, gain and frame rate are what a driver writes to them.
    /// They are on an I2C adapter that Linux attaches beside the camera (modprobe i2c-tiny-usb;
    /// usbip attach -r ADDRESS -b 1-2). A sensor's name such as imx219, or the file of a profile
    #[arg(
        long,
        requires = "usbip",
        conflicts_with_all = ["exposure", "gain", "fps"],
        value_name = "PROFILE"
    )]
    sensor: Option<String>,
    /// Arithmetic of the sensor stage
    #[arg(long, requires = "camera_link", value_parser = arithmetic(), default_value_t)]
    arith: Arithmetic,
    /// Expose mean electrons instead of spectral bands: many times faster, 2⁻¹⁷ more rounding
    #[arg(long, requires = "camera_link")]
    collapse: bool,
    #[command(flatten)]
    faults: FaultArgs,
}

/// Camera and scene.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "Camera of --gige and --usbip")]
struct SceneArgs {
    #[command(flatten)]
    camera: CameraArgs,
    /// Scene, or a sequence: a folder of pictures or cubes, video (clip.y4m), or a stream of video
    /// or camrig-frames/1 from standard input (-) or from a socket on which camrig listens
    /// (tcp://127.0.0.1:PORT, unix:PATH)
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    scene: String,
    /// Light on a reflectance scene [default: D65]
    #[arg(long, value_name = "I")]
    illuminant: Option<String>,
    /// Scene illuminance, lx; a radiance scene is scaled to it
    #[arg(long, value_parser = positive, value_name = "X")]
    lux: Option<f64>,
    #[command(flatten)]
    sequence: SequenceArgs,
    /// Move the scene: pixels per frame, to the right and down
    #[arg(long, value_name = "DX,DY", value_parser = view_args::pair, allow_hyphen_values = true)]
    motion: Option<[f64; 2]>,
    /// How light gets from scene to sensor: bands, or, faster, components or live (see `camrig
    /// simulate --help`)
    #[arg(long, value_name = "PATH", default_value = "bands")]
    path: OpticsPath,
}

impl SceneArgs {
    fn view(&self) -> ViewArgs {
        let still = ViewArgs::still(
            self.camera.clone(),
            self.scene.clone(),
            self.illuminant.as_deref(),
            self.lux,
            DeviceArgs::default(),
        );
        let (motion, path, sequence) = (self.motion, self.path, self.sequence.clone());
        ViewArgs { motion, path, sequence, ..still }
    }
}

/// Camera and scene, which only this kind of `rig serve` has.
#[derive(Debug)]
struct OptionalScene(Option<SceneArgs>);

impl clap::Args for OptionalScene {
    fn augment_args(command: Command) -> Command {
        // Those for an update require none.
        SceneArgs::augment_args_for_update(command)
    }

    fn augment_args_for_update(command: Command) -> Command {
        SceneArgs::augment_args_for_update(command)
    }
}

impl FromArgMatches for OptionalScene {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let others = <SceneArgs as clap::Args>::augment_args_for_update(Command::new(""));
        let typed = |id: &str| matches.value_source(id) == Some(ValueSource::CommandLine);
        let alone = others.get_arguments().map(|a| a.get_id().as_str()).find(|id| typed(id));
        match ["camera", "scene"].map(|id| matches.contains_id(id)) {
            [false, false] => match alone {
                None => Ok(Self(None)),
                Some(id) => Err(clap::Error::raw(
                    ErrorKind::MissingRequiredArgument,
                    format!(
                        "--{} is for --gige and --usbip, with --camera and --scene\n",
                        id.replace('_', "-")
                    ),
                )),
            },
            [true, true] => SceneArgs::from_arg_matches(matches).map(|scene| Self(Some(scene))),
            _ => Err(clap::Error::raw(
                ErrorKind::MissingRequiredArgument,
                "--camera and --scene go together, for --gige and --usbip\n",
            )),
        }
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Args {
    /// Refuses a camera, a scene and faults for a rig that has them from its host.
    pub fn refuse(&self) -> Result<()> {
        if self.view.0.is_none() && !self.time.is_given() && !self.faults.is_given() {
            return Ok(());
        }
        Err(Error::input("camera, scene, lamps or faults of a rig")
            .help("hosts bring these; --gige and --usbip are for applications that do not"))
    }
}

/// Where the camera is connected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Link {
    /// On the network, as GigE Vision.
    Gige(SocketAddrV4),
    /// On USB, which a host attaches by USB/IP.
    Usbip(SocketAddrV4),
}

impl Link {
    /// Reads `ADDRESS` or `ADDRESS:PORT` of a GigE Vision camera.
    pub fn gige(text: &str) -> Result<Self, String> {
        place(text, gige::gvcp::PORT).map(Self::Gige)
    }

    /// Reads `ADDRESS` or `ADDRESS:PORT` of a USB/IP server.
    pub fn usbip(text: &str) -> Result<Self, String> {
        place(text, usbip::protocol::PORT).map(Self::Usbip)
    }

    fn place(self) -> SocketAddrV4 {
        match self {
            Self::Gige(place) | Self::Usbip(place) => place,
        }
    }

    fn open(self) -> Result<Open> {
        let place = self.place();
        let failed = |e: std::io::Error| {
            Error::device(format!("cannot listen there: {e}")).at(place).help(
                "use an address of this machine, and another one of it for each camera: \
                 127.0.0.2, ...",
            )
        };
        Ok(match self {
            Self::Gige(_) if place.ip().is_unspecified() => {
                return Err(Error::input(format!("a camera at {}", place.ip()))
                    .help("a camera tells its address: give that of one interface"));
            }
            Self::Gige(_) => Open::Gige(gige::Server::bind(place).map_err(failed)?),
            Self::Usbip(_) => Open::Usbip(usbip::Server::bind(place).map_err(failed)?),
        })
    }
}

fn place(text: &str, port: u16) -> Result<SocketAddrV4, String> {
    let alone = text.parse::<Ipv4Addr>().map(|ip| SocketAddrV4::new(ip, port));
    alone
        .or_else(|_| text.parse())
        .map_err(|_| format!("{text:?} is not an IPv4 address of this machine such as 127.0.0.1"))
}

/// A link whose sockets are open.
enum Open {
    Gige(gige::Server),
    Usbip(usbip::Server),
}

impl Open {
    fn url(&self) -> String {
        match self {
            Self::Gige(server) => format!("gige://{}", server.address()),
            Self::Usbip(server) => format!("usbip://{}", server.address()),
        }
    }

    /// Serves applications until a signal asks to stop, and says how much was sent.
    fn run(
        &self,
        sensor: Sensor,
        source: &mut Source<'_>,
        bus: Option<&Mutex<profiles::Sensor>>,
    ) -> Result<()> {
        let stop = Stoppable::new();
        match self {
            Self::Gige(server) => {
                let counts = server.run(sensor, source, || stop.is_asked())?;
                eprintln!(
                    "sent {}, {} repeated",
                    counted(counts.blocks as usize, "frame"),
                    counted(counts.repeated as usize, "packet")
                );
            }
            Self::Usbip(server) => {
                let images = server.run(sensor, source, bus, || stop.is_asked())?;
                eprintln!("sent {}", counted(images as usize, "frame"));
            }
        }
        Ok(())
    }
}

/// Serves applications until a signal asks to stop.
pub fn serve(
    link: Link,
    allow_remote: bool,
    args: &Args,
    ready: impl FnOnce(String),
) -> Result<()> {
    let scene = args.view.0.as_ref().ok_or_else(|| {
        Error::input("a camera without what it is and sees").help("give --camera C --scene S")
    })?;
    let view = scene.view();
    let opens = "take this camera's frames and control it";
    let place = link.place();
    listen::remote(&place.to_string(), allow_remote, opens)?;
    let server = link.open()?;
    let camera = view.camera.load()?;
    let (width, height) = (camera.sensor.width, camera.sensor.height);
    let sides = 4..=u32::from(u16::MAX);
    if !sides.contains(&width) || height < 2 || !sides.contains(&(height + 2)) {
        return Err(Error::unsupported(format!("a camera of {width} x {height} pixels"))
            .help("images have 4 columns and 2 rows at least, and at most 65535 and 65533"));
    }
    let pattern = pattern(&camera.sensor.cfa)?;
    let bus = args.sensor.as_deref().map(rig_sensor::open).transpose()?.map(Mutex::new);
    let changes =
        view.motion.is_some() || args.time.is_given() || view.sequence.is_sequence(&view.scene)?;
    if changes && bus.is_some() {
        return Err(Error::unsupported("a scene that changes, with frame times from registers")
            .help("leave out --sensor, or give a still scene and steady light"));
    }
    let times = if changes { args.time.times(&camera, args.fps)? } else { None };
    let fps = args.fps.or(camera.sensor.timing.is_none().then_some(USUAL_FPS));
    let (mut lights, first) = SceneLights::open(&view, &camera, fps, times, Notes::default())?;
    let cubes = [first.cube];
    let sensors = [SimulatedSensor::new(&camera, &cubes[0].header)?];
    if let (false, Some(effect)) = (lights.stand_still(), remembering(&sensors[0]).next()) {
        return Err(changing_light(effect));
    }
    let mut rig = Rig::open("emulator:")?;
    let sensor = sensor(&mut rig, args, &camera, pattern, *place.ip(), fps)?;
    let bound_to_rate = changes && camera.sensor.timing.is_none();
    let frames = RigFrames::new(&cubes, &sensors, Some(&mut lights), args.collapse)
        .with_faults(args.faults.open(&sensors[0], false, false)?);
    frames.begin(&mut rig)?;
    let mut source = Source {
        camera: &camera,
        arithmetic: args.arith,
        rig,
        frames,
        registers: bus.as_ref().map(|bus| Registers::new(bus, (width, height))),
        held: Vec::new(),
        is_stuck: false,
        frame_lines: bound_to_rate.then_some(sensor.timing.frame_lines),
        line_ns: sensor.line_ns,
        slow: Some(0),
    };
    if let Open::Gige(server) = &server
        && !server.is_found_by_broadcast()
    {
        eprintln!(
            "note: discovery by broadcast does not find this camera: another program holds the \
             broadcast address; applications find it at {}",
            server.address()
        );
    }
    ready(server.url());
    server.run(sensor, &mut source, bus.as_ref())
}

/// The colour filters as both links know them.
fn pattern(cfa: &Cfa) -> Result<Pattern> {
    Ok(match cfa.to_string().as_str() {
        _ if cfa.is_mono() => Pattern::Mono,
        "RGGB" => Pattern::BayerRg,
        "GRBG" => Pattern::BayerGr,
        "GBRG" => Pattern::BayerGb,
        "BGGR" => Pattern::BayerBg,
        other => {
            return Err(Error::unsupported(format!("a live camera with the pattern {other}"))
                .help("pixel formats are of Bayer patterns, or without colour filters"));
        }
    })
}

/// Programs the rig's registers as at power-on, and returns the sensor that they make.
fn sensor(
    rig: &mut Rig,
    args: &Args,
    camera: &Camera,
    pattern: Pattern,
    ip: Ipv4Addr,
    fps: Option<f64>,
) -> Result<Sensor> {
    let timing = camera.sensor.timing;
    let line_ns = match timing {
        Some(timing) => (1e3 * timing.line_time_us).round() as u32,
        None => rig.read_register(address::LINE_LENGTH_NS)?,
    };
    let by_rate = |fps: f64| (1e9 / (fps * f64::from(line_ns))).round() as u32;
    let frame_lines = match (fps, timing) {
        (None, Some(timing)) => timing.frame_length_lines,
        (fps, _) => by_rate(fps.unwrap_or(USUAL_FPS)),
    };
    let min_frame_lines = timing.map_or(1, |_| camera.sensor.height);
    let allowed = min_frame_lines..=u16::MAX.into();
    if !allowed.contains(&frame_lines) {
        let what = format!("frames of {frame_lines} lines of {line_ns} ns");
        let help =
            format!("the sensor has {} to {}: choose another --fps", min_frame_lines, u16::MAX);
        return Err(Error::limit(what).help(help));
    }
    times::program(rig, (line_ns, frame_lines))?;
    Setting::Exposure(args.exposure).apply(rig)?;
    Setting::Gain(args.gain.unwrap_or(camera.sensor.analog_gain)).apply(rig)?;
    let mut read = |address| rig.read_register(address).map(|value| value as u16);
    Ok(Sensor {
        model: camera.name.clone(),
        serial: ip.to_string(),
        width: camera.sensor.width,
        height: camera.sensor.height,
        pattern,
        bits: camera.sensor.bits.into(),
        line_ns,
        min_frame_lines: min_frame_lines as u16, // within the range
        timing: Timing {
            exposure_lines: read(address::COARSE_INTEGRATION_TIME)?,
            frame_lines: frame_lines as u16, // within the range
            gain_code: read(address::ANALOG_GAIN)?,
        },
    })
}

/// The rig as a source of frames.
struct Source<'a> {
    camera: &'a Camera,
    arithmetic: Arithmetic,
    rig: Rig,
    frames: RigFrames<'a>,
    /// Those of a real sensor, which set the frames' timing instead of orders.
    registers: Option<Registers<'a>>,
    /// What the rig's registers hold, by their addresses.
    held: Vec<(u16, u16)>,
    /// Whether the fault register holds a fault that lasts.
    is_stuck: bool,
    /// Frame length that a changing scene keeps time with, until that was reported.
    frame_lines: Option<u16>,
    /// Line time, ns.
    line_ns: u32,
    /// Frames one after another that took longer than their period; `None` once that was reported.
    slow: Option<u32>,
}

/// A frame that begins.
struct Start {
    request: FrameRequest,
    /// Its exposure where the rig's registers do not say it, s.
    exposure_s: Option<f64>,
    period: Duration,
}

impl Source<'_> {
    /// Begins a frame: as ordered, by the rig's registers, or as a real sensor's registers say;
    /// `None` if that sensor stands by.
    fn begin(&mut self, order: &Order) -> Result<Option<Start>> {
        let Some(registers) = &mut self.registers else {
            self.write(order)?;
            let settings = self.camera.settings(order.frame, 1.0, None);
            let lines = u64::from(order.timing.frame_lines);
            return Ok(Some(Start {
                request: FrameRequest { by_registers: true, ..self.request(settings) },
                exposure_s: None,
                period: Duration::from_nanos(lines * u64::from(self.line_ns)),
            }));
        };
        let is_stuck = self.frames.has_stuck_registers(order.frame);
        let frame = registers.next_frame(order.after_standby, is_stuck);
        Ok(frame.map(|frame| {
            let gain = Some(frame.analog_gain);
            let settings = self.camera.settings(order.frame, frame.exposure_s, gain);
            Start {
                request: self.request(settings),
                exposure_s: Some(frame.exposure_s),
                period: rig_sensor::lasts(&frame),
            }
        }))
    }

    fn request(&self, settings: FrameSettings) -> FrameRequest {
        FrameRequest { arithmetic: self.arithmetic, ..FrameRequest::new(settings) }
    }

    /// Writes what the order asks for into the rig's registers, which act with their delay.
    fn write(&mut self, order: &Order) -> Result<()> {
        let Timing { exposure_lines, frame_lines, gain_code } = order.timing;
        let wanted = [
            (address::FRAME_LENGTH_LINES, frame_lines),
            (address::COARSE_INTEGRATION_TIME, exposure_lines),
            (address::ANALOG_GAIN, gain_code),
            (address::TEST_DATA, order.test_value),
            (address::TEST_PATTERN, order.test_pattern),
        ];
        if order.after_standby {
            self.rig.write_register(address::MODE_SELECT, 0)?;
            self.frames.stood_by();
        }
        let lost = self.frames.has_stuck_registers(order.frame);
        if order.is_written && !lost {
            for setting in wanted.into_iter().filter(|setting| !self.held.contains(setting)) {
                self.rig.write_register(setting.0, setting.1.into())?;
            }
            self.held = wanted.to_vec();
        }
        if order.after_standby {
            self.rig.write_register(address::MODE_SELECT, 1)?;
        }
        if order.fault != 0 || self.is_stuck {
            self.rig.write_register(address::FAULT_ARGUMENT, order.fault_argument.into())?;
            self.rig.write_register(address::FAULT, order.fault.into())?;
            self.is_stuck = order.fault == gige::STUCK_COUNTER;
        }
        if self.frame_lines.take_if(|lines| *lines != frame_lines).is_some() {
            eprintln!(
                "note: the scene keeps the time of the frame rate at the start: the camera file \
                 has no [sensor.timing]"
            );
        }
        Ok(())
    }

    /// Says that the frame rate cannot be kept, once some frames have taken longer than it allows.
    fn tell_slow(&mut self, order: &Order, period: Duration, took: Duration) {
        /// More than a hiccup of the machine.
        const SLOW_FRAMES: u32 = 10;
        let Some(slow) = &mut self.slow else { return };
        let is_slow = !order.after_standby && took > period;
        *slow = if is_slow { *slow + 1 } else { 0 };
        if *slow == SLOW_FRAMES {
            self.slow = None;
            eprintln!(
                "note: frames take {} ms, and their period is {} ms: the frame rate is not kept \
                 (--collapse and --path live are faster)",
                took.as_millis(),
                period.as_millis()
            );
        }
    }

    /// Pixels of the part of a frame that is sent.
    fn encode(&self, order: &Order, frame: &camrig_rig::RigFrame) -> Result<Vec<u8>> {
        let gige::Region { x, y, width, height } = order.region;
        let [x, y, width, height] = [x, y, width, height].map(|side| side as usize);
        let raw = frame.to_raw(self.frames.sensor(order.frame))?;
        let raw = match (width, height) == (raw.width, raw.height) {
            true => raw,
            false => Region { x, y, width, height }.of(&raw)?,
        };
        let format = Format::parse(&order.pixel_format)?;
        LiveEncoder::new(format, None)?.encode(&raw, &Beside::default())
    }
}

impl gige::Camera for Source<'_> {
    type Error = Error;

    fn pace(&mut self) -> Pace {
        self.registers.as_ref().map_or(Pace::AsOrdered, Registers::pace)
    }

    fn take(&mut self, order: &Order) -> Result<Taken> {
        let began = Instant::now();
        let Some(start) = self.begin(order)? else { return Ok(Taken::Dropped(0)) };
        if !self.frames.light(&mut self.rig, order.frame, start.exposure_s)? {
            return Ok(Taken::End);
        }
        let frame = self.frames.take(&mut self.rig, order.frame, start.request)?;
        let counter = frame.start.counter;
        let taken = match frame.dropped {
            true => Taken::Dropped(counter),
            false => Taken::Image(self.encode(order, &frame)?, counter),
        };
        self.tell_slow(order, start.period, began.elapsed());
        Ok(taken)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_has_an_address_and_the_port_of_its_protocol() {
        let at = |port| SocketAddrV4::new(Ipv4Addr::new(127, 0, 0, 2), port);
        assert_eq!(Link::gige("127.0.0.2"), Ok(Link::Gige(at(3956))));
        assert_eq!(Link::usbip("127.0.0.2"), Ok(Link::Usbip(at(3240))));
        assert_eq!(Link::usbip("127.0.0.2:0"), Ok(Link::Usbip(at(0))));
        assert!(Link::gige("localhost").unwrap_err().contains("127.0.0.1"));
    }

    #[test]
    fn patterns_are_those_that_pixel_formats_have() {
        let of = |text| pattern(&Cfa::parse(text).unwrap());
        assert_eq!(of("GBRG").unwrap(), Pattern::BayerGb);
        assert_eq!(of("mono").unwrap(), Pattern::Mono);
        assert!(of("RCCB").unwrap_err().to_string().contains("RCCB"));
    }
}
