//! The sensor stage, in this process or on a rig: the same bytes.

use super::remembering::remembering;
use super::{FrameRequest, Rig, RigFrame};
use camrig_base::{Error, RawFrame, Result};
use camrig_exposure::hdr::{HdrSensor, Sent, seen};
use camrig_exposure::{Arithmetic, FrameOptions, IrradianceCube, SimulatedSensor, Traps};
use camrig_sensor_core::config::FrameSettings;

/// Where frames are exposed.
pub struct SensorStage {
    rig: Option<Rig>,
    arithmetic: Arithmetic,
    cleared: Option<String>,
    /// What the frames so far left in the sensor's traps.
    traps: Traps,
}

impl SensorStage {
    /// Opens the rig at an address; without one, frames are exposed in this process. Faults and
    /// test patterns that an earlier host left in the rig's registers are cleared.
    ///
    /// # Errors
    /// Those of [`Rig::open`].
    pub fn open(rig: Option<&str>, arithmetic: Arithmetic) -> Result<Self> {
        let mut rig = rig.map(Rig::open).transpose()?;
        let cleared = rig.as_mut().map(Rig::clear_injected).transpose()?.flatten();
        Ok(Self { rig, arithmetic, cleared, traps: Traps::default() })
    }

    /// What an earlier host had left in the rig's registers and was cleared, in words.
    pub fn cleared(&self) -> Option<&str> {
        self.cleared.as_deref()
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

    /// Sets the sensor of several captures whose frames follow.
    ///
    /// # Errors
    /// Those of [`Rig::set_captures`].
    pub fn set_captures(&mut self, sensor: &HdrSensor) -> Result<()> {
        self.rig.as_mut().map_or(Ok(()), |rig| rig.set_captures(sensor))
    }

    /// What a sensor of several captures sends of a frame under `now`: light that all captures see,
    /// or that of each. `before` is that of the frame before, as for [`Self::frame`].
    ///
    /// # Errors
    /// Those of [`HdrSensor::frame`] and [`Self::frame`].
    pub fn sent(
        &mut self,
        sensor: &HdrSensor,
        now: &[&IrradianceCube],
        before: Option<&[&IrradianceCube]>,
        settings: &FrameSettings,
    ) -> Result<Sent> {
        let Some(rig) = &mut self.rig else {
            return sensor.frame(now, before, settings, self.arithmetic);
        };
        let same = |i| before.is_some_and(|before| std::ptr::eq(seen(before, i), seen(now, i)));
        let captures = sensor.captures();
        let lit_before = (0..captures.len()).all(same);
        if before.is_some()
            && !lit_before
            && let Some(effect) = captures.iter().find_map(|one| remembering(one).next())
        {
            return Err(changing_light(effect));
        }
        let request = FrameRequest {
            arithmetic: self.arithmetic,
            lit_before,
            ..FrameRequest::new(*settings)
        };
        let frame = rig.frame_of_captures(now, sensor, &request)?;
        check(&frame, settings)?;
        frame.to_sent(sensor)
    }

    /// One frame under `cube`, after one under `before` (dark where none) for the previous exposure
    /// of `settings`. Without `before` it is the sensor's first; else it follows the one taken
    /// last.
    ///
    /// # Errors
    /// Those of [`SimulatedSensor::frame`] and [`Rig::frame`]; light that changes under a sensor
    /// that remembers it ([`remembering`]), on a rig; a frame that the rig spoiled on request of
    /// another host.
    pub fn frame(
        &mut self,
        sensor: &SimulatedSensor,
        cube: &IrradianceCube,
        before: Option<&IrradianceCube>,
        settings: &FrameSettings,
    ) -> Result<RawFrame> {
        let Some(rig) = &mut self.rig else {
            if before.is_none() {
                self.traps = Traps::default();
            }
            let traps = Some(&mut self.traps);
            let options = FrameOptions { before, traps, arithmetic: self.arithmetic };
            return sensor.frame_with(cube, settings, options);
        };
        let lit_before = before.is_some_and(|b| std::ptr::eq(b, cube));
        if before.is_some()
            && !lit_before
            && let Some(effect) = remembering(sensor).next()
        {
            return Err(changing_light(effect));
        }
        let request = FrameRequest {
            arithmetic: self.arithmetic,
            lit_before,
            ..FrameRequest::new(*settings)
        };
        let frame = rig.frame(cube, sensor, &request)?;
        check(&frame, settings)?;
        frame.to_raw(sensor)
    }
}

/// Checks that a rig has taken a frame as it was asked to.
fn check(frame: &RigFrame, settings: &FrameSettings) -> Result<()> {
    if let Some(what) = frame.injected() {
        let what = format!("frame {} was altered by the rig: {what}", settings.frame);
        return Err(Error::disagreement(what)
            .help("another host wrote the rig's fault or test-pattern register; try again"));
    }
    let (asked, given) = (settings, frame.start.exposure);
    if given.exposure_s != asked.exposure_s || given.analog_gain != asked.analog_gain {
        return Err(Error::disagreement(format!(
            "the rig exposed frame {} for {} s at gain {} instead of {} s at gain {}",
            settings.frame,
            given.exposure_s,
            given.analog_gain,
            asked.exposure_s,
            asked.analog_gain
        ))
        .help("ask for an exposure and a gain that the rig keeps"));
    }
    Ok(())
}

/// Light that changes from frame to frame, under a sensor with an effect that remembers it.
pub fn changing_light(effect: &str) -> Error {
    Error::unsupported(format!(
        "{effect} depends on the light of the previous frame, which a rig knows only if the \
         light is steady: not with motion or changing irradiance"
    ))
    .help("expose these frames in this process, or remove the effect from the camera file")
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_rig_link::registers::address;

    /// A stage on an emulator in whose registers something was left. It is a link of its own, so
    /// the registers are written before the stage begins with what [`SensorStage::open`] does.
    #[test]
    fn what_an_earlier_host_left_in_the_registers_is_cleared_and_said() {
        let mut rig = Rig::open("emulator:").unwrap();
        assert_eq!(rig.clear_injected().unwrap(), None);
        for (register, value) in
            [(address::FAULT_ARGUMENT, 5), (address::FAULT, 2), (address::TEST_PATTERN, 1)]
        {
            rig.write_register(register, value).unwrap();
        }
        let said = rig.clear_injected().unwrap().unwrap();
        assert_eq!(said, "fault 2 (register 0x3100) and test pattern 1 (register 0x0600)");
        assert_eq!(rig.injected().unwrap(), None);
    }
}
