//! `camrig batch`: renders a sweep to a data set.

use super::arguments::{device, progress};
use camrig_base::numbers::counted;
use camrig_base::{Error, Result};
use camrig_batch::{self as batch, Dataset, Shard, Sweep};
use camrig_optics::{DeviceChoice, content};
use camrig_report::tradeoff;
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// Render a sweep (a grid of cameras, scenes, lights, exposures, seeds, or random draws of them) to
/// a data set with a manifest
///
/// Existing pictures are kept: after a crash or a kill, run the same command again. The pictures do
/// not depend on how the work was split.
#[derive(clap::Args, Debug)]
#[command(after_help = "A sweep file:\n  \
    format = \"sweep/1\"\n  \
    frames = 2                       # per combination\n\n  \
    [grid]                           # a value, a list, or \
    { from, to, count, spacing = \"log\" }\n  \
    camera = \"mt9t012\"\n  \
    scene = [\"colorchecker\", \"slanted-edge:angle=5\"]\n  \
    illuminant = [\"D65\", \"A\"]\n  \
    lux = [10, 100, 1000]\n  \
    exposure_s = [0.01, 0.04]\n  \
    analog_gain = 1.0\n  \
    sensor_seed = [1, 2]\n\n  \
    [grid.camera_keys]\n  \
    \"sensor.noise.read_e\" = [2.0, 4.0]\n\n  \
    [figures]                        # into figures.csv and a page, figures.html\n  \
    snr_db = true                    # uniform scenes\n  \
    dynamic_range_db = true\n  \
    mtf50_cycles_per_pixel = true    # slanted edges\n  \
    delta_e_2000 = true              # colour charts\n\n  \
    [choice]                         # the optimum on that page\n  \
    best = \"snr_10_lux\"              # least light for an SNR of 10\n  \
    need = { mtf50_cycles_per_mm = 150 }\n\n  \
    [random]                         # keys of the grid or of the camera file at random\n  \
    count = 200                      # draws per combination of the grid\n  \
    seed = 1\n  \
    [random.keys]\n  \
    scene = { choice = [\"photos/*.jpg\"] }\n  \
    lux = { log-range = [10, 1000] }\n  \
    \"sensor.noise.read_e\" = { range = [2, 4] }\n\n  \
    [clean]                          # expected signal beside each frame, NAME.clean.npy\n  \
    unit = \"dn\"                      # or \"e\"\n\n  \
    [labels]                         # carried through the lens\n  \
    folder = \"labels\"                # of photo.jpg: photo.json (LabelMe), photo.png (mask)\n\nExamples:\n  \
    camrig batch sweep.toml --dry-run\n  \
    camrig batch sweep.toml -o dataset\n  \
    camrig batch sweep.toml -o again --only 137\n  \
    camrig batch sweep.toml -o dataset --shard $SLURM_ARRAY_TASK_ID/64\n  \
    parallel -j 8 camrig batch sweep.toml -o dataset --shard {}/64 ::: $(seq 64)")]
pub struct Args {
    /// Sweep file
    sweep: PathBuf,
    /// Directory of the data set, new or to be continued
    #[arg(short, long, value_name = "DIR", required_unless_present = "dry_run")]
    output: Option<PathBuf>,
    /// Render only part K of N, counted from 1
    #[arg(long, value_name = "K/N", value_parser = Shard::parse, default_value = "1/1")]
    shard: Shard,
    /// Render only the picture with this index, counted from 0
    #[arg(long, value_name = "INDEX", conflicts_with = "shard")]
    only: Option<u64>,
    /// Print what would be rendered, and how much of it exists
    #[arg(long)]
    dry_run: bool,
    /// Device that computes blur varying over the field. Never chosen automatically, because the
    /// shards of a data set may run on different machines
    #[arg(long, value_parser = device(), default_value_t = DeviceChoice::Cpu, value_name = "D")]
    device: DeviceChoice,
    /// Do not cache the optics stage (~/.cache/camrig/optics)
    #[arg(long)]
    no_cache: bool,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let sweep = Sweep::load(&args.sweep)?;
    let total = sweep.pictures();
    let part = match args.only {
        Some(index) if index >= total => {
            return Err(Error::input(format!("picture {index} of {total}"))
                .at("--only")
                .help(format!("use 0 to {}", total - 1)));
        }
        Some(index) => index..index + 1,
        None => args.shard.pictures(total),
    };
    let dataset = match &args.output {
        Some(directory) if !args.dry_run || directory.join("batch.json").exists() => {
            Some(Dataset::open(directory, &sweep)?)
        }
        _ => None,
    };
    let mut notes = Vec::new();
    let done = match &dataset {
        Some(dataset) if !args.dry_run => {
            let bar = progress("pictures", part.end - part.start);
            let cache = if args.no_cache { None } else { content::directory() };
            let device = args.device.open()?;
            let tell = |note: &str| {
                bar.suspend(|| eprintln!("note: {note}"));
                notes.push(note.to_owned());
            };
            batch::run(&sweep, dataset, part.clone(), device, cache, || bar.inc(1), tell)?;
            bar.finish_and_clear();
            dataset.complete()?
        }
        Some(dataset) => dataset.done(),
        None => 0,
    };
    let (in_part, complete) = (part.end - part.start, done == total);
    let title = args.sweep.file_stem().unwrap_or_default().to_string_lossy();
    let page = match &dataset {
        Some(dataset) => {
            let choice = sweep.choice.as_ref().map(|choice| tradeoff::Choice {
                best: choice.best.clone(),
                need: choice.need.clone(),
            });
            dataset.draw(|records| {
                tradeoff::page(&title, records, &sweep.text, choice.as_ref()).html()
            })?
        }
        None => None,
    };
    if args.json {
        let object = json!({
            "pictures": total, "in_shard": in_part, "done": done, "complete": complete,
            "notes": notes,
        });
        println!("{object}");
    } else {
        let total = counted(total as usize, "picture");
        let part = match args.only {
            Some(index) => format!("picture {index} alone"),
            None => format!("{in_part} of them in shard {}", args.shard),
        };
        eprintln!("{total}, {part}; {done} done");
        if let (true, Some(directory)) = (complete, &args.output) {
            eprintln!("complete: {}", directory.join("manifest.jsonl").display());
            if let Some(page) = page {
                eprintln!("figures: {} and figures.csv", page.display());
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}
