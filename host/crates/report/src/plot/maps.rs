//! Maps: planes of values as pictures, tables of values as cells, small pictures in rows.

use super::{Area, Cell, Palette, Plot, Scale, Size};
use crate::numbers::number;
use camrig_base::Plane;

/// Least and largest height of a map, px, and what of it is not the box, down and across.
const HEIGHTS: [f64; 2] = [170.0, 520.0];
const FRAME: [f64; 2] = [106.0, 54.0];
/// Height of a row of cells and of a row of small pictures, px.
const CELL_ROW: f64 = 28.0;
const PICTURE_ROW: f64 = 92.0;
/// Half the side of a small picture, in rows and columns.
const HALF: f64 = 0.47;
/// Standard deviations, of both differences together, that the scale of a [`triple`] reaches.
const DEVIATIONS: f64 = 3.0;

/// A map of a plane of values with the bar of its scale. `x` and `y` are the coordinates of the
/// outer edges, left to right and top to bottom, in what the names of the axes say; the height of
/// the figure follows the sides of the plane.
pub fn heat_map(
    title: &str,
    plane: &Plane<f64>,
    [x_name, y_name]: [&str; 2],
    [x, y]: [[f64; 2]; 2],
    scale: &Scale,
) -> Plot {
    let mut plot = Plot::new(title, x_name, y_name);
    let across = Size::FIGURE.width - FRAME[1];
    let down = across * plane.height as f64 / plane.width.max(1) as f64;
    let height = (down + FRAME[0]).clamp(HEIGHTS[0], HEIGHTS[1]).round();
    plot.size(Size::FIGURE.high(height)).x_range(x[0], x[1]).y_range(y[1], y[0]);
    plot.picture(scale.picture(plane), x, y).bar(scale);
    plot
}

/// Measured, and what two models leave of it: three maps, the two differences on one scale, which
/// reaches three standard deviations of both together. `planes` are measured, model before and
/// model after.
pub fn triple(
    titles: [&str; 3],
    planes: [&Plane<f64>; 3],
    names: [&str; 2],
    ranges: [[f64; 2]; 2],
    unit: &str,
) -> [Plot; 3] {
    let [measured, before, after] = planes;
    let less = |model: &Plane<f64>| Plane {
        data: measured.data.iter().zip(&model.data).map(|(m, v)| m - v).collect(),
        ..*measured
    };
    let differences = [less(before), less(after)];
    let (mut sum, mut count) = (0.0, 0.0);
    for v in differences.iter().flat_map(|d| &d.data).filter(|v| v.is_finite()) {
        (sum, count) = (sum + v * v, count + 1.0);
    }
    let most = DEVIATIONS * (sum / f64::max(count, 1.0)).sqrt();
    let ends = ends(&measured.data);
    let scales =
        [Scale::light(ends, unit), Scale::differences(most, unit), Scale::differences(most, unit)];
    let shown = [measured, &differences[0], &differences[1]];
    [0, 1, 2].map(|i| heat_map(titles[i], shown[i], names, ranges, &scales[i]))
}

/// The least and the largest of values.
fn ends(values: &[f64]) -> [f64; 2] {
    let finite = values.iter().copied().filter(|v| v.is_finite());
    let ends = finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
    if ends[0] <= ends[1] { ends } else { [0.0, 1.0] }
}

/// A table of values as cells of colour with the number in each.
///
/// ```
/// use camrig_report::plot::{Cells, Scale};
/// let values = vec![Some(87.0), Some(45.0), Some(168.0), None];
/// let mut cells = Cells::new(["1.0", "1.4"].map(String::from).to_vec(),
///     ["f/1.4", "f/2"].map(String::from).to_vec(), values);
/// cells.best(1, 0).region(&[true, true, false, false]);
/// let scale = Scale::amounts([45.0, 168.0], "lx").logarithmic().reversed();
/// let plot = cells.plot("Light for SNR 10", ["pixel pitch, µm", "f-number"], &scale);
/// assert!(plot.svg().contains(">168</text>"));
/// ```
#[derive(Clone, Debug)]
pub struct Cells {
    columns: Vec<String>,
    rows: Vec<String>,
    values: Vec<Option<f64>>,
    texts: Option<Vec<String>>,
    best: Option<[usize; 2]>,
    region: Vec<bool>,
}

impl Cells {
    /// Cells row by row from the top; `None` is an empty one.
    pub fn new(columns: Vec<String>, rows: Vec<String>, values: Vec<Option<f64>>) -> Self {
        Self { columns, rows, values, texts: None, best: None, region: Vec::new() }
    }

    /// Sets the text of the cells, by default their number.
    pub fn texts(&mut self, texts: Vec<String>) -> &mut Self {
        self.texts = Some(texts);
        self
    }

    /// Outlines a cell: the optimum.
    pub fn best(&mut self, column: usize, row: usize) -> &mut Self {
        self.best = Some([column, row]);
        self
    }

    /// Draws a heavy line around the cells that meet a need, row by row from the top.
    pub fn region(&mut self, inside: &[bool]) -> &mut Self {
        self.region = inside.to_vec();
        self
    }

