//! Rigs on serial ports and CDC-ACM devices.

use super::transport::{ByteLink, Transport};
use camrig_base::{Error, ErrorCode, Result};
use camrig_rig_link::framing::Framing;
use camrig_rig_link::host::Limits;
use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

/// Longest packet from the rig, bytes: 3.7 ms at 3 Mbit/s, so that little is lost with a damaged
/// one.
const PACKET_BYTES: u16 = 1100;
/// Longest packet to the rig, bytes.
const SEND_BYTES: u16 = 4400;
/// Packets that may be under way to the rig when the wait for an answer begins.
const UNDER_WAY: u64 = 16;
/// Bits on the line for a byte: start, eight, stop.
const BITS_PER_BYTE: u64 = 10;
/// Wait for an answer beyond the time on the line, µs.
const PATIENCE_US: u64 = 1_000_000;
/// Writes that may wait for the line: far more than credit lets a host send ahead.
const QUEUED_WRITES: usize = 256;
/// Longest wait for a place among them, and how often it is tried.
const QUEUE_PATIENCE: Duration = Duration::from_secs(10);
const QUEUE_STEP: Duration = Duration::from_millis(5);
/// How often a read looks whether the link was closed.
const READ_TIMEOUT: Duration = Duration::from_millis(100);

/// Limits for a line of this rate, bits per second. A thread reads at all times, so credit need
/// not be scarce; the wait for an answer covers what may be under way.
pub fn limits(baud: u32) -> Limits {
    let mut limits = Limits::default();
    limits.packet_bytes = PACKET_BYTES;
    limits.credit = 64;
    limits.send_bytes = SEND_BYTES;
    limits.timeout = PATIENCE_US
        + UNDER_WAY * u64::from(SEND_BYTES) * BITS_PER_BYTE * 1_000_000 / u64::from(baud);
    limits.idle_steps = 10;
    limits
}

/// Opens a port at a rate in bits per second.
///
/// # Errors
/// A port that does not exist, that another program holds or that this user may not open.
pub fn open(path: &str, baud: u32) -> Result<Box<dyn Transport>> {
    let name = format!("serial://{path}");
    let failed = |e: serialport::Error| {
        let what = match e.kind() {
            serialport::ErrorKind::NoDevice => {
                format!("cannot open {path}: {e}; it may be in use")
            }
            _ => format!("cannot open {path}: {e}"),
        };
        Error::device(what)
            .at(&name)
            .help("check the name, and close other programs that use this port")
            .with_code(ErrorCode::RigNotFound)
    };
    let port = serialport::new(path, baud).timeout(READ_TIMEOUT).open();
    let port = port.map_err(failed)?;
    let stop = Arc::new(AtomicBool::new(false));
    let reader = StoppableReader { port: port.try_clone().map_err(failed)?, stop: stop.clone() };
    let writer = QueuedWriter::new(port, stop);
    Ok(Box::new(ByteLink::new(name, Framing::Cobs, limits(baud), writer, reader)))
}

struct StoppableReader {
    port: Box<dyn serialport::SerialPort>,
    stop: Arc<AtomicBool>,
}

impl io::Read for StoppableReader {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.stop.load(Ordering::Relaxed) { Ok(0) } else { self.port.read(out) }
    }
}

/// Writes in a thread of its own. `serialport` waits for ever, whatever its time-out, when the
/// other end stops reading (seen with 4.10 on Linux); here only that thread waits, and the packets
/// that credit allows.
struct QueuedWriter {
    queue: mpsc::SyncSender<Vec<u8>>,
    stop: Arc<AtomicBool>,
}

impl QueuedWriter {
    fn new(mut port: Box<dyn serialport::SerialPort>, stop: Arc<AtomicBool>) -> Self {
        let (queue, packets) = mpsc::sync_channel::<Vec<u8>>(QUEUED_WRITES);
        let stopped = stop.clone();
        std::thread::spawn(move || {
            for packet in packets {
                let mut rest = &packet[..];
                while !rest.is_empty() {
                    match port.write(rest) {
                        Ok(written) => rest = &rest[written..],
                        // The line's buffer is full: try again.
                        Err(e) if e.kind() == io::ErrorKind::TimedOut => {}
                        Err(_) => return,
                    }
                    if stopped.load(Ordering::Relaxed) {
                        return;
                    }
                }
            }
        });
        Self { queue, stop }
    }
}

impl Write for QueuedWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let until = Instant::now() + QUEUE_PATIENCE;
        let mut packet = bytes.to_vec();
        loop {
            packet = match self.queue.try_send(packet) {
                Ok(()) => return Ok(bytes.len()),
                Err(mpsc::TrySendError::Full(packet)) if Instant::now() < until => packet,
                Err(mpsc::TrySendError::Full(_)) => return Err(io::ErrorKind::TimedOut.into()),
                Err(mpsc::TrySendError::Disconnected(_)) => {
                    return Err(io::ErrorKind::BrokenPipe.into());
                }
            };
            std::thread::sleep(QUEUE_STEP);
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for QueuedWriter {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}
