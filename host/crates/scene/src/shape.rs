//! Flat shapes and the exact share of each grid cell that they cover.
//!
//! Coverage is computed in closed form, never by sampling, so a chart has the same light at any
//! resolution: the sum over cells of coverage times cell area is the shape's area.

use super::Grid;
use camrig_base::Plane;

/// A point (u, v) in frame coordinates.
pub type Point = [f64; 2];

/// A shape in frame coordinates.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Shape {
    /// Axis-parallel rectangle.
    Rect {
        /// Least u.
        left: f64,
        /// Least v.
        top: f64,
        /// Extent in u.
        width: f64,
        /// Extent in v.
        height: f64,
    },
    /// Disc.
    Disc {
        /// Its centre.
        centre: Point,
        /// Its radius.
        radius: f64,
    },
    /// Simple polygon (no crossing edges), either sense of rotation.
    Polygon(Vec<Point>),
    /// All points p with (p − origin) · normal > 0.
    HalfPlane {
        /// A point of the edge.
        origin: Point,
        /// Points into the half-plane.
        normal: Point,
    },
}

impl Shape {
    /// Adds `value` times the covered share of each cell to `plane`, whose size is that of `grid`.
    pub fn paint(&self, grid: &Grid, value: f32, plane: &mut Plane<f32>) {
        match self {
            Shape::Rect { left, top, width, height } => {
                paint_rect([*left, *top], [left + width, top + height], grid, value, plane);
            }
            Shape::Disc { centre, radius } => paint_disc(*centre, *radius, grid, value, plane),
            Shape::Polygon(points) => paint_polygon(points, grid, value, plane),
            Shape::HalfPlane { origin, normal } => {
                let (right, bottom) = (
                    grid.left + grid.cell * grid.width as f64,
                    grid.top + grid.cell * grid.height as f64,
                );
                let frame = [
                    [grid.left, grid.top],
                    [right, grid.top],
                    [right, bottom],
                    [grid.left, bottom],
                ];
                paint_polygon(&clip(&frame, *origin, *normal), grid, value, plane);
            }
        }
    }
}

/// Indices of the cells that the interval `from..to` touches, out of `count` cells from `start`.
fn touched(from: f64, to: f64, start: f64, cell: f64, count: usize) -> std::ops::Range<usize> {
    let first = ((from - start) / cell).floor().clamp(0.0, count as f64) as usize;
    let last = ((to - start) / cell).ceil().clamp(0.0, count as f64) as usize;
    first..last.max(first)
}

/// The share of cell `index` that lies in `from..to`, 0 to 1.
fn overlap(index: usize, from: f64, to: f64, start: f64, cell: f64) -> f64 {
    let a = (from - start) / cell - index as f64;
    let b = (to - start) / cell - index as f64;
    (b.min(1.0) - a.max(0.0)).max(0.0)
}

fn paint_rect(min: Point, max: Point, grid: &Grid, value: f32, plane: &mut Plane<f32>) {
    let columns = touched(min[0], max[0], grid.left, grid.cell, grid.width);
    let across: Vec<f32> = columns
        .clone()
        .map(|x| overlap(x, min[0], max[0], grid.left, grid.cell) as f32 * value)
        .collect();
    for y in touched(min[1], max[1], grid.top, grid.cell, grid.height) {
        let down = overlap(y, min[1], max[1], grid.top, grid.cell) as f32;
        for (cell, part) in plane.row_mut(y)[columns.clone()].iter_mut().zip(&across) {
            *cell += part * down;
        }
    }
}

