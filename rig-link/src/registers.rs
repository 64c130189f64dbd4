//! The rig's registers, at the addresses of MIPI CCS (Camera Command Set) where it has them.
//!
//! As in a real sensor, exposure is counted in lines: `exposure_s = lines x line_length_ns x
//! 1e-9`, and gain is a code: `gain = code / 256` (CCS gain type 0 with m0 = 1, c0 = 0, m1 = 0, c1
//! = 256).
//!
//! As in a real sensor, a value written while the sensor streams takes effect some frames later; a
//! delay of 1, the least, is the next frame. Exposure and frame length take 2 frames and gain 1
//! unless the delay registers say otherwise (the values of the IMX219 and others in libcamera's
//! table of sensors). Before the first frame and in standby a write takes effect at once; under
//! group hold writes wait for its end. Frames that bring their own exposure do not use the
//! registers, but are counted.
//!
//! CCS addresses bytes, high byte first. A register is read and written as a whole at its own
//! address ([`Registers::read`], [`Registers::write`]), and byte by byte, as many drivers do, at
//! the address of each byte ([`Registers::read_byte`], [`Registers::write_byte`]).

use crate::message::{Exposure, Fault};

/// Model number of this rig.
pub const MODEL_ID: u16 = 0xca39;

/// Addresses of the registers.
pub mod address {
    /// Read-only: [`super::MODEL_ID`].
    pub const MODEL_ID: u16 = 0x0000;
    /// Read-only: frame counter, 16 bits, wraps.
    pub const FRAME_COUNT: u16 = 0x0005;
    /// 1: streaming; 0: standby, in which frames without their own exposure are dropped.
    pub const MODE_SELECT: u16 = 0x0100;
    /// 1: writes to exposure, gain and frame length are held back; 0: they take effect together.
    pub const GROUPED_PARAMETER_HOLD: u16 = 0x0104;
    /// Exposure, lines.
    pub const COARSE_INTEGRATION_TIME: u16 = 0x0202;
    /// Analogue gain code: 256 times the gain.
    pub const ANALOG_GAIN: u16 = 0x0204;
    /// Lines per frame; a longer exposure is limited to it.
    pub const FRAME_LENGTH_LINES: u16 = 0x0340;
    /// Test pattern: 0 none, 1 solid (register 0x0602), 2 colour bars, 4 PN9.
    pub const TEST_PATTERN: u16 = 0x0600;
    /// DN of the solid test pattern.
    pub const TEST_DATA: u16 = 0x0602;
    /// Line time, ns (manufacturer-specific).
    pub const LINE_LENGTH_NS: u16 = 0x3000;
    /// Frames until a written exposure or frame length takes effect, 1 to 4.
    /// Manufacturer-specific.
    pub const EXPOSURE_DELAY: u16 = 0x3004;
    /// Frames until a written gain takes effect, 1 to 4. Manufacturer-specific.
    pub const GAIN_DELAY: u16 = 0x3006;
    /// Fault of the next frame: 0 none, 1 drop it, 2 corrupt a row, 3 stop the frame counter
    /// (until 0 is written), 4 deliver it late. Manufacturer-specific.
    pub const FAULT: u16 = 0x3100;
    /// Number of the corrupt row, or the delay in ms.
    pub const FAULT_ARGUMENT: u16 = 0x3102;
}

/// Bytes of each register, by its address (MIPI CCS; the frame counter has 8 bits there).
const BYTES: [(u16, u16); 14] = [
    (address::MODEL_ID, 2),
    (address::FRAME_COUNT, 1),
    (address::MODE_SELECT, 1),
    (address::GROUPED_PARAMETER_HOLD, 1),
    (address::COARSE_INTEGRATION_TIME, 2),
    (address::ANALOG_GAIN, 2),
    (address::FRAME_LENGTH_LINES, 2),
    (address::TEST_PATTERN, 2),
    (address::TEST_DATA, 2),
    (address::LINE_LENGTH_NS, 4),
    (address::EXPOSURE_DELAY, 2),
    (address::GAIN_DELAY, 2),
    (address::FAULT, 2),
    (address::FAULT_ARGUMENT, 2),
];

/// The register that has a byte at `address`, and the place of that byte in its value, bits.
fn place(address: u16) -> Option<(u16, u32)> {
    let mut registers = BYTES.iter();
    let &(register, bytes) = registers.find(|(at, n)| (*at..at + n).contains(&address))?;
    Some((register, 8 * u32::from(register + bytes - 1 - address)))
}

/// Longest delay of a written value, frames.
const MAX_DELAY: usize = 4;
/// Longest line time, ns (10 ms).
const MAX_LINE_NS: u32 = 10_000_000;
/// Gain code of unity gain (CCS gain type 0, c1).
pub const UNITY_GAIN_CODE: u16 = 256;

