//! What a file of another program says of a camera.

use camrig_base::{Error, Result};
use camrig_camera::draft::{Basis, Known};
use camrig_camera::{Change, Value};
use serde_json::Value as Json;

/// What a file says of a camera.
#[derive(Default)]
pub struct Imported {
    /// Values for its file.
    pub known: Vec<Known>,
    /// Tables that values name: name and text.
    pub tables: Vec<(String, String)>,
    /// What it does not say, or what a camera file cannot have.
    pub notes: Vec<String>,
}

impl Imported {
    pub(super) fn add(&mut self, key: &str, value: impl Into<Value>, from: &str) {
        let change = Change::new(key, value);
        self.known.push(Known { change, basis: Basis::given(from) });
    }
}

/// What is known beside the file, for forms that leave it open.
#[derive(Clone, Debug, Default)]
pub struct Beside {
    /// Name of the camera, for the names of tables.
    pub name: String,
    /// Bits of the converter.
    pub bits: Option<u8>,
    /// Columns and rows.
    pub size: Option<[f64; 2]>,
    /// PRNU.
    pub prnu: Option<f64>,
    /// Black level, DN.
    pub black_level_dn: Option<f64>,
    /// Full well, e⁻.
    pub full_well_e: Option<f64>,
    /// Which model, of a file of many.
    pub model: Option<String>,
}

impl Beside {
    /// The bits, which `what` needs.
    pub(super) fn bits(&self, what: &str) -> Result<f64> {
        let missing = || Error::input(what).help("give the bits of the converter");
        self.bits.map(f64::from).ok_or_else(missing)
    }
}

/// A number, or the only one of a list.
pub(super) fn number(json: &Json) -> Option<f64> {
    json.as_f64().or_else(|| match &json.as_array()?[..] {
        [one] => number(one),
        _ => None,
    })
}

/// A list of numbers.
pub(super) fn numbers(json: &Json) -> Option<Vec<f64>> {
    json.as_array()?.iter().map(Json::as_f64).collect()
}
