//! The design of a measurement: which frames of a capture set are used, their conditions, and the
//! division into fitted and held-out frames.

use super::alternate;
use super::variation::FrameVariation;
use camrig_base::Bands;
use camrig_base::{Error, Result};
use camrig_camera::Camera;
use camrig_captures::{Capture, CaptureSet, CapturedScene, Role, Split, Uniformity, Window};
use camrig_light::photometry::HC;
use camrig_scene::chart::{self, Geometry};

/// Largest difference of temperatures, K, at which stacks have the same dark current: with a
/// doubling every 7 K, half a kelvin changes it by 5 %.
pub const SAME_TEMPERATURE_K: f64 = 0.5;

/// The frames of each capture are numbered from a multiple of this, so that the replicates of a
/// stack do not depend on the length of the other captures, up to this number of frames.
const NUMBERS_PER_CAPTURE: usize = 10_000;

/// A stack: which frames of which capture, and the settings of the sensor.
#[derive(Clone, Debug)]
pub struct Stack {
    /// Index of the capture in the set.
    pub capture: usize,
    /// Its id.
    pub id: String,
    /// What it is for.
    pub role: Role,
    /// Number of frames skipped at its start.
    pub skip: usize,
    /// Number of frames used.
    pub frames: usize,
    /// Number of frames of its capture, used or not.
    pub total: usize,
    /// Variation over the frames used, apart from noise.
    pub variation: FrameVariation,
    /// Number of the capture's first frame in replicates. It selects the frame's temporal noise, so
    /// that no two frames of a set share it, even in different halves.
    pub first_number: u32,
    /// Exposure, s.
    pub exposure_s: f64,
    /// Analog gain.
    pub analog_gain: f64,
    /// Temperature, °C; the camera's where the manifest has none.
    pub temperature_c: f64,
}

/// Whether two stacks were taken at the same temperature.
pub fn same_temperature(a: &Stack, b: &Stack) -> bool {
    (a.temperature_c - b.temperature_c).abs() < SAME_TEMPERATURE_K
}

/// Whether two stacks were taken with the same settings.
pub fn same_settings(a: &Stack, b: &Stack) -> bool {
    let settings = |s: &Stack| (s.role, s.exposure_s, s.analog_gain);
    settings(a) == settings(b) && same_temperature(a, b)
}

/// A dark or flat stack with its light.
#[derive(Clone, Debug)]
pub struct Condition {
    /// The stack.
    pub stack: Stack,
    /// Mean photo-electrons per pixel of each channel, predicted from the camera file.
    pub photo_e: Vec<f64>,
    /// The same in the frame before each of its frames.
    pub before_e: Vec<f64>,
    /// Whether the amount of light is known.
    pub level_known: bool,
    /// Whether the light is even over the sensor.
    pub even: bool,
    /// Wavelength of narrow-band light, nm.
    pub wavelength_nm: Option<f64>,
}

impl Condition {
    /// Whether it is a flat.
    pub fn is_flat(&self) -> bool {
        self.stack.role == Role::Flat
    }

    /// Whether it is a flat whose light is known.
    pub fn is_known_flat(&self) -> bool {
        self.stack.role == Role::Flat && self.level_known
    }
}

/// A stack of a target: an edge, a grid of dots, or a chart.
#[derive(Clone, Debug)]
pub struct Target {
    /// The stack.
    pub stack: Stack,
    /// The scene, as specified on the command line and in manifests.
    pub scene: String,
    /// Positions of the target's features in the scene.
    pub geometry: Geometry,
    /// Illuminant on a reflectance scene.
    pub illuminant: Option<String>,
    /// Illuminance, lx, where the manifest has it.
    pub lux: Option<f64>,
    /// Factor on the model's light: 1 where the illuminance is known, otherwise such that the means
    /// of model and measurement agree.
    pub light: f64,
}

