//! A band relative to the band by whose mapping the scene is distorted.

use crate::engine::{Lens, OverField, SensorGrid};

/// Shifts below this are rounding of the lens's tables, mm.
const NO_SHIFT_MM: f64 = 1e-7;
/// Relative difference of illuminations that is rounding.
const ALIKE: f64 = 1e-9;
/// Places along each side of the frame at which mappings are compared.
const PLACES: usize = 17;

/// Places all over the frame, mm right of and below the optical axis.
pub fn places(grid: &SensorGrid, axis_mm: (f64, f64)) -> Vec<(f64, f64)> {
    let along = |pixels: usize, axis: f64| {
        let side = pixels as f64 * grid.pitch_um * 1e-3;
        (0..PLACES).map(move |i| side * (i as f64 / (PLACES - 1) as f64 - 0.5) - axis)
    };
    along(grid.height, axis_mm.1)
        .flat_map(|y| along(grid.width, axis_mm.0).map(move |x| (x, y)))
        .collect()
}

/// Largest distance over the frame between where bands of these wavelengths land, mm; 0 where they
/// share one mapping.
pub fn lateral_mm(lens: &dyn Lens, grid: &SensorGrid, seen_nm: &[f64]) -> f64 {
    let places = places(grid, lens.axis_mm());
    let shifts: Vec<Vec<(f64, f64)>> = seen_nm
        .iter()
        .map(|&nm| {
            let mapping = Mapping::new(lens, seen_nm[0], nm);
            places.iter().map(|&place| mapping.shift_mm(place)).collect()
        })
        .collect();
    let mut most = 0.0f64;
    for (i, a) in shifts.iter().enumerate() {
        for b in &shifts[..i] {
            let apart = a.iter().zip(b).map(|(a, b)| libm::hypot(a.0 - b.0, a.1 - b.1));
            most = apart.fold(most, f64::max);
        }
    }
    most
}

/// Where, and with how much light, a band lands in comparison with the band of the mapping.
pub struct Mapping<'a> {
    reference: Option<OverField<'a, (f64, f64)>>,
    band: Option<OverField<'a, (f64, f64)>>,
    lit: [Option<OverField<'a, f64>>; 2],
    /// Ratio of eq. 7 on the axis.
    on_axis: f64,
}

impl<'a> Mapping<'a> {
    pub fn new(lens: &'a dyn Lens, reference_nm: f64, nm: f64) -> Self {
        Self {
            reference: lens.ideal_place(reference_nm),
            band: lens.ideal_place(nm),
            lit: [lens.illumination(nm), lens.illumination(reference_nm)],
            on_axis: lens.steradians(nm) / lens.steradians(reference_nm),
        }
    }

    /// How far from a place the band lands of what the mapping brings there, mm right and down: by
    /// Newton's method, the place whose ideal place is the same.
    pub fn shift_mm(&self, (x, y): (f64, f64)) -> (f64, f64) {
        /// Step of the slopes, mm.
        const STEP: f64 = 1e-4;
        const ROUNDS: usize = 4;
        let ideal = |field: &Option<OverField<'_, (f64, f64)>>, x: f64, y: f64| {
            field.as_ref().map_or((x, y), |field| field.at(x, y))
        };
        let goal = ideal(&self.reference, x, y);
        let (mut dx, mut dy) = (0.0, 0.0);
        for _ in 0..ROUNDS {
            let here = ideal(&self.band, x + dx, y + dy);
            let right = ideal(&self.band, x + dx + STEP, y + dy);
            let below = ideal(&self.band, x + dx, y + dy + STEP);
            let (a, c) = ((right.0 - here.0) / STEP, (right.1 - here.1) / STEP);
            let (b, d) = ((below.0 - here.0) / STEP, (below.1 - here.1) / STEP);
            let (u, v) = (goal.0 - here.0, goal.1 - here.1);
            let determinant = a * d - b * c;
            if determinant > 0.0 {
                dx += (d * u - b * v) / determinant;
                dy += (a * v - c * u) / determinant;
            }
        }
        if libm::hypot(dx, dy) < NO_SHIFT_MM { (0.0, 0.0) } else { (dx, dy) }
    }

    /// Light of the band over that of the mapping's band where `place` lands: eq. 7 and relative
    /// illumination.
    pub fn gain(&self, place: (f64, f64)) -> f64 {
        let shift = self.shift_mm(place);
        let at = |field: &Option<OverField<'_, f64>>| {
            field.as_ref().map_or(1.0, |field| field.at(place.0 + shift.0, place.1 + shift.1))
        };
        let [band, reference] = self.lit.each_ref().map(at);
        if reference > 0.0 { self.on_axis * band / reference } else { self.on_axis }
    }

    /// Whether the band lands where the mapping's does, with the same relative illumination.
    pub fn is_same(&self, place: (f64, f64)) -> bool {
        self.shift_mm(place) == (0.0, 0.0)
            && (self.gain(place) - self.on_axis).abs() <= ALIKE * self.on_axis.abs()
    }
}
