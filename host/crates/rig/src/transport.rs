//! What all links have in common: whole packets out, whole packets in.

use super::inbox::{Inlet, Outlet, Taken, inbox};
use camrig_base::{Error, Result};
use camrig_rig_link::framing::{Framing, Receiver, Sender};
use camrig_rig_link::host::Limits;
use std::io::{self, Read, Write};
use std::time::{Duration, Instant};

/// A link to a rig. Packets may get lost; those that arrive are checked by their receiver.
pub trait Transport: Send {
    /// Where the next packet is made, [`MAX_PACKET`] bytes.
    ///
    /// # Errors
    /// A link that has failed or was closed.
    fn room(&mut self) -> Result<&mut [u8]>;

    /// Sends the packet of `bytes` bytes that was made in [`Transport::room`], at the latest with
    /// the next [`Transport::flush`]. Does not wait for ever when the rig stops reading.
    ///
    /// # Errors
    /// A link that has failed or was closed.
    fn send(&mut self, bytes: usize) -> Result<()>;

    /// Sends what has been gathered.
    ///
    /// # Errors
    /// A link that has failed or was closed.
    fn flush(&mut self) -> Result<()>;

    /// Waits for a packet, at most `wait` from the call on, whatever else arrives meanwhile.
    /// Returns whether one came.
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
/// Longest packets that are gathered before bytes are written.
const SENT_AT_ONCE: usize = 4;

/// A byte stream with framing. A thread reads at all times, so that a rig that keeps to its credit
/// is never held up in sending and two ends can never wait for each other. Another one is: its
/// bytes wait in the system's buffers.
pub struct ByteLink<W> {
    name: String,
    limits: Limits,
    writer: W,
    sender: Sender<Vec<u8>>,
    /// The packet that is being made, where the framing will change its bytes.
    out: Vec<u8>,
    arrived: Outlet,
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
        let (inlet, arrived) = Self::inbox(framing, &limits);
        std::thread::spawn(move || {
            let mut buffer = vec![0; READ_BYTES];
            loop {
                match reader.read(&mut buffer) {
                    Ok(0) => return,
                    Ok(n) if inlet.put(&buffer[..n]).is_err() => return,
                    Ok(_) => {}
                    Err(e)
                        if matches!(
                            e.kind(),
                            io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
                        ) => {}
                    Err(e) => return inlet.fail(e),
                }
            }
        });
        Self::from_inbox(name, framing, limits, writer, arrived)
    }

    /// A queue for what a rig that keeps to its credit may have under way.
    pub(crate) fn inbox(framing: Framing, limits: &Limits) -> (Inlet, Outlet) {
        let packet = framing.max_encoded(limits.packet_bytes.into());
        inbox(READ_BYTES + packet * usize::from(limits.credit))
    }

    /// A link whose bytes arrive in a queue; the queue's end is the link's end.
    pub(crate) fn from_inbox(
        name: String,
        framing: Framing,
        limits: Limits,
        writer: W,
        arrived: Outlet,
    ) -> Self {
        let buffer = |packets| vec![0; packets * framing.max_encoded(MAX_PACKET)];
        let out = if framing == Framing::Length { 0 } else { MAX_PACKET };
        Self {
            name,
            limits,
            writer,
            sender: Sender::new(framing, buffer(SENT_AT_ONCE)),
            out: vec![0; out],
            arrived,
            chunk: Vec::new(),
            used: 0,
            receiver: Receiver::new(framing, buffer(1)),
            bytes: (0, 0),
        }
    }
}

/// Why a link is over.
fn closed(name: &str, why: &str) -> Error {
    Error::device(format!("the rig closed the link{why}")).at(name).help(
        "it may be busy with another host: an emulator serves one at a time, and drops one that \
         has been silent for 10 s; one with a token requires it in the address \
         (?token=TEXT); otherwise check the rig and its cable, and try again",
    )
}

