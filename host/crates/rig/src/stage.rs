//! The sensor stage, in this process or on a rig: the same bytes.

use super::{FrameRequest, Rig};
use camrig_base::{Error, RawFrame, Result};
use camrig_exposure::IrradianceCube;
use camrig_render::{Arithmetic, SimulatedSensor};
use camrig_sensor_core::config::FrameSettings;

/// Where frames are exposed.
pub struct SensorStage {
    rig: Option<Rig>,
    arithmetic: Arithmetic,
}

impl SensorStage {
    /// Opens the rig at an address; without one, frames are exposed in this process.
    ///
    /// # Errors
    /// Those of [`Rig::open`].
    pub fn open(rig: Option<&str>, arithmetic: Arithmetic) -> Result<Self> {
        Ok(Self { rig: rig.map(Rig::open).transpose()?, arithmetic })
    }

    /// See [`Rig::on_broken_link`]; in this process there is no link.
    pub fn on_broken_link(&mut self, tell: impl FnMut(&Error) + Send + 'static) {
        if let Some(rig) = &mut self.rig {
            rig.on_broken_link(tell);
        }
    }

    /// Sets the sensor whose frames follow.
    ///
    /// # Errors
    /// Those of [`Rig::set_camera`].
    pub fn set_camera(&mut self, sensor: &SimulatedSensor) -> Result<()> {
        self.rig.as_mut().map_or(Ok(()), |rig| rig.set_camera(sensor))
    }

    /// One frame under `cube`, after one under `before` (dark where none). A rig knows the light
    /// before a frame only where it is that of the frame itself.
    ///
    /// # Errors
    /// Those of [`SimulatedSensor::frame`] and [`Rig::frame`].
    pub fn frame(
        &mut self,
        sensor: &SimulatedSensor,
        cube: &IrradianceCube,
        before: Option<&IrradianceCube>,
        settings: &FrameSettings,
    ) -> Result<RawFrame> {
        let Some(rig) = &mut self.rig else {
            return sensor.frame(cube, before, settings, self.arithmetic);
        };
        let request = FrameRequest {
            settings: *settings,
            arithmetic: self.arithmetic,
            collapse: false,
            lit_before: before.is_some_and(|b| std::ptr::eq(b, cube)),
            by_registers: false,
        };
        rig.frame(cube, sensor, &request)?.to_raw(sensor)
    }
}