/// Values that take effect some frames after they are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Timing {
    lines: u16,
    gain_code: u16,
    frame_length: u16,
}

/// Values of the writable registers and the frame counter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Registers {
    /// Frames begun; stands still with a stuck counter.
    pub frame_count: u16,
    /// Whether frames without their own exposure are computed.
    pub streaming: bool,
    /// As last written.
    written: Timing,
    /// As last written outside a group hold.
    released: Timing,
    /// Values released when the last frames began, newest first.
    begun: [Timing; MAX_DELAY - 1],
    /// Whether a frame has begun since power-on or the end of standby.
    running: bool,
    hold: bool,
    exposure_delay: u16,
    gain_delay: u16,
    /// Test pattern code.
    pub test_pattern: u16,
    /// DN of the solid test pattern.
    pub test_data: u16,
    line_ns: u32,
    fault: u16,
    fault_argument: u16,
    /// A register some of whose bytes have been written, and its value with them: one that it
    /// does not take until its lower bytes have come.
    part: Option<(u16, u32)>,
}

impl Default for Registers {
    fn default() -> Self {
        Self::new()
    }
}

impl Registers {
    /// Values at power-on.
    pub const fn new() -> Self {
        let timing = Timing { lines: 1000, gain_code: UNITY_GAIN_CODE, frame_length: 2000 };
        Self {
            frame_count: 0,
            streaming: true,
            written: timing,
            released: timing,
            begun: [timing; MAX_DELAY - 1],
            running: false,
            hold: false,
            exposure_delay: 2,
            gain_delay: 1,
            test_pattern: 0,
            test_data: 0,
            line_ns: 10_000,
            fault: 0,
            fault_argument: 0,
            part: None,
        }
    }

    /// Value of a register, as last written; at the address of a further byte of a register, that
    /// byte. `None` if there is no such register.
    pub fn read(&self, address: u16) -> Option<u32> {
        self.value(address).or_else(|| self.read_byte(address).map(u32::from))
    }

    /// The byte at an address, high byte first; `None` if no register is there.
    pub fn read_byte(&self, address: u16) -> Option<u8> {
        let (register, shift) = place(address)?;
        Some((self.latest(register)? >> shift) as u8)
    }

    /// Value of a register with the bytes of it that wait for others.
    fn latest(&self, register: u16) -> Option<u32> {
        match self.part {
            Some((of, value)) if of == register => Some(value),
            _ => self.value(register),
        }
    }

    fn value(&self, register: u16) -> Option<u32> {
        Some(match register {
            address::MODEL_ID => MODEL_ID.into(),
            address::FRAME_COUNT => self.frame_count.into(),
            address::MODE_SELECT => self.streaming.into(),
            address::GROUPED_PARAMETER_HOLD => self.hold.into(),
            address::COARSE_INTEGRATION_TIME => self.written.lines.into(),
            address::ANALOG_GAIN => self.written.gain_code.into(),
            address::FRAME_LENGTH_LINES => self.written.frame_length.into(),
            address::TEST_PATTERN => self.test_pattern.into(),
            address::TEST_DATA => self.test_data.into(),
            address::LINE_LENGTH_NS => self.line_ns,
            address::EXPOSURE_DELAY => self.exposure_delay.into(),
            address::GAIN_DELAY => self.gain_delay.into(),
            address::FAULT => self.fault.into(),
            address::FAULT_ARGUMENT => self.fault_argument.into(),
            _ => return None,
        })
    }

    /// Writes a register; at the address of a further byte of a register, that byte. Returns
    /// false, and changes nothing, if there is no such register, it is read-only or the value is
    /// not allowed.
    pub fn write(&mut self, address: u16, value: u32) -> bool {
        match place(address) {
            Some((register, _)) if register != address => {
                u8::try_from(value).is_ok_and(|byte| self.write_byte(address, byte))
            }
            _ => self.write_whole(address, value),
        }
    }

    /// Writes the byte at an address, high byte first. It takes effect at once where the register
    /// takes the value with it, else with the register's last byte. Returns false, and changes
    /// nothing, if there is no such register, it is read-only or the value is not allowed.
    pub fn write_byte(&mut self, address: u16, byte: u8) -> bool {
        let read_only = [address::MODEL_ID, address::FRAME_COUNT];
        let Some((register, shift)) = place(address) else { return false };
        let Some(value) = self.latest(register) else { return false };
        if read_only.contains(&register) {
            return false;
        }
        let value = value & !(0xff << shift) | u32::from(byte) << shift;
        let waits = shift > 0;
        let taken = self.write_whole(register, value);
        if !taken && waits {
            self.part = Some((register, value));
        }
        taken || waits
    }

