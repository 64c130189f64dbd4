//! The shape of a camera file, and all that is known of its keys: type, range, unit, usual values,
//! default and meaning. A key is declared here and nowhere else; reader, checks, JSON schema,
//! reference and `camrig explain` follow from it.
//!
//! Ranges are `schemars`'s; `extend` adds what JSON Schema has no word for:
//! - `unit`, and `usual`, the values of real cameras;
//! - `without`: what happens where the key is left out, if its type does not say so;
//! - `of_kind`: the `lens.kind` that the key belongs to, and `needed` where that kind needs it.
//!
//! [`super::Camera`] has the checked values.

use super::Shutter;
use super::hdr::file::HdrFile;
use super::named_files::{FileName, FractionOrFile};
use super::order::in_order;
use camrig_base::alternatives::Alternatives;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const SIDE: u32 = camrig_sensor_core::config::MAX_SIDE;
const SIGNAL_E: f64 = camrig_sensor_core::arith::MAX_SIGNAL_E as f64;

// A camera file.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "camrig camera file", transform = in_order::<Self>)]
pub struct CameraFile {
    /// Name of the camera in raw files and reports.
    #[schemars(extend("without" = "the file's name"))]
    pub name: Option<String>,
    pub lens: LensFile,
    pub sensor: SensorFile,
    /// Effects beyond the base model, in the order of the signal chain.
    #[serde(default, rename = "effect")]
    #[schemars(with = "Vec<Effect>")]
    pub effects: Vec<toml::Spanned<toml::Table>>,
}

/// An effect, which the catalogue of effects describes.
type Effect = std::collections::BTreeMap<String, serde_json::Value>;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(inline)]
pub enum LensKind {
    DiffractionLimited,
    Characterised,
    Prescription,
}

#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
#[non_exhaustive]
pub enum FallOff {
    Law(Law),
    File(FileName),
}

#[derive(Clone, Copy, Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(inline)]
#[non_exhaustive]
pub enum Law {
    Cos4,
    None,
}

