//! Outputs of `simulate` and `expose`: a file, a directory, a stream.

use super::arguments::{FrameArgs, open_report, write_report};
use super::live::{self, LiveFrames};
use crate::stop::Stoppable;
use camrig_base::output::{LiveOutput, OutputDir, OutputFile, write_file};
use camrig_base::{ChannelMean, Error, RawFrame, Result};
use camrig_camera::Camera;
use camrig_camera::hdr::HdrOutput;
use camrig_formats::live::{Beside, LiveEncoder};
use camrig_formats::mcap::CameraInfo;
use camrig_formats::{DngInfo, Facts, Format, Frames, csi2, png, preview, wide};
use camrig_measure::figure;
use camrig_report::page::Page;
use camrig_report::simulation;
use serde_json::{Value, json};
use std::borrow::Cow;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Frames of a live stream whose figures are kept: a stream may run for days.
const FIGURES: usize = 1000;

/// What is written of a frame.
#[derive(Clone, Debug, PartialEq)]
enum Kind {
    Raw(Format),
    Picture,
}

/// Where it is written.
enum Place {
    /// One file.
    File,
    /// A file for each frame.
    Directory(OutputDir),
    /// One file, frame after frame; it gets its name when it is complete.
    Stream(OutputFile, Box<LiveEncoder>),
    /// Standard output, a named pipe or a device, to which frames are written as they are taken.
    Live(Box<LiveFrames>, Stoppable),
    /// One file with all frames, written at the end.
    Stack(Stack),
}

/// Frames of a file, as long as it is not written.
enum Stack {
    Empty,
    Frames(Box<Frames>),
    Wide(Box<Frames<u32>>),
}

/// The samples of a frame.
#[derive(Clone, Copy)]
enum Samples<'a> {
    Frame(&'a RawFrame),
    /// Of more than 16 bits.
    Wide(&'a RawFrame<u32>),
}

impl Samples<'_> {
    fn encode(self, format: &Format, info: &DngInfo) -> Result<Vec<u8>> {
        match self {
            Self::Frame(frame) => {
                let facts = Facts { dng: Some(info.clone()), ..Facts::of(frame) };
                format.encode(&Frames { facts, ..Frames::from_raw(frame) })
            }
            Self::Wide(frame) => wide::encode(format, &Frames::from_raw(frame)),
        }
    }

    /// The frame in 16 bits at most, and how many times brighter it is in these: up to its
    /// brightest sample, so that dark parts of a large range keep their steps.
    fn picture(&self) -> (Cow<'_, RawFrame>, f64) {
        match self {
            Self::Frame(frame) => (Cow::Borrowed(frame), 1.0),
            Self::Wide(frame) => {
                let (frame, gain) = frame.in_16_bits();
                (Cow::Owned(frame), gain)
            }
        }
    }

    fn channel_means(self) -> Vec<ChannelMean> {
        match self {
            Self::Frame(frame) => frame.channel_means(),
            Self::Wide(frame) => frame.channel_means(),
        }
    }
}

/// The output of frames; opened before any work, so that a bad one fails at once.
pub struct FrameSink {
    kind: Kind,
    place: Place,
    path: PathBuf,
    force: bool,
    count: usize,
    written: Vec<Value>,
    report: Option<(OutputFile, simulation::Frames)>,
}

/// Which frame it is: of which exposure, and of which of its captures if there are several.
#[derive(Default)]
pub struct Named<'a> {
    /// Number of the exposure.
    pub number: u32,
    /// Name of the capture.
    pub name: Option<&'a str>,
    /// When it begins, s after the first, if that is known.
    pub time_s: Option<f64>,
    /// Payloads of its embedded data lines, for outputs that have such.
    pub embedded: Vec<Vec<u8>>,
}

/// How many frames a camera sends of an exposure.
pub fn per_exposure(camera: &Camera) -> u32 {
    match &camera.sensor.hdr {
        Some(hdr) if hdr.output == HdrOutput::Captures => hdr.captures.len() as u32,
        _ => 1,
    }
}

