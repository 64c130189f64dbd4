//! The rig's registers, at the addresses of MIPI CCS (Camera Command Set) where it has them.
//!
//! As in a real sensor, exposure is counted in lines: `exposure_s = lines x line_length_ns x 1e-9`, and
//! gain is a code: `gain = code / 256` (CCS gain type 0 with m0 = 1, c0 = 0, m1 = 0, c1 = 256).
//! Registers take effect with the next frame that does not bring its own exposure.

use crate::message::{Exposure, Fault};

/// Model number that this rig answers with.
pub const MODEL_ID: u16 = 0xca39;

/// Addresses.
pub mod address {
    /// Read-only: [`super::MODEL_ID`].
    pub const MODEL_ID: u16 = 0x0000;
    /// Read-only: frame counter, 16 bits, wraps.
    pub const FRAME_COUNT: u16 = 0x0005;
    /// 1 streams, 0 stands by: frames without their own exposure are then dropped.
    pub const MODE_SELECT: u16 = 0x0100;
    /// Exposure, lines.
    pub const COARSE_INTEGRATION_TIME: u16 = 0x0202;
    /// Analogue gain code.
    pub const ANALOG_GAIN: u16 = 0x0204;
    /// Lines per frame, exposure included: the exposure is cut to it.
    pub const FRAME_LENGTH_LINES: u16 = 0x0340;
    /// Test pattern: 0 none, 1 solid (register 0x0602), 2 colour bars, 4 PN9.
    pub const TEST_PATTERN: u16 = 0x0600;
    /// DN of the solid test pattern.
    pub const TEST_DATA: u16 = 0x0602;
    /// Line time, ns (manufacturer-specific).
    pub const LINE_LENGTH_NS: u16 = 0x3000;
    /// Fault to show with the next frame: 0 none, 1 drop it, 2 corrupt a row, 3 stop the frame counter
    /// (until written 0), 4 late. Manufacturer-specific.
    pub const FAULT: u16 = 0x3100;
    /// The corrupt row's number, or the lateness in ms.
    pub const FAULT_ARGUMENT: u16 = 0x3102;
}

/// Values of the writable registers and the frame counter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Registers {
    /// Frames begun, but for a stuck counter.
    pub frame_count: u16,
    /// Whether frames without their own exposure are made.
    pub streaming: bool,
    lines: u16,
    gain_code: u16,
    frame_length: u16,
    /// Test pattern code.
    pub test_pattern: u16,
    /// DN of the solid test pattern.
    pub test_data: u16,
    line_ns: u32,
    fault: u16,
    fault_argument: u16,
}

impl Default for Registers {
    fn default() -> Self {
        Self::new()
    }
}

impl Registers {
    /// Values at power-on.
    pub const fn new() -> Self {
        Self {
            frame_count: 0,
            streaming: true,
            lines: 1000,
            gain_code: 256,
            frame_length: 2000,
            test_pattern: 0,
            test_data: 0,
            line_ns: 10_000,
            fault: 0,
            fault_argument: 0,
        }
    }

    /// Value of a register.
    pub fn read(&self, address: u16) -> Option<u32> {
        Some(match address {
            address::MODEL_ID => MODEL_ID.into(),
            address::FRAME_COUNT => self.frame_count.into(),
            address::MODE_SELECT => self.streaming.into(),
            address::COARSE_INTEGRATION_TIME => self.lines.into(),
            address::ANALOG_GAIN => self.gain_code.into(),
            address::FRAME_LENGTH_LINES => self.frame_length.into(),
            address::TEST_PATTERN => self.test_pattern.into(),
            address::TEST_DATA => self.test_data.into(),
            address::LINE_LENGTH_NS => self.line_ns,
            address::FAULT => self.fault.into(),
            address::FAULT_ARGUMENT => self.fault_argument.into(),
            _ => return None,
        })
    }

