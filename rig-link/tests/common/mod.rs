//! Two ends in one process: a toy model, a link with faults, a virtual clock.

use camrig_rig_link::device::{Begun, Device, Model};
use camrig_rig_link::framing::{Framing, Receiver, Sender};
use camrig_rig_link::host::{Event, FrameIo, Host, Limits, Micros, Poll};
use camrig_rig_link::message::*;
use camrig_rig_link::registers::Registers;
use std::collections::VecDeque;
use std::convert::Infallible;

pub const WIDTH: usize = 40;
pub const BANDS: usize = 3;
pub const ROWS: u16 = 12;
pub const UNIT: usize = 33;
pub const UNITS: usize = BANDS * WIDTH.div_ceil(16);
pub const RAW_BYTES: usize = 2 * WIDTH;

/// splitmix64: seeds a fault schedule that repeats.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    pub fn chance(&mut self, p: f64) -> bool {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64 <= p
    }
}

pub const SHAPE: FrameShape = FrameShape {
    rows: ROWS,
    units: UNITS as u16,
    unit_bytes: UNIT as u16,
    raw_bytes: RAW_BYTES as u16,
    halo: 1,
};

/// Every raw row depends on three spectral rows, every byte of them, the frame and the camera.
pub fn toy_raw(camera: u64, frame: u32, row: u16, window: [Option<u64>; 3]) -> Vec<u8> {
    let mut random = Random(camera ^ u64::from(frame) << 20 ^ u64::from(row) << 50);
    for digest in window {
        random.0 ^= digest.unwrap_or(1);
        random.next();
    }
    (0..RAW_BYTES).map(|_| random.next() as u8).collect()
}

pub fn spectral_row(frame: u32, row: u16) -> Vec<u8> {
    let mut random = Random(u64::from(frame) << 16 | u64::from(row));
    // Some zeros, which COBS has to stuff.
    (0..UNITS * UNIT).map(|_| (random.next() as u8).saturating_sub(40)).collect()
}

pub fn expected_frame(camera: u64, frame: u32) -> Vec<Vec<u8>> {
    let digest = |row: i32| {
        (0..i32::from(ROWS)).contains(&row).then(|| camera_id(&spectral_row(frame, row as u16)))
    };
    (0..ROWS)
        .map(|row| {
            let r = i32::from(row);
            toy_raw(camera, frame, row, [digest(r - 1), digest(r), digest(r + 1)])
        })
        .collect()
}

#[derive(Default)]
pub struct Toy {
    received: Vec<u8>,
    camera: u64,
    frame: u32,
    rows: [(u16, Vec<u8>); 3],
}

impl Model for Toy {
    fn capabilities(&self) -> Capabilities {
        Capabilities {
            firmware: "toy".try_into().unwrap(),
            max_width: WIDTH as u16,
            max_bands: BANDS as u16,
            arithmetics: 1,
            codecs: 1,
            ..Default::default()
        }
    }

    fn camera_piece(&mut self, offset: u32, piece: &[u8]) -> Result<(), Refusal> {
        if offset == 0 {
            self.received.clear();
        }
        assert_eq!(offset as usize, self.received.len());
        self.received.extend_from_slice(piece);
        let max = 1000;
        if self.received.len() > max as usize {
            Err(Refusal::CameraTooLong { max })
        } else {
            Ok(())
        }
    }

    fn camera_end(&mut self) -> Result<(), Refusal> {
        self.camera = camera_id(&self.received);
        Ok(())
    }

    fn begin(&mut self, frame: &FrameBegin, _: Exposure, _: &Registers) -> Result<Begun, Refusal> {
        if usize::from(frame.width) > WIDTH {
            return Err(Refusal::TooWide { max: WIDTH as u16 });
        }
        self.frame = frame.frame;
        self.rows = Default::default();
        Ok(Begun::new(SHAPE, 1))
    }

    fn units(&mut self, row: u16, first: u16, units: &[u8]) {
        let slot = &mut self.rows[usize::from(row) % 3];
        if first == 0 {
            *slot = (row, Vec::new());
        }
        assert_eq!((slot.0, slot.1.len()), (row, usize::from(first) * UNIT), "row {row} {first}");
        slot.1.extend_from_slice(units);
    }

    fn raw_row(&mut self, row: u16, out: &mut [u8]) {
        let digest = |r: i32| {
            (0..i32::from(ROWS)).contains(&r).then(|| {
                let (there, bytes) = &self.rows[r as usize % 3];
                assert_eq!((i32::from(*there), bytes.len()), (r, UNITS * UNIT), "raw row {row}");
                camera_id(bytes)
            })
        };
        let r = i32::from(row);
        let window = [digest(r - 1), digest(r), digest(r + 1)];
        out.copy_from_slice(&toy_raw(self.camera, self.frame, row, window));
    }
}

