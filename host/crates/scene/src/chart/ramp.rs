//! A grey ramp from left to right, continuous or in steps.

use super::{BANDS, Options};
use crate::components::{ALL_NM, Grey};
use crate::{Components, Grid, Quantity, Scene};
use camrig_base::{Bands, Error, Plane, Result};
use camrig_light::colour::mixture::Mixer;

/// Reflectance that depends on u alone and changes linearly over the frame's width.
#[derive(Clone, Debug)]
pub struct Ramp {
    /// Reflectance at the left edge of the frame and beyond.
    pub from: f64,
    /// Reflectance at the right edge of the frame and beyond.
    pub to: f64,
    /// Number of equal bars; 0 for a continuous ramp.
    pub steps: u32,
}

/// `ramp[:from=0,to=1,steps=0]`.
pub(super) fn from_options(options: &mut Options) -> Result<Ramp> {
    let from = options.number("from", 0.0, 0.0..=1.0)?;
    let to = options.number("to", 1.0, 0.0..=1.0)?;
    let steps = options.number("steps", 0.0, 0.0..=4096.0)?;
    if steps.fract() != 0.0 {
        return Err(Error::input(format!("steps={steps}")).help("steps is a whole number"));
    }
    let steps = steps as u32;
    Ok(Ramp { from, to, steps })
}

impl Ramp {
    /// The integral over t of the rise 0..=1, where t is u counted from the frame's left edge.
    fn integral(&self, t: f64) -> f64 {
        let inside = t.clamp(0.0, 1.0);
        let beyond = t - inside; // the rise is 0 before the ramp and 1 beyond it
        let rise = match self.steps {
            0 => inside * inside / 2.0,
            1 => 0.0,
            steps => {
                // Bar k of n has k / (n − 1).
                let n = f64::from(steps);
                let bar = (inside * n).floor().min(n - 1.0);
                let before = bar * (bar - 1.0) / 2.0 / n;
                (before + bar * (inside - bar / n)) / (n - 1.0)
            }
        };
        rise + if self.steps == 1 { 0.0 } else { beyond.max(0.0) }
    }
}

impl Scene for Ramp {
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
        let row: Vec<f32> = (0..grid.width)
            .map(|x| {
                let t = grid.left + 0.5 + x as f64 * grid.cell;
                let rise = (self.integral(t + grid.cell) - self.integral(t)) / grid.cell;
                (self.from + (self.to - self.from) * rise).max(0.0) as f32
            })
            .collect();
        Ok(Plane { width: grid.width, height: grid.height, data: row.repeat(grid.height) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(ramp: &Ramp, width: usize, left: f64, cell: f64) -> Vec<f32> {
        ramp.plane(0, &Grid { width, height: 1, left, top: 0.0, cell }).unwrap().data
    }

    #[test]
    fn a_fraction_of_steps_is_refused() {
        let said = |options: &str| match super::super::open(&format!("ramp:{options}")).unwrap() {
            Ok(_) => String::new(),
            Err(error) => error.to_string(),
        };
        assert!(said("steps=2.5").contains("steps=2.5"), "{}", said("steps=2.5"));
        assert_eq!(said("steps=2"), "");
    }

    #[test]
    fn cells_hold_the_mean_of_the_ramp() {
        let ramp = Ramp { from: 0.1, to: 0.9, steps: 0 };
        let got = row(&ramp, 6, -0.75, 0.25);
        for (got, expected) in got.iter().zip([0.1, 0.2, 0.4, 0.6, 0.8, 0.9]) {
            assert!((got - expected).abs() < 1e-6);
        }
        let bars = Ramp { from: 0.0, to: 1.0, steps: 3 };
        let got = row(&bars, 6, -0.5, 1.0 / 6.0);
        for (got, expected) in got.iter().zip([0.0, 0.0, 0.5, 0.5, 1.0, 1.0]) {
            assert!((got - expected).abs() < 1e-6);
        }
        // Half a bar each.
        assert!((row(&bars, 1, -0.5 + 1.0 / 6.0, 1.0 / 3.0)[0] - 0.25).abs() < 1e-6);
    }
}