/// Whether what a camera sends has more than 16 bits.
fn is_wide(camera: &Camera) -> bool {
    let hdr = camera.sensor.hdr.as_ref();
    hdr.is_some_and(|hdr| hdr.output == HdrOutput::Linear && hdr.linear_bits() > u16::BITS)
}

impl FrameArgs {
    /// The kind of file; `None` for a directory.
    fn kind(&self) -> Result<Option<Kind>> {
        let path = &self.output;
        live::check_figures(path, self.json)?;
        if self.to.is_some() {
            return Ok(live::format(path, self.to.as_deref())?.map(Kind::Raw));
        }
        if LiveOutput::is_stdout(path) {
            return Err(Error::input("standard output has no name that determines the format")
                .help("give --to, for instance --to SGRBG10 or --to npy"));
        }
        match path.extension() {
            None => Ok(None),
            Some(e) if e.eq_ignore_ascii_case("png") => Ok(Some(Kind::Picture)),
            Some(_) => Ok(Some(Kind::Raw(Format::from_path(path)?))),
        }
    }

    /// Opens the output of a camera.
    pub fn sink(&self, camera: &Camera) -> Result<FrameSink> {
        let per_exposure = per_exposure(camera);
        if self.bracket.iter().any(|ev| !(-32.0..=32.0).contains(ev)) {
            let help = "use steps of -32 to 32 EV, such as -2,0,2";
            return Err(Error::input("--bracket").help(help));
        }
        let several = self.count() > 1 || per_exposure > 1;
        let (kind, live) = (self.kind()?, LiveOutput::is_stream(&self.output));
        let packets = kind == Some(Kind::Raw(Format::Csi2));
        if let Some(Kind::Raw(format)) = kind.as_ref().filter(|_| is_wide(camera)) {
            wide::check(format)?;
        }
        if self.report.is_some() && is_wide(camera) {
            return Err(Error::unsupported("a page of samples of more than 16 bits")
                .help("omit --report, or simulate with --set sensor.hdr.output=companded"));
        }
        let (kind, place) = match kind {
            None => {
                let directory = OutputDir::create(&self.output, self.force)?;
                (Kind::Raw(Format::Dng), Place::Directory(directory))
            }
            Some(Kind::Raw(format)) if format.is_stream() && (several || live || !packets) => {
                let encoder = LiveEncoder::new(format.clone(), None)?;
                let place = if live {
                    let frames = LiveFrames::create(&self.output, self.force, encoder)?;
                    Place::Live(Box::new(frames), Stoppable::new())
                } else {
                    let file = OutputFile::create(&self.output, self.force)?;
                    Place::Stream(file, Box::new(encoder))
                };
                (Kind::Raw(format), place)
            }
            Some(Kind::Picture | Kind::Raw(Format::Dng | Format::Png)) if several => {
                let frames = match self.count() {
                    u32::MAX => "all frames of a sequence".into(),
                    count => format!("{} frames", count * per_exposure),
                };
                let what = format!("{frames} into {}", self.output.display());
                return Err(Error::unsupported(what).help(
                    "write several frames to a directory (a name without extension), to one file \
                     (.npy .tiff .fits), or to a stream: .csi2, .mcap, .pgm, .y4m or headerless \
                     pixels (NAME_640x480_SGRBG10.raw, or - with --to SGRBG10)",
                ));
            }
            Some(kind) => {
                if self.output.exists() && !self.force {
                    return Err(Error::input(format!("{} exists", self.output.display()))
                        .help("choose another name, or replace it with --force"));
                }
                (kind, if several { Place::Stack(Stack::Empty) } else { Place::File })
            }
        };
        Ok(FrameSink {
            kind,
            place,
            path: self.output.clone(),
            force: self.force,
            count: 0,
            written: Vec::new(),
            report: open_report(self.report.as_deref(), self.force)?
                .map(|file| (file, simulation::Frames::default())),
        })
    }
}

impl FrameSink {
    /// Whether a signal has asked a live stream to end.
    pub fn is_asked_to_stop(&self) -> bool {
        matches!(&self.place, Place::Live(_, stop) if stop.is_asked())
    }