fn paint_disc(centre: Point, radius: f64, grid: &Grid, value: f32, plane: &mut Plane<f32>) {
    // In units of cells, the disc's centre at the origin.
    let r = radius / grid.cell;
    let [u, v] = [grid.left - centre[0], grid.top - centre[1]]
        .map(|start| move |index: usize| start / grid.cell + index as f64);
    let columns =
        touched(centre[0] - radius, centre[0] + radius, grid.left, grid.cell, grid.width);
    let rows = touched(centre[1] - radius, centre[1] + radius, grid.top, grid.cell, grid.height);
    // Quadrants of a line of corners: each corner is that of four cells.
    let line = |y: usize| -> Vec<f64> {
        (columns.start..=columns.end).map(|x| disc_quadrant(u(x), v(y), r)).collect()
    };
    let mut above = line(rows.start);
    for y in rows {
        let below = line(y + 1);
        for (i, x) in columns.clone().enumerate() {
            let far = u(x).powi(2).max(u(x + 1).powi(2)) + v(y).powi(2).max(v(y + 1).powi(2));
            let part = below[i + 1] - below[i] - above[i + 1] + above[i];
            let covered = if far <= r * r { 1.0 } else { part.clamp(0.0, 1.0) };
            plane.data[y * grid.width + x] += covered as f32 * value;
        }
        above = below;
    }
}

/// Area of the disc of radius r about the origin within the rectangle from the origin to (x, y),
/// negative where one of x and y is.
fn disc_quadrant(x: f64, y: f64, r: f64) -> f64 {
    let sign = x.signum() * y.signum();
    let (x, y) = (x.abs().min(r), y.abs().min(r));
    if x * x + y * y <= r * r {
        return sign * x * y;
    }
    // Up to `flat` the rectangle's edge y lies below the circle; beyond it the circle is the
    // bound.
    let flat = (r * r - y * y).max(0.0).sqrt();
    let under_circle =
        |t: f64| 0.5 * (t * (r * r - t * t).max(0.0).sqrt() + r * r * libm::asin(t / r));
    sign * (y * flat + under_circle(x) - under_circle(flat))
}

