//! Light that the manifest does not state, taken from the frames themselves.

use crate::data::channels::Channels;
use crate::data::curve;
use crate::data::design::{Condition, Design, Target};
use crate::model::effects::dn_per_e;
use crate::model::light::{self, Lights};
use crate::statistics::maps;
use crate::statistics::targets::Picture;
use crate::statistics::temporal::{Temporal, mean};
use camrig_base::Result;
use camrig_camera::Camera;
use camrig_captures::Role;
use camrig_clean::FrameCurve;

/// Where the manifest does not have the light of a flat, takes it from the measured mean.
pub(super) fn of_flats(camera: &Camera, design: &mut Design, stacks: &[Temporal]) {
    let black = maps::black_level(camera, design, stacks);
    let channels = Channels::new(camera);
    for (c, t) in design.conditions.iter_mut().zip(stacks) {
        if c.stack.role == Role::Flat && !c.level_known {
            let k = dn_per_e(camera, c.stack.analog_gain);
            let by_channel = channels.means(&t.mean.data);
            c.photo_e = by_channel.iter().map(|m| ((m - black) / k).max(0.0)).collect();
            c.before_e.clone_from(&c.photo_e);
        }
    }
}

/// Where the manifest does not have the illuminance of a scene, takes it from the measured mean.
pub(super) fn of_targets(
    camera: &Camera,
    targets: &mut [Target],
    pictures: &[Picture],
    lights: &Lights,
) -> Result<()> {
    for (target, picture) in targets.iter_mut().zip(pictures).filter(|(t, _)| t.lux.is_none()) {
        let electrons = &lights.of(camera, std::slice::from_ref(target))?[0].data;
        let gain = dn_per_e(camera, target.stack.analog_gain);
        let predicted = mean(electrons) * light::share(target) * gain;
        let measured = mean(&picture.mean.data) - camera.sensor.black_level_dn;
        target.light = (measured / predicted.max(1e-12)).max(0.0);
    }
    Ok(())
}

/// Where the lamp drifts within stacks, determines which of their frames has the stated light.
pub(super) fn of_drifting_lamp(
    camera: &Camera,
    design: &mut Design,
    stacks: &[Temporal],
    curve: &FrameCurve,
) {
    let black = maps::black_level(camera, design, stacks);
    let channels = Channels::new(camera);
    let shares = channels.shares();
    let ratio = |(c, t): (&Condition, &Temporal)| {
        let light: f64 = c.photo_e.iter().zip(&shares).map(|(e, s)| e * s).sum();
        (t.level() - black) / (light * dn_per_e(camera, c.stack.analog_gain))
    };
    let flats = design.conditions.iter().zip(stacks).filter(|(c, _)| c.is_known_flat());
    let mut ratios: Vec<f64> =
        flats.filter(|(_, t)| maps::saturated(t) < maps::SATURATED_FLAT).map(ratio).collect();
    curve::set_stated_light(design, curve, &mut ratios);
}
