//! A device on the network: its sockets, its clock, and the camera in the calling thread.

use crate::camera::{Camera, Sensor, Taken};
use crate::device::{Counts, Device, Next};
use crate::gvcp::{Command, Request};
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Longest wait of any thread, after which it looks whether the server ends.
const LOOK: Duration = Duration::from_millis(50);
/// Waits below this are spent spinning: sleeping takes longer to wake up from.
const SPIN: Duration = Duration::from_micros(100);
/// Longest datagram of GVCP.
const MAX_DATAGRAM: usize = 2048;

/// Frames of a server that has ended.
pub type Summary = Counts;

/// A device whose sockets are open.
#[derive(Debug)]
pub struct Server {
    control: UdpSocket,
    stream: UdpSocket,
    /// Where discovery by broadcast arrives.
    broadcast: Option<UdpSocket>,
    address: SocketAddrV4,
}

/// What the threads share.
struct Shared {
    device: Mutex<Device>,
    changed: Condvar,
    began: Instant,
    ends: AtomicBool,
}

impl Server {
    /// Opens the sockets of a device at an address; its port is [`crate::gvcp::PORT`] for
    /// applications that are not told another.
    ///
    /// # Errors
    /// An address that this machine does not have, a port in use.
    pub fn bind(address: SocketAddrV4) -> io::Result<Self> {
        let control = UdpSocket::bind(address)?;
        let SocketAddr::V4(address) = control.local_addr()? else {
            return Err(io::ErrorKind::AddrNotAvailable.into());
        };
        let stream = UdpSocket::bind((*address.ip(), 0))?;
        // The loopback interface has no broadcast of its own: what is sent to everybody arrives
        // at sockets of that address.
        let broadcast = UdpSocket::bind((Ipv4Addr::BROADCAST, address.port())).ok();
        for socket in [&control, &stream].into_iter().chain(&broadcast) {
            socket.set_read_timeout(Some(LOOK))?;
        }
        Ok(Self { control, stream, broadcast, address })
    }

    /// The address in force: a port 0 has become a number.
    pub fn address(&self) -> SocketAddrV4 {
        self.address
    }

    /// Whether discovery by broadcast finds the device: another program may hold that address.
    pub fn is_found_by_broadcast(&self) -> bool {
        self.broadcast.is_some()
    }

    /// Serves applications until `stops`, with the camera in this thread.
    ///
    /// # Errors
    /// Those of the camera.
    pub fn run<C: Camera>(
        &self,
        sensor: Sensor,
        camera: &mut C,
        stops: impl Fn() -> bool,
    ) -> Result<Summary, C::Error> {
        let source_port = self.stream.local_addr().map_or(0, |address| address.port());
        let shared = Shared {
            device: Mutex::new(Device::new(sensor, *self.address.ip(), source_port)),
            changed: Condvar::new(),
            began: Instant::now(),
            ends: AtomicBool::new(false),
        };
        let shared = &shared;
        std::thread::scope(|scope| {
            scope.spawn(|| shared.answer(&self.control, &self.control));
            if let Some(broadcast) = &self.broadcast {
                scope.spawn(move || shared.answer(broadcast, &self.control));
            }
            scope.spawn(|| shared.send(&self.stream));
            shared.take_frames(camera, stops)
        })?;
        let counts = shared.device().counts();
        Ok(counts)
    }
}

/// Held by each thread: with the first that returns or panics, all end.
struct Ending<'a>(&'a Shared);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        self.0.ends.store(true, Ordering::Release);
        self.0.changed.notify_all();
    }
}

impl Shared {
    fn device(&self) -> MutexGuard<'_, Device> {
        // With a thread that panicked the server ends.
        self.device.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now(&self) -> Duration {
        self.began.elapsed()
    }

    fn has_ended(&self) -> bool {
        self.ends.load(Ordering::Acquire)
    }

    /// Waits until something changes, or until a time; at most [`LOOK`].
    fn wait(&self, device: MutexGuard<'_, Device>, until: Option<Duration>) {
        let wait = until.map_or(LOOK, |until| until.saturating_sub(self.now()).min(LOOK));
        drop(self.changed.wait_timeout(device, wait));
    }

    /// Answers what arrives at a socket. What is sent to everybody comes from other machines, too,
    /// and may only ask who is there.
    fn answer(&self, socket: &UdpSocket, answers: &UdpSocket) {
        let _ending = Ending(self);
        let is_for_all = !std::ptr::eq(socket, answers);
        let mut datagram = [0; MAX_DATAGRAM];
        while !self.has_ended() {
            let Ok((length, SocketAddr::V4(from))) = socket.recv_from(&mut datagram) else {
                continue;
            };
            let datagram = &datagram[..length];
            let asks = |request: Request<'_>| request.command == Command::Discovery;
            if is_for_all && !Request::parse(datagram).is_some_and(asks) {
                continue;
            }
            let answer = self.device().receive(self.now(), from, datagram);
            self.changed.notify_all();
            if let Some(answer) = answer {
                // An application that cannot be reached asks again.
                let _ = answers.send_to(&answer, from);
            }
        }
    }

    /// Sends the stream.
    fn send(&self, socket: &UdpSocket) {
        let _ending = Ending(self);
        let mut packet = Vec::new();
        while !self.has_ended() {
            let mut device = self.device();
            match device.next(self.now(), &mut packet) {
                Next::Packet { to, ends_block } => {
                    drop(device);
                    if ends_block {
                        self.changed.notify_all();
                    }
                    // What is lost is asked for again.
                    let _ = socket.send_to(&packet, to);
                }
                Next::Wait(Some(until)) if until.saturating_sub(self.now()) < SPIN => {
                    drop(device);
                    std::hint::spin_loop();
                }
                Next::Wait(until) => self.wait(device, until.map(|until| until - SPIN)),
            }
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
            let mut device = self.device();
            match device.order(self.now()) {
                Some(order) => {
                    drop(device);
                    let taken: Taken = camera.take(&order)?;
                    self.device().deliver(taken);
                    self.changed.notify_all();
                }
                None => {
                    let until = device.next_order().filter(|due| *due > self.now());
                    self.wait(device, until);
                }
            }
        }
        Ok(())
    }
}
