//! Rows in the light of lamps that change while the rows collect it.

use camrig_base::Result;
use camrig_camera::RowWindows;
use camrig_exposure::{IrradianceCube, weighted};
use camrig_light::Lamps;

/// What falls on the rows of a sensor from a scene that stands still: its irradiance times the mean
/// of its lamps over each row's window. `parts` are the irradiance of the lamps' regions alone, in
/// their order: there the regions' lamps stand for the others. Nothing where the light is steady.
///
/// # Errors
/// Irradiance that cannot be read.
pub fn lamp_rows(
    cube: &IrradianceCube,
    parts: &[IrradianceCube],
    windows: &RowWindows,
    lamps: &Lamps,
) -> Result<Option<IrradianceCube>> {
    if lamps.are_steady() {
        return Ok(None);
    }
    let all: Vec<f64> = windows.rows().map(|row| lamps.mean(row)).collect();
    let of_parts = parts.iter().zip(lamps.regions()).map(|(part, (_, lamps))| {
        let means = windows.rows().zip(&all).map(|(row, all)| lamps.mean(row) - all);
        (part, means.collect())
    });
    let mut cubes: Vec<(&IrradianceCube, Vec<f64>)> = of_parts.collect();
    cubes.insert(0, (cube, all));
    weighted(&cubes).map(Some)
}
