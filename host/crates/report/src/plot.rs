//! Small plots as SVG text: lines and points on linear or logarithmic axes, and heat maps.
//!
//! Drawings are for files of their own and for pages; text and axes take the surrounding colour.

use super::page::escape;
use base64::Engine;
use camrig_base::Plane;
use camrig_base::numbers::plain;
use std::fmt::Write;

/// Colours of series, after Okabe and Ito: distinguishable for colour-blind readers.
const COLOURS: [&str; 8] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f", "#b8a800"];

/// Width and height of a drawing, and its margins: left, right, top, bottom.
const SIZE: [f64; 2] = [640.0, 400.0];
const MARGIN: [f64; 4] = [72.0, 16.0, 34.0, 48.0];

/// Height of a line of the legend, width of a mark in it, and of a character on average.
const LINE: f64 = 18.0;
const SWATCH: f64 = 26.0;
const CHARACTER: f64 = 6.6;

/// Colour of a sensor's channel by its name: red, green (also gr and gb), blue, grey for others.
pub fn channel_colour(channel: &str) -> &'static str {
    match channel.chars().next() {
        Some('r') => "#d55e00",
        Some('g') => "#009e73",
        Some('b') => "#0072b2",
        _ => "#7f7f7f",
    }
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A line through the points.
    Line,
    /// A dashed line: limits, models.
    Dashed,
    /// Dots.
    Points,
}

#[derive(Clone, Debug)]
struct Series {
    label: String,
    points: Vec<[f64; 2]>,
    mark: Mark,
    colour: String,
}

#[derive(Clone, Debug, Default)]
struct Axis {
    label: String,
    logarithmic: bool,
    range: Option<[f64; 2]>,
}

/// A plot of series over two axes.
///
/// ```
/// use camrig_report::plot::{Mark, Plot};
/// let mut plot = Plot::new("Noise", "signal, e-", "noise, e-");
/// plot.log_x().log_y().series("model", Mark::Line, vec![[1.0, 2.0], [100.0, 10.0]]);
/// assert!(plot.svg().starts_with("<svg"));
/// ```
#[derive(Clone, Debug)]
pub struct Plot {
    title: String,
    x: Axis,
    y: Axis,
    series: Vec<Series>,
    square: bool,
}

impl Plot {
    /// An empty plot with axis labels (name and unit).
    pub fn new(title: &str, x: &str, y: &str) -> Self {
        let axis = |label: &str| Axis { label: label.to_owned(), ..Axis::default() };
        let title = title.to_owned();
        Self { title, x: axis(x), y: axis(y), series: Vec::new(), square: false }
    }

    /// Makes the x axis logarithmic; points at or below 0 are left out.
    pub fn log_x(&mut self) -> &mut Self {
        self.x.logarithmic = true;
        self
    }

    /// Makes the y axis logarithmic; points at or below 0 are left out.
    pub fn log_y(&mut self) -> &mut Self {
        self.y.logarithmic = true;
        self
    }

    /// Sets the range of the x axis, which otherwise follows the points.
    pub fn x_range(&mut self, low: f64, high: f64) -> &mut Self {
        self.x.range = Some([low, high]);
        self
    }

    /// Sets the range of the y axis, which otherwise follows the points.
    pub fn y_range(&mut self, low: f64, high: f64) -> &mut Self {
        self.y.range = Some([low, high]);
        self
    }

    /// Draws a unit of x as long as a unit of y.
    pub fn square(&mut self) -> &mut Self {
        self.square = true;
        self
    }

    /// Adds a series in the next colour; without a label it is not in the legend.
    pub fn series(&mut self, label: &str, mark: Mark, points: Vec<[f64; 2]>) -> &mut Self {
        let colour = COLOURS[self.series.len() % COLOURS.len()];
        self.coloured(label, mark, points, colour)
    }

    /// Adds a series in a given colour (`#rrggbb`).
    pub fn coloured(
        &mut self,
        label: &str,
        mark: Mark,
        points: Vec<[f64; 2]>,
        colour: &str,
    ) -> &mut Self {
        let (label, colour) = (label.to_owned(), colour.to_owned());
        self.series.push(Series { label, points, mark, colour });
        self
    }

