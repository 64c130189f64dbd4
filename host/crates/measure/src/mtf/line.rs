//! Position of the edge: a polynomial through the centroids of the rows' derivatives, and from
//! there the least-squares fit of a blurred step to all samples at once.
//!
//! The fit is `v = a + b Φ(d/s)` with d the distance from the line across = Σ c_k t^k. Of a
//! symmetric blur it has the edge's position whatever the shape, with a variance of σ²/Σ lsf² in
//! each row; that of a centroid grows with the cube of the window.

use super::{Rows, Sample};
use crate::Value;
use crate::fit::Fit;
use camrig_base::{Error, Result};
use camrig_linear::{Matrix, Vector, solve_positive};
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Passes of centroids: one over whole rows, two in windows around the line found before. The
/// number is fixed so that equal data give equal bits; each pass centres the windows better.
const PASSES: usize = 3;
/// Steps of the fit of a blurred step, from a line that is a fraction of a pixel off: each doubles
/// the digits.
const STEPS: usize = 6;
/// χ² of two degrees of freedom that chance exceeds once in 1000 edges: bends with less are noise,
/// and the line is straight.
const BENT: f64 = 13.8;
/// Smallest blur of the fit, samples: a narrower one lies between samples.
const MIN_BLUR: f64 = 0.2;
/// Smallest half width of a window, and smallest distance of the edge from the region's border,
/// in samples: a derivative's centroid needs four on either side.
const MARGIN: f64 = 4.0;
/// Smallest step between the sides in standard deviations of their samples: less is noise.
const MIN_STEP: f64 = 3.0;

/// Position of the edge: `across = Σ c_k t^k` with t the distance along it from the middle row,
/// pixels.
pub struct EdgeLine {
    middle: f64,
    coefficients: Vec<f64>,
    /// Mean DN of the two sides, dark first.
    pub levels: [f64; 2],
    /// Whether the second side is the bright one.
    pub rises: bool,
    /// Standard deviation of the blur that fits best, pixels across the edge.
    pub blur: f64,
}

impl EdgeLine {
    /// Finds the edge; `step` is the distance between samples of a row, pixels.
    ///
    /// # Errors
    /// No edge or several, an edge that leaves the region or is parallel to the pixel grid.
    pub fn find(rows: &Rows, step: f64) -> Result<Self> {
        let (first, last) = (rows[0][0].along, rows[rows.len() - 1][0].along);
        let mut line = Self {
            middle: 0.5 * (first + last),
            coefficients: Vec::new(),
            levels: [0.0; 2],
            rises: true,
            blur: step,
        };
        for pass in 0..PASSES {
            let mut places = Vec::with_capacity(rows.len());
            for row in rows {
                let centre = (pass > 0).then(|| line.at(row[0].along));
                if let Some(place) = centroid(row, centre, step) {
                    places.push((row[0].along - line.middle, place));
                }
            }
            if places.len() < rows.len() / 2 {
                return Err(no_edge());
            }
            line.coefficients = polynomial(&places, 1)?;
        }
        line.check(rows, step)?;
        if let Some(straight) = line.fitted(rows, step, 1) {
            let bent = straight.line.fitted(rows, step, 3).filter(|bent| {
                let scatter = bent.squares / bent.freedom;
                straight.squares - bent.squares > BENT * scatter
            });
            line = bent.unwrap_or(straight).line;
            line.check(rows, step)?;
        }
        Ok(line)
    }

