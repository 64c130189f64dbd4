//! Which effects of a sensor remember the frame before.

use camrig_exposure::SimulatedSensor;
use camrig_sensor_core::effects::Needs;

/// The sensor's effects that depend on the light of the frame before. A rig knows that light only
/// where it is the frame's own, or none.
pub fn remembering(sensor: &SimulatedSensor) -> impl Iterator<Item = &'static str> + '_ {
    let entries = sensor.config.effects.iter().map(|effect| effect.entry());
    entries.filter(|entry| entry.needs == Needs::PreviousFrame).map(|entry| entry.kind)
}
