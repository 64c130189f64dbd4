//! The sidecar file of a frame: `NAME.json` for `NAME.raw`, as written by libcamera's programs
//! (`rpicam-still --metadata`), with the names of libcamera's controls.

use camrig_formats::Said;
use std::path::Path;

/// Largest sidecar file, bytes.
const MAX_BYTES: u64 = 1 << 20;
/// Bits of SensorBlackLevels, independent of the sensor's.
const BLACK_BITS: i32 = 16;

/// libcamera's metadata of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sidecar {
    /// ExposureTime, µs in the file, here s.
    pub exposure_s: Option<Said<f64>>,
    /// AnalogueGain.
    pub analog_gain: Option<Said<f64>>,
    /// SensorTemperature, °C.
    pub temperature_c: Option<Said<f64>>,
    /// Mean of SensorBlackLevels as a share of 2^bits.
    pub black_share: Option<Said<f64>>,
}

impl Sidecar {
    /// Reads the sidecar of a frame's file; empty where there is none.
    pub fn read(frame: &Path) -> Self {
        let path = frame.with_extension("json");
        let small = std::fs::metadata(&path).is_ok_and(|m| m.len() <= MAX_BYTES);
        let text = small.then(|| std::fs::read_to_string(&path).ok()).flatten();
        let json = text.and_then(|text| serde_json::from_str::<serde_json::Value>(&text).ok());
        // Some programs write a list, here of one frame.
        let object = match &json {
            Some(serde_json::Value::Array(list)) => match &list[..] {
                [one] => Some(one),
                _ => None,
            },
            one => one.as_ref(),
        };
        let Some(json) = object else { return Self::default() };
        let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into());
        let value = |key: &str, value: f64| Said::new(value, format!("{key} in {name}"));
        let number = |key: &str| Some(value(key, json.get(key)?.as_f64()?));
        let levels = json.get("SensorBlackLevels").and_then(|list| list.as_array());
        let levels: Vec<f64> =
            levels.into_iter().flatten().filter_map(serde_json::Value::as_f64).collect();
        let mean = levels.iter().sum::<f64>() / levels.len() as f64;
        Self {
            exposure_s: number("ExposureTime").map(|us| Said { value: us.value * 1e-6, ..us }),
            analog_gain: number("AnalogueGain"),
            temperature_c: number("SensorTemperature"),
            black_share: (!levels.is_empty())
                .then(|| value("SensorBlackLevels", mean / f64::from(1 << BLACK_BITS))),
        }
    }
}
