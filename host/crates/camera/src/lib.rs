//! [`Camera`]: lens, sensor and effects of one physical camera, as checked values with units.
//!
//! A camera file (TOML) describes it. [`Camera::load`] reads a file or a built-in preset
//! ([`presets`]), checks every value against its range ([`keys`]) and names the line of each
//! mistake; [`Camera::load_with`] changes keys of it before, [`Camera::with_size`] the number of
//! pixels after. [`Camera::sensor_config`] and [`Camera::settings`] convert the
//! result to what `camrig-sensor-core` takes; [`schema::schema`] describes the file for editors.
//!
//! # Example
//! The built-in camera of Chen et al. 2009, with another read noise:
//! ```
//! use camrig_base::Bands;
//! use camrig_camera::{Camera, LensKind};
//!
//! let camera = Camera::load_with("mt9t012", [("sensor.noise.read_e", 6.0)])?;
//! let sensor = &camera.sensor;
//! assert_eq!((sensor.width, sensor.height, sensor.pitch_um), (2048, 1536, 2.2));
//! assert_eq!(sensor.noise.read_e, 6.0); // e⁻
//! assert!(matches!(camera.lens.kind, LensKind::DiffractionLimited { f_number: 2.8, .. }));
//!
//! // Electrons per second and W m⁻² nm⁻¹ of irradiance, per channel and band of 10 nm.
//! let response = sensor.response(&Bands::VISIBLE);
//! assert_eq!((response.len(), response[0].len()), (3, 31));
//! # Ok::<(), camrig_base::Error>(())
//! ```
#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod builtin;
mod changes;
mod check;
mod crosstalk;
pub mod draft;
mod draft_text;
mod effects;
pub mod efficiency;
pub mod empirical;
pub mod facts;
mod file;
mod filter_angles;
mod gains;
pub mod hdr;
mod kept_noise;
pub mod keys;
mod named_files;
pub mod optical;
mod order;
mod parameter;
mod prescription;
pub mod presets;
mod remarks;
pub mod schema;
mod sensor;
#[cfg(test)]
mod tests;
pub mod timing;
pub mod typical;
mod value;

pub use camrig_base::Cfa;
pub use crosstalk::CrosstalkTable;
pub use effects::{AnyEffect, EffectKind, read_effects};
pub use filter_angles::{Directions, FilterAngles};
pub use gains::{AtGain, Gains};
pub use kept_noise::KeptNoise;
pub use optical::OpticalEffect;
pub use sensor::{Noise, SensorModel};
pub use timing::{FrameClock, FramePeriod, RowWindows, SensorTiming, Shutter, Window};
pub use value::{Change, Value};

use camrig_base::table::text_of;
use camrig_base::{Bands, Error, Result, Spectrum, mistakes, toml_text};
use std::io::Read;
use std::path::{Path, PathBuf};

/// One physical camera.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Camera {
    /// Name in raw files and reports.
    pub name: String,
    /// The lens.
    pub lens: LensModel,
    /// The sensor with its noise.
    pub sensor: SensorModel,
    /// Effects of the sensor beyond the base model, in the file's order.
    pub effects: Vec<camrig_sensor_core::effects::Effect>,
    /// What the empirical ones among them were made of, in the order of their tables.
    pub empirical: Vec<empirical::Empirical>,
    /// Number of the frame with which the sensor starts; no part of the file. Frame curves count
    /// from it.
    pub first_frame: u32,
    /// Effects of the optics beyond the description of the lens, in the file's order.
    pub optical_effects: Vec<OpticalEffect>,
    /// Text of the file, for reports.
    pub text: String,
}

/// The lens of a camera file.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct LensModel {
    /// How the lens is described.
    pub kind: LensKind,
    /// Transmittance over wavelength, 0 to 1.
    pub transmittance: Spectrum,
}

/// How a lens is described.
#[derive(Clone, Debug)]
pub enum LensKind {
    /// Aberration-free: key parameters only.
    DiffractionLimited {
        /// Focal length over entrance pupil diameter.
        f_number: f64,
        /// Focal length, mm.
        focal_length_mm: f64,
        /// Image size over object size, |m| of eq. 7 of Chen et al. 2009; 0 for an object at
        /// infinity.
        magnification: f64,
        /// Fall-off of illumination towards the corner.
        relative_illumination: RelativeIllumination,
    },
    /// Measured, or exported by a lens program, over a grid of field heights: a directory.
    Characterised(PathBuf),
    /// Traced from a prescription: a file, and how the lens is used.
    Prescription(Box<camrig_prescription::Setup>),
}

