//! `camrig measure patches|profile`: figures of single raw frames.

use super::plus_minus;
use crate::arguments::{finite, positive};
use camrig_base::Cfa;
use camrig_base::{Error, Plane, RawFrame, Result};
use camrig_formats as formats;
use camrig_measure::contrast::{self, Samples, Wanted};
use camrig_measure::mtf::Roi;
use camrig_measure::patches::{self, Corners, built_in_corners};
use camrig_measure::profile::{self, Along, RINGS};
use camrig_measure::{Value, even, figure};
use clap::Args as ClapArgs;
use serde_json::{Map, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// A raw frame, with values that its file may lack.
#[derive(ClapArgs)]
struct FrameSource {
    /// A raw frame
    frame: PathBuf,
    #[command(flatten)]
    given: Given,
}

/// Values for frames whose files lack them.
#[derive(ClapArgs, Clone)]
pub(super) struct Given {
    /// Colour filter pattern, where the file has none (mono without either)
    #[arg(long, value_name = "PATTERN")]
    cfa: Option<String>,
    /// Saturated level, where the file has none
    #[arg(long, value_name = "DN")]
    white: Option<u16>,
    /// Black level, where the file has none
    #[arg(long, value_name = "DN", value_parser = finite, allow_negative_numbers = true)]
    black: Option<f64>,
}

/// A frame with its metadata.
pub(super) struct Opened {
    pub plane: Plane<u16>,
    pub cfa: Cfa,
    pub white: Option<u16>,
    /// Whether neither the file nor the user provides a pattern.
    pub assumed_mono: bool,
    black: Option<f64>,
}

impl FrameSource {
    fn open(&self) -> Result<Opened> {
        let opened = self.given.first(&self.frame)?;
        let assumed = opened.assumed_mono.then_some(&*self.frame);
        note_assumed_mono(assumed.as_slice());
        Ok(opened)
    }
}

/// Notes which frames are treated as monochrome for lack of a pattern.
pub(super) fn note_assumed_mono(files: &[&Path]) {
    if let [first, more @ ..] = files {
        let name = first.display();
        let more = if more.is_empty() { "".into() } else { format!(" (and {} more)", more.len()) };
        eprintln!("note: {name}{more} has no colour filter pattern: mono");
    }
}

impl Given {
    /// The first frame of a file, with a note if there are others.
    fn first(&self, path: &Path) -> Result<Opened> {
        let (first, others) = self.open(path)?;
        if !others.is_empty() {
            let (name, count) = (path.display(), 1 + others.len());
            eprintln!("note: {name} has {count} frames: the first is measured");
        }
        Ok(first)
    }

    /// The first frame of a file, and the others.
    pub fn open(&self, path: &Path) -> Result<(Opened, Vec<Plane<u16>>)> {
        let mut frames = formats::read(path)?;
        if self.black.is_none() {
            frames.level_blacks();
        }
        let facts = &frames.facts;
        facts.notes.iter().for_each(|note| eprintln!("note: {note}"));
        let cfa = match (&self.cfa, &facts.cfa) {
            (Some(text), _) => Cfa::parse(text)?,
            (None, Some(cfa)) => cfa.clone(),
            (None, None) => Cfa::parse("mono")?,
        };
        let full_scale = facts.bits.map(|b| ((1u32 << b.min(16)) - 1) as u16);
        let mut planes = frames.planes.into_iter();
        let first = Opened {
            cfa,
            assumed_mono: self.cfa.is_none() && facts.cfa.is_none(),
            white: self.white.or(facts.white_level_dn).or(full_scale),
            black: self.black.or(facts.black_level_dn),
            plane: planes.next().ok_or_else(|| Error::internal("a file without frames"))?,
        };
        Ok((first, planes.collect()))
    }
}

impl Opened {
    /// The black level, which figures above black need.
    fn black(&self) -> Result<f64> {
        self.black
            .ok_or_else(|| Error::input("the file has no black level").help("provide --black DN"))
    }

    /// The samples of a channel in a region.
    fn codes(&self, letter: char, roi: &Roi) -> Result<Vec<u16>> {
        let (right, bottom) = (roi.x + roi.width, roi.y + roi.height);
        if right > self.plane.width || bottom > self.plane.height {
            let (width, height) = (self.plane.width, self.plane.height);
            return Err(Error::input(format!("a region outside the frame of {width} x {height}"))
                .help("give column, row, width and height in pixels"));
        }
        let places = (roi.y..bottom).flat_map(|y| (roi.x..right).map(move |x| (x, y)));
        let of_channel = places.filter(|&(x, y)| self.cfa.letter(x, y) == letter);
        Ok(of_channel.map(|(x, y)| self.plane.at(x, y)).collect())
    }

    /// The letters requested: all channels, or one.
    pub fn letters(&self, asked: &str) -> Result<Vec<char>> {
        let known = self.cfa.channels();
        if asked == "all" {
            return Ok(known);
        }
        match asked.to_uppercase().chars().collect::<Vec<_>>()[..] {
            [one] if known.contains(&one) => Ok(vec![one]),
            _ => Err(Error::input(format!("no channel {asked:?}")).help(format!(
                "the pattern {} has {}",
                self.cfa,
                known.iter().map(char::to_string).collect::<Vec<_>>().join(", ")
            ))),
        }
    }
}

/// Reads a region of a frame.
pub fn roi(text: &str) -> Result<Roi, String> {
    let numbers: Result<Vec<usize>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, width, height]) => Ok(Roi { x, y, width, height }),
        _ => Err(format!(
            "{text:?} is not a region; use X,Y,WIDTH,HEIGHT, for instance 200,100,80,120"
        )),
    }
}

