//! How a shape becomes a stage of the sensor model: `[[effect]] kind = "empirical"`.

use super::Shape;
use crate::data::design::Design;
use crate::model::effects;
use crate::statistics::maps::{self, MapKind};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_camera::empirical::{Curve, Empirical, Seam, Step, Table};
use camrig_sensor_core::effects::empirical::Quantity;

/// Maps in which parts of the sensor differ, in the order of the levels of [`Parts`].
pub(crate) const MAPS: [MapKind; 3] = [MapKind::Gain, MapKind::Offset, MapKind::DarkCurrent];
/// What they show, with its unit.
pub(crate) const UNITS: [&str; 3] = ["relative gain", "offset, e⁻", "dark current, e⁻/s"];

/// A camera with stages that simulate shapes, added after its own.
pub(crate) fn with_stages(
    camera: &Camera,
    design: &Design,
    shapes: &[Box<dyn Shape>],
) -> Result<Camera> {
    let mut camera = camera.clone();
    for shape in shapes {
        let findings = shape.findings();
        let description: Vec<&str> = findings.iter().map(|f| f.description.as_str()).collect();
        let description = Some(description.join("; "));
        let evidence = findings.first().map(|f| f.evidence[0]);
        for stage in shape.stages(&mut camera, design) {
            let description = description.clone();
            let stage = camera.keep(Empirical { description, evidence, ..stage })?;
            effects::add(&mut camera, stage);
        }
    }
    camera.check_chain()?;
    Ok(camera)
}

/// A stage of dark current at the temperature of a set's darks, which grows with temperature as the
/// camera's does.
pub(crate) fn dark(camera: &Camera, design: &Design, table: Table, rate: f64) -> Empirical {
    let temperature = (camera.sensor.noise.dark_doubling_c, temperature(camera, design));
    Empirical { temperature, ..Empirical::new(Quantity::Dark, table, rate) }
}

/// Temperature of the darks, °C.
fn temperature(camera: &Camera, design: &Design) -> f64 {
    let dark = maps::reference_dark(design);
    dark.map_or(camera.sensor.temperature_c, |i| design.conditions[i].stack.temperature_c)
}

/// Moves up to `rate` of the camera's mean dark current, e⁻/s at the temperature of the darks, into
/// a stage, and returns how much was moved. A stage cannot remove charge from pixels, so that where
/// they have less, the camera's own dark current is lowered for all.
pub(crate) fn take_dark(camera: &mut Camera, design: &Design, rate: f64) -> f64 {
    let at_c = temperature(camera, design);
    let noise = &mut camera.sensor.noise;
    let growth = libm::exp2((at_c - noise.temperature_ref_c) / noise.dark_doubling_c);
    let taken = rate.clamp(0.0, noise.dark_current_e_per_s * growth);
    noise.dark_current_e_per_s -= taken / growth;
    taken
}

/// Exposure of the shortest darks, s.
pub(crate) fn shortest_s(design: &Design) -> f64 {
    maps::reference_dark(design).map_or(0.0, |i| design.conditions[i].stack.exposure_s)
}

/// Parts of the sensor, which begin at certain columns and rows, and their levels.
pub(crate) struct Parts<'a> {
    pub columns: &'a [usize],
    pub rows: &'a [usize],
    /// Relative gain minus 1, offset (e⁻) in the shortest darks, dark current (e⁻/s), row by row of
    /// parts.
    pub levels: [Vec<f64>; 3],
}

impl Parts<'_> {
    /// Their stages.
    pub fn stages(self, camera: &mut Camera, design: &Design) -> Vec<Empirical> {
        let [gain, mut offset, mut rate] = self.levels.clone();
        let shortest = shortest_s(design);
        offset.iter_mut().zip(&rate).for_each(|(o, r)| *o -= r * shortest);
        let least = rate.iter().copied().fold(0.0, f64::min);
        if least < 0.0 {
            let taken = take_dark(camera, design, -least);
            rate.iter_mut().for_each(|r| *r += taken);
        }
        let of = |quantity, values: &[f64]| {
            let (table, amount) = self.steps(values)?;
            Some(Empirical::new(quantity, table, amount))
        };
        let rate = self.steps(&rate).map(|(table, amount)| dark(camera, design, table, amount));
        let fixed = [of(Quantity::Gain, &gain), of(Quantity::Offset, &offset)];
        fixed.into_iter().chain([rate]).flatten().collect()
    }

    /// Levels as steps from a column and a row on, which add up, and the largest of them.
    fn steps(&self, levels: &[f64]) -> Option<(Table, f64)> {
        let across = self.columns.len();
        let at = |x: Option<usize>, y: Option<usize>| match (x, y) {
            (Some(x), Some(y)) => levels[y * across + x],
            _ => 0.0,
        };
        let mut steps = Vec::new();
        for (y, first_row) in self.rows.iter().enumerate() {
            for (x, first_column) in self.columns.iter().enumerate() {
                let (left, above) = (x.checked_sub(1), y.checked_sub(1));
                let (x, y) = (Some(x), Some(y));
                let step = at(x, y) - at(left, y) - at(x, above) + at(left, above);
                let (first_column, first_row) = (*first_column as u32, *first_row as u32);
                steps.push(Step { first_column, first_row, step });
            }
        }
        let amount = steps.iter().map(|s| s.step).max_by(|a, b| a.abs().total_cmp(&b.abs()))?;
        steps.retain(|s| s.step != 0.0);
        steps.iter_mut().for_each(|s| s.step /= amount);
        (amount != 0.0).then_some((Table::Seam(Seam { seam: steps }), amount))
    }
}

/// A decay e^(−x/L) along lines of `n` pixels as a curve.
pub(crate) fn fall(n: usize, length: f64, from_end: bool) -> Curve {
    /// Decay lengths between knots, for which linear interpolation is accurate to 0.2 %, and where
    /// the curve ends (0.02 % is left).
    const STEP: f64 = 0.125;
    const END: f64 = 8.5;
    let knots = (0..).map(|i| f64::from(i) * STEP).take_while(|u| *u < END);
    let mut curve: Vec<(f64, f64)> = knots.map(|u| (u * length, libm::exp(-u))).collect();
    curve.push((END * length, 0.0));
    if from_end {
        let last = n.saturating_sub(1) as f64;
        curve.iter_mut().for_each(|k| k.0 = last - k.0);
        curve.reverse();
    }
    let (at, values) = curve.into_iter().unzip();
    Curve { at, values }
}
