//! The dark and flat stacks of a capture set as levels: conditions and moments, for photon
//! transfer and EMVA 1288.

use super::codes::{CodeCounts, Codes};
use super::cut_off::CutOff;
use super::moments::Moments;
use super::stack::Stack;
use super::tolerance::{SAME_EXPOSURE, SAME_TEMPERATURE_C};
use camrig_base::{Error, Result};
use camrig_captures::{Capture, CaptureSet, Light, Role, Uniformity};
use camrig_light::photometry::HC;

/// Share of samples at the white level from which a dark counts as saturated.
const SATURATED_DARK: f64 = 0.5;
/// Standard deviations of the samples by which the mean of a dark may lie below the nominal black
/// level. The nominal level may be wrong by drift, but not by more than the range of the dark's
/// samples.
const MAX_SDS_BELOW_BLACK: f64 = 6.0;
/// DN that are added to it, for rounding.
const ROUNDING_DN: f64 = 1.0;
/// Standard errors by which a dark must be brighter than a flat to contradict it: exceeded by
/// chance once in three million pairs.
const MIN_ERRORS: f64 = 5.0;

/// One dark or flat stack: conditions and moments.
#[derive(Clone, Debug)]
pub struct Level {
    /// The capture's id.
    pub id: String,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Sensor temperature, °C.
    pub temperature_c: Option<f64>,
    /// The light, `None` for darks.
    pub light: Option<Light>,
    /// Photons per pixel over the exposure, where the manifest allows to compute them.
    pub photons: Option<f64>,
    /// Moments of each channel.
    pub channels: Vec<Moments>,
    /// Codes of rows of the first frame.
    pub codes: CodeCounts,
    /// Whether the samples of a dark are cut off, and where.
    pub cut_off: Option<CutOff>,
}

/// The codes of the samples of these levels.
pub fn codes(darks: &[Level], flats: &[Level]) -> Codes {
    Codes::of(darks.iter().chain(flats).map(|level| &level.codes))
}

/// Captures of one analog gain and, for flats, one kind of light, chosen for a photon transfer.
#[derive(Clone, Debug)]
pub struct Selection<'a> {
    /// The analog gain.
    pub analog_gain: f64,
    /// Wavelength of the light, nm, where it is narrow-band.
    pub wavelength_nm: Option<f64>,
    /// Dark captures at the flats' temperature.
    pub darks: Vec<&'a Capture>,
    /// Dark captures at other temperatures.
    pub other_darks: Vec<&'a Capture>,
    /// Flat captures.
    pub flats: Vec<&'a Capture>,
    /// Whether the manifest states that the light of all flats is even over the sensor.
    pub even_light: bool,
}

impl<'a> Selection<'a> {
    /// Selects the analog gain and wavelength with most flats.
    ///
    /// # Errors
    /// No darks, or no flats.
    pub fn of(set: &'a CaptureSet) -> Result<Self> {
        let all = Self::all(set);
        // The one with most flats, the first in the file of several.
        let most = all.iter().map(|s| s.flats.len()).max();
        let best = all.into_iter().find(|s| Some(s.flats.len()) == most);
        let best = best.ok_or_else(|| {
            Error::input("no flat captures")
                .help("photon transfer needs captures of role = \"flat\" at several exposures")
        })?;
        if best.darks.is_empty() {
            return Err(Error::input(format!(
                "no dark captures at analog gain {}",
                best.analog_gain
            ))
            .help("add captures of role = \"dark\" at the flats' exposure times"));
        }
        Ok(best)
    }

    /// Every combination of analog gain and wavelength that has flats, in the file's order.
    pub fn all(set: &'a CaptureSet) -> Vec<Self> {
        let key = |c: &Capture| (c.analog_gain, wavelength(c));
        let mut kinds: Vec<(f64, Option<f64>)> = Vec::new();
        for flat in set.with_role(Role::Flat) {
            if !kinds.contains(&key(flat)) {
                kinds.push(key(flat));
            }
        }
        kinds.into_iter().map(|kind| Self::of_kind(set, kind)).collect()
    }

    fn of_kind(set: &'a CaptureSet, (gain, wavelength_nm): (f64, Option<f64>)) -> Self {
        let flats: Vec<&Capture> = set
            .with_role(Role::Flat)
            .filter(|c| (c.analog_gain, wavelength(c)) == (gain, wavelength_nm))
            .collect();
        let known: Vec<f64> = flats.iter().filter_map(|c| c.temperature_c).collect();
        let near = |c: &&Capture| match c.temperature_c {
            Some(own) if !known.is_empty() => {
                known.iter().any(|t| (t - own).abs() <= SAME_TEMPERATURE_C)
            }
            _ => true,
        };
        let (darks, other_darks): (Vec<_>, Vec<_>) =
            set.with_role(Role::Dark).filter(|c| c.analog_gain == gain).partition(near);
        let even =
            |c: &&Capture| c.light.as_ref().is_some_and(|l| l.uniformity == Uniformity::Flat);
        let even_light = flats.iter().all(even);
        Self { analog_gain: gain, wavelength_nm, even_light, darks, other_darks, flats }
    }
}

