//! `camrig explain` and `camrig schema`: what the keys of a camera file mean.

use super::effects;
use camrig_base::{Error, Result};
use camrig_camera::keys::{Holds, KEYS, Key};
use camrig_camera::{EffectKind, schema};
use serde_json::{Value, json};
use std::process::ExitCode;

/// What a key of the camera file means: unit, range, what real cameras have
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  \
    camrig explain                            every key and every effect\n  \
    camrig explain sensor.noise.read_e\n  \
    camrig explain effect.row-temporal-noise")]
pub struct Args {
    /// A key with or without its table, or an effect
    key: Option<String>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The JSON schema of the camera file, for editors
#[derive(clap::Args, Debug)]
#[command(after_help = "Example, for editors that know Taplo's directive:\n  \
    camrig schema > camera.schema.json\n  \
    sed -i '1i #:schema ./camera.schema.json' my-camera.toml")]
pub struct SchemaArgs {}

/// Runs `camrig schema`.
pub fn run_schema(_: &SchemaArgs) -> Result<ExitCode> {
    println!("{:#}", schema::schema());
    Ok(ExitCode::SUCCESS)
}

/// Runs `camrig explain`.
pub fn run(args: &Args) -> Result<ExitCode> {
    let (keys, kinds) = match &args.key {
        None => (KEYS.iter().collect(), EffectKind::all().collect()),
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
            println!("{:38} {}", key.path(), first_sentence(key.doc));
        }
        for kind in kinds {
            println!("{:38} {}", format!("effect.{}", kind.kind), first_sentence(kind.doc));
        }
        return Ok(ExitCode::SUCCESS);
    }
    keys.iter().for_each(|key| explain_key(key));
    kinds.iter().for_each(effects::describe);
    Ok(ExitCode::SUCCESS)
}

/// Keys and effects of a name: the whole path, or its last part.
fn find(name: &str) -> Result<(Vec<&'static Key>, Vec<EffectKind>)> {
    let keys: Vec<&Key> = KEYS.iter().filter(|k| k.path() == name || k.name == name).collect();
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
    let paths: Vec<String> = KEYS.iter().map(Key::path).collect();
    let mut known: Vec<&str> = paths.iter().map(String::as_str).collect();
    known.extend(KEYS.iter().map(|k| k.name));
    known.extend(EffectKind::all().map(|e| e.kind));
    let nearest = camrig_base::toml_text::nearest(name, known.iter().copied());
    Err(Error::input(format!("no key or effect {name:?}"))
        .help(format!("did you mean {nearest:?}? `camrig explain` lists them all")))
}

fn explain_key(key: &Key) {
    println!("{}", key.path());
    println!("  {}", key.doc);
    println!("  {}", holds(key));
    if !key.usual.is_empty() {
        println!("  usual: {}", key.usual);
    }
    match key.default {
        None => println!("  must be given"),
        Some(default) => println!("  left out: {default}"),
    }
}

fn holds(key: &Key) -> String {
    let unit = if key.unit.is_empty() { String::new() } else { format!(" {}", key.unit) };
    match key.holds {
        Holds::Number(low, high) => format!("number, {low} to {high}{unit}"),
        Holds::Whole(low, high) => format!("whole number, {low} to {high}{unit}"),
        Holds::NumberOrFile(low, high) => format!("number, {low} to {high}{unit}, or a file"),
        Holds::File => "file".into(),
        Holds::Word(words) => format!("one of {}", words.join(", ")),
        Holds::WordOrFile(words) => format!("{}, or a file", words.join(", ")),
        Holds::Text => "text".into(),
        Holds::Texts => "text, or a list of texts".into(),
        Holds::NumberOrName => "whole number from 1, or a name".into(),
    }
}

fn first_sentence(doc: &str) -> String {
    let line = doc.split_whitespace().collect::<Vec<_>>().join(" ");
    line.split_once(". ").map_or(line.clone(), |(first, _)| format!("{first}."))
}

fn key_json(key: &Key) -> Value {
    let (low, high) = match key.holds {
        Holds::Number(low, high) | Holds::NumberOrFile(low, high) => (Some(low), Some(high)),
        Holds::Whole(low, high) => (Some(low as f64), Some(high as f64)),
        _ => (None, None),
    };
    json!({
        "key": key.path(), "holds": holds(key), "unit": key.unit, "min": low, "max": high,
        "usual": key.usual, "default": key.default, "doc": key.doc,
    })
}
