//! The camera file with the effects that were found.

use crate::candidates::proposal::Proposal;
use crate::finding::number;
use camrig_base::toml_text::seven_figures;
use camrig_base::{Error, Result};
use camrig_camera::{AnyEffect, presets};
use camrig_sensor_core::effects::Parameter;
use std::path::Path;

/// An improved camera file that does not depend on its folder.
pub struct ImprovedFile {
    /// The text.
    pub text: String,
    /// Tables it names: file name and content.
    pub tables: Vec<(String, String)>,
    /// Its additions to the one given: keys with their values, and the value before where it
    /// changed; then the effects, with standard errors.
    pub additions: String,
}

/// A camera file that does not depend on its folder.
struct Standalone {
    text: String,
    tables: Vec<(String, String)>,
}

/// The text of a camera file as a table.
fn parsed(text: &str) -> Result<toml::Table> {
    toml::from_str(text).map_err(|e| Error::input(format!("the camera file: {}", e.message())))
}

/// The camera file `text`, loaded as `spec`, with the effects of `camera`, of which `named` were
/// found.
///
/// # Errors
/// A text that is no camera file; a table that cannot be read.
pub fn file(
    text: &str,
    spec: &str,
    camera: &camrig_camera::Camera,
    named: &[Proposal],
) -> Result<ImprovedFile> {
    let given = standalone(text, spec)?;
    let before = given.text.clone();
    let Standalone { text, tables } = camera_file(given, camera, named)?;
    let additions = additions(&before, &text, named)?;
    Ok(ImprovedFile { text, tables, additions })
}

/// The camera file with the effects of `camera`, of which `named` were found, from a text and the
/// tables that it names; those of empirical effects are added.
///
/// # Errors
/// A text that is no camera file.
fn camera_file(
    Standalone { text, mut tables }: Standalone,
    camera: &camrig_camera::Camera,
    named: &[Proposal],
) -> Result<Standalone> {
    let mut file = parsed(&text)?;
    let noise = &camera.sensor.noise;
    let figures = [
        ("read_e", noise.read_e),
        ("read_e_post", noise.read_e_post),
        ("dark_current_e_per_s", noise.dark_current_e_per_s),
        ("dark_doubling_c", noise.dark_doubling_c),
        ("dsnu_e_per_s", noise.dsnu_e_per_s),
        ("prnu", noise.prnu),
        ("row_fpn_e", noise.row_fpn_e),
    ];
    let shifted = file.get("sensor").and_then(|s| s.get("bits")?.as_integer())
        != Some(i64::from(camera.sensor.bits));
    if let Some(sensor) = file.get_mut("sensor").and_then(toml::Value::as_table_mut)
        && shifted
    {
        // The codes were divided by a step: the file has the bits that vary.
        let s = &camera.sensor;
        sensor.insert("bits".into(), i64::from(s.bits).into());
        sensor.insert("black_level_dn".into(), seven_figures(s.black_level_dn).into());
        sensor.insert("full_scale_e".into(), seven_figures(s.full_scale_e).into());
    }
    const OF_BASE_MODEL: [&str; 4] = ["read-noise", "prnu", "dark-current", "row-offset-fpn"];
    let base = |e: &AnyEffect| OF_BASE_MODEL.contains(&e.kind());
    // An empirical effect may replace part of the base model.
    if named.iter().flat_map(|p| &p.effects).any(base) || !camera.empirical.is_empty() {
        let sensor = file.get_mut("sensor").and_then(toml::Value::as_table_mut);
        if let Some(sensor) = sensor {
            let table = sensor.entry("noise").or_insert_with(|| toml::Table::new().into());
            if let Some(table) = table.as_table_mut() {
                for (key, value) in figures {
                    table.insert(key.into(), seven_figures(value).into());
                }
            }
        }
    }
    let table = |kind: &str, parameters: &[Parameter], values: &[f32]| -> toml::Value {
        let mut table = toml::Table::new();
        table.insert("kind".into(), kind.into());
        for (parameter, value) in parameters.iter().zip(values) {
            if parameter.default != Some(*value) {
                table.insert(parameter.key.into(), seven_figures(f64::from(*value)).into());
            }
        }
        table.into()
    };
    let optical = camera.optical_effects.iter().map(|e| {
        let entry = e.entry();
        table(entry.kind, entry.parameters, e.values())
    });
    let mut effects: Vec<toml::Value> = optical.collect();
    let mut count = 0;
    for e in &camera.effects {
        let Some(own) = camera.empirical_of(e) else {
            let entry = e.entry();
            effects.push(table(entry.kind, entry.parameters, &e.values()));
            continue;
        };
        count += 1;
        let name = format!("empirical-{count}.toml");
        effects.push(parsed(&own.to_toml(&name))?.into());
        if own.table.has_file() {
            tables.push((name, own.table.text()?));
        }
    }
    if effects.is_empty() {
        file.remove("effect");
    } else {
        file.insert("effect".into(), effects.into());
    }
    let wrong = |e| Error::internal(format!("the improved camera file: {e}"));
    let text = toml::to_string(&file).map_err(wrong)?;
    Ok(Standalone { text, tables })
}

