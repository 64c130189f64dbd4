//! Arguments shared by several commands: durations, cameras, exposure, outputs; progress bars.

use super::readout::ReadoutArgs;
use super::stdout::quiet;
use camrig_base::output::OutputFile;
use camrig_base::{Bands, Error, Result};
use camrig_camera::{Camera, Change, KeptNoise, is_preset};
use camrig_optics::DeviceChoice;
use camrig_render::auto_exposure::{self, Brightness};
use camrig_render::hdr::Hdr;
use camrig_render::{Arithmetic, IrradianceCube, SimulatedSensor};
use camrig_report::page::Page;
use camrig_sensor_core::config::FrameSettings;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::Value;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

/// Changes to a camera's file.
#[derive(clap::Args, Clone, Debug)]
pub struct ChangeArgs {
    /// Change a key of the camera file: sensor.noise.read_e=2.5, effect.KIND.KEY=VALUE; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<Change>,
    /// Which sensor of this make: sensor.seed, which fixes every fixed pattern
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// F-number of the lens: lens.f_number
    #[arg(long, value_name = "F", value_parser = positive, allow_negative_numbers = true)]
    f_number: Option<f64>,
}

impl ChangeArgs {
    /// Loads a preset or a camera file with the changes applied.
    pub fn load(&self, camera: &str) -> Result<Camera> {
        camrig_render::with_filter_angles(Camera::load_with(camera, &self.all()?)?)
    }

    /// All changes.
    fn all(&self) -> Result<Vec<Change>> {
        let seed = self.seed.map(|seed| format!("sensor.seed={seed}").parse());
        let f_number = self.f_number.map(|number| format!("lens.f_number={number:?}").parse());
        self.set.iter().cloned().map(Ok).chain(seed).chain(f_number).collect()
    }

    fn is_empty(&self) -> bool {
        self.set.is_empty() && self.seed.is_none() && self.f_number.is_none()
    }
}

/// A camera, and changes to its file.
#[derive(clap::Args, Clone, Debug)]
pub struct CameraArgs {
    /// Camera file, or a preset: mt9t012, mobile, imx219, ... (camrig presets lists them)
    #[arg(long, value_name = "C")]
    pub camera: String,
    #[command(flatten)]
    changes: ChangeArgs,
    /// Which noise frames have
    #[arg(long, value_name = "NOISE", default_value = "all", value_parser = kept_noise())]
    noise: KeptNoise,
    /// Of a sensor that reads each pixel several times, only the capture of this name, as a sensor
    /// of its own
    #[arg(long, value_name = "NAME")]
    capture: Option<String>,
}

impl CameraArgs {
    /// Loads the camera with its changes and the noise that frames are to have.
    pub fn load(&self) -> Result<Camera> {
        let mut camera = self.changes.load(&self.camera)?;
        camera.keep_noise(self.noise);
        let Some(name) = &self.capture else { return Ok(camera) };
        let position = camera.sensor.hdr.as_ref().map(|hdr| hdr.position(name)).transpose()?;
        let capture = position.and_then(|position| camera.of_capture(position));
        capture.ok_or_else(|| {
            Error::input(format!("--capture {name} of a sensor with one capture"))
                .help("omit it: the camera's file has no [sensor.hdr]")
        })
    }

    /// The name of an unchanged preset; `None` for a file or a changed preset.
    pub fn preset(&self) -> Option<&str> {
        let unchanged =
            self.changes.is_empty() && self.noise == KeptNoise::All && self.capture.is_none();
        (is_preset(&self.camera) && unchanged).then_some(&self.camera)
    }
}

/// Reads `20ms`, `1.5s`, `300us` or, as cameras write it, `1/50`: a positive duration in seconds.
pub fn duration(text: &str) -> Result<f64, String> {
    let units = [("ms", 1e-3), ("us", 1e-6), ("µs", 1e-6), ("ns", 1e-9), ("s", 1.0)];
    let wrong =
        || format!("{text:?} is not a duration; use for instance 20ms, 1.5s, 300us or 1/50");
    if let Some((part, whole)) = text.strip_suffix('s').unwrap_or(text).split_once('/') {
        let number = |text: &str| positive(text.trim()).map_err(|_| wrong());
        return Ok(number(part)? / number(whole)?);
    }
    let (number, unit) = units
        .iter()
        .find_map(|(suffix, unit)| Some((text.strip_suffix(suffix)?, unit)))
        .ok_or_else(wrong)?;
    let seconds = number.trim().parse::<f64>().map_err(|_| wrong())? * unit;
    if seconds > 0.0 && seconds.is_finite() {
        Ok(seconds)
    } else {
        Err(format!("{text:?}: the duration must be above zero, for instance 20ms"))
    }
}

/// Reads a number above zero.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v > 0.0 && v.is_finite() => Ok(v),
        _ => Err(format!("{text:?} is not a number above zero")),
    }
}

