//! The device without sockets and clock: datagrams of GVCP in, their answers and packets of GVSP
//! out; orders of frames out, frames in. Times are since the device was switched on.
//!
//! **Control.** Who writes the control register holds the device until it writes 0 there, or is
//! silent for longer than the heartbeat. What others write is refused; they may read, unless the
//! holder wrote exclusive control. Any command of the holder is a sign of life. With control the
//! acquisition ends.

use crate::acquisition::{Acquisition, Start};
use crate::camera::{Order, Region, STUCK_COUNTER, Sensor, Taken, Timing};
use crate::features::{
    self, ACQUISITION_MODES, FAULTS, Limits, MIN_HEARTBEAT_MS, PACKET_SIZES, STEP, TEST_PATTERNS,
    WIDTH_STEP,
};
use crate::gvcp::{Command, MAX_PAYLOAD, Request, Status};
use crate::gvsp::Block;
use crate::memory::bootstrap::{self, DISCOVERY_BYTES};
use crate::memory::{Memory, feature};
use crate::pixel::PixelFormat;
pub use crate::stream::Counts;
use crate::stream::{Sending, Stream};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

/// Ticks of the device's clock in a second: they are ns.
const TICKS_PER_S: u32 = 1_000_000_000;
/// Bits of the control register: control, and control that excludes others.
const CONTROL_BITS: u32 = 3;
const EXCLUSIVE: u32 = 1;
/// The user's name of the device.
const USER_NAME: std::ops::Range<u32> = bootstrap::USER_NAME..bootstrap::USER_NAME + 16;
/// Bits of the packet size register: fire a test packet, do not fragment, big endian.
const FIRE_TEST: u32 = 1 << 31;
const SIZE_FLAGS: u32 = 0x6000_0000;
/// Bit of the GVSP configuration register: block numbers of 64 bits.
const EXTENDED_IDS: u32 = 1 << 30;

/// The application in control.
#[derive(Clone, Copy, Debug)]
struct Controller {
    address: SocketAddrV4,
    heard: Duration,
}

/// What a device does next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// It sends the packet that it wrote.
    Packet {
        /// The host.
        to: SocketAddrV4,
        /// A block ends with it, so that another frame may begin.
        ends_block: bool,
    },
    /// It has nothing to send, until then if that is known.
    Wait(Option<Duration>),
}

/// A device.
#[derive(Debug)]
pub struct Device {
    sensor: Sensor,
    limits: Limits,
    formats: Vec<PixelFormat>,
    memory: Memory,
    /// Timing as last written.
    timing: Timing,
    /// Whether timing or test pattern have been written since the last order.
    is_written: bool,
    controller: Option<Controller>,
    acquisition: Option<Acquisition>,
    /// Whether a frame is being exposed, and the block that it becomes unless it is no longer
    /// wanted.
    is_busy: bool,
    exposing: Option<Block>,
    next_frame: u32,
    stream: Stream,
}

impl Device {
    /// A device at an address that sends its stream from this UDP port.
    pub fn new(sensor: Sensor, address: Ipv4Addr, source_port: u16) -> Self {
        let formats = PixelFormat::of_sensor(sensor.pattern, sensor.bits);
        let mut memory = Memory::new(&features::xml(&sensor, &formats));
        bootstrap_values(&mut memory, &sensor, address, source_port);
        memory.set(feature::WIDTH, sensor.width / WIDTH_STEP * WIDTH_STEP);
        memory.set(feature::HEIGHT, sensor.height / STEP * STEP);
        memory.set(feature::PIXEL_FORMAT, formats[0].code);
        memory.set(feature::ACQUISITION_FRAMES, 1);
        let (limits, timing) = (Limits::of(&sensor), sensor.timing);
        let mut device = Self {
            sensor,
            limits,
            formats,
            memory,
            timing,
            is_written: true,
            controller: None,
            acquisition: None,
            is_busy: false,
            exposing: None,
            next_frame: 0,
            stream: Stream::new(),
        };
        device.refresh();
        device
    }

    /// Packets so far.
    pub fn counts(&self) -> Counts {
        self.stream.counts
    }

