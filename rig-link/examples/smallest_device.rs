//! The smallest device: a camera whose raw samples are the light it is sent, and the host that
//! asks it for a frame. Both ends run in one process, and packets go from one to the other in
//! memory. A second frame leaves by the device's own interface, as on a board that feeds an image
//! signal processor, and the host gets receipts.
//!
//! A real device keeps `Smallest` and `Device` as they are; instead of the loop in `run` it reads
//! bytes from a port, puts packets together with `framing::Receiver`, and writes the answers with
//! `framing::Sender`. Neither end allocates, reads a clock or knows the port.
//!
//! ```text
//! cargo run -p camrig-rig-link --example smallest_device
//! ```

use camrig_rig_link::device::{Begun, Device, Model, RowSink};
use camrig_rig_link::host::{Event, FrameIo, Host, Limits, Poll};
use camrig_rig_link::message::*;
use camrig_rig_link::packing::{Packing, pack_row, unpack_row};
use camrig_rig_link::registers::Registers;
use camrig_rig_link::wire::crc32c;

/// Pixels in a row: one unit of the row codec.
const WIDTH: usize = 16;
/// Rows.
const ROWS: usize = 4;
/// Bytes of a unit: the exponent that 16 pixels share, and their 16-bit mantissas.
const UNIT_BYTES: usize = 1 + 2 * WIDTH;
/// Bytes of a raw row of 12 bits per sample.
const RAW_BYTES: usize = Packing::Raw12.row_bytes(WIDTH);
/// Longest packet of either end, bytes.
const PACKET_BYTES: usize = 256;
/// DN per mean photo-electron.
const DN_PER_E: f32 = 1.0;

/// Sizes on the link that host and device must agree on.
const SHAPE: FrameShape = FrameShape {
    rows: ROWS as u16,
    units: 1,
    unit_bytes: UNIT_BYTES as u16,
    raw_bytes: RAW_BYTES as u16,
    halo: 0, // A raw row depends on its own spectral row only.
};

/// The device's model: one row of electrons, no noise.
struct Smallest {
    exposure_s: f32,
    row_e: [f32; WIDTH],
    interface: Interface,
}

/// The device's own way out. On a board it starts a DMA to a camera interface or an FPGA; here it
/// counts the rows and keeps the CRC of each.
#[derive(Default)]
struct Interface {
    rows: usize,
    crcs: [u32; ROWS],
}

impl RowSink for Interface {
    fn raw_bits(&self) -> u8 {
        12
    }

    fn begin(&mut self, _start: &FrameStart, _row_bytes: u16) {
        *self = Self::default();
    }

    fn row(&mut self, row: u16, packed: &[u8]) {
        self.rows += 1;
        self.crcs[usize::from(row)] = crc32c(packed);
    }
}

impl Model for Smallest {
    fn capabilities(&self) -> Capabilities {
        Capabilities {
            firmware: "smallest 1.0".try_into().unwrap_or_default(),
            max_width: WIDTH as u16,
            max_bands: 1,
            max_camera: 64,
            arithmetics: 1 << NumberFormat::F32 as u8,
            codecs: 1 << Codec::Electrons16 as u8,
            memory_bytes: size_of::<Self>() as u32,
            ..Capabilities::default()
        }
    }

    /// This device has nothing to learn from a camera file.
    fn camera_piece(&mut self, _offset: u32, _piece: &[u8]) -> Result<(), Refusal> {
        Ok(())
    }

    fn camera_end(&mut self) -> Result<(), Refusal> {
        Ok(())
    }

    fn begin(
        &mut self,
        frame: &FrameBegin,
        exposure: Exposure,
        _registers: &Registers,
    ) -> Result<Begun, Refusal> {
        if frame.codec != Codec::Electrons16 {
            return Err(Refusal::Codec);
        }
        if usize::from(frame.width) != WIDTH || usize::from(frame.rows) != ROWS {
            return Err(Refusal::WrongShape);
        }
        if frame.raw_bits != 12 {
            return Err(Refusal::Packing);
        }
        self.exposure_s = exposure.exposure_s;
        Ok(Begun::new(SHAPE, 0))
    }

    /// Electrons per second = mantissa x 2^exponent.
    fn units(&mut self, _row: u16, _first: u16, units: &[u8]) {
        let Some((exponent, mantissas)) = units.split_first() else { return };
        let unit = power_of_two(*exponent as i8);
        for (e, m) in self.row_e.iter_mut().zip(mantissas.as_chunks().0) {
            *e = f32::from(u16::from_le_bytes(*m)) * unit * self.exposure_s;
        }
    }

    fn raw_row(&mut self, _row: u16, out: &mut [u8]) {
        let dn = self.row_e.map(|e| (e * DN_PER_E + 0.5).clamp(0.0, 4095.0) as u16);
        // `out` has the frame's `raw_bytes`, which `begin` set.
        let packed = pack_row(Packing::Raw12, &dn, out);
        debug_assert!(packed.is_ok());
    }