    /// The line of this order that a blurred step fits best from here; `None` where the fit leaves
    /// the edge.
    fn fitted(&self, rows: &Rows, step: f64, order: usize) -> Option<Fitted> {
        let reach =
            rows.iter().flatten().map(|s| (s.along - self.middle).abs()).fold(1.0, f64::max);
        let first = if self.rises { 0 } else { 1 };
        let (mut low, mut high) = (self.levels[first], self.levels[1 - first]);
        let mut line = Self { coefficients: self.coefficients.clone(), ..*self };
        line.coefficients.resize(order + 1, 0.0);
        line.blur = line.first_blur(rows, low, high).max(MIN_BLUR * step);
        let unknowns = order + 4;
        let mut out = None;
        for _ in 0..STEPS {
            let mut normal = Matrix::zeros(unknowns, unknowns);
            let mut target = Vector::zeros(unknowns);
            let (mut squares, mut samples) = (0.0, 0.0);
            let mut x = vec![0.0; unknowns];
            for row in rows {
                let t = (row[0].along - self.middle) / reach;
                let cos = 1.0 / libm::hypot(line.slope(row[0].along), 1.0);
                let place = line.at(row[0].along);
                for s in row {
                    let u = (s.across - place) * cos / line.blur;
                    let risen = 0.5 * libm::erfc(-u * FRAC_1_SQRT_2);
                    let density = libm::exp(-0.5 * u * u) / (2.0 * PI).sqrt() * (high - low);
                    (x[0], x[1], x[2]) = (1.0 - risen, risen, -density * u);
                    x[3] = -density * cos / line.blur;
                    for k in 4..unknowns {
                        x[k] = x[k - 1] * t;
                    }
                    let left = s.value - (low + (high - low) * risen);
                    (squares, samples) = (squares + left * left, samples + 1.0);
                    for i in 0..unknowns {
                        target[i] += x[i] * left;
                        for j in 0..=i {
                            normal[(i, j)] += x[i] * x[j];
                        }
                    }
                }
            }
            for i in 0..unknowns {
                for j in 0..i {
                    normal[(j, i)] = normal[(i, j)];
                }
            }
            let freedom = samples - unknowns as f64;
            let coefficients = line.coefficients.clone();
            out = Some(Fitted { line: Self { coefficients, ..line }, squares, freedom });
            let change = solve_positive(normal, &target)?;
            (low, high) = (low + change[0], high + change[1]);
            line.blur = (line.blur * libm::exp(change[2].clamp(-0.5, 0.5))).max(MIN_BLUR * step);
            for (k, c) in line.coefficients.iter_mut().enumerate() {
                *c += change[k + 3] / libm::pow(reach, k as f64);
            }
        }
        out.filter(|f| f.line.coefficients.iter().all(|c| c.is_finite()))
    }

    /// A first value of the blur, pixels: of a blurred step, samples differ from the sharp one by
    /// an area of √(2/π) s times its height.
    fn first_blur(&self, rows: &Rows, low: f64, high: f64) -> f64 {
        let mut area = 0.0;
        for row in rows {
            let place = self.at(row[0].along);
            let spacing = (row[row.len() - 1].across - row[0].across) / (row.len() - 1) as f64;
            let off = |s: &Sample| if s.across < place { s.value - low } else { high - s.value };
            area += spacing * row.iter().map(off).sum::<f64>() / (high - low);
        }
        area / rows.len() as f64 * (PI / 2.0).sqrt()
    }

    /// Position across in the row at `along`, pixels.
    pub fn at(&self, along: f64) -> f64 {
        let t = along - self.middle;
        self.coefficients.iter().rev().fold(0.0, |sum, c| sum * t + c)
    }

    /// Slope in the row at `along`, pixels across per pixel along.
    pub fn slope(&self, along: f64) -> f64 {
        let t = along - self.middle;
        let terms = self.coefficients.iter().enumerate().skip(1);
        terms.map(|(k, c)| k as f64 * c * libm::pow(t, k as f64 - 1.0)).sum()
    }

    /// The edge's position in the middle row: across and along, pixels.
    pub fn centre(&self) -> (f64, f64) {
        (self.at(self.middle), self.middle)
    }

    /// Slope in the middle row.
    pub fn slope_at_middle(&self) -> f64 {
        self.slope(self.middle)
    }

