//! The shape of `[sensor.hdr]` in a camera file.

use crate::named_files::FractionOrFile;
use crate::order::in_order;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const SIGNAL_E: f64 = camrig_sensor_core::arith::MAX_SIGNAL_E as f64;

// `[sensor.hdr]`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_order::<Self>)]
pub struct HdrFile {
    /// What the sensor sends: codes of the merged signal on a curve, the merged signal as it is,
    /// or its captures one by one.
    pub output: HdrOutput,
    /// Time from one row to the next.
    #[schemars(range(min = 0.1, max = 10_000.0), extend("unit" = "µs", "usual" = "5 to 40"))]
    pub row_time_us: f64,
    /// The photodiodes of a pixel, one to four: those of a split pixel, or of a cell of a quad
    /// pattern, which is a pixel of the merged frame.
    pub photodiode: Vec<PhotodiodeFile>,
    /// The readings of a pixel, two to four, the most sensitive first.
    pub capture: Vec<CaptureFile>,
    pub merge: MergeFile,
    pub companding: Option<CompandingFile>,
}

/// What an HDR sensor sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(inline)]
#[non_exhaustive]
pub enum HdrOutput {
    /// Codes of the merged signal on a curve.
    Companded,
    /// The merged signal.
    Linear,
    /// The captures one by one.
    Captures,
}

// `[[sensor.hdr.photodiode]]`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_order::<Self>)]
pub struct PhotodiodeFile {
    /// Its name.
    pub name: String,
    /// Its response over that of qe: a number, or a CSV of wavelength_nm,ratio.
    pub response_ratio: FractionOrFile,
    /// Charge that it holds.
    #[schemars(range(min = 1.0, max = SIGNAL_E), extend("unit" = "e-"))]
    pub full_well_e: f64,
    /// Charge beyond it that a capacitor takes, for captures with overflow.
    #[schemars(range(min = 0.0, max = SIGNAL_E), extend("unit" = "e-"))]
    pub overflow_e: f64,
    /// Mean dark current at temperature_ref_c.
    #[schemars(range(min = 0.0, max = 1e6), extend("unit" = "e-/s"))]
    pub dark_current_e_per_s: f64,
    /// Standard deviation over pixels of the dark current.
    #[schemars(range(min = 0.0, max = 1e6), extend("unit" = "e-/s"))]
    pub dsnu_e_per_s: f64,
    /// Standard deviation over pixels of the gain, mean 1.
    #[schemars(range(min = 0.0, max = 0.14))]
    pub prnu: f64,
    /// Share of the light of each other photodiode that it collects too.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub optical_leak: f64,
    /// Share of the others' charge beyond their wells that it collects; 0 so far.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub overflow_leak: f64,
}

// `[[sensor.hdr.capture]]`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_order::<Self>)]
pub struct CaptureFile {
    /// Its name.
    pub name: String,
    /// The photodiode that it reads.
    pub photodiode: String,
    /// The integration that it reads: captures of one window read the same charge.
    #[schemars(range(min = 0, max = 3))]
    pub window: u8,
    /// When the window begins, after the beginning of the frame.
    #[schemars(range(min = 0.0, max = 1e8), extend("unit" = "µs"))]
    pub start_us: f64,
    /// Its exposure over that of the frame.
    #[schemars(range(min = 1e-6, max = 1e3))]
    pub exposure_ratio: f64,
    /// Its analog gain over that of the frame.
    #[schemars(range(min = 1e-3, max = 1e3))]
    pub gain_ratio: f64,
    /// Charge at which the converter's range ends at unity gain.
    #[schemars(range(min = 1.0, max = SIGNAL_E), extend("unit" = "e-"))]
    pub full_scale_e: f64,
    /// Bits of the converter.
    #[schemars(range(min = 8, max = 16), extend("unit" = "bits"))]
    pub bits: u8,
    /// DN of no signal.
    #[schemars(range(min = 0, max = 65_534), extend("unit" = "DN"))]
    pub black_level_dn: u16,
    /// Read noise at unity gain, input-referred, standard deviation.
    #[schemars(range(min = 0.0, max = 1e5), extend("unit" = "e-"))]
    pub read_e: f64,
    /// The part of it that comes after the gain stage.
    #[schemars(range(min = 0.0, max = 1e5), extend("unit" = "e-"))]
    pub read_e_post: f64,
    /// Row-wise fixed pattern, standard deviation over rows.
    #[schemars(range(min = 0.0, max = 1e5), extend("unit" = "e-"))]
    pub row_fpn_e: f64,
    /// Whether it sees the capacitor of its photodiode too.
    pub overflow: bool,
    /// Virtual channel on which it is sent alone.
    #[schemars(range(min = 0, max = 3))]
    pub virtual_channel: u8,
}

// `[sensor.hdr.merge]`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_order::<Self>)]
pub struct MergeFile {
    /// Bits of the merged signal: 16, 20 or 24.
    #[schemars(range(min = 16, max = 24), extend("unit" = "bits"))]
    pub linear_bits: u8,
    /// DN of no signal in the merged signal.
    #[schemars(range(min = 0, max = 16_777_215), extend("unit" = "linear DN"))]
    pub pedestal_dn: u32,
    /// Linear DN per DN of each capture, in the captures' order, multiples of 1/256.
    pub gains: Vec<f64>,
    /// A capture that is taken where it exceeds the others by flicker_margin_dn, or "none".
    pub flicker_capture: String,
    /// By how much it has to exceed them.
    #[schemars(range(min = 0, max = 16_777_215), extend("unit" = "linear DN"))]
    pub flicker_margin_dn: u32,
    /// The hand-overs from capture to capture.
    pub step: Vec<StepFile>,
}

// `[[sensor.hdr.merge.step]]`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_order::<Self>)]
pub struct StepFile {
    /// The capture that takes over: the next one.
    pub to: String,
    /// The capture whose code decides, one before it.
    pub decide: String,
    /// Code up to which the new capture has no weight.
    #[schemars(range(min = 0, max = 65_535), extend("unit" = "DN"))]
    pub low_dn: u16,
    /// Code from which it has all.
    #[schemars(range(min = 0, max = 65_535), extend("unit" = "DN"))]
    pub high_dn: u16,
}

// `[sensor.hdr.companding]`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_order::<Self>)]
pub struct CompandingFile {
    /// Bits of a code: 10, 12, 14 or 16.
    #[schemars(range(min = 10, max = 16), extend("unit" = "bits"))]
    pub bits: u8,
    /// Taken off the linear signal before the curve.
    #[schemars(range(min = 0, max = 16_777_215), extend("unit" = "linear DN"))]
    pub subtract_dn: u32,
    /// Added to the code of the curve.
    #[schemars(range(min = 0, max = 65_535), extend("unit" = "DN"))]
    pub pedestal_dn: u16,
    /// Whether codes are rounded down or to the nearest.
    pub rounding: RoundingFile,
    /// Points of the curve after (0, 0), up to 64: linear number and code, a multiple of 1/256.
    pub knees: Vec<(u32, f64)>,
}

#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(inline)]
pub enum RoundingFile {
    Floor,
    Nearest,
}
