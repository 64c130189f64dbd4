//! `camrig effects`: the catalogue of effects.

use camrig_base::{Error, Result, toml_text};
use camrig_camera::EffectKind;
use serde_json::json;
use std::process::ExitCode;

/// List the effects that a camera file may contain as [[effect]], or describe one
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  camrig effects defocus")]
pub struct Args {
    /// Effect
    kind: Option<String>,
    /// Print everything as JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<ExitCode> {
    let mut kinds: Vec<EffectKind> = EffectKind::all().collect();
    if let Some(kind) = &args.kind {
        let known: Vec<&str> = kinds.iter().map(|e| e.kind).collect();
        let unknown = Error::input(format!("unknown effect {kind:?}"))
            .help(toml_text::did_you_mean(kind, &known));
        kinds.retain(|e| e.kind.eq_ignore_ascii_case(kind));
        if kinds.is_empty() {
            return Err(unknown);
        }
    }
    if args.json {
        let effects: Vec<_> = kinds.iter().map(as_json).collect();
        println!("{:#}", json!({ "effects": effects }));
    } else if args.kind.is_some() {
        kinds.iter().for_each(describe);
    } else {
        for e in &kinds {
            let words = e.words.iter().map(|w| w.key);
            let keys: Vec<&str> = words.chain(e.parameters.iter().map(|p| p.key)).collect();
            println!("{:27} {:16} {}", e.kind, e.acts, keys.join(", "));
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Prints the description of an effect, and its form in a camera file.
pub(super) fn describe(effect: &EffectKind) {
    for line in effect.doc.trim().lines() {
        println!("{}", line.trim());
    }
    let number = effect.number.map(|n| format!("; number {n} on the link of a rig"));
    let number = number.unwrap_or_default();
    println!("\nacts on {}{number}", effect.acts);
    let (test, of) = (effect.test(), effect.number.is_some());
    println!(
        "checked against its closed form over its range{}, test {test}",
        if of { " in f32 and fixed point: sensor-core" } else { ": camrig-render" }
    );
    println!("\n[[effect]]\nkind = {:?}", effect.kind);
    for w in effect.words {
        let known =
            if w.values.is_empty() { String::new() } else { format!(": {}", w.values.join(", ")) };
        let must = if w.required { "; required" } else { "" };
        println!("{} = \"...\" # {}{known}{must}", w.key, w.doc);
    }
    for p in effect.parameters {
        let value = p.default.map_or_else(|| "...".to_string(), |d| d.to_string());
        let unit = if p.unit == "1" { String::new() } else { format!(" {}", p.unit) };
        let must = if p.default.is_none() { "; required" } else { "" };
        println!("{} = {value:8} # {}: {} to {}{unit}{must}", p.key, p.doc.trim(), p.min, p.max);
    }
}

/// An effect and its parameters.
pub(super) fn as_json(effect: &EffectKind) -> serde_json::Value {
    let parameters = effect.parameters.iter().map(|p| {
        json!({
            "key": p.key, "unit": p.unit, "doc": p.doc.trim(),
            "min": p.min, "max": p.max, "default": p.default,
        })
    });
    json!({
        "kind": effect.kind, "number": effect.number, "acts_on": effect.acts,
        "domain": effect.acts, "test": effect.test(), "doc": effect.doc.trim(),
        "source": effect.source(),
        "closed_form": effect.closed_form().split_whitespace().collect::<Vec<_>>().join(" "),
        "parameters": parameters.collect::<Vec<_>>(),
        "words": effect.words.iter().map(|w| json!({
            "key": w.key, "doc": w.doc, "values": w.values, "required": w.required,
        })).collect::<Vec<_>>(),
    })
}