    /// Takes a datagram of an application, and returns the answer if there is one.
    pub fn receive(
        &mut self,
        now: Duration,
        from: SocketAddrV4,
        datagram: &[u8],
    ) -> Option<Vec<u8>> {
        let request = Request::parse(datagram)?;
        self.expire(now);
        if let Some(controller) = self.controller.as_mut().filter(|c| c.address == from) {
            controller.heard = now;
        }
        let is_exclusive = self.memory.word(bootstrap::CONTROL) & EXCLUSIVE != 0;
        let is_other = self.controller.is_some_and(|c| c.address != from);
        let outcome = match request.command {
            Command::ReadRegisters(_) | Command::ReadMemory { .. } if is_exclusive && is_other => {
                Err(Status::AccessDenied)
            }
            Command::Discovery => self.memory.read(0, DISCOVERY_BYTES).map(<[u8]>::to_vec),
            Command::ReadRegisters(addresses) => self.read_registers(addresses),
            Command::ReadMemory { address, count } => self.read_memory(address, count),
            Command::WriteRegisters(writes) => self.write_registers(now, from, writes),
            Command::WriteMemory { address, data } => (self.write(now, from, address, data))
                .map(|()| (data.len() as u32).to_be_bytes().to_vec()),
            Command::Resend(resend) => {
                let receiver = *self.destination().ip();
                let holds = self.controller.is_some_and(|c| c.address.ip() == from.ip());
                if holds || receiver == *from.ip() {
                    self.stream.repeat(resend);
                }
                return None;
            }
            Command::Unknown => Err(Status::NotImplemented),
        };
        let answers = request.acknowledge || request.command == Command::Discovery;
        answers.then(|| request.answer(outcome.as_deref().map_err(|status| *status)))
    }

    /// The next frame to take, if it is time: to be delivered before there is another.
    pub fn order(&mut self, now: Duration) -> Option<Order> {
        self.expire(now);
        if self.is_busy || self.stream.is_full() || self.destination().port() == 0 {
            return None;
        }
        let start = self.start();
        let after_standby = self.acquisition.as_mut()?.begin(now, start)?;
        let frame = self.next_frame;
        self.next_frame = frame.wrapping_add(1);
        let format = self.format();
        let region = self.region();
        let fault = self.memory.word(feature::FAULT);
        if fault != u32::from(STUCK_COUNTER) {
            self.memory.set(feature::FAULT, 0);
        }
        let extended = self.memory.word(bootstrap::GVSP_CONFIGURATION) & EXTENDED_IDS != 0;
        self.is_busy = true;
        self.exposing = Some(Block {
            id: u64::from(frame) + 1,
            extended,
            timestamp: now.as_nanos() as u64,
            pixel_format: format.code,
            region,
            image: Vec::new(),
            packet_size: (self.memory.word(bootstrap::PACKET_SIZE) & 0xffff) as usize,
        });
        Some(Order {
            frame,
            after_standby,
            is_written: std::mem::take(&mut self.is_written),
            timing: self.timing.in_force(),
            test_pattern: self.memory.short(feature::TEST_PATTERN),
            test_value: self.memory.short(feature::TEST_VALUE),
            fault: fault as u16,
            fault_argument: self.memory.short(feature::FAULT_ARGUMENT),
            region,
            image_bytes: format.image_bytes(region.width, region.height) as usize,
            pixel_format: format.name,
        })
    }

    /// When the next frame may begin, if that is a matter of time.
    pub fn next_order(&self) -> Option<Duration> {
        let by_period = matches!(self.start(), Start::Period(_));
        self.acquisition.filter(|a| by_period && !a.is_over()).map(|a| a.due())
    }

    /// What became of the order.
    pub fn deliver(&mut self, taken: Taken) {
        self.is_busy = false;
        let Some(block) = self.exposing.take() else { return };
        let number = (block.id - 1) as u32;
        let counter = match taken {
            Taken::Image(image, counter) => {
                self.stream.push(Block { image, ..block });
                counter
            }
            Taken::Dropped(counter) => counter,
            Taken::End => {
                // Frames that wait are sent.
                self.acquisition = None;
                return self.memory.set(feature::ACQUISITION, 0);
            }
        };
        self.memory.set(feature::FRAME_NUMBER, number);
        self.memory.set(feature::FRAME_COUNTER, counter.into());
        if self.acquisition.is_some_and(|a| a.is_over()) {
            self.acquisition = None;
            self.memory.set(feature::ACQUISITION, 0);
        }
    }

