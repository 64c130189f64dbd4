//! The rig emulator: the firmware's own code with a workstation's memory.

use super::inbox::Inlet;
use super::transport::{ByteLink, MAX_PACKET, Transport};
use camrig_exposure::parallel::Parallel;
use camrig_firmware_sim::{Buffers, CaptureMemory, Memory, Rig, RowMemory, ServeError, serve};
use camrig_rig_link::device::Device;
use camrig_rig_link::framing::Framing;
use camrig_rig_link::host::Limits;
use camrig_sensor_core::arith::{Arith, BLOCK, Block, Fixed, Float, blocks};
use camrig_sensor_core::collect::Sums;
use camrig_sensor_core::config::MAX_BANDS;
use camrig_sensor_core::hdr::MAX_CAPTURES;
use camrig_sensor_core::spectral::{GROUP, groups};
use std::io;
use std::sync::mpsc;

/// Longest row, pixels: the memory is laid out for it.
const MAX_WIDTH: usize = 16_384;
/// Longest packed raw row, bytes.
const RAW_BYTES: usize = 2 * MAX_WIDTH;
/// Rows of memory for two effects that read the rows above and below: 5 of light, 7 of the
/// pipeline, and as many for the frame before, where an effect remembers it.
const ROWS: usize = 5 + 7 + 7;
/// Values of the crosstalk table: 33 x 33 nodes, 64 bands, 4 channels, and the axes of the three.
const CROSSTALK: usize = 33 * 33 * 64 * 4 + 130;
/// Packets that a host may send ahead. A trade: 8 MiB of memory at the longest packet, and the
/// host need not wait for acknowledgements.
const CREDIT: u16 = 256;
/// Bytes read and written at a time on a byte stream.
const STREAM_BYTES: usize = 256 * 1024;

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

/// Memory of one of the rigs that an emulator is made of.
struct Worker {
    float: Rows<Float>,
    fixed: Rows<Fixed>,
    mantissas: Vec<u16>,
    exponents: Vec<i8>,
    crosstalk: Vec<f32>,
    captures: Vec<CaptureMemory>,
}

impl Worker {
    fn new() -> Self {
        Self {
            float: Rows::new(),
            fixed: Rows::new(),
            mantissas: vec![0; MAX_WIDTH],
            exponents: vec![0; groups(MAX_WIDTH)],
            crosstalk: vec![0.0; CROSSTALK],
            captures: (1..MAX_CAPTURES).map(|_| CaptureMemory::EMPTY).collect(),
        }
    }

    fn rig(&mut self) -> Rig<'_> {
        let (bands, exponents) = (&mut self.mantissas, &mut self.exponents);
        let memory = Memory::new(bands, exponents, &mut self.crosstalk, MAX_BANDS as u16);
        let memory = memory.with_float(self.float.lend()).with_fixed(self.fixed.lend());
        let memory = memory.with_captures(&mut self.captures);
        Rig::new(FIRMWARE, memory)
    }
}

/// An emulated rig.
pub struct Emulator {
    workers: Vec<Worker>,
    versions: Option<(u8, u8)>,
}

impl Emulator {
    /// An emulated rig that has just been switched on and computes rows in as many threads as
    /// `rayon` has. `versions`: pretend to speak these versions of the protocol.
    pub fn new(versions: Option<(u8, u8)>) -> Self {
        Self::with_threads(rayon::current_num_threads(), versions)
    }

    /// Computes rows in so many threads.
    pub fn with_threads(threads: usize, versions: Option<(u8, u8)>) -> Self {
        Self { workers: (0..threads.max(1)).map(|_| Worker::new()).collect(), versions }
    }

    /// The rig without its link.
    pub fn model(&mut self) -> Parallel<'_> {
        Parallel::new(self.workers.iter_mut().map(Worker::rig).collect())
    }

    /// Serves link after link, as `next` gives them; its camera and registers outlast a link. Ends
    /// when there is no next link.
    pub fn run<L: embedded_io::Read + embedded_io::Write>(
        &mut self,
        framing: Framing,
        mut next: impl FnMut() -> Option<L>,
        mut ended: impl FnMut(Result<(), ServeError<L::Error>>),
    ) {
        let versions = self.versions;
        let mut model = self.model();
        let mut device = Box::new(Device::<RAW_BYTES>::new(MAX_PACKET as u16, CREDIT));
        if let Some((oldest, newest)) = versions {
            device.set_versions(oldest, newest);
        }
        let chunk = match framing {
            Framing::Report(size) => size.into(),
            _ => STREAM_BYTES,
        };
        let [mut input, mut framed] = [(); 2].map(|()| vec![0; chunk]);
        let [mut packet, mut answer] = [(); 2].map(|()| vec![0; framing.max_encoded(MAX_PACKET)]);
        while let Some(mut link) = next() {
            let buffers = Buffers {
                input: &mut input,
                packet: &mut packet,
                answer: &mut answer[..MAX_PACKET],
                framed: &mut framed,
            };
            ended(serve(&mut device, &mut model, &mut link, framing, buffers));
        }
    }
}

/// One end of an in-process link.
struct ChannelEnd {
    received: mpsc::Receiver<Vec<u8>>,
    left: Vec<u8>,
    used: usize,
    sent: Inlet,
}

impl embedded_io::ErrorType for ChannelEnd {
    type Error = io::Error;
}

impl embedded_io::Read for ChannelEnd {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.used == self.left.len() {
            match self.received.recv() {
                Ok(bytes) => (self.left, self.used) = (bytes, 0),
                Err(_) => return Ok(0),
            }
        }
        let rest = &self.left[self.used..];
        let n = out.len().min(rest.len());
        out[..n].copy_from_slice(&rest[..n]);
        self.used += n;
        Ok(n)
    }
}

impl embedded_io::Write for ChannelEnd {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.sent.put(bytes)?;
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
    let mut limits = Limits::default();
    (limits.packet_bytes, limits.credit) = (MAX_PACKET as u16, CREDIT);
    open_as(Framing::Length, limits)
}

/// Starts an emulator behind an in-process link that frames packets as another kind of link does.
pub fn open_as(framing: Framing, limits: Limits) -> Box<dyn Transport> {
    let (to_device, received) = mpsc::channel();
    let (sent, from_device) = ByteLink::<ChannelWriter>::inbox(framing, &limits);
    let mut end = Some(ChannelEnd { received, left: Vec::new(), used: 0, sent });
    std::thread::spawn(move || Emulator::new(None).run(framing, || end.take(), drop));
    let writer = ChannelWriter(to_device);
    Box::new(ByteLink::from_inbox("emulator:".into(), framing, limits, writer, from_device))
}
