//! A device on the network: its sockets, its clock, and the camera in the calling thread.

use crate::camera::{Camera, Order, Sensor, Taken};
use crate::device::{Counts, Device, Next};
use crate::gvcp::{Command, Request};
use crate::running::{LOOK, Orders, Running};
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::time::Duration;

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

impl Orders for Device {
    fn order<C: Camera>(&mut self, now: Duration, _: &mut C) -> Option<Order> {
        Self::order(self, now)
    }

    fn next_order(&self) -> Option<Duration> {
        Self::next_order(self)
    }

    fn deliver(&mut self, taken: Taken) {
        Self::deliver(self, taken);
    }
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
        let running = &Running::new(Device::new(sensor, *self.address.ip(), source_port));
        std::thread::scope(|scope| {
            scope.spawn(|| answer(running, &self.control, &self.control));
            if let Some(broadcast) = &self.broadcast {
                scope.spawn(move || answer(running, broadcast, &self.control));
            }
            scope.spawn(|| send(running, &self.stream));
            running.take_frames(camera, stops)
        })?;
        let counts = running.device().counts();
        Ok(counts)
    }
}

/// Answers what arrives at a socket. What is sent to everybody comes from other machines, too,
/// and may only ask who is there.
fn answer(running: &Running<Device>, socket: &UdpSocket, answers: &UdpSocket) {
    let _ending = running.ending();
    let is_for_all = !std::ptr::eq(socket, answers);
    let mut datagram = [0; MAX_DATAGRAM];
    while !running.has_ended() {
        let Ok((length, SocketAddr::V4(from))) = socket.recv_from(&mut datagram) else {
            continue;
        };
        let datagram = &datagram[..length];
        let asks = |request: Request<'_>| request.command == Command::Discovery;
        if is_for_all && !Request::parse(datagram).is_some_and(asks) {
            continue;
        }
        let answer = running.device().receive(running.now(), from, datagram);
        running.tell();
        if let Some(answer) = answer {
            // An application that cannot be reached asks again.
            let _ = answers.send_to(&answer, from);
        }
    }
}

/// Sends the stream.
fn send(running: &Running<Device>, socket: &UdpSocket) {
    let _ending = running.ending();
    let mut packet = Vec::new();
    while !running.has_ended() {
        let mut device = running.device();
        match device.next(running.now(), &mut packet) {
            Next::Packet { to, ends_block } => {
                drop(device);
                if ends_block {
                    running.tell();
                }
                // What is lost is asked for again.
                let _ = socket.send_to(&packet, to);
            }
            Next::Wait(Some(until)) if until.saturating_sub(running.now()) < SPIN => {
                drop(device);
                std::hint::spin_loop();
            }
            Next::Wait(until) => running.wait(device, until.map(|until| until - SPIN)),
        }
    }
}
