//! `camrig rig`: use rigs, or emulate one.

use super::listen;
use super::rig_camera::{self, Link};
use camrig_base::numbers::counted;
use camrig_base::{Error, Result};
use camrig_render::Arithmetic;
use camrig_rig::script::exposure_cut;
use camrig_rig::{
    self as rig, Rig, Token, emulator::Emulator, log::LogDecoder, serve::ServeError,
};
use camrig_rig_link::message::{Codec, SEVERAL_CAPTURES};
use camrig_sensor_core::effects::Effect;
use clap::Subcommand;
use serde_json::json;
use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::ExitCode;

/// Use sensor rigs, or emulate one
#[derive(clap::Args, Debug)]
#[command(after_help = "Addresses of rigs:\n  \
    emulator:                          an emulator in this process\n  \
    tcp://HOST:PORT                    an emulator on the network (camrig rig serve)\n  \
    serial:///dev/ttyACM0?baud=3000000 a serial port or a USB CDC-ACM device\n  \
    hid://VID:PID[/SERIAL]             a USB HID device\n\nExamples:\n  \
    camrig rig stream emulator: --camera mt9v024 --scene colorchecker --exposure 20ms \
    --frames 10")]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    List(ListArgs),
    Info(InfoArgs),
    Stream(Box<super::rig_stream::Args>),
    Record(super::rig_stream::record::Args),
    Serve(Box<ServeArgs>),
    Log(LogArgs),
    Register(RegisterArgs),
    View(Box<super::rig_view::Args>),
}

/// List serial ports and HID devices that may be rigs
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig rig list --json")]
struct ListArgs {
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Show a rig's capabilities and statistics
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig rig info tcp://127.0.0.1:7420 --json")]
struct InfoArgs {
    /// Address of the rig
    url: String,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Run the emulator as a server: a rig on TCP, a pseudo-terminal or a device file, or a camera on
/// the network or on USB
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig rig serve --tcp 127.0.0.1:7420\n  \
    camrig rig serve --tcp 0.0.0.0:7420 --allow-remote --token\n  \
    camrig rig serve --pty\n  \
    camrig rig serve --gige 127.0.0.1 --camera mt9v024 --scene colorchecker --exposure 5ms\n  \
    camrig rig serve --usbip --camera mt9v024 --scene colorchecker --exposure 5ms\n  \
    camrig rig serve --usbip --camera mt9v024 --scene colorchecker --sensor ov7670\n  \
    camrig rig serve --device /dev/hidg0 --report 64    (the gadget side of a USB device)")]
#[command(group(clap::ArgGroup::new("link")
    .required(true).args(["tcp", "pty", "device", "gige", "usbip"])))]
#[command(group(clap::ArgGroup::new("camera_link").args(["gige", "usbip"])))]
struct ServeArgs {
    /// Listen on HOST:PORT. Serves one host at a time; a host that has been silent for 10 s is
    /// dropped when another one connects
    #[arg(long, value_name = "HOST:PORT")]
    tcp: Option<String>,
    /// Allow an address that other machines can reach: anyone who connects, with the token if there
    /// is one, can read and write the rig's registers and take its frames
    #[arg(long, conflicts_with_all = ["pty", "device"])]
    allow_remote: bool,
    /// Accept only hosts that know a token: this one, or without TEXT a random one, printed with
    /// the address. It crosses the network unencrypted
    #[arg(
        long,
        value_name = "TEXT",
        requires = "tcp",
        num_args = 0..=1,
        default_missing_value = "",
        require_equals = true
    )]
    token: Option<String>,
    /// Create a pseudo-terminal and print its name
    #[arg(long)]
    pty: bool,
    /// Serve a device file
    #[arg(long, value_name = "FILE")]
    device: Option<PathBuf>,
    /// Size of a HID report; without it the device file is a serial line
    #[arg(
        long,
        value_name = "BYTES",
        requires = "device",
        value_parser = clap::value_parser!(u16).range(8..=4096)
    )]
    report: Option<u16>,
    /// Be a GigE Vision camera at this address of the machine, for programs that take one (Aravis,
    /// GenICam, machine vision). One application controls it at a time; settings and faults are
    /// its features
    #[arg(
        long,
        value_name = "ADDRESS",
        value_parser = Link::gige,
        num_args = 0..=1,
        default_missing_value = "127.0.0.1"
    )]
    gige: Option<Link>,
    /// Be a USB video camera that Linux attaches from this address by USB/IP (modprobe vhci-hcd;
    /// usbip attach -r ADDRESS -b 1-1), for programs that take one (V4L2, ffmpeg, OpenCV). One host
    /// has it at a time; exposure time and gain are its controls
    #[arg(
        long,
        value_name = "ADDRESS",
        value_parser = Link::usbip,
        num_args = 0..=1,
        default_missing_value = "127.0.0.1"
    )]
    usbip: Option<Link>,
    #[command(flatten)]
    camera: rig_camera::Args,
    /// Pretend to support only these protocol versions, to test a host's messages
    #[arg(long, value_name = "OLDEST,NEWEST", value_parser = versions, hide = true)]
    versions: Option<(u8, u8)>,
}

