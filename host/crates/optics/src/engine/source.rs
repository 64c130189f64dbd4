//! The scene as it would land on the padded cell grid without blur: borders and distortion.

use super::field::{RadialTable, largest_height_mm, sampled};
use super::sampling::Cells;
use super::warp::{APRON, BLOCK, RIGHT, resample};
use super::{Lens, OverField, SensorGrid};
use crate::bicubic::BicubicTable;
use camrig_base::{Plane, Result};
use camrig_scene::{Grid, LitScene};
use rayon::prelude::*;
use std::sync::Arc;

/// Rows `first..first + count` of a cell grid.
pub type Rows<'a> = dyn Fn(usize, usize) -> Result<Plane<f32>> + Sync + 'a;

/// What lies beyond the frame, from where the blur brings light in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Border {
    /// The scene continues, as a real scene does.
    Scene,
    /// Black: light is lost over the frame's edges and none comes in.
    Black,
    /// The frame's outermost cells repeat.
    Edge,
    /// The frame is mirrored at its edges.
    Mirror,
}

/// One band of the scene on cells.
pub struct Source<'a> {
    scene: &'a LitScene<'a>,
    band: usize,
    cells: Cells,
    border: Border,
    warp: Option<Arc<Warp>>,
}

/// The geometric mapping of a lens in one band, for some cells.
pub struct Warp {
    mapping: Mapping,
    /// Sensor width, mm.
    width_mm: f64,
    /// Optical axis, sensor widths from the image centre.
    axis: (f64, f64),
}

/// Where the ideal place of a real one lies, both from the optical axis.
enum Mapping {
    /// Ideal over real height, by squared real height in mm².
    Ratio(RadialTable),
    /// Ideal places right and below, mm, over real ones.
    Places([BicubicTable; 2]),
}

impl Warp {
    /// The mapping at a wavelength; `None` of a lens that has none.
    pub fn new(lens: &dyn Lens, nm: f64, grid: &SensorGrid, cells: &Cells) -> Option<Arc<Self>> {
        let width_mm = grid.width_mm();
        let axis_mm = lens.axis_mm();
        let margin_mm = cells.margin_mm;
        let mapping = match lens.ideal_place(nm)? {
            OverField::Radial(ideal) => Mapping::Ratio(RadialTable::new(
                // At the axis the ratio is the curve's slope there.
                |h| if h > 0.0 { ideal(h) / h } else { ideal(1e-6) / 1e-6 },
                largest_height_mm(grid, axis_mm, margin_mm),
            )),
            OverField::Plane(ideal) => Mapping::Places(sampled(
                |x, y| {
                    let (x, y) = ideal(x, y);
                    [x, y]
                },
                grid,
                axis_mm,
                margin_mm,
            )),
        };
        let axis = (axis_mm.0 / width_mm, axis_mm.1 / width_mm);
        Some(Arc::new(Self { mapping, width_mm, axis }))
    }

    /// Frame coordinates of the ideal place of what lands at (u, v).
    fn ideal(&self, u: f64, v: f64) -> (f64, f64) {
        let (du, dv) = (u - self.axis.0, v - self.axis.1);
        let (du, dv) = match &self.mapping {
            Mapping::Ratio(ratio) => {
                let ratio = ratio.at((du * du + dv * dv) * self.width_mm * self.width_mm);
                (du * ratio, dv * ratio)
            }
            Mapping::Places(places) => {
                let [x, y] = [du, dv].map(|part| part * self.width_mm);
                (places[0].at(x, y) / self.width_mm, places[1].at(x, y) / self.width_mm)
            }
        };
        (self.axis.0 + du, self.axis.1 + dv)
    }
}

impl<'a> Source<'a> {
    /// The band of the scene on `cells`, by the mapping made for them.
    pub fn new(
        scene: &'a LitScene<'a>,
        band: usize,
        warp: Option<Arc<Warp>>,
        cells: &Cells,
        border: Border,
    ) -> Self {
        Self { scene, band, cells: *cells, border, warp }
    }

    /// All rows, radiance.
    pub fn plane(&self) -> Result<Plane<f32>> {
        // Rows requested from the scene at once.
        const STRIP: usize = 64;
        let Cells { across, down, .. } = self.cells;
        let mut plane = Plane::filled(across, down, 0.0);
        let strips = plane.data.par_chunks_mut(STRIP * across).enumerate();
        strips.try_for_each(|(i, strip)| {
            let rows = self.rows(i * STRIP, strip.len() / across)?;
            strip.copy_from_slice(&rows.data);
            Ok(())
        })?;
        Ok(plane)
    }

