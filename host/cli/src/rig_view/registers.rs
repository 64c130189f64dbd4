//! The registers shown on the page.

use crate::view::Register;
use camrig_base::Result;
use camrig_rig::Rig;
use camrig_rig_link::registers::{UNITY_GAIN_CODE, address as at};

/// Addresses, names, and whether they are writable.
const SHOWN: [(u16, &str, bool); 14] = [
    (at::COARSE_INTEGRATION_TIME, "exposure, lines", true),
    (at::ANALOG_GAIN, "gain code, 256 × gain", true),
    (at::FRAME_LENGTH_LINES, "frame length, lines", true),
    (at::LINE_LENGTH_NS, "line time, ns", true),
    (at::MODE_SELECT, "1 streaming, 0 standby", true),
    (at::GROUPED_PARAMETER_HOLD, "group hold: 1 hold", true),
    (at::EXPOSURE_DELAY, "exposure delay, frames", true),
    (at::GAIN_DELAY, "gain delay, frames", true),
    (at::TEST_PATTERN, "test pattern: 0 none, 1, 2, 4", true),
    (at::TEST_DATA, "solid pattern, DN", true),
    (at::FAULT, "fault: 0 none, 1 to 4", true),
    (at::FAULT_ARGUMENT, "row or ms of the fault", true),
    (at::FRAME_COUNT, "frame counter", false),
    (at::MODEL_ID, "model", false),
];

/// Reads them; those that the rig lacks are omitted.
///
/// # Errors
/// A link that fails.
pub fn read(rig: &mut Rig) -> Result<Vec<Register>> {
    let mut found = Vec::new();
    for (address, name, writable) in SHOWN {
        if let Some(value) = rig.register_if_there(address)? {
            found.push(Register { address, name, value, writable });
        }
    }
    Ok(found)
}

/// Exposure (s) and gain of registers; `None` if the rig lacks one of them.
pub fn settings(registers: &[Register]) -> Option<(f64, f64)> {
    let value =
        |address| registers.iter().find(|r| r.address == address).map(|r| f64::from(r.value));
    let exposure_s = value(at::COARSE_INTEGRATION_TIME)? * value(at::LINE_LENGTH_NS)? * 1e-9;
    Some((exposure_s, value(at::ANALOG_GAIN)? / f64::from(UNITY_GAIN_CODE)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The emulator's line time is 10 µs.
    #[test]
    fn settings_are_those_of_the_registers() {
        let mut rig = Rig::open("emulator:").unwrap();
        rig.write_register(at::COARSE_INTEGRATION_TIME, 800).unwrap();
        rig.write_register(at::ANALOG_GAIN, 384).unwrap();
        let found = read(&mut rig).unwrap();
        assert_eq!(found.len(), SHOWN.len());
        let (exposure_s, gain) = settings(&found).unwrap();
        assert!((exposure_s - 0.008).abs() < 1e-12 && gain == 1.5);
        assert_eq!(settings(&found[1..]), None);
    }
}
