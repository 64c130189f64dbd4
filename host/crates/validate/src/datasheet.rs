//! The figures of a camera's data sheet, measured on simulated captures like on real ones: EMVA
//! 1288, quantum efficiency through narrow-band filters, MTF, positional crosstalk.

use camrig_base::{Error, Plane, RawFrame, Result};
use camrig_camera::Camera;
use camrig_capture::{bench, plan, take};
use camrig_captures::{CaptureSet, Role};
use camrig_measure::contrast::{self, Noise, Wanted};
use camrig_measure::crosstalk::{self, Crosstalk};
use camrig_measure::ladder::{Level, photons};
use camrig_measure::mtf::{self, Edge, Roi};
use camrig_measure::stack::Stack;
use camrig_measure::{Value, emva};
use camrig_optics::Options;
use camrig_render::{SceneIrradiance, SceneLight, SimulatedSensor, scene_irradiance};
use std::path::Path;

/// The figures.
pub struct Datasheet {
    /// EMVA 1288 at 550 nm.
    pub emva: emva::Checked,
    /// Channel letters of [`Datasheet::efficiency`], lower case.
    pub channels: Vec<String>,
    /// Quantum efficiency by wavelength.
    pub efficiency: Vec<Efficiency>,
    /// Edge in the middle of the image, per channel.
    pub edges: Vec<Edge>,
    /// The table of factors, where the camera has any positional crosstalk.
    pub crosstalk: Option<Crosstalk>,
    /// Notes on the light of the edge, the lens and the camera's tables.
    pub notes: Vec<String>,
}

/// Quantum efficiency at a wavelength.
pub struct Efficiency {
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Electrons per photon of each channel.
    pub channels: Vec<Value>,
}

/// Columns and rows of the frame with the edge, and of the region measured. Long along the edge
/// and narrow across it: far from the edge there is only noise.
const EDGE_FRAME: (u32, u32) = (96, 320);
const EDGE_REGION: (usize, usize) = (64, 288);

/// Illuminance of the edge, lx; the exposure is adapted, so this only sets the start of the search.
const EDGE_LUX: f64 = 300.0;

/// Range of the search for the edge's exposure, s.
const FIRST_EXPOSURE_S: f64 = 1e-3;
const MAX_EXPOSURE_S: f64 = 10.0;
/// Target for the signal of the edge's bright side as a fraction of the range, and the smallest
/// that is accepted: noise decreases with light, and nothing saturates.
const FILL: f64 = 0.5;
const MIN_FILL: f64 = 0.3;
/// Smallest and largest ratio of successive exposures of the search: it must proceed where the
/// signal is hidden by rounding, and must not overshoot where a dark frame is uninformative.
const MIN_STEP: f64 = 1.5;
const MAX_STEP: f64 = 20.0;

/// Frames per point of the crosstalk bench.
const BENCH_FRAMES: u32 = 16;

impl Datasheet {
    /// Measures a camera on a sensor of its pixels, at most `size` large.
    ///
    /// # Errors
    /// Cameras that cannot take the captures (blind at 550 nm, a lens that cannot be read).
    pub fn measure(camera: &Camera, size: (u32, u32)) -> Result<Self> {
        let small = cropped(camera, size);
        let folder = tempfile::tempdir()
            .map_err(|e| Error::io("write a folder in", &std::env::temp_dir(), e))?;
        let emva = {
            let set = taken(&small, &plan::load("emva")?, &folder.path().join("emva"))?;
            emva::measure(&set)?
        };
        let set = taken(&small, &plan::parse(&filters())?, &folder.path().join("filters"))?;
        let efficiency = efficiency(&set, &emva)?;
        let channels = emva.channels.iter().map(|c| c.channel.clone()).collect();
        let crosstalk = match camera.sensor.crosstalk {
            Some(_) => {
                let out = folder.path().join("bench");
                bench::bench(&small, BENCH_FRAMES, 0.01, &out, false, 0, || ())?;
                Some(crosstalk::fit(&CaptureSet::load(&out)?)?)
            }
            None => None,
        };
        let (edges, notes) = edges(camera)?;
        Ok(Self { emva, channels, efficiency, edges, crosstalk, notes })
    }
}

/// Tolerance ε of the contrasts of a data sheet.
pub const CONTRAST_TOLERANCE: f64 = 0.5;