    /// Writes the next packet of the stream, if it is time.
    pub fn next(&mut self, now: Duration, out: &mut Vec<u8>) -> Next {
        self.expire(now);
        let delay = Duration::from_nanos(self.memory.word(bootstrap::PACKET_DELAY).into());
        let loss = self.memory.float(feature::PACKET_LOSS) / 100.0;
        match self.stream.next(now, Sending { delay, loss }, out) {
            Ok(ends_block) => Next::Packet { to: self.destination(), ends_block },
            Err(until) => Next::Wait(until),
        }
    }

    /// How frames begin.
    fn start(&self) -> Start {
        if self.memory.word(feature::TRIGGER_MODE) == 1 {
            return Start::Trigger;
        }
        let lines = u64::from(self.timing.in_force().frame_lines);
        Start::Period(Duration::from_nanos(lines * u64::from(self.sensor.line_ns)))
    }

    fn destination(&self) -> SocketAddrV4 {
        let ip = Ipv4Addr::from(self.memory.word(bootstrap::DESTINATION));
        SocketAddrV4::new(ip, self.memory.short(bootstrap::HOST_PORT))
    }

    fn region(&self) -> Region {
        let [x, y, width, height] =
            [feature::OFFSET_X, feature::OFFSET_Y, feature::WIDTH, feature::HEIGHT]
                .map(|address| self.memory.word(address));
        Region { x, y, width, height }
    }

    fn format(&self) -> PixelFormat {
        let code = self.memory.word(feature::PIXEL_FORMAT);
        let mut formats = self.formats.iter();
        formats.find(|f| f.code == code).unwrap_or(&self.formats[0]).clone()
    }

    /// Takes control away from an application that has been silent for too long.
    fn expire(&mut self, now: Duration) {
        let heartbeat = Duration::from_millis(self.memory.word(bootstrap::HEARTBEAT_MS).into());
        if self.controller.is_some_and(|c| now.saturating_sub(c.heard) > heartbeat) {
            self.release();
        }
    }

    fn release(&mut self) {
        self.stop();
        self.stream.clear();
        self.controller = None;
        for register in [bootstrap::CONTROL, bootstrap::HOST_PORT, feature::LOCKED] {
            self.memory.set(register, 0);
        }
    }

    /// Ends the acquisition; the block that is being sent is finished.
    fn stop(&mut self) {
        (self.acquisition, self.exposing) = (None, None);
        self.stream.end();
        self.memory.set(feature::ACQUISITION, 0);
    }

    fn read_registers(&self, addresses: &[[u8; 4]]) -> Result<Vec<u8>, Status> {
        let mut values = Vec::new();
        for address in addresses {
            values.extend(self.memory.read(u32::from_be_bytes(*address), 4)?);
        }
        Ok(values)
    }

    fn read_memory(&self, address: u32, count: u16) -> Result<Vec<u8>, Status> {
        if usize::from(count) > MAX_PAYLOAD - 4 {
            return Err(Status::InvalidParameter);
        }
        let data = self.memory.read(address, count.into())?;
        Ok([&address.to_be_bytes(), data].concat())
    }

    fn write_registers(
        &mut self,
        now: Duration,
        from: SocketAddrV4,
        writes: &[[u8; 8]],
    ) -> Result<Vec<u8>, Status> {
        for &[a0, a1, a2, a3, ref value @ ..] in writes {
            self.write(now, from, u32::from_be_bytes([a0, a1, a2, a3]), value)?;
        }
        Ok((writes.len() as u32).to_be_bytes().to_vec())
    }

    /// Writes registers from an address on.
    fn write(
        &mut self,
        now: Duration,
        from: SocketAddrV4,
        mut address: u32,
        mut data: &[u8],
    ) -> Result<(), Status> {
        if !address.is_multiple_of(4) || !data.len().is_multiple_of(4) {
            return Err(Status::BadAlignment);
        }
        while !data.is_empty() {
            let others = self.controller.is_some_and(|c| c.address != from);
            if others || (self.controller.is_none() && address != bootstrap::CONTROL) {
                return Err(Status::AccessDenied);
            }
            let names = USER_NAME.contains(&address);
            let length = match address {
                _ if names => data.len().min((USER_NAME.end - address) as usize),
                feature::EXPOSURE_US..=feature::PACKET_LOSS => 8,
                _ => 4,
            };
            let (value, rest) = data.split_at_checked(length).ok_or(Status::InvalidParameter)?;
            if names {
                self.memory.put(address, value);
            } else if let Ok(word) = value.try_into() {
                self.write_word(now, from, address, u32::from_be_bytes(word))?;
            } else if let Ok(float) = value.try_into() {
                self.write_float(address, f64::from_be_bytes(float))?;
            }
            self.refresh();
            (address, data) = (address + length as u32, rest);
        }
        Ok(())
    }

