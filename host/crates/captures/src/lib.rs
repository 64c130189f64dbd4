//! Capture sets: raw frames with what is known about how they were made, measured or simulated.
//!
//! A capture set is a directory with `captures.toml` and frames; it is the only way measured data
//! enter the program, and what `camrig capture` writes. [`CaptureSet::load`] reads and checks the
//! manifest; frames are read one batch at a time by [`CaptureSet::for_each_batch`], so a stack of
//! any length needs the memory of a few frames.
//!
//! Samples are DN; exposures are in s, temperatures in °C, irradiance in W m⁻² on the sensor,
//! wavelengths in nm, illuminance in lx on the scene.
//!
//! ```
//! use camrig_captures::{CaptureSet, Role};
//! use camrig_base::Plane;
//! use camrig_formats::{Facts, Format, Frames};
//!
//! let folder = tempfile::tempdir().unwrap();
//! let planes = vec![Plane::filled(8, 6, 42u16), Plane::filled(8, 6, 44u16)];
//! let facts = Facts { bits: Some(10), ..Facts::default() };
//! let bytes = Format::Npy.encode(&Frames { planes, facts })?;
//! std::fs::write(folder.path().join("dark.npy"), bytes).unwrap();
//! let manifest = r#"
//!     format = "captures/1"
//!     [sensor]
//!     width = 8
//!     height = 6
//!     bits = 10
//!     cfa = "RGGB"
//!     white_level_dn = 1023
//!     [[capture]]
//!     id = "dark"
//!     role = "dark"
//!     files = "dark.npy"
//!     exposure_s = 0.01
//!     analog_gain = 1.0
//! "#;
//! std::fs::write(folder.path().join("captures.toml"), manifest).unwrap();
//!
//! let set = CaptureSet::load(folder.path())?;
//! let dark = set.with_role(Role::Dark).next().expect("a dark stack");
//! let (mut sum, mut samples) = (0.0, 0.0);
//! let frames = set.for_each_batch(dark, |batch| {
//!     for value in batch.iter().flat_map(|frame| &frame.data) {
//!         sum += f64::from(*value);
//!         samples += 1.0;
//!     }
//!     Ok(())
//! })?;
//! assert_eq!((frames, sum / samples), (2, 43.0));
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

pub mod draft;
mod frames;
mod headers;
pub mod manifest;

pub use camrig_base as base;
pub use camrig_formats as formats;
pub use frames::{Batches, StoredFrame, open, open_with_facts};

use camrig_base::Cfa;
use camrig_base::{Error, ErrorCode, Plane, Result};
use schemars::JsonSchema;
use std::path::{Path, PathBuf};

/// A checked capture set. Frames are still on disk.
#[derive(Clone, Debug)]
pub struct CaptureSet {
    /// The directory of `captures.toml`.
    pub root: PathBuf,
    /// The base model that belongs to the set, as a path that can be opened (or a preset's name).
    pub camera: Option<PathBuf>,
    /// What is needed to read the frames.
    pub sensor: SensorFacts,
    /// The stacks, in the order of the file.
    pub captures: Vec<Capture>,
}

/// What is needed to read the frames.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorFacts {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Bits per sample.
    pub bits: u32,
    /// Colour filter pattern; `None` where the manifest does not say.
    pub cfa: Option<Cfa>,
    /// Nominal mean DN of no light; `None` where the manifest does not say.
    pub black_level_dn: Option<f64>,
    /// DN at which samples saturate.
    pub white_level_dn: u16,
    /// Pixel pitch, µm.
    pub pitch_um: Option<f64>,
    /// Where the part of the frames that is read lies; `None` where they are read whole.
    pub window: Option<Window>,
}

/// A part of stored frames, of [`SensorFacts::width`] columns and [`SensorFacts::height`] rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub x: usize,
    /// First row.
    pub y: usize,
    /// Columns and rows of the whole frames.
    pub of: [usize; 2],
}

/// What a capture is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize, serde::Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
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
    /// The crosstalk experiment: narrow-band parallel light on a rotated sensor.
    Rotation,
}

/// Which side of a fit a capture belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize, serde::Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Split {
    /// May be used for naming and fitting.
    Fit,
    /// Only for judging.
    Holdout,
}

/// One stack of repeated frames under the same conditions.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Unique name within the set.
    pub id: String,
    /// What it is for.
    pub role: Role,
    /// The frames' files in order of time.
    pub files: Vec<PathBuf>,
    /// Fit or hold-out, where the set says.
    pub split: Option<Split>,
    /// Exposure time, s; 0 of bias frames (role `dark`).
    pub exposure_s: f64,
    /// Analog gain.
    pub analog_gain: f64,
    /// Sensor temperature, °C.
    pub temperature_c: Option<f64>,
    /// What the camera was asked for, s, where it differs.
    pub exposure_requested_s: Option<f64>,
    /// Capture a frame of which came right before each frame here (image lag).
    pub preceded_by: Option<String>,
    /// The light, where there was any.
    pub light: Option<Light>,
    /// What was looked at.
    pub scene: Option<SceneSeen>,
    /// How the sensor was turned (role `rotation`).
    pub rotation: Option<Rotation>,
}

