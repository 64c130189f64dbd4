//! The structure of a camera file in TOML, unchecked. [`super::Camera`] has the checked values.

use serde::Deserialize;

/// A camera file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFile {
    pub name: Option<String>,
    pub lens: LensFile,
    pub sensor: SensorFile,
    #[serde(default, rename = "effect")]
    pub effects: Vec<toml::Spanned<toml::Table>>,
}

/// A number, or the name of a CSV file.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum NumberOrFile {
    Number(f64),
    File(String),
}

/// `[lens]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LensFile {
    pub kind: String,
    pub f_number: Option<f64>,
    pub focal_length_mm: Option<f64>,
    pub magnification: Option<f64>,
    pub transmittance: Option<NumberOrFile>,
    pub relative_illumination: Option<String>,
    pub data: Option<String>,
    pub file: Option<String>,
    pub object_distance_mm: Option<f64>,
    pub focus_distance_mm: Option<f64>,
    pub focus_mtf_per_mm: Option<f64>,
    pub sensor_shift_mm: Option<f64>,
    pub stop_radius_mm: Option<f64>,
    pub reference_nm: Option<f64>,
    pub configuration: Option<NumberOrName>,
    pub glass: Option<OneOrSeveral>,
    pub glass_catalogue: Option<OneOrSeveral>,
}

/// A number from 1, or a name.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum NumberOrName {
    Number(u32),
    Name(String),
}

impl std::fmt::Display for NumberOrName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(n) => n.fmt(f),
            Self::Name(name) => name.fmt(f),
        }
    }
}

/// One text or a list of them.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum OneOrSeveral {
    One(String),
    Several(Vec<String>),
}

impl OneOrSeveral {
    pub fn texts(&self) -> &[String] {
        match self {
            Self::One(text) => std::slice::from_ref(text),
            Self::Several(texts) => texts,
        }
    }
}

/// `[sensor]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFile {
    pub width: u32,
    pub height: u32,
    pub pitch_um: f64,
    pub fill_factor: f64,
    pub cfa: String,
    pub qe: NumberOrFile,
    pub qe_peak: Option<f64>,
    pub ir_cut: Option<String>,
    pub crosstalk: Option<String>,
    pub conversion_gain_uv_per_e: Option<f64>,
    pub full_well_e: f64,
    pub bits: u8,
    pub black_level_dn: f64,
    #[serde(default = "one")]
    pub analog_gain: f64,
    #[serde(default = "room")]
    pub temperature_c: f64,
    #[serde(default = "first")]
    pub seed: u64,
    pub timing: Option<TimingFile>,
    pub noise: NoiseFile,
}

/// `[sensor.timing]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimingFile {
    pub line_time_us: Option<f64>,
    pub frame_length_lines: Option<u32>,
    pub shutter: Option<String>,
    pub direction: Option<String>,
}

/// `[sensor.noise]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoiseFile {
    pub read_e: f64,
    #[serde(default)]
    pub read_e_post: f64,
    pub dark_current_e_per_s: f64,
    #[serde(default = "seven")]
    pub dark_doubling_c: f64,
    #[serde(default = "room")]
    pub temperature_ref_c: f64,
    #[serde(default)]
    pub dsnu_e_per_s: f64,
    pub prnu: f64,
    pub row_fpn_e: Option<f64>,
}

fn one() -> f64 {
    1.0
}

fn room() -> f64 {
    25.0
}

fn seven() -> f64 {
    7.0
}

fn first() -> u64 {
    1
}