    /// The plot.
    pub fn plot(&self, title: &str, [x_name, y_name]: [&str; 2], scale: &Scale) -> Plot {
        let mut plot = Plot::new(title, x_name, y_name);
        let (across, down) = (self.columns.len(), self.rows.len());
        let height = (FRAME[0] + CELL_ROW * down as f64).max(HEIGHTS[0]);
        plot.size(Size::FIGURE.high(height)).bar(scale);
        plot.x_range(-0.5, across as f64 - 0.5).y_range(down as f64 - 0.5, -0.5);
        plot.x_names(numbered(&self.columns)).y_names(numbered(&self.rows));
        for (i, value) in self.values.iter().enumerate().take(across * down) {
            let Some(value) = *value else { continue };
            let own = self.texts.as_ref().and_then(|t| t.get(i)).cloned();
            plot.cells.push(Cell {
                area: cell_area(i % across, i / across),
                colour: scale.colour(value),
                text: own.unwrap_or_else(|| number(value)),
                value,
            });
        }
        plot.outlined = self.best.iter().map(|[c, r]| cell_area(*c, *r)).collect();
        plot.edges = self.borders();
        plot
    }

    /// Sides between cells inside and outside the region, within the table.
    fn borders(&self) -> Vec<[[f64; 2]; 2]> {
        let (across, down) = (self.columns.len(), self.rows.len());
        let inside = |c: usize, r: usize| self.region.get(r * across + c).copied();
        let mut all = Vec::new();
        for r in 0..down {
            for c in 0..across {
                let (x, y) = (c as f64 + 0.5, r as f64 + 0.5);
                if c + 1 < across && inside(c, r) != inside(c + 1, r) {
                    all.push([[x, y - 1.0], [x, y]]);
                }
                if r + 1 < down && inside(c, r) != inside(c, r + 1) {
                    all.push([[x - 1.0, y], [x, y]]);
                }
            }
        }
        all
    }
}

fn cell_area(column: usize, row: usize) -> Area {
    let (x, y) = (column as f64, row as f64);
    Area { x: [x - 0.5, x + 0.5], y: [y - 0.5, y + 0.5] }
}

fn numbered(names: &[String]) -> Vec<(f64, String)> {
    names.iter().enumerate().map(|(i, name)| (i as f64, name.clone())).collect()
}

/// Small pictures in rows and columns, with a heading per row and column. Each has its own range,
/// from 0; the square root of the values is shown.
pub fn picture_grid(
    title: &str,
    columns: &[String],
    rows: &[(String, Vec<Plane<f64>>)],
    [x_name, y_name]: [&str; 2],
) -> Plot {
    let mut plot = Plot::new(title, x_name, y_name);
    let (across, down) = (columns.len().max(1) as f64, rows.len().max(1) as f64);
    plot.size(Size::FIGURE.high(FRAME[0] + PICTURE_ROW * down));
    plot.x_range(-0.5, across - 0.5).y_range(down - 0.5, -0.5).equal_units();
    let names: Vec<String> = rows.iter().map(|r| r.0.clone()).collect();
    plot.x_names(numbered(columns)).y_names(numbered(&names));
    for (row, (_, planes)) in rows.iter().enumerate() {
        for (column, plane) in planes.iter().enumerate() {
            let [_, high] = ends(&plane.data);
            let shade = |&v: &f64| Palette::Inferno.colour((v / high).max(0.0).sqrt());
            let data = plane.data.iter().map(shade).collect();
            let picture = Plane { width: plane.width, height: plane.height, data };
            let around = |at: usize| [at as f64 - HALF, at as f64 + HALF];
            plot.picture(picture, around(column), around(row));
        }
    }
    plot
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_of_a_triple_share_one_scale_with_zero_in_the_middle() {
        let plane = |v: f64| Plane::from_fn(4, 2, |x, _| v * x as f64);
        let maps = triple(
            ["measured", "before", "after"],
            [&plane(3.0), &plane(1.0), &plane(3.0)],
            ["column", "row"],
            [[0.0, 4.0], [0.0, 2.0]],
            "e⁻",
        );
        assert_eq!(maps[1].scale, maps[2].scale);
        let white = maps[2].pictures[0].colours.data.iter().all(|c| *c == [246, 246, 246]);
        assert!(white, "nothing is left");
        assert!(maps[0].scale != maps[1].scale);
    }

    #[test]
    fn the_region_is_bordered_where_it_ends() {
        let names = |n: usize| (0..n).map(|i| i.to_string()).collect::<Vec<_>>();
        let mut cells = Cells::new(names(2), names(2), vec![Some(1.0); 4]);
        cells.region(&[true, false, false, false]);
        assert_eq!(cells.borders(), [[[0.5, -0.5], [0.5, 0.5]], [[-0.5, 0.5], [0.5, 0.5]]]);
    }

    #[test]
    fn flat_and_empty_planes_draw() {
        let scale = Scale::amounts([1.0, 1.0], "mm");
        let flat = Plane::filled(3, 2, 1.0);
        let map = heat_map("flat", &flat, ["x", "y"], [[0.0, 3.0], [0.0, 2.0]], &scale);
        assert!(map.svg().contains("data:image/png;base64,"));
        assert_eq!(picture_grid("empty", &[], &[], ["", ""]).svg().matches("<image").count(), 0);
    }
}