/// Reads an analog gain: a factor above zero, or in decibels (20 log₁₀) as `6dB`.
pub fn gain(text: &str) -> Result<f64, String> {
    let (number, unit) = text.split_at(text.len().saturating_sub(2));
    match unit.eq_ignore_ascii_case("db") {
        true => Ok(libm::exp10(finite(number.trim())? / 20.0)),
        false => positive(text),
    }
}

/// Reads a finite number.
pub fn finite(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|v| v.is_finite());
    number.ok_or_else(|| format!("{text:?} is not a number"))
}

/// Reads frames per second: a number, or a fraction such as `30000/1001`.
pub fn frames_per_s(text: &str) -> Result<f64, String> {
    let (number, per) = text.split_once('/').unwrap_or((text, "1"));
    Ok(positive(number.trim())? / positive(per.trim())?)
}

/// Parser of one of the library's choices by its name; the help lists them all.
pub fn choice<T>(
    all: &[T],
    name: fn(T) -> &'static str,
    about: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> + use<T>
where
    T: FromStr<Err = Error> + Copy + Send + Sync + 'static,
{
    let listed = all.iter().map(|&value| PossibleValue::new(name(value)).help(about(value)));
    PossibleValuesParser::new(listed).try_map(|name| name.parse::<T>())
}

/// Parser of the device for the optics.
pub fn device() -> impl TypedValueParser<Value = DeviceChoice> {
    choice(&DeviceChoice::ALL, DeviceChoice::name, |device| match device {
        DeviceChoice::Cpu => "The CPU: the same bytes on any machine",
        DeviceChoice::Gpu => {
            "Any graphics processor, even a software device: equal to the CPU within 32-bit \
             rounding"
        }
        DeviceChoice::Auto => "A dedicated graphics processor if there is one, otherwise the CPU",
    })
}

/// Parser of the arithmetic of the sensor stage.
pub fn arithmetic() -> impl TypedValueParser<Value = Arithmetic> {
    choice(&Arithmetic::ALL, Arithmetic::name, |arithmetic| match arithmetic {
        Arithmetic::F32 => "32-bit floating point",
        Arithmetic::Fixed => {
            "32-bit fixed point, for microcontrollers without a floating-point unit; up to 64 DN per electron"
        }
    })
}

/// Parser of which noise frames have.
fn kept_noise() -> impl TypedValueParser<Value = KeptNoise> {
    choice(&KeptNoise::ALL, KeptNoise::name, |kept| match kept {
        KeptNoise::All => "All noise, dark current, fixed patterns and defects of the camera file",
        KeptNoise::Shot => "Photon shot noise only",
        KeptNoise::None => "No noise: mean signals, rounded to DN",
    })
}

/// A band of 10 nm, the width assumed for narrow-band light.
pub fn band_at(nm: f64) -> Bands {
    Bands { start_nm: nm, step_nm: 10.0, count: 1 }
}

/// Reports that the link to a rig broke and is being reopened.
pub fn broken_link(error: &Error) {
    let rig = error.place().unwrap_or("the rig");
    eprintln!("the link broke; resuming the frame at {rig}");
}

/// A progress bar on standard error; where that is not a terminal, a line every ten seconds.
pub fn progress(label: &'static str, total: u64) -> ProgressBar {
    let bar = match quiet() {
        true => ProgressBar::hidden(),
        false => bar(label, total),
    };
    if !quiet() && !std::io::stderr().is_terminal() {
        let bar = bar.downgrade();
        std::thread::spawn(move || {
            loop {
                std::thread::sleep(LINE_EVERY);
                let Some(bar) = bar.upgrade().filter(|bar| !bar.is_finished()) else { return };
                let of =
                    bar.length().filter(|n| *n > 0).map_or(String::new(), |n| format!("/{n}"));
                eprintln!("{label}: {}{of}", bar.position());
            }
        });
    }
    bar
}

/// Time between lines of progress.
const LINE_EVERY: Duration = Duration::from_secs(10);

fn bar(label: &'static str, total: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{prefix:>12} {wide_bar} {pos}/{len} {eta}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(total).with_style(style).with_prefix(label)
}

/// A progress bar of frames; without a length if they go on to the end of the scene (`u32::MAX`).
pub fn frames_bar(count: u32) -> ProgressBar {
    progress("frames", if count == u32::MAX { 0 } else { count.into() })
}

/// The device for the optics.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct DeviceArgs {
    /// Device that computes blur varying over the field
    #[arg(long, value_parser = device(), default_value_t, value_name = "D")]
    pub device: DeviceChoice,
}

/// Exposure time, or how it is determined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// Seconds.
    Time(f64),
    /// Determined from trial frames.
    Auto(Brightness),
}