#[derive(ClapArgs)]
pub struct SnrArgs {
    #[command(flatten)]
    source: FrameSource,
    /// Region, pixels; by default the middle half of the width and height
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    roi: Option<Roi>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn snr_of(args: &SnrArgs) -> Result<ExitCode> {
    let opened = args.source.open()?;
    let black_level_dn = opened.black()?;
    let frame = RawFrame {
        width: opened.plane.width,
        height: opened.plane.height,
        bits: u16::BITS,
        cfa: opened.cfa,
        black_level_dn,
        white_level_dn: opened.white.unwrap_or(u16::MAX),
        data: opened.plane.data,
    };
    let roi = args.roi.unwrap_or_else(|| even::middle(&frame));
    let (mut lines, mut channels, mut why) = (Vec::new(), Map::new(), None);
    for (c, name) in names(&frame.cfa).into_iter().enumerate() {
        let (line, found) = match even::snr_db(&frame, c, roi) {
            Ok(snr) => (format!("{} dB", plus_minus(snr)), json!({ "snr_db": snr })),
            Err(e) => {
                let missing = e.what().to_string();
                let line = format!("not determined: {missing}");
                why.get_or_insert(e.at(format!("channel {name}")));
                (line, json!({ "snr_db": null, "snr_missing": missing }))
            }
        };
        lines.push(format!("{name}: SNR {line}"));
        channels.insert(name, found);
    }
    // A figure that another channel lacks is one; without any there is an error.
    if let Some(why) = why.filter(|_| channels.values().all(|found| found["snr_db"].is_null())) {
        return Err(why);
    }
    match args.json {
        true => println!("{}", json!({ "channels": figure::object(&channels)? })),
        false => lines.iter().for_each(|line| println!("{line}")),
    }
    Ok(ExitCode::SUCCESS)
}

#[derive(ClapArgs)]
pub struct PatchesArgs {
    #[command(flatten)]
    source: FrameSource,
    /// Centres of patches 1, 6, 24 and 19 in pixels; by default, those of the built-in chart
    #[arg(long, value_name = "X1,Y1,...,X4,Y4", value_parser = corners)]
    corners: Option<Corners>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Reads the centres of a chart's corner patches.
pub fn corners(text: &str) -> Result<Corners, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[a, b, c, d, e, f, g, h]) => Ok([[a, b], [c, d], [e, f], [g, h]]),
        _ => Err(format!("{text:?}: use eight numbers, X1,Y1,...,X4,Y4")),
    }
}

