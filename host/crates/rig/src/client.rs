//! A connected rig: its camera, its registers, its frames.

use super::feed::Feed;
use super::held::Held;
#[cfg(feature = "hid")]
use super::hid;
use super::remembering::remembering;
#[cfg(feature = "serial")]
use super::serial;
use super::transport::Transport;
use super::{Url, emulator, tcp};
use camrig_base::{Error, ErrorCode, RawFrame, Result};
use camrig_exposure::IrradianceCube;
use camrig_exposure::hdr::{HdrSensor, Samples, Sent};
use camrig_exposure::{Arithmetic, SimulatedSensor};
use camrig_firmware_sim::camera::{self, Capture};
use camrig_firmware_sim::raw_row::RawRow;
use camrig_firmware_sim::rig as device;
use camrig_formats::csi2::{self, Embedded};
use camrig_rig_link::host::{Event, FrameIo, Host, HostStatistics, Poll};
use camrig_rig_link::message::{
    Before, Capabilities, Exposure, Fault, FrameBegin, FrameShape, FrameStart, Nack, NumberFormat,
    RECEIPT_BYTES, Refusal, SEVERAL_CAPTURES, Statistics, ToDevice, ToHost, camera_id,
};
use camrig_rig_link::registers::{MODEL_ID, UNITY_GAIN_CODE, address};
use camrig_sensor_core::config::FrameSettings;
use camrig_sensor_core::hdr::{Output, Readout};
use rayon::prelude::*;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::time::{Duration, Instant};

/// Number of times that a frame is resumed after the link broke. A trade-off: a touched cable
/// recovers, and a link that breaks in every frame is reported soon.
const RECONNECTS: u32 = 3;
/// Attempts to reopen a link, and the wait before each: 2 s in all, enough for a server to notice
/// that its host has gone and for a USB device to be enumerated again.
const REOPEN_TRIES: u32 = 10;
const REOPEN_WAIT: Duration = Duration::from_millis(200);
/// No attempt begins later than this after the link broke: with a rig that opens but does not
/// answer, each takes some time.
const REOPEN_PATIENCE: Duration = Duration::from_secs(20);
/// Sample widths of raw rows that the link packs, bits (MIPI CSI-2 RAW8 to RAW24).
const RAW_BITS: [u8; 7] = [8, 10, 12, 14, 16, 20, 24];
/// Registers that inject a fault or a test pattern, and their names.
const INJECTING: [(u16, &str); 2] =
    [(address::FAULT, "fault"), (address::TEST_PATTERN, "test pattern")];

/// Request for a frame. [`FrameRequest::new`] makes one with the defaults.
#[derive(Clone, Copy, Debug)]
pub struct FrameRequest {
    /// Frame number, exposure, gain, temperature.
    pub settings: FrameSettings,
    /// Arithmetic of the rig's sensor; `f32` by default.
    pub arithmetic: Arithmetic,
    /// Integrate the bands on the host and send mean electrons: fewer bytes, at the cost of the
    /// last bit of accuracy.
    pub collapse: bool,
    /// The sensor saw the same light in the previous frame, for the exposure that `settings` name
    /// as the previous one.
    pub lit_before: bool,
    /// Use exposure and gain from the rig's registers.
    pub by_registers: bool,
    /// Do not return the raw rows: the rig sends them out through its own raw output.
    pub rows_stay: bool,
}

impl FrameRequest {
    /// A frame with these settings, computed in `f32` from the bands of its light.
    pub const fn new(settings: FrameSettings) -> Self {
        Self {
            settings,
            arithmetic: Arithmetic::F32,
            collapse: false,
            lit_before: false,
            by_registers: false,
            rows_stay: false,
        }
    }
}

/// A frame from a rig.
#[derive(Clone, Debug)]
pub struct RigFrame {
    /// The rig's announcement of the frame: counter, exposure, gain, seed, fault.
    pub start: FrameStart,
    /// Packed raw rows, one after the other; empty if the rig sent them out itself.
    pub packed: Vec<u8>,
    /// CRC-32C of each row that the rig sent out through its own raw output.
    pub receipts: Option<Vec<u32>>,
    /// How a row lies in bytes.
    pub raw_row: RawRow,
    /// The frame was dropped, as requested in the rig's fault register: there are no rows.
    pub dropped: bool,
    /// What happens to its packets where it is written as CSI-2.
    pub damage: Vec<csi2::Damage>,
    /// Exposure in lines, if it came from the registers of a rig with a line time.
    pub lines: Option<u16>,
    /// Registers that were restored, because the rig had other values after its link broke: it
    /// restarted, or another host wrote them. In words.
    pub restored: Option<String>,
}

/// A caller's callback for faults.
type Listener = Box<dyn FnMut(&Error) + Send>;