    fn write_word(
        &mut self,
        now: Duration,
        from: SocketAddrV4,
        address: u32,
        value: u32,
    ) -> Result<(), Status> {
        let known = |names: &[(&str, u32)]| names.iter().any(|(_, v)| *v == value);
        let taken = match address {
            bootstrap::CONTROL => {
                self.control(now, from, value & CONTROL_BITS);
                return Ok(());
            }
            feature::ACQUISITION => return self.acquire(now, value),
            feature::TRIGGER_SOFTWARE => {
                self.acquisition.iter_mut().for_each(Acquisition::trigger);
                return Ok(());
            }
            bootstrap::PACKET_SIZE => return self.packet_size(value),
            feature::WIDTH | feature::HEIGHT | feature::OFFSET_X | feature::OFFSET_Y => {
                self.is_still()?;
                self.takes_part(address, value)
            }
            feature::PIXEL_FORMAT => {
                self.is_still()?;
                self.formats.iter().any(|f| f.code == value)
            }
            bootstrap::HEARTBEAT_MS => value >= MIN_HEARTBEAT_MS,
            bootstrap::HOST_PORT | bootstrap::DESTINATION => {
                // What waits was meant for the receiver before.
                self.stream.clear();
                true
            }
            bootstrap::PACKET_DELAY => true,
            bootstrap::GVSP_CONFIGURATION => value & !EXTENDED_IDS == 0,
            feature::TEST_PATTERN => known(&TEST_PATTERNS),
            feature::TEST_VALUE => value >> self.sensor.bits.min(16) == 0,
            feature::ACQUISITION_MODE => known(&ACQUISITION_MODES),
            feature::ACQUISITION_FRAMES => (1..=0xffff).contains(&value),
            feature::TRIGGER_SELECTOR | feature::TRIGGER_SOURCE => value == 0,
            feature::TRIGGER_MODE | feature::LOCKED => value <= 1,
            feature::FAULT => known(&FAULTS),
            feature::FAULT_ARGUMENT => value <= 0xffff,
            _ if self.memory.read(address, 4).is_ok() => return Err(Status::WriteProtect),
            _ => return Err(Status::InvalidAddress),
        };
        if !taken {
            return Err(Status::InvalidParameter);
        }
        self.is_written |= [feature::TEST_PATTERN, feature::TEST_VALUE].contains(&address);
        self.memory.set(address, value);
        Ok(())
    }

    fn write_float(&mut self, address: u32, value: f64) -> Result<(), Status> {
        let refused = Status::InvalidParameter;
        match address {
            feature::EXPOSURE_US => {
                let lines = self.limits.exposure_lines(value).ok_or(refused)?;
                self.timing.exposure_lines = lines;
            }
            feature::GAIN_DB => {
                self.timing.gain_code = features::gain_code(value).ok_or(refused)?
            }
            feature::FRAME_RATE => {
                self.timing.frame_lines = self.limits.frame_lines(value).ok_or(refused)?;
            }
            feature::PACKET_LOSS if (0.0..=100.0).contains(&value) => {
                self.memory.set_float(address, value);
                return Ok(());
            }
            feature::PACKET_LOSS => return Err(refused),
            _ => return Err(Status::InvalidAddress),
        }
        self.is_written = true;
        Ok(())
    }

    /// Takes or gives back control.
    fn control(&mut self, now: Duration, from: SocketAddrV4, value: u32) {
        if value == 0 {
            return self.release();
        }
        self.controller = Some(Controller { address: from, heard: now });
        self.memory.set(bootstrap::CONTROL, value);
    }

    fn acquire(&mut self, now: Duration, value: u32) -> Result<(), Status> {
        match value {
            0 => self.stop(),
            1 => {
                let frames = match self.memory.word(feature::ACQUISITION_MODE) {
                    0 => None,
                    1 => Some(1),
                    _ => Some(self.memory.word(feature::ACQUISITION_FRAMES)),
                };
                self.acquisition = Some(Acquisition::new(now, frames));
                self.memory.set(feature::ACQUISITION, 1);
            }
            _ => return Err(Status::InvalidParameter),
        }
        Ok(())
    }

