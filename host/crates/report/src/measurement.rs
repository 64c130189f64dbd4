//! Pages of measurements: figures with their standard errors, and the curves they come from.

use super::emva::capitalised;
use super::numbers::{NOT_DETERMINED, amount, counted, number, with_error};
use super::page::{KeyFigure, Page, Table, Tone};
use super::plot::{Colour, Mark, Plot};
use camrig_captures::CaptureSet;
use camrig_measure::Value;
use camrig_measure::{mtf, ptc};
use serde_json::Value as Json;
use std::path::Path;

/// Frequency up to which responses are drawn, cycles/pixel.
const HIGHEST: f64 = 1.0;
/// Height of the plot of a response over its largest value.
const ABOVE: f64 = 1.1;
/// Part of an edge's profile that is drawn, pixels to each side: beyond it is noise alone.
const BESIDE_EDGE: f64 = 12.0;
/// Standard errors that a band reaches on each side.
const BAND: f64 = 2.0;

/// The page of a photon transfer.
pub fn ptc(set: &CaptureSet, result: &ptc::Ptc) -> Page {
    let mut page = Page::new("Photon transfer");
    let s = &set.sensor;
    page.kind("Measurement").subtitle(&format!(
        "{}{}: {} of {} × {} pixels, {} bits, analog gain {}",
        set.name(),
        set.camera.as_ref().map_or_else(String::new, |camera| format!(" of {}", stem(camera))),
        counted(set.captures.len(), "capture"),
        s.width,
        s.height,
        s.bits,
        number(result.analog_gain)
    ));
    let all = &result.figures;
    let card = |name: &str, value: &Option<Value>, unit: &str| {
        let text = value.as_ref().map(|v| amount(v.value, Some(v.std_error), unit));
        KeyFigure::new(name, &text.unwrap_or_else(|| NOT_DETERMINED.into())).below("all channels")
    };
    page.key_figures(&[
        card("System gain", &all.system_gain_dn_per_e, "DN/e⁻"),
        card("Read noise", &all.read_noise_e, "e⁻"),
        card("Full well", &all.full_well_e, "e⁻"),
        card("Dark current", &all.dark_current_e_per_s, "e⁻/s"),
    ]);
    for note in &result.notes {
        page.note(&format!("{}.", capitalised(note)));
    }
    page.heading("Photon transfer").plot(&transfer(result)).rows(&figures(result));
    page.small("Value ± standard error. All: mean of the channels, weighted by their errors.");
    page
}

/// The page of a camera file that was fitted to captures: `values` has, by key, objects with
/// `value`, `std_error`, `unit`, `grade` and `basis`; `gap` is that on held-out frames, and its limit.
pub fn camera(
    name: &str,
    values: &serde_json::Map<String, Json>,
    notes: &[String],
    gap: Option<[f64; 2]>,
) -> Page {
    let mut page = Page::new(name);
    page.kind("Camera file").subtitle("Values measured on captures, with their sources");
    let text = |own: &Json| {
        let unit = own["unit"].as_str().unwrap_or_default();
        let unit = if unit == "1" { "" } else { unit };
        match own["value"].as_f64() {
            Some(value) => amount(value, own["std_error"].as_f64(), unit),
            None => own["value"].as_str().map_or_else(|| own["value"].to_string(), str::to_string),
        }
    };
    let card = |name: &str, key: &str| {
        KeyFigure::new(name, &values.get(key).map_or_else(|| NOT_DETERMINED.into(), text))
    };
    page.key_figures(&[
        card("Full well", "sensor.full_well_e"),
        card("Read noise", "sensor.noise.read_e"),
        card("Dark current", "sensor.noise.dark_current_e_per_s"),
        card("PRNU", "sensor.noise.prnu"),
    ]);
    if let Some([gap, limit]) = gap {
        let (tone, word) = match gap <= limit {
            true => (Tone::Good, "passes"),
            false => (Tone::Bad, "incomplete"),
        };
        let told = format!(
            "The gap to held-out frames is {} (1 for the true model; limit {}).",
            number(gap),
            number(limit)
        );
        page.verdict(tone, word, &told);
    }
    for note in notes {
        page.note(&format!("{}.", capitalised(note)));
    }
    let mut table = Table::new(&["key", "value", "grade", "basis"]);
    for (key, own) in values {
        let word = |field: &str| own[field].as_str().unwrap_or_default().to_string();
        table.row(vec![key.clone(), text(own), word("grade"), word("basis")]);
    }
    page.heading("Values").rows(&table);
    page
}

