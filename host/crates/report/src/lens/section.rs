//! A lens in section as SVG text for a page.

use crate::plot::Colour;
use camrig_lens::section::{Place, Section};
use std::fmt::Write;

/// Sizes, px: that of the drawing, its margins, the row of the legend and that of the scale bar.
const WIDTH: f64 = 358.0;
const MAX_HIGH: f64 = 300.0;
const MARGIN: f64 = 6.0;
const LEGEND: f64 = 42.0;
const SCALE: f64 = 30.0;
/// Distance of the entries of the legend, px.
const ENTRY: f64 = 66.0;
/// Part of the drawing's width that the scale bar has at most.
const BAR: f64 = 0.3;

/// From mm to px.
struct Frame {
    per_mm: f64,
    left_mm: f64,
    middle: f64,
}

impl Frame {
    fn at(&self, [z, y]: Place) -> [f64; 2] {
        [MARGIN + (z - self.left_mm) * self.per_mm, self.middle - y * self.per_mm]
    }

    fn path(&self, places: &[Place]) -> String {
        let mut out = String::new();
        for (i, place) in places.iter().enumerate() {
            let [x, y] = self.at(*place);
            let _ = write!(out, "{}{x:.1} {y:.1}", if i == 0 { 'M' } else { 'L' });
        }
        out
    }
}

/// The drawing: surfaces, rays of each field in its own colour, and a scale bar.
pub(super) fn svg(section: &Section, fields_deg: &[f64]) -> String {
    let places = || {
        let of_rays = section.rays.iter().flatten().flatten();
        section.surfaces.iter().flat_map(|s| &s.curve).chain(of_rays)
    };
    let least = places().map(|p| p[0]).fold(f64::INFINITY, f64::min);
    let most = places().map(|p| p[0]).fold(section.image_z_mm, f64::max);
    let half = places().map(|p| p[1].abs()).fold(0.0, f64::max);
    let across = (WIDTH - 2.0 * MARGIN) / (most - least);
    let per_mm = across.min((MAX_HIGH - 2.0 * MARGIN) / (2.0 * half));
    let middle = LEGEND + MARGIN + half * per_mm;
    let height = (middle + half * per_mm + MARGIN + SCALE).round();
    let frame = Frame { per_mm, left_mm: least, middle };
    let mut out = format!(
        "<svg viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\" role=\"img\" \
         aria-label=\"Section through the lens with rays of {} fields, in mm\">\
         <text class=\"tt\" x=\"0\" y=\"13\">Section</text>",
        fields_deg.len()
    );
    legend(&mut out, fields_deg);
    glass(&mut out, section, &frame);
    let axis = frame.path(&[[least, 0.0], [most, 0.0]]);
    let _ = write!(out, "<path class=\"l ref refc\" d=\"{axis}\"/>");
    for (i, rays) in section.rays.iter().enumerate() {
        let class = Colour::Series(i).class();
        let d: String = rays.iter().map(|ray| frame.path(ray)).collect();
        let _ = write!(out, "<path class=\"l ray {class}\" d=\"{d}\"/>");
    }
    let image = frame.path(&[[section.image_z_mm, -half], [section.image_z_mm, half]]);
    let _ = write!(out, "<path class=\"l meas\" d=\"{image}\"/>");
    scale_bar(&mut out, &frame, height);
    out + "</svg>"
}

fn legend(out: &mut String, fields_deg: &[f64]) {
    for (i, deg) in fields_deg.iter().enumerate() {
        let (x, class) = (ENTRY * i as f64, Colour::Series(i).class());
        let _ = write!(
            out,
            "<path class=\"l {class}\" d=\"M{x:.1} 27h16\"/>\
             <text x=\"{:.1}\" y=\"31\">{}°</text>",
            x + 21.0,
            (10.0 * deg).round() / 10.0
        );
    }
}

/// Elements filled, other surfaces and the stop as lines.
fn glass(out: &mut String, section: &Section, frame: &Frame) {
    for (i, surface) in section.surfaces.iter().enumerate() {
        let next = section.surfaces.get(i + 1).filter(|_| surface.before_glass);
        if let Some(next) = next {
            let around: Vec<Place> =
                surface.curve.iter().chain(next.curve.iter().rev()).copied().collect();
            let _ = write!(out, "<path class=\"glass\" d=\"{}Z\"/>", frame.path(&around));
        }
        let of_glass = surface.before_glass || i > 0 && section.surfaces[i - 1].before_glass;
        if !of_glass && !surface.stop {
            let _ = write!(out, "<path class=\"l refc\" d=\"{}\"/>", frame.path(&surface.curve));
        }
        if let (true, Some(first), Some(last)) =
            (surface.stop, surface.curve.first(), surface.curve.last())
        {
            for ([z, y], sign) in [(*first, -1.0), (*last, 1.0)] {
                let beyond = y + sign * 8.0 / frame.per_mm;
                let d = frame.path(&[[z, y], [z, beyond]]);
                let _ = write!(out, "<path class=\"l meas\" d=\"{d}\"/>");
            }
        }
    }
}

/// A bar of 1, 2 or 5 times a power of ten.
fn scale_bar(out: &mut String, frame: &Frame, height: f64) {
    let mm = super::curves::rounded(BAR * WIDTH / frame.per_mm);
    let (long, y) = (mm * frame.per_mm, height - 12.0);
    let _ = write!(
        out,
        "<path class=\"l meas\" d=\"M{MARGIN} {:.1}v8m0 -4h{long:.1}m0 -4v8\"/>\
         <text x=\"{:.1}\" y=\"{:.1}\">{mm} mm</text>",
        y - 4.0,
        MARGIN + long + 8.0,
        y + 4.0
    );
}