fn wavelength(capture: &Capture) -> Option<f64> {
    capture.light.as_ref().and_then(|l| l.wavelength_nm)
}

impl Level {
    /// The level of a capture whose moments are `stack`.
    pub fn new(set: &CaptureSet, capture: &Capture, stack: &Stack) -> Self {
        let channels = set.cfa().channels().len();
        Self {
            id: capture.id.clone(),
            exposure_s: capture.exposure_s,
            temperature_c: capture.temperature_c,
            light: capture.light.clone(),
            photons: photons(set, capture),
            channels: (0..channels).map(|c| stack.channel_moments(c)).collect(),
            codes: stack.codes.clone(),
            cut_off: stack.cut_off,
        }
    }
}

/// Photons per pixel (area pitch²) over the exposure: from the manifest, or E t A λ / (h c) for an
/// irradiance E at a wavelength λ; `None` where the manifest has neither.
pub fn photons(set: &CaptureSet, capture: &Capture) -> Option<f64> {
    let light = capture.light.as_ref()?;
    if let Some(rate) = light.photons_per_pixel_per_s {
        return Some(rate * capture.exposure_s);
    }
    let area = (set.sensor.pitch_um? * 1e-6).powi(2);
    let energy = light.irradiance_w_m2? * area * capture.exposure_s;
    Some(energy * light.wavelength_nm? * 1e-9 / HC)
}

/// Relative exposure of each flat: photons per pixel where known, otherwise the exposure time (s)
/// where all flats have the same irradiance or illuminance, otherwise `None`.
pub fn exposures(flats: &[Level]) -> Option<Vec<f64>> {
    if let Some(photons) = flats.iter().map(|f| f.photons).collect() {
        return Some(photons);
    }
    let known = |f: &Level| {
        f.light.as_ref().is_some_and(|l| l.irradiance_w_m2.is_some() || l.lux.is_some())
    };
    let same = flats.iter().all(|f| known(f) && f.light == flats[0].light);
    same.then(|| flats.iter().map(|f| f.exposure_s).collect())
}

/// The error for a stack of one frame.
pub(crate) fn single_frame(place: String) -> Error {
    Error::input("temporal noise needs more than one frame")
        .at(place)
        .help("provide at least two frames per capture")
}

/// Refuses darks that cannot be measured.
///
/// # Errors
/// Single frames, saturated darks, darks below the nominal black level.
pub fn check_darks(set: &CaptureSet, darks: &[Level]) -> Result<()> {
    for dark in darks {
        for (channel, m) in dark.channels.iter().enumerate() {
            let place = format!("dark capture {:?}, channel {channel}", dark.id);
            if m.frames < 2 {
                return Err(single_frame(place));
            }
            if m.whites > SATURATED_DARK {
                return Err(Error::input("a dark capture is saturated").at(place));
            }
            let Some(black) = set.sensor.black_level_dn else { continue };
            let spread = (m.temporal + m.plane.measured).sqrt();
            let dark_signal = m.mean() - black;
            if dark_signal < -(MAX_SDS_BELOW_BLACK * spread + ROUNDING_DN) {
                return Err(Error::disagreement(format!(
                    "black_level_dn = {black} but the dark frames' mean is {:.2} DN with a \
                     standard deviation of {spread:.2} DN",
                    m.mean()
                ))
                .at(place)
                .help("a dark frame cannot be darker than black: correct black_level_dn"));
            }
        }
    }
    Ok(())
}

/// Refuses flats that are darker than a dark of the same or a shorter exposure time. Between two
/// stacks, an offset drifts by less than the noise of a sample or a step of the codes.
///
/// # Errors
/// A dark brighter than a flat.
pub fn check_flats<'a>(darks: &[Level], flats: impl Iterator<Item = &'a Level>) -> Result<()> {
    for flat in flats {
        let no_longer = |d: &&Level| d.exposure_s <= flat.exposure_s * (1.0 + SAME_EXPOSURE);
        for dark in darks.iter().filter(no_longer) {
            let step = codes(std::slice::from_ref(dark), std::slice::from_ref(flat)).step_dn;
            for (channel, (f, d)) in flat.channels.iter().zip(&dark.channels).enumerate() {
                let above = d.mean() - f.mean();
                let error = libm::hypot(f.mean_error(), d.mean_error());
                if above > MIN_ERRORS * error && above > d.temporal.sqrt() + step {
                    return Err(Error::disagreement(format!(
                        "dark capture {:?} has a mean of {:.2} DN, flat capture {:?} of {:.2} DN",
                        dark.id,
                        d.mean(),
                        flat.id,
                        f.mean()
                    ))
                    .at(format!("channel {channel}"))
                    .help(format!(
                        "a flat of {} s must not be darker than a dark of {} s: check whether light \
                         reached the dark, or whether an id, exposure or gain is wrong",
                        flat.exposure_s, dark.exposure_s
                    )));
                }
            }
        }
    }
    Ok(())
}