    /// The drawing as SVG text.
    pub fn svg(&self) -> String {
        let [width, height] = SIZE;
        let [left, right, top, bottom] = MARGIN;
        let (mut inner_width, inner_height) = (width - left - right, height - top - bottom);
        let (x, mut y) = (self.scale(&self.x, 0), self.scale(&self.y, 1));
        if self.square {
            inner_width = inner_height;
            y.high = y.low + (x.high - x.low);
        }
        let place = |p: &[f64; 2]| {
            let (u, v) = (x.at(p[0])?, y.at(p[1])?);
            Some([left + u * inner_width, top + (1.0 - v) * inner_height])
        };
        let legend = self.legend(width - left - right);
        let mut out = Drawing::new(width, height + LINE * legend.len() as f64, &self.title);
        out.frame([left, top, inner_width, inner_height]);
        for (value, text) in x.ticks() {
            let at = left + x.at(value).unwrap_or(0.0) * inner_width;
            out.tick(
                [at, top],
                [at, top + inner_height],
                [at, top + inner_height + 16.0],
                "middle",
                &text,
            );
        }
        for (value, text) in y.ticks() {
            let at = top + (1.0 - y.at(value).unwrap_or(0.0)) * inner_height;
            out.tick([left, at], [left + inner_width, at], [left - 6.0, at + 4.0], "end", &text);
        }
        out.text([left + inner_width / 2.0, height - 10.0], "middle", &self.x.label, "");
        let turn = format!(" transform=\"rotate(-90 16 {:.1})\"", top + inner_height / 2.0);
        out.text([16.0, top + inner_height / 2.0], "middle", &self.y.label, &turn);
        for series in &self.series {
            let points: Vec<[f64; 2]> = series.points.iter().filter_map(place).collect();
            out.marks(&points, series.mark, &series.colour);
        }
        for (row, entries) in legend.iter().enumerate() {
            for (x, series) in entries {
                let at = [left + x, height + LINE * (row as f64 + 0.5)];
                out.swatch(at, series.mark, &series.colour, &series.label);
            }
        }
        out.end()
    }

    /// The labelled series in lines of a width, each with its distance from the left. They stand
    /// below the axes, where no data are.
    fn legend(&self, width: f64) -> Vec<Vec<(f64, &Series)>> {
        let mut lines: Vec<Vec<(f64, &Series)>> = Vec::new();
        let mut end = f64::INFINITY;
        for series in self.series.iter().filter(|s| !s.label.is_empty()) {
            let own = SWATCH + CHARACTER * series.label.chars().count() as f64;
            if end + own > width {
                lines.push(Vec::new());
                end = 0.0;
            }
            if let Some(line) = lines.last_mut() {
                line.push((end, series));
            }
            end += own + 2.0 * CHARACTER;
        }
        lines
    }

    fn scale(&self, axis: &Axis, index: usize) -> Scale {
        let all = self.series.iter().flat_map(|s| &s.points).map(|p| p[index]);
        let usable = all.filter(|v| v.is_finite() && (!axis.logarithmic || *v > 0.0));
        let found = usable
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
        Scale::over(axis.range.unwrap_or(found), axis.logarithmic, axis.range.is_some())
    }
}

/// A range of values along an axis.
struct Scale {
    low: f64,
    high: f64,
    logarithmic: bool,
}

impl Scale {
    fn over([low, high]: [f64; 2], logarithmic: bool, exact: bool) -> Self {
        let [mut low, mut high] = if low <= high { [low, high] } else { [0.0, 1.0] };
        if logarithmic {
            low = if low > 0.0 { low.log10() } else { -3.0 };
            high = if high > 0.0 { high.log10() } else { 0.0 };
        }
        let spread = high - low;
        let room = match (exact, spread > 0.0) {
            (true, true) => 0.0,
            (false, true) => 0.03 * spread,
            (_, false) => {
                if low == 0.0 {
                    1.0
                } else {
                    0.1 * low.abs()
                }
            }
        };
        Self { low: low - room, high: high + room, logarithmic }
    }

