//! Which frames of a set are looked at, and under which conditions they were taken.

use super::looks::Look;
use camrig_base::Bands;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_captures::{Capture, CaptureSet, Role, SceneSeen, Split, Uniformity};
use camrig_scene::chart;
use camrig_scene::photometry::HC;

/// Frames that are held in memory at once.
pub const BATCH: usize = 32;

/// A stack as it was taken.
#[derive(Clone, Debug)]
pub struct Condition {
    /// Index of the capture in the set.
    pub capture: usize,
    /// Its id.
    pub id: String,
    /// What it is for.
    pub role: Role,
    /// Frames left out at its start.
    pub skip: usize,
    /// Frames used.
    pub frames: usize,
    /// Exposure, s.
    pub exposure_s: f64,
    /// Analog gain.
    pub analog_gain: f64,
    /// Temperature, °C; the camera's where the manifest has none.
    pub temperature_c: f64,
    /// Mean photo-electrons of each channel, as the camera file predicts.
    pub photo_e: Vec<f64>,
    /// Mean photo-electrons of each channel in the frame before each.
    pub before_e: Vec<f64>,
    /// Whether the amount of light is known.
    pub level_known: bool,
    /// Whether the light is even over the sensor.
    pub even: bool,
    /// Wavelength of narrow-band light, nm.
    pub wavelength_nm: Option<f64>,
}

impl Condition {
    /// Whether it is a flat whose light is known.
    pub fn is_known_flat(&self) -> bool {
        self.role == Role::Flat && self.level_known
    }
}

/// The stacks of one half of a set.
#[derive(Clone, Debug)]
pub struct Design {
    /// Dark and flat stacks in the order of the manifest.
    pub conditions: Vec<Condition>,
    /// Edges, dots and charts, the same way.
    pub looks: Vec<Look>,
}

/// A set divided in frames to fit and frames to judge.
#[derive(Clone, Debug)]
pub struct Halves {
    /// For naming and fitting.
    pub fit: Design,
    /// For judging only; `None` where the set has too few frames.
    pub holdout: Option<Design>,
    /// What was left out or is not as wished, for people.
    pub notes: Vec<String>,
}

/// Divides a set: as the manifest says, or else each stack in its first and second half.
///
/// # Errors
/// A set without usable stacks, of another size than the camera, or whose light cannot be.
pub fn divide(camera: &Camera, set: &CaptureSet, counts: &[usize]) -> Result<Halves> {
    let s = &camera.sensor;
    if (set.sensor.width, set.sensor.height) != (s.width as usize, s.height as usize) {
        return Err(Error::input(format!(
            "captures of {} x {} pixels, a camera of {} x {}",
            set.sensor.width, set.sensor.height, s.width, s.height
        ))
        .help("give the camera file of the sensor that took the captures"));
    }
    if set.sensor.bits != u32::from(s.bits) {
        return Err(Error::input(format!(
            "captures of {} bits, a camera of {} bits",
            set.sensor.bits, s.bits
        ))
        .help("set bits in the camera file to the captures' depth"));
    }
    if let Some(cfa) = &set.sensor.cfa
        && *cfa != s.cfa
    {
        return Err(Error::input(format!(
            "captures with colour filters {cfa}, a camera with {}",
            s.cfa
        ))
        .help("give the camera file of the sensor that took the captures"));
    }
    let mut notes = Vec::new();
    let mut fit = Design { conditions: Vec::new(), looks: Vec::new() };
    let mut holdout = fit.clone();
    let by_manifest = set.captures.iter().any(|c| c.split.is_some());
    for (index, capture) in set.captures.iter().enumerate() {
        let n = counts[index];
        let place = |e: Error| e.at(format!("capture {:?}", capture.id));
        let of_light = matches!(capture.role, Role::Dark | Role::Flat);
        // A single frame shows a thing; noise takes two.
        let least = if of_light { 2 } else { 1 };
        let too_few = if by_manifest { n < least } else { n < 2 * least };
        if too_few {
            notes.push(match by_manifest {
                true => format!("{}: one frame shows no noise; left out", capture.id),
                false => format!(
                    "{}: {n} frames are too few to fit some and judge with others ({} and more); left out",
                    capture.id,
                    2 * least
                ),
            });
            continue;
        }
        // Frames for each half: (skip, frames).
        let [first, second] = match (by_manifest, capture.split) {
            (true, Some(Split::Holdout)) => [None, Some((0, n))],
            (true, _) => [Some((0, n)), None],
            (false, _) => [Some((0, n / 2)), Some((n / 2, n / 2))],
        };
        let halves = [(&mut fit, first), (&mut holdout, second)];
        if of_light {
            let condition = condition(camera, set, index).map_err(place)?;
            for (design, (skip, frames)) in halves.into_iter().filter_map(|(d, f)| Some((d, f?))) {
                design.conditions.push(Condition { skip, frames, ..condition.clone() });
            }
        } else {
            match look(camera, set, index).map_err(place)? {
                Some(look) => {
                    for (design, (skip, frames)) in
                        halves.into_iter().filter_map(|(d, f)| Some((d, f?)))
                    {
                        design.looks.push(Look { skip, frames, ..look.clone() });
                    }
                }
                None => notes.push(format!(
                    "{}: the diagnosis looks at slanted-edge, dots and colorchecker; left out",
                    capture.id
                )),
            }
        }
    }
    if fit.is_empty() {
        return Err(Error::input("no stack to look at")
            .help("dark and flat stacks of four and more frames each are needed; two frames per stack leave nothing to judge with"));
    }
    if by_manifest && holdout.is_empty() {
        notes.push("no capture has split = \"holdout\": nothing can be confirmed".into());
    }
    let holdout = (!holdout.is_empty()).then_some(holdout);
    Ok(Halves { fit, holdout, notes })
}