/// Relative illumination over the field.
#[derive(Clone, Debug)]
pub enum RelativeIllumination {
    /// cos⁴ of the field angle.
    Cos4,
    /// No fall-off.
    Flat,
    /// Pairs of field (0 at the axis, 1 at the sensor's corner) and ratio to the axis.
    Table(Vec<(f64, f64)>),
}

/// Where files that a camera file names are found.
pub(crate) enum Folder<'a> {
    Directory(&'a Path),
    BuiltIn,
    /// Tables that are not written yet, by name and text; others are in the directory.
    Draft {
        tables: &'a [(String, String)],
        directory: &'a Path,
    },
}

impl Folder<'_> {
    /// The text of a file named in the camera file.
    fn read(&self, name: &str) -> Result<String> {
        match self {
            Folder::Directory(directory) => {
                let path = directory.join(name);
                std::fs::read(&path).map(text_of).map_err(|e| {
                    let error = Error::io("read", &path, e);
                    match builtin::file(name) {
                        Some(_) => error.help(format!(
                            "it comes with the program: `camrig presets {name} > {name}`"
                        )),
                        None => error,
                    }
                })
            }
            Folder::Draft { tables, directory } => match tables.iter().find(|(n, _)| n == name) {
                Some((_, text)) => Ok(text.clone()),
                None => Folder::Directory(directory).read(name),
            },
            Folder::BuiltIn => presets::file(name)
                .map(str::to_string)
                .ok_or_else(|| Error::input(format!("no built-in file {name:?}"))),
        }
    }

    /// The same of a file that is not longer than `most` bytes.
    fn read_short(&self, name: &str, most: u64) -> Result<String> {
        let Folder::Directory(directory) = self else { return self.read(name) };
        let path = directory.join(name);
        let wrong = |e| Error::io("read", &path, e);
        let mut bytes = Vec::new();
        let file = std::fs::File::open(&path).map_err(wrong)?;
        file.take(most + 1).read_to_end(&mut bytes).map_err(wrong)?;
        if bytes.len() as u64 > most {
            return Err(Error::limit(format!("longer than {most} bytes")).at(name));
        }
        Ok(text_of(bytes))
    }

    fn path(&self, name: &str) -> PathBuf {
        match self {
            Folder::Directory(directory) | Folder::Draft { directory, .. } => directory.join(name),
            Folder::BuiltIn => PathBuf::from(name),
        }
    }
}

/// Lines of a table in CSV, without remarks (`#`) and blanks.
pub(crate) fn csv_reader(text: &str) -> csv::Reader<&[u8]> {
    let mut builder = csv::ReaderBuilder::new();
    builder.comment(Some(b'#')).trim(csv::Trim::All).from_reader(text.as_bytes())
}

/// Whether a camera's name is that of a preset rather than of a file.
pub fn is_preset(spec: &str) -> bool {
    !spec.contains(['/', '\\', '.'])
}

impl Camera {
    /// Remarks for the user on pictures in light of `bands`: noise that is left out, what was
    /// assumed in reading tables, and where the light reaches beyond them.
    pub fn notes(&self, bands: &Bands) -> Vec<String> {
        let sensor = &self.sensor;
        let curves =
            [&self.lens.transmittance].into_iter().chain(&sensor.ir_cut).chain(&sensor.qe);
        let mut notes: Vec<String> =
            sensor.kept_noise.note().map(str::to_owned).into_iter().collect();
        for note in curves.flat_map(|curve| curve.notes(bands)) {
            // The columns of a table share its remarks.
            if !notes.contains(&note) {
                notes.push(note);
            }
        }
        notes.extend(remarks::of(self));
        notes
    }

    /// Loads a camera file, or a built-in preset where `spec` has no path separator and no
    /// extension.
    ///
    /// # Errors
    /// An unknown preset, a file that cannot be read, unknown or missing keys, values out of
    /// range.
    pub fn load(spec: &str) -> Result<Self> {
        Self::load_with(spec, [] as [Change; 0])
    }

