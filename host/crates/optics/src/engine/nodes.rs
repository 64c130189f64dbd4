//! Nodes, the places where kernels are computed, and the error of interpolation between them.
//!
//! There are two interpolations. The engine blends the kernels of four nodes of a grid over the
//! frame; how far the blend is from the kernel of a place is measured. The lens data hold PSFs at
//! some heights, between which they are blended linearly; what lies between is not in the data, so
//! that error is estimated from them: leave one height out, and interpolate over it.

use super::psf::{KernelGrid, PsfField, UPRIGHT};
use super::sampling::Layout;
use super::stations::{Lattice, Stations};
use super::varying::{Kernels, Tiling};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How PSFs are interpolated over the field, and with what error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeReport {
    /// Nodes across and down.
    pub grid: (usize, usize),
    /// Cells between nodes.
    pub tile: usize,
    /// Side of the kernels, in cells.
    pub kernel: usize,
    /// Largest mean error that was allowed.
    pub tolerance: f64,
    /// Interpolation between nodes, at the centres of tiles, where it is worst.
    pub nodes: Misplaced,
    /// Interpolation between the heights (or places) of the lens data, halfway between them,
    /// estimated from the data; `None` where they are fewer than five each way.
    pub heights: Option<Misplaced>,
}

/// Light that interpolation misplaces compared with the PSF itself, as a fraction of all the
/// light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Misplaced {
    /// Mean over the field.
    pub mean: f64,
    /// Largest in the field.
    pub largest: f64,
}

impl Misplaced {
    /// The larger of each.
    fn or_worse(self, other: Self) -> Self {
        Self { mean: self.mean.max(other.mean), largest: self.largest.max(other.largest) }
    }

    /// The weighted mean and the maximum of (value, weight) pairs.
    #[must_use]
    pub fn of(values: &[(f64, f64)]) -> Self {
        let (sum, weight) = values.iter().fold((0.0, 0.0), |(s, w), v| (s + v.0 * v.1, w + v.1));
        Self { mean: sum / weight, largest: values.iter().fold(0.0, |m, v| v.0.max(m)) }
    }
}

impl NodeReport {
    /// Joins the report of another band: errors become the larger of the two.
    pub fn join(&mut self, other: Self) {
        self.nodes = self.nodes.or_worse(other.nodes);
        self.heights = match (self.heights, other.heights) {
            (Some(a), Some(b)) => Some(a.or_worse(b)),
            (a, b) => a.or(b),
        };
        self.kernel = self.kernel.max(other.kernel);
    }

    /// A warning for the user where a tolerance is not kept or cannot be checked.
    #[must_use]
    pub fn warning(&self) -> Option<String> {
        let percent = |v: f64| match v < 1e-4 {
            true => format!("{:.1e} %", 100.0 * v),
            false => format!("{:.2} %", 100.0 * v),
        };
        let limit = percent(self.tolerance);
        if self.nodes.mean > self.tolerance {
            return Some(format!(
                "PSFs change so fast over the field that nodes every {} cells misplace {} of the \
                 light in the mean, more than the {limit} asked for",
                self.tile,
                percent(self.nodes.mean)
            ));
        }
        match self.heights {
            Some(heights) if heights.mean > self.tolerance => Some(format!(
                "field points of the lens data are so far apart that PSFs between them misplace \
                 about {} of the light in the mean, more than the {limit} asked for; give PSFs \
                 at more of them",
                percent(heights.mean)
            )),
            Some(_) => None,
            None => Some(
                "the lens data hold PSFs at fewer than five field points: how wrong they are \
                 between is not known"
                    .into(),
            ),
        }
    }
}

/// Half the sum of absolute differences: the fraction of the light that one kernel puts elsewhere
/// than the other.
#[must_use]
pub fn misplaced(a: &[f32], b: &[f32]) -> f64 {
    0.5 * a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>()
}

