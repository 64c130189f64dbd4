//! The page of simulated frames: facts, pictures, levels and the camera model.

use super::numbers::{self, amount, count};
use super::page::{Page, Table};
use super::plot::{Colour, Mark, Plot};
use camrig_base::{RawFrame, Result};
use camrig_camera::Camera;
use camrig_formats::{DngInfo, png, preview};
use camrig_scene::Illuminant;
use camrig_sensor_core::config::FrameSettings;

/// Frames shown as pictures; of all others the page has the figures only.
const SHOWN: usize = 4;
/// Longest side of a picture, pixels.
const PICTURE: usize = 1024;

/// How pictures are made of raw frames.
const WORDS: &str = "simple demosaicing, white balance, sRGB";

/// Pictures and levels, collected frame by frame.
#[derive(Default)]
pub struct Frames {
    shown: Vec<Shown>,
    rows: Vec<Vec<String>>,
}

/// A frame as a page shows it.
struct Shown {
    name: String,
    as_captured: Vec<u8>,
    /// Brightened, and its caption, where that differs.
    bright: Option<(Vec<u8>, String)>,
    histogram: Plot,
}

impl Frames {
    /// Adds a frame.
    ///
    /// # Errors
    /// A picture that cannot be encoded.
    pub fn add(&mut self, name: &str, frame: &RawFrame, info: &DngInfo) -> Result<()> {
        if self.shown.len() < SHOWN {
            let (picture, factor) = preview::bright_thumbnail(frame, info, PICTURE);
            let caption = format!("{WORDS}; {}", preview::brightness_words(factor));
            let bright = png::encode_rgb(&picture)?;
            self.shown.push(Shown {
                name: name.to_string(),
                as_captured: png::encode_rgb(&preview::thumbnail(frame, info, PICTURE))?,
                bright: (factor > 1.0).then_some((bright, caption)),
                histogram: histogram(frame),
            });
        }
        for (channel, mean_dn, saturated) in frame.channel_means() {
            self.rows.push(vec![
                name.to_string(),
                channel,
                numbers::number(mean_dn - frame.black_level_dn),
                numbers::fixed(100.0 * saturated, 2),
            ]);
        }
        Ok(())
    }
}

/// The page.
///
/// `made_of` are names and values of further facts; `settings` are those of the first frame.
pub fn page(
    title: &str,
    camera: &Camera,
    light: Option<&Illuminant>,
    settings: &FrameSettings,
    made_of: &[(&str, String)],
    frames: &Frames,
) -> Page {
    let mut page = Page::new(title);
    page.kind("Simulation");
    let mut facts: Vec<(&str, String)> = made_of.to_vec();
    let sensor = &camera.sensor;
    let fixed = [
        ("exposure", amount(f64::from(settings.exposure_s) * 1e3, None, "ms")),
        ("analog gain", numbers::number(settings.analog_gain.into())),
        ("sensor temperature", format!("{} °C", settings.temperature_c)),
        ("sensor seed", sensor.seed.to_string()),
        ("first frame", settings.frame.to_string()),
        (
            "sensor",
            format!("{} × {} pixels of {} µm", sensor.width, sensor.height, sensor.pitch_um),
        ),
        ("pattern", sensor.cfa.to_string()),
        ("levels", format!("{} bits, black {} DN", sensor.bits, sensor.black_level_dn)),
    ];
    facts.extend(fixed);
    page.facts(&facts);
    for shown in &frames.shown {
        page.heading(&shown.name);
        page.pictures(|page| {
            if let Some((picture, caption)) = &shown.bright {
                page.picture(picture, caption);
            }
            let caption = format!("{WORDS}; {}", preview::brightness_words(1.0));
            page.picture(&shown.as_captured, &caption);
        });
        page.plot(&shown.histogram);
    }
    page.heading("Levels");
    let mut levels =
        Table::new(&["frame", "channel"]).numbers(&["mean above black, DN", "saturated, %"]);
    levels.rows(frames.rows.iter().cloned());
    page.rows(&levels);
    page.heading("Model").grid(|page| {
        page.plot(&response(camera, light)).plot(&noise(camera, settings));
    });
    page.heading("Camera file");
    page.verbatim(&camera.text);
    page
}