    /// Loads a camera with keys of its file changed. [`Camera::text`] is the changed file.
    ///
    /// ```
    /// use camrig_camera::{Camera, Change};
    ///
    /// let camera = Camera::load_with("mt9v024", [("sensor.noise.prnu", 0.02)])?;
    /// assert_eq!(camera.sensor.noise.prnu, 0.02);
    /// # Ok::<(), camrig_base::Error>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`Camera::load`], and keys that a camera file does not have.
    pub fn load_with<C: Into<Change>>(
        spec: &str,
        changes: impl IntoIterator<Item = C>,
    ) -> Result<Self> {
        let changes: Vec<Change> = changes.into_iter().map(Into::into).collect();
        if is_preset(spec) {
            let file = format!("{}.toml", spec.to_ascii_lowercase());
            let text = presets::file(&file).ok_or_else(|| {
                let error = presets::unknown("camera", spec);
                let help = error.remedy().unwrap_or_default().to_string();
                error.help(format!("{help}; or give a file such as ./camera.toml"))
            })?;
            return changes::parse(text, &changes, spec, &Folder::BuiltIn);
        }
        let path = Path::new(spec);
        let text = std::fs::read_to_string(path).map_err(|e| Error::io("read", path, e))?;
        let directory = path.parent().unwrap_or(Path::new("."));
        let stem = path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into());
        let folder = Folder::Directory(directory);
        changes::parse(&text, &changes, &stem, &folder).map_err(|e| e.at(spec))
    }

    /// A camera from the text of a camera file with keys of it changed. Files that it names are
    /// looked for in `directory`.
    ///
    /// ```
    /// use camrig_camera::{Camera, Change};
    ///
    /// // Without the tables that come with the preset.
    /// let text = Camera::load_with("mt9t012", [("sensor.qe", 0.5)])?.text;
    /// let text = text.replace("ir_cut = \"ir-cut-690.csv\"", "");
    /// let camera = Camera::from_text(&text, ".".as_ref(), [("sensor.width", 320)])?;
    /// assert_eq!(camera.sensor.width, 320);
    /// # Ok::<(), camrig_base::Error>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`Camera::load_with`].
    pub fn from_text<C: Into<Change>>(
        text: &str,
        directory: &Path,
        changes: impl IntoIterator<Item = C>,
    ) -> Result<Self> {
        let changes: Vec<Change> = changes.into_iter().map(Into::into).collect();
        changes::parse(text, &changes, "camera", &Folder::Directory(directory))
    }

    /// The camera whose sensor starts with the frame of this number.
    #[must_use]
    pub fn starting_at(self, first_frame: u32) -> Self {
        Self { first_frame, ..self }
    }

    /// The camera with another number of pixels, of the same size: 320 columns and 240 rows, for
    /// instance. A frame length that its file does not give is the new number of rows.
    ///
    /// ```
    /// let camera = camrig_camera::Camera::load("mt9v024")?.with_size(320, 240)?;
    /// assert_eq!((camera.sensor.width, camera.sensor.height), (320, 240));
    /// # Ok::<(), camrig_base::Error>(())
    /// ```
    ///
    /// # Errors
    /// A size that no sensor has.
    pub fn with_size(mut self, width: u32, height: u32) -> Result<Self> {
        let size = [Change::new("sensor.width", width), Change::new("sensor.height", height)];
        let mistakes = size.iter().filter_map(|c| keys::Key::of(&c.key)?.mistake(&c.value));
        let mistakes: Vec<Error> = mistakes.collect();
        if !mistakes.is_empty() {
            return Err(mistakes::all(mistakes));
        }
        self.text = changes::text_with(&self.text, &size)?;
        let file: toml::Table = toml_text::read(&self.text)?;
        let timing = file.get("sensor").and_then(|sensor| sensor.get("timing"));
        let own_length = timing.is_some_and(|t| t.get("frame_length_lines").is_some());
        (self.sensor.width, self.sensor.height) = (width, height);
        if let Some(timing) = self.sensor.timing.as_mut().filter(|_| !own_length) {
            timing.frame_length_lines = height;
        }
        Ok(self)
    }

    fn parse(text: &str, default_name: &str, folder: &Folder<'_>) -> Result<Self> {
        match mistakes::compare(text, &keys::DECLARED) {
            (Some(file), wrong) => check::camera(file, wrong, text, default_name, folder),
            (None, wrong) => Err(mistakes::all(wrong)),
        }
        .map_err(|e| match e.remedy() {
            None => e.help("`camrig explain` says what the keys mean"),
            Some(_) => e,
        })
    }
}
