//! Factors that depend only on the place of a pixel in the field: eq. 7, relative illumination,
//! veiling glare.

use super::{Lens, OverField, SensorGrid};
use crate::bicubic::BicubicTable;
use camrig_base::Plane;
use rayon::prelude::*;

/// A curve over image height, sampled so finely that linear interpolation in r² errs by at most
/// 1e-7 for curves smooth in r².
pub struct RadialTable {
    per_square_mm: f64,
    values: Vec<f64>,
}

impl RadialTable {
    const STEPS: usize = 4096;

    /// Samples `curve` from height 0 to `largest_mm`.
    pub fn new(curve: impl Fn(f64) -> f64, largest_mm: f64) -> Self {
        let per_square_mm = Self::STEPS as f64 / (largest_mm * largest_mm);
        let values =
            (0..Self::STEPS + 2).map(|i| curve((i as f64 / per_square_mm).sqrt())).collect();
        Self { per_square_mm, values }
    }

    /// The value where the squared height is `square_mm`.
    pub fn at(&self, square_mm: f64) -> f64 {
        let t = (square_mm * self.per_square_mm).min(Self::STEPS as f64);
        let i = t as usize;
        self.values[i] + (t - i as f64) * (self.values[i + 1] - self.values[i])
    }
}

/// Greatest distance of a point of the frame, widened by `margin_mm`, from the optical axis, mm.
pub fn largest_height_mm(grid: &SensorGrid, axis_mm: (f64, f64), margin_mm: f64) -> f64 {
    let half = |n: usize, axis: f64| n as f64 * grid.pitch_um * 0.5e-3 + axis.abs() + margin_mm;
    half(grid.width, axis_mm.0).hypot(half(grid.height, axis_mm.1))
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
    /// frequency can leave values just below 0 beside bright points; irradiance is not negative,
    /// so they become 0.
    pub fn apply(&self, plane: &mut Plane<f32>) {
        let Self { grid, axis_mm: axis, steradians: factor, ratio, glare } = self;
        let (pitch_mm, width) = (grid.pitch_um * 1e-3, grid.width);
        let centred = |i: usize, n: usize| (i as f64 + 0.5 - n as f64 / 2.0) * pitch_mm;
        plane.data.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let dy = centred(y, grid.height) - axis.1;
            for (x, e) in row.iter_mut().enumerate() {
                let dx = centred(x, width) - axis.0;
                let factor = match ratio {
                    None => *factor,
                    Some(Ratio::Radial(table)) => factor * table.at(dx * dx + dy * dy),
                    Some(Ratio::Plane(table)) => factor * table.at(dx, dy).max(0.0),
                };
                *e = e.max(0.0) * factor as f32;
            }
        });
        if *glare > 0.0 {
            let sum: f64 = plane.data.iter().map(|&e| f64::from(e)).sum();
            let veil = (glare * sum / plane.data.len() as f64) as f32;
            let kept = (1.0 - glare) as f32;
            plane.data.iter_mut().for_each(|e| *e = kept * *e + veil);
        }
    }
}
