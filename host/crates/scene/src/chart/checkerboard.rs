//! A checkerboard over the whole plane.

use super::{BANDS, Options};
use crate::components::{ALL_NM, Grey};
use crate::{Components, Grid, Quantity, Scene};
use camrig_base::{Bands, Plane, Result};
use camrig_light::colour::mixture::Mixer;

/// Squares alternating in both directions; a corner is at the frame's centre.
#[derive(Clone, Debug)]
pub struct Checkerboard {
    /// Edge of a square, sensor widths.
    pub square: f64,
    /// Reflectance of the dark squares.
    pub dark: f64,
    /// Reflectance of the bright squares.
    pub bright: f64,
}

/// `checkerboard[:square=0.1,dark=0.04,bright=0.8]`.
pub(super) fn from_options(options: &mut Options) -> Result<Checkerboard> {
    let square = options.number("square", 0.1, 1e-5..=10.0)?;
    let dark = options.number("dark", 0.04, 0.0..=1.0)?;
    let bright = options.number("bright", 0.8, 0.0..=1.0)?;
    Ok(Checkerboard { square, dark, bright })
}

impl Checkerboard {
    /// Means over `count` cells of the square wave that is +1 on 0..square and −1 on the next.
    fn wave(&self, start: f64, cell: f64, count: usize) -> Vec<f64> {
        // The wave's integral is a triangle of period 2 squares.
        let integral = |t: f64| {
            let phase = (t / self.square).rem_euclid(2.0);
            phase.min(2.0 - phase) * self.square
        };
        (0..count)
            .map(|i| {
                let t = start + i as f64 * cell;
                (integral(t + cell) - integral(t)) / cell
            })
            .collect()
    }
}

impl Scene for Checkerboard {
    fn bands(&self) -> Bands {
        BANDS
    }

    fn data_nm(&self) -> [f64; 2] {
        ALL_NM
    }

    fn in_bands(&self, bands: &Bands) -> Option<Box<dyn Scene>> {
        Some(Box::new(Grey::new(self.clone(), bands)))
    }

    fn quantity(&self) -> Quantity {
        Quantity::Reflectance
    }

    fn aspect(&self) -> Option<f64> {
        None
    }

    /// The board is a product of two square waves, and so are its cell means.
    fn components(&self, mixer: &Mixer) -> Result<Option<Components>> {
        Ok(Some(Components::of_grey(self.clone(), mixer)))
    }

    fn plane(&self, _band: usize, grid: &Grid) -> Result<Plane<f32>> {
        let across = self.wave(grid.left, grid.cell, grid.width);
        let down = self.wave(grid.top, grid.cell, grid.height);
        let (mean, swing) = ((self.bright + self.dark) / 2.0, (self.bright - self.dark) / 2.0);
        Ok(Plane::from_fn(grid.width, grid.height, |x, y| {
            (mean + swing * across[x] * down[y]).max(0.0) as f32
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_hold_the_mean_of_the_board() {
        let board = Checkerboard { square: 0.5, dark: 0.0, bright: 1.0 };
        let grid = Grid { width: 2, height: 2, left: -0.5, top: -0.5, cell: 0.5 };
        assert_eq!(board.plane(0, &grid).unwrap().data, [1.0, 0.0, 0.0, 1.0]);
        // A cell from (−0.25, 0) of half a square each side is grey; of three quarters is not.
        let grid = Grid { width: 1, height: 1, left: -0.25, top: 0.0, cell: 0.5 };
        assert_eq!(board.plane(0, &grid).unwrap().data, [0.5]);
        let grid = Grid { left: -0.125, ..grid };
        assert_eq!(board.plane(0, &grid).unwrap().data, [0.75]);
    }
}