/// Decode the log of a firmware
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig rig log --elf rig-m4.elf uart1.bin")]
struct LogArgs {
    /// The firmware's ELF file, which contains the text of the messages
    #[arg(long, value_name = "FILE")]
    elf: PathBuf,
    /// Output of the firmware; `-` is standard input
    input: PathBuf,
}

/// Read or write a register of a rig
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig rig register tcp://127.0.0.1:7420 0x0202           (exposure, lines)\n  \
    camrig rig register tcp://127.0.0.1:7420 0x0204 512       (gain 2.0)\n\n\
    Registers (addresses of MIPI CCS):\n  \
    0x0000 model id, read only          0x0005 frame counter, read only\n  \
    0x0100 1 streaming, 0 standby       0x0104 group hold: 1 hold, 0 release\n  \
    0x0202 exposure, lines              0x0204 gain code, gain x 256\n  \
    0x0340 frame length, lines          0x3000 line time, ns\n  \
    0x3004 exposure delay, frames       0x3006 gain delay, frames, 1 to 4\n  \
    0x0600 test pattern: 0 none, 1 solid, 2 bars, 4 PN9\n  \
    0x0602 DN of the solid pattern\n  \
    0x3100 fault: 0 none, 1 drop a frame, 2 corrupt a row, 3 stuck counter, 4 late frame\n  \
    0x3102 the corrupt row, or the delay in ms\n\n\
    An address in the table is the whole register; the addresses after it are its further bytes, \
    high byte first. With --byte the address in the table is the high byte.")]
