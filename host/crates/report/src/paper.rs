//! The page of the validation after section VI of Chen et al. 2009: captured frames, model and
//! improved model side by side.

use super::numbers::{NOT_DETERMINED, fixed, number};
use super::page::{Page, Table};
use super::plot::{Colour, Mark, Plot};
use camrig_base::{Plane, RawFrame, Result};
use camrig_formats::{DngInfo, png, preview};
use camrig_measure::patches::DARK;
use camrig_validate::paper::{Differences, Figures, Level, PatchNoise, REPORTED, Taken};

/// One side of the comparison.
pub struct Side<'a> {
    /// Name of the side.
    pub name: &'a str,
    /// Its frames.
    pub taken: &'a Taken,
    /// Their figures.
    pub figures: &'a Figures,
    /// Differences of the captured figures from this side; `None` for the captured side.
    pub differences: Option<&'a Differences>,
}

/// Colours of captured, model, improved model.
const COLOURS: [Colour; 3] = [Colour::Measured, Colour::Given, Colour::Improved];

/// The page. The first of `sides` is the captured one; `info` has the colour for pictures of raw
/// frames.
///
/// # Errors
/// Pictures that cannot be encoded.
pub fn page(
    sides: &[Side<'_>],
    levels: &[Level; 2],
    info: &DngInfo,
    causes: &str,
) -> Result<String> {
    let mut page = Page::new("Section VI of Chen et al. 2009, reproduced");
    let captured = sides[0].figures;
    page.kind("Validation").paragraph(
        "A ColorChecker and a slanted edge under D65 at two light levels (300 lx and 10 lx in the \
         paper). The paper compares frames of a real module with simulated ones and finds four \
         differences. Each is shown below, first for the model, then for the model with its causes \
         included.",
    );
    page.heading("The four differences");
    page.table(&headings(sides), &difference_rows(sides, levels));
    page.paragraph(&format!(
        "Table I in the paper: {} % on average, {} % without the dark patches {DARK:?}.",
        REPORTED.all_percent, REPORTED.without_dark_percent
    ));
    let [bright, dim] = levels.map(|l| format!("{} lx", l.lux));
    page.heading(&format!("System MTF, green, {bright} (Fig. 8)"));
    let mut plot = Plot::new("System MTF", "spatial frequency, cycles/pixel", "modulation");
    plot.x_range(0.0, 0.7).y_range(0.0, 1.1).limit_x(0.5, "Nyquist");
    plot.note("From a slanted edge, raw samples of the green channel.");
    for (side, colour) in sides.iter().zip(COLOURS) {
        let points = side.figures.mtf.curve.iter().filter(|p| p[0] <= 0.7).copied().collect();
        plot.series(side.name, Mark::Line, colour, points);
    }
    page.plot(&plot);
    for (level, light) in levels.iter().enumerate() {
        page.heading(&format!("Standard deviation of the luminance, {} lx (Table I)", light.lux));
        let caption = format!(
            "{} ms, gain {}, patches by number",
            light.exposure_s * 1e3,
            light.analog_gain
        );
        let mut plot = scatter_plot(sides, level);
        page.evidence(
            |page| {
                page.plot(plot.note(&caption));
            },
            |page| {
                page.rows(&table(sides, level));
            },
        );
    }
    page.heading(&format!("Green along row {}, {bright} (Fig. 9)", captured.row)).grid(|page| {
        page.plot(&profile(sides)).plot(&displacement(sides));
    });
    pictures(&mut page, sides, info, [&bright, &dim])?;
    page.heading("Causes");
    page.verbatim(causes);
    Ok(page.html())
}

fn profile(sides: &[Side<'_>]) -> Plot {
    let mut plot = Plot::new("Profile", "column, pixels", "level above black, DN");
    plot.note("One frame, one row, no smoothing.");
    for (side, colour) in sides.iter().zip(COLOURS) {
        plot.series(side.name, Mark::Line, colour, side.figures.profile.points.clone());
    }
    plot
}

fn displacement(sides: &[Side<'_>]) -> Plot {
    let mut plot = Plot::new(
        "Displacement of edges along the row",
        "column, pixels",
        "captured − model, pixels",
    );
    plot.note("Found by correlation; caused by image size and distortion.");
    for (side, colour) in sides.iter().zip(COLOURS).skip(1) {
        let points = side.differences.map(|d| d.displacements_px.clone()).unwrap_or_default();
        plot.series(side.name, Mark::Points, colour, points);
    }
    plot
}

fn headings<'a>(sides: &[Side<'a>]) -> Vec<&'a str> {
    let mut all = vec!["captured compared with"];
    all.extend(sides.iter().skip(1).map(|s| s.name));
    all
}

