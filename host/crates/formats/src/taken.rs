//! How frames were taken, as their file says: exposure, gain, temperature, kind, each with the
//! field that says it.

use super::Facts;
use super::ifd::{Ifd, Tiff};
use camrig_base::toml_text;

/// ISO speed of unity gain in files of camrig and of camera-tuning tools
/// ([`DngInfo::iso`](super::DngInfo::iso)).
pub(super) const ISO_OF_UNITY: f64 = 100.0;

/// A value and the field of the file that says it.
#[derive(Clone, Debug, PartialEq)]
pub struct Said<T> {
    /// The value.
    pub value: T,
    /// The field, for a person: `EXIF ExposureTime`.
    pub by: String,
}

impl<T> Said<T> {
    /// A value that the field `by` says.
    pub fn new(value: T, by: impl Into<String>) -> Self {
        Self { value, by: by.into() }
    }
}

/// What a file says of how its frames were taken; `None` where it does not say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Taken {
    /// Exposure time, s.
    pub exposure_s: Option<Said<f64>>,
    /// Gain before the converter, 1 at unity.
    pub analog_gain: Option<Said<f64>>,
    /// Temperature of the sensor, °C.
    pub temperature_c: Option<Said<f64>>,
    /// Distance of neighbouring pixels, µm.
    pub pitch_um: Option<Said<f64>>,
    /// What the frames are of, in the words of the program that took them: `Dark Frame`.
    pub kind: Option<Said<String>>,
    /// Whether a note of camrig says the bits; those of the container may be more.
    pub noted: bool,
    /// Fields that a person may understand and this reader does not take over.
    pub remarks: Vec<String>,
}

impl Taken {
    /// What EXIF says (EXIF 2.32: ExposureTime, PhotographicSensitivity). ISO speeds are gains by
    /// the convention that 100 is unity, which is said.
    /// Of several directories the first that has a field decides.
    pub(super) fn of_directories(directories: &[&Ifd]) -> Self {
        let first = |tag: u16| directories.iter().find_map(|d| d.floats(tag)?.first().copied());
        Self {
            exposure_s: first(33434).map(|s| Said::new(s, "EXIF ExposureTime")),
            analog_gain: first(34855).filter(|iso| *iso > 0.0).map(gain_of_iso),
            ..Self::default()
        }
    }

    /// What the EXIF directory of a TIFF says, or its first directory (TIFF/EP); nothing where
    /// there are none.
    pub(super) fn of_tiff(bytes: &[u8]) -> Self {
        let read = || {
            let file = Tiff::open(bytes).ok()?;
            let first = file.ifd(file.first().ok()?).ok()?;
            let exif = first.uint(34665).and_then(|at| file.ifd(at as usize).ok());
            Some(Self::of_directories(&exif.iter().chain([&first]).collect::<Vec<_>>()))
        };
        read().unwrap_or_default()
    }

    /// Fills in a word of camrig's note.
    pub(super) fn take_word(&mut self, key: &str, value: &str) {
        let by = || "camrig's note in the file";
        let number = value.parse::<f64>().ok().filter(|v| v.is_finite() && *v >= 0.0);
        match (key, number) {
            ("exposure", Some(s)) => {
                self.exposure_s.get_or_insert_with(|| Said::new(s, by()));
            }
            ("iso", Some(iso)) if iso > 0.0 => {
                self.analog_gain.get_or_insert_with(|| gain_of_iso(iso));
            }
            _ => {}
        }
    }
}

fn gain_of_iso(iso: f64) -> Said<f64> {
    Said::new(iso / ISO_OF_UNITY, format!("ISO {iso}, with ISO 100 as gain 1"))
}

impl<S> Facts<S> {
    /// Exposure time that a file of these facts is to say, s.
    pub(super) fn exposure_to_say(&self) -> Option<f64> {
        let info = self.dng.as_ref().and_then(|info| info.exposure_s);
        let exposure_s = info.or(self.taken.exposure_s.as_ref().map(|said| said.value));
        exposure_s.map(toml_text::seven_figures)
    }

    /// Distance of pixels that a file of these facts is to say, µm.
    pub(super) fn pitch_to_say(&self) -> Option<f64> {
        let info = self.dng.as_ref().and_then(|info| info.pitch_um);
        info.or(self.taken.pitch_um.as_ref().map(|said| said.value))
    }

    /// ISO speed that a file of these facts is to say.
    pub(super) fn iso_to_say(&self) -> Option<f64> {
        let info = self.dng.as_ref().and_then(|info| Some(f64::from(info.iso?)));
        info.or(self.taken.analog_gain.as_ref().map(|said| ISO_OF_UNITY * said.value))
    }
}