#[derive(ClapArgs)]
pub struct ContrastArgs {
    #[command(flatten)]
    source: FrameSource,
    /// Region of the bright patch, pixels
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    bright: Roi,
    /// Region of the dark patch, pixels
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    dark: Roi,
    /// Weber contrast of the patches [default: that of their means]
    #[arg(long, value_name = "K", value_parser = positive, allow_negative_numbers = true)]
    contrast: Option<f64>,
    /// Relative deviation from the contrast that counts as shown
    #[arg(long, value_name = "EPSILON", default_value_t = 0.5)]
    tolerance: f64,
    /// Channel letter, or all
    #[arg(long, default_value = "all", value_name = "r|g|b|all")]
    channel: String,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn contrast_of(args: &ContrastArgs) -> Result<ExitCode> {
    let frame = args.source.open()?;
    let black = frame.black()?;
    let mut object = Map::new();
    for letter in frame.letters(&args.channel)? {
        let at = |e: Error| e.at(format!("{}, channel {letter}", args.source.frame.display()));
        let samples = |roi: &Roi| Ok(Samples::new(frame.codes(letter, roi)?, black));
        let (bright, dark) = (samples(&args.bright)?, samples(&args.dark)?);
        let of_means = bright.mean_dn() / dark.mean_dn() - 1.0;
        let wanted = Wanted::new(args.contrast.unwrap_or(of_means), args.tolerance).map_err(at)?;
        let found = contrast::of_samples(&bright, &dark, wanted).map_err(at)?;
        let (b, d) = (bright.noise(), dark.noise());
        let predicted = contrast::of_noise(b, d, black, wanted);
        let name = letter.to_ascii_lowercase().to_string();
        if !args.json {
            println!(
                "{name}: CTA {} of all pairs, {predicted:.4} by means and noise; contrast {:.4} ± \
                 {:.0} %, {:.2} and {:.2} DN above black",
                plus_minus(found),
                wanted.contrast,
                100.0 * wanted.tolerance,
                b.mean_dn,
                d.mean_dn
            );
        }
        object.insert(
            name,
            json!({
                "contrast_transfer_accuracy": found,
                "contrast_transfer_accuracy_of_noise": predicted,
                "contrast": wanted.contrast,
                "tolerance": wanted.tolerance,
                "bright": b,
                "dark": d,
            }),
        );
    }
    if args.json {
        println!("{}", json!({ "channels": figure::object(&object)? }));
    }
    Ok(ExitCode::SUCCESS)
}

#[derive(ClapArgs)]
pub struct ProfileArgs {
    #[command(flatten)]
    source: FrameSource,
    /// Profile along this row
    #[arg(long, value_name = "Y", conflicts_with = "column")]
    row: Option<usize>,
    /// Profile along this column
    #[arg(long, value_name = "X")]
    column: Option<usize>,
    /// Number of lines averaged, from this one on
    #[arg(long, default_value_t = 1, value_name = "N")]
    lines: usize,
    /// Channel letter, or all
    #[arg(long, default_value = "all", value_name = "r|g|b|all")]
    channel: String,
    /// Another frame of the same format to compare with
    #[arg(long, value_name = "FRAME")]
    against: Option<PathBuf>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// A patch with its figures; standard errors are those of Gaussian noise.
fn patch_json(p: &patches::Patch) -> serde_json::Value {
    let n = p.samples as f64;
    let mean = |(m, s): (&f64, &f64)| Value::new(*m, s / n.sqrt());
    let spread = |s: &f64| Value::new(*s, s / (2.0 * (n - 1.0)).sqrt());
    json!({
        "number": p.number,
        "centre": p.centre,
        "samples": p.samples,
        "at_zero": p.at_zero,
        "mean_dn": p.mean_dn.iter().zip(&p.std_dn).map(mean).collect::<Vec<_>>(),
        "std_dn": p.std_dn.iter().map(spread).collect::<Vec<_>>(),
        "luminance_dn": mean((&p.luminance_dn, &p.luminance_std_dn)),
        "luminance_std_dn": Value::new(p.luminance_std_dn, p.luminance_std_error_dn),
        "luminance_excess_kurtosis": p.luminance_excess_kurtosis,
    })
}

pub fn patches_of(args: &PatchesArgs) -> Result<ExitCode> {
    let frame = args.source.open()?;
    let plane = &frame.plane;
    // The built-in chart's card is 0.8 sensor widths wide.
    let corners = args.corners.unwrap_or_else(|| built_in_corners(plane.width, plane.height, 0.8));
    let patches = patches::measure(plane, &frame.cfa, frame.black()?, frame.white, &corners)
        .map_err(|e| e.at(args.source.frame.display()))?;
    patches::cut_off(&patches).iter().for_each(|note| eprintln!("note: {note}"));
    if args.json {
        let patches: Vec<_> = patches.iter().map(patch_json).collect();
        let all = json!({ "channels": names(&frame.cfa), "patches": patches });
        println!("{}", serde_json::Value::Object(figure::object(&all)?));
        return Ok(ExitCode::SUCCESS);
    }
    println!("patch  luminance DN  std DN  (channels {})", names(&frame.cfa).join(" "));
    for p in &patches {
        let means: Vec<String> =
            p.mean_dn.iter().zip(&p.std_dn).map(|(m, s)| format!("{m:.1}±{s:.1}")).collect();
        println!(
            "{:5}  {:12.2}  {:6.2}  {}",
            p.number,
            p.luminance_dn,
            p.luminance_std_dn,
            means.join("  ")
        );
    }
    Ok(ExitCode::SUCCESS)
}

fn names(cfa: &Cfa) -> Vec<String> {
    cfa.channels().iter().map(|c| c.to_ascii_lowercase().to_string()).collect()
}

pub fn profile_of(args: &ProfileArgs) -> Result<ExitCode> {
    let frame = args.source.open()?;
    let black = frame.black()?;
    let (direction, first) = match (args.row, args.column) {
        (_, Some(x)) => (Along::Column, x),
        (Some(y), None) => (Along::Row, y),
        (None, None) => (Along::Row, frame.plane.height / 2),
    };
    let given = Given { cfa: Some(frame.cfa.to_string()), ..args.source.given.clone() };
    let other = args.against.as_ref().map(|path| given.first(path)).transpose()?;
    let mut object = Map::new();
    for letter in frame.letters(&args.channel)? {
        let line = |f: &Opened, black: f64| {
            profile::along(&f.plane, &f.cfa, letter, black, direction, first, args.lines)
        };
        let name = letter.to_ascii_lowercase().to_string();
        // A single row of a Bayer pattern has two of the three channels.
        let there = profile::passes(&frame.cfa, letter, direction, first, args.lines);
        if args.channel == "all" && !there {
            continue;
        }
        let here = line(&frame, black)?;
        let difference = match &other {
            Some(o) => Some(profile::difference(&here, &line(o, o.black()?)?)?),
            None => None,
        };
        for f in [Some(&frame), other.as_ref()].into_iter().flatten() {
            let notes = profile::clipped(&f.plane, &f.cfa, letter, f.white, RINGS);
            notes.iter().for_each(|note| eprintln!("note: {note}"));
        }
        let rings =
            profile::relative_illumination(&frame.plane, &frame.cfa, letter, black, RINGS)?;
        if args.json {
            let channel = json!({
                "profile": here.points, "against": difference, "relative_illumination": rings,
            });
            object.insert(name, channel);
        } else if let Some(d) = difference {
            println!(
                "{name}: ratio of means {:.4}, rms {:.2} DN ({:.2} DN after scaling), correlation \
                 {:.5}",
                d.ratio_of_means, d.rms_dn, d.rms_scaled_dn, d.correlation
            );
        } else {
            for [p, v] in &here.points {
                println!("{name},{p},{v:.3}");
            }
        }
    }
    if args.json {
        println!("{}", json!({ "channels": object }));
    }
    Ok(ExitCode::SUCCESS)
}