/// An open rig.
pub struct Rig {
    url: Url,
    /// `None` while a broken link is being reopened.
    transport: Option<Box<dyn Transport>>,
    host: Host<Vec<u16>>,
    camera: Vec<u8>,
    since: Instant,
    /// Called when a link breaks, before it is reopened.
    link_broken: Option<Listener>,
    /// Values of its registers, once a frame by registers was requested.
    held: Option<Held>,
}

fn open(url: &Url) -> Result<Box<dyn Transport>> {
    match url {
        Url::Emulator => Ok(emulator::open()),
        Url::Tcp { address, token } => tcp::open(address, token.as_ref()),
        #[cfg(feature = "serial")]
        Url::Serial { path, baud } => serial::open(path, *baud),
        #[cfg(feature = "hid")]
        Url::Hid { vid, pid, serial } => hid::open(*vid, *pid, serial.as_deref()),
        #[cfg(not(all(feature = "serial", feature = "hid")))]
        _ => Err(Error::unsupported("this program was built without links of this kind")
            .at(url)
            .help("switch on the features `hid` and `serial` of camrig-rig, or use tcp://")),
    }
}

/// A random session number, which distinguishes packets of an earlier session. Results do not
/// depend on it.
fn session() -> u16 {
    RandomState::new().build_hasher().finish() as u16
}

impl Rig {
    /// Opens the rig at an address and begins a session.
    ///
    /// # Errors
    /// Text that is not an address ([`Url::parse`]), a link that cannot be opened, a rig that does
    /// not answer or speaks other versions of the protocol.
    pub fn open(url: &str) -> Result<Self> {
        let url = Url::parse(url)?;
        let transport = open(&url)?;
        Self::with_transport(url, transport)
    }

    /// Begins a session with the rig at the other end of an open link.
    ///
    /// # Errors
    /// A rig that does not answer or speaks other versions of the protocol.
    pub fn with_transport(url: Url, transport: Box<dyn Transport>) -> Result<Self> {
        let host = Host::new(transport.limits(), Vec::new());
        let mut rig = Self {
            url,
            transport: Some(transport),
            host,
            camera: Vec::new(),
            since: Instant::now(),
            link_broken: None,
            held: None,
        };
        rig.connect()?;
        Ok(rig)
    }

    /// Calls `tell` with the fault whenever the link breaks in a frame, before it is reopened and
    /// the frame is resumed.
    pub fn on_broken_link(&mut self, tell: impl FnMut(&Error) + Send + 'static) {
        self.link_broken = Some(Box::new(tell));
    }

    /// The rig's capabilities.
    pub fn device(&self) -> Capabilities {
        self.host.device().cloned().unwrap_or_default()
    }

    /// Counters of this end of the link.
    pub fn statistics(&self) -> HostStatistics {
        self.host.statistics()
    }

    /// Bytes over the link, framing included: sent and received.
    pub fn link_bytes(&self) -> (u64, u64) {
        self.transport.as_ref().map_or((0, 0), |t| t.bytes())
    }

    /// Asks the rig for its counters.
    ///
    /// # Errors
    /// A link that fails, a rig that does not answer.
    pub fn device_statistics(&mut self) -> Result<Statistics> {
        match self.request(ToDevice::Statistics)? {
            ToHost::Statistics(s) => Ok(s),
            other => Err(self.unexpected(other)),
        }
    }

    /// Reads a register.
    ///
    /// # Errors
    /// A register that the rig does not have, a link that fails.
    pub fn read_register(&mut self, address: u16) -> Result<u32> {
        match self.request(ToDevice::RegRead(address))? {
            ToHost::Register(_, value) => Ok(value),
            other => Err(self.unexpected(other)),
        }
    }

    /// Writes a register. The rig's sensor decides with which frame it takes effect.
    ///
    /// # Errors
    /// A register or a value that the rig refuses, a link that fails.
    pub fn write_register(&mut self, address: u16, value: u32) -> Result<()> {
        let held = self.held.take();
        self.request(ToDevice::RegWrite(address, value))?;
        self.held = held.and_then(|mut held| held.write(address, value).then_some(held));
        Ok(())
    }

    /// Reads the byte at an address: registers are their bytes, high byte first (MIPI CCS).
    ///
    /// # Errors
    /// An address without a register, a firmware without access by bytes, a link that fails.
    pub fn read_byte(&mut self, address: u16) -> Result<u8> {
        match self.request(ToDevice::ByteRead(address))? {
            ToHost::Register(_, value) => Ok(value as u8),
            other => Err(self.unexpected(other)),
        }
    }

    /// Writes the byte at an address. If the register accepts no value with this byte alone, it
    /// takes effect with the register's last byte.
    ///
    /// # Errors
    /// Those of [`Rig::read_byte`], a value that the register refuses.
    pub fn write_byte(&mut self, address: u16, value: u8) -> Result<()> {
        self.held = None;
        self.request(ToDevice::ByteWrite(address, value)).map(drop)
    }

