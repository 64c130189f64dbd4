//! `camrig camera fit`: writes a camera file from a folder of captures.

use super::files;
use crate::arguments::positive;
use crate::captures::opened;
use crate::diagnose::with_display;
use crate::measure::plus_minus;
use camrig_base::{Result, Value};
use camrig_camera::{Camera, Change};
use camrig_captures::draft;
use camrig_captures::{CaptureSet, manifest};
use camrig_diagnose::compare;
use camrig_fit::{Fitted, Options, fit};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Write a camera file from dark and flat frames: every value with its error and the frames that
/// it was measured on, effects that stand out, and how far the file is from the captures
#[derive(clap::Args, Debug)]
#[command(after_help = "\
    Needed are some ten dark frames of the shortest exposure and two flats of one level. More \
    levels up\n\
    to saturation give the response, darks of a long exposure the dark current, several gains the\n\
    noise before and after the gain stage. A folder without captures.toml is read as by\n\
    `camrig captures new`. What the frames do not tell is typical, or that of --like, and marked.\n\n\
    Examples:\n  \
    camrig camera fit captures -o camera.toml\n  \
    camrig camera fit captures --like imx219 --set lens.f_number=2 -o camera.toml --json\n  \
    camrig camera fit darks --dn-per-e 0.25 -o camera.toml\n  \
    camrig diagnose ./camera.toml captures -o diagnosis")]
pub struct FitArgs {
    /// Capture set: a directory with captures.toml, or a folder of frames
    captures: PathBuf,
    /// Output; the tables that it refers to are written to the same folder
    #[arg(short, long, value_name = "FILE.toml")]
    output: PathBuf,
    /// Built-in sensor whose values stand where the captures tell nothing
    #[arg(long, value_name = "NAME")]
    like: Option<String>,
    /// DN per electron at unity gain, for darks without flats
    #[arg(long, value_name = "K", value_parser = positive)]
    dn_per_e: Option<f64>,
    /// Any key of the file, whatever the captures tell: sensor.pitch_um=2.2; repeatable
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<Change>,
    /// Name of the camera in raw files and reports [default: that of the file]
    #[arg(long)]
    name: Option<String>,
    /// Leave out the comparison of the file with the captures
    #[arg(long)]
    no_compare: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
    /// Replace existing files
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(args: &FitArgs) -> Result<ExitCode> {
    files::check_name(&args.output)?;
    let stem = args.output.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
    let mut options = Options::default();
    options.name = args.name.clone().unwrap_or(stem);
    options.like = args.like.as_ref().map(|like| like.to_ascii_lowercase());
    options.given = args.set.clone();
    options.dn_per_e = args.dn_per_e;
    let set = set_of(&args.captures)?;
    let fitted = fit(&set, &options)?;
    let written = files::write(&fitted.draft, &args.output, args.force)?;
    fitted.notes.iter().for_each(|note| eprintln!("note: {note}"));
    if !args.json {
        print(&fitted);
    }
    let compared = match args.no_compare {
        true => None,
        false => {
            let camera = Camera::load(&args.output.to_string_lossy())?;
            let options = camrig_diagnose::Options::default();
            Some(with_display(options, None, |options| compare(&camera, set, &options))?)
        }
    };
    if args.json {
        let gap = compared.as_ref().map(|c| json!({ "gap": c.gap, "limit": c.gap_limit }));
        let object = json!({
            "camera": args.output, "comparison": gap, "notes": fitted.notes,
            "values": fitted.values(),
        });
        println!("{object}");
    }
    files::tell(&fitted.draft, &args.output, &written);
    if let Some(found) = compared {
        if !args.json {
            println!(
                "gap {:.2} on held-out frames (1 for the true model; limit {:.2})",
                found.gap, found.gap_limit
            );
        }
        if !found.agrees {
            let dot = if args.output.is_absolute() { "" } else { "./" };
            eprintln!(
                "next: camrig diagnose {dot}{} {} -o diagnosis",
                args.output.display(),
                args.captures.display()
            );
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The set of a folder; without a manifest, that which `camrig captures new` would write.
fn set_of(folder: &Path) -> Result<CaptureSet> {
    let file = folder.join("captures.toml");
    if !folder.is_dir() || file.exists() {
        return opened(folder);
    }
    let draft = draft::Draft::of(folder, &draft::Known::default(), &|_| ())?;
    draft.notes.iter().for_each(|note| eprintln!("note: {note}"));
    eprintln!(
        "note: no {}: taken as `camrig captures new {}` writes it, where each \"?\" can be \
         replaced",
        file.display(),
        folder.display()
    );
    manifest::parse(&draft.text(&[]), &file)
}

/// Prints what was measured.
fn print(fitted: &Fitted) {
    for (key, value) in fitted.values() {
        let Some((number, error)) = value["value"].as_f64().zip(value["std_error"].as_f64())
        else {
            continue;
        };
        let unit = value["unit"].as_str().unwrap_or_default();
        println!("{key:36} {} {unit}", plus_minus(Value::new(number, error)));
    }
}