// `[lens]`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_order::<Self>)]
pub struct LensFile {
    /// How the lens is described: key parameters of an aberration-free lens, a measured or
    /// exported grid of figures and PSFs, or a prescription that is ray-traced.
    pub kind: LensKind,
    /// Focal length over entrance pupil diameter; sets exposure and diffraction
    /// (diffraction-limited).
    #[schemars(range(min = 0.5, max = 128.0), extend("usual" = "1.4 to 16"))]
    #[schemars(extend("of_kind" = "diffraction-limited", "needed" = true))]
    pub f_number: Option<f64>,
    /// Focal length (diffraction-limited).
    #[schemars(range(min = 0.1, max = 10_000.0))]
    #[schemars(extend("unit" = "mm", "usual" = "2 to 8 in phones, 4 to 50 in machine vision"))]
    #[schemars(extend("of_kind" = "diffraction-limited", "needed" = true))]
    pub focal_length_mm: Option<f64>,
    /// Image size over object size, |m| of the camera equation; 0 is an object at infinity
    /// (diffraction-limited).
    #[schemars(range(min = -100.0, max = 100.0))]
    #[schemars(extend("usual" = "0 for distant scenes", "without" = "0"))]
    #[schemars(extend("of_kind" = "diffraction-limited"))]
    pub magnification: Option<f64>,
    /// Fraction of light that gets through: a number, or a CSV of wavelength_nm,transmittance.
    #[schemars(extend("usual" = "0.85 to 0.98", "without" = "1"))]
    pub transmittance: Option<FractionOrFile>,
    /// Fall-off towards the corner: the cos⁴ law, none, or a CSV of field,ratio with field 0 at
    /// the axis and 1 at the corner (diffraction-limited).
    #[schemars(extend("without" = "cos4", "of_kind" = "diffraction-limited"))]
    pub relative_illumination: Option<FallOff>,
    /// Directory or file of a characterised lens.
    #[schemars(extend("of_kind" = "characterised", "needed" = true))]
    pub data: Option<FileName>,
    /// Prescription: .zmx, CODE V .seq, or .toml.
    #[schemars(extend("of_kind" = "prescription", "needed" = true))]
    pub file: Option<FileName>,
    /// Distance of the scene in front of the first surface; inf is allowed (prescription).
    #[schemars(range(min = 1e-3), extend("unit" = "mm", "without" = "that of the file"))]
    #[schemars(extend("of_kind" = "prescription"))]
    pub object_distance_mm: Option<f64>,
    /// Focuses at this distance: the sensor moves as the paraxial image does from the file's
    /// object to one there; inf is allowed (prescription).
    #[schemars(range(min = 1e-3), extend("unit" = "mm", "of_kind" = "prescription"))]
    #[schemars(extend("without" = "the sensor is where the file has the image"))]
    pub focus_distance_mm: Option<f64>,
    /// Focuses where the MTF on the axis at this frequency is largest, in the mean over the
    /// file's wavelengths (prescription).
    // Up to the cut-off of f/0.5 in the blue.
    #[schemars(range(min = 1e-2, max = 5000.0), extend("unit" = "cycles/mm"))]
    #[schemars(extend("usual" = "20 to 100", "of_kind" = "prescription"))]
    #[schemars(extend("without" = "the sensor is where the file has the image"))]
    pub focus_mtf_per_mm: Option<f64>,
    /// Moves the sensor away from the lens, from where focus puts it (prescription).
    // More than the longest camera lens.
    #[schemars(range(min = -1e3, max = 1e3))]
    #[schemars(extend("unit" = "mm", "without" = "0", "of_kind" = "prescription"))]
    pub sensor_shift_mm: Option<f64>,
    /// Radius of the stop (prescription).
    #[schemars(range(min = 1e-3, max = 1e4), extend("unit" = "mm", "of_kind" = "prescription"))]
    #[schemars(extend("without" = "from the file's aperture"))]
    pub stop_radius_mm: Option<f64>,
    /// Wavelength of paraxial figures and of the stop's radius (prescription).
    // Far ultraviolet to far infrared.
    #[schemars(range(min = 100.0, max = 20_000.0))]
    #[schemars(extend("unit" = "nm", "without" = "that of the file", "of_kind" = "prescription"))]
    pub reference_nm: Option<f64>,
    /// Configuration of a file with several, by number from 1 or by title (prescription).
    #[schemars(extend("without" = "the active one", "of_kind" = "prescription"))]
    pub configuration: Option<NumberOrName>,
    /// Glasses that no catalogue has, as NAME=n_d:V_d (prescription).
    #[schemars(extend("without" = "none", "of_kind" = "prescription"))]
    pub glass: Option<Alternatives<String>>,
    /// Glass catalogues (.agf), or folders of them, before those beside the file (prescription).
    #[schemars(extend("without" = "those beside the file", "of_kind" = "prescription"))]
    pub glass_catalogue: Option<Alternatives<String>>,
}

