//! Layout of a plot, and its SVG text.

use super::axis::{Span, Tick};
use super::colours::Dot;
use super::text::width;
use super::{Area, Cell, Colour, Limit, Mark, Plot, Shape};
use crate::page::{data_uri, escape};
use camrig_formats::png;
use serde_json::{Value, json};
use std::fmt::Write;

/// Distances, px: baseline of the title and height of its row; height of a row of the legend; from
/// the name of the y axis to the box; below the box, and of the bar of colours.
const TITLE_BASE: f64 = 13.0;
const TITLE_ROW: f64 = 18.0;
const LEGEND_ROW: f64 = 16.0;
const AXIS_GAP: f64 = 9.0;
const BELOW: f64 = 36.0;
const BAR_ROW: f64 = 24.0;
/// Least distance of the box from the right side, px.
const RIGHT: f64 = 14.0;
/// Width of a mark in the legend with the distance to its text, and between entries, px.
const SWATCH: f64 = 21.0;
const BETWEEN: f64 = 12.0;
/// Room of a label along x and along y, px.
const ROOM: [f64; 2] = [52.0, 36.0];
/// Sampling distance along a line when names are placed, px.
const SAMPLED: f64 = 2.0;
/// Ascent and descent of text, and its distance from data, px.
const ASCENT: f64 = 9.0;
const DESCENT: f64 = 3.0;
const CLEAR: f64 = 3.0;
/// How much wider than computed text may be where none of the fonts is installed.
const WIDER: f64 = 1.2;
/// From the middle of a mark to its tag, px.
const TAG: f64 = 11.0;
/// Steps in the bar of colours.
const BAR_STEPS: usize = 64;
/// Radius of dots: few are read one by one, many as a cloud.
const RADII: [(usize, f64); 2] = [(30, 3.0), (200, 2.4)];
const SMALLEST_RADIUS: f64 = 1.7;

/// A place in the figure, px.
type Point = [f64; 2];

/// The symbol of a name in the legend.
#[derive(Clone, Copy)]
enum Key {
    Mark(Mark),
    Band,
    Limit,
}

