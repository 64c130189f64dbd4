//! Factors that depend only on the place of a pixel in the field: eq. 7, relative illumination,
//! veiling glare.

use super::{Lens, OverField, SensorGrid};
use crate::bicubic::BicubicTable;
use camrig_base::Plane;
use camrig_vector::vectorised;
use rayon::prelude::*;

/// A curve over image height, sampled so finely that linear interpolation in r² errs by at most
/// 1e-7 for curves smooth in r².
pub struct RadialTable {
    per_square_mm: f64,
    values: Box<[f64; Self::STEPS + 2]>,
}

impl RadialTable {
    const STEPS: usize = 4096;

    /// Samples `curve` from height 0 to `largest_mm`.
    pub fn new(curve: impl Fn(f64) -> f64, largest_mm: f64) -> Self {
        let per_square_mm = Self::STEPS as f64 / (largest_mm * largest_mm);
        let mut values = Box::new([0.0; Self::STEPS + 2]);
        for (i, value) in values.iter_mut().enumerate() {
            *value = curve((i as f64 / per_square_mm).sqrt());
        }
        Self { per_square_mm, values }
    }

    /// The value where the squared height is `square_mm`.
    #[inline(always)]
    pub fn at(&self, square_mm: f64) -> f64 {
        let t = (square_mm * self.per_square_mm).min(Self::STEPS as f64);
        let i = (t as u32 as usize).min(Self::STEPS);
        self.values[i] + (t - i as f64) * (self.values[i + 1] - self.values[i])
    }
}

/// Greatest distance of a point of the frame, widened by `margin_mm`, from the optical axis, mm.
pub fn largest_height_mm(grid: &SensorGrid, axis_mm: (f64, f64), margin_mm: f64) -> f64 {
    let half = |n: usize, axis: f64| n as f64 * grid.pitch_um * 0.5e-3 + axis.abs() + margin_mm;
    libm::hypot(half(grid.width, axis_mm.0), half(grid.height, axis_mm.1))
}

/// Functions of the place from the optical axis, sampled over the frame widened by `margin_mm`, for
/// fast interpolation: of the third order, over a hundredth of the frame.
pub fn sampled<const N: usize>(
    function: impl Fn(f64, f64) -> [f64; N] + Sync,
    grid: &SensorGrid,
    axis_mm: (f64, f64),
    margin_mm: f64,
) -> [BicubicTable; N] {
    const NODES: usize = 129;
    let places = |n: usize, axis: f64| -> Vec<f64> {
        let half = n as f64 * grid.pitch_um * 0.5e-3 + margin_mm;
        let part = |i: usize| 2.0 * i as f64 / (NODES - 1) as f64 - 1.0;
        (0..NODES).map(|i| half * part(i) - axis).collect()
    };
    let (x, y) = (places(grid.width, axis_mm.0), places(grid.height, axis_mm.1));
    let values: Vec<[f64; N]> =
        (0..NODES * NODES).into_par_iter().map(|k| function(x[k % NODES], y[k / NODES])).collect();
    std::array::from_fn(|n| {
        let values: Vec<f64> = values.iter().map(|v| v[n]).collect();
        BicubicTable::new(x.clone(), y.clone(), &values)
    })
}

/// Steradians, relative illumination and veiling glare of a lens in one band.
pub struct FallOff {
    grid: SensorGrid,
    axis_mm: (f64, f64),
    steradians: f64,
    ratio: Option<Ratio>,
    glare: f64,
}

/// Relative illumination: by squared height, or over the plane.
enum Ratio {
    Radial(RadialTable),
    Plane(BicubicTable),
}

impl FallOff {
    /// Of a wavelength.
    pub fn new(lens: &dyn Lens, nm: f64, grid: &SensorGrid) -> Self {
        let axis_mm = lens.axis_mm();
        let ratio = lens.illumination(nm).map(|ratios| match ratios {
            OverField::Radial(curve) => {
                Ratio::Radial(RadialTable::new(curve, largest_height_mm(grid, axis_mm, 0.0)))
            }
            OverField::Plane(function) => {
                let [table] = sampled(|x, y| [function(x, y)], grid, axis_mm, 0.0);
                Ratio::Plane(table)
            }
        });
        let (steradians, glare) = (lens.steradians(nm), lens.veiling_glare());
        Self { grid: *grid, axis_mm, steradians, ratio, glare }
    }

    /// Multiplies by steradians and relative illumination at the pixel centres, then spreads the
    /// veiling glare: E ← (1−g)·E + g·mean(E). Rounding and the cut at the cell grid's Nyquist
    /// frequency can leave values just below 0 next to bright points; irradiance is not negative,
    /// so they become 0.
    pub fn apply(&self, plane: &mut Plane<f32>) {
        let Self { grid, axis_mm, steradians, ratio, glare } = self;
        plane.data.par_chunks_mut(grid.width).enumerate().for_each(|(y, row)| {
            let dy = self.beyond_axis(y, grid.height, axis_mm.1);
            match ratio {
                None => row.iter_mut().for_each(|e| *e = e.max(0.0) * *steradians as f32),
                Some(Ratio::Radial(table)) => radial_row(self, table, dy, row),
                Some(Ratio::Plane(table)) => {
                    for (x, e) in row.iter_mut().enumerate() {
                        let dx = self.beyond_axis(x, grid.width, axis_mm.0);
                        *e = e.max(0.0) * (steradians * table.at(dx, dy).max(0.0)) as f32;
                    }
                }
            }
        });
        if *glare > 0.0 {
            let sum: f64 = plane.data.iter().map(|&e| f64::from(e)).sum();
            let veil = (glare * sum / plane.data.len() as f64) as f32;
            let kept = (1.0 - glare) as f32;
            plane.data.iter_mut().for_each(|e| *e = kept * *e + veil);
        }
    }

    /// Place of the centre of pixel `i` of `n` from the axis, mm.
    #[inline(always)]
    fn beyond_axis(&self, i: usize, n: usize, axis_mm: f64) -> f64 {
        (i as f64 + 0.5 - n as f64 / 2.0) * (self.grid.pitch_um * 1e-3) - axis_mm
    }
}

/// A row at the height `dy` from the axis, mm, times steradians and a table's relative
/// illumination; negative values become 0.
#[vectorised]
fn radial_row(of: &FallOff, table: &RadialTable, dy: f64, row: &mut [f32]) {
    for (x, e) in row.iter_mut().enumerate() {
        let dx = of.beyond_axis(x, of.grid.width, of.axis_mm.0);
        *e = e.max(0.0) * (of.steradians * table.at(dx * dx + dy * dy)) as f32;
    }
}
