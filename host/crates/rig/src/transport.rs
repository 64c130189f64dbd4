//! What all links have in common: whole packets out, whole packets in.

use camrig_base::{Error, Result};
use camrig_rig_link::framing::{Framing, Receiver, Sender};
use camrig_rig_link::host::Limits;
use std::io::{self, Read, Write};
use std::sync::mpsc;
use std::time::Duration;

/// A link to a rig. Packets may get lost; those that arrive are checked by their receiver.
pub trait Transport: Send {
    /// Sends a packet, at the latest with the next [`Transport::flush`]. Does not wait for ever
    /// when the rig stops reading.
    ///
    /// # Errors
    /// A link that has failed or was closed.
    fn send(&mut self, packet: &[u8]) -> Result<()>;

    /// Sends what has been gathered.
    ///
    /// # Errors
    /// A link that has failed or was closed.
    fn flush(&mut self) -> Result<()>;

    /// Waits for a packet. Returns whether one came.
    ///
    /// # Errors
    /// A link that has failed or was closed, bytes that are not the protocol.
    fn receive(&mut self, wait: Duration) -> Result<bool>;

    /// The packet that came.
    fn packet(&mut self) -> &[u8];

    /// Packet sizes, credit and patience that suit the link.
    fn limits(&self) -> Limits;

    /// Bytes that went over the link, framing included: sent and received.
    fn bytes(&self) -> (u64, u64);
}

/// Longest packet on any link, bytes.
pub const MAX_PACKET: usize = 32 * 1024;

/// Bytes read at a time from a byte stream: two of the longest packets.
const READ_BYTES: usize = 2 * MAX_PACKET;

type Chunk = io::Result<Vec<u8>>;

/// A byte stream with framing. A thread reads at all times, so that the rig is never held up in
/// sending and two ends can never wait for each other.
pub struct ByteLink<W> {
    name: String,
    limits: Limits,
    writer: W,
    sender: Sender<Vec<u8>>,
    chunks: mpsc::Receiver<Chunk>,
    chunk: Vec<u8>,
    used: usize,
    receiver: Receiver<Vec<u8>>,
    bytes: (u64, u64),
}

impl<W: Write + Send> ByteLink<W> {
    /// A link over a stream's two halves. Reads that time out are tried again.
    pub fn new(
        name: String,
        framing: Framing,
        limits: Limits,
        writer: W,
        mut reader: impl Read + Send + 'static,
    ) -> Self {
        let (sender, chunks) = mpsc::channel();
        std::thread::spawn(move || {
            let mut buffer = vec![0; READ_BYTES];
            loop {
                let chunk = match reader.read(&mut buffer) {
                    Ok(0) => return,
                    Ok(n) => Ok(buffer[..n].to_vec()),
                    Err(e)
                        if matches!(
                            e.kind(),
                            io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
                        ) =>
                    {
                        continue;
                    }
                    Err(e) => Err(e),
                };
                let last = chunk.is_err();
                if sender.send(chunk).is_err() || last {
                    return;
                }
            }
        });
        Self::from_chunks(name, framing, limits, writer, chunks)
    }

    /// A link whose bytes arrive in chunks; the channel's end is the link's end.
    pub fn from_chunks(
        name: String,
        framing: Framing,
        limits: Limits,
        writer: W,
        chunks: mpsc::Receiver<Chunk>,
    ) -> Self {
        let buffer = || vec![0; 2 * framing.max_encoded(MAX_PACKET)];
        Self {
            name,
            limits,
            writer,
            sender: Sender::new(framing, buffer()),
            chunks,
            chunk: Vec::new(),
            used: 0,
            receiver: Receiver::new(framing, buffer()),
            bytes: (0, 0),
        }
    }

    fn closed(&self, why: &str) -> Error {
        Error::device(format!("the rig closed the link{why}")).at(&self.name).help(
            "it may be busy with another host: an emulator serves one at a time; otherwise check \
             the rig and its cable, and try again",
        )
    }
}

/// Writes all bytes and counts them.
fn counted(writer: &mut impl Write, count: &mut u64) -> impl FnMut(&[u8]) -> io::Result<()> {
    |bytes| {
        *count += bytes.len() as u64;
        writer.write_all(bytes)
    }
}

impl<W: Write + Send> Transport for ByteLink<W> {
    fn send(&mut self, packet: &[u8]) -> Result<()> {
        let write = counted(&mut self.writer, &mut self.bytes.0);
        self.sender.push(packet, write).map_err(|e| self.closed(&format!(": {e}")))
    }

    fn flush(&mut self) -> Result<()> {
        let write = counted(&mut self.writer, &mut self.bytes.0);
        self.sender
            .flush(write)
            .and_then(|()| self.writer.flush())
            .map_err(|e| self.closed(&format!(": {e}")))
    }

    fn receive(&mut self, wait: Duration) -> Result<bool> {
        loop {
            let mut bytes = &self.chunk[self.used..];
            let whole = self.receiver.push(&mut bytes).map_err(|_| {
                Error::disagreement("the bytes that arrived are not the rig's protocol")
                    .at(&self.name)
                    .help("give the address of a rig; serial lines take serial://, not tcp://")
            })?;
            self.used = self.chunk.len() - bytes.len();
            if whole {
                return Ok(true);
            }
            let next = if wait.is_zero() {
                self.chunks.try_recv().map_err(|e| e == mpsc::TryRecvError::Disconnected)
            } else {
                self.chunks
                    .recv_timeout(wait)
                    .map_err(|e| e == mpsc::RecvTimeoutError::Disconnected)
            };
            match next {
                Ok(Ok(chunk)) => {
                    self.bytes.1 += chunk.len() as u64;
                    (self.chunk, self.used) = (chunk, 0);
                }
                Ok(Err(e)) => return Err(self.closed(&format!(": {e}"))),
                Err(true) => return Err(self.closed("")),
                Err(false) => return Ok(false),
            }
        }
    }

    fn packet(&mut self) -> &[u8] {
        self.receiver.packet()
    }

    fn limits(&self) -> Limits {
        self.limits
    }

    fn bytes(&self) -> (u64, u64) {
        self.bytes
    }
}
