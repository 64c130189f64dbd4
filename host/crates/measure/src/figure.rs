//! Figures as JSON: `{"value", "std_error", "unit"}`, the one form of every command, file and page.
//!
//! A figure's name carries its unit, so that the name alone tells it.

use camrig_base::{Error, Result};
use serde::Serialize;
use serde_json::{Map, Value};

/// Endings of names and the units they stand for, the longer ones first.
const ENDINGS: [(&str, &str); 24] = [
    ("_cycles_per_pixel", "cycles/pixel"),
    ("_cycles_per_mm", "cycles/mm"),
    ("_dn_per_photon", "DN/photon"),
    ("_system_gain", "DN/e⁻"),
    ("_dn_per_e", "DN/e⁻"),
    ("_e_per_s", "e⁻/s"),
    ("_dn_per_s", "DN/s"),
    ("_percent", "%"),
    ("delta_e_2000_mean", "ΔE2000"),
    ("delta_e_2000_max", "ΔE2000"),
    ("delta_e_2000", "ΔE2000"),
    ("read_e_post", "e⁻"),
    ("_pixels", "pixels"),
    ("_db", "dB"),
    ("_bit", "bit"),
    ("_deg", "°"),
    ("_dn2", "DN²"),
    ("_dn", "DN"),
    ("_nm", "nm"),
    ("_um", "µm"),
    ("_e", "e⁻"),
    ("_p", "photons"),
    ("_c", "°C"),
    ("_s", "s"),
];

/// The unit of a figure of this name; `1` for a ratio or a number.
#[must_use]
pub fn unit(name: &str) -> &'static str {
    ENDINGS.iter().find(|(ending, _)| name.ends_with(ending)).map_or("1", |(_, unit)| unit)
}

/// Figures as a JSON object: every [`Value`](crate::Value) in it gets the unit of its name. A
/// standard error that is not known is null.
///
/// # Errors
/// Values that are no object, which is a fault of the program.
pub fn object(figures: &impl Serialize) -> Result<Map<String, Value>> {
    let fault = |what: String| Error::internal(format!("figures as JSON: {what}"));
    let mut value = serde_json::to_value(figures).map_err(|e| fault(e.to_string()))?;
    add_units("", &mut value);
    match value {
        Value::Object(map) => Ok(map),
        other => Err(fault(format!("not an object: {other}"))),
    }
}

fn add_units(name: &str, value: &mut Value) {
    match value {
        Value::Object(map) if map.len() == 2 && map.contains_key("std_error") => {
            map.insert("unit".into(), unit(name).into());
        }
        Value::Object(map) => map.iter_mut().for_each(|(name, value)| add_units(name, value)),
        Value::Array(values) => values.iter_mut().for_each(|value| add_units(name, value)),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Value as Figure, emva, ptc};
    use serde_json::json;

    #[test]
    fn a_figure_has_value_error_and_the_unit_of_its_name() {
        let figures = ptc::Figures {
            read_noise_e: Some(Figure::new(3.0, 0.5)),
            prnu: Some(Figure::chosen(0.01)),
            ..ptc::Figures::default()
        };
        let object = object(&figures).unwrap();
        assert_eq!(
            object["read_noise_e"],
            json!({ "value": 3.0, "std_error": 0.5, "unit": "e⁻" })
        );
        assert_eq!(object["prnu"], json!({ "value": 0.01, "std_error": null, "unit": "1" }));
        assert!(object["full_well_e"].is_null());
    }

    /// Every figure of the standard whose name ends otherwise than in a unit is a ratio.
    #[test]
    fn names_tell_units() {
        let names = object(&emva::Figures::default()).unwrap();
        let ratios: Vec<&str> = names.keys().map(|n| &n[..]).filter(|n| unit(n) == "1").collect();
        assert_eq!(ratios, ["dynamic_range", "quantum_efficiency", "snr_max"]);
        for (name, expected) in [
            ("overall_system_gain", "DN/e⁻"),
            ("responsivity_dn_per_photon", "DN/photon"),
            ("saturation_capacity_p", "photons"),
            ("dark_current_mean_e_per_s", "e⁻/s"),
            ("prnu_1288_row_percent", "%"),
            ("dark_current_doubling_c", "°C"),
            ("mtf50_cycles_per_pixel", "cycles/pixel"),
            ("hot_pixels", "pixels"),
            ("variance_dn2", "DN²"),
        ] {
            assert_eq!(unit(name), expected, "{name}");
        }
    }
}