    /// Reads a register; `None` if the rig has none at this address.
    ///
    /// # Errors
    /// A link that fails.
    pub fn register_if_there(&mut self, address: u16) -> Result<Option<u32>> {
        self.host.request(ToDevice::RegRead(address));
        match self.run(&mut None)? {
            Event::Answer(ToHost::Register(_, value)) => Ok(Some(value)),
            Event::Answer(other) => Err(self.unexpected(other)),
            Event::Refused(Nack::Register(_)) => Ok(None),
            event => Err(self.failed(event)),
        }
    }

    /// What the rig's fault and test-pattern registers do to the frames that follow, in words;
    /// `None` for nothing. Registers outlast the host that wrote them.
    ///
    /// # Errors
    /// A link that fails.
    pub fn injected(&mut self) -> Result<Option<String>> {
        let mut said = Vec::new();
        for (address, what) in INJECTING {
            let value = self.register_if_there(address)?.unwrap_or(0);
            if value != 0 {
                said.push(format!("{what} {value} (register {address:#06x})"));
            }
        }
        Ok((!said.is_empty()).then(|| said.join(" and ")))
    }

    /// Clears the rig's fault and test-pattern registers, and returns what they held.
    ///
    /// # Errors
    /// A link that fails.
    pub fn clear_injected(&mut self) -> Result<Option<String>> {
        let held = self.injected()?;
        for (address, _) in INJECTING.iter().filter(|_| held.is_some()) {
            if self.register_if_there(*address)?.is_some_and(|value| value != 0) {
                self.write_register(*address, 0)?;
            }
        }
        Ok(held)
    }

    /// Tells the rig that this host is still there: a server drops a host that has been silent for
    /// [`crate::serve::GIVEN_UP_AFTER`] when another one connects.
    ///
    /// # Errors
    /// A link that fails, a rig that does not answer.
    pub fn keep_alive(&mut self) -> Result<()> {
        self.device_statistics().map(drop)
    }

    /// Values of the registers that decide frames, read once.
    fn held(&mut self) -> Result<Held> {
        let held = match self.held.take() {
            Some(held) => held,
            None => Held::read(self)?,
        };
        self.held = Some(held.clone());
        Ok(held)
    }

    /// Sends the sensor to the rig, unless the rig has it already.
    ///
    /// # Errors
    /// A sensor whose rows, bands or tables are too large for the rig, effects that its firmware
    /// lacks, a link that fails.
    pub fn set_camera(&mut self, sensor: &SimulatedSensor) -> Result<()> {
        self.set_sensor(&OnLink::one(sensor))
    }

    /// Sends a sensor of several captures to the rig, which merges and compands them.
    ///
    /// # Errors
    /// Those of [`Rig::set_camera`]; a rig without the firmware or the memory for so many captures.
    pub fn set_captures(&mut self, sensor: &HdrSensor) -> Result<()> {
        if self.device().codecs & SEVERAL_CAPTURES == 0 {
            return Err(Error::unsupported("a sensor of several captures on this rig")
                .at(&self.url)
                .help(format!(
                    "update its firmware, or give it memory for them; or choose a capture: {}",
                    sensor.hdr().names()
                )));
        }
        self.set_sensor(&OnLink::several(sensor))
    }

    fn set_sensor(&mut self, sensor: &OnLink<'_>) -> Result<()> {
        if sensor.captures.iter().any(|capture| capture.effects_with_traps() > 0) {
            return Err(Error::unsupported(
                "persistence on a rig, which has no memory for the charge of all pixels",
            )
            .at(&self.url)
            .help(
                "expose these frames in this process, or remove the effect from the camera file",
            ));
        }
        self.camera = sensor
            .encoded()
            .ok_or_else(|| Error::limit("the camera is too large for the link"))?;
        let device = self.device();
        let effects = sensor.captures.iter().flat_map(|capture| &capture.config.effects);
        let mut lacking: Vec<&str> = effects
            .map(|effect| effect.entry())
            .filter(|entry| !device.effects.contains(entry.id))
            .map(|entry| entry.kind)
            .collect();
        lacking.dedup();
        if !lacking.is_empty() {
            let what =
                format!("the rig's firmware lacks effects of the camera: {}", lacking.join(", "));
            return Err(Error::unsupported(what).at(&self.url).help(
                "remove them from the camera file, or use the rig's firmware with all effects \
                 (feature `catalogue`)",
            ));
        }
        let config = &sensor.captures[0].config;
        let (width, bands) = (config.width, u16::from(config.bands));
        if width > u32::from(device.max_width) {
            return Err(self.refused(Nack::Refused(Refusal::TooWide { max: device.max_width })));
        }
        if bands > device.max_bands {
            let max = device.max_bands;
            return Err(self.refused(Nack::Refused(Refusal::TooManyBands { max })));
        }
        self.send_camera()
    }