/// The name of a camera's file.
fn stem(camera: &Path) -> String {
    camera.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
}

fn transfer(result: &ptc::Ptc) -> Plot {
    let mut plot = Plot::new("Photon transfer", "signal above dark, DN", "temporal variance, DN²");
    plot.log_x().log_y();
    let mut left_out = Vec::new();
    for channel in &result.channels {
        let of = |used: bool| {
            let points = channel.curve.iter().filter(move |p| p.used == used);
            points.map(|p| [p.signal_dn, p.variance_dn2.value, p.variance_dn2.std_error])
        };
        let (name, colour) = (&channel.channel, Colour::of_channel(&channel.channel));
        let points: Vec<[f64; 3]> = of(true).collect();
        plot.with_errors(&capitalised(name), Mark::Points, colour, &points);
        left_out.extend(of(false).map(|p| [p[0], p[1]]));
    }
    let rest = if left_out.is_empty() { "" } else { " Rings: not used in the fit." };
    if !left_out.is_empty() {
        plot.series("not used", Mark::Hollow, Colour::Reference, left_out);
    }
    plot.note(&format!("One dot per capture, with an error bar of one standard error.{rest}"));
    plot
}

/// Takes a figure from all of a channel or of the sensor.
type Take = fn(&ptc::Figures) -> &Option<Value>;

const FIGURES: [(&str, &str, Take); 17] = [
    ("System gain", "DN/e⁻", |f| &f.system_gain_dn_per_e),
    ("Read noise", "e⁻", |f| &f.read_noise_e),
    ("Full well", "e⁻", |f| &f.full_well_e),
    ("Quantum efficiency", "e⁻/photon", |f| &f.quantum_efficiency),
    ("Black level", "DN", |f| &f.black_level_dn),
    ("Nonlinearity", "%", |f| &f.nonlinearity_percent),
    ("PRNU", "1", |f| &f.prnu),
    ("DSNU", "e⁻", |f| &f.dsnu_e),
    ("Dark current, from means", "e⁻/s", |f| &f.dark_current_e_per_s),
    ("Hot pixels, share", "", |f| &f.hot_pixel_fraction),
    ("Hot pixels, mean dark current", "e⁻/s", |f| &f.hot_pixel_mean_e_per_s),
    ("Dark current, from variances", "e⁻/s", |f| &f.dark_current_from_variance_e_per_s),
    ("Dark current non-uniformity", "e⁻/s", |f| &f.dsnu_e_per_s),
    ("Dark current doubles every", "°C", |f| &f.dark_doubling_c),
    ("Pixel fixed-pattern noise", "e⁻", |f| &f.pixel_fpn_e),
    ("Row fixed-pattern noise", "e⁻", |f| &f.row_fpn_e),
    ("Column fixed-pattern noise", "e⁻", |f| &f.column_fpn_e),
];

/// A row per figure, a column for all and one per channel.
fn figures(result: &ptc::Ptc) -> Table {
    let mut heads = vec!["all".to_owned()];
    let mut columns = vec![&result.figures];
    if result.channels.len() > 1 {
        heads.extend(result.channels.iter().map(|c| capitalised(&c.channel)));
        columns.extend(result.channels.iter().map(|c| &c.figures));
    }
    let heads: Vec<&str> = heads.iter().map(String::as_str).collect();
    let mut table = Table::new(&["figure", "unit"]).numbers(&heads);
    for (name, unit, take) in FIGURES {
        let cell = |figures: &&ptc::Figures| match take(figures) {
            Some(v) => with_error(v.value, Some(v.std_error)),
            None => NOT_DETERMINED.into(),
        };
        let mut row = vec![name.to_owned(), unit.to_owned()];
        row.extend(columns.iter().map(cell));
        table.row(row);
    }
    table
}

