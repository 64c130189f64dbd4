//! A camera whose samples are taken in steps of the captures' codes.

use camrig_camera::Camera;
use camrig_clean::Cleaned;

/// The camera of a cleaned set: where a step was taken off the codes, and the camera has the bits
/// of the samples as they were, it gets those that vary, with the same gain, DN per electron over
/// the step. A camera that has these bits already stays as it is.
pub fn camera_of(camera: &Camera, cleaned: &Cleaned) -> Camera {
    let mut camera = camera.clone();
    let Some(step) = cleaned.step() else { return camera };
    let (bits, shift) = (u32::from(camera.sensor.bits), u32::from(step.step).ilog2());
    if bits != cleaned.set().sensor.bits + shift {
        return camera;
    }
    let sensor = &mut camera.sensor;
    sensor.bits -= shift as u8;
    let full = |bits: u32| f64::from((1u32 << bits) - 1);
    let step_dn = f64::from(step.step);
    // The gain is full scale over full well.
    sensor.full_well_e *= full(bits - shift) * step_dn / full(bits);
    sensor.black_level_dn = (sensor.black_level_dn - f64::from(step.offset)).max(0.0) / step_dn;
    camera
}