    fn send_camera(&mut self) -> Result<()> {
        let id = camera_id(&self.camera);
        if self.host.device().is_some_and(|d| d.camera == id) {
            return Ok(());
        }
        self.host.send_camera(id, self.camera.len() as u32);
        match self.run(&mut None)? {
            Event::CameraReady => Ok(()),
            event => Err(self.failed(event)),
        }
    }

    /// Exposes one frame to a cube.
    ///
    /// # Errors
    /// Those of [`Rig::frame_from`].
    pub fn frame(
        &mut self,
        cube: &IrradianceCube,
        sensor: &SimulatedSensor,
        request: &FrameRequest,
    ) -> Result<RigFrame> {
        let mut feed =
            if request.collapse { Feed::collapsed(cube, sensor) } else { Feed::spectral(cube) };
        self.frame_from(&mut feed, sensor, request)
    }

    /// Exposes one frame of a sensor of several captures to a cube that all of them see, or to one of
    /// each.
    ///
    /// # Errors
    /// Those of [`Rig::frame_from`]; windows of a photodiode that overlap at this exposure.
    pub fn frame_of_captures(
        &mut self,
        cubes: &[&IrradianceCube],
        sensor: &HdrSensor,
        request: &FrameRequest,
    ) -> Result<RigFrame> {
        sensor.hdr().check_exposure(request.settings.exposure_s.into())?;
        let mut feed = Feed::of_captures(cubes.to_vec());
        self.frame_of(&mut feed, &OnLink::several(sensor), request)
    }

    /// Exposes one frame to the light of a feed, which decides whether bands are collapsed. A
    /// broken link is reopened and the frame resumed where it was. If the rig's registers decide
    /// and have changed meanwhile, their previous values are restored.
    ///
    /// # Errors
    /// A frame too large for the link, a cube that cannot be read, settings that the rig refuses,
    /// a link that fails too often.
    pub fn frame_from(
        &mut self,
        feed: &mut Feed<'_>,
        sensor: &SimulatedSensor,
        request: &FrameRequest,
    ) -> Result<RigFrame> {
        self.frame_of(feed, &OnLink::one(sensor), request)
    }

    fn frame_of(
        &mut self,
        feed: &mut Feed<'_>,
        sensor: &OnLink<'_>,
        request: &FrameRequest,
    ) -> Result<RigFrame> {
        let (begin, shape, raw_row) = announcement(sensor, feed, request)?;
        feed.for_codecs(self.device().codecs);
        let held = if request.by_registers { Some(self.held()?) } else { None };
        let line_ns = held.as_ref().and_then(Held::line_ns);
        let raw_bytes = usize::from(shape.raw_bytes);
        self.host.reserve_rows(|rows| rows.resize(rows.len().max(shape.rows.into()), 0));
        let packed = vec![0; raw_bytes * usize::from(shape.rows)];
        let mut transfer = Some(Transfer { feed, packed, raw_bytes, error: None });
        let (mut breaks, mut restored) = (0, None);
        loop {
            self.host.begin(begin, shape, breaks > 0);
            let outcome = self.run(&mut transfer);
            if let Some(error) = transfer.as_mut().and_then(|t| t.error.take()) {
                return Err(error);
            }
            let broken = match outcome {
                Ok(Event::FrameDone(start)) | Ok(Event::FrameDropped(start)) => {
                    if let Fault::LateFrame(ms) = start.fault {
                        std::thread::sleep(Duration::from_millis(ms.into()));
                    }
                    let dropped = matches!(outcome, Ok(Event::FrameDropped(_)));
                    let packed = transfer.map(|t| t.packed).filter(|_| !dropped);
                    let mut packed = packed.unwrap_or_default();
                    let receipts =
                        request.rows_stay.then(|| receipts(&std::mem::take(&mut packed)));
                    sensor.check_seed(start.seed).map_err(|e| e.at(&self.url))?;
                    if request.by_registers {
                        let used = request.settings.with_gain(start.exposure.analog_gain);
                        sensor.check_scale(request.arithmetic, &used).map_err(|e| {
                            e.at(format!("{}, register {:#06x}", self.url, address::ANALOG_GAIN))
                        })?;
                    }
                    let exposure_s = f64::from(start.exposure.exposure_s);
                    let lines = line_ns.and_then(|ns| whole_lines(exposure_s, ns));
                    return Ok(RigFrame {
                        start,
                        packed,
                        receipts,
                        raw_row,
                        dropped,
                        damage: Vec::new(),
                        lines,
                        restored,
                    });
                }
                Ok(event @ (Event::NoAnswer | Event::Refused(Nack::NoSession))) => {
                    self.failed(event)
                }
                Ok(Event::Refused(Nack::Refused(Refusal::Packing))) if request.rows_stay => {
                    return Err(Error::unsupported("this rig has no raw output of its own")
                        .at(&self.url)
                        .help("return the rows over the link"));
                }
                Ok(event) => return Err(self.failed(event)),
                Err(error) => error,
            };
            breaks += 1;
            if breaks > RECONNECTS || self.url == Url::Emulator {
                return Err(broken);
            }
            if let Some(tell) = &mut self.link_broken {
                tell(&broken);
            }
            self.reopen()?;
            self.send_camera()?;
            if let Some(held) = &held {
                restored = held.restore(self)?;
            }
        }
    }