    /// Writes a register; false, and nothing changes, where that cannot be.
    pub fn write(&mut self, address: u16, value: u32) -> bool {
        if address == address::LINE_LENGTH_NS {
            let allowed = (1..=10_000_000).contains(&value);
            if allowed {
                self.line_ns = value;
            }
            return allowed;
        }
        let Ok(value) = u16::try_from(value) else { return false };
        let (register, allowed) = match address {
            address::MODE_SELECT if value <= 1 => {
                self.streaming = value == 1;
                return true;
            }
            address::COARSE_INTEGRATION_TIME => (&mut self.lines, true),
            address::ANALOG_GAIN => (&mut self.gain_code, value >= 1),
            address::FRAME_LENGTH_LINES => (&mut self.frame_length, value >= 1),
            address::TEST_PATTERN => (&mut self.test_pattern, matches!(value, 0 | 1 | 2 | 4)),
            address::TEST_DATA => (&mut self.test_data, true),
            address::FAULT => (&mut self.fault, value <= 4),
            address::FAULT_ARGUMENT => (&mut self.fault_argument, true),
            _ => return false,
        };
        if allowed {
            *register = value;
        }
        allowed
    }

    /// The exposure that the registers ask for.
    pub fn exposure(&self) -> Exposure {
        let lines = self.lines.min(self.frame_length);
        // Both factors are exact in f32 for all register values that matter (below 2^24).
        Exposure {
            exposure_s: f32::from(lines) * (self.line_ns as f32 * 1e-9),
            analog_gain: f32::from(self.gain_code) / 256.0,
        }
    }

    /// Counts a frame and takes the fault that it is to show.
    pub fn next_frame(&mut self) -> Fault {
        let fault = match self.fault {
            1 => Fault::DropFrame,
            2 => Fault::CorruptRow(self.fault_argument),
            3 => return Fault::StuckCounter,
            4 => Fault::LateFrame(self.fault_argument),
            _ => Fault::None,
        };
        self.fault = 0;
        self.frame_count = self.frame_count.wrapping_add(1);
        fault
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposure_follows_the_registers() {
        let mut r = Registers::default();
        assert!(r.write(address::LINE_LENGTH_NS, 20_000));
        assert!(r.write(address::COARSE_INTEGRATION_TIME, 500));
        assert!(r.write(address::ANALOG_GAIN, 640));
        let e = r.exposure();
        // One rounding each in 20000e-9, and in its product with 500.
        assert!((e.exposure_s - 0.01).abs() <= 2.0 * f32::EPSILON * 0.01);
        assert_eq!(e.analog_gain, 2.5);
        assert!(r.write(address::FRAME_LENGTH_LINES, 100));
        assert!((r.exposure().exposure_s - 0.002).abs() <= 2.0 * f32::EPSILON * 0.002);
    }

    #[test]
    fn read_only_and_senseless_writes_are_refused() {
        let mut r = Registers::default();
        let before = r;
        for (address, value) in [
            (address::MODEL_ID, 1),
            (address::FRAME_COUNT, 1),
            (address::MODE_SELECT, 2),
            (address::ANALOG_GAIN, 0),
            (address::TEST_PATTERN, 3),
            (address::FAULT, 5),
            (address::COARSE_INTEGRATION_TIME, 0x1_0000),
            (address::LINE_LENGTH_NS, 0),
            (0x4444, 0),
        ] {
            assert!(!r.write(address, value), "{address:#06x} <- {value}");
        }
        assert_eq!(r, before);
    }

    #[test]
    fn a_fault_shows_once_but_a_stuck_counter_stays() {
        let mut r = Registers::default();
        assert!(r.write(address::FAULT, 1));
        assert_eq!((r.next_frame(), r.next_frame()), (Fault::DropFrame, Fault::None));
        assert_eq!(r.frame_count, 2);
        assert!(r.write(address::FAULT, 3));
        assert_eq!((r.next_frame(), r.next_frame()), (Fault::StuckCounter, Fault::StuckCounter));
        assert_eq!(r.frame_count, 2);
    }
}