    /// Rows `first..first + count` of the cells, radiance.
    pub fn rows(&self, first: usize, count: usize) -> Result<Plane<f32>> {
        if self.border == Border::Scene {
            return self.region(0, first, self.cells.across, count);
        }
        let Cells { across, left, top, frame: (wide, high), .. } = self.cells;
        let rows: Vec<Option<usize>> =
            (first..first + count).map(|y| self.inside(y as isize - top as isize, high)).collect();
        let mut out = Plane::filled(across, count, 0.0);
        let Some(low) = rows.iter().flatten().min().copied() else { return Ok(out) };
        let high_row = rows.iter().flatten().max().map_or(low, |&y| y);
        let frame = self.region(left, top + low, wide, high_row - low + 1)?;
        for (y, row) in rows.iter().enumerate().filter_map(|(y, r)| r.map(|r| (y, r))) {
            let source = frame.row(row - low);
            for (x, value) in out.row_mut(y).iter_mut().enumerate() {
                if let Some(x) = self.inside(x as isize - left as isize, wide) {
                    *value = source[x];
                }
            }
        }
        Ok(out)
    }

    /// Where in 0..n the border rule finds the value of place i; `None` for black.
    fn inside(&self, i: isize, n: usize) -> Option<usize> {
        let last = n as isize - 1;
        match self.border {
            _ if (0..=last).contains(&i) => Some(i as usize),
            Border::Scene | Border::Black => None,
            Border::Edge => Some(i.clamp(0, last) as usize),
            Border::Mirror => {
                let i = i.rem_euclid(2 * n as isize);
                Some(i.min(2 * n as isize - 1 - i) as usize)
            }
        }
    }

    /// A rectangle of the cells, distorted by the lens.
    fn region(&self, x: usize, y: usize, width: usize, height: usize) -> Result<Plane<f32>> {
        let (cell, corner) = (self.cells.side, self.cells.corner);
        let left = corner.0 + x as f64 * cell;
        let top = corner.1 + y as f64 * cell;
        let Some(warp) = &self.warp else {
            let grid = Grid { width, height, left, top, cell };
            return self.scene.radiance(self.band, &grid);
        };
        let place = |i: usize, j: usize| {
            warp.ideal(left + (i as f64 + 0.5) * cell, top + (j as f64 + 0.5) * cell)
        };
        // The ideal region that the rectangle needs: mappings that have an inverse reach their
        // extremes on the rectangle's outline, which the cells below cover.
        let (mut low, mut high) = ((f64::MAX, f64::MAX), (f64::MIN, f64::MIN));
        let mut reach = |(u, v): (f64, f64)| {
            low = (low.0.min(u), low.1.min(v));
            high = (high.0.max(u), high.1.max(v));
        };
        // The last block's line ends beyond the rectangle.
        let right = width.next_multiple_of(BLOCK);
        for i in 0..=right {
            reach(place(i, 0));
            reach(place(i, height - 1));
        }
        for j in 0..height {
            reach(place(0, j));
            reach(place(right, j));
        }
        // One cell more for what the outline's sampling leaves out.
        let apron = (APRON + 1) as f64 * cell;
        let cells = |from: f64, to: f64| ((to - from) / cell).ceil() as usize + 2 * APRON + 4;
        // On one lattice of cells whatever the rectangle, so that neighbouring strips see one
        // scene.
        let lattice = |edge: f64| ((edge - apron) / cell).floor() * cell;
        let grid = Grid {
            width: cells(low.0, high.0) + RIGHT,
            height: cells(low.1, high.1),
            left: lattice(low.0),
            top: lattice(low.1),
            cell,
        };
        let ideal = self.scene.radiance(self.band, &grid)?;
        let sample = |i: usize, j: usize| {
            let (u, v) = place(i, j);
            ((u - grid.left) / cell - 0.5, (v - grid.top) / cell - 0.5)
        };
        let mut mesh = vec![(0.0, 0.0); width.div_ceil(BLOCK) + 1];
        let mut out = Plane::filled(width, height, 0.0);
        for j in 0..height {
            mesh.iter_mut().enumerate().for_each(|(i, place)| *place = sample(i * BLOCK, j));
            resample(&ideal, &mesh, out.row_mut(j));
        }
        Ok(out)
    }
}
