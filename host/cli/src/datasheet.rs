//! `camrig datasheet`: measures a camera and writes its data sheet.

use super::arguments::{ChangeArgs, band_at, progress};
use super::notes::Notes;
use camrig_base::output::write_file;
use camrig_base::{Error, Result};
use camrig_camera::presets;
use camrig_capture::bench;
use camrig_report::datasheet::page;
use camrig_validate::datasheet::Datasheet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Measure a camera on simulated captures and write its data sheet (HTML)
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig datasheet mt9t012 -o sheets\n  \
    camrig datasheet imx219 --set sensor.noise.read_e=1.5 -o better\n\n\
    Without a camera, mt9t012, mt9v024 and mobile: camrig datasheet -o sheets")]
pub struct Args {
    /// Camera files or presets
    cameras: Vec<String>,
    #[command(flatten)]
    changes: ChangeArgs,
    /// Folder for the pages, each called NAME.html; created if it does not exist
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Replace existing pages
    #[arg(long)]
    force: bool,
}

/// Sensor on which the figures are measured: large enough for their sampling errors to be below a
/// per cent.
const SIZE: (u32, u32) = (256, 192);

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let all: Vec<String> = presets::NAMES.map(str::to_owned).to_vec();
    let cameras = if args.cameras.is_empty() { &all } else { &args.cameras };
    std::fs::create_dir_all(&args.output).map_err(|e| Error::io("make", &args.output, e))?;
    let path = |spec: &str| {
        let stem = Path::new(spec).file_stem().map_or(spec.into(), |s| s.to_string_lossy());
        args.output.join(format!("{stem}.html"))
    };
    if let Some(taken) = cameras.iter().map(|c| path(c)).find(|p| p.exists() && !args.force) {
        return Err(
            Error::input(format!("{} exists", taken.display())).help("replace it with --force")
        );
    }
    let bar = progress("cameras", cameras.len() as u64);
    for spec in cameras {
        let camera = args.changes.load(spec)?;
        let mut notes = Notes::default();
        notes.tell_tables(&camera, bench::FILTERS_NM.map(band_at));
        let sheet = Datasheet::measure(&camera, SIZE).map_err(|e| e.at(spec))?;
        notes.tell(sheet.notes.iter().cloned());
        write_file(&path(spec), args.force, page(&camera, &sheet).as_bytes())?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    eprintln!("wrote {} data sheets to {}", cameras.len(), args.output.display());
    Ok(ExitCode::SUCCESS)
}