/// Contrast transfer accuracy (IEEE 2020) of single pixels over the whole frame, predicted from
/// the gain, temporal and fixed-pattern noise of EMVA 1288: of a Weber contrast to a dark patch of
/// `dark_e` electrons, both below saturation.
///
/// # Errors
/// A contrast that is not positive.
pub fn contrast_transfer(
    channel: &emva::ChannelEmva,
    black_dn: f64,
    dark_e: f64,
    contrast: f64,
) -> Result<Option<f64>> {
    let wanted = Wanted::new(contrast, CONTRAST_TOLERANCE)?;
    let f = &channel.figures;
    let bright_e = dark_e * (1.0 + contrast);
    let (Some(read_e), Some(dsnu_e), Some(prnu_percent)) =
        (f.temporal_dark_noise_e, f.dsnu_1288_e, f.prnu_1288_percent)
    else {
        return Ok(None);
    };
    let (Some(k), Some(capacity_e)) = (small_signal_gain(f), f.saturation_capacity_e) else {
        return Ok(None);
    };
    let (k, read_e) = (k.value, read_e.value);
    let noise = |signal_e: f64| {
        let fixed = libm::hypot(dsnu_e.value, 0.01 * prnu_percent.value * signal_e);
        let sd_dn = k * (read_e * read_e + signal_e + fixed * fixed).sqrt();
        Noise { mean_dn: k * signal_e, sd_dn }
    };
    let below = bright_e < capacity_e.value;
    Ok(below.then(|| contrast::of_noise(noise(bright_e), noise(dark_e), black_dn, wanted)))
}

/// K at small signals where that is determined, else the standard's, DN/e⁻.
fn small_signal_gain(figures: &emva::Figures) -> Option<Value> {
    figures.linearised_system_gain.or(figures.overall_system_gain)
}

/// The camera with the middle of its sensor only.
fn cropped(camera: &Camera, (width, height): (u32, u32)) -> Camera {
    let mut small = camera.clone();
    small.sensor.width = width.min(camera.sensor.width);
    small.sensor.height = height.min(camera.sensor.height);
    small
}

fn taken(camera: &Camera, shots: &[plan::Shot], out: &Path) -> Result<CaptureSet> {
    take::take(camera, shots, out, &take::TakeOptions::default(), || ())?;
    CaptureSet::load(out)
}

/// A dark and flats through the filters of the crosstalk experiment.
fn filters() -> String {
    let mut text = String::from(
        "format = \"plan/1\"\n[[stack]]\nid = \"dark\"\nrole = \"dark\"\nframes = 16\n\
         exposure_s = 0.01\n",
    );
    for nm in bench::FILTERS_NM {
        text.push_str(&format!(
            "[[stack]]\nid = \"flat-{nm}\"\nrole = \"flat\"\nframes = 16\nexposure_s = 0.01\n\
             fill = 0.5\n\
             light = {{ wavelength_nm = {nm:?}, width_nm = 10.0 }}\n"
        ));
    }
    text
}

/// Electrons per photon: signal above dark over K and photons, with the K of the small-signal
/// photon transfer.
fn efficiency(set: &CaptureSet, emva: &emva::Checked) -> Result<Vec<Efficiency>> {
    let level = |c| Ok::<_, Error>(Level::new(set, c, &Stack::read_moments(set, c)?));
    let none = || Error::input("no dark captures");
    let dark = level(set.with_role(Role::Dark).next().ok_or_else(none)?)?;
    let mut out = Vec::new();
    for capture in set.with_role(Role::Flat) {
        let (Some(light), Some(photons)) = (&capture.light, photons(set, capture)) else {
            continue;
        };
        let flat = level(capture)?;
        let of = |(c, channel): (usize, &emva::ChannelEmva)| {
            let (f, d) = (&flat.channels[c], &dark.channels[c]);
            let signal =
                Value::new(f.mean() - d.mean(), libm::hypot(f.mean_error(), d.mean_error()));
            let gain = small_signal_gain(&channel.figures);
            gain.map_or(Value::chosen(f64::NAN), |k| signal.over(k).scaled(1.0 / photons))
        };
        let channels = emva.channels.iter().enumerate().map(of).collect();
        out.push(Efficiency { wavelength_nm: light.wavelength_nm.unwrap_or(0.0), channels });
    }
    Ok(out)
}