/// The part of a convex polygon with (p − origin) · normal > 0.
fn clip(polygon: &[Point], origin: Point, normal: Point) -> Vec<Point> {
    let height = |p: &Point| (p[0] - origin[0]) * normal[0] + (p[1] - origin[1]) * normal[1];
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, p) in polygon.iter().enumerate() {
        let q = &polygon[(i + 1) % polygon.len()];
        let (hp, hq) = (height(p), height(q));
        if hp > 0.0 {
            kept.push(*p);
        }
        if (hp > 0.0) != (hq > 0.0) {
            let t = hp / (hp - hq);
            kept.push([p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
        }
    }
    kept
}

/// Exact area coverage by summing, over the polygon's edges, the area between edge and the right
/// border of the grid; the coverage is the running sum along each row.
fn paint_polygon(points: &[Point], grid: &Grid, value: f32, plane: &mut Plane<f32>) {
    if points.len() < 3 {
        return;
    }
    let cells: Vec<Point> = points
        .iter()
        .map(|p| [(p[0] - grid.left) / grid.cell, (p[1] - grid.top) / grid.cell])
        .collect();
    let extreme = |axis: usize, pick: fn(f64, f64) -> f64| {
        cells.iter().map(|p| p[axis]).fold(cells[0][axis], pick)
    };
    let rows = touched(extreme(1, f64::min), extreme(1, f64::max), 0.0, 1.0, grid.height);
    let columns = touched(extreme(0, f64::min), extreme(0, f64::max), 0.0, 1.0, grid.width);
    if rows.is_empty() || columns.is_empty() {
        return;
    }
    let width = columns.len();
    let mut edges = vec![0.0; (width + 1) * rows.len()];
    let mut twice_area = 0.0;
    for (i, p) in cells.iter().enumerate() {
        let q = &cells[(i + 1) % cells.len()];
        twice_area += p[0] * q[1] - q[0] * p[1];
        let local =
            |point: &Point| [point[0] - columns.start as f64, point[1] - rows.start as f64];
        add_edge(local(p), local(q), width, rows.len(), &mut edges);
    }
    // An edge going up (v falling) opens the shape when its points run clockwise as seen (v down).
    let sign = if twice_area > 0.0 { -1.0 } else { 1.0 };
    for (y, row_edges) in rows.zip(edges.chunks_exact(width + 1)) {
        let mut sum = 0.0;
        for (cell, edge) in plane.row_mut(y)[columns.clone()].iter_mut().zip(row_edges) {
            sum += edge;
            *cell += (sign * sum).clamp(0.0, 1.0) as f32 * value;
        }
    }
}

/// Adds one edge, in cells, to the per-row differences of signed area.
fn add_edge(p: Point, q: Point, width: usize, height: usize, edges: &mut [f64]) {
    let (top, bottom, sense) = if p[1] < q[1] { (p, q, 1.0) } else { (q, p, -1.0) };
    let slope = (bottom[0] - top[0]) / (bottom[1] - top[1]);
    if !slope.is_finite() {
        return;
    }
    for y in touched(top[1], bottom[1], 0.0, 1.0, height) {
        let y0 = top[1].max(y as f64);
        let y1 = bottom[1].min(y as f64 + 1.0);
        if y1 > y0 {
            let (xa, xb) = (top[0] + slope * (y0 - top[1]), top[0] + slope * (y1 - top[1]));
            let row = &mut edges[y * (width + 1)..(y + 1) * (width + 1)];
            spread(xa.min(xb), xa.max(xb), sense * (y1 - y0), width, row);
        }
    }
}

/// Adds a piece of edge within one row that runs from column position `lo` to `hi` over the signed
/// height `rise`. What lies left of the grid covers the row from its start.
fn spread(lo: f64, hi: f64, rise: f64, width: usize, row: &mut [f64]) {
    let span = hi - lo;
    let part = |a: f64, b: f64| if span > 0.0 { rise * (b - a).max(0.0) / span } else { 0.0 };
    if span <= 0.0 && (lo < 0.0 || lo >= width as f64) {
        if lo < 0.0 {
            row[0] += rise;
        }
        return;
    }
    row[0] += part(lo, hi.min(0.0));
    for x in touched(lo, hi.max(lo + f64::EPSILON), 0.0, 1.0, width) {
        let (a, b) = (lo.max(x as f64), hi.min(x as f64 + 1.0));
        let piece = if span > 0.0 { part(a, b) } else { rise };
        let right_of = (a + b) / 2.0 - x as f64;
        row[x] += piece * (1.0 - right_of);
        row[x + 1] += piece * right_of;
        if span <= 0.0 {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Grid = Grid { width: 24, height: 18, left: -0.5, top: -0.375, cell: 1.0 / 24.0 };

    fn coverage(shape: &Shape, grid: &Grid) -> Plane<f32> {
        let mut plane = Plane::filled(grid.width, grid.height, 0.0);
        shape.paint(grid, 1.0, &mut plane);
        plane
    }

    fn area(shape: &Shape, grid: &Grid) -> f64 {
        coverage(shape, grid).data.iter().map(|&c| f64::from(c)).sum::<f64>()
            * grid.cell
            * grid.cell
    }

    /// Coverage is held in f32 (relative 6e-8 per cell).
    const TOLERANCE: f64 = 1e-7;

    #[test]
    fn areas_are_exact_at_any_resolution() {
        let (centre, radius) = ([0.013, -0.02], 0.217);
        for scale in [1, 3, 40] {
            let cell = GRID.cell / f64::from(scale);
            let grid =
                Grid { width: 24 * scale as usize, height: 18 * scale as usize, cell, ..GRID };
            let disc = area(&Shape::Disc { centre, radius }, &grid);
            assert!((disc - std::f64::consts::PI * radius * radius).abs() < TOLERANCE, "{disc}");
            let rect = Shape::Rect { left: -0.31, top: -0.123, width: 0.4567, height: 0.0021 };
            assert!((area(&rect, &grid) - 0.4567 * 0.0021).abs() < TOLERANCE);
            let star = [[0.0, -0.3], [0.05, 0.0], [0.3, 0.1], [-0.02, 0.11], [-0.4, 0.2]];
            let shoelace: f64 = (0..5)
                .map(|i| {
                    let (p, q) = (star[i], star[(i + 1) % 5]);
                    (p[0] * q[1] - q[0] * p[1]) / 2.0
                })
                .sum();
            let mut points = star.to_vec();
            assert!((area(&Shape::Polygon(points.clone()), &grid) - shoelace).abs() < TOLERANCE);
            points.reverse();
            assert!((area(&Shape::Polygon(points), &grid) - shoelace).abs() < TOLERANCE);
        }
    }

    /// A disc cell by cell against a 64-gon inscribed in it, whose area is known to be smaller by
    /// at most the sagitta of its sides, and against the polygon code's independent arithmetic.
    #[test]
    fn disc_agrees_with_a_polygon_of_many_sides() {
        let (centre, radius, sides) = ([0.1, 0.05], 0.2, 4096);
        let points = (0..sides)
            .map(|i| {
                let a = std::f64::consts::TAU * f64::from(i) / f64::from(sides);
                [centre[0] + radius * a.cos(), centre[1] + radius * a.sin()]
            })
            .collect();
        let disc = coverage(&Shape::Disc { centre, radius }, &GRID);
        let polygon = coverage(&Shape::Polygon(points), &GRID);
        // Sagitta r (1 − cos(π/n)) = 6e-8 over a cell of 1/24: 1.4e-6, twice at a corner.
        for (a, b) in disc.data.iter().zip(&polygon.data) {
            assert!((a - b).abs() < 3e-6, "{a} {b}");
        }
    }

    #[test]
    fn shapes_that_leave_the_grid_are_cut_off() {
        let big = [[-9.0, -7.0], [8.0, -7.5], [9.0, 8.0], [-7.0, 9.0]];
        assert!(coverage(&Shape::Polygon(big.to_vec()), &GRID).data.iter().all(|&c| c == 1.0));
        assert!(
            coverage(&Shape::Disc { centre: [0.0, 0.0], radius: 2.0 }, &GRID)
                .data
                .iter()
                .all(|&c| c == 1.0)
        );
        let outside = Shape::Polygon(vec![[2.0, 0.0], [3.0, 0.0], [2.5, 1.0]]);
        assert!(coverage(&outside, &GRID).data.iter().all(|&c| c == 0.0));
        let left = Shape::Polygon(vec![[-9.0, -0.2], [-0.3, 0.0], [-9.0, 0.2]]);
        // Within the frame: a triangle of base 0.4 (0.2/8.7) and height 0.2.
        let inside = 0.2 * 0.2 * (0.2 / 8.7);
        assert!((area(&left, &GRID) - inside).abs() < TOLERANCE);
    }

    /// A half-plane in one cell has a closed form: with the edge's normal (nx, ny) and distance d
    /// of the cell's lower corner, ½ d²/(nx ny) while the edge cuts the corner off.
    #[test]
    fn half_plane_in_a_cell_is_the_closed_form() {
        let grid = Grid { width: 1, height: 1, left: 0.0, top: 0.0, cell: 1.0 };
        let (nx, ny) = (0.6, 0.8);
        for d in [0.1, 0.3, 0.59] {
            let shape = Shape::HalfPlane { origin: [d * nx, d * ny], normal: [-nx, -ny] };
            let expected = 0.5 * d * d / (nx * ny);
            assert!((area(&shape, &grid) - expected).abs() < TOLERANCE);
        }
    }

    #[test]
    fn vertical_edges_fall_where_they_should() {
        let grid = Grid { width: 4, height: 1, left: 0.0, top: 0.0, cell: 1.0 };
        let shape = Shape::HalfPlane { origin: [1.25, 0.0], normal: [1.0, 0.0] };
        assert_eq!(coverage(&shape, &grid).data, [0.0, 0.75, 1.0, 1.0]);
        let edge = Shape::HalfPlane { origin: [2.0, 0.0], normal: [1.0, 0.0] };
        assert_eq!(coverage(&edge, &grid).data, [0.0, 0.0, 1.0, 1.0]);
    }
}
