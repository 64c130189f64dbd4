//! `camrig measure`: figures from captures or frames.

use crate::camera::Cfa;
use crate::captures::CaptureSet;
use crate::formats;
use crate::measure::mtf::{self, Roi};
use crate::measure::{Value, emva, ptc};
use crate::{Error, Result};
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
    #[command(after_help = "Example: camrig measure ptc captures/ --json")]
    Ptc(OnCaptures),
    /// EMVA 1288 release 4.0 linear, with warnings where its assumptions do not hold
    #[command(after_help = "Example: camrig measure emva captures/ --json")]
    Emva(OnCaptures),
    /// Slanted-edge response (ISO 12233:2023 e-SFR) on raw channels, without demosaic
    #[command(
        after_help = "Example: camrig measure mtf edge.dng --roi 200,100,80,120 --pitch-um 2.2"
    )]
    Mtf(MtfArgs),
}

#[derive(ClapArgs)]
struct OnCaptures {
    /// A capture set: a directory with captures.toml
    captures: PathBuf,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

#[derive(ClapArgs)]
struct MtfArgs {
    /// A raw frame
    frame: PathBuf,
    /// Region of the edge in pixels
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    roi: Roi,
    /// Pixel pitch, for cycles per millimetre
    #[arg(long, value_name = "P")]
    pitch_um: Option<f64>,
    /// Channel letter, or all
    #[arg(long, default_value = "all", value_name = "r|g|b|all")]
    channel: String,
    /// Colour filter pattern, where the file does not say (mono without either)
    #[arg(long, value_name = "PATTERN")]
    cfa: Option<String>,
    /// Saturated level, where the file does not say
    #[arg(long, value_name = "DN")]
    white: Option<u16>,
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
    }
}

fn run_ptc(args: &OnCaptures) -> Result<ExitCode> {
    let set = CaptureSet::load(&args.captures)?;
    let result = ptc::measure(&set)?;
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
    if args.json {
        let mut object = match &result.channels[..] {
            [mono] => self::object(mono)?,
            several => {
                let mut channels = Map::new();
                for c in several {
                    channels.insert(c.channel.clone(), to_json(c)?);
                }
                Map::from_iter([("channels".to_owned(), channels.into())])
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
    let frames = formats::read(&args.frame).map_err(|e| e.at(args.frame.display()))?;
    let facts = &frames.facts;
    let cfa = match (&args.cfa, &facts.cfa) {
        (Some(text), _) => Cfa::parse(text)?,
        (None, Some(cfa)) => cfa.clone(),
        (None, None) => {
            eprintln!("note: {} names no colour filter pattern: mono", args.frame.display());
            Cfa::parse("mono")?
        }
    };
    let letters = match args.channel.as_str() {
        "all" => cfa.channels(),
        one => one.to_uppercase().chars().collect(),
    };
    let full_scale = facts.bits.map(|b| ((1u32 << b.min(16)) - 1) as u16);
    let white = args.white.or(facts.white_level_dn).or(full_scale);
    let edges: Vec<mtf::Edge> = letters
        .iter()
        .map(|&l| {
            mtf::measure(&frames.planes[0], &cfa, l, args.roi, white, args.pitch_um)
                .map_err(|e| e.at(format!("{}, channel {l}", args.frame.display())))
        })
        .collect::<Result<_>>()?;
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
