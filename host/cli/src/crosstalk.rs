//! `camrig crosstalk`: the virtual rotation experiment and the fit of its captures.

use super::arguments::{CameraArgs, band_at, duration, progress};
use super::captures::opened;
use super::notes::Notes;
use camrig_base::output::write_file;
use camrig_base::{Error, Result};
use camrig_capture::bench;
use camrig_captures::Role;
use camrig_measure::{coupling, crosstalk};
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// Simulate the crosstalk experiment, or fit its captures
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig crosstalk bench --camera my.toml --frames 100 -o bench\n  \
    camrig crosstalk fit bench -o crosstalk.csv")]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand, Debug)]
enum What {
    /// Simulate the experiment: seven filters, a 17 x 13 grid of points and four axis scans; the
    /// camera's crosstalk table is the hidden truth
    #[command(after_help = "Examples:\n  \
        camrig crosstalk bench --camera my.toml --frames 100 -o bench")]
    Bench(BenchArgs),
    /// Fit the table of factors, with uncertainties, to captures of role "rotation"
    #[command(after_help = "Examples:\n  camrig crosstalk fit bench -o crosstalk.csv")]
    Fit(FitArgs),
}

#[derive(clap::Args, Debug)]
struct BenchArgs {
    #[command(flatten)]
    camera: CameraArgs,
    /// Frames per point
    #[arg(
        long,
        default_value_t = 100,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(2..)
    )]
    frames: u32,
    /// Exposure time
    #[arg(
        long,
        default_value = "10ms",
        value_parser = duration,
        value_name = "TIME",
        allow_hyphen_values = true
    )]
    exposure: f64,
    /// Number of the first frame
    #[arg(long, default_value_t = 0, value_name = "K")]
    frame_seed: u32,
    /// Directory of the capture set
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Replace an existing set
    #[arg(long)]
    force: bool,
}

#[derive(clap::Args, Debug)]
struct FitArgs {
    /// Capture set with rotation captures
    captures: PathBuf,
    /// Output table (CSV)
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Replace an existing table
    #[arg(long)]
    force: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    match &args.what {
        What::Bench(args) => run_bench(args),
        What::Fit(args) => run_fit(args),
    }
}

fn run_bench(args: &BenchArgs) -> Result<ExitCode> {
    let camera = args.camera.load()?;
    Notes::default().tell_tables(&camera, bench::FILTERS_NM.map(band_at));
    let bar = progress("frames", bench::total_frames(args.frames));
    bench::bench(
        &camera,
        args.frames,
        args.exposure,
        &args.output,
        args.force,
        args.frame_seed,
        || bar.inc(1),
    )?;
    bar.finish_and_clear();
    eprintln!("wrote {}", args.output.display());
    Ok(ExitCode::SUCCESS)
}

fn run_fit(args: &FitArgs) -> Result<ExitCode> {
    let set = opened(&args.captures)?;
    let result = crosstalk::fit(&set)?;
    let coupling = match set.with_role(Role::Flat).next() {
        Some(_) => Some(coupling::fit(&set)?),
        None => None,
    };
    for note in &result.notes {
        eprintln!("note: {note}");
    }
    let csv = crosstalk::to_csv(&result);
    if let Some(path) = &args.output {
        write_file(path, args.force, csv.as_bytes())?;
    }
    if args.json {
        let mut object = serde_json::to_value(&result)
            .map_err(|e| Error::internal(format!("figures as JSON: {e}")))?;
        object["neighbour_coupling"] = json!(coupling);
        println!("{object}");
        return Ok(ExitCode::SUCCESS);
    }
    if args.output.is_none() {
        print!("{csv}");
    }
    for c in &result.consistency {
        eprintln!(
            "{} scan: {} samples, {:.2} % rms from the grid, χ² per sample {:.2}",
            c.scan, c.samples, c.rms_percent, c.chi2_per_sample
        );
    }
    if let Some(coupling::Coupling { horizontal: h, vertical: v }) = coupling {
        eprintln!(
            "neighbour coupling: {:.4} ± {:.4} horizontal, {:.4} ± {:.4} vertical",
            h.value, h.std_error, v.value, v.std_error
        );
    }
    Ok(ExitCode::SUCCESS)
}
