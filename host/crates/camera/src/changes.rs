//! Changes of a camera file's keys: single changes by the user, and the grid of a sweep.

use super::{Camera, Folder};
use camrig_base::{Error, Result, toml_text};

/// Reads one `KEY=VALUE`: the value in TOML's syntax, or a bare word as a string.
///
/// # Errors
/// A message for text without `=`.
pub fn read(text: &str) -> Result<(String, toml::Value), String> {
    let (key, value) = text.split_once('=').ok_or_else(|| {
        format!("{text:?}: write KEY=VALUE, for instance sensor.noise.read_e=2.5")
    })?;
    let (key, value) = (key.trim(), value.trim());
    let parsed = toml::from_str::<toml::Table>(&format!("v = {value}"));
    let parsed = parsed.ok().and_then(|mut table| table.remove("v"));
    Ok((key.to_string(), parsed.unwrap_or_else(|| toml::Value::String(value.to_string()))))
}

/// The camera of a file's text with some of its keys changed.
pub(super) fn parse(
    text: &str,
    changes: &[(String, toml::Value)],
    default_name: &str,
    folder: &Folder<'_>,
) -> Result<Camera> {
    if changes.is_empty() {
        return Camera::parse(text, default_name, folder);
    }
    let mut file: toml::Table = toml::from_str(text).map_err(|e| toml_text::error(text, &e))?;
    let mut words = Vec::new();
    for (key, value) in changes {
        set(&mut file, key, value)?;
        words.push(format!("{key} = {value}"));
    }
    let place = |e: Error| e.at(format!("the camera file with {}", words.join(", ")));
    let text = toml::to_string(&file).map_err(|e| place(Error::input(e.to_string())))?;
    Camera::parse(&text, default_name, folder).map_err(place)
}

fn set(file: &mut toml::Table, key: &str, value: &toml::Value) -> Result<()> {
    let wrong = || {
        Error::input(format!("{key:?} is not a key of a camera file")).help(
            "name it with its table, for instance sensor.noise.read_e, or effect.KIND.KEY; \
             `camrig explain` lists them",
        )
    };
    let mut path: Vec<&str> = key.split('.').collect();
    let last = path.pop().ok_or_else(wrong)?;
    let mut table = file;
    if let ["effect", kind] = path[..] {
        table = effect(table, kind).ok_or_else(wrong)?;
    } else {
        // Tables that a file may lack come with their first key.
        if let (["sensor", "timing"], Some(sensor)) = (&path[..], table.get_mut("sensor")) {
            let sensor = sensor.as_table_mut().ok_or_else(wrong)?;
            sensor.entry("timing").or_insert_with(|| toml::Table::new().into());
        }
        for name in path {
            table = table.get_mut(name).and_then(toml::Value::as_table_mut).ok_or_else(wrong)?;
        }
    }
    table.insert(last.to_string(), value.clone());
    Ok(())
}

/// The first effect of a kind, added where there is none.
fn effect<'a>(file: &'a mut toml::Table, kind: &str) -> Option<&'a mut toml::Table> {
    let effects = file.entry("effect").or_insert_with(|| toml::Value::Array(Vec::new()));
    let effects = effects.as_array_mut()?;
    let is_it = |e: &toml::Value| e.get("kind").and_then(toml::Value::as_str) == Some(kind);
    let index = effects.iter().position(is_it).unwrap_or_else(|| {
        let kind = toml::Value::String(kind.to_string());
        effects.push(toml::Value::Table([("kind".to_string(), kind)].into_iter().collect()));
        effects.len() - 1
    });
    effects[index].as_table_mut()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(changes: &[&str]) -> Result<Camera> {
        let changes: Vec<_> = changes.iter().map(|c| read(c).unwrap()).collect();
        Camera::load_with("mt9t012", &changes)
    }

    #[test]
    fn keys_are_set_and_effects_added() {
        let camera = with(&[
            "sensor.noise.read_e=7.5",
            "name=mine",
            "effect.row-temporal-noise.sigma_e=0.8",
            "sensor.timing.line_time_us=20",
            "sensor.timing.shutter=global",
            "sensor.width=64",
        ])
        .unwrap();
        assert_eq!((camera.sensor.noise.read_e, camera.sensor.width), (7.5, 64));
        assert_eq!((camera.name.as_str(), camera.effects.len()), ("mine", 1));
        assert_eq!(camera.effects[0].values()[..], [0.8]);
        assert!(camera.text.contains("read_e = 7.5"));
        let timing = camera.sensor.timing.unwrap();
        assert_eq!((timing.line_time_us, timing.shutter), (20.0, crate::Shutter::Global));
        assert_eq!(timing.frame_length_lines, camera.sensor.height);
    }

    #[test]
    fn wrong_keys_and_values_are_named() {
        let said = |change: &str| with(&[change]).unwrap_err().to_string();
        assert!(
            said("sensor.noise.raed_e=1").contains("read_e"),
            "{}",
            said("sensor.noise.raed_e=1")
        );
        assert!(said("snesor.width=1").contains("snesor.width"));
        assert!(said("sensor.timing.shutter=global").contains("line_time_us"));
        assert!(said("sensor.noise.prnu=5").contains("prnu = 5"));
        assert!(said("effect.row-temporal-nose.sigma_e=1").contains("row-temporal-noise"));
        assert!(read("no equals sign").is_err());
    }
}
