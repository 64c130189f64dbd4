//! A copy of a rig's registers on the host, which tells the exposure of a frame before the frame
//! begins: light that changes with time is made for the windows in which its rows are open.
//!
//! A value that is written takes effect some frames later, and a rig does not tell what is under
//! way. So the copy runs the rig's own rules on what its registers hold between frames. What
//! another host writes and takes back between two looks is not seen; the start of the frame then
//! tells another exposure.

use super::Rig;
use camrig_base::Result;
use camrig_rig_link::registers::{Registers, address};

/// Registers that decide when rows are open.
const LOOKED_AT: [u16; 5] = [
    address::MODE_SELECT,
    address::EXPOSURE_DELAY,
    address::LINE_LENGTH_NS,
    address::FRAME_LENGTH_LINES,
    address::COARSE_INTEGRATION_TIME,
];

/// The copy.
#[derive(Clone, Debug, Default)]
pub struct Mirror {
    registers: Registers,
}

/// The frame that begins next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coming {
    /// Exposure, s.
    pub exposure_s: f32,
    /// Frame length, lines.
    pub lines: u16,
    /// Line time, ns.
    pub line_ns: u32,
}

impl Mirror {
    /// Looks at the rig's registers, and begins a frame.
    ///
    /// # Errors
    /// A rig without these registers, a link that fails.
    pub fn next_frame(&mut self, rig: &mut Rig) -> Result<Coming> {
        let held = rig.read_register(address::GROUPED_PARAMETER_HOLD)?;
        let hold = |registers: &mut Registers, when: u32| {
            if held == when {
                registers.write(address::GROUPED_PARAMETER_HOLD, held);
            }
        };
        hold(&mut self.registers, 1);
        for register in LOOKED_AT {
            let value = rig.read_register(register)?;
            if self.registers.read(register) != Some(value) {
                self.registers.write(register, value);
            }
        }
        hold(&mut self.registers, 0);
        let (lines, line_ns) = self.registers.frame_lines();
        let coming = Coming { exposure_s: self.registers.exposure().exposure_s, lines, line_ns };
        self.registers.next_frame();
        Ok(coming)
    }
}
