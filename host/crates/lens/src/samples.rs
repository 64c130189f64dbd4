//! The pupil as a grid of traced rays, each with the share of its cell that light passes.

use super::pupil::{Bundle, Extent, Outline};
use super::trace::LANES;

/// Rays over a pupil, or over half of one that is its mirror image.
#[derive(Clone, Debug)]
pub struct PupilSamples {
    /// What the rays run over.
    pub extent: Extent,
    /// The rays that pass, cell by cell.
    pub rays: Vec<Sample>,
    /// Radiant power through the whole pupil: Σ power · launch area, of both halves.
    pub power: f64,
    /// Launch area of a whole cell, mm².
    pub cell_mm2: f64,
}

/// One ray and the part of the pupil that it represents.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Direction cosines x and y at the image.
    pub direction: [f64; 2],
    /// Where it meets the image plane, relative to the chief ray, mm.
    pub landing: [f64; 2],
    /// Its phase as a plane wave at the chief ray's image point, waves.
    pub phase: f64,
    /// Its optical path difference to the chief ray on the reference sphere, waves.
    pub opd: f64,
    /// Radiant power through its cell.
    pub power: f64,
    /// Amplitude of its plane wave times the solid angle it represents: √(power · dL dM). With it
    /// the squared modulus of the summed waves is the irradiance on the image plane (Parseval),
    /// whatever the spacing of directions.
    pub amplitude: f64,
}

/// The traced rays, one entry per node of the grid.
struct Nodes {
    columns: usize,
    rows: usize,
    l: Vec<f64>,
    m: Vec<f64>,
    x: Vec<f64>,
    y: Vec<f64>,
    phase: Vec<f64>,
    opd: Vec<f64>,
}

impl PupilSamples {
    /// Traces a grid with `across` square cells over the pupil's extent in y. An outline that is
    /// resolved is at least a hundredth as high as wide, which bounds the grid.
    #[must_use]
    pub fn trace(beam: &impl Bundle, outline: &Outline, across: usize) -> Self {
        let ([low, high], widest) = outline.bounds();
        let left = outline.left();
        let cell = (high - low) / across as f64;
        let inner_columns = (((widest - left) / cell).ceil() as usize).max(1);
        let coverage = coverage(outline, [inner_columns, across], [left, low], cell);
        // One node more on every side but the mirror's, for differences across cell borders.
        let before = match outline.extent {
            Extent::MirrorHalf => 0,
            Extent::Whole => 1,
        };
        let columns = (before + inner_columns + 1).next_multiple_of(LANES);
        let rows = across + 2;
        let count = columns * rows;
        let mut nodes = Nodes {
            columns,
            rows,
            l: vec![0.0; count],
            m: vec![0.0; count],
            x: vec![0.0; count],
            y: vec![0.0; count],
            phase: vec![0.0; count],
            opd: vec![0.0; count],
        };
        let place = |column: usize, row: usize| {
            let from_left = column as f64 + 0.5 - before as f64;
            [left + from_left * cell, low + (row as f64 - 0.5) * cell]
        };
        let chief = beam.chief();
        let chief = [chief.position[0][0], chief.position[1][0]];
        for row in 0..rows {
            for block in (0..columns).step_by(LANES) {
                let rays = beam.trace(&std::array::from_fn(|i| place(block + i, row)));
                for i in 0..LANES {
                    let node = row * columns + block + i;
                    nodes.l[node] = rays.direction[0][i];
                    nodes.m[node] = rays.direction[1][i];
                    nodes.x[node] = rays.position[0][i] - chief[0];
                    nodes.y[node] = rays.position[1][i] - chief[1];
                    nodes.phase[node] = beam.plane_wave_phase(&rays, i);
                    nodes.opd[node] = beam.opd_waves(&rays, i);
                }
            }
        }
        let mut rays = Vec::with_capacity(inner_columns * across);
        let (mut power, area) = (0.0, cell * cell);
        let copies = outline.extent.copies();
        for row in 1..=across {
            for column in 0..inner_columns {
                let share = coverage[(row - 1) * inner_columns + column];
                if share <= 0.0 {
                    continue;
                }
                let column = column + before;
                let node = row * columns + column;
                let through = share * beam.power(place(column, row));
                power += copies * area * through;
                let jacobian = nodes.jacobian(column, row, cell);
                let sample = Sample {
                    direction: [nodes.l[node], nodes.m[node]],
                    landing: [nodes.x[node], nodes.y[node]],
                    phase: nodes.phase[node],
                    opd: nodes.opd[node],
                    power: area * through,
                    amplitude: area * share * (jacobian.abs() * through / share).sqrt(),
                };
                // A cell on the rim whose own ray is lost is left out.
                if sample.phase.is_finite() && sample.amplitude.is_finite() {
                    rays.push(sample);
                }
            }
        }
        Self { extent: outline.extent, rays, power, cell_mm2: area }
    }

