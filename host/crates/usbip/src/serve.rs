//! A device on TCP: its connections, its clock, and the camera in the calling thread.
//!
//! One host at a time has the device, until it closes the connection; others are told that it is
//! busy, and may ask what there is. A connection that asks for nothing is closed after
//! [`TO_ASK`]; a host that does not take what it asked for, after [`TO_TAKE`].

use crate::descriptors;
use crate::device::Device;
use crate::protocol::{self, HEADER_BYTES, Operation, Refusal, Request};
use camrig_gige::{Camera, Sensor, Taken};
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, SocketAddrV4, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Longest wait of any thread, after which it looks whether the server ends.
const LOOK: Duration = Duration::from_millis(50);
/// Longest wait for a connection's first request, and for a host that takes data.
const TO_ASK: Duration = Duration::from_secs(5);
const TO_TAKE: Duration = Duration::from_secs(5);
/// Most connections at once.
const MAX_CONNECTIONS: usize = 16;

/// A device whose port is open.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
}

/// The device and the host that has it: what is sent follows the order of what changes.
struct Attachment {
    device: Device,
    host: Option<TcpStream>,
}

struct Shared {
    attachment: Mutex<Attachment>,
    changed: Condvar,
    began: Instant,
    ends: AtomicBool,
    connections: AtomicUsize,
}

impl Server {
    /// Opens a port; the usual one is [`protocol::PORT`].
    ///
    /// # Errors
    /// An address that this machine does not have, a port in use.
    pub fn bind(address: SocketAddrV4) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        Ok(Self { listener, address })
    }

    /// The address in force: a port 0 has become a number.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Serves hosts until `stops`, with the camera in this thread; returns how many images it has
    /// sent.
    ///
    /// # Errors
    /// Those of the camera.
    pub fn run<C: Camera>(
        &self,
        sensor: Sensor,
        camera: &mut C,
        stops: impl Fn() -> bool,
    ) -> Result<u64, C::Error> {
        let shared = Shared {
            attachment: Mutex::new(Attachment { device: Device::new(sensor), host: None }),
            changed: Condvar::new(),
            began: Instant::now(),
            ends: AtomicBool::new(false),
            connections: AtomicUsize::new(0),
        };
        let shared = &shared;
        std::thread::scope(|scope| {
            scope.spawn(move || {
                let _ending = Ending(shared);
                while !shared.has_ended() {
                    let Ok((stream, _)) = self.listener.accept() else {
                        std::thread::sleep(LOOK);
                        continue;
                    };
                    if shared.connections.fetch_add(1, Ordering::AcqRel) < MAX_CONNECTIONS {
                        scope.spawn(move || {
                            // A connection that fails is over.
                            let _ = shared.connect(stream);
                            shared.connections.fetch_sub(1, Ordering::AcqRel);
                        });
                    } else {
                        shared.connections.fetch_sub(1, Ordering::AcqRel);
                    }
                }
            });
            shared.take_frames(camera, stops)
        })?;
        let images = shared.lock().device.images();
        Ok(images)
    }
}

/// Held by the threads that the server cannot do without: with the first that ends, all do.
struct Ending<'a>(&'a Shared);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        self.0.ends.store(true, Ordering::Release);
        self.0.changed.notify_all();
    }
}

/// Held by the connection that has the device.
struct Attached<'a>(&'a Shared);

impl Drop for Attached<'_> {
    fn drop(&mut self) {
        let mut attachment = self.0.lock();
        attachment.host = None;
        attachment.device.detach();
    }
}

impl Attachment {
    /// Sends to the host, who is given up if it does not take all of it in time.
    fn send(&mut self, bytes: &[u8]) {
        let Some(host) = &mut self.host else { return };
        if write(host, bytes).is_err() {
            // The thread that reads from it notices.
            let _ = host.shutdown(Shutdown::Both);
        }
    }
}

