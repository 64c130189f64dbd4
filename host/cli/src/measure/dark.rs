//! `camrig measure dark`: figures of a stack of dark frames.

use super::plus_minus;
use crate::captures::opened;
use camrig_base::output::OutputDir;
use camrig_base::{Cfa, Error, Result};
use camrig_captures::{CaptureSet, DraftStack};
use camrig_measure::dark_stack::{self, DarkStack};
use clap::Args as ClapArgs;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(ClapArgs)]
pub struct DarkArgs {
    /// Frames taken without light under the same conditions: files, stacks, or their folder; - for
    /// standard input, into which a rig or another program sends CSI-2, MCAP, PGM or NPY
    #[arg(required = true)]
    frames: Vec<PathBuf>,
    /// System gain, for the read noise in electrons and, in --json, the dynamic range
    #[arg(long, value_name = "K", value_parser = crate::arguments::positive)]
    dn_per_e: Option<f64>,
    /// Colour filter pattern, where the files have none (mono without either)
    #[arg(long, value_name = "PATTERN")]
    cfa: Option<String>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn dark_of(args: &DarkArgs) -> Result<ExitCode> {
    if let [folder] = &args.frames[..]
        && folder.join("captures.toml").is_file()
    {
        if let Some(darks) = CaptureSet::darks_of_draft(folder)? {
            return of_draft(&darks, args);
        }
        let set = opened(folder)?;
        return of_set(&set, args.dn_per_e, args.json);
    }
    let cfa = args.cfa.as_deref().map(Cfa::parse).transpose()?;
    let stream = args.frames.iter().any(|path| path.as_os_str() == "-");
    let spooled = stream.then(spooled).transpose()?;
    let found = match &spooled {
        Some(_) if args.frames.len() > 1 => {
            return Err(Error::input("a stream together with files").help("use one or the other"));
        }
        Some(folder) => dark_stack::of_files(&[folder.path().join(SPOOLED)], cfa)
            .map_err(|e| e.at("standard input"))?,
        None => dark_stack::of_files(&files(&args.frames)?, cfa)?,
    };
    if args.json {
        println!("{}", serde_json::Value::Object(found.json(args.dn_per_e)?));
    } else {
        print(&found, args.dn_per_e);
    }
    Ok(ExitCode::SUCCESS)
}

/// Measures the dark stacks of a manifest that is not filled in yet, by their files alone.
fn of_draft(darks: &[DraftStack], args: &DarkArgs) -> Result<ExitCode> {
    eprintln!("note: captures.toml is not filled in yet: the files alone say how they were taken");
    if darks.is_empty() {
        return Err(Error::input("no dark captures")
            .help("a capture of role = \"dark\" is a stack without light"));
    }
    let cfa = args.cfa.as_deref().map(Cfa::parse).transpose()?;
    let mut objects = Vec::new();
    for DraftStack { id, files } in darks {
        let found = dark_stack::of_files(files, cfa.clone()).map_err(|e| e.at(id))?;
        if args.json {
            let mut object = found.json(args.dn_per_e)?;
            object.insert("id".into(), id.clone().into());
            objects.push(object);
        } else {
            print!("{id}: ");
            print(&found, args.dn_per_e);
        }
    }
    if let Some(first) = objects.first().cloned() {
        let mut top = first;
        top.insert("darks".into(), json!(objects));
        println!("{}", serde_json::Value::Object(top));
    }
    Ok(ExitCode::SUCCESS)
}

/// Measures the dark stacks of a capture set. The top level of the JSON object is the shortest of
/// them, with the least noise of the dark current.
pub fn of_set(set: &CaptureSet, dn_per_e: Option<f64>, json: bool) -> Result<ExitCode> {
    let darks = dark_stack::of_set(set)?;
    if json {
        let object = dark_stack::json_of_set(&darks, dn_per_e)?;
        println!("{}", serde_json::Value::Object(object));
        return Ok(ExitCode::SUCCESS);
    }
    for (capture, found) in &darks {
        let (id, time, gain) = (&capture.id, capture.exposure_s, capture.analog_gain);
        print!("{id} ({time} s, analog gain {gain}): ");
        print(found, dn_per_e);
    }
    Ok(ExitCode::SUCCESS)
}

/// Name of the file for standard input.
const SPOOLED: &str = "frames";

/// Saves standard input in a temporary folder, as a stack is read more than once. The folder is
/// deleted when the value is dropped or the program ends.
fn spooled() -> Result<OutputDir> {
    let name = format!("camrig-frames-{}", std::process::id());
    let folder = OutputDir::create(&std::env::temp_dir().join(name), false)?;
    folder.write(SPOOLED, &camrig_formats::read_bytes(Path::new("-"))?)?;
    Ok(folder)
}

fn print(found: &DarkStack, dn_per_e: Option<f64>) {
    found.notes.iter().for_each(|note| eprintln!("note: {note}"));
    let read = match (found.read_noise_dn, found.read_noise_e(dn_per_e)) {
        (Some(dn), Some(e)) => format!("{} DN ({} e-)", plus_minus(dn), plus_minus(e)),
        (Some(dn), None) => format!("{} DN", plus_minus(dn)),
        (None, _) => "hidden by rounding".into(),
    };
    println!(
        "read noise {read}, offset {} DN, noise of rows {} and columns {} DN, {} hot pixels, {} \
         frames",
        plus_minus(found.offset_dn),
        plus_minus(found.row_noise_dn),
        plus_minus(found.column_noise_dn),
        found.hot_pixels.value,
        found.frames
    );
}

/// The given files, and those in given folders, in order of their names.
fn files(named: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for path in named {
        match path.is_dir() {
            true => all.extend(inside(path)?),
            false => all.push(path.clone()),
        }
    }
    Ok(all)
}

fn inside(folder: &Path) -> Result<Vec<PathBuf>> {
    let failed = |e| Error::io("read", folder, e);
    let entries = std::fs::read_dir(folder).map_err(failed)?;
    let mut files: Vec<PathBuf> =
        entries.map(|entry| Ok(entry.map_err(failed)?.path())).collect::<Result<_>>()?;
    let hidden = |path: &Path| {
        path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
    };
    files.retain(|path| path.is_file() && !hidden(path));
    files.sort();
    Ok(files)
}