/// A plot with its layout: left, top, right and bottom of the box.
pub struct Drawing<'a> {
    plot: &'a Plot,
    x: Span<'a>,
    y: Span<'a>,
    edges: [f64; 4],
    legend: Vec<(f64, usize, &'a str, Key, Colour)>,
    legend_rows: usize,
    /// Names of limits and their places; those without a place are in the legend.
    names: Vec<(Point, &'a str)>,
    left_out: usize,
}

impl<'a> Drawing<'a> {
    /// Lays a plot out. A limit whose name has no room next to the data is named in the legend,
    /// which moves the box; with each turn one more at least is.
    pub fn of(plot: &'a Plot) -> Self {
        let mut named = vec![true; plot.limits.len()];
        loop {
            let mut drawing = Self::with(plot, &named);
            let homeless = drawing.place_names(&named);
            if homeless.is_empty() {
                return drawing;
            }
            for limit in homeless {
                named[limit] = false;
            }
        }
    }

    fn with(plot: &'a Plot, named: &[bool]) -> Self {
        let (shown, left_out) = plot.shown_values();
        let room = |pixels: f64, axis: usize| (pixels / ROOM[axis]).max(2.0) as usize;
        let height = plot.size.height;
        let x = plot.x.over(plot.values(0).into_iter(), room(plot.size.width - 60.0, 0));
        let y = plot.y.over(shown.into_iter(), room(height - 90.0, 1));
        let mut drawing = Self {
            plot,
            x,
            y,
            edges: [0.0; 4],
            legend: Vec::new(),
            legend_rows: 0,
            names: Vec::new(),
            left_out,
        };
        drawing.fill_legend(named);
        let labels = drawing.y.ticks(room(height - 90.0, 1));
        let widest = labels.iter().filter_map(|t| Some(WIDER * width(t.1.as_ref()?)));
        let left = widest.fold(14.0, f64::max) + 12.0;
        let title = if plot.title.is_empty() { 0.0 } else { TITLE_ROW };
        let rows = LEGEND_ROW * drawing.legend_rows as f64;
        let bar = if plot.scale.is_some() { BAR_ROW } else { 0.0 };
        let top = TITLE_BASE + title + rows + AXIS_GAP;
        drawing.edges = [left, top, plot.size.width - RIGHT, height - BELOW - bar];
        if plot.equal {
            drawing.equalise();
        }
        drawing
    }

    /// Widens the range that has more pixels per unit.
    fn equalise(&mut self) {
        let [left, top, right, bottom] = self.edges;
        let per_unit = |pixels: f64, span: &Span<'_>| pixels / (span.high - span.low).abs();
        let (of_x, of_y) = (per_unit(right - left, &self.x), per_unit(bottom - top, &self.y));
        let (span, factor) = match of_x > of_y {
            true => (&mut self.x, of_x / of_y),
            false => (&mut self.y, of_y / of_x),
        };
        let (middle, half) = (0.5 * (span.low + span.high), 0.5 * (span.high - span.low));
        (span.low, span.high) = (middle - factor * half, middle + factor * half);
    }

    fn fill_legend(&mut self, named: &[bool]) {
        let series = self.plot.series.iter().filter(|s| !s.label.is_empty()).map(|s| {
            let key = match &s.shape {
                Shape::Marks { mark, .. } => Key::Mark(*mark),
                Shape::Band(_) => Key::Band,
            };
            (&s.label[..], key, s.colour)
        });
        let homeless = self.plot.limits.iter().zip(named).filter(|(_, named)| !**named);
        let limits = homeless.map(|(l, _)| (&l.name[..], Key::Limit, Colour::Reference));
        let (mut at, mut row) = (0.0, 0);
        for (label, key, colour) in series.chain(limits) {
            let own = SWATCH + WIDER * width(label);
            if at > 0.0 && at + own > self.plot.size.width {
                (at, row) = (0.0, row + 1);
            }
            self.legend.push((at, row, label, key, colour));
            self.legend_rows = row + 1;
            at += own + BETWEEN;
        }
    }

    fn place(&self, [x, y]: [f64; 2]) -> Option<Point> {
        let [left, top, right, bottom] = self.edges;
        let (u, v) = (self.x.at(x)?, self.y.at(y)?);
        Some([left + u * (right - left), bottom - v * (bottom - top)])
    }

    /// A point in or just outside the box.
    fn is_inside(&self, [x, y]: Point) -> bool {
        let [left, top, right, bottom] = self.edges;
        (left - 1.0..=right + 1.0).contains(&x) && (top - 1.0..=bottom + 1.0).contains(&y)
    }

    /// Both edges of an area, px: left, top, right, bottom.
    fn corners(&self, area: &Area) -> Option<[f64; 4]> {
        let [a, b] = self.place([area.x[0], area.y[0]])?;
        let [c, d] = self.place([area.x[1], area.y[1]])?;
        Some([a.min(c), b.min(d), a.max(c), b.max(d)])
    }

    /// Ends of a limit's line; none where it is outside the box.
    fn limit_line(&self, limit: &Limit) -> Option<[Point; 2]> {
        let [left, top, right, bottom] = self.edges;
        if limit.upright {
            let x = left + self.x.at(limit.at)? * (right - left);
            return self.is_inside([x, top]).then_some([[x, top], [x, bottom]]);
        }
        let y = bottom - self.y.at(limit.at)? * (bottom - top);
        self.is_inside([left, y]).then_some([[left, y], [right, y]])
    }

    /// Finds places for the names of limits, and returns those that have none.
    fn place_names(&mut self, named: &[bool]) -> Vec<usize> {
        let data = self.occupied();
        let mut homeless = Vec::new();
        let mut taken: Vec<[f64; 4]> = Vec::new();
        for (i, limit) in self.plot.limits.iter().enumerate().filter(|(i, _)| named[*i]) {
            let Some(line) = self.limit_line(limit) else { continue };
            let across = WIDER * width(&limit.name);
            let others = self.plot.limits.iter().enumerate().filter(|(k, _)| *k != i);
            let others = others.filter_map(|(_, l)| self.limit_line(l));
            let lines: Vec<Point> = others.flat_map(|[a, b]| along(a, b)).collect();
            let free = |&[x, y]: &Point| {
                let own = [x - CLEAR, y - ASCENT - CLEAR, x + across + CLEAR, y + DESCENT + CLEAR];
                let hit =
                    |&[px, py]: &Point| px > own[0] && px < own[2] && py > own[1] && py < own[3];
                let [left, top, right, bottom] = self.edges;
                let inside = x > left && x + across < right && y - ASCENT > top && y < bottom;
                let apart = |t: &[f64; 4]| {
                    own[0] > t[2] || own[2] < t[0] || own[1] > t[3] || own[3] < t[1]
                };
                inside && taken.iter().all(apart) && !data.iter().chain(&lines).any(hit)
            };
            match self.candidates(limit, line, across).into_iter().find(|at| free(at)) {
                Some([x, y]) => {
                    taken.push([x, y - ASCENT, x + across, y + DESCENT]);
                    self.names.push(([x, y], &limit.name));
                }
                None => homeless.push(i),
            }
        }
        homeless
    }

    /// Places next to a limit's line, the best first: at its end, then along it.
    fn candidates(&self, limit: &Limit, [from, to]: [Point; 2], across: f64) -> Vec<Point> {
        let [left, top, right, bottom] = self.edges;
        let steps = (0..=20).map(|i| f64::from(i) / 20.0);
        match limit.upright {
            true => steps
                .map(|t| top + 12.0 + t * (bottom - top - 18.0))
                .flat_map(|y| [[to[0] + 5.0, y], [to[0] - across - 5.0, y]])
                .collect(),
            false => steps
                .map(|t| right - across - 4.0 - t * (right - left - across - 8.0))
                .flat_map(|x| [[x, from[1] - 5.0], [x, from[1] + 13.0]])
                .collect(),
        }
    }

    /// Points that lines and marks run through.
    fn occupied(&self) -> Vec<Point> {
        let mut all = Vec::new();
        for series in &self.plot.series {
            match &series.shape {
                Shape::Marks { mark, points, errors } => {
                    let places: Vec<_> = points.iter().map(|p| self.place(*p)).collect();
                    if !matches!(mark, Mark::Points | Mark::Hollow) {
                        for pair in places.windows(2) {
                            if let [Some(a), Some(b)] = pair {
                                all.extend(along(*a, *b));
                            }
                        }
                    }
                    for (p, e) in points.iter().zip(errors) {
                        if let Some([a, b]) = self.bar_ends(*p, *e) {
                            all.extend(along(a, b));
                        }
                    }
                    all.extend(places.into_iter().flatten());
                }
                Shape::Band(points) => {
                    let ends = points.iter().flat_map(|p| [[p[0], p[1]], [p[0], p[2]]]);
                    all.extend(ends.filter_map(|p| self.place(p)));
                }
            }
        }
        let rings = self.plot.rings.iter().filter_map(|p| self.place(*p));
        all.extend(rings.flat_map(|[x, y]| [[x - 7.0, y], [x + 7.0, y]]));
        all.retain(|p| self.is_inside(*p));
        all
    }

    /// Ends of the bar of a standard error; one without a place ends at the box.
    fn bar_ends(&self, [x, y]: [f64; 2], error: f64) -> Option<[Point; 2]> {
        let [px, _] = self.place([x, y])?;
        if !(error.is_finite() && error > 0.0) {
            return None;
        }
        let low = self.place([x, y - error]).map_or(self.edges[3], |p| p[1]);
        Some([[px, low], self.place([x, y + error])?])
    }

    /// The whole drawing; `style` is for files of their own, which also get a white ground.
    pub fn svg(&self, style: &str) -> String {
        let (w, h) = (self.plot.size.width, self.plot.size.height);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" \
             height=\"{h}\" role=\"img\" aria-label=\"{}\">",
            escape(&self.words())
        );
        if !style.is_empty() {
            add(&mut out, format_args!("<style>{style}</style>"));
            add(&mut out, format_args!("<rect width=\"{w}\" height=\"{h}\" fill=\"#fff\"/>"));
        }
        self.heads(&mut out);
        self.axes(&mut out);
        self.data(&mut out);
        if let Some(scale) = &self.plot.scale {
            let [left, _, right, _] = self.edges;
            let [low, high] = scale.ends();
            let (from, to) = (left + width(&low) + 8.0, right - width(&high) - 8.0);
            text(&mut out, "ax", [left, h - 4.0], "start", &low);
            text(&mut out, "ax", [right, h - 4.0], "end", &high);
            let place = [from, h - 12.0, to, h - 4.0];
            image(&mut out, "", &place, &scale.bar(BAR_STEPS));
        }
        out.push_str("</svg>");
        out
    }

    /// What the drawing shows, for those who do not see it.
    fn words(&self) -> String {
        let plot = self.plot;
        let what = format!("{} against {}", plot.y.label, plot.x.label);
        let title = if plot.title.is_empty() { what } else { format!("{}: {what}", plot.title) };
        format!("{title}. {}", plot.note).trim_end().to_owned()
    }

    /// Title, legend and the names of the axes.
    fn heads(&self, out: &mut String) {
        let plot = self.plot;
        let mut y = TITLE_BASE;
        if !plot.title.is_empty() {
            text(out, "tt", [0.0, y], "start", &plot.title);
            y += TITLE_ROW;
        }
        for (x, row, label, key, colour) in &self.legend {
            let y = y + LEGEND_ROW * *row as f64;
            swatch(out, *key, *colour, [*x, y - 4.0]);
            text(out, "lg", [x + SWATCH, y], "start", label);
        }
        y += LEGEND_ROW * self.legend_rows as f64;
        text(out, "ax", [0.0, y], "start", &plot.y.label);
        let [_, _, right, bottom] = self.edges;
        text(out, "ax", [right, bottom + 33.0], "end", &plot.x.label);
    }

    fn axes(&self, out: &mut String) {
        let [left, top, right, bottom] = self.edges;
        let room = |pixels: f64, axis: usize| (pixels / ROOM[axis]).max(2.0) as usize;
        let x_ticks = self.x.ticks(room(right - left, 0));
        let y_ticks = self.y.ticks(room(bottom - top, 1));
        let classes = |t: &Tick| match t.1 {
            Some(_) => ("g", 5),
            None => ("g minor", 3),
        };
        out.push_str("<g class=\"grid\">");
        for tick in &x_ticks {
            let Some(x) = self.x.at(tick.0).map(|t| left + t * (right - left)) else { continue };
            let (class, length) = classes(tick);
            add(
                out,
                format_args!(
                    "<path class=\"{class}\" d=\"M{x:.1} {top:.1}V{bottom:.1}\"/>\
                     <path class=\"tk\" d=\"M{x:.1} {bottom:.1}v{length}\"/>"
                ),
            );
        }
        for tick in &y_ticks {
            let Some(y) = self.y.at(tick.0).map(|t| bottom - t * (bottom - top)) else { continue };
            let (class, length) = classes(tick);
            add(
                out,
                format_args!(
                    "<path class=\"{class}\" d=\"M{left:.1} {y:.1}H{right:.1}\"/>\
                     <path class=\"tk\" d=\"M{left:.1} {y:.1}h-{length}\"/>"
                ),
            );
        }
        out.push_str("</g>");
        add(
            out,
            format_args!("<path class=\"tk\" d=\"M{left:.1} {top:.1}V{bottom:.1}H{right:.1}\"/>"),
        );
        self.labels(out, &x_ticks, &y_ticks);
    }

    /// Labels of ticks; along x, those that would touch the one before are left out.
    fn labels(&self, out: &mut String, x_ticks: &[Tick], y_ticks: &[Tick]) {
        let [left, top, right, bottom] = self.edges;
        let mut labelled: Vec<(f64, &str)> = x_ticks
            .iter()
            .filter_map(|(v, t)| Some((left + self.x.at(*v)? * (right - left), t.as_deref()?)))
            .collect();
        labelled.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut end = f64::NEG_INFINITY;
        for (x, label) in labelled {
            let half = 0.5 * WIDER * width(label);
            let x = x.min(self.plot.size.width - half);
            if x - half > end + 5.0 {
                end = x + half;
                text(out, "tl", [x, bottom + 17.0], "middle", label);
            }
        }
        for (value, label) in y_ticks {
            if let (Some(t), Some(label)) = (self.y.at(*value), label) {
                text(out, "tl", [left - 8.0, bottom - t * (bottom - top) + 4.0], "end", label);
            }
        }
    }

    /// All that lies in the box, which it is cut to.
    fn data(&self, out: &mut String) {
        let plot = self.plot;
        let [left, top, right, bottom] = self.edges;
        let clip = self.name();
        add(
            out,
            format_args!(
                "<clipPath id=\"{clip}\"><rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" \
                 height=\"{:.1}\"/></clipPath><g class=\"data\" clip-path=\"url(#{clip})\">",
                left - 3.0,
                top - 3.0,
                right - left + 6.0,
                bottom - top + 6.0
            ),
        );
        for picture in &plot.pictures {
            if let Some(place) = self.corners(&picture.area) {
                image(out, "px", &place, &picture.colours);
            }
        }
        for cell in &plot.cells {
            self.cell(out, cell);
        }
        for [a, b] in &plot.edges {
            if let (Some(a), Some(b)) = (self.place(*a), self.place(*b)) {
                add(out, format_args!("<path class=\"l need\" d=\"{}\"/>", segment(a, b)));
            }
        }
        for area in &plot.outlined {
            if let Some([a, b, c, d]) = self.corners(area) {
                let d = format!(
                    "M{:.1} {:.1}H{:.1}V{:.1}H{:.1}Z",
                    a + 1.0,
                    b + 1.0,
                    c - 1.0,
                    d - 1.0,
                    a + 1.0
                );
                add(out, format_args!("<path class=\"l halo\" d=\"{d}\"/>"));
                add(out, format_args!("<path class=\"l best\" d=\"{d}\"/>"));
            }
        }
        for limit in &plot.limits {
            if let Some([a, b]) = self.limit_line(limit) {
                let d = segment(a, b);
                add(out, format_args!("<path class=\"l ref refc\" d=\"{d}\"/>"));
            }
        }
        for series in &plot.series {
            match &series.shape {
                Shape::Band(points) => self.draw_band(out, series.colour.class(), points),
                Shape::Marks { mark, points, errors } => {
                    self.draw_marks(out, *mark, series.colour, points, errors);
                }
            }
        }
        for [x, y] in plot.rings.iter().filter_map(|p| self.place(*p)) {
            add(
                out,
                format_args!("<circle class=\"l meas\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"7\"/>"),
            );
        }
        for (place, name) in &self.names {
            text(out, "rl refc", *place, "start", name);
        }
        for (point, tag) in &plot.tags {
            let Some([x, y]) = self.place(*point) else { continue };
            let left = x - TAG - WIDER * width(tag) > self.edges[0];
            let (x, anchor) = if left { (x - TAG, "end") } else { (x + TAG, "start") };
            text(out, "tag", [x, y + 4.0], anchor, tag);
        }
        out.push_str("</g>");
    }

    fn cell(&self, out: &mut String, cell: &Cell) {
        let Some([a, b, c, d]) = self.corners(&cell.area) else { return };
        let [red, green, blue] = cell.colour;
        add(
            out,
            format_args!(
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" \
                 fill=\"rgb({red},{green},{blue})\"/>",
                a + 0.7,
                b + 0.7,
                (c - a - 1.4).max(0.0),
                (d - b - 1.4).max(0.0)
            ),
        );
        // Text that the cell has no room for is left to the hover.
        if width(&cell.text) < c - a - 2.0 {
            let ink = if super::colours::is_light(cell.colour) { "dark" } else { "light" };
            let middle = [0.5 * (a + c), 0.5 * (b + d) + 4.0];
            text(out, &format!("cell {ink}"), middle, "middle", &cell.text);
        }
    }

    fn draw_band(&self, out: &mut String, class: &str, points: &[[f64; 3]]) {
        let side = |k: usize| points.iter().filter_map(move |p| self.place([p[0], p[k]]));
        let low: Vec<Point> = side(1).collect();
        let all: Vec<Point> = side(2).chain(low.into_iter().rev()).collect();
        let d = path(all.iter().map(|p| Some(*p)));
        if !d.is_empty() {
            add(out, format_args!("<path class=\"b {class}\" d=\"{d}Z\"/>"));
        }
    }

    fn draw_marks(
        &self,
        out: &mut String,
        mark: Mark,
        colour: Colour,
        points: &[[f64; 2]],
        errors: &[f64],
    ) {
        let class = colour.class();
        if matches!(mark, Mark::Line | Mark::Dashed | Mark::LinePoints) {
            let dash = if mark == Mark::Dashed { " dash" } else { "" };
            let d = path(points.iter().map(|p| self.place(*p)));
            if !d.is_empty() {
                add(out, format_args!("<path class=\"l{dash} {class}\" d=\"{d}\"/>"));
            }
        }
        for (point, error) in points.iter().zip(errors) {
            if let Some([a, b]) = self.bar_ends(*point, *error) {
                add(out, format_args!("<path class=\"e {class}\" d=\"{}\"/>", segment(a, b)));
            }
        }
        if matches!(mark, Mark::Points | Mark::Hollow | Mark::LinePoints) {
            let radius = radius(points.len());
            let form = if mark == Mark::Hollow { "l" } else { "f" };
            add(out, format_args!("<g class=\"{form} {class}\">"));
            let places = points.iter().filter_map(|p| self.place(*p));
            for [x, y] in places.filter(|p| self.is_inside(*p)) {
                dot(out, colour.dot(), "", [x, y], radius);
            }
            out.push_str("</g>");
        }
    }

    /// The figure of a page.
    pub fn figure(&self, class: &str) -> String {
        let mut note = self.plot.note.clone();
        if self.left_out > 0 {
            let all = self.plot.values(1).len();
            let words = format!(" Beyond the axis: {} of {all} values.", self.left_out);
            note = (note + &words).trim_start().to_owned();
        }
        let caption = match &note[..] {
            "" => String::new(),
            note => format!("<figcaption>{}</figcaption>", escape(note)),
        };
        // A `<` in the data must not end the element.
        let data = self.values().to_string().replace('<', "\\u003c");
        format!(
            "<figure class=\"plot {class}\" data-name=\"{}\">{}{caption}\
             <script type=\"application/json\">{data}</script></figure>\n",
            self.name(),
            self.svg("")
        )
    }

    /// A name for files, and for the clip path: it distinguishes figures of a page by their title,
    /// size and data.
    fn name(&self) -> String {
        let letters =
            self.plot.title.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' });
        let name: String = letters.collect::<String>().to_lowercase();
        let Plot { size, series, .. } = self.plot;
        let text = format!("{size:?}{:?}{series:?}", self.edges);
        // FNV-1a, 32 bits.
        let hash = text
            .bytes()
            .fold(0x811c_9dc5_u32, |h, b| (h ^ u32::from(b)).wrapping_mul(0x0100_0193));
        format!("{}-{hash:08x}", if name.is_empty() { "figure" } else { &name })
    }

    /// The data for `figure.js`.
    fn values(&self) -> Value {
        let axis = |span: &Span<'_>| {
            let mut all = json!({
                "lo": span.low, "hi": span.high, "log": span.axis.logarithmic, "n": span.axis.label
            });
            if !span.axis.names.is_empty() {
                all["t"] = json!(span.axis.names);
            }
            all
        };
        let mut series: Vec<Value> = Vec::new();
        for s in &self.plot.series {
            let Shape::Marks { mark, points, errors } = &s.shape else { continue };
            let known: Vec<usize> =
                (0..points.len()).filter(|&i| points[i].iter().all(|v| v.is_finite())).collect();
            let pairs: Vec<_> = known.iter().map(|&i| points[i].map(short)).collect();
            let mut one = json!({ "n": s.label, "c": s.colour.class(), "p": pairs });
            if !errors.is_empty() {
                one["e"] = known.iter().map(|&i| short(errors[i])).collect();
            }
            if matches!(mark, Mark::Dashed) {
                one["d"] = json!(1);
            }
            series.push(one);
        }
        if !self.plot.cells.is_empty() {
            let middle = |[a, b]: [f64; 2]| short(0.5 * (a + b));
            let cells = self.plot.cells.iter().filter(|c| c.value.is_finite());
            let cells: Vec<_> =
                cells.map(|c| [middle(c.area.x), middle(c.area.y), short(c.value)]).collect();
            series.push(json!({ "n": "", "c": "meas", "p": cells }));
        }
        let edges = self.edges.map(|v| (10.0 * v).round() / 10.0);
        json!({ "x": axis(&self.x), "y": axis(&self.y), "box": edges, "s": series })
    }
}