    /// Sets the frame rate before the first frame, for outputs that store it.
    pub fn set_rate(&mut self, frames_per_s: Option<f64>) {
        match &mut self.place {
            Place::Stream(_, encoder) => encoder.set_rate(frames_per_s),
            Place::Live(frames, _) => frames.set_rate(frames_per_s),
            _ => {}
        }
    }

    /// Sets the camera's intrinsics before the first frame, if the output stores them.
    pub fn set_camera(&mut self, figures: impl FnOnce() -> Result<CameraInfo>) -> Result<()> {
        match &mut self.place {
            Place::Stream(_, encoder) if encoder.has_camera() => encoder.set_camera(figures()?),
            Place::Live(frames, _) if frames.has_camera() => frames.set_camera(figures()?),
            _ => {}
        }
        Ok(())
    }

    /// Writes a frame of more than 16 bits.
    pub fn write_wide(
        &mut self,
        is: &Named<'_>,
        frame: &RawFrame<u32>,
        info: &DngInfo,
    ) -> Result<()> {
        self.put(is, Samples::Wide(frame), info)
    }

    /// Writes a frame of an exposure.
    pub fn write_named(&mut self, is: &Named<'_>, frame: &RawFrame, info: &DngInfo) -> Result<()> {
        self.put(is, Samples::Frame(frame), info)
    }

