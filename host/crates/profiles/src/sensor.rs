//! A sensor on an I2C bus.
//!
//! A driver writes the address of a register and values, which go to it and the registers after it,
//! high bytes first; a read goes on at the address written last. What is written acts some frames
//! later, with the delays of the profile; in standby it acts at once.

use crate::field::Memory;
use crate::profile::{MAX_DELAY, Profile};
use embedded_hal::i2c::{ErrorKind, ErrorType, I2c, NoAcknowledgeSource, Operation};
use std::collections::VecDeque;

/// A byte that nobody acknowledged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nack {
    /// The address: no sensor is there.
    Address,
    /// A byte of data.
    Data,
}

impl embedded_hal::i2c::Error for Nack {
    fn kind(&self) -> ErrorKind {
        ErrorKind::NoAcknowledge(match self {
            Self::Address => NoAcknowledgeSource::Address,
            Self::Data => NoAcknowledgeSource::Data,
        })
    }
}

impl std::fmt::Display for Nack {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Address => "no sensor acknowledged this I2C address",
            Self::Data => "the sensor did not acknowledge a byte",
        })
    }
}

impl std::error::Error for Nack {}

/// What a frame is taken with.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Gain before the converter.
    pub analog_gain: f64,
    /// Digital gain, to be applied by the caller.
    pub digital_gain: f64,
    /// From the beginning of this frame to that of the next, s.
    pub frame_s: f64,
    /// Columns and rows that are read out, where registers say so.
    pub size: Option<(u32, u32)>,
    /// Columns are read from right to left.
    pub is_mirrored: bool,
    /// Rows are read from the bottom up.
    pub is_flipped: bool,
    /// Name of the test pattern, or its code where the profile has no name.
    pub test_pattern: Option<String>,
    /// The sensor's own exposure control is on, which is not modelled: exposure and gain are what
    /// the registers hold.
    pub is_automatic: bool,
}

/// A sensor with a register map.
#[derive(Clone, Debug)]
pub struct Sensor {
    profile: Profile,
    address: u8,
    identity: Memory,
    power_on: Memory,
    /// As last written.
    written: Memory,
    /// As last written outside a group hold.
    released: Memory,
    /// Registers released when the last frames began, newest first; none before the first frame.
    begun: VecDeque<Memory>,
    /// The address that a read goes on from.
    pointer: u16,
    /// A high byte that waits for its low byte, and its register; or the register whose low byte
    /// is read next.
    half: Option<(u16, u8)>,
    /// Transactions that are not acknowledged.
    nacks: u32,
}

impl Sensor {
    /// A sensor that was just switched on, at its usual address.
    pub fn new(profile: Profile) -> Self {
        let (power_on, identity) = profile.power_on();
        Self {
            address: profile.i2c[0], // checked: there is one
            identity,
            written: power_on.clone(),
            released: power_on.clone(),
            power_on,
            begun: VecDeque::new(),
            pointer: 0,
            half: None,
            nacks: 0,
            profile,
        }
    }

    /// The same at another I2C address.
    #[must_use]
    pub fn at(self, address: u8) -> Self {
        Self { address, ..self }
    }

    /// Its register map.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// Does not acknowledge so many transactions from now on: a fault for tests.
    pub fn refuse(&mut self, transactions: u32) {
        self.nacks = transactions;
    }

    /// What a register holds.
    pub fn register(&self, address: u16) -> u16 {
        self.written.get(&address).copied().unwrap_or(0)
    }

    /// Whether it takes frames.
    pub fn is_streaming(&self) -> bool {
        self.profile.state.streams.holds(&self.written, self.profile.register_bits)
    }

    /// Begins a frame; `None` in standby.
    pub fn next_frame(&mut self) -> Option<Frame> {
        if !self.is_streaming() {
            return None;
        }
        self.begun.push_front(self.released.clone());
        self.begun.truncate(MAX_DELAY as usize);
        let frame = self.frame();
        Some(frame)
    }

    /// Lets frames go by that nobody takes: all that was written acts in the next one.
    pub fn settle(&mut self) {
        self.begun.clear();
    }

    /// Registers in force in the frame that has begun, of those with this delay.
    fn in_force(&self, delay: u32) -> &Memory {
        let frames_ago =
            (delay as usize).saturating_sub(1).min(self.begun.len().saturating_sub(1));
        self.begun.get(frames_ago).unwrap_or(&self.released)
    }

