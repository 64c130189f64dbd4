//! How bright scenes of radiance are.

use super::{Grid, Scene};
use camrig_base::{Error, Result};
use camrig_light::photometry::{KM, observer_in_bands};

/// Cells across the frame over which a mean luminance is taken: their averages are exact, and the
/// last row misses the frame's edge by half a cell at most.
const METER_CELLS: usize = 256;

/// Mean luminance of a scene of radiance over a frame of that aspect (width over height), cd/m².
///
/// # Errors
/// Those of [`Scene::plane`].
pub fn mean_luminance(scene: &dyn Scene, frame_aspect: f64) -> Result<f64> {
    let bands = scene.bands();
    let cell = 1.0 / METER_CELLS as f64;
    let height = (METER_CELLS as f64 / frame_aspect).round().max(1.0) as usize;
    let top = -0.5 * height as f64 * cell;
    let grid = Grid { width: METER_CELLS, height, left: -0.5, top, cell };
    let [_, visibility, _] = observer_in_bands(&bands);
    let mut luminance = 0.0;
    for (band, &v) in visibility.iter().enumerate().filter(|(_, v)| **v > 0.0) {
        let plane = scene.plane(band, &grid)?;
        let sum: f64 = plane.data.iter().map(|&radiance| f64::from(radiance)).sum();
        luminance += KM * v * bands.step_nm * sum / plane.data.len() as f64;
    }
    Ok(luminance)
}

/// Refuses a scene whose radiance has no absolute scale: it needs a light level.
///
/// # Errors
/// A picture of radiance, of which neither its file nor the user says how bright it was.
pub fn check_absolute(scene: &dyn Scene) -> Result<()> {
    if scene.white().is_none_or(|white| white.absolute) {
        return Ok(());
    }
    Err(Error::input("radiance without an absolute scale").help(
        "ask for a light level, which its white will have, or say the luminance of a unit of Y \
         behind its name, scale=CD_PER_M2",
    ))
}
