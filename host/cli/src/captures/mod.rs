//! `camrig captures`: makes and checks capture sets.

mod new;

use super::arguments::progress;
use camrig_base::numbers::counted;
use camrig_base::{Error, Result};
use camrig_captures::CaptureSet;
use camrig_clean::{Cleaned, Finding, Options};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Make capture sets from your own frames, and check them
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand, Debug)]
enum Command {
    New(new::NewArgs),
    Check(CheckArgs),
}

/// List all faults of a manifest, missing values, contradictions between files and manifest, and
/// everything in the frames that is not the steady behaviour of the sensor: copies, codes with a
/// step, processing, particle hits, pixels that change, wrong labels of light, drift, start-up
#[derive(clap::Args, Debug)]
#[command(after_help = "Exit status 0 if nothing was found, 1 if something was, 2 if the set \
    cannot be read. `camrig diagnose`, `compare`, `camera fit` and `measure ptc|emva` clean sets in \
    the same way. \
    Examples:\n  \
    camrig captures check captures")]
pub struct CheckArgs {
    /// Capture set: a directory with captures.toml
    captures: PathBuf,
    /// Print the findings as JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    match &args.command {
        Command::New(args) => new::run(args),
        Command::Check(args) => check(args),
    }
}

/// Loads a capture set and notes where its files contradict the manifest.
pub(super) fn opened(path: &Path) -> Result<CaptureSet> {
    let set = CaptureSet::load(path)?;
    set.contradictions().iter().for_each(|words| eprintln!("note: {words}"));
    Ok(set)
}

/// A capture set as measurements of its sensor take it ([`Cleaned::for_measurements`]).
///
/// # Errors
/// Files that cannot be read; captures that the sensor merged.
pub(super) fn cleaned(path: &Path) -> Result<(CaptureSet, Vec<String>)> {
    let set = opened(path)?;
    let bar = progress("checked", Cleaned::frames_to_read(&set)? as u64);
    let read = |n| bar.inc(n as u64);
    let cleaned = Cleaned::for_measurements(set, &Options::default().with_progress(&read))?;
    bar.finish_and_clear();
    Ok(cleaned)
}

fn check(args: &CheckArgs) -> Result<ExitCode> {
    let set = CaptureSet::load(&args.captures)?;
    // Reads all frames, including those of targets, which checks their size and bits.
    let mut frames = 0;
    let mut faults: Vec<Error> = Vec::new();
    for capture in &set.captures {
        match set.for_each_batch(capture, |_| Ok(())) {
            Ok(n) => frames += n,
            Err(e) => faults.push(e),
        }
    }
    if !faults.is_empty() {
        return Err(camrig_base::mistakes::all(faults));
    }
    let contradictions = set.contradictions();
    let bar = progress("checked", Cleaned::frames_to_read(&set)? as u64);
    let cleaned =
        Cleaned::inspect(set, &Options::default().with_progress(&|n| bar.inc(n as u64)))?;
    bar.finish_and_clear();
    let found = cleaned.findings();
    if args.json {
        let json = serde_json::json!({ "nuisances": found, "contradictions": contradictions });
        println!("{}", serde_json::to_string_pretty(&json).unwrap_or_default());
    } else {
        for line in contradictions.iter().cloned().chain(found.iter().map(Finding::line)) {
            println!("{line}");
        }
        let captures = cleaned.set().captures.len();
        let what = match contradictions.len() + found.len() {
            0 => "nothing found".to_string(),
            n => counted(n, "finding"),
        };
        println!("{}, {}: {what}", counted(captures, "capture"), counted(frames, "frame"));
    }
    let nothing = contradictions.is_empty() && found.is_empty();
    Ok(if nothing { ExitCode::SUCCESS } else { ExitCode::from(1) })
}
