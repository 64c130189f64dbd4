//! Plots as SVG text of one size: series over linear or logarithmic axes, maps, cells.
//!
//! Title, legend and axis labels are in rows outside the box of the data; names of limits are
//! placed where there are no data. A drawing is for a page, where its colours follow the page and
//! `figure.js` adds values on hover, zoom and export, or a separate file ([`Plot::file`]).
//! The crate `kuva` was tried for the box of the data: it numbers its clip paths by a counter of
//! the process, so that the same plot has other bytes the second time, draws what is not a number
//! as 1e-10 on logarithmic axes, and has neither the ticks nor the groups that pages need.
//!
//! ```
//! use camrig_report::plot::{Colour, Mark, Plot};
//! let mut plot = Plot::new("Noise", "signal, e⁻", "noise, e⁻");
//! plot.log_x().log_y().note("Dots: measured. Line: shot noise.");
//! plot.series("measured", Mark::Points, Colour::Measured, vec![[10.0, 3.3], [1e3, 31.0]]);
//! plot.series("shot", Mark::Line, Colour::Reference, vec![[1.0, 1.0], [1e4, 100.0]]);
//! plot.limit_x(9e3, "full well");
//! assert!(plot.svg().starts_with("<svg"));
//! ```

mod axis;
mod colours;
mod maps;
mod svg;
pub(crate) mod text;

pub use colours::{Colour, Palette, Scale};
pub use maps::{Cells, heat_map, picture_grid, triple};

pub(crate) use colours::page_style;

use axis::Axis;
use camrig_base::Plane;

/// Style of figures, for pages and files alike.
pub(crate) const STYLE: &str = include_str!("plot.css");

/// Quantile of the data on each side that [`Plot::without_outliers`] always shows, and the part of
/// the range between them that it adds on each side.
const SHOWN: f64 = 0.02;
const BESIDE: f64 = 0.5;

/// Size of a figure, px. It is never scaled on a screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Size {
    /// Across.
    pub width: f64,
    /// Down.
    pub height: f64,
}

impl Size {
    /// A figure among others: three across on a desk, two on A4, one on a phone.
    pub const FIGURE: Self = Self { width: 360.0, height: 262.0 };
    /// A headline figure on a desktop and in print; a page also needs [`Size::NARROW`].
    pub const WIDE: Self = Self { width: 640.0, height: 350.0 };
    /// A headline figure on a phone.
    pub const NARROW: Self = Self { width: 358.0, height: 330.0 };
    /// One of small multiples, four across on a desk.
    pub const SMALL: Self = Self { width: 264.0, height: 206.0 };

    /// The same width with another height.
    pub fn high(self, height: f64) -> Self {
        Self { height, ..self }
    }
}

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Mark {
    /// A line through the points; a point without a place breaks it.
    Line,
    /// A dashed line: limits, models.
    Dashed,
    /// Dots.
    Points,
    /// Rings, which stay apart from dots in print without colours.
    Hollow,
    /// Dots on a line.
    LinePoints,
}

#[derive(Clone, Debug)]
struct Series {
    label: String,
    colour: Colour,
    shape: Shape,
}

#[derive(Clone, Debug)]
enum Shape {
    Marks {
        mark: Mark,
        points: Vec<[f64; 2]>,
        errors: Vec<f64>,
    },
    /// x, low, high.
    Band(Vec<[f64; 3]>),
}

/// A line across the box, with its name: at an x or at a y.
#[derive(Clone, Debug)]
struct Limit {
    at: f64,
    upright: bool,
    name: String,
}

/// A rectangle of the plane of the data: left, right and bottom, top edge in units of the axes.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Area {
    x: [f64; 2],
    y: [f64; 2],
}

#[derive(Clone, Debug)]
struct Picture {
    area: Area,
    colours: Plane<[u8; 3]>,
}

/// A filled rectangle with text in its middle.
#[derive(Clone, Debug)]
struct Cell {
    area: Area,
    colour: [u8; 3],
    text: String,
    value: f64,
}

/// A plot over two axes, as it is being put together.
#[derive(Clone, Debug)]
pub struct Plot {
    title: String,
    note: String,
    size: Size,
    x: Axis,
    y: Axis,
    equal: bool,
    without_outliers: bool,
    series: Vec<Series>,
    limits: Vec<Limit>,
    pictures: Vec<Picture>,
    cells: Vec<Cell>,
    /// Heavy lines from point to point.
    edges: Vec<[[f64; 2]; 2]>,
    outlined: Vec<Area>,
    rings: Vec<[f64; 2]>,
    tags: Vec<([f64; 2], String)>,
    scale: Option<Scale>,
}

