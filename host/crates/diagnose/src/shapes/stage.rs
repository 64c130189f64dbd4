//! How a shape becomes a stage of the sensor model: `[[effect]] kind = "empirical"`.

use super::Shape;
use crate::data::design::Design;
use crate::model::effects;
use crate::statistics::maps;
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_camera::empirical::{Curve, Empirical, Table};
use camrig_sensor_core::effects::empirical::Quantity;

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
