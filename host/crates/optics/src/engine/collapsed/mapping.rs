//! A band beside the band by whose mapping the scene is distorted.

use crate::engine::field::largest_height_mm;
use crate::engine::{Lens, RadialCurve, SensorGrid};

/// Shifts below this are rounding of the lens's tables, mm.
const NO_SHIFT_MM: f64 = 1e-7;
/// Relative difference of illuminations that is rounding.
const ALIKE: f64 = 1e-9;
/// Heights at which mappings are compared.
const HEIGHTS: usize = 16;

/// Largest distance over the frame between where bands of these wavelengths land, mm; 0 where they
/// share one mapping.
pub fn lateral_mm(lens: &dyn Lens, grid: &SensorGrid, seen_nm: &[f64]) -> f64 {
    let most = largest_height_mm(grid, lens.axis_mm(), 0.0);
    let (mut low, mut high) = ([0.0f64; HEIGHTS], [0.0f64; HEIGHTS]);
    for &nm in seen_nm {
        let mapping = Mapping::new(lens, seen_nm[0], nm);
        for i in 0..HEIGHTS {
            let shift = mapping.shift_mm(most * (i + 1) as f64 / HEIGHTS as f64);
            (low[i], high[i]) = (low[i].min(shift), high[i].max(shift));
        }
    }
    low.iter().zip(high).fold(0.0, |m, (low, high)| m.max(high - low))
}

/// Where, and with how much light, a band lands in comparison with the band of the mapping.
pub struct Mapping<'a> {
    reference: Option<RadialCurve<'a>>,
    band: Option<RadialCurve<'a>>,
    lit: [Option<RadialCurve<'a>>; 2],
    /// Ratio of eq. 7 on the axis.
    on_axis: f64,
}

impl<'a> Mapping<'a> {
    pub fn new(lens: &'a dyn Lens, reference_nm: f64, nm: f64) -> Self {
        Self {
            reference: lens.ideal_height(reference_nm),
            band: lens.ideal_height(nm),
            lit: [lens.illumination(nm), lens.illumination(reference_nm)],
            on_axis: lens.steradians(nm) / lens.steradians(reference_nm),
        }
    }

    /// How much further out than `height_mm` the band lands of what the mapping brings there, mm.
    pub fn shift_mm(&self, height_mm: f64) -> f64 {
        /// Step of the slope, mm.
        const STEP: f64 = 1e-4;
        const ROUNDS: usize = 4;
        let ideal = |curve: &Option<RadialCurve<'_>>, h: f64| curve.as_ref().map_or(h, |c| c(h));
        let goal = ideal(&self.reference, height_mm);
        let mut real = height_mm;
        for _ in 0..ROUNDS {
            let here = ideal(&self.band, real);
            let slope = (ideal(&self.band, real + STEP) - here) / STEP;
            if slope > 0.0 {
                real += (goal - here) / slope;
            }
        }
        let shift = real - height_mm;
        if shift.abs() < NO_SHIFT_MM { 0.0 } else { shift }
    }

    /// Light of the band over that of the mapping's band where `height_mm` lands: eq. 7 and
    /// relative illumination.
    pub fn gain(&self, height_mm: f64) -> f64 {
        let at = |curve: &Option<RadialCurve<'_>>| {
            curve.as_ref().map_or(1.0, |c| c(height_mm + self.shift_mm(height_mm)))
        };
        let [band, reference] = self.lit.each_ref().map(at);
        if reference > 0.0 { self.on_axis * band / reference } else { self.on_axis }
    }

    /// Whether relative illumination is that of the mapping's band.
    pub fn is_lit_alike(&self, height_mm: f64) -> bool {
        (self.gain(height_mm) - self.on_axis).abs() <= ALIKE * self.on_axis.abs()
    }
}