fn difference_rows(sides: &[Side<'_>], levels: &[Level; 2]) -> Vec<Vec<String>> {
    let row = |name: &str, of: &dyn Fn(&Differences) -> String| {
        let mut cells = vec![name.to_owned()];
        cells.extend(sides.iter().filter_map(|s| s.differences).map(of));
        cells
    };
    let scatter = |level: usize| {
        move |d: &Differences| {
            let s = d.luminance_std[level];
            format!("{:.1} %, {:.1} % without dark", s.all_percent, s.without_dark_percent)
        }
    };
    vec![
        row("MTF50 of the edge", &|d| format!("{} %", signed(d.mtf50_percent, 1))),
        row("MTF at Nyquist, model and captured", &|d| {
            let word = |v: Option<f64>| v.map_or(NOT_DETERMINED.into(), |v| format!("{v:.3}"));
            d.mtf_at_nyquist.map(word).join(", ")
        }),
        row(&format!("standard deviation of luminance, {} lx", levels[0].lux), &scatter(0)),
        row(&format!("standard deviation of luminance, {} lx", levels[1].lux), &scatter(1)),
        row("brightness, all patches", &|d| format!("{:.3}", d.brightness_ratio)),
        row("correlation of the rows", &|d| format!("{:.5}", d.profile_correlation)),
        row("displacement at the edge of the frame", &|d| {
            format!("{} pixels", signed(d.displacement_at_edge_px, 2))
        }),
        row("defects per million in dim light, model and captured", &|d| {
            format!("{:.0}, {:.0}", d.defects_per_million[0], d.defects_per_million[1])
        }),
    ]
}

/// A difference, with its sign.
fn signed(value: f64, decimals: usize) -> String {
    format!("{}{}", if value > 0.0 { "+" } else { "" }, fixed(value, decimals))
}

fn scatter_plot(sides: &[Side<'_>], level: usize) -> Plot {
    let mut plot = Plot::new("Standard deviation of luminance", "patch", "standard deviation, DN");
    for (side, colour) in sides.iter().zip(COLOURS) {
        let point = |p: &PatchNoise| [p.number as f64, p.std_dn];
        let points = side.figures.table[level].iter().map(point).collect();
        plot.series(side.name, Mark::LinePoints, colour, points);
    }
    plot
}

/// The table of patches at a level.
fn table(sides: &[Side<'_>], level: usize) -> Table {
    let names: Vec<&str> = sides.iter().map(|s| s.name).collect();
    let mut table = Table::new(&["patch"]).numbers(&["mean, DN"]).numbers(&names);
    for (i, c) in sides[0].figures.table[level].iter().enumerate() {
        let mut cells = vec![c.number.to_string(), number(c.luminance_dn), number(c.std_dn)];
        for side in &sides[1..] {
            let own = side.figures.table[level][i].std_dn;
            let off = 100.0 * (c.std_dn / own - 1.0);
            cells.push(format!("{} ({} %)", number(own), signed(off, 1)));
        }
        table.row(cells);
    }
    table
}

fn pictures(
    page: &mut Page,
    sides: &[Side<'_>],
    info: &DngInfo,
    [bright, dim]: [&str; 2],
) -> Result<()> {
    let names: Vec<&str> = sides.iter().map(|s| s.name).collect();
    let names = names.join(" | ");
    let frames = |level: usize| sides.iter().filter_map(move |s| s.taken.chart[level].first());
    page.heading(&format!("Image pairs, {bright} (Fig. 10)"));
    let whole: Vec<_> = frames(0).map(|f| preview::thumbnail(f, info, 420)).collect();
    page.picture(&png::encode_rgb(&beside(&whole))?, &names);
    page.heading(&format!("{dim}, pixel by pixel"));
    let crops: Vec<_> = frames(1).map(|f| preview::render(&crop(f, 300, 220), info)).collect();
    page.picture(&png::encode_rgb(&beside(&crops))?, &names);
    Ok(())
}

/// The middle of a frame, beginning at a whole period of the pattern.
fn crop(frame: &RawFrame, width: usize, height: usize) -> RawFrame {
    let (width, height) = (width.min(frame.width), height.min(frame.height));
    let whole = |free: usize, period: usize| free / 2 / period * period;
    let left = whole(frame.width - width, frame.cfa.width);
    let top = whole(frame.height - height, frame.cfa.height);
    let rows = (top..top + height).map(|y| y * frame.width + left);
    let data = rows.flat_map(|at| &frame.data[at..at + width]).copied().collect();
    RawFrame { width, height, data, ..frame.clone() }
}

/// Pictures next to each other with a gap between them.
fn beside(pictures: &[Plane<[u8; 3]>]) -> Plane<[u8; 3]> {
    const GAP: usize = 6;
    let height = pictures.iter().map(|p| p.height).max().unwrap_or(0);
    let mut data = Vec::new();
    for y in 0..height {
        for (i, p) in pictures.iter().enumerate() {
            let gap = if i == 0 { 0 } else { GAP };
            data.extend(std::iter::repeat_n([255; 3], gap));
            match y < p.height {
                true => data.extend_from_slice(p.row(y)),
                false => data.extend(std::iter::repeat_n([255; 3], p.width)),
            }
        }
    }
    Plane { width: data.len() / height.max(1), height, data }
}