/// Writes all bytes within [`TO_TAKE`].
fn write(to: &mut TcpStream, mut bytes: &[u8]) -> io::Result<()> {
    let began = Instant::now();
    while !bytes.is_empty() {
        match to.write(bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(n) => bytes = &bytes[n..],
            Err(e) if [io::ErrorKind::WouldBlock, io::ErrorKind::TimedOut].contains(&e.kind()) => {
            }
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
        if began.elapsed() > TO_TAKE {
            return Err(io::ErrorKind::TimedOut.into());
        }
    }
    Ok(())
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Attachment> {
        // With a thread that panicked the server ends.
        self.attachment.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now(&self) -> Duration {
        self.began.elapsed()
    }

    fn has_ended(&self) -> bool {
        self.ends.load(Ordering::Acquire)
    }

    /// Fills a buffer, within a time if one is given.
    fn read(
        &self,
        from: &mut TcpStream,
        out: &mut [u8],
        within: Option<Duration>,
    ) -> io::Result<()> {
        let began = Instant::now();
        let mut at = 0;
        while at < out.len() {
            match from.read(&mut out[at..]) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(n) => at += n,
                Err(e)
                    if [io::ErrorKind::WouldBlock, io::ErrorKind::TimedOut]
                        .contains(&e.kind()) => {}
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
            if self.has_ended() || within.is_some_and(|within| began.elapsed() > within) {
                return Err(io::ErrorKind::TimedOut.into());
            }
        }
        Ok(())
    }

    /// A connection from its first request to its end.
    fn connect(&self, mut stream: TcpStream) -> io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(LOOK))?;
        stream.set_write_timeout(Some(LOOK))?;
        let mut header = [0; Operation::HEADER];
        self.read(&mut stream, &mut header, Some(TO_ASK))?;
        let device = descriptors::usbip();
        match Operation::parse(header) {
            Some(Operation::List) => {
                stream.write_all(&protocol::listed(&device, &descriptors::INTERFACES))
            }
            Some(Operation::Import) => {
                let mut name = [0; Operation::BODY];
                self.read(&mut stream, &mut name, Some(TO_ASK))?;
                if !Operation::names_the_device(&name) {
                    return stream.write_all(&protocol::imported(Err(Refusal::Unknown)));
                }
                let mut attachment = self.lock();
                if attachment.host.is_some() {
                    drop(attachment);
                    return stream.write_all(&protocol::imported(Err(Refusal::Busy)));
                }
                attachment.host = Some(stream.try_clone()?);
                let _attached = Attached(self);
                attachment.send(&protocol::imported(Ok(&device)));
                drop(attachment);
                self.serve(&mut stream)
            }
            None => Ok(()),
        }
    }

    /// Answers the host that has the device.
    fn serve(&self, stream: &mut TcpStream) -> io::Result<()> {
        let mut header = [0; HEADER_BYTES];
        let mut data = Vec::new();
        loop {
            self.read(stream, &mut header, None)?;
            let request = Request::parse(&header).ok_or(io::ErrorKind::InvalidData)?;
            data.resize(request.body_bytes(), 0);
            self.read(stream, &mut data, Some(TO_TAKE))?;
            let mut attachment = self.lock();
            let answer = attachment.device.receive(self.now(), &request, &data);
            attachment.send(&answer);
            drop(attachment);
            self.changed.notify_all();
        }
    }

    /// Takes frames as the device orders them.
    fn take_frames<C: Camera>(
        &self,
        camera: &mut C,
        stops: impl Fn() -> bool,
    ) -> Result<(), C::Error> {
        let _ending = Ending(self);
        while !stops() && !self.has_ended() {
            let mut attachment = self.lock();
            match attachment.device.order(self.now()) {
                Some(order) => {
                    drop(attachment);
                    let taken: Taken = camera.take(&order)?;
                    let mut attachment = self.lock();
                    let packets = attachment.device.deliver(taken);
                    attachment.send(&packets);
                }
                None => {
                    let due = attachment.device.next_order().filter(|due| *due > self.now());
                    let wait = due.map_or(LOOK, |due| due.saturating_sub(self.now()).min(LOOK));
                    drop(self.changed.wait_timeout(attachment, wait));
                }
            }
        }
        Ok(())
    }
}