/// What happens to the bytes of one direction.
#[derive(Clone, Copy, Debug, Default)]
pub struct Faults {
    /// Chance per byte (per report on HID) of each of: flip, drop, duplicate.
    pub per_byte: f64,
    /// Chance per byte (per report on HID) that a burst of up to [`LONGEST_BURST`] bytes begins,
    /// which become others.
    pub per_burst: f64,
    /// Chance per write of each of: truncation, reordering with the next write, a stall.
    pub per_write: f64,
}

/// Longest burst of damage, bytes.
pub const LONGEST_BURST: usize = 100;

/// One direction of a link.
pub struct Pipe {
    /// Bytes of a burst that are still to come.
    burst: usize,
    queue: VecDeque<(Micros, Vec<u8>)>,
    pub faults: Faults,
    delay: Micros,
    pub bytes: u64,
}

impl Pipe {
    pub fn new(delay: Micros) -> Self {
        Self { burst: 0, queue: VecDeque::new(), faults: Faults::default(), delay, bytes: 0 }
    }

    pub fn write(
        &mut self,
        now: Micros,
        bytes: &[u8],
        report: Option<usize>,
        random: &mut Random,
    ) -> Result<(), Infallible> {
        self.bytes += bytes.len() as u64;
        let f = self.faults;
        let mut sent = Vec::new();
        for unit in bytes.chunks(report.unwrap_or(1)) {
            let mut unit = unit.to_vec();
            if f.per_burst > 0.0 && random.chance(f.per_burst) {
                self.burst = 1 + random.below(LONGEST_BURST);
            }
            for byte in unit.iter_mut().take(self.burst) {
                *byte = random.next() as u8;
            }
            self.burst = self.burst.saturating_sub(unit.len());
            if random.chance(f.per_byte) {
                match random.below(3) {
                    0 => {
                        let i = random.below(unit.len());
                        unit[i] ^= 1 << random.below(8);
                    }
                    1 => continue,
                    _ => sent.extend_from_slice(&unit),
                }
            }
            sent.extend_from_slice(&unit);
        }
        let mut arrival = now + self.delay;
        if random.chance(f.per_write) {
            match random.below(3) {
                0 => sent.truncate(
                    random.below(sent.len() + 1) / report.unwrap_or(1) * report.unwrap_or(1),
                ),
                1 => {
                    if let Some((_, last)) = self.queue.back_mut() {
                        std::mem::swap(last, &mut sent);
                    }
                }
                _ => arrival += 400_000,
            }
        }
        // A stream stays in order: nothing overtakes what was stalled.
        arrival = arrival.max(self.queue.back().map_or(0, |(t, _)| *t));
        self.queue.push_back((arrival, sent));
        Ok(())
    }

    fn read(&mut self, now: Micros) -> Option<Vec<u8>> {
        (self.queue.front()?.0 <= now).then(|| self.queue.pop_front().unwrap().1)
    }

    fn next(&self) -> Option<Micros> {
        self.queue.front().map(|(t, _)| *t)
    }

    pub fn clear(&mut self) {
        self.queue.clear();
    }
}

/// The host's memory: one frame.
pub struct Frame {
    pub frame: u32,
    pub camera: Vec<u8>,
    pub raw: Vec<Vec<u8>>,
}

impl FrameIo for Frame {
    fn spectral(&mut self, row: u16, first: u16, out: &mut [u8]) {
        let at = usize::from(first) * UNIT;
        out.copy_from_slice(&spectral_row(self.frame, row)[at..at + out.len()]);
    }

    fn raw_row(&mut self, row: u16) -> &mut [u8] {
        &mut self.raw[usize::from(row)]
    }

    fn camera(&mut self, offset: u32, out: &mut [u8]) {
        let at = offset as usize;
        out.copy_from_slice(&self.camera[at..at + out.len()]);
    }
}

pub type ToyDevice = Device<RAW_BYTES>;
pub type ToyHost = Host<[u16; ROWS as usize]>;

/// Host, device, and the link between.
pub struct Bench {
    pub now: Micros,
    pub random: Random,
    pub framing: Framing,
    pub up: Pipe,
    pub down: Pipe,
    pub host: ToyHost,
    pub device: Box<ToyDevice>,
    pub toy: Toy,
    host_receiver: Receiver<Vec<u8>>,
    /// What has been read and not yet used.
    host_input: Vec<u8>,
    device_receiver: Receiver<Vec<u8>>,
    host_sender: Sender<Vec<u8>>,
    device_sender: Sender<Vec<u8>>,
    pub io: Frame,
    pub session: u16,
}

pub fn begin(frame: u32) -> FrameBegin {
    FrameBegin {
        transfer: 0,
        frame,
        rows: ROWS,
        width: WIDTH as u16,
        bands: BANDS as u16,
        codec: Codec::Bfp16,
        arithmetic: NumberFormat::F32,
        raw_bits: 16,
        temperature_c: 25.0,
        before: Before::Dark,
        exposure: Some(Exposure { exposure_s: 0.01, analog_gain: 1.0 }),
    }
}