    /// Writes the captures of an exposure on their virtual channels, and returns whether the format
    /// has such; if not, they are to be written one by one.
    pub fn write_captures(&mut self, captures: &[csi2::Sent<'_>]) -> Result<bool> {
        match &mut self.place {
            Place::Stream(file, encoder) => {
                let Some(bytes) = encoder.encode_captures(captures)? else { return Ok(false) };
                file.write_all(&bytes).map_err(|e| Error::io("write", &self.path, e))?;
                Ok(true)
            }
            Place::Live(frames, _) => frames.write_captures(captures),
            _ => Ok(false),
        }
    }

    /// Counts a capture that is written, for the report and the figures.
    pub fn note(&mut self, is: &Named<'_>, frame: &RawFrame, info: &DngInfo) -> Result<()> {
        let capture = is.name.unwrap_or_default();
        let name = format!("{} frame {} {capture}", self.path.display(), is.number);
        self.noted(name, Samples::Frame(frame), info)
    }

    fn put(&mut self, is: &Named<'_>, samples: Samples<'_>, info: &DngInfo) -> Result<()> {
        let number = self.count;
        let beside =
            Beside { embedded: is.embedded.clone(), time_s: is.time_s, ..Beside::default() };
        let encoded = || match &self.kind {
            Kind::Picture => {
                let (frame, gain) = samples.picture();
                let (picture, factor) = preview::bright(&frame, info);
                let factor = factor * gain;
                eprintln!("note: {}", preview::brightness_words(factor));
                png::encode_rgb(&picture)
            }
            Kind::Raw(format) => samples.encode(format, info),
        };
        let mut name = format!("{} frame {number}", self.path.display());
        match (&mut self.place, samples) {
            (Place::File, _) => {
                write_file(&self.path, self.force, &encoded()?)?;
                name = self.path.display().to_string();
            }
            (Place::Directory(directory), _) => {
                let (ending, format) = match samples {
                    Samples::Frame(_) => ("dng", Format::Dng),
                    Samples::Wide(_) => ("tiff", Format::Tiff),
                };
                let file = match is.name {
                    None => format!("{:04}.{ending}", is.number),
                    Some(name) => format!("{:04}-{name}.{ending}", is.number),
                };
                directory.write(Path::new(&file), &samples.encode(&format, info)?)?;
                name = self.path.join(file).display().to_string();
            }
            (Place::Stream(file, encoder), _) => {
                let bytes = match samples {
                    Samples::Frame(frame) => {
                        if number == 0 {
                            live::tell(encoder, frame);
                        }
                        encoder.encode(frame, &beside)?
                    }
                    Samples::Wide(frame) => encoder.encode_wide(frame, &beside)?,
                };
                file.write_all(&bytes).map_err(|e| Error::io("write", &self.path, e))?;
            }
            (Place::Live(frames, _), Samples::Frame(frame)) => {
                frames.write(frame, &beside)?;
            }
            (Place::Live(frames, _), Samples::Wide(frame)) => frames.write_wide(frame, &beside)?,
            (Place::Stack(stack), _) => stack.push(samples, info),
        }
        self.noted(name, samples, info)
    }

    fn noted(&mut self, name: String, samples: Samples<'_>, info: &DngInfo) -> Result<()> {
        if let Some((_, frames)) = &mut self.report {
            let file = Path::new(&name).file_name().unwrap_or_default().to_string_lossy();
            frames.add(&file, &samples.picture().0, info)?;
        }
        self.count += 1;
        if self.count <= FIGURES || !matches!(self.place, Place::Live(..)) {
            self.written.push(json!({ "file": name, "channels": channel_figures(samples)? }));
        }
        Ok(())
    }

    /// Completes the output and returns what was written, for `--json`; `page` makes the report.
    pub fn finish(self, page: impl FnOnce(&simulation::Frames) -> Page) -> Result<Vec<Value>> {
        let place = live::named(&self.path);
        match self.place {
            Place::File => {}
            Place::Directory(directory) => directory.finish()?,
            Place::Stream(mut file, mut encoder) => {
                let end = encoder.finish()?;
                file.write_all(&end).map_err(|e| Error::io("write", &self.path, e))?;
                file.finish()?;
            }
            Place::Live(mut frames, stop) if stop.is_asked() => {
                frames.finish()?;
                eprintln!("interrupted: {} whole frames written to {place}", frames.count());
            }
            Place::Live(mut frames, _) => {
                frames.finish()?;
                if self.count > FIGURES {
                    let count = self.count;
                    eprintln!("{count} frames written to {place}; the first {FIGURES} of them:");
                }
            }
            Place::Stack(stack) => {
                let Kind::Raw(format) = &self.kind else { return Ok(self.written) };
                let bytes = match stack {
                    Stack::Empty => return Ok(self.written),
                    Stack::Frames(frames) => format.encode(&frames)?,
                    Stack::Wide(frames) => wide::encode(format, &frames)?,
                };
                write_file(&self.path, self.force, &bytes)?;
            }
        }
        if let Some((file, frames)) = self.report {
            write_report(file, &page(&frames))?;
        }
        Ok(self.written)
    }
}

impl Stack {
    fn push(&mut self, samples: Samples<'_>, info: &DngInfo) {
        match (&mut *self, samples) {
            (Self::Frames(stack), Samples::Frame(frame)) => {
                stack.planes.append(&mut Frames::from_raw(frame).planes);
                // A bracket has no single exposure to store.
                let of_all = |first: &DngInfo| first.exposure_s == info.exposure_s;
                stack.facts.dng = stack.facts.dng.take().filter(of_all);
            }
            (Self::Wide(stack), Samples::Wide(frame)) => {
                stack.planes.append(&mut Frames::from_raw(frame).planes);
            }
            (_, Samples::Frame(frame)) => {
                let mut first = Frames::from_raw(frame);
                first.facts.dng = Some(info.clone());
                *self = Self::Frames(Box::new(first));
            }
            (_, Samples::Wide(frame)) => *self = Self::Wide(Box::new(Frames::from_raw(frame))),
        }
    }
}

fn channel_figures(samples: Samples<'_>) -> Result<serde_json::Map<String, Value>> {
    let of_channel = |channel: ChannelMean| {
        let [mean_dn, saturated_fraction] =
            [channel.mean_dn, channel.saturated].map(camrig_measure::Value::chosen);
        let figures = json!({ "mean_dn": mean_dn, "saturated_fraction": saturated_fraction });
        (channel.name, figures)
    };
    let channels = samples.channel_means().into_iter().map(of_channel);
    figure::object(&channels.collect::<serde_json::Map<_, _>>())
}
