//! Parts of the sensor with an amplifier each, as stages and in words.

use super::stage::{dark, shortest_s, take_dark};
use crate::data::design::Design;
use crate::finding::number;
use crate::statistics::maps::MapKind;
use camrig_base::Value;
use camrig_camera::Camera;
use camrig_camera::empirical::{Empirical, Seam, Step, Table};
use camrig_sensor_core::effects::empirical::Quantity;

/// Maps in which parts of the sensor differ, in the order of the levels of [`Parts`].
pub(crate) const MAPS: [MapKind; 3] = [MapKind::Gain, MapKind::Offset, MapKind::DarkCurrent];
/// What they show, with its unit.
pub(crate) const UNITS: [&str; 3] = ["relative gain", "offset, e⁻", "dark current, e⁻/s"];

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

/// What a part differs in from another, as figures and in words: its gain over the other's, and the
/// steps in the maps, in the order of [`MAPS`]. Those without a standard error are not significant.
pub(crate) fn differences(
    ratio: Value,
    [_, offset, dark]: [Value; 3],
) -> (Vec<(&'static str, Value)>, String) {
    let all = [
        ("gain_ratio", ratio, "gain ratio", ""),
        ("offset_e", offset, "offset", " e⁻"),
        ("dark_current_e_per_s", dark, "dark current", " e⁻/s"),
    ];
    let significant = || all.iter().filter(|(_, step, ..)| step.std_error.is_finite());
    let words =
        significant().map(|(_, step, name, unit)| format!("{name} {}{unit}", number(*step)));
    let words: Vec<String> = words.collect();
    (significant().map(|(key, step, ..)| (*key, *step)).collect(), words.join(", "))
}
