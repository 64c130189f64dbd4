//! Changes of a camera file's keys, before it is read.

use super::{Camera, Change, Folder, Value};
use camrig_base::{Error, Result, toml_text};

/// The camera of a file's text with some of its keys changed.
pub(super) fn parse(
    text: &str,
    changes: &[Change],
    default_name: &str,
    folder: &Folder<'_>,
) -> Result<Camera> {
    if changes.is_empty() {
        return Camera::parse(text, default_name, folder);
    }
    let words = changes.iter().map(|change| format!("{} = {}", change.key, change.value));
    let words = words.collect::<Vec<_>>().join(", ");
    let text = text_with(text, changes)?;
    let place = |e: Error| e.at(format!("the camera file with {words}"));
    Camera::parse(&text, default_name, folder).map_err(place)
}

/// The text of a camera file with some of its keys changed.
pub(super) fn text_with(text: &str, changes: &[Change]) -> Result<String> {
    let mut file: toml::Table = toml_text::read(text)?;
    for change in changes {
        set(&mut file, &change.key, &change.value)?;
    }
    toml::to_string(&file).map_err(|e| Error::input(e.to_string()))
}

fn set(file: &mut toml::Table, key: &str, value: &Value) -> Result<()> {
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
    table.insert(last.to_string(), value.0.clone());
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
        let changes = changes.iter().map(|c| c.parse::<Change>().unwrap());
        Camera::load_with("mt9t012", changes)
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
        assert_eq!(camera.effects[0].values()[..2], [0.8, 0.0]);
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
        assert!("no equals sign".parse::<Change>().is_err());
    }

    #[test]
    fn a_camera_of_another_size_is_the_one_that_its_file_describes() {
        let timing = Change::new("sensor.timing.line_time_us", 20);
        let size = [Change::new("sensor.width", 64), Change::new("sensor.height", 48)];
        let changes = [&size[..], std::slice::from_ref(&timing)].concat();
        let loaded = Camera::load_with("mt9t012", &changes).unwrap();
        let sized = Camera::load_with("mt9t012", [timing]).unwrap().with_size(64, 48).unwrap();
        assert_eq!(format!("{loaded:?}"), format!("{sized:?}"));
        let error = sized.with_size(0, 48).unwrap_err().to_string();
        assert!(error.contains("sensor.width = 0"), "{error}");
    }
}