impl Capture {
    /// A stack of these files at unity gain, of which nothing more is known.
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
        }
    }
}

/// The light of a capture. Every field is what the manifest says; none is made up.
#[derive(Clone, Debug, Default, PartialEq, serde::Deserialize, serde::Serialize, JsonSchema)]
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
    /// Illuminant name or file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub illuminant: Option<String>,
    /// Scene illuminance, lx.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lux: Option<f64>,
    /// Whether shading of the light itself may be present.
    #[serde(default)]
    pub uniformity: Uniformity,
}

/// What is known about the evenness of the light over the sensor.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Uniformity {
    /// Even.
    Flat,
    /// Shading of the light itself may be present.
    #[default]
    Unknown,
}

/// What an edge, chart, dots or scene capture looked at.
#[derive(Clone, Debug, Default, PartialEq, serde::Deserialize, serde::Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneSeen {
    /// A scene as on the command line.
    pub scene: String,
    /// Angle of the edge to the columns, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_deg: Option<f64>,
}

impl SceneSeen {
    /// The scene as on the command line, turned as `angle_deg` says where its name does not.
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

/// How the sensor was turned in the crosstalk experiment, and which point of it is read.
///
/// `x` and `y` are -1..1 over the sensor's half width and half height; the light comes from the
/// direction of the chief ray of that point: `tilt_x_deg` from the side of +x, `tilt_y_deg` from
/// the side of +y, both direction angles (tan components of one direction).
#[derive(Clone, Copy, Debug, PartialEq, serde::Deserialize, serde::Serialize, JsonSchema)]
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
    /// Which scan it belongs to.
    #[serde(default)]
    pub scan: Scan,
    /// Whether the frames are a window of the sensor centred on the point, not the whole sensor.
    #[serde(default)]
    pub window: bool,
}

/// A scan of the crosstalk experiment.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize, JsonSchema,
)]
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

impl CaptureSet {
    /// Reads `DIR/captures.toml` (or that file itself) and finds every frame's file.
    ///
    /// # Errors
    /// A manifest that is missing or wrong (unknown keys, values out of range, repeated ids), and
    /// patterns that no file matches. Frames themselves are read later.
    pub fn load(path: &Path) -> Result<Self> {
        let file = if path.is_dir() { path.join("captures.toml") } else { path.to_owned() };
        let text = std::fs::read_to_string(&file).map_err(|e| {
            Error::io("read", &file, e).help("a capture set is a directory with captures.toml")
        })?;
        manifest::parse(&text, &file)
    }

    /// The set with `width` columns from `x` on and `height` rows from `y` on of every frame, as if
    /// the sensor had no others.
    ///
    /// # Errors
    /// A region that is empty, not inside the frames, or does not start at a whole period of the
    /// colour filter pattern.
    pub fn within(mut self, [x, y, width, height]: [usize; 4]) -> Result<Self> {
        let whole = [self.sensor.width, self.sensor.height];
        let inside = |start: usize, length: usize, all: usize| {
            length > 0 && start.checked_add(length).is_some_and(|end| end <= all)
        };
        let region = format!("region {x},{y},{width},{height}");
        if !inside(x, width, whole[0]) || !inside(y, height, whole[1]) {
            return Err(Error::input(format!("{region} of {} x {}", whole[0], whole[1]))
                .help("give a region inside the frames")
                .with_code(ErrorCode::RegionOutside));
        }
        let cfa = self.cfa();
        if !x.is_multiple_of(cfa.width) || !y.is_multiple_of(cfa.height) {
            return Err(Error::unsupported(format!("{region} inside a period of {cfa}")).help(
                format!("start at multiples of {} columns and {} rows", cfa.width, cfa.height),
            ));
        }
        (self.sensor.width, self.sensor.height) = (width, height);
        self.sensor.window = Some(Window { x, y, of: whole });
        Ok(self)
    }

    /// The colour filter pattern, mono where the manifest does not say.
    pub fn cfa(&self) -> Cfa {
        let mono = || Cfa { width: 1, height: 1, letters: vec!['M'] };
        self.sensor.cfa.clone().unwrap_or_else(mono)
    }

    /// The captures of one role, in the order of the file.
    pub fn with_role(&self, role: Role) -> impl Iterator<Item = &Capture> {
        self.captures.iter().filter(move |c| c.role == role)
    }

    /// Number of frames of a capture.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn count(&self, capture: &Capture) -> Result<usize> {
        capture.files.iter().map(|f| Ok(open(f)?.len())).sum()
    }

    /// Calls `each` with the capture's frames in order of time, a few at a time. Files of a batch
    /// are decoded in parallel. Returns the number of frames.
    ///
    /// # Errors
    /// A file that cannot be read, or a frame whose size or largest sample contradicts `[sensor]`.
    pub fn for_each_batch(
        &self,
        capture: &Capture,
        each: impl FnMut(&[Plane<u16>]) -> Result<()>,
    ) -> Result<usize> {
        frames::for_each_batch(&self.sensor, capture, each)
            .map_err(|e| e.at(format!("capture {:?}", capture.id)))
    }
}
