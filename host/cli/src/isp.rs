//! `camrig isp`: a chart through the camera and real raw converters, compared with the truth.

use super::arguments::{CameraArgs, DeviceArgs, WARN_SATURATED, duration, positive};
use super::view_args::ViewArgs;
use camrig_base::output;
use camrig_base::{Error, Plane, Result};
use camrig_formats::{Facts, Format, Frames, preview};
use camrig_measure::figure;
use camrig_measure::picture::{Card, ColourError, Patch, colours, srgb_to_linear};
use camrig_render::{self as render, SimulatedSensor};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

/// Rate raw converters on a simulated ColorChecker: ΔE2000 of each patch
///
/// Runs the installed converters (dcraw, dcraw_emu of LibRaw, rawtherapee-cli, darktable-cli) on a
/// simulated raw file and compares their pictures with the colours of the patches' reflectances in
/// D65. --picture rates a picture that your own ISP made from a raw file of this camera.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig isp --camera mt9t012 --exposure 30ms\n  \
    camrig isp --camera mobile --illuminant A --exposure 20ms --keep chart.dng\n  \
    camrig isp --camera mobile --exposure 20ms --picture from-my-board.png --json")]
pub struct Args {
    #[command(flatten)]
    camera: CameraArgs,
    /// Light on the chart
    #[arg(long, default_value = "D65", value_name = "I")]
    illuminant: String,
    /// Scene illuminance, lx
    #[arg(long, value_parser = positive, value_name = "X")]
    lux: Option<f64>,
    /// Exposure time
    #[arg(long, value_parser = duration, value_name = "TIME", allow_hyphen_values = true)]
    exposure: f64,
    #[command(flatten)]
    device: DeviceArgs,
    /// Picture (sRGB PNG) of another ISP to rate as well
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
    /// Keep the raw file
    #[arg(long, value_name = "FILE.dng")]
    keep: Option<PathBuf>,
    /// Replace an existing raw file
    #[arg(long)]
    force: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Width of the built-in chart's card, sensor widths.
const CARD: f64 = 0.8;

/// A picture of linear sRGB.
type Picture = Plane<[f64; 3]>;

/// A converter: program, arguments (IN and OUT are replaced), and how its picture is read.
struct Converter {
    program: &'static str,
    arguments: &'static [&'static str],
    output: &'static str,
    read: fn(&[u8]) -> Result<Picture>,
}

/// White balance as shot, sRGB primaries; dcraw and LibRaw linear, the others with their default
/// tone.
const CONVERTERS: [Converter; 4] = [
    Converter {
        program: "dcraw",
        arguments: &["-w", "-4", "-o", "1", "IN"],
        output: "in.ppm",
        read: linear_ppm,
    },
    Converter {
        program: "dcraw_emu",
        arguments: &["-w", "-4", "-o", "1", "IN"],
        output: "in.dng.ppm",
        read: linear_ppm,
    },
    Converter {
        program: "rawtherapee-cli",
        arguments: &["-Y", "-n", "-b16", "-o", "OUT", "-c", "IN"],
        output: "out.png",
        read: srgb_png,
    },
    Converter {
        program: "darktable-cli",
        arguments: &[
            "IN",
            "OUT",
            "--apply-custom-presets",
            "0",
            "--core",
            "--library",
            ":memory:",
            "--configdir",
            "DIR",
            "--cachedir",
            "DIR",
            "--disable-opencl",
        ],
        output: "out.png",
        read: srgb_png,
    },
];

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let view = ViewArgs::still(
        args.camera.clone(),
        format!("colorchecker:width={CARD}"),
        Some(&args.illuminant),
        args.lux,
        args.device,
    );
    let (camera, view) = view.view()?;
    let sensor = SimulatedSensor::new(&camera, &view.cube.header)?;
    let settings = camera.settings(0, args.exposure, None);
    let raw = sensor.frame(&view.cube, &settings)?;
    for channel in raw.channel_means() {
        if channel.saturated > WARN_SATURATED {
            eprintln!(
                "warning: channel {} saturates; its colours are wrong: shorten the exposure",
                channel.name
            );
        }
    }
    let header = &view.cube.header;
    let info = render::frame_info(&camera, &settings, view.light.as_ref(), header, true)?;
    let facts = Facts { dng: Some(info.clone()), ..Facts::of(&raw) };
    let dng = Format::Dng.encode(&Frames { facts, ..Frames::from_raw(&raw) })?;
    if let Some(path) = &args.keep {
        output::write_file(path, args.force, &dng)?;
    }
    let folder = tempfile::tempdir().map_err(|e| Error::io("create", Path::new("a folder"), e))?;
    let path = folder.path().join("in.dng");
    std::fs::write(&path, &dng).map_err(|e| Error::io("write", &path, e))?;

    let judge =
        |picture: &Picture| colours(picture, Card { frame_width: raw.width, card_width: CARD });
    let shown = preview::render(&raw, &info);
    let linear = |p: [u8; 3]| p.map(|v| srgb_to_linear(f64::from(v) / 255.0));
    let shown = Plane {
        width: shown.width,
        height: shown.height,
        data: shown.data.iter().map(|&p| linear(p)).collect(),
    };
    let mut table: Vec<(String, Vec<Patch>)> = vec![("camrig".into(), judge(&shown)?)];
    for converter in &CONVERTERS {
        match develop(converter, folder.path(), &path) {
            Ok(Some(picture)) => table.push((converter.program.into(), judge(&picture)?)),
            Ok(None) => eprintln!("note: {} is not installed", converter.program),
            Err(error) => eprintln!("warning: {}: {error}", converter.program),
        }
    }
    if let Some(path) = &args.picture {
        let bytes = std::fs::read(path).map_err(|e| Error::io("read", path, e))?;
        let picture = srgb_png(&bytes).map_err(|e| e.at(path.display()))?;
        table.push((path.display().to_string(), judge(&picture)?));
    }
    print_table(&table, args.json.then_some(&view.notes))?;
    Ok(ExitCode::SUCCESS)
}

