//! Values of the registers that decide frames. A rig that restarted while its link was broken has
//! its power-on values: a resumed frame must not be taken with these.

use super::Rig;
use camrig_base::Result;
use camrig_rig_link::registers::address;

/// The registers, in the order in which they are restored.
const DECISIVE: [(u16, &str); 9] = [
    (address::EXPOSURE_DELAY, "exposure delay"),
    (address::GAIN_DELAY, "gain delay"),
    (address::LINE_LENGTH_NS, "line time"),
    (address::FRAME_LENGTH_LINES, "frame length"),
    (address::COARSE_INTEGRATION_TIME, "exposure"),
    (address::ANALOG_GAIN, "gain"),
    (address::TEST_DATA, "test data"),
    (address::TEST_PATTERN, "test pattern"),
    (address::MODE_SELECT, "mode"),
];

/// Values of the registers that a rig has, by their places in that list.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Held([Option<u32>; DECISIVE.len()]);

impl Held {
    /// Reads them.
    pub fn read(rig: &mut Rig) -> Result<Self> {
        let mut values = [None; DECISIVE.len()];
        for (value, (address, _)) in values.iter_mut().zip(DECISIVE) {
            *value = rig.register_if_there(address)?;
        }
        Ok(Self(values))
    }

    /// Records a value that was written; false for an address that is not in the list.
    pub fn write(&mut self, address: u16, value: u32) -> bool {
        let place = DECISIVE.iter().position(|(of, _)| *of == address);
        let held = place.and_then(|i| self.0[i].as_mut());
        held.map(|held| *held = value).is_some()
    }

    /// The rig's line time, ns.
    pub fn line_ns(&self) -> Option<u32> {
        let place = DECISIVE.iter().position(|(of, _)| *of == address::LINE_LENGTH_NS);
        place.and_then(|i| self.0[i])
    }

    /// Restores those that have other values in the rig, and returns which.
    pub fn restore(&self, rig: &mut Rig) -> Result<Option<String>> {
        let found = Self::read(rig)?;
        let mut said = Vec::new();
        for (i, (address, name)) in DECISIVE.into_iter().enumerate() {
            let (Some(value), Some(found)) = (self.0[i], found.0[i]) else { continue };
            if value != found {
                rig.write_register(address, value)?;
                said.push(format!("{name} {value} (it was {found})"));
            }
        }
        Ok((!said.is_empty()).then(|| said.join(", ")))
    }
}