/// Writes all bytes and counts them.
fn counted(writer: &mut impl Write, count: &mut u64) -> impl FnMut(&[u8]) -> io::Result<()> {
    |bytes| {
        *count += bytes.len() as u64;
        writer.write_all(bytes)
    }
}

impl<W: Write + Send> Transport for ByteLink<W> {
    fn room(&mut self) -> Result<&mut [u8]> {
        let Self { name, sender, out, writer, bytes, .. } = self;
        let place = sender.place(MAX_PACKET, counted(writer, &mut bytes.0));
        Ok(place.map_err(|e| closed(name, &format!(": {e}")))?.unwrap_or(out))
    }

    fn send(&mut self, bytes: usize) -> Result<()> {
        if self.out.is_empty() {
            self.sender.push_placed(bytes);
            return Ok(());
        }
        let write = counted(&mut self.writer, &mut self.bytes.0);
        let sent = self.sender.push(&self.out[..bytes], write);
        sent.map_err(|e| closed(&self.name, &format!(": {e}")))
    }

    fn flush(&mut self) -> Result<()> {
        let write = counted(&mut self.writer, &mut self.bytes.0);
        self.sender
            .flush(write)
            .and_then(|()| self.writer.flush())
            .map_err(|e| closed(&self.name, &format!(": {e}")))
    }

    fn receive(&mut self, wait: Duration) -> Result<bool> {
        let until = Instant::now() + wait;
        let mut taken = false;
        loop {
            let mut bytes = &self.chunk[self.used..];
            let whole = self.receiver.push(&mut bytes).map_err(|_| {
                Error::disagreement("the bytes received do not follow the rig's protocol")
                    .at(&self.name)
                    .help("give the address of a rig; serial lines use serial://, not tcp://")
            })?;
            self.used = self.chunk.len() - bytes.len();
            if whole {
                return Ok(true);
            }
            if taken && Instant::now() >= until {
                return Ok(false);
            }
            match self.arrived.take(&mut self.chunk, until) {
                Taken::Bytes => {
                    self.bytes.1 += self.chunk.len() as u64;
                    (self.used, taken) = (0, true);
                }
                Taken::Nothing => return Ok(false),
                Taken::Ended(Ok(())) => return Err(closed(&self.name, "")),
                Taken::Ended(Err(e)) => return Err(closed(&self.name, &format!(": {e}"))),
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A reader that always has a chunk of these bytes, at once or after a pause.
    struct Talker(&'static [u8], Duration);

    impl Read for Talker {
        fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
            std::thread::sleep(self.1);
            let n = out.len() / self.0.len() * self.0.len();
            let n = if self.1.is_zero() { n } else { self.0.len() };
            out[..n].iter_mut().zip(self.0.iter().cycle()).for_each(|(o, b)| *o = *b);
            Ok(n)
        }
    }

    #[test]
    fn a_peer_that_talks_without_a_packet_gets_no_more_time_than_a_silent_one() {
        let now_and_then = Duration::from_millis(5);
        for (framing, text, pause) in [
            (Framing::Length, &[0u8; 4][..], Duration::ZERO),
            (Framing::Length, &[0u8; 4][..], now_and_then),
            (Framing::Cobs, &b"sensor ready\r\n"[..], now_and_then),
        ] {
            let mut limits = Limits::default();
            limits.credit = 4;
            limits.packet_bytes = 1000;
            let talker = Talker(text, pause);
            let mut link = ByteLink::new("x".into(), framing, limits, io::sink(), talker);
            for wait in [0, 100] {
                let began = Instant::now();
                assert!(!link.receive(Duration::from_millis(wait)).unwrap());
                assert!(began.elapsed() < Duration::from_secs(5), "{framing:?} {pause:?} {wait}");
            }
            // Twice what its credit lets under way, one read, and what a reader has at hand.
            let most = 2 * (4 * 1010 + 2 * READ_BYTES);
            assert!(link.chunk.capacity() <= 2 * most, "{}", link.chunk.capacity());
        }
    }
}
