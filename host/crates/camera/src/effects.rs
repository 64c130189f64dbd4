//! `[[effect]]` tables of a camera file as effects of the sensor or of the optics.

use super::empirical::{self, Word};
use super::optical::OpticalEffect;
use super::parameter::number;
use camrig_base::{Error, Result, toml_text};
use camrig_sensor_core::effects::gain_table::GainTable;
use camrig_sensor_core::effects::{Effect, Parameter};
use serde::Deserialize;

/// The effect that an `[[effect]]` table describes.
#[derive(Clone, Debug, PartialEq)]
pub enum AnyEffect {
    /// A stage of the sensor's signal chain.
    Sensor(Effect),
    /// An effect of the optics, which acts before the irradiance and thus before a rig.
    Optical(OpticalEffect),
}

impl AnyEffect {
    /// The effect of a kind with values in the order of its declaration. `None` for an unknown kind
    /// and for values that are out of range or do not fit together.
    pub fn new(kind: &str, values: &[f32]) -> Option<Self> {
        match Effect::CATALOGUE.iter().find(|e| e.kind == kind) {
            Some(entry) => Effect::new(entry.id, values).map(Self::Sensor),
            None => OpticalEffect::new(kind, values).map(Self::Optical),
        }
    }

    /// Its name in camera files.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Sensor(effect) => effect.entry().kind,
            Self::Optical(effect) => effect.entry().kind,
        }
    }

    /// Its values in the order of the declaration.
    pub fn values(&self) -> Vec<f32> {
        match self {
            Self::Sensor(effect) => effect.values().to_vec(),
            Self::Optical(effect) => effect.values().to_vec(),
        }
    }
}

/// An entry of the complete catalogue, optics and sensor.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct EffectKind {
    /// Name in camera files.
    pub kind: &'static str,
    /// Number on the link of a rig and in random streams; `None` for effects of the optics, which
    /// rigs do not know.
    pub number: Option<u8>,
    /// Where the effect acts: `optics`, or a domain of the sensor.
    pub acts: &'static str,
    /// Meaning, equation and source.
    pub doc: &'static str,
    /// Parameters in order.
    pub parameters: &'static [Parameter],
    /// Keys that hold words or texts.
    pub words: &'static [Word],
}

impl EffectKind {
    /// The test that holds the effect against its closed form over its range: of sensor-core, in f32
    /// and in fixed point; for effects of the optics, which act before both, of camrig-render.
    pub fn test(&self) -> String {
        self.kind.replace('-', "_")
    }

    /// Where its equation comes from: a publication, a standard, or that it is a definition.
    pub fn source(&self) -> &'static str {
        let after = self.doc.split_once("Source: ").map_or("", |(_, after)| after);
        after.split_once("Closed form: ").map_or(after, |(source, _)| source).trim()
    }

    /// What it does to a known signal, in closed form: what its test holds it against.
    pub fn closed_form(&self) -> &'static str {
        self.doc.split_once("Closed form: ").map_or("", |(_, form)| form.trim())
    }

    /// Every kind that a camera file may name, those of the optics first.
    pub fn all() -> impl Iterator<Item = Self> {
        let optical = OpticalEffect::CATALOGUE.iter().map(|e| Self {
            kind: e.kind,
            number: None,
            acts: "optics",
            doc: e.doc,
            parameters: e.parameters,
            words: &[],
        });
        // A gain table is `[sensor.gains]`.
        let listed = Effect::CATALOGUE.iter().filter(|e| e.kind != GainTable::ENTRY.kind);
        let sensor = listed.map(|e| Self {
            kind: e.kind,
            number: Some(e.id),
            acts: e.domain.name(),
            doc: e.doc,
            parameters: e.parameters,
            words: &[],
        });
        // The one with a table has keys of its own in a camera file.
        let in_words = |e: Self| match e.kind {
            empirical::KIND => Self {
                acts: "as its domain",
                parameters: empirical::PARAMETERS,
                words: empirical::WORDS,
                ..e
            },
            _ => e,
        };
        optical.chain(sensor.map(in_words))
    }
}

/// The effects of the `[[effect]]` tables of a TOML text.
///
/// ```
/// let text = "[[effect]]\nkind = 'row-temporal-noise'\nsigma_e = 2.0\n";
/// assert_eq!(camrig_camera::read_effects(text)?.len(), 1);
/// # Ok::<(), camrig_base::Error>(())
/// ```
///
/// # Errors
/// An unknown kind, unknown or missing keys, values out of range; the message names the key. An
/// empirical effect, which only a camera file may have.
pub fn read_effects(text: &str) -> Result<Vec<AnyEffect>> {
    #[derive(Deserialize)]
    struct Tables {
        #[serde(default)]
        effect: Vec<toml::Table>,
    }
    let tables: Tables = toml_text::read(text)?;
    tables.effect.iter().map(read_effect).collect()
}

/// The effect of a table, if it is none with a file of its own.
pub(crate) fn read_effect(table: &toml::Table) -> Result<AnyEffect> {
    let kind = table.get("kind").and_then(toml::Value::as_str).ok_or_else(|| {
        Error::input("key \"kind\" is missing").help("kind = \"row-temporal-noise\", for instance")
    })?;
    let entry = EffectKind::all().find(|e| e.kind == kind).ok_or_else(|| {
        let known: Vec<&str> = EffectKind::all().map(|e| e.kind).collect();
        Error::input(format!("unknown effect {kind:?}"))
            .help(toml_text::did_you_mean(kind, &known))
    })?;
    if entry.kind == empirical::KIND {
        return Err(Error::unsupported("an empirical effect outside a camera file"));
    }
    let keys: Vec<&str> = entry.parameters.iter().map(|p| p.key).collect();
    if let Some(key) = table.keys().find(|k| *k != "kind" && !keys.contains(&k.as_str())) {
        return Err(Error::input(format!("unknown key {key:?} of {kind:?}"))
            .help(toml_text::did_you_mean(key, &keys)));
    }
    let values: Result<Vec<f32>> =
        entry.parameters.iter().map(|p| number(table, kind, p)).collect();
    let values = values?;
    AnyEffect::new(kind, &values)
        .ok_or_else(|| Error::input(format!("values of {kind:?} do not fit together")))
}
