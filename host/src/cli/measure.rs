//! `camrig measure`: figures from captures or frames.

use super::arguments;
use crate::camera::Cfa;
use crate::captures::CaptureSet;
use crate::formats;
use crate::measure::mtf::{self, Roi};
use crate::measure::patches::{self, Corners, built_in_corners};
use crate::measure::profile::{self, Along};
use crate::measure::{Value, compare, emva, ptc, rates};
use crate::report::{measurement, page::Page};
use crate::{Error, Plane, Result};
use clap::{Args as ClapArgs, Subcommand};
use serde_json::{Map, json};
use std::path::PathBuf;
use std::process::ExitCode;

/// What a person types.
#[derive(ClapArgs)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Photon transfer: gain, read noise, full well, fixed patterns, dark current, non-linearity
    #[command(after_help = "Example: camrig measure ptc captures/ --json --report ptc.html")]
    Ptc(OnCaptures),
    /// EMVA 1288 release 4.0 linear, with warnings where its assumptions do not hold
    #[command(after_help = "Example: camrig measure emva captures/ --json")]
    Emva(OnCaptures),
    /// Slanted-edge response (ISO 12233:2023 e-SFR) on raw channels, without demosaic
    #[command(
        after_help = "Example: camrig measure mtf edge.dng --roi 200,100,80,120 --pitch-um 2.2"
    )]
    Mtf(MtfArgs),
    /// Means and standard deviations of ColorChecker patches
    #[command(after_help = "Example: camrig measure patches chart.dng --json\n\
        Corners: centres of patches 1, 6, 24 and 19 (clockwise from dark skin)")]
    Patches(PatchesArgs),
    /// Row or column profile, against another frame, and relative illumination
    #[command(
        after_help = "Example: camrig measure profile a.dng --row 510 --against b.dng --channel g"
    )]
    Profile(ProfileArgs),
    /// Signal rates per position of the filter pattern under each light, from exposure series
    #[command(after_help = "Example: camrig measure rates captures/ --json")]
    Rates(RatesArgs),
    /// Two capture sets, capture by capture; exit status 1 where they differ by more than chance
    #[command(after_help = "Example: camrig measure compare captures-a captures-b")]
    Compare(CompareArgs),
}

#[derive(ClapArgs)]
struct OnCaptures {
    /// A capture set: a directory with captures.toml
    captures: PathBuf,
    #[command(flatten)]
    page: PageArgs,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

#[derive(ClapArgs)]
struct RatesArgs {
    /// A capture set: a directory with captures.toml
    captures: PathBuf,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// A page about a measurement.
#[derive(ClapArgs)]
struct PageArgs {
    /// Also write a page: figures, plots
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Replace an existing page
    #[arg(long)]
    force: bool,
}

impl PageArgs {
    /// Writes the page if one was asked for.
    fn write(&self, page: impl FnOnce() -> Page) -> Result<()> {
        match arguments::open_report(self.report.as_deref(), self.force)? {
            Some(file) => arguments::write_report(file, &page()),
            None => Ok(()),
        }
    }
}

/// A raw frame and what its file may not say.
#[derive(ClapArgs)]
struct FrameSource {
    /// A raw frame
    frame: PathBuf,
    /// Colour filter pattern, where the file does not say (mono without either)
    #[arg(long, value_name = "PATTERN")]
    cfa: Option<String>,
    /// Saturated level, where the file does not say
    #[arg(long, value_name = "DN")]
    white: Option<u16>,
    /// Black level, where the file does not say
    #[arg(long, value_name = "DN")]
    black: Option<f64>,
}

/// A frame with what is known about it.
struct Opened {
    plane: Plane<u16>,
    cfa: Cfa,
    white: Option<u16>,
    black: Option<f64>,
}

impl FrameSource {
    fn open(&self) -> Result<Opened> {
        let mut frames = formats::read(&self.frame).map_err(|e| e.at(self.frame.display()))?;
        let facts = &frames.facts;
        let cfa = match (&self.cfa, &facts.cfa) {
            (Some(text), _) => Cfa::parse(text)?,
            (None, Some(cfa)) => cfa.clone(),
            (None, None) => {
                eprintln!("note: {} names no colour filter pattern: mono", self.frame.display());
                Cfa::parse("mono")?
            }
        };
        let full_scale = facts.bits.map(|b| ((1u32 << b.min(16)) - 1) as u16);
        Ok(Opened {
            cfa,
            white: self.white.or(facts.white_level_dn).or(full_scale),
            black: self.black.or(facts.black_level_dn),
            plane: frames.planes.swap_remove(0),
        })
    }
}

impl Opened {
    /// The black level, which figures above black cannot do without.
    fn black(&self) -> Result<f64> {
        self.black.ok_or_else(|| {
            Error::input("the file does not say its black level").help("give --black DN")
        })
    }