/// A number from 1, or a name.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(untagged)]
#[non_exhaustive]
pub enum NumberOrName {
    Number(#[schemars(range(min = 1))] u32),
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

// `[sensor]`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_order::<Self>)]
pub struct SensorFile {
    /// Pixels in a row.
    #[schemars(range(min = 1, max = SIDE), extend("unit" = "pixels", "usual" = "640 to 8000"))]
    pub width: u32,
    /// Rows.
    #[schemars(range(min = 1, max = SIDE), extend("unit" = "pixels", "usual" = "480 to 6000"))]
    pub height: u32,
    /// Distance of neighbouring pixels.
    #[schemars(range(min = 0.1, max = 1000.0))]
    #[schemars(extend("unit" = "µm", "usual" = "0.6 to 2 in phones, 2 to 10 elsewhere"))]
    pub pitch_um: f64,
    /// Effective photosensitive area over pitch².
    #[schemars(range(min = 0.001, max = 1.0))]
    #[schemars(extend("usual" = "0.3 to 0.6 without microlenses, 0.8 to 1 with"))]
    pub fill_factor: f64,
    /// Colour filter pattern: the top-left 2 x 2 pixels row by row, mono, quad-RGGB for cells of
    /// 2 x 2 pixels, or rows of letters, parted by slashes or as a list; up to 25 channels, as of
    /// multispectral mosaics of 5 x 5 pixels.
    #[schemars(extend("usual" = "RGGB, GRBG, GBRG, BGGR, mono"))]
    pub cfa: Alternatives<String>,
    /// Quantum efficiency with the colour filter: a number, or a CSV of wavelength_nm,r,g,b (or
    /// gr,gb apart, one column for mono, a column per letter of the pattern). Straight lines
    /// join its points, at most 100 nm apart; outside them it is zero, or held where the CSV has
    /// a line `# outside: held`. Charts are seen wherever it is above zero; a number without a
    /// table of ir_cut is taken to be that of 400 to 700 nm.
    #[schemars(extend("unit" = "electrons per photon", "usual" = "0.3 to 0.8 at the peak"))]
    pub qe: FractionOrFile,
    /// Largest quantum efficiency: scales the table of qe, which may be relative, so that its
    /// largest value is this.
    #[schemars(range(min = 0.001, max = 1.0))]
    #[schemars(extend("unit" = "electrons per photon", "usual" = "0.4 to 0.95"))]
    #[schemars(extend("without" = "the table's values as they are"))]
    pub qe_peak: Option<f64>,
    /// Infrared cut filter: CSV of wavelength_nm,transmittance; outside its wavelengths as for
    /// qe.
    #[schemars(extend("without" = "none"))]
    pub ir_cut: Option<FileName>,
    /// Effective index of the infrared cut filter, if it is an interference filter: it then moves to
    /// shorter waves with the angle of the light, over the field and the cone of the lens.
    #[schemars(range(min = 1.0, max = 5.0))]
    #[schemars(extend("usual" = "1.5 to 2.3", "without" = "alike at all angles, as of absorbing glass"))]
    pub ir_cut_effective_index: Option<f64>,
    /// Positional crosstalk: CSV of channel,wavelength_nm,x,y,factor with x, y in -1..1 over
    /// the sensor and factors relative to the centre.
    #[schemars(extend("without" = "none"))]
    pub crosstalk: Option<FileName>,
    /// Voltage per electron at the sense node. Cancels in the DN: full well and bits set the
    /// scale.
    #[schemars(range(min = 0.001, max = 10_000.0))]
    #[schemars(extend("unit" = "µV per electron", "usual" = "20 to 200"))]
    #[schemars(extend("without" = "it cancels in the DN"))]
    pub conversion_gain_uv_per_e: Option<f64>,
    /// Linear full well: the charge that a pixel holds.
    #[schemars(range(min = 1.0, max = SIGNAL_E), extend("unit" = "e-"))]
    #[schemars(extend("usual" = "4000 to 10000 at 1 to 2 µm, 10000 to 100000 above 3 µm"))]
    pub full_well_e: f64,
    /// Charge at which the converter's range ends at unity gain: its largest code over the DN per
    /// electron. Below full_well_e the converter saturates first, above it the pixel.
    #[schemars(range(min = 1.0, max = SIGNAL_E))]
    #[schemars(extend("unit" = "e-", "without" = "full_well_e"))]
    pub full_scale_e: Option<f64>,
    /// Bits of the converter.
    #[schemars(range(min = 8, max = 16), extend("unit" = "bits", "usual" = "10 to 14"))]
    pub bits: u8,
    /// Mean DN of no signal; below the top of the converter.
    #[schemars(range(min = 0.0, max = 65_534.0))]
    #[schemars(extend("unit" = "DN", "usual" = "1/64 to 1/16 of the range"))]
    pub black_level_dn: f64,
    /// Gain before the converter. In 32-bit fixed point it is at most that at which an electron is
    /// 64 DN with all gains, those of `system-gain` and `gain-by-site` among them.
    #[serde(default = "one")]
    #[schemars(range(min = 0.01, max = 1000.0), extend("usual" = "1 to 16"))]
    pub analog_gain: f64,
    /// Temperature of the sensor.
    #[serde(default = "room")]
    #[schemars(range(min = -100.0, max = 150.0), extend("unit" = "°C", "usual" = "20 to 60"))]
    pub temperature_c: f64,
    /// Names the physical sensor: fixes every fixed pattern.
    #[serde(default = "first")]
    pub seed: u64,
    pub timing: Option<TimingFile>,
    pub noise: NoiseFile,
    pub gains: Option<GainsFile>,
    pub hdr: Option<HdrFile>,
}

// `[sensor.timing]`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_order::<Self>)]
pub struct TimingFile {
    /// Time from one row to the next. Exposure, skew and frame rate follow from it; the rig's
    /// register 0x3000 holds it in ns.
    #[schemars(range(min = 0.1, max = 10_000.0), extend("unit" = "µs", "usual" = "5 to 40"))]
    #[schemars(extend(
        "without" = "needed where the table is given: without it a frame is one moment"
    ))]
    pub line_time_us: f64,
    /// Lines of a frame, those without pixels included: the frame period over the line time. A
    /// longer exposure makes a longer frame. The rig's register 0x0340.
    #[schemars(range(min = 1, max = 65_535), extend("unit" = "lines"))]
    #[schemars(extend("usual" = "1.02 to 1.5 times the rows", "without" = "the rows"))]
    pub frame_length_lines: Option<u32>,
    /// Whether rows collect light one after the other, or all at once.
    #[serde(default)]
    pub shutter: Shutter,
    /// Which row is read first: the top one (down) or the bottom one (up).
    #[serde(default)]
    pub direction: Direction,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(inline)]