    /// Closes the link and reopens it, as soon as the other end has released it.
    fn reopen(&mut self) -> Result<()> {
        self.transport = None;
        let began = Instant::now();
        let mut tries = 0..REOPEN_TRIES;
        loop {
            std::thread::sleep(REOPEN_WAIT);
            let outcome = open(&self.url).and_then(|transport| {
                self.transport = Some(transport);
                self.connect()
            });
            let over = tries.next().is_none() || began.elapsed() >= REOPEN_PATIENCE;
            if outcome.is_ok() || over {
                return outcome;
            }
            self.transport = None;
        }
    }

    fn connect(&mut self) -> Result<()> {
        self.host.connect(session());
        match self.run(&mut None)? {
            Event::Connected => Ok(()),
            event => Err(self.failed(event)),
        }
    }

    fn request(&mut self, message: ToDevice) -> Result<ToHost> {
        self.host.request(message);
        match self.run(&mut None)? {
            Event::Answer(answer) => Ok(answer),
            event => Err(self.failed(event)),
        }
    }

    /// Runs the host's operation to its end.
    fn run(&mut self, transfer: &mut Option<Transfer<'_, '_>>) -> Result<Event> {
        let transport = (self.transport.as_mut())
            .ok_or_else(|| Error::device("the link is closed").at(&self.url))?;
        loop {
            let now = self.since.elapsed().as_micros() as u64 + 1;
            let mut io = Io { transfer, camera: &self.camera };
            let wait = match self.host.poll(now, &mut io, transport.room()?) {
                Poll::Done(event) => return Ok(event),
                Poll::Send(bytes) => {
                    transport.send(bytes)?;
                    Duration::ZERO
                }
                Poll::Wait(until) => {
                    transport.flush()?;
                    Duration::from_micros(until.saturating_sub(now))
                }
            };
            if transport.receive(wait)? {
                let now = self.since.elapsed().as_micros() as u64 + 1;
                if let Some(event) = self.host.receive(now, transport.packet(), &mut io) {
                    return Ok(event);
                }
            }
        }
    }

    fn unexpected(&self, answer: ToHost) -> Error {
        Error::disagreement(format!("unexpected answer of the rig: {answer:?}")).at(&self.url)
    }

    fn failed(&self, event: Event) -> Error {
        let error = match event {
            Event::Refused(nack) => return self.refused(nack),
            Event::NoCommonVersion { oldest, newest } => {
                let (ours_oldest, ours) = camrig_rig_link::message::VERSIONS;
                let advice = if newest < ours_oldest {
                    "update the rig's firmware"
                } else {
                    "update camrig"
                };
                Error::disagreement(format!(
                    "the rig supports versions {oldest} to {newest} of the protocol, camrig \
                     {ours_oldest} to {ours}"
                ))
                .help(advice)
            }
            Event::UnusableHello => Error::disagreement(
                "the rig's answer to the Hello cannot be used: it cannot be read, or states limits \
                 or a version that no rig can have",
            )
            .help("check the rig's firmware against docs/protocol.md, section 4"),
            Event::NoProgress => Error::device(
                "the link loses too many packets to complete a frame",
            )
            .help(
                "use a shorter cable or a lower baud rate, or close other programs on this port",
            ),
            _ => Error::device("no answer from the rig")
                .help("is it switched on, and is this its address?")
                .with_code(ErrorCode::RigNotFound),
        };
        error.at(&self.url)
    }