struct RegisterArgs {
    /// Address of the rig
    url: String,
    /// Register address, for instance 0x0202
    #[arg(value_parser = number)]
    address: u32,
    /// Value to write
    #[arg(value_parser = number)]
    value: Option<u32>,
    /// Read or write a single byte at the address, like a driver that writes byte by byte
    #[arg(long)]
    byte: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Reads a number, decimal or 0x.
fn number(text: &str) -> Result<u32, String> {
    match text.strip_prefix("0x") {
        Some(hex) => u32::from_str_radix(hex, 16),
        None => text.parse(),
    }
    .map_err(|_| format!("{text:?} is not a number such as 514 or 0x0202"))
}

/// Reads two versions of the protocol.
fn versions(text: &str) -> Result<(u8, u8), String> {
    text.split_once(',')
        .and_then(|(oldest, newest)| Some((oldest.parse().ok()?, newest.parse().ok()?)))
        .ok_or_else(|| format!("{text:?} is not a pair of versions such as 1,2"))
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    match &args.command {
        Command::List(args) => list(args),
        Command::Info(args) => info(args),
        Command::Stream(args) => return super::rig_stream::run(args),
        Command::Record(args) => super::rig_stream::record::run(args),
        Command::Serve(args) => serve(args),
        Command::Log(args) => log(args),
        Command::Register(args) => register(args),
        Command::View(args) => super::rig_view::run(args),
    }
    .map(|()| ExitCode::SUCCESS)
}

fn list(args: &ListArgs) -> Result<()> {
    let found = rig::list();
    if args.json {
        println!("{}", json!({ "rigs": found }));
        return Ok(());
    }
    if found.is_empty() {
        eprintln!("no serial port or HID device found; `emulator:` is always available");
    }
    for rig in found {
        println!("{:32} {}", rig.url, rig.description);
    }
    Ok(())
}

fn info(args: &InfoArgs) -> Result<()> {
    let mut rig = Rig::open(&args.url)?;
    let d = rig.device();
    let s = rig.device_statistics()?;
    let effects: Vec<&str> = (Effect::CATALOGUE.iter())
        .filter(|entry| d.effects.contains(entry.id))
        .map(|entry| entry.kind)
        .collect();
    let arithmetics: Vec<&str> = Arithmetic::ALL
        .into_iter()
        .filter(|&a| d.arithmetics >> (a as u8) & 1 == 1)
        .map(Arithmetic::name)
        .collect();
    let codecs: Vec<&str> = [(Codec::Bfp16, "bfp16"), (Codec::Electrons16, "electrons16")]
        .into_iter()
        .filter(|(c, _)| d.codecs >> (*c as u8) & 1 == 1)
        .map(|(_, name)| name)
        .collect();
    let several = d.codecs & SEVERAL_CAPTURES != 0;
    if args.json {
        let camera = (d.camera != 0).then(|| format!("{:016x}", d.camera));
        println!(
            "{}",
            json!({
                "firmware": d.firmware.as_str(),
                "max_width": d.max_width,
                "max_bands": d.max_bands,
                "arithmetics": arithmetics,
                "codecs": codecs,
                "several_captures": several,
                "packet_bytes": d.packet_bytes,
                "credit_packets": d.credit,
                "max_camera_bytes": d.max_camera,
                "row_memory_bytes": d.memory_bytes,
                "effects": effects,
                "camera": camera,
                "statistics": {
                    "frames": s.frames,
                    "rows_in": s.rows_in,
                    "rows_out": s.rows_out,
                    "packets": s.packets,
                    "damaged_packets": s.damaged,
                    "stale_packets": s.stale,
                    "gaps": s.gaps,
                },
            })
        );
        return Ok(());
    }
    println!("firmware     {}", d.firmware);
    println!("rows         up to {} pixels x {} bands", d.max_width, d.max_bands);
    println!("arithmetics  {}", arithmetics.join(", "));
    println!("row codecs   {}", codecs.join(", "));
    println!(
        "captures     {}",
        if several { "several of a pixel, merged" } else { "one of a pixel" }
    );
    println!("row memory   {} bytes", d.memory_bytes);
    if effects.len() == Effect::CATALOGUE.len() {
        println!("effects      all {}", effects.len());
    } else {
        println!("effects      {}", effects.join(", "));
    }
    println!(
        "since start  {}, {}, {} damaged, {}",
        counted(s.frames as usize, "frame"),
        counted(s.packets as usize, "packet"),
        s.damaged,
        counted(s.gaps as usize, "gap")
    );
    Ok(())
}

fn serve(args: &ServeArgs) -> Result<()> {
    // The address goes to standard output: scripts wait for it.
    let ready = |url: String| {
        println!("{url}");
        let _ = std::io::stdout().flush();
    };
    if let Some(link) = args.gige.or(args.usbip) {
        return rig_camera::serve(link, args.allow_remote, &args.camera, ready);
    }
    args.camera.refuse()?;
    let emulator = Emulator::new(args.versions);
    if let Some(address) = &args.tcp {
        return serve_tcp(address, args, emulator, ready);
    }
    if let Some(path) = &args.device {
        ready(path.display().to_string());
        return rig::serve::device(path, args.report, emulator, link_failed);
    }
    rig::serve::pty(emulator, |path| ready(format!("serial://{path}")), link_failed)
}

/// Serves an address, with a token if the arguments ask for one.
fn serve_tcp(
    address: &str,
    args: &ServeArgs,
    emulator: Emulator,
    ready: impl FnOnce(String),
) -> Result<()> {
    let token = match args.token.as_deref() {
        None => None,
        Some("") => Some(Token::random()?),
        Some(text) => Some(Token::parse(text).map_err(|e| e.at("--token"))?),
    };
    let opens = match token {
        None => {
            "connect to this rig without a password (--token requires one), read and write its \
             registers and take its frames"
        }
        Some(_) => {
            "connect to this rig with the token, which crosses the network unencrypted, read and \
             write its registers and take its frames"
        }
    };
    listen::remote(address, args.allow_remote, opens)?;
    let query = token.as_ref().map_or(String::new(), |t| format!("?token={}", t.secret()));
    let listening = |address: &str| ready(format!("tcp://{address}{query}"));
    rig::serve::tcp(address, token, emulator, listening, link_failed)
}

fn link_failed(why: ServeError<std::io::Error>) {
    match why {
        ServeError::Link(e) => eprintln!("the link ended: {e}"),
        ServeError::OutOfStep => {
            eprintln!("the link ended: the bytes received do not follow the protocol")
        }
        other => eprintln!("the link ended: {other}"),
    }
}

fn log(args: &LogArgs) -> Result<()> {
    let decoder = LogDecoder::open(&args.elf)?;
    let mut bytes = Vec::new();
    let read = if args.input.as_os_str() == "-" {
        std::io::stdin().read_to_end(&mut bytes)
    } else {
        std::fs::File::open(&args.input).and_then(|mut file| file.read_to_end(&mut bytes))
    };
    read.map_err(|e| Error::io("read", &args.input, e))?;
    decoder.decode(&bytes, |line| println!("{line}"));
    Ok(())
}

fn register(args: &RegisterArgs) -> Result<()> {
    let address = u16::try_from(args.address)
        .map_err(|_| Error::input("register addresses have 16 bits").at(args.address))?;
    let mut rig = Rig::open(&args.url)?;
    match (args.value, args.byte) {
        (None, _) => {}
        (Some(value), false) => rig.write_register(address, value)?,
        (Some(value), true) => {
            let byte = u8::try_from(value)
                .map_err(|_| Error::input(format!("{value} is not a byte")).help("0 to 255"))?;
            rig.write_byte(address, byte)?;
        }
    }
    let value =
        if args.byte { rig.read_byte(address)?.into() } else { rig.read_register(address)? };
    if args.value.is_some()
        && let Some(cut) = exposure_cut(&mut rig)?
    {
        eprintln!("note: {cut}");
    }
    if args.json {
        println!("{}", json!({ "address": address, "value": value }));
    } else {
        println!("{address:#06x} = {value} ({value:#x})");
    }
    Ok(())
}
