//! `camrig compare`: the deviations of captures from a model, by statistic.

use super::arguments::ChangeArgs;
use super::captures::opened;
use super::diagnose::with_display;
use camrig_base::Result;
use camrig_diagnose::{Options, compare};
use camrig_measure::mtf::Roi;
use std::path::PathBuf;
use std::process::ExitCode;

/// Compare captures with a camera file, statistic by statistic
#[derive(clap::Args, Debug)]
#[command(after_help = "Exit status 1 where they disagree. Examples:\n  \
    camrig capture --camera mt9v024 --plan ptc --size 256,256 --frames 8 -o captures\n  \
    camrig compare mt9v024 captures\n  \
    camrig compare mt9v024 captures --set sensor.noise.read_e=30")]
pub struct Args {
    /// Camera file or preset: the model
    camera: String,
    /// Capture set: a directory with captures.toml
    captures: PathBuf,
    #[command(flatten)]
    changes: ChangeArgs,
    /// Only this region of the frames, in pixels
    #[arg(long, visible_alias = "roi", value_name = "X,Y,W,H", value_parser = super::measure::roi)]
    region: Option<Roi>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
    /// Number of statistics printed, the largest deviations first; 0 for all
    #[arg(long, default_value_t = 20, value_name = "N")]
    most: usize,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let camera = args.changes.load(&args.camera)?;
    let found = with_display(Options::default(), args.region, |options| {
        compare(&camera, opened(&args.captures)?, &options)
    })?;
    if args.json {
        println!("{}", found.json());
    } else {
        let most = if args.most == 0 { found.statistics.len() } else { args.most };
        println!(
            "gap {:.3} on held-out frames (1 for the true model; limit {:.2})",
            found.gap, found.gap_limit
        );
        let [fit, held_out, measured, model] = ["z fit", "held-out", "measured", "model"];
        println!("{fit:>8} {held_out:>8}  {measured:>13} {model:>13}  statistic");
        for row in found.statistics.iter().take(most) {
            let n = |value: Option<f64>| value.unwrap_or(f64::NAN);
            println!(
                "{:>8.2} {:>8.2}  {:>13.6} {:>13.6}  {}: {}",
                n(row.z_fit),
                n(row.z_held_out),
                n(row.measured),
                n(row.predicted),
                row.place,
                row.statistic,
            );
        }
    }
    Ok(if found.agrees { ExitCode::SUCCESS } else { ExitCode::from(1) })
}