    /// Position of a value, 0 to 1 from end to end; `None` outside the axis.
    fn at(&self, value: f64) -> Option<f64> {
        let v = if self.logarithmic { value.log10() } else { value };
        let t = (v - self.low) / (self.high - self.low);
        // Points at the ends must not be lost to rounding.
        (-1e-6..=1.0 + 1e-6).contains(&t).then_some(t)
    }

    /// Values with their text: decades, or round steps (1, 2 or 5).
    fn ticks(&self) -> Vec<(f64, String)> {
        let spread = self.high - self.low;
        if self.logarithmic && spread >= 1.0 {
            let step = (spread / 6.0).ceil().max(1.0) as i32;
            let (first, last) = (self.low.ceil() as i32, self.high.floor() as i32);
            let decades = (first..=last).step_by(step as usize);
            return decades.map(|d| (10f64.powi(d), label(10f64.powi(d), d, 0))).collect();
        }
        let power = (spread / 5.0).log10().floor() as i32;
        let unit = 10f64.powi(power);
        let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * unit).into_iter().find(|s| spread / s <= 6.0);
        let step = step.unwrap_or(10.0 * unit);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        let values = (first..=last.min(first + 20)).map(|k| k as f64 * step);
        let values: Vec<f64> =
            values.map(|v| if self.logarithmic { 10f64.powf(v) } else { v }).collect();
        // Between decades steps are not round: as many digits as tell the labels apart.
        let labels = |more| values.iter().map(|&v| label(v, power, more)).collect::<Vec<_>>();
        let apart = (0..MOST_DIGITS).map(labels).find(|all| all.windows(2).all(|w| w[0] != w[1]));
        let labels = apart.unwrap_or_else(|| labels(0));
        values.iter().copied().zip(labels).collect()
    }
}

/// Digits behind the point that a label has at most.
const MOST_DIGITS: usize = 8;

/// A number with as many digits as steps of 10^`power` need, and some more.
fn label(value: f64, power: i32, more: usize) -> String {
    if value != 0.0 && !(1e-4..1e6).contains(&value.abs()) {
        return format!("{value:.more$e}");
    }
    format!("{value:.*}", (usize::try_from(-power).unwrap_or(0) + more).min(MOST_DIGITS))
}

/// A heat map of a plane of values.
///
/// Values go from black over colours to near white; with `root` their square root is shown, which
/// makes faint parts visible. `x` and `y` are the coordinates of the outer edges, left to right
/// and top to bottom, in `unit`.
pub fn heat_map(
    title: &str,
    plane: &Plane<f64>,
    x: [f64; 2],
    y: [f64; 2],
    unit: &str,
    root: bool,
) -> String {
    let [left, _, top, bottom] = MARGIN;
    let side = SIZE[1] - top - bottom;
    let across = side * plane.width as f64 / plane.height.max(1) as f64;
    let mut out = Drawing::new(left + across + 90.0, SIZE[1], title);
    let finite = plane.data.iter().copied().filter(|v| v.is_finite());
    let (low, high) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    let place = [left, top, across, side];
    out.picture(plane, low, high, root, place);
    out.frame(place);
    for (value, text) in Scale::over(x, false, true).ticks() {
        let at = left + (value - x[0]) / (x[1] - x[0]) * across;
        out.text([at, top + side + 16.0], "middle", &text, "");
    }
    for (value, text) in Scale::over([y[0].min(y[1]), y[0].max(y[1])], false, true).ticks() {
        let at = top + (value - y[0]) / (y[1] - y[0]) * side;
        out.text([left - 6.0, at + 4.0], "end", &text, "");
    }
    out.text([left + across / 2.0, SIZE[1] - 10.0], "middle", unit, "");
    // A colour bar with the ends of the range.
    let bar = Plane::from_fn(1, 64, |_, row| 1.0 - row as f64 / 63.0);
    let bar_place = [left + across + 16.0, top, 14.0, side];
    out.picture(&bar, 0.0, 1.0, root, bar_place);
    out.text([left + across + 36.0, top + 10.0], "start", &plain(high), "");
    out.text([left + across + 36.0, top + side], "start", &plain(low), "");
    out.end()
}