/// A number of five significant digits.
fn short(value: f64) -> f64 {
    format!("{value:.4e}").parse().unwrap_or(value)
}

/// Radius of dots by their number, px.
fn radius(count: usize) -> f64 {
    RADII.iter().find(|(most, _)| count <= *most).map_or(SMALLEST_RADIUS, |(_, r)| *r)
}

/// Points on a stretch, at most [`SAMPLED`] apart as long as it is not far beyond a figure.
fn along(a: Point, b: Point) -> impl Iterator<Item = Point> {
    let longest = (b[0] - a[0]).abs().max((b[1] - a[1]).abs());
    let pieces = (longest / SAMPLED).clamp(1.0, 2000.0) as u32;
    (0..=pieces).map(move |i| {
        let t = f64::from(i) / f64::from(pieces);
        [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
    })
}

fn segment([a, b]: Point, [c, d]: Point) -> String {
    format!("M{a:.1} {b:.1}L{c:.1} {d:.1}")
}

/// A path through places; it breaks where there is none.
fn path(places: impl Iterator<Item = Option<Point>>) -> String {
    let mut out = String::new();
    let mut down = false;
    for place in places {
        let Some([x, y]) = place else {
            down = false;
            continue;
        };
        add(&mut out, format_args!("{}{x:.1} {y:.1}", if down { 'L' } else { 'M' }));
        down = true;
    }
    out
}

/// A dot around a place. Those that are not round are paths from their middle, from which the
/// script of the page moves them.
fn dot(out: &mut String, form: Dot, class: &str, [x, y]: Point, r: f64) {
    let with = |own: &str| match format!("{own} {class}").trim() {
        "" => String::new(),
        all => format!("class=\"{all}\" "),
    };
    // Of about the area of the round one.
    let (a, b, c) = (0.9 * r, 1.25 * r, 1.4 * r);
    let side = match form {
        Dot::Round => {
            let class = with("");
            add(out, format_args!("<circle {class}cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{r}\"/>"));
            return;
        }
        Dot::Square => format!("m-{a:.1}-{a:.1}h{0:.1}v{0:.1}h-{0:.1}z", 2.0 * a),
        Dot::Diamond => format!("m0-{b:.1}l{b:.1} {b:.1}l-{b:.1} {b:.1}l-{b:.1}-{b:.1}z"),
        Dot::Triangle => format!("m0-{c:.1}l{b:.1} {0:.1}h-{1:.1}z", 1.6 * c, 2.0 * b),
    };
    let class = with("mk");
    add(out, format_args!("<path {class}d=\"M{x:.1} {y:.1}{side}\"/>"));
}

fn swatch(out: &mut String, key: Key, colour: Colour, [x, y]: Point) {
    let class = colour.class();
    let line = |dash: &str| format!("<path class=\"l {dash}{class}\" d=\"M{x:.1} {y:.1}h16\"/>");
    let dot = |form: &str| {
        let mut own = String::new();
        dot(&mut own, colour.dot(), &format!("{form} {class}"), [x + 8.0, y], 3.0);
        own
    };
    out.push_str(&match key {
        Key::Mark(Mark::Line) => line(""),
        Key::Mark(Mark::Dashed) => line("dash "),
        Key::Mark(Mark::Points) => dot("f"),
        Key::Mark(Mark::Hollow) => dot("l"),
        Key::Mark(Mark::LinePoints) => line("") + &dot("f"),
        Key::Limit => line("ref "),
        Key::Band => format!(
            "<rect class=\"b {class}\" x=\"{x:.1}\" y=\"{:.1}\" width=\"16\" height=\"10\"/>",
            y - 5.0
        ),
    });
}

fn image(
    out: &mut String,
    class: &str,
    [a, b, c, d]: &[f64; 4],
    colours: &camrig_base::Plane<[u8; 3]>,
) {
    // A picture that PNG cannot hold is larger than memory.
    let Ok(bytes) = png::encode_rgb(colours) else { return };
    add(
        out,
        format_args!(
            "<image class=\"{class}\" x=\"{a:.1}\" y=\"{b:.1}\" width=\"{:.1}\" \
             height=\"{:.1}\" preserveAspectRatio=\"none\" href=\"{}\"/>",
            c - a,
            d - b,
            data_uri(&bytes)
        ),
    );
}

fn text(out: &mut String, class: &str, [x, y]: Point, anchor: &str, words: &str) {
    let words = escape(words);
    add(
        out,
        format_args!(
            "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" \
             text-anchor=\"{anchor}\">{words}</text>"
        ),
    );
}

/// Writing to a String does not fail.
fn add(out: &mut String, what: std::fmt::Arguments<'_>) {
    let _ = out.write_fmt(what);
}
