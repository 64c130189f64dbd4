//! A scene that moves as a whole while the sensor reads a frame.

use super::{Grid, Quantity, Scene, White};
use camrig_base::{Bands, Plane, Result};

/// A scene displaced by `velocity` times time; time is counted in frame periods.
///
/// A rolling shutter reads row v at time `start + rolling · (v/h + ½)`, with h the frame's height:
/// the scene is displaced row by row. Displacement is constant over a row of cells and over the
/// exposure: motion blur is not modelled. Content from beyond the scene's edge is what the scene
/// itself gives there.
pub struct Moving<'a> {
    /// The scene at time 0.
    pub scene: Box<dyn Scene + 'a>,
    /// To the right and down, sensor widths per frame period.
    pub velocity: [f64; 2],
    /// Time at which the first row is read, frame periods.
    pub start: f64,
    /// Part of the frame period in which the rows are read one after the other; 0 for a global
    /// shutter.
    pub rolling: f64,
    /// Height of the frame, sensor widths.
    pub height: f64,
}

impl Scene for Moving<'_> {
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
        let at = |time: f64, grid: Grid| Grid {
            left: grid.left - self.velocity[0] * time,
            top: grid.top - self.velocity[1] * time,
            ..grid
        };
        if self.rolling == 0.0 {
            return self.scene.plane(band, &at(self.start, *grid));
        }
        let mut plane = Plane { width: grid.width, height: 0, data: Vec::new() };
        for row in 0..grid.height {
            let top = grid.top + row as f64 * grid.cell;
            let middle = top + 0.5 * grid.cell;
            // Blur brings light from rows outside the frame into it: they move with the nearest
            // row inside.
            let read = (middle / self.height + 0.5).clamp(0.0, 1.0);
            let strip = Grid { height: 1, top, ..*grid };
            let strip = self.scene.plane(band, &at(self.start + self.rolling * read, strip))?;
            plane.data.extend(strip.data);
            plane.height += 1;
        }
        Ok(plane)
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
    use crate::open;

    const GRID: Grid = Grid { width: 64, height: 48, left: -0.5, top: -0.375, cell: 1.0 / 64.0 };

    fn moved(velocity: [f64; 2], start: f64, rolling: f64) -> Plane<f32> {
        let scene = open("checkerboard").unwrap();
        Moving { scene, velocity, start, rolling, height: 0.75 }.plane(10, &GRID).unwrap()
    }

    /// A displacement by whole cells is a shift of the plane.
    #[test]
    fn translation_shifts_by_what_it_says() {
        let still = moved([0.0; 2], 0.0, 0.0);
        let right = moved([2.0 / 64.0, 1.0 / 64.0], 2.0, 0.0);
        for y in 2..48 {
            for x in 4..64 {
                assert!((right.at(x, y) - still.at(x - 4, y - 2)).abs() < 1e-5, "{x} {y}");
            }
        }
    }

    /// Row y of a rolling shutter is what a global one sees at the time the row is read.
    #[test]
    fn rolling_rows_are_global_rows_of_their_time() {
        let rolling = moved([0.1, 0.0], 1.0, 0.8);
        for y in [0, 20, 47] {
            let time = 1.0 + 0.8 * (y as f64 + 0.5) / 48.0;
            let global = moved([0.1, 0.0], time, 0.0);
            for x in 0..64 {
                assert!((rolling.at(x, y) - global.at(x, y)).abs() < 1e-5, "{x} {y}");
            }
        }
    }
}
