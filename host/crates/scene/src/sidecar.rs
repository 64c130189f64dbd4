//! What the user adds to a cube's file: a sidecar beside it (`cube.toml` for `cube.npy`), or the
//! same keys as options of its name (`cube.npy:quantity=radiance,scale=0.01`), which take
//! precedence. A key is optional where the file itself has its value:
//! ```toml
//! quantity = "reflectance"     # or "radiance", W m⁻² sr⁻¹ nm⁻¹
//! wavelength_nm = [400, 410]   # band centres, or start_nm and step_nm
//! start_nm = 400
//! step_nm = 10
//! axes = "yxb"                 # NumPy: order of rows, columns, bands; slowest first
//! scale = 1.0                  # multiplies the samples
//! array = "cube"               # NumPy: name within an .npz
//! ```

use super::Quantity;
use camrig_base::{Error, Result};
use serde::Deserialize;
use std::path::Path;

/// The content of a sidecar.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Sidecar {
    quantity: Option<QuantityName>,
    wavelength_nm: Option<Vec<f64>>,
    start_nm: Option<f64>,
    step_nm: Option<f64>,
    pub axes: Option<String>,
    pub scale: Option<f32>,
    pub array: Option<String>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum QuantityName {
    Reflectance,
    Radiance,
}

impl Sidecar {
    /// The sidecar of `path`, if there is one, with `options` (`KEY=VALUE,...`) taking precedence.
    pub fn read(path: &Path, options: &str) -> Result<Self> {
        let place = path.with_extension("toml");
        let mut text = match std::fs::read_to_string(&place) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(e) => return Err(Error::io("read", &place, e)),
        };
        let mut table: toml::Table = text
            .parse()
            .map_err(|e: toml::de::Error| Error::input(e.to_string()).at(place.display()))?;
        for option in options.split(',').filter(|o| !o.trim().is_empty()) {
            let Some((key, value)) = option.split_once('=') else {
                return Err(Error::input(format!("option {option:?} has no value"))
                    .help("write options as KEY=VALUE, for instance quantity=radiance"));
            };
            let value = match value.trim().parse::<f64>() {
                Ok(number) => toml::Value::Float(number),
                Err(_) => toml::Value::String(value.trim().to_string()),
            };
            table.insert(key.trim().to_string(), value);
        }
        text = table.to_string();
        toml::from_str(&text).map_err(|e| {
            Error::input(e.message().to_string()).at(place.display()).help(
                "the keys are quantity, wavelength_nm, start_nm, step_nm, axes, scale and array",
            )
        })
    }

    /// The wavelengths of the bands, nm: the sidecar's, else the file's own, else for 31 bands 400
    /// to 700 nm.
    pub fn wavelengths(&self, bands: usize, own: Option<Vec<f64>>) -> Result<Vec<f64>> {
        let regular = |start: f64, step: f64| {
            (0..bands).map(|b| start + step * b as f64).collect::<Vec<f64>>()
        };
        match (&self.wavelength_nm, self.start_nm, self.step_nm, own) {
            (Some(list), None, None, _) => Ok(list.clone()),
            (None, Some(start), Some(step), _) => Ok(regular(start, step)),
            (None, None, None, Some(own)) => Ok(own),
            (None, None, None, None) if bands == 31 => Ok(regular(400.0, 10.0)),
            _ => Err(Error::input(format!("the wavelengths of the {bands} bands are not known"))
                .help("give wavelength_nm, or start_nm and step_nm, in the sidecar .toml")),
        }
    }

    /// The quantity: the sidecar's, else the file's own, else reflectance.
    pub fn quantity(&self, own: Option<Quantity>) -> Quantity {
        match self.quantity {
            Some(QuantityName::Radiance) => Quantity::Radiance,
            Some(QuantityName::Reflectance) => Quantity::Reflectance,
            None => own.unwrap_or(Quantity::Reflectance),
        }
    }
}