    fn write_whole(&mut self, address: u16, value: u32) -> bool {
        let allowed = self.set(address, value);
        if self.part.is_some_and(|(register, _)| register == address) {
            self.part = None;
        }
        if allowed && !self.hold {
            self.released = self.written;
            if !self.running {
                self.begun = [self.released; MAX_DELAY - 1];
            }
        }
        allowed
    }

    fn set(&mut self, address: u16, value: u32) -> bool {
        if address == address::LINE_LENGTH_NS {
            let allowed = (1..=MAX_LINE_NS).contains(&value);
            if allowed {
                self.line_ns = value;
            }
            return allowed;
        }
        let Ok(value) = u16::try_from(value) else { return false };
        let delay = (1..=MAX_DELAY as u16).contains(&value);
        let (register, allowed) = match address {
            address::MODE_SELECT if value <= 1 => {
                self.streaming = value == 1;
                self.running = false;
                return true;
            }
            address::GROUPED_PARAMETER_HOLD if value <= 1 => {
                self.hold = value == 1;
                return true;
            }
            address::COARSE_INTEGRATION_TIME => (&mut self.written.lines, value >= 1),
            address::ANALOG_GAIN => (&mut self.written.gain_code, value >= 1),
            address::FRAME_LENGTH_LINES => (&mut self.written.frame_length, value >= 1),
            address::TEST_PATTERN => (&mut self.test_pattern, matches!(value, 0 | 1 | 2 | 4)),
            address::TEST_DATA => (&mut self.test_data, true),
            address::EXPOSURE_DELAY => (&mut self.exposure_delay, delay),
            address::GAIN_DELAY => (&mut self.gain_delay, delay),
            address::FAULT => (&mut self.fault, value <= 4),
            address::FAULT_ARGUMENT => (&mut self.fault_argument, true),
            _ => return false,
        };
        if allowed {
            *register = value;
        }
        allowed
    }

    /// Values in force in the frame that begins next, of registers with this delay.
    fn in_force(&self, delay: u16) -> Timing {
        match usize::from(delay).checked_sub(2) {
            Some(frames_ago) => self.begun.get(frames_ago).copied().unwrap_or(self.released),
            None => self.released,
        }
    }

    /// Lines of the frame that begins next, and the line time, ns.
    pub fn frame_lines(&self) -> (u16, u32) {
        (self.in_force(self.exposure_delay).frame_length, self.line_ns)
    }

    /// Exposure and gain of the frame that begins next, as the registers have them.
    pub fn exposure(&self) -> Exposure {
        let timing = self.in_force(self.exposure_delay);
        let lines = timing.lines.min(timing.frame_length);
        let exposure_ns = u64::from(lines) * u64::from(self.line_ns);
        Exposure {
            // 1e9 is exact in f32, and so are ns of 24 bits and zeros: then one rounding, to the
            // value that these seconds have wherever they are written.
            exposure_s: exposure_ns as f32 / 1e9,
            analog_gain: f32::from(self.in_force(self.gain_delay).gain_code)
                / f32::from(UNITY_GAIN_CODE),
        }
    }

