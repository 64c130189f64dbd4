//! `camrig compare`: how far a model is from captures, statistic by statistic.

use super::diagnose::open;
use camrig_base::Result;
use camrig_diagnose::verdict;
use std::path::PathBuf;
use std::process::ExitCode;

/// How far a camera file is from captures, statistic by statistic
#[derive(clap::Args, Debug)]
#[command(after_help = "Exit status 1 where they disagree. Example:\n  \
    camrig capture --camera mt9v024 --plan ptc --size 256,256 --frames 8 -o captures\n  \
    camrig compare mt9v024 captures")]
pub struct Args {
    /// Camera file or preset: the model
    camera: String,
    /// Capture set: a directory with captures.toml
    captures: PathBuf,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
    /// Statistics printed, the furthest first; 0 for all
    #[arg(long, default_value_t = 20, value_name = "N")]
    most: usize,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let (camera, session) = open(&args.camera, &args.captures)?;
    let found = session.compare(&camera)?;
    let rows = verdict::rows(&session, &found);
    let passes = verdict::passes(&session, &found.0, found.1);
    if args.json {
        let object = serde_json::json!({
            "gap": found.1,
            "gap_limit": found.0.limit(),
            "agrees": passes,
            "statistics": rows,
        });
        println!("{}", serde_json::to_string_pretty(&object).unwrap_or_default());
    } else {
        let most = if args.most == 0 { rows.len() } else { args.most };
        println!(
            "gap {:.3} on held-out frames (1: a replicate of the right model; passes below {:.2})",
            found.1,
            found.0.limit()
        );
        println!("{:>8} {:>8}  {:>13} {:>13}  statistic", "z fit", "held-out", "measured", "model");
        for row in rows.iter().take(most) {
            let n = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
            println!(
                "{:>8.2} {:>8.2}  {:>13.6} {:>13.6}  {}: {}",
                n("z_fit"),
                n("z_held_out"),
                n("measured"),
                n("predicted"),
                row["where"].as_str().unwrap_or(""),
                row["statistic"].as_str().unwrap_or(""),
            );
        }
    }
    Ok(if passes { ExitCode::SUCCESS } else { ExitCode::from(1) })
}
