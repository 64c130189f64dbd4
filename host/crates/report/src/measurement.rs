//! Pages of measurements: figures with their standard errors, and the curves they come from.

use super::page::Page;
use super::plot::{Mark, Plot};
use camrig_captures::CaptureSet;
use camrig_measure::{mtf, ptc};
use serde::Serialize;
use serde_json::Value;

/// The page of a photon transfer.
pub fn ptc(set: &CaptureSet, result: &ptc::Ptc) -> Page {
    let mut page = Page::new("camrig measure ptc");
    captures(&mut page, set);
    notes(&mut page, &result.notes);
    page.heading("All channels");
    figures(&mut page, &result.figures);
    let mut plot = Plot::new("Photon transfer", "signal above dark, DN", "temporal variance, DN²");
    plot.log_x().log_y();
    for channel in &result.channels {
        let of = |used: bool| {
            let points = channel.curve.iter().filter(|p| p.used == used);
            points.map(|p| [p.signal_dn, p.variance_dn2.value]).collect::<Vec<_>>()
        };
        plot.series(&format!("{}, in the fit", channel.channel), Mark::Points, of(true));
        let left_out = of(false);
        if !left_out.is_empty() {
            plot.coloured(
                &format!("{}, left out", channel.channel),
                Mark::Points,
                left_out,
                "#7f7f7f",
            );
        }
    }
    page.drawing(&plot.svg(), "variance over signal, one point per capture");
    for channel in result.channels.iter().filter(|_| result.channels.len() > 1) {
        page.heading(&format!("Channel {}", channel.channel));
        figures(&mut page, &channel.figures);
    }
    page
}

/// The page of slanted edges.
pub fn mtf(name: &str, edges: &[mtf::Edge]) -> Page {
    let mut page = Page::new("camrig measure mtf");
    page.paragraph(&format!(
        "{name}. Slanted-edge response after ISO 12233:2023 on raw channels."
    ));
    let mut plot = Plot::new("MTF", "cycles per pixel", "response");
    plot.x_range(0.0, 1.0);
    for edge in edges {
        plot.series(&edge.channel, Mark::Line, edge.curve.clone());
    }
    page.drawing(
        &plot.svg(),
        "spatial frequency response; the pixel's own aperture is part of it",
    );
    let rows: Vec<Vec<String>> = edges
        .iter()
        .map(|e| {
            vec![
                e.channel.clone(),
                format!("{:.4} ± {:.4}", e.mtf50_cycles_per_pixel, e.mtf50_std_error),
                e.mtf50_cycles_per_mm.map_or_else(String::new, |v| format!("{v:.2}")),
                format!("{:.3}", e.mtf_at_nyquist),
                format!("{:.2}", e.angle_deg),
            ]
        })
        .collect();
    let header = ["channel", "MTF50, cycles/pixel", "cycles/mm", "at Nyquist", "edge, degrees"];
    page.table(&header, &rows);
    page
}

fn captures(page: &mut Page, set: &CaptureSet) {
    let s = &set.sensor;
    page.paragraph(&format!(
        "{} captures of {} x {} pixels, {} bits.",
        set.captures.len(),
        s.width,
        s.height,
        s.bits
    ));
}

fn notes(page: &mut Page, notes: &[String]) {
    for note in notes {
        page.paragraph(&format!("Note: {note}"));
    }
}

/// Table of all fields of a structure that are numbers or values with errors; the latter are
/// rounded to the two leading digits of the error.
fn figures(page: &mut Page, figures: &impl Serialize) {
    let row = |(name, v): (&String, &Value)| {
        let (value, error) = match (v.as_f64(), v["value"].as_f64(), v["std_error"].as_f64()) {
            (_, Some(value), Some(error)) if error > 0.0 => {
                let digits = (1.0 - error.log10().floor()).clamp(0.0, 9.0) as usize;
                (format!("{value:.digits$}"), format!("{error:.digits$}"))
            }
            (Some(value), ..) | (_, Some(value), _) => (format!("{value:.6}"), String::new()),
            _ => ("not determined".into(), String::new()),
        };
        vec![name.clone(), value, error]
    };
    let rows: Vec<Vec<String>> = match serde_json::to_value(figures) {
        Ok(Value::Object(map)) => map.iter().map(row).collect(),
        _ => Vec::new(),
    };
    page.table(&["figure", "value", "standard error"], &rows);
}