#[non_exhaustive]
pub enum Direction {
    #[default]
    Down,
    Up,
}

// `[sensor.noise]`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_order::<Self>)]
pub struct NoiseFile {
    /// Read noise at unity gain, input-referred, standard deviation.
    #[schemars(range(min = 0.0, max = 1e5), extend("unit" = "e-", "usual" = "1 to 10"))]
    pub read_e: f64,
    /// The part of it that comes after the gain stage; referred to the input it falls as
    /// 1/gain. At most read_e.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e5))]
    #[schemars(extend("unit" = "e-", "usual" = "0 to all of read_e"))]
    pub read_e_post: f64,
    /// Mean dark current at temperature_ref_c.
    #[schemars(range(min = 0.0, max = 1e6))]
    #[schemars(extend("unit" = "e-/s", "usual" = "1 to 100 at 25 °C"))]
    pub dark_current_e_per_s: f64,
    /// Rise of temperature that doubles the dark current.
    #[serde(default = "seven")]
    #[schemars(range(min = 1.0, max = 100.0), extend("unit" = "K", "usual" = "6 to 9"))]
    pub dark_doubling_c: f64,
    /// Temperature for which the dark current holds.
    #[serde(default = "room")]
    #[schemars(range(min = -100.0, max = 150.0), extend("unit" = "°C"))]
    pub temperature_ref_c: f64,
    /// Dark signal non-uniformity: standard deviation over pixels of the dark current.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e6))]
    #[schemars(extend("unit" = "e-/s", "usual" = "0.1 to 1 of the dark current"))]
    pub dsnu_e_per_s: f64,
    /// Photo response non-uniformity: standard deviation over pixels of the gain, mean 1.
    #[schemars(range(min = 0.0, max = 0.14), extend("usual" = "0.005 to 0.02"))]
    pub prnu: f64,
    /// Row-wise fixed pattern, standard deviation over rows.
    #[schemars(range(min = 0.0, max = 1e5), extend("unit" = "e-"))]
    #[schemars(extend("usual" = "0.1 to 1 of read_e", "without" = "half of read_e"))]
    pub row_fpn_e: Option<f64>,
}

// `[sensor.gains]`.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = in_order::<Self>)]
pub struct GainsFile {
    /// Nominal gains, 1 to 16 of them, rising. Between two of them values follow straight lines in
    /// logarithms, beyond the first and the last they stay. A gain that stands twice is a step, as
    /// of the conversion gain: the second holds from there on.
    pub at: Vec<f64>,
    /// Read noise at these gains, input-referred, in place of sensor.noise.read_e and
    /// read_e_post.
    #[schemars(extend("unit" = "e-", "without" = "the law of read_e and read_e_post"))]
    pub read_e: Option<Vec<f64>>,
    /// DN per electron at these gains. Beyond the last one it stays, so that more gain is none.
    #[schemars(extend("unit" = "DN per electron", "without" = "in proportion to the gain"))]
    pub dn_per_e: Option<Vec<f64>>,
    /// Mean DN of no signal at these gains.
    #[schemars(extend("unit" = "DN", "without" = "sensor.black_level_dn"))]
    pub black_level_dn: Option<Vec<f64>>,
    /// Charge that the sense node holds at these gains, where that is less than full_well_e.
    #[schemars(extend("unit" = "e-", "without" = "full_well_e"))]
    pub well_e: Option<Vec<f64>>,
    /// Largest analog gain: above it, codes are multiplied by the rest, after the converter.
    #[schemars(range(min = 0.01, max = 10_000.0), extend("without" = "all gain is analog"))]
    pub digital_above: Option<f64>,
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