/// The page of slanted edges.
pub fn mtf(name: &str, found: &mtf::Responses) -> Page {
    let edges = &found.edges;
    let mut page = Page::new("Slanted-edge response");
    page.kind("Measurement")
        .subtitle(&format!("{name} · ISO 12233:2023, applied to raw channels"));
    // Of several edges, those nearest the centre.
    let nearest = edges.iter().map(|e| e.field).fold(f64::INFINITY, f64::min);
    let central = edges.iter().filter(|e| e.field == nearest);
    let cards: Vec<KeyFigure> = central.map(card).collect();
    page.key_figures(&cards);
    page.heading("Response").grid(|page| {
        page.plot(&response(edges)).plot(&spread(edges));
    });
    let mut table = Table::new(&["edge", "across"]).numbers(&[
        "field, 1",
        "x, pixels",
        "y, pixels",
        "MTF50, cycles/pixel",
        "MTF50, cycles/mm",
        "response at Nyquist",
        "angle of the edge, °",
        "dark side, DN",
        "bright side, DN",
        "frames",
        "spread between frames, cycles/pixel",
    ]);
    table.rows(edges.iter().zip(names(edges)).map(|(e, name)| {
        let of_value = |v: Value| with_error(v.value, Some(v.std_error));
        vec![
            name,
            e.direction.name().into(),
            format!("{:.2}", e.field),
            format!("{:.0}", e.position[0]),
            format!("{:.0}", e.position[1]),
            of_value(e.mtf50_cycles_per_pixel),
            e.mtf50_cycles_per_mm.map_or_else(|| "unknown pitch".into(), of_value),
            e.mtf_at_nyquist.map_or_else(|| NOT_DETERMINED.into(), of_value),
            number(e.angle_deg),
            number(e.levels_dn[0]),
            number(e.levels_dn[1]),
            e.frames.to_string(),
            e.mtf50_frame_spread.map_or_else(|| "one frame".into(), number),
        ]
    }));
    page.rows(&table);
    for mtf::Excluded { channel, roi, reason } in &found.excluded {
        let mtf::Roi { x, y, width, height } = roi;
        let channel = capitalised(channel);
        page.note(&format!("{channel} at {x},{y},{width},{height} has no response: {reason}."));
    }
    page.small(
        "Value ± standard error: of a response from a jackknife over tenths of the rows, of MTF50 \
         from that or the noise of the sides over the slope of the response, or from the spread \
         between frames, whichever is largest. Field: distance from the centre divided by half the \
         diagonal; x to the right and y down from the centre.",
    );
    page
}

/// A name of each edge: its channel, with the number of its region where there are several.
fn names(edges: &[mtf::Edge]) -> Vec<String> {
    let mut regions: Vec<mtf::Roi> = Vec::new();
    for edge in edges {
        if !regions.contains(&edge.roi) {
            regions.push(edge.roi);
        }
    }
    let number = |roi| regions.iter().position(|r| *r == roi).map_or(0, |i| i + 1);
    let name = |edge: &mtf::Edge| match regions.len() {
        1 => capitalised(&edge.channel),
        _ => format!("{} {}", capitalised(&edge.channel), number(edge.roi)),
    };
    edges.iter().map(name).collect()
}

fn card(edge: &mtf::Edge) -> KeyFigure {
    let text = |v: Value, unit| amount(v.value, Some(v.std_error), unit);
    let name = format!("MTF50, {}", capitalised(&edge.channel));
    let card = KeyFigure::new(&name, &text(edge.mtf50_cycles_per_pixel, "cycles/pixel"));
    match edge.mtf50_cycles_per_mm {
        Some(per_mm) => card.below(&text(per_mm, "cycles/mm")),
        None => card,
    }
}

fn response(edges: &[mtf::Edge]) -> Plot {
    let mut plot = Plot::new("MTF", "spatial frequency, cycles/pixel", "response, 1");
    let responses = edges.iter().flat_map(|e| &e.curve).map(|p| p[1]);
    let top = responses.fold(1.0, f64::max);
    plot.x_range(0.0, HIGHEST)
        .y_range(0.0, ABOVE * top)
        .limit_x(0.5, "Nyquist")
        .limit_y(0.5, "MTF50");
    for edge in edges {
        let band = edge.curve.iter().zip(&edge.curve_std_error);
        let band = band.map(|(p, e)| [p[0], (p[1] - BAND * e).max(0.0), p[1] + BAND * e]);
        plot.band("", Colour::of_channel(&edge.channel), band.collect());
    }
    for (edge, name) in edges.iter().zip(names(edges)) {
        let colour = Colour::of_channel(&edge.channel);
        plot.series(&name, Mark::Line, colour, edge.curve.clone());
    }
    plot.note(
        "Includes the pixel aperture. Bands: two standard errors. Nyquist frequency of the pixel \
         grid.",
    );
    plot
}

fn spread(edges: &[mtf::Edge]) -> Plot {
    let mut plot =
        Plot::new("Edge spread function", "distance from the edge, pixels", "level, DN");
    for (edge, name) in edges.iter().zip(names(edges)) {
        let colour = Colour::of_channel(&edge.channel);
        plot.series(&name, Mark::Line, colour, edge.spread.clone());
    }
    plot.x_range(-BESIDE_EDGE, BESIDE_EDGE);
    plot.note("Samples along the edge normal, in bins of a quarter of the channel's pitch.");
    plot
}