/// The stacks of one half of a set.
#[derive(Clone, Debug, Default)]
pub struct Design {
    /// Dark and flat stacks, in the order of the manifest.
    pub conditions: Vec<Condition>,
    /// Stacks of targets, in the order of the manifest.
    pub targets: Vec<Target>,
    /// Code at which samples saturate, DN, in captures and in what is simulated for them.
    pub white_level_dn: u16,
}

/// A set divided into frames to fit and held-out frames.
#[derive(Clone, Debug)]
pub struct Halves {
    /// For identifying effects and fitting parameters.
    pub fit: Design,
    /// For validation only; `None` where the set has too few frames.
    pub holdout: Option<Design>,
    /// Notes for people on what is not used.
    pub notes: Vec<String>,
}

/// Divides a set according to the manifest, otherwise each stack into its first and second half.
/// `counts` are the numbers of frames of the set's captures.
///
/// # Errors
/// Sets without usable stacks, of another size, bits or filters than the camera, or with light that
/// the camera cannot see.
pub fn divide(camera: &Camera, set: &CaptureSet, counts: &[usize]) -> Result<Halves> {
    check_sensor(camera, set)?;
    let numbers = first_numbers(counts)?;
    let mut notes = Vec::new();
    let white_level_dn = set.sensor.white_level_dn;
    let mut fit = Design { white_level_dn, ..Design::default() };
    let mut holdout = fit.clone();
    let by_manifest = set.captures.iter().any(|c| c.split.is_some());
    let short = if by_manifest { Vec::new() } else { alternate::stacks(set, counts) };
    notes.extend(alternate::note(set, &short));
    notes.extend(by_manifest.then(|| without_split(set)).flatten());
    for (index, capture) in set.captures.iter().enumerate() {
        let n = counts[index];
        let place = |e: Error| e.at(format!("capture {:?}", capture.id));
        let of_light = matches!(capture.role, Role::Dark | Role::Flat);
        // One frame suffices for a target, noise needs two.
        let least = if of_light { 2 } else { 1 };
        let short = short.iter().find(|s| s.capture == index);
        let too_few = if by_manifest { n < least } else { n < 2 * least && short.is_none() };
        if too_few {
            notes.push(match by_manifest {
                true => format!("{}: noise needs two frames; not used", capture.id),
                false => format!(
                    "{}: {n} frames are too few to fit some and hold out others (at least {}); not \
                     used",
                    capture.id,
                    2 * least
                ),
            });
            continue;
        }
        // Frames for each half: (skip, frames).
        let all = Some((0, n));
        let [first, second] = match (by_manifest, capture.split, short) {
            (true, Some(Split::Holdout), _) => [None, all],
            (true, ..) => [all, None],
            (false, _, Some(s)) => [all.filter(|_| s.fit), all.filter(|_| s.held_out)],
            (false, ..) => [Some((0, n / 2)), Some((n / 2, n / 2))],
        };
        let halves = [(&mut fit, first), (&mut holdout, second)];
        let halves = halves.into_iter().filter_map(|(design, frames)| Some((design, frames?)));
        let stack = Stack { total: n, ..stack(camera, capture, index, numbers[index]) };
        let of_half = |(skip, frames)| Stack { skip, frames, ..stack.clone() };
        if !of_light && set.sensor.window.is_some() {
            notes.push(format!(
                "{}: targets need the whole frame, not a region; not used",
                capture.id
            ));
        } else if of_light {
            let condition = condition(camera, set, &stack).map_err(place)?;
            for (design, frames) in halves {
                let stack = of_half(frames);
                design.conditions.push(Condition { stack, ..condition.clone() });
            }
        } else {
            match target(capture, &stack).map_err(place)? {
                Some(target) => {
                    for (design, frames) in halves {
                        design.targets.push(Target { stack: of_half(frames), ..target.clone() });
                    }
                }
                None => notes.push(format!(
                    "{}: only slanted-edge, dots and colorchecker are measured; not used",
                    capture.id
                )),
            }
        }
    }
    if fit.is_empty() {
        return Err(Error::input("no usable stack").help(
            "provide dark and flat stacks of at least four frames each, or of at least two frames at \
             six levels of light or six dark exposures",
        ));
    }
    notes.extend(set.sensor.window.map(|w| {
        let Window { x, y, of: [across, down] } = w;
        let (width, height) = (set.sensor.width, set.sensor.height);
        format!(
            "region {x},{y},{width},{height} of {across} x {down} pixels: effects that depend on \
             the position on the sensor (fall-off, glow) are fitted as if it were the whole sensor"
        )
    }));
    if by_manifest && holdout.is_empty() {
        notes.push("no capture has split = \"holdout\": nothing can be confirmed".into());
    }
    let holdout = (!holdout.is_empty()).then_some(holdout);
    Ok(Halves { fit, holdout, notes })
}

