//! Built-in cameras.
//!
//! Nine are files of their own: `mt9t012`, the module of Chen et al. 2009, `mt9v024`, a
//! machine-vision camera, `mobile`, a phone camera, and six sensors that take several captures
//! of each pixel ([`HDR_NAMES`]). The others are sensors of
//! [`crate::facts`], each behind a usual lens; what is not known of them follows the rules of
//! [`crate::typical`].

use super::builtin;
pub use super::builtin::{HDR_NAMES, NAMES};
use super::draft::{self, Draft};
use super::facts::Sensor;
use camrig_base::Error;
use std::sync::LazyLock;

/// Files of the cameras that are made of facts, by name and text.
static FILES: LazyLock<Vec<(String, String)>> = LazyLock::new(|| {
    // A test drafts them all.
    let text = |sensor: Sensor| Draft::of_preset(sensor.name()).map(|draft| draft.text());
    let file = |sensor: Sensor| Some((format!("{}.toml", sensor.name()), text(sensor).ok()?));
    Sensor::all().filter_map(file).collect()
});

/// Names of all built-in cameras.
#[must_use]
pub fn names() -> Vec<&'static str> {
    draft::names()
}

/// The text of a built-in file, `None` for a name that is not built in.
#[must_use]
pub fn file(name: &str) -> Option<&'static str> {
    let made = || FILES.iter().find(|(n, _)| n == name).map(|(_, text)| text.as_str());
    builtin::file(name).or_else(made)
}

/// No built-in camera has this name; `what` is what it was taken for.
#[must_use]
pub fn unknown(what: &str, name: &str) -> Error {
    draft::unknown(what, name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Camera;
    use camrig_base::Bands;

    #[test]
    fn every_preset_loads_without_remarks_and_makes_a_sensor() {
        for name in names() {
            let camera = Camera::load(name).unwrap();
            assert_eq!(camera.name, name);
            let config = camera.sensor_config(&Bands::VISIBLE).unwrap();
            assert!(config.response.iter().any(|&r| r > 0.0), "{name}");
            let notes = camera.notes(&Bands::VISIBLE);
            // The curve of a real sensor may be finer than its captures.
            let of_curve = |note: &String| note.contains("the curve has more codes");
            assert!(
                notes.iter().all(|n| builtin::HDR_NAMES.contains(&name) && of_curve(n)),
                "{name}: {notes:?}"
            );
        }
        assert!(names().len() >= 25 + NAMES.len());
    }
}
