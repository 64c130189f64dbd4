//! `camrig diagnose`: name what the model lacks.

use super::arguments::{ChangeArgs, band_at, progress};
use super::captures::opened;
use super::notes::Notes;
use camrig_base::output::OutputDir;
use camrig_base::{Bands, Error, Result};
use camrig_camera::Camera;
use camrig_capture::plan;
use camrig_captures::{CaptureSet, Role};
use camrig_clean::{self as clean, Cleaned, Finding};
use camrig_diagnose::Session;
use camrig_diagnose::data::codes;
use camrig_diagnose::data::design::{self, Halves};
use camrig_diagnose::report::Report;
use camrig_diagnose::verdict::{self, improved};
use camrig_measure::mtf::Roi;
use camrig_report as pages;
use camrig_shapes as shapes;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

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

/// How the frames of a cleaned set are measured: [`Session::open`] or [`Session::to_compare`].
type Measure = fn(&Camera, &Cleaned, Halves, &(dyn Fn(usize) + Sync)) -> Result<Session>;

/// Reads camera and captures, of them only a `region` where one is given, and measures the frames.
pub(super) fn open(
    mut camera: Camera,
    captures: &Path,
    region: Option<Roi>,
    measure: Measure,
) -> Result<(Camera, Session)> {
    let mut set = opened(captures)?;
    if let Some(Roi { x, y, width, height }) = region {
        set = set.within([x, y, width, height])?;
    }
    // A capture set may hold a region of the sensor.
    let (w, h) = (set.sensor.width as u32, set.sensor.height as u32);
    if w <= camera.sensor.width && h <= camera.sensor.height {
        (camera.sensor.width, camera.sensor.height) = (w, h);
    }
    let lit = set.captures.iter().filter_map(|c| c.light.as_ref()?.wavelength_nm).map(band_at);
    let mut notes = Notes::default();
    notes.tell_tables(&camera, lit.chain([Bands::VISIBLE]));
    let of_tables = notes.all().to_vec();
    let bar = looking(&set)?;
    let cleaned =
        Cleaned::new(set, &clean::Options::default().with_progress(&|n| bar.inc(n as u64)))?;
    bar.finish_and_clear();
    let (camera, set) = (codes::camera_of(&camera, &cleaned), cleaned.set());
    let counts = set.captures.iter().map(|c| set.count(c)).collect::<Result<Vec<usize>>>()?;
    let halves = design::divide(&camera, set, &counts)?;
    let total: usize = frames(&halves);
    let bar = progress("frames", total as u64);
    let mut session = measure(&camera, &cleaned, halves, &|n| bar.inc(n as u64))?;
    bar.finish_and_clear();
    session.notes.retain(|note| !of_tables.contains(note));
    session.notes.splice(0..0, of_tables);
    notes.tell(session.notes.iter().cloned().chain(session.findings.iter().map(Finding::line)));
    Ok((camera, session))
}

/// The bar while a set is looked at, which reads its dark and flat stacks twice.
pub(super) fn looking(set: &CaptureSet) -> Result<indicatif::ProgressBar> {
    let of_light = set.captures.iter().filter(|c| matches!(c.role, Role::Dark | Role::Flat));
    let frames = of_light.map(|c| set.count(c)).sum::<Result<usize>>()?;
    Ok(progress("looked at", 2 * frames as u64))
}

fn frames(halves: &Halves) -> usize {
    // The stacks of a set are read once for each half.
    let of = |d: &design::Design| {
        let stacks = d.conditions.iter().map(|c| c.stack.frames);
        stacks.chain(d.targets.iter().map(|t| t.stack.frames)).sum::<usize>()
    };
    of(&halves.fit) + halves.holdout.as_ref().map_or(0, of)
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let known: Vec<&str> = camrig_diagnose::candidates::CATALOGUE.iter().map(|c| c.0).collect();
    for kind in &args.without {
        if !known.contains(&kind.as_str()) {
            return Err(Error::input(format!("no effect {kind:?} is looked for"))
                .help(camrig_base::toml_text::did_you_mean(kind, &known)));
        }
    }
    let model = args.changes.load(&args.camera)?;
    let output = OutputDir::create(&args.output, args.force)?;
    let (camera, mut session) = open(model, &args.captures, args.region, Session::open)?;
    let bar = indicatif::ProgressBar::new_spinner();
    let outcome = shapes::run(&mut session, &camera, &args.without, &|what| {
        bar.set_message(format!("trying {what}"));
        bar.tick();
    })?;
    bar.finish_and_clear();
    let found = verdict::report(&session, &outcome);
    let alone = improved::standalone(&camera.text, &args.camera)?;
    let given = alone.text.clone();
    let improved = improved::camera_file(alone, &outcome.after.camera, &outcome.after.named)?;
    let json = found.json() + "\n";
    output.write("diagnosis.json", json.as_bytes())?;
    output.write("camera-improved.toml", improved.text.as_bytes())?;
    for (name, content) in &improved.tables {
        output.write(name, content.as_bytes())?;
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
    if !outcome.confounded.is_empty() || !session.unexplained(&outcome.after).is_empty() {
        output.write("next-captures.toml", plan::text(verdict::next_plan(&outcome)).as_bytes())?;
    }
    let added = improved::additions(&given, &improved.text, &outcome.after.named)?;
    let files = [&improved.text[..], &added];
    output.write(
        "report.html",
        pages::diagnosis::page(&session, &outcome, &found, files, &command)?.as_bytes(),
    )?;
    output.finish()?;
    if args.json {
        print!("{json}");
    } else {
        say(&found);
    }
    Ok(if found.verdict.is_explained() { ExitCode::SUCCESS } else { ExitCode::from(1) })
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
    if let Some(first) = &found.doubted {
        println!("  {first} was named first; a search that begins without it explains more");
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
        println!("  cannot be told apart: {}; {}", pair.names(), pair.tie_breaker);
    }
}