    fn refused(&self, nack: Nack) -> Error {
        let (what, help) = match nack {
            Nack::Refused(Refusal::TooWide { max }) => (
                format!(
                    "the camera's rows are too long for this rig, which supports {max} pixels"
                ),
                "use a camera with fewer columns, or a rig with more memory",
            ),
            Nack::Refused(Refusal::TooManyBands { max }) => (
                format!("too many spectral bands for this rig, which supports {max}"),
                "use irradiance with fewer bands",
            ),
            Nack::Refused(Refusal::CameraTooLong { max }) => (
                format!("the camera is too large for this rig, which supports {max} bytes"),
                "use a coarser crosstalk table, or a rig with more memory",
            ),
            Nack::Refused(Refusal::Arithmetic) => {
                ("this rig does not support the arithmetic".into(), "choose the other one")
            }
            Nack::Refused(Refusal::Effects) => (
                "the camera's effects need more rows than the rig has memory for".into(),
                "remove effects that read neighbouring rows, or use a rig with more memory",
            ),
            Nack::Refused(Refusal::Captures { max }) => (
                format!("the camera has too many captures for this rig, which takes {max}"),
                "choose one capture, or use a rig with more memory",
            ),
            Nack::Refused(Refusal::BadCamera) => (
                format!("the rig refuses: {}", Refusal::BadCamera),
                "use firmware as new as this program; mosaics of more than four channels need its \
                 feature `multispectral`",
            ),
            Nack::Refused(refusal) => {
                (format!("the rig refuses: {refusal}"), "check the camera and the settings")
            }
            Nack::Register(address) => (
                format!("the rig refuses this value for register {address:#06x}, or lacks it"),
                "check the address and the value",
            ),
            nack => (format!("the rig refuses: {nack}"), "try again; it may have been reset"),
        };
        let error = match nack {
            Nack::Refused(Refusal::Arithmetic) => {
                Error::unsupported(what).with_code(ErrorCode::RigArithmetic)
            }
            Nack::Refused(Refusal::Effects) => Error::unsupported(what),
            Nack::Refused(
                Refusal::TooWide { .. }
                | Refusal::TooManyBands { .. }
                | Refusal::CameraTooLong { .. }
                | Refusal::Captures { .. },
            ) => Error::limit(what),
            Nack::Refused(_) => Error::input(what),
            Nack::Register(_) => Error::input(what).with_code(ErrorCode::RigRegister),
            _ => Error::disagreement(what),
        };
        error.at(&self.url).help(help)
    }
}

/// Receipts as they came over the link.
fn receipts(bytes: &[u8]) -> Vec<u32> {
    bytes.as_chunks().0.iter().map(|receipt| u32::from_le_bytes(*receipt)).collect()
}

/// A sensor as a rig takes it.
struct OnLink<'s> {
    captures: Vec<&'s SimulatedSensor>,
    readout: Option<&'s Readout>,
}

impl<'s> OnLink<'s> {
    fn one(sensor: &'s SimulatedSensor) -> Self {
        Self { captures: vec![sensor], readout: None }
    }

    fn several(sensor: &'s HdrSensor) -> Self {
        Self { captures: sensor.captures().iter().collect(), readout: Some(sensor.readout()) }
    }

    /// Refuses a frame of another sensor.
    fn check_seed(&self, used: u64) -> Result<()> {
        let seed = self.captures[0].config.seed;
        if used == seed {
            return Ok(());
        }
        Err(Error::disagreement(format!(
            "the rig took the frame with seed {used}, the camera's is {seed}"
        ))
        .help("another host changed the rig's camera, or its firmware leaves out the seed"))
    }

    /// Refuses settings at which the arithmetic is not right to one DN in each capture.
    fn check_scale(&self, arithmetic: Arithmetic, settings: &FrameSettings) -> Result<()> {
        for (i, capture) in self.captures.iter().enumerate() {
            let ratios = self.readout.and_then(|readout| readout.ratios.get(i));
            let own = ratios.map_or(*settings, |ratios| ratios.settings(settings));
            arithmetic.check(&capture.config, &own)?;
        }
        Ok(())
    }

    /// Its bytes on the link.
    fn encoded(&self) -> Option<Vec<u8>> {
        let captures = self
            .captures
            .iter()
            .map(|sensor| Capture { config: &sensor.config, crosstalk: sensor.crosstalk() });
        let words = |capture: Capture<'_>| {
            let crosstalk = capture.crosstalk;
            let table = crosstalk
                .map_or(0, |c| c.x.len() + c.y.len() + c.wavelength_nm.len() + c.factors.len());
            table + capture.config.table.len()
        };
        let words: usize = captures.clone().map(words).sum();
        let mut bytes = vec![0; 2 * camera::CONFIG_BYTES * (1 + self.captures.len()) + 4 * words];
        let n = match (self.readout, &self.captures[..]) {
            (None, [one]) => camera::encode(&one.config, one.crosstalk(), &mut bytes),
            (readout, _) => camera::encode_captures(readout?, captures, &mut bytes),
        }?;
        bytes.truncate(n);
        Some(bytes)
    }
}

