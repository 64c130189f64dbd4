//! The data sheet of a camera as a page.

use super::emva;
use super::numbers::{NOT_DETERMINED, amount, number};
use super::page::{Page, Table};
use super::plot::{Colour, Mark, Plot};
use camrig_camera::Camera;
use camrig_measure::Value;
use camrig_measure::crosstalk::Crosstalk;
use camrig_validate::datasheet::{CONTRAST_TOLERANCE, Datasheet, contrast_transfer};

/// The data sheet of a camera: its file's facts, the figures measured on simulated captures,
/// plots.
pub fn page(camera: &Camera, sheet: &Datasheet) -> String {
    let mut page = Page::new(&format!("{} · data sheet", camera.name));
    page.kind("Data sheet").subtitle(
        "EMVA Standard 1288, release 4.0 linear · measured on simulated captures, with their \
         sampling errors",
    );
    let mut facts = emva::operating_point(&sheet.emva.conditions, "simulated captures");
    facts.retain(|fact| fact.0 != "Camera");
    facts.insert(0, ("Camera", camera.name.clone()));
    emva::first_sheet(&mut page, &sheet.emva, &facts);
    page.heading_on_new_sheet("Quantum efficiency, and MTF at the centre of the image").grid(
        |page| {
            page.plot(&efficiency(sheet)).plot(&transfer(sheet));
        },
    );
    let mut edges = Table::new(&["channel"]).numbers(&[
        "MTF50, cycles/pixel",
        "MTF50, cycles/mm",
        "response at Nyquist",
    ]);
    let of_value = |v: Value| amount(v.value, Some(v.std_error), "");
    edges.rows(sheet.edges.iter().map(|e| {
        vec![
            e.channel.to_uppercase(),
            of_value(e.mtf50_cycles_per_pixel),
            e.mtf50_cycles_per_mm.map_or(String::new(), of_value),
            e.mtf_at_nyquist.map_or_else(|| NOT_DETERMINED.into(), of_value),
        ]
    }));
    page.rows(&edges);
    contrast(&mut page, camera, sheet);
    page.heading("Positional crosstalk");
    match &sheet.crosstalk {
        Some(crosstalk) => {
            page.paragraph(
                "Mean factor at the four corners of the image, relative to its centre.",
            );
            let mut table = Table::new(&["channel"]).numbers(&["wavelength, nm", "corner factor"]);
            table.rows(corners(crosstalk));
            page.rows(&table);
        }
        None => {
            page.paragraph("This camera file has no crosstalk table.");
        }
    }
    page.heading("Plots of the standard").grid(|page| emva::plots(page, &sheet.emva));
    page.heading("Further figures").rows(&emva::further(&sheet.emva.channels));
    emva::further_remarks(&mut page, &sheet.emva);
    page.html()
}

/// Dark signals, e⁻, and contrasts of the table of contrast transfer.
const DARK_E: [f64; 6] = [10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0];
const CONTRASTS: [f64; 4] = [0.1, 0.3, 1.0, 3.0];

/// Contrast transfer accuracy of the channel with most light.
fn contrast(page: &mut Page, camera: &Camera, sheet: &Datasheet) {
    let light = |c: &&camrig_measure::emva::ChannelEmva| {
        c.levels.iter().map(|level| level.signal_dn).sum::<f64>()
    };
    let most = sheet.emva.channels.iter().max_by(|a, b| light(a).total_cmp(&light(b)));
    let Some(channel) = most else { return };
    page.heading("Contrast transfer accuracy (IEEE 2020)").paragraph(&format!(
        "Share of pairs of pixels of channel {}, one of each patch, that show the patches' Weber \
         contrast within {:.0} %: from gain and noise above. –: beyond saturation or not \
         determined.",
        channel.channel.to_uppercase(),
        100.0 * CONTRAST_TOLERANCE
    ));
    let heads = CONTRASTS.map(|k| format!("contrast {k}"));
    let mut table = Table::new(&["dark patch, e⁻"]).numbers(&heads.each_ref().map(|h| &h[..]));
    table.rows(DARK_E.iter().map(|&dark_e| {
        let cell = |&k: &f64| {
            let found = contrast_transfer(channel, camera.sensor.black_level_dn, dark_e, k);
            found.ok().flatten().map_or_else(|| "–".into(), |share| format!("{share:.3}"))
        };
        let shares = CONTRASTS.iter().map(cell);
        std::iter::once(number(dark_e)).chain(shares).collect()
    }));
    page.rows(&table);
}

fn efficiency(sheet: &Datasheet) -> Plot {
    let mut plot = Plot::new("Quantum efficiency", "wavelength, nm", "electrons per photon, e⁻");
    plot.note("From flats through seven filters of 10 nm, per photon on the pixel.");
    for (c, channel) in sheet.channels.iter().enumerate() {
        let points =
            sheet.efficiency.iter().map(|e| [e.wavelength_nm, e.channels[c].value]).collect();
        let colour = Colour::of_channel(channel);
        plot.series(&channel.to_uppercase(), Mark::LinePoints, colour, points);
    }
    plot
}

fn transfer(sheet: &Datasheet) -> Plot {
    let mut plot = Plot::new("MTF", "spatial frequency, cycles/pixel", "modulation");
    plot.x_range(0.0, 1.0).y_range(0.0, 1.1).limit_x(0.5, "Nyquist");
    plot.note("From a slanted edge in D65, raw samples of each channel.");
    for edge in &sheet.edges {
        let colour = Colour::of_channel(&edge.channel);
        plot.series(&edge.channel.to_uppercase(), Mark::Line, colour, edge.curve.clone());
    }
    plot
}

/// Distance from the axes, in half sides, from which a node counts as one of a corner.
const CORNER: f64 = 0.9;

fn corners(crosstalk: &Crosstalk) -> Vec<Vec<String>> {
    let mut rows: Vec<(String, f64, Vec<Value>)> = Vec::new();
    for n in &crosstalk.nodes {
        if rows.last().is_none_or(|r| r.0 != n.channel || r.1 != n.wavelength_nm) {
            rows.push((n.channel.clone(), n.wavelength_nm, Vec::new()));
        }
        if n.x.abs() > CORNER
            && n.y.abs() > CORNER
            && let Some(row) = rows.last_mut()
        {
            row.2.push(n.factor);
        }
    }
    rows.iter()
        .map(|(channel, nm, values)| {
            let n = values.len().max(1) as f64;
            let mean = values.iter().map(|v| v.value).sum::<f64>() / n;
            vec![channel.to_uppercase(), nm.to_string(), format!("{mean:.4}")]
        })
        .collect()
}