/// Small pictures in rows and columns, with a heading per row and column. Each picture has its own
/// range; the square root of the values is shown.
pub fn picture_grid(
    title: &str,
    columns: &[String],
    rows: &[(String, Vec<Plane<f64>>)],
) -> String {
    const CELL: f64 = 120.0;
    let left = 110.0;
    let (width, height) =
        ((left + CELL * columns.len() as f64 + 8.0).max(480.0), 64.0 + CELL * rows.len() as f64);
    let mut out = Drawing::new(width, height, title);
    for (j, heading) in columns.iter().enumerate() {
        out.text([left + CELL * (j as f64 + 0.5), 52.0], "middle", heading, "");
    }
    for (i, (heading, planes)) in rows.iter().enumerate() {
        let top = 60.0 + CELL * i as f64;
        out.text([left - 8.0, top + CELL / 2.0], "end", heading, "");
        for (j, plane) in planes.iter().enumerate() {
            let high = plane.data.iter().copied().fold(0.0, f64::max);
            let place = [left + CELL * j as f64 + 2.0, top, CELL - 4.0, CELL - 4.0];
            out.picture(plane, 0.0, high, true, place);
        }
    }
    out.end()
}

/// A colour from black over blue, red and yellow to near white, for t from 0 to 1.
pub fn colour(t: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 5] = [
        [0.0, 0.0, 4.0],
        [87.0, 16.0, 110.0],
        [188.0, 55.0, 84.0],
        [249.0, 142.0, 9.0],
        [252.0, 255.0, 164.0],
    ];
    let place = t.clamp(0.0, 1.0) * 4.0;
    let i = (place as usize).min(3);
    let f = place - i as f64;
    [0, 1, 2].map(|k| (STOPS[i][k] + f * (STOPS[i + 1][k] - STOPS[i][k])).round() as u8)
}

/// SVG text under construction. Writing to a String does not fail, so its results are ignored.
struct Drawing {
    text: String,
}

impl Drawing {
    fn new(width: f64, height: f64, title: &str) -> Self {
        let text = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
             width=\"{width:.0}\" height=\"{height:.0}\" font-family=\"sans-serif\" \
             font-size=\"12\" fill=\"currentColor\">\n"
        );
        let mut drawing = Self { text };
        drawing.text([width / 2.0, 20.0], "middle", title, " font-weight=\"bold\"");
        drawing
    }

    fn add(&mut self, what: std::fmt::Arguments<'_>) {
        let _ = self.text.write_fmt(what);
    }

    fn text(&mut self, [x, y]: [f64; 2], anchor: &str, text: &str, more: &str) {
        let text = escape(text);
        self.add(format_args!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\"{more}>{text}</text>\n"
        ));
    }

    fn frame(&mut self, [x, y, width, height]: [f64; 4]) {
        self.add(format_args!(
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" \
             fill=\"none\" stroke=\"currentColor\"/>\n"
        ));
    }

    fn tick(&mut self, from: [f64; 2], to: [f64; 2], place: [f64; 2], anchor: &str, text: &str) {
        self.add(format_args!(
            "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"currentColor\" \
             stroke-opacity=\"0.15\"/>\n",
            from[0], from[1], to[0], to[1]
        ));
        self.text(place, anchor, text, "");
    }

    fn marks(&mut self, points: &[[f64; 2]], mark: Mark, colour: &str) {
        if mark == Mark::Points {
            // Few points are read one by one, many as a cloud.
            let radius = if points.len() < 100 { 3.0 } else { 1.6 };
            self.add(format_args!("<g fill=\"{colour}\" fill-opacity=\"0.7\">"));
            for [x, y] in points {
                self.add(format_args!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\"/>"));
            }
            self.add(format_args!("</g>\n"));
            return;
        }
        let dash = if mark == Mark::Dashed { " stroke-dasharray=\"6 4\"" } else { "" };
        let path: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        self.add(format_args!(
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" \
             stroke-width=\"1.6\"{dash}/>\n",
            path.join(" ")
        ));
    }

    /// An entry of the legend; its left end is at a position.
    fn swatch(&mut self, [x, y]: [f64; 2], mark: Mark, colour: &str, label: &str) {
        let ends = [[x, y - 4.0], [x + 20.0, y - 4.0]];
        match mark {
            Mark::Points => self.marks(&[[x + 10.0, y - 4.0]], mark, colour),
            _ => self.marks(&ends, mark, colour),
        }
        self.text([x + SWATCH, y], "start", label, "");
    }

    fn picture(&mut self, plane: &Plane<f64>, low: f64, high: f64, root: bool, place: [f64; 4]) {
        let [x, y, width, height] = place;
        let spread = if high > low { high - low } else { 1.0 };
        let shade = |v: &f64| {
            let t = (v - low) / spread;
            colour(if root { t.max(0.0).sqrt() } else { t })
        };
        let pixels: Vec<u8> = plane.data.iter().flat_map(shade).collect();
        let Some(bytes) = png(plane.width, plane.height, &pixels) else { return };
        let data = base64::engine::general_purpose::STANDARD.encode(bytes);
        self.add(format_args!(
            "<image x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" \
             preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" \
             href=\"data:image/png;base64,{data}\"/>\n"
        ));
    }

    fn end(mut self) -> String {
        self.text.push_str("</svg>\n");
        self.text
    }
}