/// The host's announcement of a frame, the sizes on the link that follow from it, and how raw rows
/// lie in bytes.
fn announcement(
    sensor: &OnLink<'_>,
    feed: &Feed<'_>,
    request: &FrameRequest,
) -> Result<(FrameBegin, FrameShape, RawRow)> {
    let captures = sensor.captures.iter().map(|sensor| &sensor.config).collect();
    let on_device = device::Sensor { captures, readout: sensor.readout };
    let config = &sensor.captures[0].config;
    let too_large = || {
        Error::limit(format!(
            "a frame of {} x {} pixels in {} bands is too large for the link",
            config.width,
            config.height,
            feed.bands()
        ))
        .help("send fewer bands, or mean electrons")
        .with_code(ErrorCode::FrameTooLarge)
    };
    let bits = RAW_BITS.into_iter().find(|&bits| on_device.raw_row(bits).is_some());
    let raw_bits = bits.ok_or_else(too_large)?;
    let raw_row = on_device.raw_row(raw_bits).ok_or_else(too_large)?;
    let bands = u16::try_from(feed.bands()).map_err(|_| too_large())?;
    let mut shape = on_device.frame_shape(bands, raw_bits).ok_or_else(too_large)?;
    if request.rows_stay {
        shape.raw_bytes = RECEIPT_BYTES as u16;
    }
    if !request.by_registers {
        sensor.check_scale(request.arithmetic, &request.settings)?;
    }
    let begin = FrameBegin {
        transfer: 0,
        frame: request.settings.frame,
        rows: shape.rows,
        width: config.width as u16, // frame_shape has a unit count, so the width is small
        bands,
        codec: feed.codec(),
        arithmetic: match request.arithmetic {
            Arithmetic::F32 => NumberFormat::F32,
            Arithmetic::Fixed => NumberFormat::Fixed,
        },
        raw_bits: if request.rows_stay { 0 } else { raw_bits },
        temperature_c: request.settings.temperature_c,
        before: before(sensor, request),
        exposure: (!request.by_registers).then_some(Exposure {
            exposure_s: request.settings.exposure_s,
            analog_gain: request.settings.analog_gain,
        }),
    };
    Ok((begin, shape, raw_row))
}

/// What the rig is told of the previous frame. Its exposure only where the sensor remembers it and
/// it may differ from this one's: older rigs do not take it.
fn before(sensor: &OnLink<'_>, request: &FrameRequest) -> Before {
    let FrameSettings { exposure_s, previous_exposure_s, .. } = request.settings;
    let remembers = || sensor.captures.iter().any(|one| remembering(one).next().is_some());
    match previous_exposure_s {
        _ if !request.lit_before => Before::Dark,
        Some(previous) if (request.by_registers || previous != exposure_s) && remembers() => {
            Before::LitFor { exposure_s: previous }
        }
        _ => Before::Lit,
    }
}

/// An exposure, s, in the nearest whole number of lines, if it fits into the exposure register.
/// Exact for exposures that a rig reports from its registers: f32 has 24 bits, the number 16.
pub(super) fn whole_lines(exposure_s: f64, line_ns: u32) -> Option<u16> {
    let lines = (exposure_s / (f64::from(line_ns) * 1e-9)).round();
    (1.0..=f64::from(u16::MAX)).contains(&lines).then_some(lines as u16)
}

impl RigFrame {
    /// The frame's embedded data line (CCS tagged data) with its settings.
    /// The settings are at the addresses of [`csi2::address`], the registers that CCS has at their
    /// own; exposure in lines and gain code are among them if registers decided.
    pub fn embedded_line(&self) -> Vec<u8> {
        let start = &self.start;
        let Exposure { exposure_s, analog_gain, .. } = start.exposure;
        let mut line = Embedded::of_frame(exposure_s, analog_gain, start.frame);
        line.put(address::MODEL_ID, &MODEL_ID.to_be_bytes());
        line.put(address::FRAME_COUNT, &[start.counter as u8]); // CCS counts in 8 bits
        if let Some(lines) = self.lines {
            let code = (analog_gain * f32::from(UNITY_GAIN_CODE)) as u16; // exact
            line.put(address::COARSE_INTEGRATION_TIME, &lines.to_be_bytes());
            line.put(address::ANALOG_GAIN, &code.to_be_bytes());
        }
        line.put(address::TEST_PATTERN, &start.test_pattern.to_be_bytes());
        line.put(csi2::address::SEED, &start.seed.to_be_bytes());
        line.line(self.raw_row.packing.bits())
    }

    /// What the rig did to the samples on request, in words: a fault or a test pattern.
    pub fn injected(&self) -> Option<String> {
        match (self.start.fault, self.start.test_pattern) {
            _ if self.dropped => Some("it was dropped".into()),
            (Fault::CorruptRow(row), _) => Some(format!("row {row} is corrupt")),
            (_, 0) => None,
            (_, pattern) => Some(format!("it is test pattern {pattern}")),
        }
    }

    /// Unpacks the frame into digital numbers.
    ///
    /// # Errors
    /// A dropped frame, which has no rows; one whose rows the rig sent out itself.
    pub fn to_raw(&self, sensor: &SimulatedSensor) -> Result<RawFrame> {
        let data = self.samples(sensor.config.width as usize, sensor.config.height as usize)?;
        Ok(sensor.raw_frame(data, self.start.exposure.analog_gain))
    }