/// The edge under D65 in the middle of the image, every channel, exposed to half of saturation; and
/// notes on it.
fn edges(camera: &Camera) -> Result<(Vec<Edge>, Vec<String>)> {
    let camera = cropped(camera, EDGE_FRAME);
    let light = SceneLight::lux("D65", EDGE_LUX);
    let options = Options::default();
    let SceneIrradiance { cube, notes, .. } =
        scene_irradiance(&camera, "slanted-edge", &light, &options, |_, _| ())?;
    let sensor = SimulatedSensor::new(&camera, &cube.header)?;
    let frame = |seconds: f64| -> Result<RawFrame> {
        let settings = camera.settings(0, seconds, Some(1.0));
        sensor.frame(&cube, &settings)
    };
    // Exposure by search: the brightest hundredth of the samples at half of the range.
    let mut seconds = FIRST_EXPOSURE_S;
    let frame = loop {
        let frame = frame(seconds)?;
        let mut sorted = frame.data.clone();
        sorted.sort_unstable();
        let bright = f64::from(sorted[sorted.len() * 99 / 100]) - frame.black_level_dn;
        let range = f64::from(frame.white_level_dn) - frame.black_level_dn;
        if bright > MIN_FILL * range || seconds > MAX_EXPOSURE_S {
            break frame;
        }
        seconds *= (FILL * range / bright.max(1.0)).clamp(MIN_STEP, MAX_STEP);
    };
    let (width, height) = (EDGE_REGION.0.min(frame.width), EDGE_REGION.1.min(frame.height));
    let (x, y) = ((frame.width - width) / 2, (frame.height - height) / 2);
    let roi = Roi { x, y, width, height };
    let plane = Plane { width: frame.width, height: frame.height, data: frame.data.clone() };
    let (white, pitch) = (Some(frame.white_level_dn), Some(camera.sensor.pitch_um));
    let edges: Result<Vec<Edge>> = frame
        .cfa
        .channels()
        .iter()
        .map(|&letter| mtf::measure(&plane, &frame.cfa, letter, roi, white, pitch))
        .collect();
    Ok((edges?, notes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::{Bands, Spectrum, weighted_means};

    /// The sheet agrees with the camera file.
    #[test]
    fn a_sheet_of_a_preset() {
        let camera = Camera::load("mt9v024").unwrap();
        let sheet = Datasheet::measure(&camera, (128, 96)).unwrap();
        assert_eq!(sheet.channels, ["r", "g", "b"]);
        for Efficiency { wavelength_nm: nm, channels } in &sheet.efficiency {
            for (value, curve) in channels.iter().zip(&camera.sensor.qe) {
                // Per photon on the whole pixel, the mean over a band of 10 nm of even power.
                let band = Bands { start_nm: *nm, step_nm: 10.0, count: 1 };
                let curves: Vec<&Spectrum> =
                    std::iter::once(curve).chain(&camera.sensor.ir_cut).collect();
                let efficiency = weighted_means(&curves, &[&Spectrum::wavelength()], &band)[0];
                let truth = efficiency * camera.sensor.fill_factor;
                let off = (value.value - truth).abs();
                assert!(off < 4.0 * value.std_error + 0.01 * truth, "{nm} nm: {value:?}, {truth}");
            }
        }
        let green = &sheet.emva.channels[1].figures;
        let read = camera.sensor.noise.read_e;
        assert!((green.temporal_dark_noise_e.unwrap().value / read - 1.0).abs() < 0.05);
        // A contrast of 1 to 1000 e⁻ is 1000 ± 500 e⁻ in a noise of some 60 e⁻; one of 0.1 to
        // 30 e⁻ is 3 ± 1.5 e⁻ in a noise of at least 8 e⁻.
        let cta = |e, k| contrast_transfer(&sheet.emva.channels[1], 64.0, e, k).unwrap();
        assert!(cta(1000.0, 1.0).unwrap() > 0.999);
        assert!((0.5..1.0).contains(&cta(300.0, 0.3).unwrap()));
        assert!(cta(30.0, 0.1).unwrap() < 0.2);
        assert_eq!(cta(1e6, 1.0), None);
        assert_eq!(sheet.edges.len(), 3);
        assert!(sheet.edges.iter().all(|e| {
            let mtf50 = e.mtf50_cycles_per_pixel;
            mtf50.std_error < 0.05 * mtf50.value
        }));
    }
}