/// The note about captures without `split` where others have one.
fn without_split(set: &CaptureSet) -> Option<String> {
    let without = set.captures.iter().filter(|c| c.split.is_none());
    let ids: Vec<&str> = without.map(|c| c.id.as_str()).collect();
    (!ids.is_empty()).then(|| {
        format!(
            "captures without split are used for fitting, as others have one: {}",
            ids.join(", ")
        )
    })
}

/// Number of the first frame of each capture, given their numbers of frames: the next unused
/// multiple of [`NUMBERS_PER_CAPTURE`].
fn first_numbers(counts: &[usize]) -> Result<Vec<u32>> {
    let too_many = || {
        Error::limit("more frames than there are frame numbers")
            .help("use fewer than four billion frames")
    };
    let mut next = NUMBERS_PER_CAPTURE;
    let mut first = Vec::with_capacity(counts.len());
    for &count in counts {
        let blocks = count.div_ceil(NUMBERS_PER_CAPTURE).max(1);
        let number = u32::try_from(next).map_err(|_| too_many())?;
        let after = blocks.checked_mul(NUMBERS_PER_CAPTURE).and_then(|n| n.checked_add(next));
        next = after.filter(|&n| n <= u32::MAX as usize).ok_or_else(too_many)?;
        first.push(number);
    }
    Ok(first)
}

/// Checks that the captures can be from the camera.
fn check_sensor(camera: &Camera, set: &CaptureSet) -> Result<()> {
    let s = &camera.sensor;
    if let Some(hdr) = &s.hdr {
        return Err(hdr.where_one_is_read().help(format!(
            "take the captures ({}) one by one (sensor.hdr.output = \"captures\", or --capture \
             NAME), and give a plain camera file of one: `camrig camera fit` makes it of its darks \
             and flats",
            hdr.names()
        )));
    }
    if (set.sensor.width, set.sensor.height) != (s.width as usize, s.height as usize) {
        return Err(Error::disagreement(format!(
            "captures of {} x {} pixels, a camera of {} x {}",
            set.sensor.width, set.sensor.height, s.width, s.height
        ))
        .help("give the camera file of the sensor that took the captures"));
    }
    if set.sensor.bits != u32::from(s.bits) {
        return Err(Error::disagreement(format!(
            "captures of {} bits, a camera of {} bits",
            set.sensor.bits, s.bits
        ))
        .help("set bits in the camera file to the captures' depth"));
    }
    if let Some(cfa) = &set.sensor.cfa
        && *cfa != s.cfa
    {
        return Err(Error::disagreement(format!(
            "captures with colour filters {cfa}, a camera with {}",
            s.cfa
        ))
        .help("give the camera file of the sensor that took the captures"));
    }
    Ok(())
}

impl Design {
    fn is_empty(&self) -> bool {
        self.conditions.is_empty() && self.targets.is_empty()
    }
}