    /// Unpacks what a sensor of several captures has sent.
    ///
    /// # Errors
    /// Those of [`Self::to_raw`].
    pub fn to_sent(&self, sensor: &HdrSensor) -> Result<Sent> {
        let config = &sensor.captures()[0].config;
        let width = config.width as usize;
        let in_row = width * self.raw_row.rows * if self.raw_row.halves { 2 } else { 1 };
        let samples = self.samples(in_row, config.height as usize)?;
        let samples = if self.raw_row.halves {
            let half = self.raw_row.packing.bits();
            let (pairs, _) = samples.as_chunks();
            Samples::Wide(
                pairs.iter().map(|&[a, b]| u32::from(a) << half | u32::from(b)).collect(),
            )
        } else if sensor.readout().output == Output::Captures {
            let of = |capture: usize| {
                let rows = samples.chunks(in_row);
                rows.flat_map(|row| &row[capture * width..][..width]).copied().collect()
            };
            Samples::Captures((0..self.raw_row.rows).map(of).collect())
        } else {
            Samples::Merged(samples)
        };
        Ok(sensor.described(samples, self.start.exposure.analog_gain))
    }

    /// The samples of all rows, so many in each.
    fn samples(&self, in_row: usize, height: usize) -> Result<Vec<u16>> {
        if self.dropped {
            let what = format!("the rig dropped frame {}, as requested", self.start.frame);
            return Err(Error::disagreement(what)
                .help("write 0 to its fault register 0x3100, and 1 to 0x0100"));
        }
        if self.receipts.is_some() {
            let what = format!("the rows of frame {} were not returned", self.start.frame);
            return Err(Error::input(what)
                .at("the rig")
                .help("take them from the rig's own raw output, or request them"));
        }
        let mut data = vec![0; in_row * height];
        let rows = self.packed.par_chunks((self.packed.len() / height.max(1)).max(1));
        data.par_chunks_mut(in_row).zip(rows).try_for_each(|(row, packed)| {
            self.raw_row
                .unpack(packed, row)
                .map_err(|e| Error::internal(format!("a raw row of {} bytes", e.found)))
        })?;
        Ok(data)
    }
}

/// A frame in progress.
struct Transfer<'a, 'c> {
    feed: &'a mut Feed<'c>,
    packed: Vec<u8>,
    raw_bytes: usize,
    /// Why the cube could not be read.
    error: Option<Error>,
}

/// Input and output of the protocol.
struct Io<'a, 'f, 'c> {
    transfer: &'a mut Option<Transfer<'f, 'c>>,
    camera: &'a [u8],
}

impl FrameIo for Io<'_, '_, '_> {
    fn spectral(&mut self, row: u16, first: u16, out: &mut [u8]) {
        if let Some(t) = self.transfer
            && let Err(error) = t.feed.units(row.into(), first.into(), out)
        {
            out.fill(0);
            t.error.get_or_insert(error);
        }
    }

    fn raw_row(&mut self, row: u16) -> &mut [u8] {
        match self.transfer {
            Some(t) => {
                let start = usize::from(row) * t.raw_bytes;
                &mut t.packed[start..start + t.raw_bytes]
            }
            None => &mut [],
        }
    }

    fn camera(&mut self, offset: u32, out: &mut [u8]) {
        let start = offset as usize;
        out.copy_from_slice(&self.camera[start..start + out.len()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_base::Bands;
    use camrig_camera::Camera;
    use camrig_exposure::CubeHeader;

    /// The capture of 1.5 DN per electron is right in fixed point up to a gain of 42.67, however
    /// the gain comes.
    #[test]
    fn fixed_point_ends_at_64_dn_per_electron_by_registers_too() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("camera.toml");
        std::fs::write(&path, camrig_testing::hdr::camera("dcg2", [16, 2], "captures")).unwrap();
        let camera = Camera::load(path.to_str().unwrap()).unwrap();
        let bands = Bands { start_nm: 500.0, step_nm: 10.0, count: 3 };
        let header = CubeHeader::new((16, 2), &bands, "darkness");
        let dark = IrradianceCube::uniform(header.clone(), &[0.0; 3]).unwrap();
        let sensor = HdrSensor::in_light(&camera, &header, 1.0).unwrap();
        let mut rig = Rig::open("emulator:").unwrap();
        rig.set_captures(&sensor).unwrap();
        let mut frame = |gain: f64, by_registers: bool, arithmetic: Arithmetic| {
            let code = (gain * f64::from(UNITY_GAIN_CODE)) as u32;
            rig.write_register(address::ANALOG_GAIN, code).unwrap();
            // The gain of the settings is that of no frame by registers.
            let own = if by_registers { 100.0 } else { gain };
            let settings = camera.settings(0, 0.01, Some(own));
            let request = FrameRequest { by_registers, arithmetic, ..FrameRequest::new(settings) };
            rig.frame_of_captures(&[&dark], &sensor, &request)
        };
        for (by_registers, place) in
            [(false, "analog_gain = 43"), (true, "emulator:, register 0x0204, analog_gain = 43")]
        {
            frame(42.5, by_registers, Arithmetic::Fixed).unwrap();
            frame(43.0, by_registers, Arithmetic::F32).unwrap();
            let error = frame(43.0, by_registers, Arithmetic::Fixed).err().unwrap();
            assert_eq!(error.what(), "64.5 DN per electron in fixed point");
            assert_eq!(error.place(), Some(place));
        }
    }
}