    /// Root mean square and peak-to-valley of the optical path difference, waves, after the mean
    /// over the pupil, weighted by power, is subtracted.
    #[must_use]
    pub fn opd_rms_pv(&self) -> (f64, f64) {
        let total: f64 = self.rays.iter().map(|r| r.power).sum();
        let mean = self.rays.iter().map(|r| r.power * r.opd).sum::<f64>() / total;
        let square: f64 = self.rays.iter().map(|r| r.power * (r.opd - mean).powi(2)).sum();
        let (low, high) = self
            .rays
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), r| (a.min(r.opd), b.max(r.opd)));
        ((square / total).sqrt(), high - low)
    }

    /// Root-mean-square distance of the landing places from their centroid, mm.
    #[must_use]
    pub fn spot_rms_mm(&self) -> f64 {
        let total: f64 = self.rays.iter().map(|r| r.power).sum();
        let mean =
            |k: usize| self.rays.iter().map(|r| r.power * r.landing[k]).sum::<f64>() / total;
        let centre = match self.extent {
            Extent::MirrorHalf => [0.0, mean(1)],
            Extent::Whole => [mean(0), mean(1)],
        };
        let square =
            |r: &Sample| (r.landing[0] - centre[0]).powi(2) + (r.landing[1] - centre[1]).powi(2);
        (self.rays.iter().map(|r| r.power * square(r)).sum::<f64>() / total).sqrt()
    }
}

impl Nodes {
    /// |∂(L, M)/∂(px, py)| at a node by central differences, one-sided next to lost rays.
    fn jacobian(&self, column: usize, row: usize, cell: f64) -> f64 {
        let at = |values: &[f64], column: usize, row: usize| values[row * self.columns + column];
        let slope = |before: f64, here: f64, after: f64| match (before.is_nan(), after.is_nan()) {
            (false, false) => (after - before) / (2.0 * cell),
            (true, false) => (after - here) / cell,
            (false, true) => (here - before) / cell,
            (true, true) => f64::NAN,
        };
        // In a half, mirror image at x < 0: L changes its sign, M does not.
        let across = |values: &[f64], sign: f64| {
            let here = at(values, column, row);
            let before = match column {
                0 => sign * here,
                _ => at(values, column - 1, row),
            };
            let after =
                if column + 1 < self.columns { at(values, column + 1, row) } else { f64::NAN };
            slope(before, here, after)
        };
        let along = |values: &[f64]| {
            debug_assert!(row > 0 && row + 1 < self.rows);
            slope(
                at(values, column, row - 1),
                at(values, column, row),
                at(values, column, row + 1),
            )
        };
        across(&self.l, -1.0) * along(&self.m) - along(&self.l) * across(&self.m, 1.0)
    }
}

/// The share of every cell inside the outline: exact areas of the polygon through its points.
fn coverage(
    outline: &Outline,
    [columns, rows]: [usize; 2],
    [left, low]: [f64; 2],
    cell: f64,
) -> Vec<f64> {
    // Signed-area accumulation: every edge adds what lies to its right, a running sum along the
    // row gives the area (Levien's font rasteriser). One column more takes what passes the right
    // end.
    let mut sums = vec![0.0; (columns + 1) * rows];
    let mut edge = |a: [f64; 2], b: [f64; 2]| {
        let scaled = |p: [f64; 2]| [((p[0] - left) / cell).max(0.0), (p[1] - low) / cell];
        accumulate(&mut sums, columns, rows, scaled(a), scaled(b));
    };
    let strips = &outline.edges;
    for i in 0..strips.len() {
        let Some([inner, outer]) = strips[i] else { continue };
        let next = strips.get(i + 1).copied().flatten();
        let before = i.checked_sub(1).and_then(|j| strips[j]);
        if let Some([next_inner, next_outer]) = next {
            edge(outer.launch, next_outer.launch);
            edge(next_inner.launch, inner.launch);
        }
        // Radial sides cancel between neighbours; they count where the outline ends.
        match (before, next) {
            (None, Some(_)) => edge(inner.launch, outer.launch),
            (Some(_), None) => edge(outer.launch, inner.launch),
            _ => {}
        }
    }
    let mut shares = Vec::with_capacity(columns * rows);
    for row in sums.chunks_exact(columns + 1) {
        let mut sum = 0.0;
        for v in &row[..columns] {
            sum += v;
            // Orientation of the outline makes the sum negative or positive; shares are neither.
            shares.push(f64::abs(sum).min(1.0));
        }
    }
    // Rounding in the running sum leaves a little in empty cells. A share below this limit carries
    // no light that a PSF in f32 shows.
    const MIN_SHARE: f64 = 1e-9;
    shares.iter_mut().filter(|v| **v < MIN_SHARE).for_each(|v| *v = 0.0);
    shares
}