    fn packet_size(&mut self, value: u32) -> Result<(), Status> {
        let size = value & 0xffff;
        if !PACKET_SIZES.contains(&size) {
            return Err(Status::InvalidParameter);
        }
        if value & FIRE_TEST != 0 {
            self.stream.test(size);
        }
        self.memory.set(bootstrap::PACKET_SIZE, value & SIZE_FLAGS | size);
        Ok(())
    }

    /// Refuses what must not change while blocks are sent.
    fn is_still(&self) -> Result<(), Status> {
        self.acquisition.map_or(Ok(()), |_| Err(Status::AccessDenied))
    }

    /// Whether a side or offset of the region fits.
    fn takes_part(&self, address: u32, value: u32) -> bool {
        let Region { x, y, width, height } = self.region();
        let (columns, rows) = (self.sensor.width, self.sensor.height);
        let (min, step, rest) = match address {
            feature::WIDTH => (WIDTH_STEP, WIDTH_STEP, columns - x),
            feature::HEIGHT => (STEP, STEP, rows - y),
            feature::OFFSET_X => (0, STEP, columns - width),
            _ => (0, STEP, rows - height),
        };
        (min..=rest).contains(&value) && value.is_multiple_of(step)
    }

    /// Sets the registers that follow from others.
    fn refresh(&mut self) {
        let Region { width, height, .. } = self.region();
        let bytes = self.format().image_bytes(width, height);
        self.memory.set(feature::PAYLOAD_BYTES, bytes as u32);
        let timing = self.timing.in_force();
        for (register, value) in [
            (feature::EXPOSURE_US, self.limits.exposure_us(timing.exposure_lines)),
            (feature::GAIN_DB, features::gain_db(timing.gain_code)),
            (feature::FRAME_RATE, self.limits.frame_rate(timing.frame_lines)),
        ] {
            self.memory.set_float(register, value);
        }
    }
}

/// Values of the bootstrap registers at power-on.
fn bootstrap_values(memory: &mut Memory, sensor: &Sensor, address: Ipv4Addr, source_port: u16) {
    const VERSION_2_0: u32 = 0x0002_0000;
    /// Big endian, texts in UTF-8.
    const MODE: u32 = 0x8000_0001;
    /// DHCP and link-local addresses, as much as the host's system supports them.
    const IP_MODES: u32 = 0x6;
    /// User name, serial number; resend, WRITEMEM and several registers in a command.
    const CAPABILITIES: u32 = 0xC000_0007;
    /// Source port register; block numbers of 16 bits.
    const STREAM_CAPABILITIES: u32 = 0xC000_0000;
    /// A locally administered address.
    const MAC_HIGH: u32 = 0x0200;
    let mask = if address.is_loopback() { 0xFF00_0000 } else { 0xFFFF_FF00 };
    for (register, value) in [
        (bootstrap::VERSION, VERSION_2_0),
        (bootstrap::DEVICE_MODE, MODE),
        (bootstrap::MAC_HIGH, MAC_HIGH),
        (bootstrap::MAC_LOW, address.into()),
        (bootstrap::IP_SUPPORTED, IP_MODES),
        (bootstrap::IP_CURRENT, IP_MODES),
        (bootstrap::IP_ADDRESS, address.into()),
        (bootstrap::IP_MASK, mask),
        (bootstrap::INTERFACES, 1),
        (bootstrap::STREAM_CHANNELS, 1),
        (bootstrap::GVSP_CAPABILITY, STREAM_CAPABILITIES),
        (bootstrap::GVCP_CAPABILITY, CAPABILITIES),
        (bootstrap::HEARTBEAT_MS, 3000),
        (bootstrap::TICKS_PER_S, TICKS_PER_S),
        (bootstrap::PACKET_SIZE, 1500),
        (bootstrap::SOURCE_PORT, source_port.into()),
    ] {
        memory.set(register, value);
    }
    for (register, length, text) in [
        (bootstrap::VENDOR, 32, "camrig"),
        (bootstrap::MODEL, 32, &*sensor.model),
        (bootstrap::DEVICE_VERSION, 32, env!("CARGO_PKG_VERSION")),
        (bootstrap::INFORMATION, 48, "simulated camera"),
        (bootstrap::SERIAL, 16, &*sensor.serial),
    ] {
        memory.set_text(register, length, text);
    }
}

#[cfg(test)]
mod tests;
