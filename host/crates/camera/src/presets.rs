//! Built-in cameras: `mt9t012`, the module of Chen et al. 2009, `mt9v024`, a machine-vision
//! camera, and `mobile`, a phone camera.

/// Names of the built-in cameras.
pub const NAMES: [&str; 3] = ["mt9t012", "mt9v024", "mobile"];

const FILES: [(&str, &str); 7] = [
    ("mt9t012.toml", include_str!("../presets/mt9t012.toml")),
    ("mt9v024.toml", include_str!("../presets/mt9v024.toml")),
    ("mobile.toml", include_str!("../presets/mobile.toml")),
    ("mt9m131-qe.csv", include_str!("../presets/mt9m131-qe.csv")),
    ("mt9v024-qe.csv", include_str!("../presets/mt9v024-qe.csv")),
    ("mobile-qe.csv", include_str!("../presets/mobile-qe.csv")),
    ("ir-cut-690.csv", include_str!("../presets/ir-cut-690.csv")),
];

/// The text of a built-in file, `None` for a name that is not built in.
pub fn file(name: &str) -> Option<&'static str> {
    FILES.iter().find(|(n, _)| *n == name).map(|(_, text)| *text)
}

#[cfg(test)]
mod tests {
    use crate::Camera;
    use camrig_base::Bands;

    #[test]
    fn every_preset_loads_and_makes_a_sensor() {
        for name in super::NAMES {
            let camera = Camera::load(name).unwrap();
            assert_eq!(camera.name, name);
            camera.sensor_config(&Bands::VISIBLE).unwrap();
        }
    }
}
