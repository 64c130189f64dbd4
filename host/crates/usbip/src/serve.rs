//! Devices on TCP: their connections, their clock, and the camera in the calling thread.
//!
//! One host at a time has a device, until it closes the connection; others are told that it is
//! busy, and may ask what there is. A connection that asks for nothing is closed after
//! [`TO_ASK`]; a host that does not take what it asked for, after [`TO_TAKE`].

use crate::adapter::Adapter;
use crate::descriptors::{ADAPTER, CAMERA, Identity};
use crate::device::Device;
use crate::protocol::{self, HEADER_BYTES, Operation, Refusal, Request};
use camrig_gige::running::{LOOK, Orders, Running};
use camrig_gige::{Camera, Order, Sensor, Taken};
use embedded_hal::i2c::I2c;
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, SocketAddrV4, TcpListener, TcpStream};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Longest wait for a connection's first request, and for a host that takes data.
const TO_ASK: Duration = Duration::from_secs(5);
const TO_TAKE: Duration = Duration::from_secs(5);
/// Most connections at once.
const MAX_CONNECTIONS: usize = 16;

/// Devices whose port is open.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
}

/// A device that hosts attach.
trait Attachable {
    const IDENTITY: Identity;

    /// Takes a request with the data that follow it, and returns the answers.
    fn receive(&mut self, now: Duration, request: &Request, data: &[u8]) -> Vec<u8>;

    /// The host has gone.
    fn detach(&mut self);
}

impl Attachable for Device {
    const IDENTITY: Identity = CAMERA;

    fn receive(&mut self, now: Duration, request: &Request, data: &[u8]) -> Vec<u8> {
        Self::receive(self, now, request, data)
    }

    fn detach(&mut self) {
        Self::detach(self);
    }
}

impl<B: I2c> Attachable for Adapter<'_, B> {
    const IDENTITY: Identity = ADAPTER;

    fn receive(&mut self, _: Duration, request: &Request, data: &[u8]) -> Vec<u8> {
        Self::receive(self, request, data)
    }

    fn detach(&mut self) {}
}

/// A device and the host that has it: what is sent follows the order of what changes.
struct Attachment<D> {
    device: D,
    host: Option<TcpStream>,
}

struct Shared<'a, B> {
    camera: Running<Attachment<Device>>,
    adapter: Option<Running<Attachment<Adapter<'a, B>>>>,
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
    /// sent. With a bus there is an I2C adapter beside the camera, whose exposure and gain are then
    /// no controls of its own: sensors on the bus have them.
    ///
    /// # Errors
    /// Those of the camera.
    pub fn run<C: Camera, B: I2c + Send>(
        &self,
        sensor: Sensor,
        camera: &mut C,
        bus: Option<&Mutex<B>>,
        stops: impl Fn() -> bool,
    ) -> Result<u64, C::Error> {
        let adapter = bus.map(|bus| Adapter::new(bus, &sensor.serial));
        let device = Device::new(sensor);
        let device = if bus.is_some() { device.without_controls() } else { device };
        let shared = &Shared {
            camera: Attachment::running(device),
            adapter: adapter.map(Attachment::running),
            connections: AtomicUsize::new(0),
        };
        std::thread::scope(|scope| {
            scope.spawn(move || {
                let _ending = shared.camera.ending();
                while !shared.camera.has_ended() {
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
            shared.camera.take_frames(camera, stops)
        })?;
        let images = shared.camera.device().device.images();
        Ok(images)
    }
}

/// Held by the connection that has a device.
struct Attached<'a, D: Attachable>(&'a Running<Attachment<D>>);

impl<D: Attachable> Drop for Attached<'_, D> {
    fn drop(&mut self) {
        let mut attachment = self.0.device();
        attachment.host = None;
        attachment.device.detach();
    }
}

impl<D> Attachment<D> {
    /// A device that no host has.
    fn running(device: D) -> Running<Self> {
        Running::new(Self { device, host: None })
    }

    /// Sends to the host, who is given up if it does not take all of it in time.
    fn send(&mut self, bytes: &[u8]) {
        let Some(host) = &mut self.host else { return };
        if write(host, bytes).is_err() {
            // The thread that reads from it notices.
            let _ = host.shutdown(Shutdown::Both);
        }
    }
}

impl Orders for Attachment<Device> {
    fn order<C: Camera>(&mut self, now: Duration, camera: &mut C) -> Option<Order> {
        self.device.order(now, camera.pace())
    }

    fn next_order(&self) -> Option<Duration> {
        self.device.next_order()
    }

    fn deliver(&mut self, taken: Taken) {
        let packets = self.device.deliver(taken);
        self.send(&packets);
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

impl<B: I2c + Send> Shared<'_, B> {
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
            if self.camera.has_ended() || within.is_some_and(|within| began.elapsed() > within) {
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
        match Operation::parse(header) {
            Some(Operation::List) => {
                let adapter = self.adapter.as_ref().map(|_| ADAPTER.listed());
                let devices: Vec<_> = [CAMERA.listed()].into_iter().chain(adapter).collect();
                stream.write_all(&protocol::listed(&devices))
            }
            Some(Operation::Import) => {
                let mut name = [0; Operation::BODY];
                self.read(&mut stream, &mut name, Some(TO_ASK))?;
                let name = Operation::bus_id(&name);
                match &self.adapter {
                    _ if name == CAMERA.bus_id.as_bytes() => self.attach(&self.camera, stream),
                    Some(adapter) if name == ADAPTER.bus_id.as_bytes() => {
                        self.attach(adapter, stream)
                    }
                    _ => stream.write_all(&protocol::imported(Err(Refusal::Unknown))),
                }
            }
            None => Ok(()),
        }
    }

    /// Gives a device to a host, and answers it until it has gone.
    fn attach<D: Attachable>(
        &self,
        running: &Running<Attachment<D>>,
        mut stream: TcpStream,
    ) -> io::Result<()> {
        let mut attachment = running.device();
        if attachment.host.is_some() {
            drop(attachment);
            return stream.write_all(&protocol::imported(Err(Refusal::Busy)));
        }
        attachment.host = Some(stream.try_clone()?);
        let _attached = Attached(running);
        attachment.send(&protocol::imported(Ok(&D::IDENTITY.usbip())));
        drop(attachment);
        let mut header = [0; HEADER_BYTES];
        let mut data = Vec::new();
        loop {
            self.read(&mut stream, &mut header, None)?;
            let request = Request::parse(&header).ok_or(io::ErrorKind::InvalidData)?;
            data.resize(request.body_bytes(), 0);
            self.read(&mut stream, &mut data, Some(TO_TAKE))?;
            let mut attachment = running.device();
            let answer = attachment.device.receive(running.now(), &request, &data);
            attachment.send(&answer);
            drop(attachment);
            self.camera.tell();
        }
    }
}