/// Counts per DN and channel, in at most 256 bins.
fn histogram(frame: &RawFrame) -> Plot {
    let bins = (1usize << frame.bits.min(8)).max(2);
    let per_bin = (1usize << frame.bits) / bins;
    let channels = frame.cfa.channels();
    let mut counts = vec![vec![0u32; bins]; channels.len()];
    for (y, row) in frame.data.chunks(frame.width).enumerate() {
        for (x, &dn) in row.iter().enumerate() {
            counts[frame.cfa.channel(x, y)][(usize::from(dn) / per_bin).min(bins - 1)] += 1;
        }
    }
    let mut plot = Plot::new("Histogram", "level, DN", &format!("samples per {per_bin} DN"));
    let last = (1u32 << frame.bits) as f64;
    plot.log_y().x_range(0.0, last).limit_x(frame.black_level_dn, "black");
    let samples = count(frame.data.len() as u64);
    plot.note(&format!("{samples} samples, bins of {per_bin} DN; empty bins have no line."));
    for (letter, counts) in channels.iter().zip(counts) {
        let counts: Vec<f64> = counts.into_iter().map(f64::from).collect();
        let colour = Colour::of_channel(&letter.to_string());
        plot.bins(&letter.to_string(), colour, [-0.5, per_bin as f64], &counts);
    }
    plot
}

/// Electrons per photon that enters the lens, and the light, over wavelength.
fn response(camera: &Camera, light: Option<&Illuminant>) -> Plot {
    let sensor = &camera.sensor;
    let nm: Vec<f64> = (380..=780).step_by(5).map(f64::from).collect();
    let mut plot = Plot::new("Response", "wavelength, nm", "electrons per photon, e⁻");
    plot.note("Quantum efficiency with filters and lens.");
    for (name, qe) in sensor.channel_names.iter().zip(&sensor.qe) {
        let at = |&w: &f64| {
            let filter = sensor.ir_cut.as_ref().map_or(1.0, |f| f.at(w));
            [w, qe.at(w) * filter * camera.lens.transmittance.at(w)]
        };
        let points = nm.iter().map(at).collect();
        plot.series(&name.to_uppercase(), Mark::Line, Colour::of_channel(name), points);
    }
    if let Some(light) = light {
        let most = nm.iter().map(|&w| light.power.at(w)).fold(0.0, f64::max);
        let peak = sensor.qe.iter().flat_map(|q| nm.iter().map(|&w| q.at(w))).fold(0.0, f64::max);
        let points = nm.iter().map(|&w| [w, peak * light.power.at(w) / most]).collect();
        let label = format!("{}, scaled", light.name);
        plot.series(&label, Mark::Dashed, Colour::Reference, points);
    }
    plot
}

/// Standard deviations over signal, both in e⁻: eq. 10 of Chen et al. 2009 without row pattern and
/// DSNU, with the quantisation of the converter.
fn noise(camera: &Camera, settings: &FrameSettings) -> Plot {
    let (sensor, gain) = (&camera.sensor, f64::from(settings.analog_gain));
    let noise = &sensor.noise;
    let post = noise.read_e_post * noise.read_e_post;
    let e_per_dn = sensor.full_well_e / (gain * f64::from((1u32 << sensor.bits) - 1));
    let read2 =
        noise.read_e * noise.read_e - post + post / (gain * gain) + e_per_dn * e_per_dn / 12.0;
    let signals: Vec<f64> = (0..=60)
        .map(|i| libm::pow(sensor.full_well_e, f64::from(i) / 60.0))
        .filter(|s| *s >= 1.0)
        .collect();
    let mut plot = Plot::new("Noise", "signal, e⁻", "standard deviation, e⁻");
    plot.log_x().log_y().note(
        "The base model's temporal and fixed noise of a pixel, before the effects of the camera \
         file.",
    );
    let mut curve = |name: &str, mark: Mark, colour: Colour, sigma: &dyn Fn(f64) -> f64| {
        let points = signals.iter().map(|&s| [s, sigma(s)]).collect();
        plot.series(name, mark, colour, points);
    };
    let all = |s: f64| (read2 + s + (noise.prnu * s).powi(2)).sqrt();
    curve("all", Mark::Line, Colour::Measured, &all);
    curve("shot", Mark::Dashed, Colour::Series(0), &|s| s.sqrt());
    curve("read and converter", Mark::Dashed, Colour::Series(1), &|_| read2.sqrt());
    curve("PRNU", Mark::Dashed, Colour::Series(2), &|s| noise.prnu * s);
    plot
}
