//! `camrig measure ptc|emva|rates|compare`: figures of capture sets.

use super::{PageArgs, dark, plus_minus};
use crate::captures::{cleaned, opened};
use camrig_base::Result;
use camrig_base::numbers::counted;
use camrig_captures::Role;
use camrig_measure::compare::{Comparison, compare};
use camrig_measure::figure::object;
use camrig_measure::{Value, emva, gains, ptc, rates};
use camrig_report as report;
use clap::Args as ClapArgs;
use serde_json::json;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::ExitCode;

/// Levels from which on they are a ladder, and too many to list.
const LADDER: usize = 4;

#[derive(ClapArgs)]
pub struct OnCaptures {
    /// Capture set: a directory with captures.toml
    captures: PathBuf,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

#[derive(ClapArgs)]
pub struct WithPage {
    #[command(flatten)]
    on: OnCaptures,
    #[command(flatten)]
    page: PageArgs,
}

#[derive(ClapArgs)]
pub struct CompareArgs {
    /// Capture set: a directory with captures.toml
    first: PathBuf,
    /// A capture set with captures of the same ids
    second: PathBuf,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

pub fn ptc_of(args: &WithPage) -> Result<ExitCode> {
    let WithPage { on: args, page } = args;
    let (set, found) = cleaned(&args.captures)?;
    let has = |role| set.with_role(role).next().is_some();
    if has(Role::Dark) && !has(Role::Flat) && !page.is_wanted() {
        eprintln!(
            "note: no flat captures, so no gain: figures of the darks in DN (for electrons, add \
             captures of role = \"flat\" at several exposures)"
        );
        return dark::of_set(&set, None, args.json);
    }
    let mut result = ptc::measure(&set)?;
    result.notes.splice(0..0, found);
    page.write(|| report::measurement::ptc(&set, &result).html())?;
    let gains = gains::measure(&set)?;
    if args.json {
        println!("{}", serde_json::Value::Object(result.json(gains.as_ref())?));
    } else {
        for note in &result.notes {
            eprintln!("note: {note}");
        }
        print_figures("all channels", &result.figures)?;
        if result.channels.len() > 1 {
            for channel in &result.channels {
                print_figures(&format!("channel {}", channel.channel), &channel.figures)?;
            }
        }
        if let Some(gains) = &gains {
            for g in &gains.gains {
                print_figures(&format!("analog gain {}", g.analog_gain), g)?;
            }
            if let Some(note) = &gains.note {
                eprintln!("note: {note}");
            }
            println!("over the gains");
            for (name, v) in [("read_e", gains.read_e), ("read_e_post", gains.read_e_post)] {
                let text = v.map_or("not determined by these captures".to_owned(), plus_minus);
                println!("  {name:36} {text}");
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

pub fn emva_of(args: &WithPage) -> Result<ExitCode> {
    let (set, found) = cleaned(&args.on.captures)?;
    let mut result = emva::measure(&set)?;
    result.warnings.splice(0..0, found);
    let folder = args.on.captures.display().to_string();
    let name = set.name();
    let camera = result.conditions.camera.as_deref().unwrap_or(&name);
    let title = format!("{camera} · EMVA 1288 data sheet");
    let command = format!("camrig measure emva {folder} --report");
    args.page.write(|| report::emva::page(&title, &name, &result, &command))?;
    let args = &args.on;
    if args.json {
        println!("{}", serde_json::Value::Object(result.json()?));
        return Ok(ExitCode::SUCCESS);
    }
    for warning in &result.warnings {
        eprintln!("warning: {warning}");
    }
    for channel in &result.channels {
        let name = format!("channel {}", channel.channel);
        print_limited(&name, &channel.figures, channel.lower_limits())?;
        // Of a ladder, the page has the plot.
        for level in channel.levels.iter().filter(|_| channel.levels.len() < LADDER) {
            let snr = level.snr_db.map_or("not determined".into(), plus_minus);
            println!(
                "  {:36} {snr} dB at {:.1} DN",
                format!("snr of {}", level.id),
                level.signal_dn
            );
        }
    }
    Ok(ExitCode::SUCCESS)
}

pub fn rates_of(args: &OnCaptures) -> Result<ExitCode> {
    let series = rates::measure(&opened(&args.captures)?)?;
    if args.json {
        println!("{}", json!({ "series": series }));
        return Ok(ExitCode::SUCCESS);
    }
    let notes: BTreeSet<&String> = series.iter().flat_map(|s| &s.notes).collect();
    notes.iter().for_each(|note| eprintln!("note: {note}"));
    series.iter().for_each(|s| println!("{s}"));
    Ok(ExitCode::SUCCESS)
}

pub fn compare_of(args: &CompareArgs) -> Result<ExitCode> {
    let Comparison { rows, notes } = compare(&opened(&args.first)?, &opened(&args.second)?)?;
    let worst = rows.iter().map(|r| r.z.abs()).fold(0.0, f64::max);
    let gap = rows.iter().map(|r| r.z * r.z).sum::<f64>() / rows.len() as f64;
    // A false-alarm rate of 1 in 100, corrected for multiple comparisons (Bonferroni).
    let limit = largest_normal(rows.len());
    let differ = worst > limit;
    if args.json {
        let object = json!({
            "statistics": rows, "mean_square_z": gap, "largest_z": worst, "limit": limit,
            "differ": differ, "notes": notes,
        });
        println!("{object}");
    } else {
        notes.iter().for_each(|note| eprintln!("note: {note}"));
        for r in rows.iter().filter(|r| r.z.abs() > limit) {
            println!(
                "{} {} {}: {} and {}, z {:+.1}",
                r.id,
                r.channel,
                r.statistic,
                plus_minus(r.first),
                plus_minus(r.second),
                r.z
            );
        }
        let rows = counted(rows.len(), "statistic");
        println!("{rows}, mean square z {gap:.2}, largest {worst:.1}");
    }
    Ok(if differ { ExitCode::from(1) } else { ExitCode::SUCCESS })
}

/// The limit that the largest of n absolute standard normal variates exceeds with a probability of
/// 1 %: solves n erfc(z/√2) = 0.01 with the tail's leading term.
fn largest_normal(n: usize) -> f64 {
    let mut z = 3.0f64;
    for _ in 0..50 {
        let tail = (2.0 / std::f64::consts::PI).sqrt() / z * n as f64 / 0.01;
        z = (2.0 * libm::log(tail)).max(1.0).sqrt();
    }
    z
}

fn print_figures(title: &str, figures: &impl serde::Serialize) -> Result<()> {
    print_limited(title, figures, &[])
}

/// Prints figures, some of which are lower limits.
fn print_limited(
    title: &str,
    figures: &impl serde::Serialize,
    lower_limits: &[&str],
) -> Result<()> {
    println!("{title}");
    for (name, value) in object(figures)?.into_iter().filter(|f| !f.1.is_number()) {
        let is_limit = lower_limits.contains(&&name[..]);
        match (value["value"].as_f64(), value["std_error"].as_f64()) {
            (Some(v), _) if is_limit => {
                println!("  {name:36} >= {}", plus_minus(Value::chosen(v)));
            }
            (Some(v), Some(e)) => println!("  {name:36} {}", plus_minus(Value::new(v, e))),
            (Some(v), None) => println!("  {name:36} {}", plus_minus(Value::chosen(v))),
            _ => println!("  {name:36} not determined by these captures"),
        }
    }
    Ok(())
}