/// Reads a duration, `auto` or `auto:SHARE`.
pub fn exposure(text: &str) -> Result<Exposure, String> {
    match text.split_once(':') {
        None if text == "auto" => Ok(Exposure::Auto(Brightness::Highlights)),
        Some(("auto", share)) => Ok(Exposure::Auto(Brightness::Mean(positive(share)?))),
        _ => duration(text).map(Exposure::Time),
    }
}

/// How frames are taken and where they go.
#[derive(clap::Args, Clone, Debug)]
pub struct FrameArgs {
    /// Exposure time: 20ms, 1.5s, 300us; auto (99.9 % of each channel below 0.85 of full scale), or
    /// auto:SHARE (mean of green, as a fraction of full scale above black; as auto where that clips
    /// highlights)
    #[arg(long, value_parser = exposure, allow_hyphen_values = true, value_name = "TIME")]
    pub exposure: Exposure,
    /// Analog gain, or in decibels as 6dB [default: that of the camera file]
    #[arg(long, value_parser = gain, value_name = "G", allow_negative_numbers = true)]
    pub gain: Option<f64>,
    #[command(flatten)]
    pub(super) readout: ReadoutArgs,
    /// Whether frames are taken to the end of the scene if their number is not given.
    #[arg(skip)]
    pub until_over: bool,
    /// Number of frames. Several frames go into a directory, or one after another into a stream
    /// (headerless pixels, csi2, mcap, pgm, y4m); to - or a named pipe, each is written as soon as
    /// it is ready [default: 1, or those of the bracket or sequence]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub frames: Option<u32>,
    /// Frame rate of the sensor, frames/s (30, 30000/1001): time stamps of mcap, rate of y4m, and
    /// which frame of a sequence is shown when. An exposure longer than a frame is refused [default:
    /// as fast as [sensor.timing] of the camera file allows]
    #[arg(long, value_name = "F", value_parser = frames_per_s)]
    pub fps: Option<f64>,
    /// Exposure bracket: steps in EV relative to the exposure, one frame each
    #[arg(long, value_name = "EV,...", value_delimiter = ',', allow_hyphen_values = true)]
    pub bracket: Vec<f64>,
    /// Light that is white in the frames: AsShotNeutral of DNG, previews [default: the illuminant;
    /// D65 for radiance scenes]
    #[arg(long, value_name = "I")]
    pub white: Option<String>,
    /// Two exposures in one frame: rows:RATIO (alternating pairs of long and short rows) or
    /// `staggered:RATIO[:OFFSET]` (each row twice, the short exposure OFFSET rows later)
    #[arg(long, value_name = "FORM", value_parser = Hdr::parse)]
    #[arg(conflicts_with_all = ["roi", "binning"])]
    pub hdr: Option<Hdr>,
    /// Number of the first frame, the seed of its temporal noise; fixed patterns do not change
    #[arg(long, default_value_t = 0, value_name = "K")]
    pub frame_seed: u32,
    /// Arithmetic of the sensor stage
    #[arg(long, value_parser = arithmetic(), default_value_t)]
    pub arith: Arithmetic,
    /// Run the sensor stage on a rig, with the same bytes: emulator:, tcp://HOST:PORT,
    /// serial://..., hid://...
    #[arg(long, value_name = "URL")]
    pub rig: Option<String>,
    /// Output: .dng .tiff .npy .pgm .fits, .png (a picture to look at), or a directory for several
    /// frames
    #[arg(short, long, value_name = "OUT", allow_hyphen_values = true)]
    pub output: PathBuf,
    /// Output format, if the name does not determine it, as for -: dng, npy, pgm, csi2, y4m
    /// (sensors without colour filters), or the V4L2 name of headerless pixels. These are scaled if
    /// they have another bit depth than the sensor: from 10 bits, SRGGB16 is shifted left by 6 and
    /// SRGGB8 right by 2
    #[arg(long, value_name = "FORMAT")]
    pub to: Option<String>,
    /// DNG: write lens shading and bad pixels as opcodes, for the raw converter to correct
    #[arg(long, conflicts_with_all = ["roi", "binning"])]
    pub opcodes: bool,
    /// Also write an HTML report: pictures, plots, tables, the camera file
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Replace existing output
    #[arg(long)]
    pub force: bool,
    /// Print one JSON object about the frames on standard output
    #[arg(long)]
    pub json: bool,
}

/// Opens the file of a report before the work, so that a bad name fails at once.
pub fn open_report(path: Option<&Path>, force: bool) -> Result<Option<OutputFile>> {
    path.map(|path| OutputFile::create(path, force)).transpose()
}

/// Writes a report.
pub fn write_report(mut file: OutputFile, page: &Page) -> Result<()> {
    file.write_all(page.html().as_bytes())
        .map_err(|e| Error::io("write", Path::new("the report"), e))?;
    file.finish()
}