/// The additions of an improved camera file to the one given: keys with their values, and the value
/// before where it changed; then the effects. `named` has the standard errors.
///
/// # Errors
/// A text that is no camera file.
fn additions(given: &str, improved: &str, named: &[Proposal]) -> Result<String> {
    let (old, new) = (parsed(given)?, parsed(improved)?);
    let mut out = String::new();
    changes("", &old, &new, &mut out);
    let effects = |file: &toml::Table| -> Vec<toml::Value> {
        file.get("effect").and_then(|e| e.as_array().cloned()).unwrap_or_default()
    };
    let before = effects(&old);
    for effect in effects(&new).iter().filter(|e| !before.contains(e)) {
        let Some(table) = effect.as_table() else { continue };
        out.push_str("\n[[effect]]\n");
        let kind = table.get("kind").and_then(toml::Value::as_str).unwrap_or_default();
        let found = named.iter().find(|p| p.kind == kind);
        for (key, value) in table {
            let error = found.and_then(|p| p.parameters.iter().find(|(name, _)| name == key));
            let comment = error.filter(|(_, e)| e.std_error.is_finite());
            let comment = comment.map_or(String::new(), |(_, e)| format!("  # {}", number(*e)));
            out.push_str(&format!("{key} = {value}{comment}\n"));
        }
    }
    Ok(out.trim_start().to_owned())
}

/// The keys outside the effects whose values differ.
fn changes(place: &str, old: &toml::Table, new: &toml::Table, out: &mut String) {
    for (key, value) in new.iter().filter(|(key, _)| !(place.is_empty() && *key == "effect")) {
        let before = old.get(key);
        if let Some(table) = value.as_table() {
            let none = toml::Table::new();
            let before = before.and_then(toml::Value::as_table).unwrap_or(&none);
            changes(&format!("{place}{key}."), before, table, out);
        } else if before != Some(value) {
            let was = before.map_or(String::new(), |v| format!("  # was {v}"));
            out.push_str(&format!("{place}{key} = {value}{was}\n"));
        }
    }
}

/// Makes a camera file's text independent of its folder: the tables that it names, except those of
/// effects, are returned with it under their names; the path of a lens becomes absolute. `spec` is
/// how the camera was named.
///
/// # Errors
/// A table that cannot be read.
fn standalone(text: &str, spec: &str) -> Result<Standalone> {
    let mut file = parsed(text)?;
    let built_in = !spec.contains(['/', '\\', '.']);
    let directory = Path::new(spec).parent().unwrap_or(Path::new(".")).to_owned();
    let mut tables = Vec::new();
    for (section, key) in [
        ("lens", "transmittance"),
        ("lens", "relative_illumination"),
        ("sensor", "qe"),
        ("sensor", "ir_cut"),
        ("sensor", "crosstalk"),
    ] {
        let Some(value) = file.get_mut(section).and_then(|s| s.get_mut(key)) else { continue };
        let Some(name) = value.as_str().filter(|n| n.contains('.')).map(str::to_string) else {
            continue;
        };
        let content = if built_in {
            presets::file(&name).unwrap_or_default().to_string()
        } else {
            let path = directory.join(&name);
            std::fs::read_to_string(&path).map_err(|e| Error::io("read", &path, e))?
        };
        let base =
            Path::new(&name).file_name().map_or(name.clone(), |b| b.to_string_lossy().into());
        *value = base.clone().into();
        tables.push((base, content));
    }
    for key in ["data", "file"] {
        let Some(value) = file.get_mut("lens").and_then(|s| s.get_mut(key)) else { continue };
        let path = directory.join(value.as_str().unwrap_or_default());
        let whole = path.canonicalize().map_err(|e| Error::io("read", &path, e))?;
        *value = whole.to_string_lossy().to_string().into();
    }
    tables.sort();
    tables.dedup();
    let text =
        toml::to_string(&file).map_err(|e| Error::input(format!("the camera file: {e}")))?;
    Ok(Standalone { text, tables })
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_camera::Camera;

    #[test]
    fn additions_are_what_differs() {
        let old = "name = \"a\"\n[sensor.noise]\nread_e = 3.0\nprnu = 0.01\n\
                   [[effect]]\nkind = \"prnu\"\n";
        let new = "name = \"a\"\n[sensor.noise]\nread_e = 4.0\nprnu = 0.01\nrow_fpn_e = 1.5\n\
                   [[effect]]\nkind = \"prnu\"\n[[effect]]\nkind = \"amp-glow\"\nx = 1.0\n";
        let added = additions(old, new, &[]).unwrap();
        assert_eq!(
            added,
            "sensor.noise.read_e = 4.0  # was 3.0\nsensor.noise.row_fpn_e = 1.5\n\n\
             [[effect]]\nkind = \"amp-glow\"\nx = 1.0\n"
        );
        assert_eq!(additions(new, new, &[]).unwrap(), "");
    }

    #[test]
    fn effects_of_the_optics_stay() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("c.toml");
        let base = presets::file("mt9v024.toml").unwrap();
        for table in ["mt9v024-qe.csv", "ir-cut-690.csv"] {
            std::fs::write(directory.path().join(table), presets::file(table).unwrap()).unwrap();
        }
        let text = format!("{base}\n[[effect]]\nkind = \"veiling-glare\"\nfraction = 0.02\n");
        std::fs::write(&path, &text).unwrap();
        let spec = path.to_str().unwrap();
        let camera = Camera::load(spec).unwrap();
        let alone = standalone(&camera.text, spec).unwrap();
        assert_eq!(alone.tables.len(), 2);
        let improved = camera_file(alone, &camera, &[]).unwrap().text;
        assert!(improved.contains("veiling-glare"), "{improved}");
    }
}
