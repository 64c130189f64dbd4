//! The page of simulated frames: pictures, headroom, levels, and the camera's model.

mod frames;
mod hdr;
mod model;

pub use frames::Frames;

use super::numbers::{self, amount, counted, factor, fixed, number};
use super::page::{KeyFigure, Page, Table, Tone};
use super::plot::{Colour, Plot, Size};
use camrig_camera::Camera;
use camrig_light::Illuminant;
use camrig_sensor_core::config::FrameSettings;
use frames::{Captioned, First, FrameLevels, Levels};
use model::Noise;

/// Part of the samples that headroom leaves out: single bright pixels do not decide it.
const BRIGHTEST: f64 = 0.001;
/// Bins of a histogram.
const BINS: usize = 256;

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
    let light_words = light.map_or_else(String::new, |l| format!(" · {}", l.name));
    let exposure = exposure_words(settings.exposure_s.into());
    page.kind("Simulation");
    page.subtitle(&format!("{}{light_words} · {exposure}", camera.name));
    // Of several captures one system gain and one noise say nothing.
    let plain = camera.sensor.hdr.is_none();
    let noise = plain.then(|| Noise::of(camera, settings.analog_gain.into()));
    let first_levels = frames.levels.first().map(|first| &first.levels);
    if let (Some(first), Some(levels)) = (&frames.first, first_levels) {
        pictures(&mut page, first);
        // Of binned frames the system gain and noise of single pixels say nothing.
        let single = first.sides
            == [camera.sensor.width, camera.sensor.height].map(|n| n as usize)
            && levels.bits == u32::from(camera.sensor.bits);
        let electrons = noise.as_ref().filter(|_| single);
        let exposure_s = plain.then_some(settings.exposure_s.into());
        page.key_figures(&key_figures(levels, electrons, exposure_s));
        samples(&mut page, first, levels);
        table(&mut page, frames, electrons);
        others(&mut page, frames);
        model(&mut page, camera, light, noise.as_ref(), single.then_some(levels));
    } else {
        model(&mut page, camera, light, noise.as_ref(), None);
    }
    hdr::section(&mut page, camera, settings);
    set_up(&mut page, camera, settings, made_of);
    page.folded("Camera file", |page| {
        page.verbatim(&camera.text);
    });
    page
}

fn exposure_words(seconds: f64) -> String {
    match seconds {
        s if s < 1e-3 => amount(s * 1e6, None, "µs"),
        s if s < 1.0 => amount(s * 1e3, None, "ms"),
        s => amount(s, None, "s"),
    }
}

fn pictures(page: &mut Page, first: &First) {
    page.pictures(|page| {
        if let Some(bright) = &first.bright {
            let caption = format!(
                "Preview, brightened {}: the brightest 1 % of the pixels are white. Simple \
                 demosaicing, white balance, sRGB.",
                factor(bright.factor)
            );
            page.thumbnail(&bright.png, "Brightened preview of the frame.", &caption);
        }
        page.thumbnail(
            &first.as_captured,
            "The frame as captured, without brightening.",
            "As captured: white is the white level of the raw samples.",
        );
    });
}

/// The channel whose median is largest: in white light the green one.
fn brightest(levels: &Levels) -> usize {
    let medians = (0..levels.channels.len()).map(|c| levels.quantile(c, 0.5));
    let best = medians.enumerate().fold((0, f64::NEG_INFINITY), |best, (c, median)| {
        if median > best.1 { (c, median) } else { best }
    });
    best.0
}

/// How much brighter the light may be before more than the brightest 0.1 % saturates, EV; none
/// where that is so already, or where nothing is above black.
fn headroom(levels: &Levels) -> Option<f64> {
    let top = levels.quantile_of_all(1.0 - BRIGHTEST);
    let white = f64::from(levels.white);
    let room = (white - levels.black) / (top - levels.black);
    (top > levels.black && top < white).then(|| libm::log2(room))
}

/// Figures of the levels; of a frame with an exposure also how much longer it may be. Codes on a
/// curve do not rise with it.
fn key_figures(levels: &Levels, noise: Option<&Noise>, exposure_s: Option<f64>) -> Vec<KeyFigure> {
    let (room, full) = (headroom(levels), levels.saturated());
    let dark = levels.quantile_of_all(1.0 - BRIGHTEST) <= levels.black;
    let head = match room {
        Some(ev) => KeyFigure::new("Headroom", &format!("{}\u{a0}EV", fixed(ev, 1)))
            .below("from the brightest 0.1 % to the white level"),
        None if dark => {
            KeyFigure::new("Headroom", numbers::NOT_DETERMINED).below("all samples are dark")
        }
        None => KeyFigure::new("Headroom", "none").status(Tone::Bad, "0.1 % or more is saturated"),
    };
    let saturated = KeyFigure::new("Saturated", &format!("{}\u{a0}%", fixed(100.0 * full, 2)))
        .below(&format!("of {} samples", numbers::count(levels.samples())));
    let channel = brightest(levels);
    let median = levels.quantile(channel, 0.5) - levels.black;
    let name = format!("Signal, median of {}", levels.channels[channel]);
    let signal = match noise {
        Some(noise) if median > 0.0 => {
            let e = median / noise.dn_per_e;
            KeyFigure::new(&name, &amount(e, None, "e⁻"))
                .below(&format!("SNR {} per pixel in the model", number(e / noise.sigma(e))))
        }
        _ => KeyFigure::new(&name, &amount(median, None, "DN")).below("above black"),
    };
    let Some(exposure_s) = exposure_s else { return vec![saturated, signal] };
    let used = exposure_words(exposure_s);
    let longest = match room {
        Some(ev) => {
            KeyFigure::new("Longest exposure", &exposure_words(exposure_s * libm::exp2(ev)))
                .below(&format!("before 0.1 % saturates; {used} used"))
        }
        None if dark => KeyFigure::new("Longest exposure", numbers::NOT_DETERMINED)
            .below(&format!("{used} used")),
        None => KeyFigure::new("Longest exposure", &format!("below {used}"))
            .below("0.1 % or more is saturated"),
    };
    vec![head, saturated, signal, longest]
}

