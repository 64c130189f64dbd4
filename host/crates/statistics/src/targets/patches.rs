//! The patches of a ColorChecker that fills a frame.

use camrig_base::{Plane, Result};
use camrig_camera::Camera;
use camrig_measure::patches::{self, Patch, built_in_corners};

/// The patches of a frame of codes or of their means, DN.
///
/// # Errors
/// Charts that cannot be measured, for example with patches that are too small.
pub(super) fn measure<T: Copy + Into<f64>>(
    camera: &Camera,
    card_width: f64,
    frame: &Plane<T>,
) -> Result<Vec<Patch>> {
    let s = &camera.sensor;
    let corners = built_in_corners(frame.width, frame.height, card_width);
    let full = ((1u32 << s.bits) - 1) as u16;
    patches::measure(frame, &s.cfa, s.black_level_dn, full, &corners)
}

/// Variance of the luminance within each patch of a frame, DN².
pub(super) fn variances(camera: &Camera, card_width: f64, frame: &Plane<u16>) -> Result<Vec<f64>> {
    let patches = measure(camera, card_width, frame)?;
    Ok(patches.iter().map(|p| p.luminance_std_dn.powi(2)).collect())
}