    /// The letters asked for: all channels, or one.
    fn letters(&self, asked: &str) -> Result<Vec<char>> {
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

#[derive(ClapArgs)]
struct PatchesArgs {
    #[command(flatten)]
    source: FrameSource,
    /// Centres of patches 1, 6, 24 and 19 in pixels; the built-in chart's place unless given
    #[arg(long, value_name = "X1,Y1,...,X4,Y4", value_parser = corners)]
    corners: Option<Corners>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

#[derive(ClapArgs)]
struct ProfileArgs {
    #[command(flatten)]
    source: FrameSource,
    /// Profile along this row
    #[arg(long, value_name = "Y", conflicts_with = "column")]
    row: Option<usize>,
    /// Profile along this column
    #[arg(long, value_name = "X")]
    column: Option<usize>,
    /// Lines averaged, from the given one on
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

#[derive(ClapArgs)]
struct CompareArgs {
    /// A capture set
    first: PathBuf,
    /// Another one with captures of the same ids
    second: PathBuf,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

fn corners(text: &str) -> Result<Corners, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[a, b, c, d, e, f, g, h]) => Ok([[a, b], [c, d], [e, f], [g, h]]),
        _ => Err(format!("{text:?}: use eight numbers, X1,Y1,...,X4,Y4")),
    }
}

#[derive(ClapArgs)]
struct MtfArgs {
    #[command(flatten)]
    source: FrameSource,
    /// Region of the edge in pixels
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    roi: Roi,
    #[command(flatten)]
    page: PageArgs,
    /// Pixel pitch, for cycles per millimetre
    #[arg(long, value_name = "P")]
    pitch_um: Option<f64>,
    /// Channel letter, or all
    #[arg(long, default_value = "all", value_name = "r|g|b|all")]
    channel: String,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

fn roi(text: &str) -> Result<Roi, String> {
    let numbers: Result<Vec<usize>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, width, height]) => Ok(Roi { x, y, width, height }),
        _ => {
            Err(format!("{text:?} is no region; use X,Y,WIDTH,HEIGHT, for instance 200,100,80,120"))
        }
    }
}

/// Runs `camrig measure`.
pub fn run(args: Args) -> Result<ExitCode> {
    match args.what {
        What::Ptc(args) => run_ptc(&args),
        What::Emva(args) => run_emva(&args),
        What::Mtf(args) => run_mtf(&args),
        What::Patches(args) => run_patches(&args),
        What::Profile(args) => run_profile(&args),
        What::Rates(args) => run_rates(&args),
        What::Compare(args) => run_compare(&args),
    }
}

fn run_ptc(args: &OnCaptures) -> Result<ExitCode> {
    let set = CaptureSet::load(&args.captures)?;
    let result = ptc::measure(&set)?;
    args.page.write(|| measurement::ptc(&set, &result))?;
    if args.json {
        let mut object = object(&result.figures)?;
        if result.channels.len() > 1 {
            let channels: Map<String, serde_json::Value> = result
                .channels
                .iter()
                .map(|c| Ok((c.channel.clone(), to_json(c)?)))
                .collect::<Result<_>>()?;
            object.insert("channels".into(), channels.into());
        } else {
            object.append(&mut self::object(&result.channels[0])?);
        }
        object.insert("analog_gain".into(), json!(result.analog_gain));
        object.insert("dsnu_exposure_s".into(), json!(result.dsnu_exposure_s));
        object.insert("notes".into(), json!(result.notes));
        println!("{}", serde_json::Value::Object(object));
    } else {
        for note in &result.notes {
            eprintln!("note: {note}");
        }
        print_figures("all channels", &result.figures)?;
        if result.channels.len() > 1 {
            for channel in &result.channels {
                print_figures(&format!("channel {}", channel.channel), &channel.figures)?;
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn run_emva(args: &OnCaptures) -> Result<ExitCode> {
    let set = CaptureSet::load(&args.captures)?;
    let result = emva::measure(&set)?;
    args.page.write(|| measurement::emva(&set, &result))?;
    if args.json {
        let mut object = match &result.channels[..] {
            [mono] => self::object(mono)?,
            several => {
                // At the top the channel that gets most light, for which the levels were chosen.
                let signal = |c: &&emva::ChannelEmva| c.levels.iter().map(|l| l.signal_dn).sum();
                let most = several
                    .iter()
                    .max_by(|a, b| f64::total_cmp(&signal(a), &signal(b)))
                    .ok_or_else(|| Error::input("no channels"))?;
                let mut object = self::object(&most.figures)?;
                object.insert("reference_channel".into(), json!(most.channel));
                let mut channels = Map::new();
                for c in several {
                    channels.insert(c.channel.clone(), to_json(c)?);
                }
                object.insert("channels".into(), channels.into());
                object
            }
        };
        object.insert("warnings".into(), json!(result.warnings));
        println!("{}", serde_json::Value::Object(object));
        return Ok(ExitCode::SUCCESS);
    }
    for warning in &result.warnings {
        eprintln!("warning: {warning}");
    }
    for channel in &result.channels {
        println!("channel {}", channel.channel);
        for (name, value) in object(&channel.figures)? {
            match value.as_f64() {
                Some(v) => println!("  {name:36} {v:.6}"),
                None => println!("  {name:36} not determined by these captures"),
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn run_mtf(args: &MtfArgs) -> Result<ExitCode> {
    let frame = args.source.open()?;
    let letters = frame.letters(&args.channel)?;
    let edges: Vec<mtf::Edge> = letters
        .iter()
        .map(|&l| {
            mtf::measure(&frame.plane, &frame.cfa, l, args.roi, frame.white, args.pitch_um)
                .map_err(|e| e.at(format!("{}, channel {l}", args.source.frame.display())))
        })
        .collect::<Result<_>>()?;
    args.page.write(|| measurement::mtf(&args.source.frame.display().to_string(), &edges))?;
    if args.json {
        println!("{}", json!({ "edges": edges }));
        return Ok(ExitCode::SUCCESS);
    }
    for e in &edges {
        let mtf50 = Value::new(e.mtf50_cycles_per_pixel, e.mtf50_std_error);
        let per_mm = args.pitch_um.map_or(String::new(), |p| {
            format!(" ({} cycles/mm)", plus_minus(mtf50.scaled(1e3 / p)))
        });
        println!(
            "{}: MTF50 {} cycles/pixel{per_mm}, at Nyquist {:.3}, edge at {:.2} degrees",
            e.channel,
            plus_minus(mtf50),
            e.mtf_at_nyquist,
            e.angle_deg
        );
    }
    Ok(ExitCode::SUCCESS)
}

fn run_patches(args: &PatchesArgs) -> Result<ExitCode> {
    let frame = args.source.open()?;
    let plane = &frame.plane;
    // The built-in chart's card is 0.8 sensor widths wide.
    let corners = args.corners.unwrap_or_else(|| built_in_corners(plane.width, plane.height, 0.8));
    let white = frame.white.unwrap_or(u16::MAX);
    let patches = patches::measure(plane, &frame.cfa, frame.black()?, white, &corners)
        .map_err(|e| e.at(args.source.frame.display()))?;
    if args.json {
        println!("{}", json!({ "channels": names(&frame.cfa), "patches": patches }));
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

fn run_profile(args: &ProfileArgs) -> Result<ExitCode> {
    let frame = args.source.open()?;
    let black = frame.black()?;
    let (direction, first) = match (args.row, args.column) {
        (_, Some(x)) => (Along::Column, x),
        (Some(y), None) => (Along::Row, y),
        (None, None) => (Along::Row, frame.plane.height / 2),
    };
    let other = args.against.as_ref().map(|path| {
        let source = FrameSource {
            frame: path.clone(),
            cfa: Some(frame.cfa.to_string()),
            white: args.source.white,
            black: args.source.black,
        };
        source.open()
    });
    let other = other.transpose()?;
    let mut object = Map::new();
    for letter in frame.letters(&args.channel)? {
        let line = |f: &Opened, black: f64| {
            profile::along(&f.plane, &f.cfa, letter, black, direction, first, args.lines)
        };
        let name = letter.to_ascii_lowercase().to_string();
        let here = match line(&frame, black) {
            // A single row of a Bayer pattern has two of the three channels.
            Err(_) if args.channel == "all" && args.lines == 1 => continue,
            other => other?,
        };
        let difference = match &other {
            Some(o) => Some(profile::difference(&here, &line(o, o.black()?)?)?),
            None => None,
        };
        let rings = profile::relative_illumination(&frame.plane, &frame.cfa, letter, black, 20)?;
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

fn run_rates(args: &RatesArgs) -> Result<ExitCode> {
    let series = rates::measure(&CaptureSet::load(&args.captures)?)?;
    if args.json {
        println!("{}", json!({ "series": series }));
        return Ok(ExitCode::SUCCESS);
    }
    for s in &series {
        let light = s.wavelength_nm.map_or("light".to_owned(), |nm| format!("{nm} nm"));
        let positions = s.positions.iter().zip(&s.ratios);
        let text: Vec<String> = positions
            .map(|((letter, rate), ratio)| format!("{letter} {rate:.2} DN/s ({ratio:.4})"))
            .collect();
        println!("{:?}, {light}: {}", s.role, text.join(", "));
    }
    Ok(ExitCode::SUCCESS)
}

fn run_compare(args: &CompareArgs) -> Result<ExitCode> {
    let rows = compare::compare(&CaptureSet::load(&args.first)?, &CaptureSet::load(&args.second)?)?;
    let worst = rows.iter().map(|r| r.z.abs()).fold(0.0, f64::max);
    let gap = rows.iter().map(|r| r.z * r.z).sum::<f64>() / rows.len() as f64;
    // The largest of n standard normals exceeds this in one case of a hundred (Bonferroni).
    let limit = largest_normal(rows.len());
    let differ = worst > limit;
    if args.json {
        let object = json!({
            "statistics": rows, "mean_square_z": gap, "largest_z": worst, "limit": limit,
            "differ": differ,
        });
        println!("{object}");
    } else {
        for r in rows.iter().filter(|r| r.z.abs() > limit) {
            println!(
                "{} {} {}: {} against {}, z {:+.1}",
                r.id,
                r.channel,
                r.statistic,
                plus_minus(r.first),
                plus_minus(r.second),
                r.z
            );
        }
        println!("{} statistics, mean square z {gap:.2}, largest {worst:.1}", rows.len());
    }
    Ok(if differ { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// Where the largest of n absolute standard normals lies with 99 % probability, at most: solves
/// n erfc(z/√2) = 0.01 with the tail's leading term.
fn largest_normal(n: usize) -> f64 {
    let mut z = 3.0f64;
    for _ in 0..50 {
        let tail = (2.0 / std::f64::consts::PI).sqrt() / z * n as f64 / 0.01;
        z = (2.0 * tail.ln()).max(1.0).sqrt();
    }
    z
}

fn print_figures(title: &str, figures: &impl serde::Serialize) -> Result<()> {
    println!("{title}");
    for (name, value) in object(figures)? {
        match (value["value"].as_f64(), value["std_error"].as_f64()) {
            (Some(v), Some(e)) => println!("  {name:36} {}", plus_minus(Value::new(v, e))),
            _ => println!("  {name:36} not determined by these captures"),
        }
    }
    Ok(())
}

/// A value to the two leading digits of its error.
fn plus_minus(v: Value) -> String {
    let digits = if v.std_error > 0.0 { 1 - v.std_error.log10().floor() as i32 } else { 6 };
    let digits = digits.clamp(0, 9) as usize;
    format!("{:.digits$} ± {:.digits$}", v.value, v.std_error)
}

fn to_json(value: &impl serde::Serialize) -> Result<serde_json::Value> {
    serde_json::to_value(value).map_err(|e| Error::input(format!("figures as JSON: {e}")))
}

fn object(value: &impl serde::Serialize) -> Result<Map<String, serde_json::Value>> {
    match to_json(value)? {
        serde_json::Value::Object(map) => Ok(map),
        _ => Ok(Map::new()),
    }
}