impl Design {
    fn is_empty(&self) -> bool {
        self.conditions.is_empty() && self.looks.is_empty()
    }
}

/// A stack of a thing that can be measured.
fn look(camera: &Camera, set: &CaptureSet, index: usize) -> Result<Option<Look>> {
    let capture = &set.captures[index];
    let Some(scene) = capture.scene.as_ref().map(SceneSeen::spec) else { return Ok(None) };
    let geometry = chart::geometry(&scene).map_err(|e| e.at("[capture.scene]"))?;
    let light = capture.light.as_ref();
    Ok(geometry.map(|geometry| Look {
        capture: index,
        id: capture.id.clone(),
        role: capture.role,
        skip: 0,
        frames: 0,
        exposure_s: capture.exposure_s,
        analog_gain: capture.analog_gain,
        temperature_c: capture.temperature_c.unwrap_or(camera.sensor.temperature_c),
        scene,
        geometry,
        illuminant: light.and_then(|l| l.illuminant.clone()),
        lux: light.and_then(|l| l.lux),
        light: 1.0,
    }))
}

fn condition(camera: &Camera, set: &CaptureSet, index: usize) -> Result<Condition> {
    let capture = &set.captures[index];
    let (photo_e, level_known) = photo_electrons(camera, capture)?;
    let before_e = match &capture.preceded_by {
        Some(id) => {
            let before = set.captures.iter().find(|c| &c.id == id);
            match before {
                Some(before) => photo_electrons(camera, before)?.0,
                None => vec![0.0; photo_e.len()],
            }
        }
        // A stack follows itself.
        None => photo_e.clone(),
    };
    let light = capture.light.as_ref();
    Ok(Condition {
        capture: index,
        id: capture.id.clone(),
        role: capture.role,
        skip: 0,
        frames: 0,
        exposure_s: capture.exposure_s,
        analog_gain: capture.analog_gain,
        temperature_c: capture.temperature_c.unwrap_or(camera.sensor.temperature_c),
        photo_e,
        before_e,
        level_known,
        even: light.is_some_and(|l| l.uniformity == Uniformity::Flat),
        wavelength_nm: light.and_then(|l| l.wavelength_nm),
    })
}

/// Mean photo-electrons per channel in one exposure, and whether the manifest determines them.
fn photo_electrons(camera: &Camera, capture: &Capture) -> Result<(Vec<f64>, bool)> {
    let s = &camera.sensor;
    let channels = s.channel_names.len();
    let Some(light) = capture.light.as_ref().filter(|_| capture.role != Role::Dark) else {
        return Ok((vec![0.0; channels], true));
    };
    let Some(nm) = light.wavelength_nm else {
        return Ok((vec![0.0; channels], false));
    };
    let area = (s.pitch_um * 1e-6).powi(2);
    let irradiance = match (light.irradiance_w_m2, light.photons_per_pixel_per_s) {
        (Some(e), _) => e,
        (None, Some(photons)) => photons * HC / (nm * 1e-9) / area,
        (None, None) => return Ok((vec![0.0; channels], false)),
    };
    let band = Bands { start_nm: nm, step_nm: 1.0, count: 1 };
    let electrons: Vec<f64> =
        s.response(&band).iter().map(|r| r[0] * irradiance * capture.exposure_s).collect();
    if electrons.iter().all(|&e| e <= 0.0) && irradiance > 0.0 {
        return Err(Error::input(format!("light at {nm} nm, where the camera sees nothing"))
            .help("extend the quantum efficiency in the camera file to that wavelength"));
    }
    Ok((electrons, true))
}