    /// Begins a frame: counts it and returns the fault that it is to have.
    pub fn next_frame(&mut self) -> Fault {
        self.begun.rotate_right(1);
        self.begun[0] = self.released;
        self.running = true;
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
    extern crate std;
    use super::*;

    #[test]
    fn exposure_follows_the_registers() {
        let mut r = Registers::default();
        assert!(r.write(address::LINE_LENGTH_NS, 20_000));
        assert!(r.write(address::COARSE_INTEGRATION_TIME, 500));
        assert!(r.write(address::ANALOG_GAIN, 640));
        let e = r.exposure();
        assert_eq!((e.exposure_s, e.analog_gain), (0.01, 2.5));
        assert!(r.write(address::FRAME_LENGTH_LINES, 100));
        assert_eq!(r.exposure().exposure_s, 0.002);
        assert_eq!(r.frame_lines(), (100, 20_000));
    }

    /// Lines and gain code of the frames that begin now.
    fn frames(r: &mut Registers, count: usize) -> std::vec::Vec<(u16, u16)> {
        (0..count)
            .map(|_| {
                let e = r.exposure();
                r.next_frame();
                ((e.exposure_s * 1e5).round() as u16, (e.analog_gain * 256.0) as u16)
            })
            .collect()
    }

    #[test]
    fn writes_show_as_many_frames_later_as_the_delays_say() {
        let mut r = Registers::default();
        let write = |r: &mut Registers, lines, gain| {
            assert!(r.write(address::COARSE_INTEGRATION_TIME, lines));
            assert!(r.write(address::ANALOG_GAIN, gain));
        };
        write(&mut r, 500, 512);
        assert_eq!(frames(&mut r, 2), [(500, 512); 2], "before the first frame: at once");
        write(&mut r, 600, 300);
        assert_eq!(frames(&mut r, 3), [(500, 300), (600, 300), (600, 300)]);
        // One write between frames after the other, as a control loop does.
        let mut seen = std::vec::Vec::new();
        for i in 0..4 {
            write(&mut r, 700 + i, 400 + i);
            seen.extend(frames(&mut r, 1));
        }
        assert_eq!(seen, [(600, 400), (700, 401), (701, 402), (702, 403)]);
        assert!(r.write(address::EXPOSURE_DELAY, 4) && r.write(address::GAIN_DELAY, 3));
        write(&mut r, 800, 256);
        assert_eq!(
            frames(&mut r, 5)[..],
            [(701, 402), (702, 403), (703, 256), (800, 256), (800, 256)]
        );
    }

    #[test]
    fn a_group_hold_lets_writes_go_together_and_standby_at_once() {
        let mut r = Registers::default();
        frames(&mut r, 1);
        assert!(r.write(address::GROUPED_PARAMETER_HOLD, 1));
        assert!(r.write(address::ANALOG_GAIN, 512));
        assert_eq!(r.read(address::ANALOG_GAIN), Some(512));
        assert_eq!(frames(&mut r, 2), [(1000, 256); 2]);
        assert!(r.write(address::GROUPED_PARAMETER_HOLD, 0));
        assert_eq!(frames(&mut r, 1), [(1000, 512)]);
        assert!(r.write(address::MODE_SELECT, 0));
        assert!(r.write(address::COARSE_INTEGRATION_TIME, 30));
        assert!(r.write(address::MODE_SELECT, 1));
        assert_eq!(frames(&mut r, 1), [(30, 512)]);
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
            (address::COARSE_INTEGRATION_TIME, 0),
            (address::EXPOSURE_DELAY, 0),
            (address::GAIN_DELAY, 5),
            (address::GROUPED_PARAMETER_HOLD, 2),
            (address::LINE_LENGTH_NS, 0),
            (0x4444, 0),
        ] {
            assert!(!r.write(address, value), "{address:#06x} <- {value}");
        }
        assert_eq!(r, before);
    }

    #[test]
    fn a_register_is_its_bytes_the_high_one_first() {
        let mut r = Registers::default();
        assert!(r.write(address::COARSE_INTEGRATION_TIME, 0x0123));
        assert_eq!((r.read_byte(0x0202), r.read_byte(0x0203)), (Some(0x01), Some(0x23)));
        assert_eq!(r.read(0x0203), Some(0x23));
        assert!(r.write(0x0203, 0x45));
        assert_eq!(r.read(0x0202), Some(0x0145));
        assert!(r.write_byte(0x0202, 0x02));
        assert_eq!(r.read(0x0202), Some(0x0245));
        assert!(!r.write(0x0203, 0x100), "a byte has 8 bits");
        assert!(r.write(address::LINE_LENGTH_NS, 0x0001_2345));
        let line: std::vec::Vec<_> = (0x3000..0x3004).map(|a| r.read_byte(a).unwrap()).collect();
        assert_eq!(line, [0x00, 0x01, 0x23, 0x45]);
        assert_eq!(r.read_byte(address::FRAME_COUNT + 1), None, "CCS counts frames in 8 bits");
        assert!(!r.write_byte(0x0001, 0) && !r.write_byte(address::FRAME_COUNT, 0));
        assert!(!r.write_byte(0x4444, 0));
    }

    #[test]
    fn a_byte_whose_register_takes_no_such_value_waits_for_the_lower_byte() {
        let mut r = Registers::default();
        assert!(r.write(address::COARSE_INTEGRATION_TIME, 0x0100));
        // With this byte alone the exposure would be 0 lines.
        assert!(r.write_byte(0x0202, 0x00));
        assert_eq!((r.read(0x0202), r.read_byte(0x0202)), (Some(0x0100), Some(0x00)));
        assert!(r.write_byte(0x0203, 0x40));
        assert_eq!(r.read(0x0202), Some(0x0040));
        // A whole value takes the place of a byte that waits.
        assert!(r.write_byte(0x0202, 0x01) && r.write_byte(0x0203, 0x00));
        assert!(r.write_byte(0x0202, 0x00) && r.write(0x0202, 0x0300) && r.write(0x0203, 0x07));
        assert_eq!(r.read(0x0202), Some(0x0307));
        // A low byte that makes a value not taken is refused.
        assert!(r.write(0x0202, 0x0001) && !r.write(0x0203, 0));
        assert_eq!(r.read(0x0202), Some(0x0001));
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