impl PsfField {
    /// Error of PSFs halfway between the heights of the data as far as `reach_mm`, or in the middle
    /// of the cells of their grid, after integration over pixels.
    ///
    /// Interpolating over one left-out height spans twice the distance, over three four times. The
    /// ratio of the two errors is what halving the distance gains once more: 4 where the data are
    /// smooth between heights, 2 where PSFs move by more than their detail, 1 where they have
    /// nothing in common.
    #[must_use]
    pub fn height_error(&self, grid: &KernelGrid, reach_mm: f64) -> Option<Misplaced> {
        let heights_mm = match &self.stations {
            Stations::Heights(heights_mm) => heights_mm,
            Stations::Lattice(lattice) => return self.lattice_error(lattice, grid),
        };
        let used = heights_mm.partition_point(|&h| h < reach_mm) + 1;
        let last = used.min(heights_mm.len()) - 1;
        if last == 0 {
            // One PSF serves the whole frame.
            return Some(Misplaced::default());
        }
        if heights_mm.len() < MIN_HEIGHTS {
            return None;
        }
        let last = last.max(MIN_HEIGHTS - 1);
        let left_out = |span: usize| -> Vec<(f64, f64)> {
            (span..=last - span)
                .into_par_iter()
                .map(|k| {
                    let [h0, h, h1] = [k - span, k, k + span].map(|i| heights_mm[i]);
                    let t = ((h - h0) / (h1 - h0)) as f32;
                    let pair = self.psfs[k - span].iter().zip(&self.psfs[k + span]);
                    let blend: Vec<f32> = pair.map(|(a, b)| a + t * (b - a)).collect();
                    let kernel = |psf: &[f32]| self.projected(psf, UPRIGHT, grid);
                    // A ring of the field counts by its area.
                    (misplaced(&kernel(&blend), &kernel(&self.psfs[k])), h1 * h1 - h0 * h0)
                })
                .collect()
        };
        Some(halved(&left_out))
    }

    /// The same over a grid of places: a node is left out and blended from the four that are
    /// diagonally next to it, as the middle of a cell is from its corners.
    fn lattice_error(&self, lattice: &Lattice, grid: &KernelGrid) -> Option<Misplaced> {
        let (across, down) = (lattice.x_mm.len(), lattice.y_mm.len());
        if across * down == 1 {
            return Some(Misplaced::default());
        }
        if across.min(down) < MIN_HEIGHTS {
            return None;
        }
        let kernel = |psf: &[f32]| self.projected(psf, UPRIGHT, grid);
        let left_out = |span: usize| -> Vec<(f64, f64)> {
            let inside = |k: &usize| {
                let (i, j) = (k % across, k / across);
                (span..across - span).contains(&i) && (span..down - span).contains(&j)
            };
            (0..across * down)
                .into_par_iter()
                .filter(inside)
                .map(|k| {
                    let part = |axis: &[f64], i: usize| {
                        let [a, here, b] = [i - span, i, i + span].map(|i| axis[i]);
                        (((here - a) / (b - a)) as f32, b - a)
                    };
                    let (i, j) = (k % across, k / across);
                    let ((t, wide), (v, high)) = (part(&lattice.x_mm, i), part(&lattice.y_mm, j));
                    let corners = [[i - span, i + span], [j - span, j + span]];
                    let blend = lattice.between(&self.psfs, corners, [t, v]);
                    (misplaced(&kernel(&blend), &kernel(&self.psfs[k])), wide * high)
                })
                .collect()
        };
        Some(halved(&left_out))
    }
}

/// The error between stations from those over one and over three left-out ones.
fn halved(left_out: &dyn Fn(usize) -> Vec<(f64, f64)>) -> Misplaced {
    let (near, far) = (Misplaced::of(&left_out(1)), Misplaced::of(&left_out(2)));
    if near.mean == 0.0 {
        return near;
    }
    let gain = (far.mean / near.mean).clamp(1.0, 4.0);
    Misplaced { mean: near.mean / gain, largest: near.largest / gain }
}

/// Heights of the data from which the error between them can be estimated: two left-out spans need
/// five.
const MIN_HEIGHTS: usize = 5;
/// Distances of nodes that are tried, pixels: steps of √2, so that each halves the number of
/// nodes.
const NODE_DISTANCES: [usize; 14] = [512, 362, 256, 181, 128, 90, 64, 45, 32, 23, 16, 11, 8, 6];
/// Distance of nodes where none of those keeps the tolerance, pixels. Closer nodes would cost a
/// transform of a kernel for a handful of pixels; the error that is left is reported.
const MIN_NODE_DISTANCE: usize = 4;

/// The kernel for light that lands at (x, y) mm from the optical axis.
pub type KernelAt<'k> = dyn Fn(f64, f64) -> Vec<f32> + Sync + 'k;