impl Bench {
    pub fn new(framing: Framing, limits: Limits, seed: u64) -> Self {
        let buffer = || vec![0; framing.max_encoded(2000)];
        Self {
            now: 0,
            random: Random(seed),
            framing,
            up: Pipe::new(50),
            down: Pipe::new(50),
            host: Host::new(limits, [0; ROWS as usize]),
            device: Box::new(ToyDevice::new(600, 32)),
            toy: Toy::default(),
            host_receiver: Receiver::new(framing, buffer()),
            host_input: Vec::new(),
            device_receiver: Receiver::new(framing, buffer()),
            host_sender: Sender::new(framing, buffer()),
            device_sender: Sender::new(framing, buffer()),
            io: Frame {
                frame: 0,
                camera: (0..700).map(|i| i as u8).collect(),
                raw: vec![vec![0; RAW_BYTES]; ROWS.into()],
            },
            session: 0,
        }
    }

    pub fn set_faults(&mut self, faults: Faults) {
        (self.up.faults, self.down.faults) = (faults, faults);
    }

    /// The cable is unplugged and plugged in again: what was in flight is lost.
    pub fn disconnect(&mut self) {
        self.up.clear();
        self.down.clear();
        self.host_input.clear();
        let buffer = || vec![0; self.framing.max_encoded(2000)];
        self.host_receiver = Receiver::new(self.framing, buffer());
        self.host_sender = Sender::new(self.framing, buffer());
        if self.framing == Framing::Length {
            // A new connection, to the device as well.
            self.device_receiver = Receiver::new(self.framing, buffer());
            self.device_sender = Sender::new(self.framing, buffer());
        }
    }

    /// Runs the host's operation to its end, or until `stop` packets were sent. The clock jumps to
    /// whatever happens next.
    pub fn run(&mut self, stop: Option<u32>) -> Option<Event> {
        let report = match self.framing {
            Framing::Report(size) => Some(usize::from(size)),
            _ => None,
        };
        let mut out = [0; 2000];
        let mut sent = 0;
        for _ in 0..5_000_000 {
            let wait = match self.host.poll(self.now, &mut self.io, &mut out) {
                Poll::Done(event) => return Some(event),
                Poll::Send(bytes) => {
                    if stop == Some(sent) {
                        return None;
                    }
                    sent += 1;
                    let (up, random, now) = (&mut self.up, &mut self.random, self.now);
                    let write = |bytes: &[u8]| up.write(now, bytes, report, random);
                    self.host_sender.push(&out[..bytes], write).unwrap();
                    continue;
                }
                Poll::Wait(until) => until,
            };
            let (up, random, now) = (&mut self.up, &mut self.random, self.now);
            let write = |bytes: &[u8]| up.write(now, bytes, report, random);
            self.host_sender.flush(write).unwrap();
            let next = [self.up.next(), self.down.next(), Some(wait)];
            self.now = next.into_iter().flatten().min().unwrap().max(self.now);
            while let Some(bytes) = self.up.read(self.now) {
                let mut input = &bytes[..];
                let (down, random, now) = (&mut self.down, &mut self.random, self.now);
                let mut write = |bytes: &[u8]| down.write(now, bytes, report, random);
                while self.device_receiver.push(&mut input) == Ok(true) {
                    self.device.receive(self.device_receiver.packet(), &mut self.toy);
                    while let Some(n) = self.device.transmit(&mut out, &mut self.toy) {
                        self.device_sender.push(&out[..n], &mut write).unwrap();
                    }
                }
                self.device_sender.flush(write).unwrap();
            }
            loop {
                let bytes = std::mem::take(&mut self.host_input);
                let mut input = &bytes[..];
                while self.host_receiver.push(&mut input) == Ok(true) {
                    let packet = self.host_receiver.packet();
                    if let Some(event) = self.host.receive(self.now, packet, &mut self.io) {
                        self.host_input = input.to_vec();
                        return Some(event);
                    }
                }
                let Some(bytes) = self.down.read(self.now) else { break };
                self.host_input = bytes;
            }
        }
        panic!("hang: the host neither ends nor fails");
    }

    pub fn connect(&mut self) -> Event {
        self.session += 1;
        self.host.connect(self.session);
        self.run(None).unwrap()
    }

    pub fn send_camera(&mut self) -> Event {
        self.host.send_camera(camera_id(&self.io.camera), self.io.camera.len() as u32);
        self.run(None).unwrap()
    }

    pub fn frame(&mut self, frame: u32, resume: bool) -> Event {
        self.begin(frame, resume);
        self.run(None).unwrap()
    }

    pub fn begin(&mut self, frame: u32, resume: bool) {
        self.io.frame = frame;
        if !resume {
            self.io.raw.iter_mut().for_each(|row| row.fill(0));
        }
        self.host.begin(begin(frame), SHAPE, resume);
    }

    pub fn is_right(&self) -> bool {
        self.io.raw == expected_frame(camera_id(&self.io.camera), self.io.frame)
    }
}
