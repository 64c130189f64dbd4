//! Metadata beside a frame: `NAME.json` for `NAME.raw`, as libcamera's programs write it
//! (`rpicam-still --metadata`), by the names of libcamera's controls.

use camrig_formats::Said;
use std::path::Path;

/// Largest file that can be metadata, bytes.
const LARGEST: u64 = 1 << 20;
/// Bits that SensorBlackLevels are given in, whatever the sensor's.
const BLACK_BITS: i32 = 16;

/// What libcamera says of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Beside {
    /// ExposureTime, µs in the file, here s.
    pub exposure_s: Option<Said<f64>>,
    /// AnalogueGain.
    pub analog_gain: Option<Said<f64>>,
    /// SensorTemperature, °C.
    pub temperature_c: Option<Said<f64>>,
    /// Mean of SensorBlackLevels as a share of 2^bits.
    pub black_share: Option<Said<f64>>,
}

impl Beside {
    /// The metadata beside a frame's file; nothing where there are none.
    pub fn of(frame: &Path) -> Self {
        let path = frame.with_extension("json");
        let small = std::fs::metadata(&path).is_ok_and(|m| m.len() <= LARGEST);
        let text = small.then(|| std::fs::read_to_string(&path).ok()).flatten();
        let json = text.and_then(|text| serde_json::from_str::<serde_json::Value>(&text).ok());
        // Programs that take several frames write a list; it is of one frame here.
        let of_one = match &json {
            Some(serde_json::Value::Array(list)) => match &list[..] {
                [one] => Some(one),
                _ => None,
            },
            one => one.as_ref(),
        };
        let Some(json) = of_one else { return Self::default() };
        let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into());
        let said = |key: &str, value: f64| Said::new(value, format!("{key} in {name}"));
        let number = |key: &str| Some(said(key, json.get(key)?.as_f64()?));
        let levels = json.get("SensorBlackLevels").and_then(|list| list.as_array());
        let levels: Vec<f64> =
            levels.into_iter().flatten().filter_map(serde_json::Value::as_f64).collect();
        let mean = levels.iter().sum::<f64>() / levels.len() as f64;
        Self {
            exposure_s: number("ExposureTime").map(|us| Said { value: us.value * 1e-6, ..us }),
            analog_gain: number("AnalogueGain"),
            temperature_c: number("SensorTemperature"),
            black_share: (!levels.is_empty())
                .then(|| said("SensorBlackLevels", mean / 2f64.powi(BLACK_BITS))),
        }
    }
}