    fn frame(&self) -> Frame {
        let profile = &self.profile;
        let (timing, exposure, state) = (&profile.timing, &profile.exposure, &profile.state);
        let bits = profile.register_bits;
        let lengths = self.in_force(timing.frame_length_delay);
        let clock_hz = profile.pixel_clock_hz(lengths);
        let line_clocks = u128::from(profile.length(&timing.line_length, lengths));
        let frame_lines = u128::from(profile.length(&timing.frame_length, lengths));
        let exposing = self.in_force(exposure.delay);
        let read = |field: &Option<crate::Field>| {
            u128::from(field.as_ref().map_or(0, |field| field.read(exposing, bits)))
        };
        // Exposure and frame length in clocks times `per_line`, whole numbers.
        let per_line = u128::from(exposure.per_line);
        let code = u128::from(exposure.field.read(exposing, bits).max(exposure.min));
        let wanted = code * line_clocks + read(&exposure.fine) * per_line;
        let margin = u128::from(exposure.margin) * line_clocks * per_line;
        let given = frame_lines * line_clocks * per_line;
        let (wanted, given) = match exposure.lengthens_frame {
            true => (wanted, given.max(wanted + margin)),
            false => (wanted.min(given.saturating_sub(margin)), given),
        };
        let shift = f64::from(1u32 << read(&exposure.shift).min(31));
        let seconds = |clocks: u128| clocks as f64 * shift / (per_line as f64 * clock_hz);
        let now = self.in_force(1);
        let gain = |gain: &crate::Gain| profile.factor(gain, self.in_force(gain.delay));
        let pattern = profile.test_pattern.as_ref().and_then(|pattern| {
            let code = pattern.field.read(now, bits);
            let mut names = pattern.names.iter();
            let name = names.find(|(_, of)| **of == code).map(|(name, _)| name.clone());
            (code != 0).then(|| name.unwrap_or_else(|| format!("{code:#x}")))
        });
        let size = profile.size.as_ref();
        Frame {
            exposure_s: seconds(wanted),
            analog_gain: gain(&profile.analog_gain),
            digital_gain: profile.digital_gain.as_ref().map_or(1.0, gain),
            frame_s: seconds(given),
            size: size.map(|size| (size.width.read(now, bits), size.height.read(now, bits))),
            is_mirrored: profile.is(&state.mirrored, now),
            is_flipped: profile.is(&state.flipped, now),
            test_pattern: pattern,
            is_automatic: state.manual.is_some() && !profile.is(&state.manual, now),
        }
    }

    /// Writes a register.
    fn set(&mut self, address: u16, value: u16) {
        let (profile, bits) = (&self.profile, self.profile.register_bits);
        let is_locked = profile.state.locked.as_ref().is_some_and(|locked| {
            locked.holds(&self.written, bits) && !locked.field().is_at(address)
        });
        if is_locked || self.identity.contains_key(&address) {
            return;
        }
        let was_held = profile.is(&profile.state.holds, &self.written);
        self.written.insert(address, value);
        let is_reset = profile.is(&profile.state.resets, &self.written);
        if is_reset {
            self.written = self.power_on.clone();
        }
        if !profile.is(&profile.state.holds, &self.written) {
            // The whole only where more than this register changes: messages have many.
            if was_held || is_reset {
                self.released = self.written.clone();
            } else {
                self.released.insert(address, value);
            }
        }
        if !self.is_streaming() {
            self.begun.clear();
        }
    }

    /// Takes the bytes between a start and a stop.
    fn receive(&mut self, bytes: &[u8]) {
        let (address, mut data) = match (self.profile.address_bits, bytes) {
            (8, [address, data @ ..]) => (u16::from(*address), data),
            (16, [high, low, data @ ..]) => (u16::from_be_bytes([*high, *low]), data),
            _ => return,
        };
        self.pointer = address;
        if self.profile.register_bits == 8 {
            for byte in data {
                self.set(self.pointer, (*byte).into());
                self.step();
            }
            return;
        }
        if let (Some((register, high)), true, [low]) = (self.half, self.is_low_byte(), data) {
            self.half = None;
            return self.set(register, u16::from_be_bytes([high, *low]));
        }
        while let [high, low, rest @ ..] = data {
            self.set(self.pointer, u16::from_be_bytes([*high, *low]));
            self.step();
            data = rest;
        }
        if let [high] = data {
            self.half = Some((self.pointer, *high));
        }
    }

    fn send(&mut self, bytes: &mut [u8]) {
        if self.profile.register_bits == 8 {
            for byte in bytes {
                *byte = self.register(self.pointer) as u8;
                self.step();
            }
            return;
        }
        if let (Some((register, _)), true, [low]) = (self.half, self.is_low_byte(), &mut *bytes) {
            *low = self.register(register) as u8;
            self.half = None;
            return;
        }
        for pair in bytes.chunks_mut(2) {
            let value = self.register(self.pointer).to_be_bytes();
            pair.copy_from_slice(&value[..pair.len()]);
            if let [high] = pair {
                self.half = Some((self.pointer, *high));
            }
            self.step();
        }
    }

    fn is_low_byte(&self) -> bool {
        self.profile.low_byte_at == Some(self.pointer)
    }

    /// To the next register.
    fn step(&mut self) {
        let last = ((1u32 << self.profile.address_bits) - 1) as u16;
        self.pointer = self.pointer.wrapping_add(1) & last;
    }
}

impl ErrorType for Sensor {
    type Error = Nack;
}

impl I2c for Sensor {
    fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), Nack> {
        if address != self.address {
            return Err(Nack::Address);
        }
        if self.nacks > 0 {
            self.nacks -= 1;
            return Err(Nack::Data);
        }
        // Writes one after another are one, without a start in between.
        let mut sent = Vec::new();
        for operation in operations {
            match operation {
                Operation::Write(bytes) => sent.extend_from_slice(bytes),
                Operation::Read(bytes) => {
                    self.receive(&std::mem::take(&mut sent));
                    self.send(bytes);
                }
            }
        }
        self.receive(&sent);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