fn samples(page: &mut Page, first: &First, levels: &Levels) {
    page.heading("Samples").evidence(
        |page| {
            page.headline(|size| histogram(levels, size));
        },
        |page| {
            page.subheading("Raw samples in the colours of their filters");
            let Captioned { png, caption } = &first.samples;
            page.samples(png, "Raw samples in the middle of the frame.", caption);
        },
    );
}

/// Samples over DN and channel; the bins are whole multiples of 1 DN.
fn histogram(levels: &Levels, size: Size) -> Plot {
    let per_bin = (1usize << levels.bits).div_ceil(BINS);
    let samples = format!("samples per {per_bin} DN");
    let mut plot = Plot::new("Histogram of the raw samples", "level, DN", &samples);
    plot.size(size.high(320.0)).log_y().x_range(0.0, f64::from(1u32 << levels.bits));
    for (c, name) in levels.channels.iter().enumerate() {
        let counts = levels.binned(c, per_bin);
        plot.bins(name, Colour::of_channel(name), [-0.5, per_bin as f64], &counts);
    }
    plot.limit_x(levels.black, "black").limit_x(levels.white.into(), "white");
    plot.note("Empty bins are not drawn.");
    plot
}

fn table(page: &mut Page, frames: &Frames, noise: Option<&Noise>) {
    let mut heads = vec!["mean, DN"];
    if noise.is_some() {
        heads.push("mean, e⁻");
    }
    heads.extend(["1 %, DN", "median, DN", "99 %, DN", "saturated, %", "at or below black, %"]);
    let mut table = Table::new(&["channel"]).numbers(&heads);
    for FrameLevels { name, levels } in &frames.levels {
        table.section(name);
        for (c, channel) in levels.channels.iter().enumerate() {
            let mean = levels.mean(c) - levels.black;
            let mut row = vec![channel.clone(), number(mean)];
            row.extend(noise.map(|n| number(mean / n.dn_per_e)));
            let above = |share: f64| fixed(levels.quantile(c, share) - levels.black, 0);
            row.extend([0.01, 0.5, 0.99].map(above));
            row.extend(levels.at_ends(c).map(|share| fixed(100.0 * share, 2)));
            table.row(row);
        }
    }
    page.rows(&table);
    let shown = frames.levels.len();
    let more = match frames.count - shown {
        0 => String::new(),
        more => format!(" Of {}, the first {shown}.", counted(shown + more, "frame")),
    };
    let electrons = noise.map_or_else(String::new, |n| {
        format!(" Electrons: DN divided by the system gain, {} DN/e⁻.", number(n.dn_per_e))
    });
    page.small(&format!("DN above black.{electrons}{more}"));
}

fn others(page: &mut Page, frames: &Frames) {
    if frames.others.is_empty() {
        return;
    }
    page.heading("Further frames").pictures(|page| {
        for Captioned { png, caption } in &frames.others {
            page.picture(png, caption);
        }
    });
}

fn model(
    page: &mut Page,
    camera: &Camera,
    light: Option<&Illuminant>,
    noise: Option<&Noise>,
    levels: Option<&Levels>,
) {
    page.heading("Model").grid(|page| {
        page.plot(&model::response(camera, light));
        if let Some(noise) = noise {
            page.plot(&model::noise(noise));
            page.plot(&model::snr(noise, levels.map(|l| (l, brightest(l)))));
        }
    });
}

fn set_up(page: &mut Page, camera: &Camera, settings: &FrameSettings, made_of: &[(&str, String)]) {
    let sensor = &camera.sensor;
    let of_sensor = [
        (
            "sensor",
            format!("{} × {} pixels of {} µm", sensor.width, sensor.height, sensor.pitch_um),
        ),
        ("pattern", sensor.cfa.to_string()),
        (
            "levels",
            format!("{} bits, black {}\u{a0}DN", sensor.bits, number(sensor.black_level_dn)),
        ),
        ("exposure", exposure_words(settings.exposure_s.into())),
        ("analog gain", number(settings.analog_gain.into())),
        ("sensor temperature", format!("{}\u{a0}°C", settings.temperature_c)),
        ("sensor seed", sensor.seed.to_string()),
        ("first frame", settings.frame.to_string()),
    ];
    page.heading("Settings").beside(
        |page| {
            page.facts(made_of);
        },
        |page| {
            page.facts(&of_sensor);
        },
    );
}
