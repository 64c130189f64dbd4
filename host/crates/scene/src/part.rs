//! A part of a scene, for light that falls on nothing else.

use super::{Components, Grid, Quantity, Scene, White};
use camrig_base::{Bands, Plane, Result};
use camrig_light::colour::mixture::Mixer;
use camrig_light::lamp::Region;
use std::sync::Arc;

/// A scene within a rectangle; around it is darkness.
pub struct Part {
    /// The whole.
    pub scene: Arc<dyn Scene>,
    /// Where it is seen.
    pub region: Region,
    /// Height of the frame, sensor widths.
    pub height: f64,
}

/// Where a region ends. A scene goes on beyond the frame, from where a lens blurs and a distortion
/// draws light into it: so does a region that reaches the frame's edge.
fn ends(begin: f64, size: f64) -> [f64; 2] {
    let low = if begin <= 0.0 { f64::NEG_INFINITY } else { begin };
    let high = if begin + size >= 1.0 { f64::INFINITY } else { begin + size };
    [low, high]
}

/// How much of a cell from `begin` on lies between two edges, 0 to 1.
fn covered(begin: f64, cell: f64, [low, high]: [f64; 2]) -> f64 {
    ((begin + cell).min(high) - begin.max(low)).max(0.0) / cell
}

impl Scene for Part {
    fn bands(&self) -> Bands {
        self.scene.bands()
    }

    fn quantity(&self) -> Quantity {
        self.scene.quantity()
    }

    fn aspect(&self) -> Option<f64> {
        self.scene.aspect()
    }

    fn plane(&self, band: usize, grid: &Grid) -> Result<Plane<f32>> {
        let [x, y, width, height] = self.region;
        let across = ends(x, width).map(|x| x - 0.5);
        let down = ends(y, height).map(|y| (y - 0.5) * self.height);
        let mut plane = self.scene.plane(band, grid)?;
        for (row, cells) in plane.data.chunks_mut(grid.width).enumerate() {
            let of_row = covered(grid.top + row as f64 * grid.cell, grid.cell, down);
            for (column, cell) in cells.iter_mut().enumerate() {
                let of_column = covered(grid.left + column as f64 * grid.cell, grid.cell, across);
                *cell *= (of_row * of_column) as f32;
            }
        }
        Ok(plane)
    }

    fn components(&self, mixer: &Mixer) -> Result<Option<Components>> {
        let Self { region, height, .. } = *self;
        let part = |scene| Self { scene, region, height };
        Ok(self.scene.components(mixer)?.map(|components| components.seen(part)))
    }

    fn white(&self) -> Option<&White> {
        self.scene.white()
    }

    fn notes(&self) -> Vec<String> {
        self.scene.notes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A quarter of the frame, whose edges cut cells in half.
    #[test]
    fn only_the_rectangle_is_seen() {
        let scene: Arc<dyn Scene> = Arc::from(crate::chart::open("uniform:0.8").unwrap().unwrap());
        let region = [0.25, 0.125, 0.5, 0.5];
        let grid = Grid { width: 6, height: 4, left: -0.5, top: -0.25, cell: 1.0 / 6.0 };
        let height = 2.0 / 3.0;
        let grid = Grid { top: -0.5 * height, ..grid };
        let whole = scene.plane(3, &grid).unwrap();
        let part = Part { scene, region, height }.plane(3, &grid).unwrap();
        let columns = [0.0, 0.5, 1.0, 1.0, 0.5, 0.0];
        let rows = [0.5, 1.0, 0.5, 0.0];
        for (y, of_row) in rows.iter().enumerate() {
            for (x, of_column) in columns.iter().enumerate() {
                let expected = whole.at(x, y) * (of_column * of_row) as f32;
                assert!((part.at(x, y) - expected).abs() < 1e-6, "{x} {y}");
            }
        }
    }

    #[test]
    fn a_region_at_the_edge_goes_on_beyond_the_frame() {
        let scene: Arc<dyn Scene> = Arc::from(crate::chart::open("uniform:0.8").unwrap().unwrap());
        let beyond = Grid { width: 4, height: 2, left: -1.0, top: -0.5, cell: 0.5 };
        let whole = scene.plane(3, &beyond).unwrap();
        let region = [0.5, 0.0, 0.5, 1.0];
        let part = Part { scene, region, height: 0.5 }.plane(3, &beyond).unwrap();
        for y in 0..2 {
            assert_eq!([0, 1].map(|x| part.at(x, y)), [0.0; 2]);
            assert_eq!([2, 3].map(|x| part.at(x, y)), [2, 3].map(|x| whole.at(x, y)));
        }
    }
}
