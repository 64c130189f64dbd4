//! The effects of a camera under diagnosis: which it has, and how one is put into it.

use camrig_camera::{AnyEffect, Camera, EffectKind};
use camrig_sensor_core::effects::{Effect, Parameter};

/// The effect of a kind that a camera has; of several the first.
pub fn of_camera(camera: &Camera, kind: &str) -> Option<AnyEffect> {
    let optical = camera.optical_effects.iter().find(|o| o.entry().kind == kind);
    let optical = optical.map(|o| AnyEffect::Optical(o.clone()));
    optical.or_else(|| current(camera, kind).map(AnyEffect::Sensor))
}

/// The parameters that a kind declares.
pub fn declared(kind: &str) -> &'static [Parameter] {
    EffectKind::all().find(|e| e.kind == kind).map_or(&[], |e| e.parameters)
}

/// Puts an effect into a camera, in place of one of its kind.
pub fn put(camera: &mut Camera, effect: &AnyEffect) {
    match effect {
        AnyEffect::Sensor(effect) => put_sensor(camera, *effect),
        AnyEffect::Optical(effect) => {
            let kind = effect.entry().kind;
            match camera.optical_effects.iter_mut().find(|e| e.entry().kind == kind) {
                Some(e) => e.clone_from(effect),
                None => camera.optical_effects.push(effect.clone()),
            }
        }
    }
}

/// The effect of a kind in a camera's chain; of several the first.
pub fn current(camera: &Camera, kind: &str) -> Option<Effect> {
    camera.chain().into_iter().find(|e| e.entry().kind == kind)
}

/// Puts an effect of the sensor into a camera, in place of one of its kind. Effects of the base
/// model set the camera's noise figures; what the camera file lists beyond the base model keeps its
/// place.
fn put_sensor(camera: &mut Camera, effect: Effect) {
    let noise = &mut camera.sensor.noise;
    match effect {
        Effect::ReadNoise(e) => {
            noise.read_e = f64::from(e.read_e);
            noise.read_e_post = f64::from(e.read_e_post);
        }
        Effect::Prnu(e) => noise.prnu = f64::from(e.sigma),
        Effect::DarkCurrent(e) => {
            noise.dark_current_e_per_s = f64::from(e.mean_e_per_s);
            noise.dsnu_e_per_s = f64::from(e.dsnu_e_per_s);
            noise.dark_doubling_c = f64::from(e.doubling_c);
            noise.temperature_ref_c = f64::from(e.reference_c);
        }
        Effect::RowOffsetFpn(e) => noise.row_fpn_e = f64::from(e.sigma_e),
        _ => {
            let id = effect.entry().id;
            match camera.effects.iter_mut().find(|e| e.entry().id == id) {
                Some(e) => *e = effect,
                None => add(camera, effect),
            }
        }
    }
}

/// Adds an effect to a camera, in addition to others of its kind.
pub fn add(camera: &mut Camera, effect: Effect) {
    let at = camera.effects.partition_point(|e| rank(e) <= rank(&effect));
    camera.effects.insert(at, effect);
}

/// Order among the effects of a camera file: those of the converter come last.
fn rank(effect: &Effect) -> u8 {
    match effect {
        Effect::SystemGain(_) => 1,
        Effect::BlackLevelOffset(_) => 2,
        Effect::AdcNonlinearity(_) => 3,
        Effect::OffsetClipping(_) => 4,
        _ => 0,
    }
}

/// System gain, DN/e⁻, at an analog gain, with the camera's `system-gain` effect.
pub fn dn_per_e(camera: &Camera, analog_gain: f64) -> f64 {
    let ratio = match current(camera, "system-gain") {
        Some(Effect::SystemGain(e)) => f64::from(e.ratio),
        _ => 1.0,
    };
    ratio * camera.sensor.dn_per_e(analog_gain)
}