impl FrameArgs {
    /// Maximum number of frames to take.
    pub fn count(&self) -> u32 {
        let usual = if self.until_over { u32::MAX } else { self.bracket.len().max(1) as u32 };
        self.frames.unwrap_or(usual)
    }

    /// The exposure time, s; prints a note if it was determined from trial frames.
    pub fn exposure_s(
        &self,
        camera: &Camera,
        sensor: &SimulatedSensor,
        cube: &IrradianceCube,
    ) -> Result<f64> {
        match self.exposure {
            Exposure::Time(seconds) => Ok(seconds),
            Exposure::Auto(brightness) => {
                let found =
                    auto_exposure::exposure_s(camera, sensor, cube, self.gain, brightness)?;
                // Its three digits, and not those of the product's rounding.
                let ms = |seconds: f64| (1e9 * seconds).round() / 1e6;
                let clipping = found.clipping_s.map_or_else(String::new, |s| {
                    format!(", since {} ms clips highlights of a channel", ms(s))
                });
                eprintln!("note: automatic exposure: {} ms{clipping}", ms(found.exposure_s));
                Ok(found.exposure_s)
            }
        }
    }

    /// Number of the first frame that the sensor takes.
    pub fn first_number(&self) -> u32 {
        self.hdr.map_or(self.frame_seed, |hdr| hdr.frames(self.frame_seed)[0])
    }

    /// Settings of frame `i` for an exposure of `exposure_s` seconds before bracketing.
    pub fn settings(&self, camera: &Camera, exposure_s: f64, i: u32) -> FrameSettings {
        let step = self.bracket.get(i as usize % self.bracket.len().max(1)).unwrap_or(&0.0);
        let exposure_s = exposure_s * libm::exp2(*step);
        camera.settings(self.frame_seed.wrapping_add(i), exposure_s, self.gain)
    }
}

/// Share of a channel's samples that may be saturated without a warning. A trade: hot pixels and
/// highlights saturate in any light, and a scene that is overexposed has more.
pub const WARN_SATURATED: f64 = 1e-3;

/// Prints what was written, and warns of saturation: the `frames` of the JSON object of a command.
pub fn report(object: &Value, as_json: bool) {
    let written = object["frames"].as_array().map_or(&[][..], Vec::as_slice);
    let file = |frame: &Value| frame["file"].as_str().unwrap_or("").to_string();
    for frame in written {
        let channels = frame["channels"].as_object();
        for (channel, figures) in channels.into_iter().flatten() {
            let saturated = figures["saturated_fraction"]["value"].as_f64().unwrap_or(0.0);
            if saturated > WARN_SATURATED {
                eprintln!(
                    "warning: {}: {:.1} % of channel {channel} is saturated; shorten the \
                     exposure or lower the light",
                    file(frame),
                    100.0 * saturated
                );
            }
        }
    }
    match as_json {
        true => println!("{object}"),
        false => written.iter().for_each(|frame| eprintln!("wrote {}", file(frame))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposures() {
        assert_eq!(exposure("20ms"), Ok(Exposure::Time(0.02)));
        assert_eq!(exposure("auto"), Ok(Exposure::Auto(Brightness::Highlights)));
        assert_eq!(exposure("auto:0.18"), Ok(Exposure::Auto(Brightness::Mean(0.18))));
        assert_eq!(exposure("1/50"), Ok(Exposure::Time(0.02)));
        assert_eq!(duration("1/8s"), Ok(0.125));
        assert!(
            duration("1/0").is_err() && duration("/50").is_err() && duration("1/5ms").is_err()
        );
        assert!(exposure("auto:-1").is_err() && exposure("automatic").is_err());
    }

    #[test]
    fn gains() {
        assert_eq!((gain("2.5"), gain("0dB")), (Ok(2.5), Ok(1.0)));
        assert!((gain("6dB").unwrap() - 1.995_262).abs() < 1e-6);
        assert!((gain("-6 db").unwrap() - 0.501_187).abs() < 1e-6);
        assert!(gain("0").is_err() && gain("dB").is_err() && gain("-2").is_err());
    }

    #[test]
    fn frame_rates() {
        assert_eq!(frames_per_s("25"), Ok(25.0));
        assert_eq!(frames_per_s("30000/1001"), Ok(30_000.0 / 1001.0));
        assert!(frames_per_s("0").is_err() && frames_per_s("25/0").is_err());
    }

    #[test]
    fn durations() {
        for (text, seconds) in [("20ms", 0.02), ("1.5s", 1.5), ("300us", 3e-4), ("2 s", 2.0)] {
            assert!((duration(text).unwrap() - seconds).abs() < 1e-12, "{text}");
        }
        for text in ["20", "0s", "-1ms", "ms", "1h", "nans", "infs"] {
            assert!(duration(text).is_err(), "{text}");
        }
    }
}