impl Plot {
    /// An empty plot with a title and the names of the axes, each with its unit.
    pub fn new(title: &str, x: &str, y: &str) -> Self {
        let axis = |label: &str| Axis { label: label.into(), ..Axis::default() };
        Self {
            title: title.into(),
            note: String::new(),
            size: Size::FIGURE,
            x: axis(x),
            y: axis(y),
            equal: false,
            without_outliers: false,
            series: Vec::new(),
            limits: Vec::new(),
            pictures: Vec::new(),
            cells: Vec::new(),
            edges: Vec::new(),
            outlined: Vec::new(),
            rings: Vec::new(),
            tags: Vec::new(),
            scale: None,
        }
    }

    /// Sets the size, [`Size::FIGURE`] otherwise.
    pub fn size(&mut self, size: Size) -> &mut Self {
        self.size = size;
        self
    }

    /// Sets the line below the figure that explains it.
    pub fn note(&mut self, text: &str) -> &mut Self {
        self.note = text.into();
        self
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

    /// Sets the x of the left and the right end, which otherwise follow the data.
    pub fn x_range(&mut self, left: f64, right: f64) -> &mut Self {
        self.x.range = Some([left, right]);
        self
    }

    /// Sets the y of the lower and the upper end, which otherwise follow the data; the larger may
    /// be below, as rows of an image are.
    pub fn y_range(&mut self, bottom: f64, top: f64) -> &mut Self {
        self.y.range = Some([bottom, top]);
        self
    }

    /// Writes names instead of numbers along x.
    pub fn x_names(&mut self, names: Vec<(f64, String)>) -> &mut Self {
        self.x.names = names;
        self
    }

    /// Writes names instead of numbers along y.
    pub fn y_names(&mut self, names: Vec<(f64, String)>) -> &mut Self {
        self.y.names = names;
        self
    }

    /// Draws a unit of x as long as a unit of y, by widening one of the ranges around its middle.
    pub fn equal_units(&mut self) -> &mut Self {
        self.equal = true;
        self
    }

    /// Keeps single values far from the others from squeezing these: the y axis covers all but the
    /// outermost 2 % of the points and half as much again, and the note says how many are left
    /// out.
    pub fn without_outliers(&mut self) -> &mut Self {
        self.without_outliers = true;
        self
    }

    /// Adds points; without a label they are not in the legend.
    pub fn series(
        &mut self,
        label: &str,
        mark: Mark,
        colour: Colour,
        points: Vec<[f64; 2]>,
    ) -> &mut Self {
        // The two greens stay apart without colours.
        let mark = match (mark, colour) {
            (Mark::Line, Colour::GreenInBlue) => Mark::Dashed,
            _ => mark,
        };
        self.add(label, colour, Shape::Marks { mark, points, errors: Vec::new() })
    }

    /// Adds dots, rings or dots on a line with bars of one standard error: x, y, error of y.
    pub fn with_errors(
        &mut self,
        label: &str,
        mark: Mark,
        colour: Colour,
        points: &[[f64; 3]],
    ) -> &mut Self {
        let errors = points.iter().map(|p| p[2]).collect();
        let points = points.iter().map(|p| [p[0], p[1]]).collect();
        self.add(label, colour, Shape::Marks { mark, points, errors })
    }

    /// Adds the band of a model: x, low, high.
    pub fn band(&mut self, label: &str, colour: Colour, points: Vec<[f64; 3]>) -> &mut Self {
        self.add(label, colour, Shape::Band(points))
    }

    /// Adds a histogram as a line of steps: where the first bin begins, width of a bin, counts.
    /// Empty bins on a logarithmic axis break the line.
    pub fn bins(
        &mut self,
        label: &str,
        colour: Colour,
        [start, step]: [f64; 2],
        counts: &[f64],
    ) -> &mut Self {
        let edges = |(i, &n): (usize, &f64)| {
            let left = start + i as f64 * step;
            [[left, n], [left + step, n]]
        };
        let points = counts.iter().enumerate().flat_map(edges).collect();
        self.series(label, Mark::Line, colour, points)
    }

    /// Adds a limit at an x, an upright line with its name.
    pub fn limit_x(&mut self, x: f64, name: &str) -> &mut Self {
        self.limits.push(Limit { at: x, upright: true, name: name.into() });
        self
    }

    /// Adds a limit at a y, a level line with its name.
    pub fn limit_y(&mut self, y: f64, name: &str) -> &mut Self {
        self.limits.push(Limit { at: y, upright: false, name: name.into() });
        self
    }

    /// Puts a ring around a point: the optimum.
    pub fn ring(&mut self, point: [f64; 2]) -> &mut Self {
        self.rings.push(point);
        self
    }

    /// Writes text next to a point: to its left, or to its right if there is no room.
    pub fn tag(&mut self, point: [f64; 2], text: &str) -> &mut Self {
        self.tags.push((point, text.into()));
        self
    }

    /// Lays a picture under the data, its edges at x left and right and y bottom and top.
    pub fn picture(&mut self, colours: Plane<[u8; 3]>, x: [f64; 2], y: [f64; 2]) -> &mut Self {
        if !colours.data.is_empty() {
            self.pictures.push(Picture { area: Area { x, y }, colours });
        }
        self
    }

    /// Draws the bar of a scale of colours below the box, with its ends and unit.
    pub fn bar(&mut self, scale: &Scale) -> &mut Self {
        self.scale = Some(scale.clone());
        self
    }

    fn add(&mut self, label: &str, colour: Colour, shape: Shape) -> &mut Self {
        self.series.push(Series { label: label.into(), colour, shape });
        self
    }

    /// The title.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// The drawing as SVG text for a page, which has its style.
    pub fn svg(&self) -> String {
        svg::Drawing::of(self).svg("")
    }

    /// The drawing as a separate file: light, without CSS variables.
    pub fn file(&self) -> String {
        let style = format!("{STYLE}{}{}", include_str!("file.css"), colours::file_style());
        svg::Drawing::of(self).svg(&style)
    }

    /// The drawing as a figure of a page: with its note, and its data for `figure.js`.
    pub(crate) fn figure(&self, class: &str) -> String {
        svg::Drawing::of(self).figure(class)
    }

    /// All y of the points and, for bands and bars, of their ends.
    fn values(&self, index: usize) -> Vec<f64> {
        let mut all = Vec::new();
        for series in &self.series {
            match &series.shape {
                Shape::Marks { points, errors, .. } => {
                    all.extend(points.iter().map(|p| p[index]));
                    if index == 1 {
                        let ends = points.iter().zip(errors).filter(|(_, e)| e.is_finite());
                        all.extend(ends.flat_map(|(p, e)| [p[1] - e, p[1] + e]));
                    }
                }
                Shape::Band(points) if index == 0 => all.extend(points.iter().map(|p| p[0])),
                Shape::Band(points) => all.extend(points.iter().flat_map(|p| [p[1], p[2]])),
            }
        }
        let areas = self.pictures.iter().map(|p| p.area).chain(self.cells.iter().map(|c| c.area));
        all.extend(areas.flat_map(|a| if index == 0 { a.x } else { a.y }));
        all.extend(self.limits.iter().filter(|l| l.upright == (index == 0)).map(|l| l.at));
        all
    }

    /// The values that decide the range of y, and how many points lie outside it.
    fn shown_values(&self) -> (Vec<f64>, usize) {
        let all = self.values(1);
        let mut sorted: Vec<f64> = all.iter().copied().filter(|v| self.y.takes(*v)).collect();
        if !self.without_outliers || sorted.is_empty() {
            return (all, 0);
        }
        sorted.sort_by(f64::total_cmp);
        let quantile = |q: f64| sorted[(q * (sorted.len() - 1) as f64).round() as usize];
        let [low, high] = [quantile(SHOWN), quantile(1.0 - SHOWN)];
        let beside = BESIDE * (high - low);
        let inside = |v: &f64| (low - beside..=high + beside).contains(v);
        let shown: Vec<f64> = sorted.iter().copied().filter(inside).collect();
        let out = sorted.len() - shown.len();
        (shown, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of an attribute of an element, in the order of the drawing.
    fn numbers(svg: &str, element: &str, attribute: &str) -> Vec<f64> {
        let (element, attribute) = (format!("<{element} "), format!(" {attribute}=\""));
        let of = |part: &str| {
            let tag = format!(" {}", part.split('>').next()?);
            tag.split(&attribute).nth(1)?.split('"').next()?.parse().ok()
        };
        svg.split(&element).skip(1).filter_map(of).collect()
    }

    #[test]
    fn points_lie_where_their_values_say() {
        let mut plot = Plot::new("t", "x, s", "y, DN");
        plot.log_x().x_range(1.0, 100.0).y_range(0.0, 10.0);
        let points = vec![[1.0, 0.0], [10.0, 5.0], [100.0, 10.0]];
        plot.series("", Mark::Points, Colour::Measured, points);
        let svg = plot.svg();
        let (x, y) = (numbers(&svg, "circle", "cx"), numbers(&svg, "circle", "cy"));
        assert_eq!(x.len(), 3);
        assert!((x[1] - 0.5 * (x[0] + x[2])).abs() < 0.11, "a decade is half of two: {x:?}");
        assert!((y[1] - 0.5 * (y[0] + y[2])).abs() < 0.11 && y[0] > y[2], "{y:?}");
    }

    #[test]
    fn the_two_greens_differ_in_more_than_colour() {
        let draw = |name: &str, mark| {
            let mut plot = Plot::new("t", "x", "y");
            let points = vec![[0.0, 1.0], [1.0, 2.0]];
            plot.series(name, mark, Colour::of_channel(name), points).svg()
        };
        for (mark, own) in [(Mark::Line, "class=\"l dash gb\""), (Mark::Points, "class=\"mk\"")] {
            assert!(draw("Gb", mark).contains(own), "{}", draw("Gb", mark));
            assert!(!draw("Gr", mark).contains("dash") && !draw("Gr", mark).contains("mk"));
        }
    }

    #[test]
    fn odd_data_still_draw_and_break_lines() {
        let mut plot = Plot::new("a < b", "x", "y");
        plot.log_x().log_y();
        plot.series("none", Mark::Line, Colour::Red, vec![]);
        let odd =
            vec![[1.0, 1.0], [2.0, 2.0], [3.0, f64::NAN], [4.0, -1.0], [5.0, 5.0], [6.0, 6.0]];
        plot.series("bad", Mark::Line, Colour::Blue, odd);
        let svg = plot.svg();
        assert!(svg.contains("a &lt; b") && !svg.contains("NaN") && svg.ends_with("</svg>"));
        let path = svg.split("class=\"l bl\" d=\"").last().unwrap();
        let path = path.split('"').next().unwrap();
        assert_eq!(path.matches('M').count(), 2, "two pieces: {path}");
        assert_eq!(path.matches('L').count(), 2, "{path}");
    }

    #[test]
    fn the_same_plot_has_the_same_bytes() {
        let draw = || {
            let mut plot = Plot::new("t", "x", "y");
            plot.series("a", Mark::LinePoints, Colour::Red, vec![[0.0, 1.0], [1.0, 2.0]]);
            plot.figure("")
        };
        assert_eq!(draw(), draw());
    }

    #[test]
    fn the_name_of_a_limit_avoids_the_data_or_goes_into_the_legend() {
        let name = |svg: &str| numbers(svg, "text class=\"rl refc\"", "y");
        let mut plot = Plot::new("t", "x", "y");
        plot.x_range(0.0, 10.0).y_range(0.0, 10.0).limit_y(5.0, "limit");
        // Data above the whole line: the name is below it.
        let above = (0..200).map(|i| [0.05 * f64::from(i), 5.4]).collect();
        plot.series("", Mark::Points, Colour::Red, above);
        let line = numbers(&plot.svg(), "circle", "cy")[0];
        assert!(name(&plot.svg())[0] > line + 12.0);
        // A wall of data leaves no place: the legend names it.
        let wall = (0..4000).map(|i| [0.2 * f64::from(i % 50), 0.125 * f64::from(i / 50)]);
        plot.series("", Mark::Points, Colour::Red, wall.collect());
        let svg = plot.svg();
        assert!(name(&svg).is_empty() && svg.contains(">limit</text>"), "{svg}");
    }

    #[test]
    fn one_outlier_does_not_squeeze_the_rest_and_is_told() {
        let mut plot = Plot::new("t", "x", "y");
        let mut points: Vec<_> = (0..100).map(|i| [f64::from(i), f64::from(i % 7)]).collect();
        points.push([50.0, 1e6]);
        plot.series("", Mark::Points, Colour::Red, points).without_outliers().note("Read it.");
        let figure = plot.figure("");
        assert!(figure.contains("Read it. Beyond the axis: 1 of 101 values."), "{figure}");
        assert!(numbers(&plot.svg(), "circle", "cy").len() == 100);
    }

    #[test]
    fn a_file_needs_no_style_from_elsewhere() {
        let mut plot = Plot::new("t", "x", "y");
        plot.series("a", Mark::Line, Colour::Red, vec![[0.0, 1.0], [1.0, 2.0]]);
        let file = plot.file();
        assert!(file.contains("#c44a00") && file.contains("xmlns"));
        assert!(!file.contains("var(") && !file.contains("light-dark"), "{file}");
    }
}