/// The stack of a capture; its frames are set later.
fn stack(camera: &Camera, capture: &Capture, index: usize, first_number: u32) -> Stack {
    Stack {
        capture: index,
        id: capture.id.clone(),
        role: capture.role,
        skip: 0,
        frames: 0,
        total: 0,
        variation: FrameVariation::default(),
        first_number,
        exposure_s: capture.exposure_s,
        analog_gain: capture.analog_gain,
        temperature_c: capture.temperature_c.unwrap_or(camera.sensor.temperature_c),
    }
}

/// The target of a capture; `None` for scenes that cannot be measured.
fn target(capture: &Capture, stack: &Stack) -> Result<Option<Target>> {
    let Some(scene) = capture.scene.as_ref().map(CapturedScene::spec) else { return Ok(None) };
    let geometry = chart::geometry(&scene).map_err(|e| e.at("[capture.scene]"))?;
    let light = capture.light.as_ref();
    Ok(geometry.map(|geometry| Target {
        stack: stack.clone(),
        scene,
        geometry,
        illuminant: light.and_then(|l| l.illuminant.clone()),
        lux: light.and_then(|l| l.lux),
        light: 1.0,
    }))
}

fn condition(camera: &Camera, set: &CaptureSet, stack: &Stack) -> Result<Condition> {
    let capture = &set.captures[stack.capture];
    let (photo_e, level_known) = photo_electrons(camera, capture)?;
    let before_e = match &capture.preceded_by {
        Some(id) => {
            let before = set.captures.iter().find(|c| &c.id == id);
            match before {
                Some(before) => photo_electrons(camera, before)?.0,
                None => vec![0.0; photo_e.len()],
            }
        }
        // A stack is preceded by itself.
        None => photo_e.clone(),
    };
    let light = capture.light.as_ref();
    Ok(Condition {
        stack: stack.clone(),
        photo_e,
        before_e,
        level_known,
        even: light.is_some_and(|l| l.uniformity == Uniformity::Flat),
        wavelength_nm: light.and_then(|l| l.wavelength_nm),
    })
}

/// Width of light of which the manifest states none: so little that the response in it is that at
/// its wavelength, also beside a kink of its table.
const LINE_NM: f64 = 1e-3;

/// Mean photo-electrons per pixel of each channel in one exposure, and whether the manifest
/// determines them.
fn photo_electrons(camera: &Camera, capture: &Capture) -> Result<(Vec<f64>, bool)> {
    let s = &camera.sensor;
    let channels = s.channel_names.len();
    let Some(light) = capture.light.as_ref().filter(|_| capture.role != Role::Dark) else {
        return Ok((vec![0.0; channels], capture.role == Role::Dark));
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
    let width_nm = light.width_nm.unwrap_or(LINE_NM);
    let band = Bands { start_nm: nm, step_nm: width_nm, count: 1 };
    let joule_m2_nm = irradiance / width_nm * capture.exposure_s;
    let electrons: Vec<f64> = s.response(&band).iter().map(|r| r[0] * joule_m2_nm).collect();
    if electrons.iter().all(|&e| e <= 0.0) && irradiance > 0.0 {
        return Err(Error::disagreement(format!(
            "light at {nm} nm, where the camera sees nothing"
        ))
        .help("extend the quantum efficiency in the camera file to that wavelength"));
    }
    Ok((electrons, true))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_numbers_of_long_captures_do_not_overlap() {
        // Captures of up to 10,000 frames begin at successive multiples.
        assert_eq!(first_numbers(&[8, 10_000, 0, 4]).unwrap(), [10_000, 20_000, 30_000, 40_000]);
        // Longer ones shift only those after them.
        let counts = [7, 10_001, 25_000, 3, 10_000];
        let first = first_numbers(&counts).unwrap();
        assert_eq!(first[..2], [10_000, 20_000]);
        for (i, pair) in first.windows(2).enumerate() {
            assert!(pair[0] as usize + counts[i] <= pair[1] as usize, "{first:?}");
        }
        assert!(first_numbers(&[u32::MAX as usize, 1]).is_err());
        assert!(first_numbers(&[usize::MAX, 1]).is_err());
    }
}