/// An 8-bit RGB PNG; `None` for an empty picture.
fn png(width: usize, height: usize, pixels: &[u8]) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let (width, height) = (u32::try_from(width).ok()?, u32::try_from(height).ok()?);
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().ok()?.write_image_data(pixels).ok()?;
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_few() {
        let texts = |low: f64, high: f64, log: bool| {
            let ticks = Scale::over([low, high], log, true).ticks();
            ticks.into_iter().map(|t| t.1).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(texts(0.0, 1.0, false), "0.0 0.2 0.4 0.6 0.8 1.0");
        assert_eq!(texts(-0.013, 0.004, false), "-0.010 -0.005 0.000");
        assert_eq!(texts(1.0, 10000.0, true), "1 10 100 1000 10000");
    }

    #[test]
    fn legends_stand_below_the_axes() {
        let mut plot = Plot::new("many", "x", "y");
        for i in 0..12 {
            plot.series(&format!("a series of number {i}"), Mark::Line, vec![[0.0, 0.0]]);
        }
        let inner = SIZE[0] - MARGIN[0] - MARGIN[1];
        let lines = plot.legend(inner);
        assert_eq!(lines.iter().map(Vec::len).sum::<usize>(), 12);
        for (x, series) in lines.iter().flatten() {
            assert!(x + SWATCH + CHARACTER * series.label.len() as f64 <= inner, "{x}");
        }
        let height = SIZE[1] + LINE * lines.len() as f64;
        assert!(plot.svg().contains(&format!("viewBox=\"0 0 640 {height:.0}\"")));
    }

    #[test]
    fn odd_data_still_draw() {
        let mut plot = Plot::new("a < b", "x", "y");
        plot.log_x().log_y();
        plot.series("none", Mark::Line, vec![]);
        plot.series("bad", Mark::Points, vec![[0.0, -1.0], [f64::NAN, 1.0], [1.0, 1.0]]);
        let svg = plot.svg();
        assert!(svg.contains("a &lt; b") && !svg.contains("NaN") && svg.ends_with("</svg>\n"));
        let flat =
            heat_map("flat", &Plane::filled(3, 2, 1.0), [0.0, 1.0], [0.0, 1.0], "mm", false);
        assert!(flat.contains("data:image/png;base64,"));
        assert_eq!(picture_grid("empty", &[], &[]).matches("<image").count(), 0);
    }
}
