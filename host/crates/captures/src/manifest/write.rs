//! Writing a manifest.

use super::paths;
use crate::{Capture, CapturedScene, Light, Role, Rotation, SensorFacts};
use camrig_base::{Error, Result};
use serde::Serialize;

/// Writes the text of a manifest, capture by capture.
pub struct ManifestWriter {
    head: toml::Table,
    captures: Vec<toml::Value>,
}

#[derive(Serialize)]
struct WrittenCapture<'a> {
    id: &'a str,
    role: Role,
    files: String,
    exposure_s: f64,
    analog_gain: f64,
    temperature_c: Option<f64>,
    light: Option<&'a Light>,
    scene: Option<&'a CapturedScene>,
    rotation: Option<&'a Rotation>,
}

impl ManifestWriter {
    /// A manifest for frames of this format, simulated from the camera `name`; `camera` is a preset
    /// or a path relative to the set.
    pub fn new(facts: SensorFacts, camera: Option<&str>, name: &str) -> Self {
        let mut sensor = toml::Table::new();
        sensor.insert("width".into(), (facts.width as i64).into());
        sensor.insert("height".into(), (facts.height as i64).into());
        sensor.insert("bits".into(), i64::from(facts.bits).into());
        sensor.insert("white_level_dn".into(), i64::from(facts.white_level_dn).into());
        if let Some(cfa) = facts.cfa {
            sensor.insert("cfa".into(), cfa.to_string().into());
        }
        if let Some(black) = facts.black_level_dn {
            sensor.insert("black_level_dn".into(), black.into());
        }
        if let Some(pitch) = facts.pitch_um {
            sensor.insert("pitch_um".into(), pitch.into());
        }
        let mut source = toml::Table::new();
        source.insert("sensor".into(), format!("camera {name:?}, simulated by camrig").into());
        let mut head = toml::Table::new();
        head.insert("format".into(), "captures/1".into());
        if let Some(camera) = camera {
            head.insert("camera".into(), camera.into());
        }
        head.insert("source".into(), source.into());
        head.insert("sensor".into(), sensor.into());
        Self { head, captures: Vec::new() }
    }

    /// Adds a capture; its only file is the pattern of its frames. Relative paths of its scene and
    /// light are resolved against the current directory.
    pub fn push(&mut self, c: &Capture) {
        let (mut light, mut scene) = (c.light.clone(), c.scene.clone());
        paths::resolve(&std::env::current_dir().unwrap_or_default(), &mut light, &mut scene);
        let written = WrittenCapture {
            id: &c.id,
            role: c.role,
            files: c.files.first().map_or(String::new(), |f| f.to_string_lossy().into()),
            exposure_s: c.exposure_s,
            analog_gain: c.analog_gain,
            temperature_c: c.temperature_c,
            light: light.as_ref(),
            scene: scene.as_ref(),
            rotation: c.rotation.as_ref(),
        };
        self.captures.extend(toml::Value::try_from(written));
    }

    /// The text.
    ///
    /// # Errors
    /// Values that TOML cannot represent.
    pub fn text(mut self) -> Result<String> {
        self.head.insert("capture".into(), self.captures.into());
        toml::to_string(&self.head).map_err(|e| Error::input(format!("captures.toml: {e}")))
    }
}
