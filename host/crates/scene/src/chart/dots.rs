//! A square grid of dots, for distortion and lateral colour.

use super::{BANDS, Options};
use crate::components::{ALL_NM, Grey};
use crate::shape::Shape;
use crate::{Components, Grid, Quantity, Scene};
use camrig_base::{Bands, Plane, Result};
use camrig_light::colour::mixture::Mixer;

/// Dots on a ground over the whole plane; one dot is centred in the frame.
#[derive(Clone, Debug)]
pub struct Dots {
    /// Distance between the dots' centres, sensor widths.
    pub pitch: f64,
    /// Diameter of a dot, sensor widths.
    pub diameter: f64,
    /// Reflectance of the dots.
    pub dot: f64,
    /// Reflectance of the ground.
    pub ground: f64,
}

/// `dots[:pitch=0.05,fill=0.5,dot=0.04,ground=0.8]`; `fill` is diameter over pitch.
pub(super) fn from_options(options: &mut Options) -> Result<Dots> {
    let pitch = options.number("pitch", 0.05, 1e-4..=1.0)?;
    let diameter = pitch * options.number("fill", 0.5, 0.01..=1.0)?;
    let dot = options.number("dot", 0.04, 0.0..=1.0)?;
    let ground = options.number("ground", 0.8, 0.0..=1.0)?;
    Ok(Dots { pitch, diameter, dot, ground })
}

impl Scene for Dots {
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

    fn components(&self, mixer: &Mixer) -> Result<Option<Components>> {
        Ok(Some(Components::of_grey(self.clone(), mixer)))
    }

    fn plane(&self, _band: usize, grid: &Grid) -> Result<Plane<f32>> {
        let mut plane = Plane::filled(grid.width, grid.height, self.ground as f32);
        let radius = self.diameter / 2.0;
        let indices = |start: f64, cells: usize| {
            let end = start + cells as f64 * grid.cell;
            ((start - radius) / self.pitch).ceil() as i64..=((end + radius) / self.pitch) as i64
        };
        for row in indices(grid.top, grid.height) {
            for column in indices(grid.left, grid.width) {
                let centre = [column as f64 * self.pitch, row as f64 * self.pitch];
                let change = (self.dot - self.ground) as f32;
                Shape::Disc { centre, radius }.paint(grid, change, &mut plane);
            }
        }
        plane.data.iter_mut().for_each(|v| *v = v.max(0.0));
        Ok(plane)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_is_that_of_one_period() {
        let dots = Dots { pitch: 0.1, diameter: 0.06, dot: 0.04, ground: 0.8 };
        // Ten periods, not aligned to the dots.
        let grid = Grid { width: 333, height: 333, left: -0.47, top: 0.013, cell: 1.0 / 333.0 };
        let plane = dots.plane(0, &grid).unwrap();
        let mean = plane.data.iter().map(|&v| f64::from(v)).sum::<f64>() / 333.0 / 333.0;
        let covered = std::f64::consts::PI * 0.03f64.powi(2) / 0.01;
        assert!((mean - (0.8 + (0.04 - 0.8) * covered)).abs() < 1e-6, "{mean}");
    }
}
