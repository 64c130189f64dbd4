//! `camrig measure`: figures from captures or frames.

use crate::captures::CaptureSet;
use crate::measure::{Value, ptc};
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
}

#[derive(ClapArgs)]
struct OnCaptures {
    /// A capture set: a directory with captures.toml
    captures: PathBuf,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Runs `camrig measure`.
pub fn run(args: Args) -> Result<ExitCode> {
    match args.what {
        What::Ptc(args) => run_ptc(&args),
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