/// Adds one polygon edge to the accumulation buffer.
fn accumulate(sums: &mut [f64], columns: usize, rows: usize, a: [f64; 2], b: [f64; 2]) {
    if a[1] == b[1] {
        return;
    }
    let (sign, [x0, y0], [x1, y1]) = if a[1] < b[1] { (1.0, a, b) } else { (-1.0, b, a) };
    let slope = (x1 - x0) / (y1 - y0);
    let first = y0.max(0.0) as usize;
    let last = (y1.ceil().max(0.0) as usize).min(rows);
    for row in first..last {
        let top = y0.max(row as f64);
        let bottom = y1.min(row as f64 + 1.0);
        if bottom <= top {
            continue;
        }
        let height = sign * (bottom - top);
        let (p, q) = (x0 + (top - y0) * slope, x0 + (bottom - y0) * slope);
        let (left, right) = (p.min(q), p.max(q));
        let mut done = 0.0;
        let line = &mut sums[row * (columns + 1)..(row + 1) * (columns + 1)];
        let (from, to) = ((left as usize).min(columns), (right as usize).min(columns));
        for (column, sum) in line.iter_mut().enumerate().take(to + 1).skip(from) {
            // Mean over the edge's height of the part of this cell to the right of it.
            let reach = right_of(column as f64, left, right);
            *sum += height * (reach - done);
            done = reach;
        }
        if to < columns {
            line[to + 1] += height * (1.0 - done);
        }
    }
}

/// The mean, over an edge whose x runs evenly from `left` to `right`, of the part of the cell
/// [column, column + 1] that lies to the right of the edge.
fn right_of(column: f64, left: f64, right: f64) -> f64 {
    // ∫ of the clamped part: antiderivative of clamp(column + 1 − x, 0, 1).
    let upto = |x: f64| {
        let u = (column + 1.0 - x).clamp(0.0, 1.0);
        let beyond = (column - x).max(0.0);
        -(0.5 * u * u + beyond)
    };
    if right - left < 1e-12 {
        return (column + 1.0 - left).clamp(0.0, 1.0);
    }
    (upto(right) - upto(left)) / (right - left)
}

#[cfg(test)]
mod tests {
    use super::super::pupil::EdgePoint;
    use super::*;

    /// Areas of a half disc and of a half ring on a grid add up to those of the polygons.
    #[test]
    fn coverage_adds_up_to_the_area() {
        let n = 400;
        let ring = |inner: f64, outer: f64| {
            let edges = (0..=n).map(|i| {
                let (s, c) = ((i as f64 / n as f64 - 0.5) * std::f64::consts::PI).sin_cos();
                let at = |r: f64| EdgePoint {
                    launch: [r * c.max(0.0), r * s],
                    direction: [0.0; 2],
                    landing: [0.0; 2],
                };
                Some([at(inner), at(outer)])
            });
            Outline { extent: Extent::MirrorHalf, edges: edges.collect() }
        };
        for (inner, outer) in [(0.0, 1.0), (0.4, 1.0)] {
            let cell = 2.0 / 31.0;
            let shares = coverage(&ring(inner, outer), [16, 31], [0.0, -1.0], cell);
            let area: f64 = shares.iter().sum::<f64>() * cell * cell;
            let chord = (std::f64::consts::PI / n as f64).sin() * n as f64 / 2.0;
            let exact = chord * (outer * outer - inner * inner);
            assert!((area - exact).abs() < 1e-9, "{area} instead of {exact}");
            assert!(shares.iter().all(|v| (0.0..=1.0).contains(v)));
        }
    }
}
