//! The rig emulator: the firmware's own code with a workstation's memory.

use super::transport::{ByteLink, MAX_PACKET, Transport};
use firmware_sim::running::AnyRunning;
use firmware_sim::{Buffers, Dispatch, Memory, Rig, RowMemory, ServeError, serve};
use multiversion::multiversion;
use rig_link::device::Device;
use rig_link::framing::Framing;
use rig_link::host::Limits;
use sensor_core::arith::{Arith, BLOCK, Block, Fixed, Float, blocks};
use sensor_core::collect::Sums;
use sensor_core::config::MAX_BANDS;
use sensor_core::spectral::{GROUP, groups};
use std::io;
use std::sync::mpsc;

/// Longest row, pixels.
const MAX_WIDTH: usize = 16_384;
/// Longest packed raw row, bytes.
const RAW_BYTES: usize = 2 * MAX_WIDTH;
/// Rows of memory: two effects that read their neighbours, and one with a memory.
const ROWS: usize = 5 + 8;
/// Values of the crosstalk table: 33 x 33 nodes, 64 bands, 4 channels.
const CROSSTALK: usize = 33 * 33 * 64 * 4 + 130;

/// Name and version that the emulator answers with.
const FIRMWARE: &str = concat!("camrig emulator ", env!("CARGO_PKG_VERSION"));

struct Rows<A: Arith> {
    rows: Vec<Block<A::Signal>>,
    sums: Vec<Sums<A::Sum>>,
}

impl<A: Arith> Rows<A> {
    fn new() -> Self {
        Self {
            rows: vec![[A::Signal::default(); BLOCK]; ROWS * blocks(MAX_WIDTH)],
            sums: vec![[A::Sum::default(); GROUP]; groups(MAX_WIDTH)],
        }
    }

    fn lend(&mut self) -> RowMemory<'_, A> {
        RowMemory { rows: &mut self.rows, sums: &mut self.sums }
    }
}

/// Memory of an emulated rig.
pub struct Emulator {
    float: Rows<Float>,
    fixed: Rows<Fixed>,
    mantissas: Vec<u16>,
    exponents: Vec<i8>,
    crosstalk: Vec<f32>,
    versions: Option<(u8, u8)>,
}

impl Emulator {
    /// An emulated rig that has just been switched on. `versions`: pretend to speak these versions of
    /// the protocol.
    pub fn new(versions: Option<(u8, u8)>) -> Self {
        Self {
            float: Rows::new(),
            fixed: Rows::new(),
            mantissas: vec![0; MAX_WIDTH],
            exponents: vec![0; groups(MAX_WIDTH)],
            crosstalk: vec![0.0; CROSSTALK],
            versions,
        }
    }

    /// Serves link after link, as `next` gives them; its camera and registers outlast a link. Ends when
    /// there is no next link.
    pub fn run<L: embedded_io::Read + embedded_io::Write>(
        &mut self,
        framing: Framing,
        mut next: impl FnMut() -> Option<L>,
        mut ended: impl FnMut(Result<(), ServeError<L::Error>>),
    ) {
        let mut rig = Rig::new(
            FIRMWARE,
            Memory {
                float: self.float.lend(),
                fixed: self.fixed.lend(),
                mantissas: &mut self.mantissas,
                exponents: &mut self.exponents,
                crosstalk: &mut self.crosstalk,
                max_bands: MAX_BANDS as u16,
            },
        );
        let mut device = Box::new(Device::<RAW_BYTES>::new(MAX_PACKET as u16));
        if let Some((oldest, newest)) = self.versions {
            device.set_versions(oldest, newest);
        }
        let mut buffer = [(); 4].map(|()| vec![0; 2 * framing.max_encoded(MAX_PACKET)]);
        while let Some(mut link) = next() {
            let [input, packet, answer, framed] = &mut buffer;
            let input = match framing {
                Framing::Report(size) => &mut input[..usize::from(size)],
                _ => &mut input[..],
            };
            let buffers = Buffers { input, packet, answer: &mut answer[..MAX_PACKET], framed };
            ended(serve::<Vectorised, _, RAW_BYTES>(
                &mut device,
                &mut rig,
                &mut link,
                framing,
                buffers,
            ));
        }
    }
}

/// The row functions compiled for the vector instructions of this machine, as `camrig expose` has them.
struct Vectorised;

impl Dispatch for Vectorised {
    fn units(running: &mut AnyRunning<'_>, row: u16, first: u16, bytes: &[u8]) {
        units(running, row, first, bytes);
    }

    fn raw_row(running: &mut AnyRunning<'_>, row: u16, out: &mut [u8]) {
        raw_row(running, row, out);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn units(running: &mut AnyRunning<'_>, row: u16, first: u16, bytes: &[u8]) {
    running.units(row, first, bytes);
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl", "x86_64+avx2"))]
fn raw_row(running: &mut AnyRunning<'_>, row: u16, out: &mut [u8]) {
    running.raw_row(row, out);
}

/// One end of an in-process link.
struct ChannelEnd {
    received: mpsc::Receiver<Vec<u8>>,
    left: Vec<u8>,
    sent: mpsc::Sender<io::Result<Vec<u8>>>,
}

impl embedded_io::ErrorType for ChannelEnd {
    type Error = io::Error;
}

impl embedded_io::Read for ChannelEnd {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.left.is_empty() {
            match self.received.recv() {
                Ok(bytes) => self.left = bytes,
                Err(_) => return Ok(0),
            }
        }
        let n = out.len().min(self.left.len());
        out[..n].copy_from_slice(&self.left[..n]);
        self.left.drain(..n);
        Ok(n)
    }
}

impl embedded_io::Write for ChannelEnd {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.sent.send(Ok(bytes.to_vec())).map_err(|_| io::ErrorKind::BrokenPipe)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

struct ChannelWriter(mpsc::Sender<Vec<u8>>);

impl io::Write for ChannelWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.send(bytes.to_vec()).map_err(|_| io::ErrorKind::BrokenPipe)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Starts an emulator in a thread of this process.
pub fn open() -> Box<dyn Transport> {
    let (to_device, received) = mpsc::channel();
    let (sent, from_device) = mpsc::channel();
    let mut end = Some(ChannelEnd { received, left: Vec::new(), sent });
    std::thread::spawn(move || Emulator::new(None).run(Framing::Length, || end.take(), drop));
    let limits = Limits { packet_bytes: MAX_PACKET as u16, ..Limits::default() };
    let writer = ChannelWriter(to_device);
    Box::new(ByteLink::from_chunks(
        "emulator:".into(),
        Framing::Length,
        limits,
        writer,
        from_device,
    ))
}
