//! The operating point of a measurement, which the standard requires in a data sheet.

use super::spatial::SpatialPair;
use crate::ladder::{Level, Selection};
use camrig_captures::{CaptureSet, Light, SensorFacts};

/// The conditions of a measurement, as far as the captures state them.
#[derive(Clone, Debug)]
pub struct Conditions {
    /// The region that was read out and its samples.
    pub sensor: SensorFacts,
    /// Name of the captures' camera file.
    pub camera: Option<String>,
    /// Analog gain.
    pub analog_gain: f64,
    /// Wavelength of the light, nm, where it is narrow-band.
    pub wavelength_nm: Option<f64>,
    /// Name of the light otherwise.
    pub illuminant: Option<String>,
    /// Shortest and longest exposure of the light levels, s.
    pub exposure_s: [f64; 2],
    /// Lowest and highest temperature of light levels and darks, °C.
    pub temperature_c: Option<[f64; 2]>,
    /// Temperatures of the darks used for the doubling of the dark current, °C.
    pub other_temperatures_c: Vec<f64>,
    /// Number of light levels.
    pub levels: usize,
    /// Smallest and largest number of frames of a light level.
    pub level_frames: [usize; 2],
    /// Number of dark stacks at the flats' temperature, of different exposures or not.
    pub darks: usize,
    /// Frames of the dark and the flat stack of the spatial figures.
    pub spatial_frames: Option<[usize; 2]>,
}

impl Conditions {
    pub(super) fn of(
        set: &CaptureSet,
        selection: &Selection<'_>,
        darks: &[Level],
        levels: &[Level],
        pair: Option<&SpatialPair>,
    ) -> Self {
        let frames = |l: &Level| l.channels[0].frames;
        let light = |l: &&Level| l.light.as_ref().and_then(|l: &Light| l.illuminant.clone());
        let mut other: Vec<f64> =
            selection.other_darks.iter().filter_map(|c| c.temperature_c).collect();
        other.sort_by(f64::total_cmp);
        other.dedup();
        Self {
            sensor: set.sensor.clone(),
            camera: set
                .camera
                .as_ref()
                .and_then(|path| Some(path.file_stem()?.to_string_lossy().into_owned())),
            analog_gain: selection.analog_gain,
            wavelength_nm: selection.wavelength_nm,
            illuminant: levels.iter().find_map(|l| light(&l)),
            exposure_s: ends(levels.iter().map(|l| l.exposure_s)).unwrap_or_default(),
            temperature_c: ends(darks.iter().chain(levels).filter_map(|l| l.temperature_c)),
            other_temperatures_c: other,
            levels: levels.len(),
            level_frames: [
                levels.iter().map(frames).min().unwrap_or(0),
                levels.iter().map(frames).max().unwrap_or(0),
            ],
            darks: darks.len(),
            spatial_frames: pair.map(|p| [frames(&darks[p.dark]), p.frames]),
        }
    }
}

/// Smallest and largest value; `None` without values.
fn ends(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    values.fold(None, |ends, v| match ends {
        None => Some([v, v]),
        Some([a, b]) => Some([v.min(a), v.max(b)]),
    })
}
