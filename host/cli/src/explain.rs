//! `camrig explain`: what the keys of a camera file mean.

use super::effects;
use super::presets::bare;
use camrig_base::{Error, Result};
use camrig_camera::draft::{Draft, Entry};
use camrig_camera::keys::Key;
use camrig_camera::{Camera, EffectKind, presets};
use serde_json::{Value, json};
use std::process::ExitCode;

/// Explain a key of the camera file (meaning, unit, range, values of real cameras), or list the
/// sources of a built-in camera's values
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig explain                            every key and every effect\n  \
    camrig explain sensor.noise.read_e\n  \
    camrig explain effect.row-temporal-noise\n  \
    camrig explain imx477                     every value of a preset, with its source")]
pub struct Args {
    /// A key with or without its table, an effect, or a preset
    key: Option<String>,
    /// Print one JSON object on standard output
    #[arg(long)]
    json: bool,
}

/// Runs `camrig explain`.
pub fn run(args: &Args) -> Result<ExitCode> {
    let key = args.key.as_ref().map(|key| key.to_ascii_lowercase());
    if let Some(name) = key.as_ref().filter(|name| presets::names().contains(&&name[..])) {
        explain_preset(name, args.json)?;
        return Ok(ExitCode::SUCCESS);
    }
    let (keys, kinds) = match &key {
        None => (Key::all().iter().collect(), EffectKind::all().collect()),
        Some(name) => find(name)?,
    };
    if args.json {
        let keys: Vec<Value> = keys.iter().map(|k| key_json(k)).collect();
        let effects: Vec<Value> = kinds.iter().map(effects::as_json).collect();
        println!("{}", json!({ "keys": keys, "effects": effects }));
        return Ok(ExitCode::SUCCESS);
    }
    if args.key.is_none() {
        for key in keys {
            println!("{:38} {}.", key.path(), key.summary());
        }
        for kind in kinds {
            println!("{:38} {}", format!("effect.{}", kind.kind), first_sentence(kind.doc));
        }
        return Ok(ExitCode::SUCCESS);
    }
    for key in keys {
        explain_key(key);
        if key.path() != "name" {
            in_presets(key)?;
        }
    }
    kinds.iter().for_each(effects::describe);
    Ok(ExitCode::SUCCESS)
}

/// Keys and effects of a name: the whole path, or its last part.
fn find(name: &str) -> Result<(Vec<&'static Key>, Vec<EffectKind>)> {
    let keys: Vec<&Key> =
        Key::all().iter().filter(|k| k.path() == name || k.name() == name).collect();
    let mut words = name.strip_prefix("effect.").unwrap_or(name).split('.');
    let kind = words.next().unwrap_or_default();
    let parameter = words.next();
    let is_it = |e: &EffectKind| {
        e.kind == kind && parameter.is_none_or(|p| e.parameters.iter().any(|q| q.key == p))
    };
    let effects: Vec<EffectKind> = EffectKind::all().filter(is_it).collect();
    if !keys.is_empty() || !effects.is_empty() {
        return Ok((keys, effects));
    }
    let mut known: Vec<&str> = Key::all().iter().map(Key::path).collect();
    known.extend(Key::all().iter().map(Key::name));
    known.extend(EffectKind::all().map(|e| e.kind));
    known.extend(presets::names());
    let nearest = camrig_base::toml_text::nearest(name, known.iter().copied());
    Err(Error::input(format!("no key, effect or preset {name:?}"))
        .help(format!("did you mean {nearest:?}? `camrig explain` lists them all")))
}

fn explain_key(key: &Key) {
    println!("{}", key.path());
    println!("  {}", key.doc());
    println!("  {}", key.range());
    if !key.usual().is_empty() {
        println!("  usual: {}", key.usual());
    }
    match key.default() {
        None => println!("  required"),
        Some(default) => println!("  default: {default}"),
    }
}

/// The values that built-in cameras have for a key.
fn in_presets(key: &Key) -> Result<()> {
    let mut lines = Vec::new();
    for name in presets::names().into_iter().filter(|n| !presets::HDR_NAMES.contains(n)) {
        let draft = Draft::of_preset(name)?;
        if let Some(entry) = draft.entry(key.path()) {
            lines.push(format!("    {name:16} {:12} {}", bare(entry), based_on(entry)));
        }
    }
    if !lines.is_empty() {
        println!("  built-in cameras:");
    }
    lines.iter().for_each(|line| println!("{line}"));
    Ok(())
}

/// The source of a value, in one line.
fn based_on(entry: &Entry) -> String {
    let basis = &entry.basis;
    let second_hand = if basis.second_hand { ", second-hand" } else { "" };
    let parts = [&format!("{}{second_hand}", basis.grade.name()), &basis.note, &basis.source];
    parts.into_iter().filter(|p| !p.is_empty()).cloned().collect::<Vec<_>>().join("; ")
}

/// Every value of a built-in camera with its source.
fn explain_preset(name: &str, json: bool) -> Result<()> {
    let draft = Draft::of_preset(name)?;
    let entries = || draft.entries.iter().filter(|entry| !entry.key.table().is_empty());
    let sensor = Camera::load(name)?.sensor;
    let (dn_per_e, saturation_e) = (sensor.dn_per_e(1.0), sensor.saturation_e(1.0));
    let dynamic_range_db = 20.0 * libm::log10(saturation_e / sensor.noise.read_e);
    if json {
        let values: Vec<Value> = entries().map(value_json).collect();
        let figures = json!({
            "system_gain_dn_per_e": dn_per_e, "saturation_e": saturation_e,
            "dynamic_range_db": dynamic_range_db,
        });
        let about = &draft.about;
        let all = json!({ "preset": name, "about": about, "values": values, "follows": figures });
        println!("{all}");
        return Ok(());
    }
    println!("{name}\n  {}", draft.about);
    for entry in entries() {
        let unit = if entry.value.as_str().is_some() { "" } else { entry.key.unit() };
        let value = format!("{} {unit}", bare(entry));
        println!("  {:34} {value:22} {}", entry.key.path(), based_on(entry));
    }
    println!(
        "  At unity gain this gives {dn_per_e:.4} DN per electron, saturation at {saturation_e:.0} \
         e-, and {dynamic_range_db:.1} dB over the read noise."
    );
    Ok(())
}

fn value_json(entry: &Entry) -> Value {
    let basis = &entry.basis;
    json!({
        "key": entry.key.path(), "value": entry.value, "unit": entry.key.unit(),
        "grade": basis.grade.name(), "second_hand": basis.second_hand, "source": basis.source,
        "note": basis.note,
    })
}

fn first_sentence(doc: &str) -> String {
    let line = doc.split_whitespace().collect::<Vec<_>>().join(" ");
    line.split_once(". ").map_or(line.clone(), |(first, _)| format!("{first}."))
}

fn key_json(key: &Key) -> Value {
    let (low, high) = key.limits();
    json!({
        "key": key.path(), "holds": key.range(), "unit": key.unit(), "min": low, "max": high,
        "usual": key.usual(), "default": key.default(), "doc": key.doc(),
    })
}
