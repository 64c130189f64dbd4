//! Adapts a camera to captures whose samples were divided by a step of the codes.

use camrig_camera::Camera;
use camrig_clean::Cleaned;

/// The camera for a cleaned set: where samples were divided by a step and the camera has the bits
/// of the undivided samples, its bits are reduced to those that vary, and its gain, DN per
/// electron, is divided by the step. A camera with the reduced bits is returned unchanged.
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
    // The gain stays the same.
    sensor.full_scale_e *= full(bits - shift) * step_dn / full(bits);
    sensor.black_level_dn = (sensor.black_level_dn - f64::from(step.offset)).max(0.0) / step_dn;
    camera
}
