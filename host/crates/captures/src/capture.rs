//! A capture: one stack of frames, with the conditions under which it was taken.

use super::Held;
use camrig_base::alternatives::Alternatives;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::path::PathBuf;

/// The purpose of a capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Role {
    /// No light.
    Dark,
    /// Uniform light.
    Flat,
    /// A slanted edge.
    Edge,
    /// A test chart.
    Chart,
    /// A grid of dots.
    Dots,
    /// Anything else.
    Scene,
    /// The crosstalk experiment: narrow-band collimated light on a rotated sensor.
    Rotation,
}

/// Whether a capture is used for fitting or for validation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Split {
    /// For fitting.
    Fit,
    /// For validation only.
    Holdout,
}

/// One stack of frames under the same conditions.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Capture {
    /// Unique name within the set.
    pub id: String,
    /// Its purpose.
    pub role: Role,
    /// The frames' files: a name, or a pattern with `*`, in order of time by name; or a list of
    /// these, in order of time.
    #[serde(with = "one_or_several")]
    #[schemars(with = "Alternatives<String>")]
    pub files: Vec<PathBuf>,
    /// Fit or hold-out; if omitted, the program divides the set, with a note.
    pub split: Option<Split>,
    /// Exposure time, s; 0 for bias frames (role `dark`).
    pub exposure_s: f64,
    /// Gain before the converter.
    #[serde(default = "unity")]
    pub analog_gain: f64,
    /// Temperature of the sensor, °C; if omitted, that of the camera file.
    pub temperature_c: Option<f64>,
    /// Requested exposure time, s, where it differs from the actual one.
    pub exposure_requested_s: Option<f64>,
    /// Id of the capture right before it, where image lag may matter.
    pub preceded_by: Option<String>,
    /// Light on the sensor or on the scene.
    pub light: Option<Light>,
    /// The scene of an edge, chart, dots or scene capture.
    pub scene: Option<CapturedScene>,
    /// Orientation of the sensor; with role `rotation`.
    pub rotation: Option<Rotation>,
    /// Numbers of frames that readers leave out, from 0 in order of time.
    #[serde(skip)]
    pub left_out: Vec<usize>,
    /// Frames that are in memory, in place of files.
    #[serde(skip)]
    pub held: Option<Held>,
}

fn unity() -> f64 {
    1.0
}

/// Files in a manifest: one name, or a list.
pub(crate) mod one_or_several {
    use super::{Alternatives, Deserialize, Deserializer, PathBuf, Serialize, Serializer};

    pub fn serialize<S: Serializer>(files: &[PathBuf], to: S) -> Result<S::Ok, S::Error> {
        match files {
            [one] => one.serialize(to),
            several => several.serialize(to),
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<PathBuf>, D::Error> {
        Ok(Alternatives::deserialize(from)?.as_slice().to_vec())
    }
}

impl Capture {
    /// A stack of these files at unity gain, with all else unknown.
    #[must_use]
    pub fn new(id: impl Into<String>, role: Role, files: Vec<PathBuf>, exposure_s: f64) -> Self {
        Self {
            id: id.into(),
            role,
            files,
            split: None,
            exposure_s,
            analog_gain: 1.0,
            temperature_c: None,
            exposure_requested_s: None,
            preceded_by: None,
            light: None,
            scene: None,
            rotation: None,
            left_out: Vec::new(),
            held: None,
        }
    }
}

/// The light of a capture. Fields are those of the manifest; none is derived.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// Sensor-plane irradiance, W m⁻², at `wavelength_nm`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub irradiance_w_m2: Option<f64>,
    /// Photons per pixel (pitch² area) and second.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub photons_per_pixel_per_s: Option<f64>,
    /// Wavelength of narrow-band light, nm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Width of its band, nm; a line if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width_nm: Option<f64>,
    /// Illuminant name or file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub illuminant: Option<String>,
    /// Scene illuminance, lx.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lux: Option<f64>,
    /// Whether the light is known to be even over the sensor.
    #[serde(default)]
    pub uniformity: Uniformity,
}

/// Evenness of the light over the sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Uniformity {
    /// Even.
    Flat,
    /// The light itself may be uneven.
    #[default]
    Unknown,
}

/// The scene of an edge, chart, dots or scene capture.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CapturedScene {
    /// The scene, as specified on the command line.
    pub scene: String,
    /// Angle of the edge to the columns, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_deg: Option<f64>,
}

impl CapturedScene {
    /// The scene as specified on the command line, with `angle_deg` where the scene has no angle.
    pub fn spec(&self) -> String {
        match self.angle_deg {
            Some(angle)
                if self.scene.starts_with("slanted-edge") && !self.scene.contains("angle=") =>
            {
                let joint = if self.scene.contains(':') { ',' } else { ':' };
                format!("{}{joint}angle={angle}", self.scene)
            }
            _ => self.scene.clone(),
        }
    }
}

/// Orientation of the sensor in the crosstalk experiment, and the point of it that is read.
///
/// `x` and `y` are -1..1 over the sensor's half width and half height; the light comes from the
/// direction of the chief ray of that point: `tilt_x_deg` from the side of +x, `tilt_y_deg` from
/// the side of +y, both direction angles (tan components of one direction).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rotation {
    /// Point read, -1..1 over the half width.
    pub x: f64,
    /// Point read, -1..1 over the half height.
    pub y: f64,
    /// Tilt towards +x, degrees.
    pub tilt_x_deg: f64,
    /// Tilt towards +y, degrees.
    pub tilt_y_deg: f64,
    /// The scan that it belongs to.
    #[serde(default)]
    pub scan: Scan,
    /// Whether the frames are a window of the sensor centred on the point, not the whole sensor.
    #[serde(default)]
    pub window: bool,
}

/// A scan of the crosstalk experiment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Scan {
    /// The rectangular grid of points, which becomes the table.
    #[default]
    Grid,
    /// About the vertical axis: points along the horizontal one.
    Horizontal,
    /// About the horizontal axis: points along the vertical one.
    Vertical,
    /// Along the diagonal from the top left.
    Diagonal,
    /// Along the diagonal from the bottom left.
    Antidiagonal,
}
