//! Pages of measurements: figures with their standard errors, and the curves they come from.

use super::numbers::{NOT_DETERMINED, amount, number};
use super::page::{Page, Table};
use super::plot::{Colour, Mark, Plot};
use camrig_captures::CaptureSet;
use camrig_measure::{mtf, ptc};
use serde::Serialize;
use serde_json::Value;

/// The page of a photon transfer.
pub fn ptc(set: &CaptureSet, result: &ptc::Ptc) -> Page {
    let mut page = Page::new("Photon transfer");
    page.kind("Measurement");
    captures(&mut page, set);
    notes(&mut page, &result.notes);
    page.heading("All channels");
    figures(&mut page, &result.figures);
    let mut plot = Plot::new("Photon transfer", "signal above dark, DN", "temporal variance, DN²");
    plot.log_x().log_y().note("Variance over signal, one point per capture.");
    for channel in &result.channels {
        let of = |used: bool| {
            let points = channel.curve.iter().filter(|p| p.used == used);
            points.map(|p| [p.signal_dn, p.variance_dn2.value]).collect::<Vec<_>>()
        };
        let (name, colour) = (&channel.channel, Colour::of_channel(&channel.channel));
        plot.series(&format!("{name}, in the fit"), Mark::Points, colour, of(true));
        let left_out = of(false);
        if !left_out.is_empty() {
            plot.series(&format!("{name}, left out"), Mark::Hollow, colour, left_out);
        }
    }
    page.plot(&plot);
    for channel in result.channels.iter().filter(|_| result.channels.len() > 1) {
        page.heading(&format!("Channel {}", channel.channel));
        figures(&mut page, &channel.figures);
    }
    page
}

/// The page of slanted edges.
pub fn mtf(name: &str, edges: &[mtf::Edge]) -> Page {
    let mut page = Page::new("Slanted-edge response");
    page.kind("Measurement");
    page.paragraph(&format!(
        "{name}. Slanted-edge response after ISO 12233:2023 on raw channels."
    ));
    let mut plot = Plot::new("MTF", "spatial frequency, cycles/pixel", "response");
    plot.x_range(0.0, 1.0).limit_x(0.5, "Nyquist");
    plot.note("Spatial frequency response; the pixel's own aperture is part of it.");
    for edge in edges {
        let colour = Colour::of_channel(&edge.channel);
        plot.series(&edge.channel, Mark::Line, colour, edge.curve.clone());
    }
    page.plot(&plot);
    let mut table = Table::new(&["channel"]).numbers(&[
        "MTF50, cycles/pixel",
        "MTF50, cycles/mm",
        "response at Nyquist",
        "edge, °",
    ]);
    table.rows(edges.iter().map(|e| {
        vec![
            e.channel.clone(),
            amount(e.mtf50_cycles_per_pixel, Some(e.mtf50_std_error), ""),
            e.mtf50_cycles_per_mm.map_or_else(String::new, number),
            number(e.mtf_at_nyquist),
            number(e.angle_deg),
        ]
    }));
    page.rows(&table);
    page
}

fn captures(page: &mut Page, set: &CaptureSet) {
    let s = &set.sensor;
    page.paragraph(&format!(
        "{} captures of {} × {} pixels, {} bits.",
        set.captures.len(),
        s.width,
        s.height,
        s.bits
    ));
}

fn notes(page: &mut Page, notes: &[String]) {
    for note in notes {
        page.note(note);
    }
}

/// Table of all fields of a structure that are numbers or values with errors.
fn figures(page: &mut Page, figures: &impl Serialize) {
    let row = |(name, v): (&String, &Value)| {
        let text = match (v.as_f64(), v["value"].as_f64()) {
            (_, Some(value)) => amount(value, v["std_error"].as_f64(), ""),
            (Some(value), None) => number(value),
            _ => NOT_DETERMINED.into(),
        };
        vec![name.clone(), text]
    };
    let mut table = Table::new(&["figure"]).numbers(&["value ± standard error"]);
    if let Ok(Value::Object(map)) = serde_json::to_value(figures) {
        table.rows(map.iter().map(row));
    }
    page.rows(&table);
}
