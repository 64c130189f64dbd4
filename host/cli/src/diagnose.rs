//! `camrig diagnose`: name what the model lacks.

use super::arguments::{ChangeArgs, progress};
use super::captures::opened;
use super::notes::Notes;
use camrig_base::Result;
use camrig_base::output::OutputDir;
use camrig_capture::plan;
use camrig_diagnose::report::Report;
use camrig_diagnose::{Options, Progress, diagnose};
use camrig_measure::mtf::Roi;
use camrig_report as pages;
use indicatif::ProgressBar;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

/// Find where captures and a camera file disagree, name the missing effects, add them, show the
/// gap shrink
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Writes diagnosis.json, camera-improved.toml and report.html. Exit status 1 \
    where something stays unexplained. Examples:\n  \
    camrig capture --camera mt9v024 --plan ptc --size 256,256 --frames 8 -o captures\n  \
    camrig diagnose mt9v024 captures -o diagnosis"
)]
pub struct Args {
    /// Camera file or preset: the model
    camera: String,
    /// Capture set: a directory with captures.toml
    captures: PathBuf,
    #[command(flatten)]
    changes: ChangeArgs,
    /// Directory of the results
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Leave an effect out of the catalogue (may be repeated)
    #[arg(long, value_name = "KIND")]
    without: Vec<String>,
    /// Only this region of the frames, in pixels
    #[arg(long, visible_alias = "roi", value_name = "X,Y,W,H", value_parser = super::measure::roi)]
    region: Option<Roi>,
    /// Print diagnosis.json on standard output
    #[arg(long)]
    json: bool,
    /// Replace existing results
    #[arg(long)]
    force: bool,
}

/// Calls `run` with options that show on standard error what a diagnosis is doing.
pub(super) fn with_display<T>(
    options: Options<'_>,
    region: Option<Roi>,
    run: impl FnOnce(Options<'_>) -> Result<T>,
) -> Result<T> {
    let display = Mutex::new(Display::default());
    let show = |progress: Progress<'_>| {
        display.lock().unwrap_or_else(PoisonError::into_inner).show(progress);
    };
    let options = options.with_progress(&show);
    run(match region {
        Some(Roi { x, y, width, height }) => options.with_region([x, y, width, height]),
        None => options,
    })
}

/// Standard error while a diagnosis runs: a bar for each of its stages, and notes.
#[derive(Default)]
struct Display {
    bar: Option<(&'static str, ProgressBar)>,
    notes: Notes,
}

impl Display {
    fn show(&mut self, progress: Progress<'_>) {
        match progress {
            Progress::Checked { frames, total } => self.advance("checked", frames, total),
            Progress::Measured { frames, total } => self.advance("measured", frames, total),
            Progress::Note(note) => {
                self.clear();
                self.notes.tell([note.to_string()]);
            }
            Progress::Trying(what) => {
                let bar = self.bar("trying", ProgressBar::new_spinner);
                bar.set_message(format!("trying {what}"));
                bar.tick();
            }
            _ => (),
        }
    }

    fn advance(&mut self, stage: &'static str, frames: usize, total: usize) {
        self.bar(stage, || progress(stage, total as u64)).inc(frames as u64);
    }

    /// The bar of a stage, in place of that of the stage before.
    fn bar(&mut self, stage: &'static str, new: impl Fn() -> ProgressBar) -> &ProgressBar {
        if self.bar.as_ref().is_some_and(|(of, _)| *of != stage) {
            self.clear();
        }
        &self.bar.get_or_insert_with(|| (stage, new())).1
    }

    fn clear(&mut self) {
        self.bar.take().iter().for_each(|(_, bar)| bar.finish_and_clear());
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        self.clear();
    }
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let options = Options::default().without(&args.without)?;
    let model = args.changes.load(&args.camera)?;
    let output = OutputDir::create(&args.output, args.force)?;
    let found = with_display(options, args.region, |options| {
        diagnose(&model, opened(&args.captures)?, &options)
    })?;
    let json = found.report.json() + "\n";
    let improved = found.improved_file(&args.camera)?;
    output.write("diagnosis.json", json.as_bytes())?;
    output.write("camera-improved.toml", improved.text.as_bytes())?;
    for (name, content) in &improved.tables {
        output.write(name, content.as_bytes())?;
    }
    if let Some(plan) = found.next_plan() {
        output.write("next-captures.toml", plan::text(plan).as_bytes())?;
    }
    let region =
        args.region.map(|Roi { x, y, width: w, height: h }| format!(" --region {x},{y},{w},{h}"));
    let command = format!(
        "camrig diagnose {} {}{} -o {}",
        args.camera,
        args.captures.display(),
        region.unwrap_or_default(),
        args.output.display()
    );
    let page = pages::diagnosis::page(&found, &improved, &command)?;
    output.write("report.html", page.as_bytes())?;
    output.finish()?;
    if args.json {
        print!("{json}");
    } else {
        say(&found.report);
    }
    let explained = found.report.verdict.is_explained();
    Ok(if explained { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// Prints the diagnosis in a few lines.
fn say(found: &Report) {
    println!(
        "{}: gap {:.2} → {:.2} on held-out frames (1.0: as good as the right model; passes below \
         {:.2})",
        found.verdict.word(),
        found.gap_before,
        found.gap_after,
        found.gap_limit,
    );
    for nuisance in &found.nuisances {
        println!("  {}", nuisance.line());
    }
    for e in found.evidence.iter().filter(|e| e.is_named()) {
        let deviation = match e.deviation.is_finite() {
            true => format!(", {:+.0} standard errors", e.deviation),
            false => String::new(),
        };
        println!(
            "  evidence of {} ({}{deviation}): {}",
            e.effect,
            e.status.words(),
            if e.amounts.is_empty() { e.description.clone() } else { e.amounts_in_words() },
        );
    }
    for step in &found.steps {
        if let Some(description) = &step.description {
            println!("  {} ({}): {description}", step.effect, step.status.word());
            continue;
        }
        println!(
            "  {} ({}): gap {:.2} → {:.2}; {}",
            step.effect,
            step.status.word(),
            step.gap_before,
            step.gap_after,
            step.place,
        );
        for (key, p) in &step.parameters {
            match p.std_error {
                Some(se) => println!("    {key} = {:.5} ± {se:.1e}", p.value),
                // A value that was chosen, not fitted.
                None => println!("    {key} = {:.5}", p.value),
            }
        }
    }
    if let Some(first) = &found.superseded {
        println!("  {first} was named first; another in its place explains more");
    }
    for m in &found.measures.mtf_at_nyquist {
        println!(
            "  {}: MTF at Nyquist, channel {}: measured {:.3}, model {:.3} → {:.3}",
            m.capture, m.channel, m.measured, m.before, m.after,
        );
    }
    for m in &found.measures.luminance_scatter {
        let ([before, before_bright], [after, after_bright]) = (m.before, m.after);
        println!(
            "  {}: scatter of the luminance off by {before:.1} % → {after:.1} %, without dark \
             patches {before_bright:.1} % → {after_bright:.1} % (two sensors of one kind: \
             {:.1} %)",
            m.capture, m.expected[1],
        );
    }
    for left in &found.unexplained {
        println!("  unexplained: {}", left.description);
    }
    if let Some(nearest) = found.nearest_in_words() {
        println!("  {nearest}");
    }
    for pair in &found.ambiguous {
        println!("  cannot be distinguished: {}; {}", pair.names(), pair.tie_breaker);
    }
}
