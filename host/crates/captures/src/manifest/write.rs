//! Writing a manifest.

use super::{File, Sensor, paths};
use crate::{Capture, SensorFacts};
use camrig_base::{Error, Result};
use toml::Spanned;

/// Writes the text of a manifest, capture by capture.
pub struct ManifestWriter(File);

impl ManifestWriter {
    /// A manifest for frames of this format, simulated from the camera `name`; `camera` is a preset
    /// or a path relative to the set.
    pub fn new(facts: SensorFacts, camera: Option<&str>, name: &str) -> Self {
        let source = format!("camera {name:?}, simulated by camrig");
        Self(File {
            format: "captures/1".into(),
            camera: camera.map(str::to_string),
            source: [("sensor".to_string(), source.into())].into_iter().collect(),
            sensor: Sensor {
                width: facts.width,
                height: facts.height,
                bits: facts.bits,
                cfa: facts.cfa.map(|cfa| cfa.to_string()),
                black_level_dn: facts.black_level_dn,
                white_level_dn: Some(facts.white_level_dn),
                pitch_um: facts.pitch_um,
            },
            capture: Vec::new(),
        })
    }

    /// Adds a capture, whose files are relative to the set. Relative paths of its scene and light
    /// are resolved against the current directory.
    pub fn push(&mut self, capture: &Capture) {
        let mut capture = capture.clone();
        let folder = std::env::current_dir().unwrap_or_default();
        paths::resolve(&folder, &mut capture.light, &mut capture.scene);
        self.0.capture.push(Spanned::new(0..0, capture));
    }

    /// The text.
    ///
    /// # Errors
    /// Values that TOML cannot represent.
    pub fn text(self) -> Result<String> {
        // A table sorts its keys.
        let text = toml::Table::try_from(&self.0).and_then(|table| toml::to_string(&table));
        text.map_err(|e| Error::input(format!("captures.toml: {e}")))
    }
}