/// The picture of a converter; `None` if it is not installed.
fn develop(converter: &Converter, folder: &Path, raw: &Path) -> Result<Option<Picture>> {
    let output = folder.join(converter.output);
    let argument = |a: &&str| match *a {
        "IN" => raw.as_os_str().to_owned(),
        "OUT" => output.as_os_str().to_owned(),
        "DIR" => folder.as_os_str().to_owned(),
        a => a.into(),
    };
    let run = Command::new(converter.program)
        .args(converter.arguments.iter().map(argument))
        .current_dir(folder)
        .stdin(Stdio::null())
        .output();
    let done = match run {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        other => other.map_err(|e| Error::io("run", Path::new(converter.program), e))?,
    };
    let bytes = std::fs::read(&output).map_err(|_| {
        let said = String::from_utf8_lossy(&done.stderr).trim().to_string();
        Error::device(format!("no picture: {said}"))
    })?;
    std::fs::remove_file(&output).map_err(|e| Error::io("remove", &output, e))?;
    (converter.read)(&bytes).map(Some)
}

/// A 16-bit P6 picture of linear values.
fn linear_ppm(bytes: &[u8]) -> Result<Picture> {
    let wrong = || Error::disagreement("not a 16-bit PPM picture");
    let mut at = 0;
    let mut word = || {
        let rest = bytes.get(at..)?;
        let start = at + rest.iter().position(|b| !b.is_ascii_whitespace())?;
        let length = bytes[start..].iter().position(u8::is_ascii_whitespace)?;
        at = start + length;
        std::str::from_utf8(&bytes[start..at]).ok().map(|w| (w, at + 1))
    };
    let mut next = || word().ok_or_else(wrong);
    let number = |w: &str| w.parse::<usize>().map_err(|_| wrong());
    let magic = next()?.0;
    let (width, height) = (number(next()?.0)?, number(next()?.0)?);
    let (depth, start) = next()?;
    let samples = bytes.get(start..).unwrap_or_default();
    let size = width.checked_mul(height).and_then(|n| n.checked_mul(6));
    if magic != "P6" || depth != "65535" || size != Some(samples.len()) {
        return Err(wrong());
    }
    let value = |b: &[u8]| f64::from(u16::from_be_bytes([b[0], b[1]])) / 65535.0;
    let pixel = |b: &[u8]| [value(b), value(&b[2..]), value(&b[4..])];
    Ok(Plane { width, height, data: samples.chunks_exact(6).map(pixel).collect() })
}

/// An sRGB PNG of 8 or 16 bits.
fn srgb_png(bytes: &[u8]) -> Result<Picture> {
    let wrong = |e: png::DecodingError| Error::disagreement(format!("not a PNG picture: {e}"));
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(wrong)?;
    let size = reader.output_buffer_size().ok_or_else(|| Error::limit("a PNG too large"))?;
    let mut samples = vec![0; size];
    let info = reader.next_frame(&mut samples).map_err(wrong)?;
    let channels = match info.color_type {
        png::ColorType::Rgb => 3,
        png::ColorType::Rgba => 4,
        other => {
            return Err(
                Error::unsupported(format!("a PNG of {other:?}")).help("use a colour picture")
            );
        }
    };
    let values: Vec<f64> = match info.bit_depth {
        png::BitDepth::Sixteen => samples
            .chunks_exact(2)
            .map(|b| f64::from(u16::from_be_bytes([b[0], b[1]])) / 65535.0)
            .collect(),
        _ => samples.iter().map(|&b| f64::from(b) / 255.0).collect(),
    };
    let pixel = |p: &[f64]| [0, 1, 2].map(|c| srgb_to_linear(p[c]));
    let (width, height) = (info.width as usize, info.height as usize);
    let data = values.chunks_exact(channels).take(width * height).map(pixel).collect();
    Ok(Plane { width, height, data })
}

/// Prints the figures; as JSON if `notes` are given.
fn print_table(table: &[(String, Vec<Patch>)], json_notes: Option<&Vec<String>>) -> Result<()> {
    if let Some(notes) = json_notes {
        let isps = table.iter().map(|(name, patches)| {
            let mut figures = figure::object(&ColourError::of(patches))?;
            figures.append(&mut figure::object(&BTreeMap::from([("patches", patches)]))?);
            Ok((name.clone(), figures))
        });
        let isps: BTreeMap<_, _> = isps.collect::<Result<_>>()?;
        println!("{}", json!({ "isps": isps, "notes": notes }));
        return Ok(());
    }
    let line = |label: &str, value: &dyn Fn(&[Patch]) -> f64| {
        let cells: Vec<String> = table
            .iter()
            .map(|(name, p)| format!("{:>w$.2}", value(p), w = name.len().max(6)))
            .collect();
        println!("{label:>8}  {}", cells.join("  "));
    };
    let names: Vec<String> = table.iter().map(|(name, _)| format!("{name:>6}")).collect();
    println!("{:>8}  {}", "patch", names.join("  "));
    for i in 0..table[0].1.len() {
        line(&(i + 1).to_string(), &|patches| patches[i].delta_e_2000.value);
    }
    line("mean", &|patches| ColourError::of(patches).delta_e_2000_mean.value);
    line("max", &|patches| ColourError::of(patches).delta_e_2000_max.value);
    Ok(())
}
