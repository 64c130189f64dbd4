//! `camrig camera fit`: writes a camera file from a folder of captures.

use super::files;
use crate::arguments::positive;
use crate::captures::opened;
use crate::diagnose::with_display;
use crate::measure::plus_minus;
use camrig_base::output::{OutputFile, write_file};
use camrig_base::{Result, Value};
use camrig_camera::{Camera, Change};
use camrig_captures::draft;
use camrig_captures::{CaptureSet, manifest};
use camrig_diagnose::candidates::proposal::Proposal;
use camrig_diagnose::{compare, diagnose};
use camrig_fit::{Fitted, Options, fit};
use camrig_report::measurement;
use serde_json::{Map, Value as Json, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Write a camera file from dark and flat frames: every value with its error and the frames that
/// it was measured on, effects that stand out, and how far the file is from the captures
#[derive(clap::Args, Debug)]
#[command(after_help = "\
    Needed are some ten dark frames of the shortest exposure and two flats of one level. More \
    levels up\n\
    to saturation give the response, darks of a long exposure the dark current, several gains the\n\
    noise before and after the gain stage. Without flats, two frames or more of a scene in which\n\
    nothing moves give the gain; of darks alone, figures in electrons stay open (\"?\"). A folder without captures.toml is read as by\n\
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
    /// Leave out the comparison of the file with the captures, and the diagnosis
    #[arg(long)]
    no_compare: bool,
    /// Leave out the diagnosis, which searches for missing effects where the gap is over its limit
    #[arg(long)]
    no_diagnose: bool,
    /// Also write a page with all values, their errors and sources (HTML)
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
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
    // What cannot be written is said before any work.
    for output in [&args.output].into_iter().chain(&args.report) {
        OutputFile::create(output, args.force)?;
    }
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
    let open = files::open(&fitted.draft);
    let compared = match args.no_compare || !open.is_empty() {
        true => None,
        false => Some(judged(args, &fitted, set)?),
    };
    let added = compared.iter().flat_map(|c| &c.found);
    let added = added.map(|line| format!("the diagnosis added to the file: {line}"));
    let notes: Vec<String> = fitted.notes.iter().cloned().chain(added).collect();
    if let Some(page) = &args.report {
        let gap = compared.as_ref().map(|c| [c.gap, c.limit]);
        let page_of = measurement::camera(&options.name, &fitted.values(), &notes, gap);
        write_file(page, args.force, page_of.html().as_bytes())?;
    }
    if args.json {
        let gap = compared.as_ref().map(|c| {
            json!({
                "first_gap": c.first_gap, "gap": c.gap, "limit": c.limit, "found": c.found,
            })
        });
        let object = json!({
            "camera": args.output, "comparison": gap, "notes": notes,
            "open": open, "values": fitted.values(),
        });
        println!("{object}");
    }
    files::tell(&fitted.draft, &args.output, &written);
    if !open.is_empty() {
        eprintln!(
            "open: {}: darks alone tell no gain, so nothing in electrons. Give --dn-per-e, or add \
             two flats of one level or frames of a static scene; until then nothing runs with the \
             file",
            open.join(", ")
        );
    }
    let Some(found) = compared else { return Ok(ExitCode::SUCCESS) };
    if !args.json {
        println!(
            "gap {:.2} on held-out frames (1 for the true model; limit {:.2})",
            found.first_gap, found.limit
        );
        found.found.iter().for_each(|line| println!("  {line}"));
        if found.gap != found.first_gap {
            println!("gap {:.2} with what diagnosis found, which is in the file", found.gap);
        }
    }
    if found.gap > found.limit {
        let dot = if args.output.is_absolute() { "" } else { "./" };
        eprintln!(
            "next: camrig diagnose {dot}{} {} -o diagnosis",
            args.output.display(),
            args.captures.display()
        );
    }
    Ok(ExitCode::SUCCESS)
}

/// How far the file is from its captures.
struct Judged {
    first_gap: f64,
    gap: f64,
    limit: f64,
    /// What the diagnosis named.
    found: Vec<String>,
}

/// Compares the file with the captures, and adds to it what a diagnosis finds where it does not
/// agree.
fn judged(args: &FitArgs, fitted: &Fitted, set: CaptureSet) -> Result<Judged> {
    let file = args.output.to_string_lossy();
    let camera = Camera::load(&file)?;
    let options = camrig_diagnose::Options::default();
    let compared = with_display(options, None, |options| compare(&camera, set.clone(), &options))?;
    let (first_gap, limit) = (compared.gap, compared.gap_limit);
    let mut judged = Judged { first_gap, gap: first_gap, limit, found: Vec::new() };
    if compared.agrees || args.no_diagnose {
        return Ok(judged);
    }
    let options = camrig_diagnose::Options::default();
    let found = with_display(options, None, |options| diagnose(&camera, set, &options))?;
    let after = &found.outcome.after;
    if after.named.is_empty() && found.outcome.shapes.is_empty() {
        return Ok(judged);
    }
    let improved = found.improved_file(&file)?;
    let text = with_sources(&improved.text, &fitted.values(), &after.named);
    write_file(&args.output, true, text.as_bytes())?;
    let folder = args.output.parent().unwrap_or(Path::new(""));
    for (name, table) in &improved.tables {
        write_file(&folder.join(name), true, table.as_bytes())?;
    }
    let named = |p: &Proposal| {
        let value = |(key, v): &(&str, Value)| format!("{key} {}", plus_minus(*v));
        format!("{}: {}", p.kind, p.parameters.iter().map(value).collect::<Vec<_>>().join(", "))
    };
    judged.found = after.named.iter().map(named).collect();
    let shapes = found.outcome.shapes.iter().map(|s| s.description.clone());
    judged.found.extend(shapes);
    judged.gap = found.report.gap_after;
    Ok(judged)
}

/// The text of a camera file with the source of each value behind it: those of the fit where the
/// value is still that, else the diagnosis with its error.
fn with_sources(text: &str, values: &Map<String, Json>, named: &[Proposal]) -> String {
    let mut out = String::new();
    let (mut section, mut kind) = (String::new(), String::new());
    let lines: Vec<&str> = text.lines().collect();
    for (i, line) in lines.iter().enumerate() {
        out.push_str(line);
        if let Some(header) = line.strip_prefix('[') {
            section = header.trim_matches(['[', ']']).to_string();
            let block = lines[i + 1..].iter().take_while(|line| !line.starts_with('['));
            let own = block.filter_map(|line| line.strip_prefix("kind = ")).next();
            kind = own.unwrap_or_default().trim_matches('"').to_string();
        }
        if let Some((key, value)) = line.split_once(" = ").filter(|(key, _)| *key != "kind") {
            let path = match (section.as_str(), kind.as_str()) {
                ("", _) => key.to_string(),
                ("effect", kind) => format!("effect.{kind}.{key}"),
                (section, _) => format!("{section}.{key}"),
            };
            let number: Option<f64> = value.parse().ok();
            let same = |a: f64| number.is_some_and(|b| (a - b).abs() <= 1e-6 * b.abs());
            let own = values.get(&path).filter(|own| own["value"].as_f64().is_none_or(same));
            let parameters = named.iter().flat_map(|p| p.parameters.iter().map(|v| (p.kind, v)));
            let mut found = parameters.filter(|(of, (name, v))| {
                same(v.value) && (section != "effect" || (*of == kind && *name == key))
            });
            if let Some(own) = own {
                let word = |field: &str| own[field].as_str().unwrap_or_default();
                let error =
                    own["std_error"].as_f64().map_or(String::new(), |e| format!(" ± {e:.2e}"));
                let basis = word("basis");
                let comma = if basis.is_empty() { "" } else { ", " };
                out.push_str(&format!("  # {}{error}{comma}{basis}", word("grade")));
            } else if let Some((_, (_, v))) = found.next().filter(|(_, (_, v))| v.std_error > 0.0)
            {
                out.push_str(&format!("  # measured ± {:.2e}, by diagnosis", v.std_error));
            }
        }
        out.push('\n');
    }
    out
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