/// Where cells of the padded grid lie from the optical axis.
pub struct Place<'a> {
    /// Padded grids.
    pub layout: &'a Layout,
    /// Pixel pitch, mm.
    pub pitch_mm: f64,
    /// The optical axis from the sensor's centre, mm.
    pub axis_mm: (f64, f64),
}

impl Place<'_> {
    /// (x, y) mm from the optical axis of a point in cells from the padded grid's corner.
    #[must_use]
    pub fn from_axis(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let cell = self.pitch_mm / self.layout.oversample as f64;
        let along = |cells: f64, edge: usize, pixels: usize, axis: f64| {
            cells * cell - (edge as f64 + pixels as f64 / 2.0) * self.pitch_mm - axis
        };
        (
            along(x, self.layout.left(), self.layout.width, self.axis_mm.0),
            along(y, self.layout.top(), self.layout.height, self.axis_mm.1),
        )
    }

    /// [`misplaced`] light at the centres of tiles of `tile` cells, where blending the corners'
    /// kernels is worst, over a sample of the field; `field` has the PSFs that kernels are made of.
    #[must_use]
    pub fn grid_error(
        &self,
        kernel_at: &KernelAt<'_>,
        field: &PsfField,
        tile: usize,
    ) -> Misplaced {
        // Places each way: the error changes slowly over the field, and each costs five
        // kernels.
        const SAMPLES: usize = 6;
        let t = tile as f64;
        let spread = |i: usize, cells: usize| {
            let tiles = (cells as f64 / t).ceil().max(1.0);
            let tile = match &field.stations {
                // Half of the frame: such lenses are symmetric, sensors centred or nearly.
                Stations::Heights(_) => tiles * i as f64 / (2 * SAMPLES) as f64,
                Stations::Lattice(_) => tiles * (i as f64 + 0.5) / SAMPLES as f64,
            };
            (tile.floor() + 0.5) * t
        };
        let errors: Vec<(f64, f64)> = (0..SAMPLES * SAMPLES)
            .into_par_iter()
            .map(|k| {
                let x = spread(k % SAMPLES, self.layout.cells_across());
                let y = spread(k / SAMPLES, self.layout.cells_down());
                let kernel = |dx: f64, dy: f64| {
                    let (x, y) = self.from_axis((x + dx * t, y + dy * t));
                    kernel_at(x, y)
                };
                let corners =
                    [kernel(-0.5, -0.5), kernel(0.5, -0.5), kernel(-0.5, 0.5), kernel(0.5, 0.5)];
                let blend: Vec<f32> = (0..corners[0].len())
                    .map(|k| corners.iter().map(|c| c[k]).sum::<f32>() * 0.25)
                    .collect();
                (misplaced(&blend, &kernel(0.0, 0.0)), 1.0)
            })
            .collect();
        Misplaced::of(&errors)
    }

    /// The largest distance of nodes, in pixels, at which the mean [`Place::grid_error`] keeps
    /// `tolerance`; at least 4 pixels.
    #[must_use]
    pub fn node_distance(
        &self,
        kernel_at: &KernelAt<'_>,
        field: &PsfField,
        tolerance: f64,
    ) -> usize {
        let s = self.layout.oversample;
        NODE_DISTANCES
            .into_iter()
            .filter(|&pixels| pixels <= self.layout.padded_width.max(self.layout.padded_height))
            .find(|&pixels| self.grid_error(kernel_at, field, pixels * s).mean <= tolerance)
            .unwrap_or(MIN_NODE_DISTANCE)
    }

    /// The report on a tiling whose nodes have the kernels of `kernel_at`, made of `field`.
    pub fn report(
        &self,
        kernel_at: &KernelAt<'_>,
        field: &PsfField,
        grid: &KernelGrid,
        tiling: &Tiling,
        tolerance: f64,
    ) -> NodeReport {
        let reach = |edge: (f64, f64)| {
            let (x, y) = self.from_axis(edge);
            libm::hypot(x, y)
        };
        let (wide, high) = (self.layout.cells_across() as f64, self.layout.cells_down() as f64);
        let corners = [(0.0, 0.0), (wide, 0.0), (0.0, high), (wide, high)];
        NodeReport {
            grid: (tiling.across() + 1, tiling.down() + 1),
            tile: tiling.tile,
            kernel: grid.size,
            tolerance,
            nodes: self.grid_error(kernel_at, field, tiling.tile),
            heights: field.height_error(grid, corners.map(reach).into_iter().fold(0.0, f64::max)),
        }
    }

    /// Kernels at every node of a tiling.
    #[must_use]
    pub fn kernels(&self, field: &PsfField, grid: &KernelGrid, tiling: &Tiling) -> Kernels {
        let across = tiling.across() + 1;
        let nodes = across * (tiling.down() + 1);
        let data: Vec<Vec<f32>> = (0..nodes)
            .into_par_iter()
            .map(|k| {
                let (x, y) = self.from_axis(tiling.node(k % across, k / across));
                field.kernel(x, y, grid)
            })
            .collect();
        Kernels { size: grid.size, data: data.concat() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaussian spots that grow with height, sampled every µm.
    fn spot(height_mm: f64) -> Vec<f32> {
        let (radial, across) = (3.0 + 4.0 * height_mm * height_mm, 3.0 + height_mm);
        let value = |k: usize| {
            let (y, x) = ((k / 64) as f64 - 32.0, (k % 64) as f64 - 32.0);
            (-0.5 * ((y / radial).powi(2) + (x / across).powi(2))).exp()
        };
        let sum: f64 = (0..64 * 64).map(value).sum();
        (0..64 * 64).map(|k| (value(k) / sum) as f32).collect()
    }

    fn field(heights: usize) -> PsfField {
        let step = 1.0 / (heights - 1) as f64;
        let heights_mm: Vec<f64> = (0..heights).map(|i| i as f64 * step).collect();
        let psfs = heights_mm.iter().map(|&h| spot(h)).collect();
        PsfField { stations: Stations::Heights(heights_mm), size: 64, spacing_um: 1.0, psfs }
    }

    #[test]
    fn the_estimate_between_heights_is_the_error_there() {
        let grid = KernelGrid::new(1, 2.0, 2.0, 40.0);
        for heights in [6, 9, 17] {
            let field = field(heights);
            let Stations::Heights(heights_mm) = &field.stations else { panic!() };
            let between: Vec<(f64, f64)> = heights_mm
                .windows(2)
                .map(|w| {
                    let middle = 0.5 * (w[0] + w[1]);
                    let exact = field.projected(&spot(middle), (0.0, 1.0), &grid);
                    let blend = field.kernel(0.0, middle, &grid);
                    (misplaced(&exact, &blend), w[1] * w[1] - w[0] * w[0])
                })
                .collect();
            let exact = Misplaced::of(&between);
            let found = field.height_error(&grid, 1.0).unwrap();
            println!("{heights} heights: {found:?}, in truth {exact:?}");
            // Extrapolated by the order seen, of a spot whose change is not the same everywhere.
            assert!((0.6..1.7).contains(&(found.mean / exact.mean)), "{found:?} {exact:?}");
            assert!((0.5..2.0).contains(&(found.largest / exact.largest)), "{found:?} {exact:?}");
        }
        assert_eq!(field(4).height_error(&grid, 1.0), None);
        let one = PsfField {
            stations: Stations::Heights(vec![0.0]),
            size: 64,
            spacing_um: 1.0,
            psfs: vec![spot(0.0)],
        };
        assert_eq!(one.height_error(&grid, 1.0), Some(Misplaced::default()));
    }

    #[test]
    fn a_tolerance_that_is_not_kept_is_told() {
        let kept = Misplaced { mean: 0.004, largest: 0.02 };
        let worse = Misplaced { mean: 0.03, largest: 0.2 };
        let report = |nodes, heights| NodeReport {
            grid: (3, 3),
            tile: 8,
            kernel: 9,
            tolerance: 0.01,
            nodes,
            heights,
        };
        assert_eq!(report(kept, Some(kept)).warning(), None);
        assert!(report(worse, Some(kept)).warning().unwrap().contains("nodes every 8 cells"));
        assert!(report(kept, Some(worse)).warning().unwrap().contains("more of them"));
        assert!(report(kept, None).warning().unwrap().contains("not known"));
        let mut joined = report(kept, Some(worse));
        joined.join(report(worse, None));
        assert_eq!((joined.nodes, joined.heights), (worse, Some(worse)));
    }
}