    fn sink(&mut self) -> Option<&mut dyn RowSink> {
        Some(&mut self.interface)
    }
}

/// 2^exponent, by the bits of an f32 (`core` has no powers).
fn power_of_two(exponent: i8) -> f32 {
    f32::from_bits(((i32::from(exponent) + 127).clamp(1, 254) as u32) << 23)
}

/// What the host sends and where it puts what comes back.
struct Picture {
    raw: [[u8; RAW_BYTES]; ROWS],
}

impl FrameIo for Picture {
    /// A ramp: pixel x of row y gives 1000 (x + y) electrons per second.
    fn spectral(&mut self, row: u16, _first: u16, out: &mut [u8]) {
        let Some((exponent, mantissas)) = out.split_first_mut() else { return };
        *exponent = 0;
        for (x, m) in (0u16..).zip(mantissas.as_chunks_mut().0) {
            *m = (1000 * (x + row)).to_le_bytes();
        }
    }

    fn raw_row(&mut self, row: u16) -> &mut [u8] {
        &mut self.raw[usize::from(row)]
    }

    fn camera(&mut self, _offset: u32, out: &mut [u8]) {
        out.fill(0);
    }
}

type Ends = (Host<[u16; ROWS]>, Device<RAW_BYTES>, Smallest, Picture);

/// Runs the host's operation to its end.
fn run((host, device, model, picture): &mut Ends) -> Event {
    let mut packet = [0; PACKET_BYTES];
    let mut now_us = 0;
    loop {
        match host.poll(now_us, picture, &mut packet) {
            Poll::Done(event) => return event,
            Poll::Send(bytes) => device.receive(&packet[..bytes], model),
            Poll::Wait(until_us) => now_us = until_us, // Nothing can come but what is here.
        }
        while let Some(bytes) = device.transmit(&mut packet, model) {
            if let Some(event) = host.receive(now_us, &packet[..bytes], picture) {
                return event;
            }
        }
    }
}

fn main() {
    let mut ends: Ends = (
        Host::new(Limits::default(), [0; ROWS]),
        Device::new(PACKET_BYTES as u16, 8),
        Smallest { exposure_s: 0.0, row_e: [0.0; WIDTH], interface: Interface::default() },
        Picture { raw: [[0; RAW_BYTES]; ROWS] },
    );

    ends.0.connect(1);
    assert_eq!(run(&mut ends), Event::Connected);
    println!("connected to {:?}", ends.0.device().map(|d| d.firmware.as_str()));

    let camera = [0; 4];
    ends.0.send_camera(camera_id(&camera), camera.len() as u32);
    assert_eq!(run(&mut ends), Event::CameraReady);

    let begin = FrameBegin {
        transfer: 0, // The host numbers its transfers itself.
        frame: 0,
        rows: ROWS as u16,
        width: WIDTH as u16,
        bands: 1,
        codec: Codec::Electrons16,
        arithmetic: NumberFormat::F32,
        raw_bits: 12,
        temperature_c: 25.0,
        before: Before::Dark,
        exposure: Some(Exposure { exposure_s: 0.05, analog_gain: 1.0 }),
    };
    ends.0.begin(begin, SHAPE, false);
    match run(&mut ends) {
        Event::FrameDone(start) => println!("frame {}: {}", start.frame, start.exposure),
        event => panic!("no frame: {event}"),
    }
    for (y, raw) in ends.3.raw.iter().enumerate() {
        let mut dn = [0; WIDTH];
        unpack_row(Packing::Raw12, raw, &mut dn).expect("the sizes of SHAPE");
        println!("row {y}: {dn:?} DN");
        let ramp = core::array::from_fn(|x| 50 * (x + y) as u16);
        assert_eq!(dn, ramp, "1000 (x + y) electrons per second for 0.05 s");
    }

    // The same light again; the rows stay with the device.
    let begin = FrameBegin { frame: 1, raw_bits: 0, ..begin };
    let shape = FrameShape { raw_bytes: RECEIPT_BYTES as u16, ..SHAPE };
    let crcs = ends.3.raw.map(|row| crc32c(&row));
    ends.0.begin(begin, shape, false);
    match run(&mut ends) {
        Event::FrameDone(start) => println!("frame {} has left by the interface", start.frame),
        event => panic!("no frame: {event}"),
    }
    assert_eq!((ends.2.interface.rows, ends.2.interface.crcs), (ROWS, crcs));
    // A receipt is the CRC of the row that left.
    for (raw, crc) in ends.3.raw.iter().zip(crcs) {
        assert_eq!(raw[..RECEIPT_BYTES], crc.to_le_bytes());
    }
}