    fn check(&mut self, rows: &Rows, step: f64) -> Result<()> {
        let margin = MARGIN * step;
        let (mut dark, mut bright) = (Vec::new(), Vec::new());
        for row in rows {
            let place = self.at(row[0].along);
            let (first, last) = (row[0].across, row[row.len() - 1].across);
            if !(place > first + margin && place < last - margin) {
                return Err(Error::input("the edge leaves the region").help(
                    "keep the edge inside the region in every row, with room on both sides",
                ));
            }
            let (left, right): (Vec<&Sample>, Vec<&Sample>) =
                row.iter().partition(|s| s.across < place);
            let far = |s: &&&Sample| (s.across - place).abs() > 0.5 * margin;
            dark.extend(left.iter().filter(far).map(|s| s.value));
            bright.extend(right.iter().filter(far).map(|s| s.value));
        }
        let moments = |v: &[f64]| {
            let mean = v.iter().sum::<f64>() / v.len() as f64;
            let variance = v.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / v.len() as f64;
            (mean, variance)
        };
        let ((a, va), (b, vb)) = (moments(&dark), moments(&bright));
        (self.levels, self.rises) = ([a.min(b), a.max(b)], b > a);
        if (a - b).abs() < MIN_STEP * (va + vb).sqrt() {
            return Err(no_edge());
        }
        // The edge has to cross the samples at every phase: over the rows it must move by at least
        // one sample.
        let travel = (self.at(rows[rows.len() - 1][0].along) - self.at(rows[0][0].along)).abs();
        if travel < step {
            return Err(Error::input(format!(
                "the edge is parallel to the pixel grid ({:.2} degrees; it moves by {travel:.2} \
                 pixels over the region)",
                libm::atan(self.slope_at_middle()).to_degrees()
            ))
            .help("slant it by 2 to 10 degrees, or use a longer region"));
        }
        if self.slope_at_middle().abs() > 1.0 {
            return Err(no_edge());
        }
        Ok(())
    }
}

/// A line that was fitted, with the sum of squares that it leaves and its degrees of freedom.
struct Fitted {
    line: EdgeLine,
    squares: f64,
    freedom: f64,
}

/// The error for a region without an edge.
pub fn no_edge() -> Error {
    Error::input("no single straight edge found in the region")
        .help("choose a region with one edge between two even areas, slanted by 2 to 10 degrees")
}

/// Centroid of the derivative along a row, under a Hamming window around `centre` (the row's
/// middle without one), as in the standard.
fn centroid(row: &[Sample], centre: Option<f64>, step: f64) -> Option<f64> {
    let (first, last) = (row[0].across, row[row.len() - 1].across);
    let middle = centre.unwrap_or(0.5 * (first + last));
    let half = (middle - first).min(last - middle).max(MARGIN * step);
    let (mut sum, mut moment) = (0.0, 0.0);
    for pair in row.windows(2) {
        let at = 0.5 * (pair[0].across + pair[1].across);
        let u = (at - middle) / half;
        if centre.is_some() && u.abs() > 1.0 {
            continue;
        }
        let window = match centre {
            Some(_) => 0.54 + 0.46 * libm::cos(std::f64::consts::PI * u),
            None => 1.0,
        };
        let d = (pair[1].value - pair[0].value) * window;
        sum += d;
        moment += d * at;
    }
    let place = moment / sum;
    (place > first && place < last).then_some(place)
}

fn polynomial(points: &[(f64, f64)], order: usize) -> Result<Vec<f64>> {
    // Abscissas are scaled to 1 at most, so that powers stay comparable.
    let range = points.iter().map(|p| p.0.abs()).fold(1.0, f64::max);
    let datum = |&(x, y): &(f64, f64)| {
        ((0..=order).map(|k| libm::pow(x / range, k as f64)).collect(), Value::new(y, 1.0))
    };
    let fit = Fit::new(&points.iter().map(datum).collect::<Vec<_>>())?;
    Ok(fit.coefficients.iter().enumerate().map(|(k, c)| c / libm::pow(range, k as f64)).collect())
}
