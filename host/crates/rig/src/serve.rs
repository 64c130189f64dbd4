//! The emulator as a server: on TCP, on a pseudo-terminal, or as the device side of a USB gadget.

use super::Token;
use super::emulator::Emulator;
#[cfg(feature = "serial")]
use super::platform::PseudoTerminal;
use camrig_base::{Error, Result};
pub use camrig_firmware_sim::ServeError;
use camrig_rig_link::framing::Framing;
use camrig_rig_link::wire::tells_no_session;
use std::fs::File;
use std::io;
use std::net::{Shutdown, TcpListener, TcpStream, ToSocketAddrs};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, mpsc};
use std::time::{Duration, Instant};

/// A host that has been silent for this long is dropped when another one connects. A trade-off:
/// longer than a host needs for the light of its next frame, yet short for those who wait.
/// [`crate::Rig::keep_alive`] breaks the silence.
pub const GIVEN_UP_AFTER: Duration = Duration::from_secs(10);
/// Longest wait for the device to release a dropped host, and the polling interval.
const LET_GO: Duration = Duration::from_secs(2);
const LET_GO_STEP: Duration = Duration::from_millis(5);
/// Longest wait for a host that has just closed its link: the end arrives on another thread.
const CLOSED: Duration = Duration::from_millis(100);
/// Longest wait for the token of a connecting host, and the maximum number of hosts waited for at
/// once; further ones are rejected.
const TO_GREET: Duration = Duration::from_secs(2);
const GREETING_AT_ONCE: usize = 16;

/// Whether a host is served, and when it was last heard.
struct Guest {
    busy: AtomicBool,
    began: Instant,
    /// ms after `began`.
    heard: AtomicU64,
    /// Another handle on its link.
    link: Mutex<Option<TcpStream>>,
}

impl Guest {
    fn new() -> Self {
        let (busy, heard) = (AtomicBool::new(false), AtomicU64::new(0));
        Self { busy, began: Instant::now(), heard, link: Mutex::new(None) }
    }

    fn link(&self) -> MutexGuard<'_, Option<TcpStream>> {
        self.link.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn now(&self) -> u64 {
        self.began.elapsed().as_millis() as u64
    }

    fn hear(&self) {
        self.heard.store(self.now(), Ordering::Relaxed);
    }

    fn silence(&self) -> Duration {
        Duration::from_millis(self.now().saturating_sub(self.heard.load(Ordering::Relaxed)))
    }

    /// Takes the device for another host, if it is free. A link that has been closed is let go of
    /// within moments, one that has been silent for too long is ended.
    fn takes_another(&self, patience: Duration) -> bool {
        if self.is_free_within(CLOSED) {
            return true;
        }
        if self.silence() < patience {
            return false;
        }
        // It may have closed by itself.
        let _ = self.link().as_ref().map(|stream| stream.shutdown(Shutdown::Both));
        self.is_free_within(LET_GO)
    }

    fn is_free_within(&self, wait: Duration) -> bool {
        let until = Instant::now() + wait;
        loop {
            if !self.busy.swap(true, Ordering::AcqRel) {
                return true;
            }
            if Instant::now() >= until {
                return false;
            }
            std::thread::sleep(LET_GO_STEP);
        }
    }
}

/// Whether other machines can connect to what listens at an address: anything but the loopback
/// interface.
pub fn is_open_to_others(address: &str) -> bool {
    address.to_socket_addrs().is_ok_and(|mut all| all.any(|a| !a.ip().is_loopback()))
}

/// A `std` stream as an `embedded_io` link.
struct Link<T> {
    stream: T,
    /// The host at the other end, where there may be others.
    guest: Option<Arc<Guest>>,
}

impl<T> embedded_io::ErrorType for Link<T> {
    type Error = io::Error;
}

impl<T: io::Read> embedded_io::Read for Link<T> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        loop {
            match self.stream.read(out) {
                Err(e)
                    if matches!(
                        e.kind(),
                        io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
                    ) => {}
                other => return other,
            }
        }
    }
}

impl<T: io::Write> embedded_io::Write for Link<T> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // The device answers valid packets alone, and those of a peer that never said Hello by a
        // refusal: other bytes and such packets are no sign of a host.
        let refuses = |bytes: &[u8]| {
            let Some((length, rest)) = bytes.split_first_chunk() else { return false };
            let packet = rest.get(..u32::from_le_bytes(*length) as usize);
            packet.is_some_and(tells_no_session)
        };
        if let Some(guest) = self.guest.as_ref().filter(|_| !refuses(bytes)) {
            guest.hear();
        }
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

impl<T> Drop for Link<T> {
    fn drop(&mut self) {
        if let Some(guest) = &self.guest {
            *guest.link() = None;
            guest.busy.store(false, Ordering::Release);
        }
    }
}

/// Reports why a link ended, unless it was closed properly.
fn failures(
    mut failed: impl FnMut(ServeError<io::Error>),
) -> impl FnMut(Result<(), ServeError<io::Error>>) {
    move |outcome| outcome.unwrap_or_else(&mut failed)
}

/// Takes in what connects: at once without a token, and otherwise who begins with it within
/// [`TO_GREET`]. Others are turned away without a word.
fn door(
    listener: TcpListener,
    token: Option<Token>,
    admitted: mpsc::Sender<io::Result<TcpStream>>,
) {
    let greeting = Arc::new(AtomicUsize::new(0));
    for stream in listener.incoming() {
        let (Ok(stream), Some(token)) = (&stream, &token) else {
            if admitted.send(stream).is_err() {
                return;
            }
            continue;
        };
        // So that a greeting that does not come holds up no other.
        if greeting.fetch_add(1, Ordering::AcqRel) >= GREETING_AT_ONCE {
            greeting.fetch_sub(1, Ordering::AcqRel);
            continue;
        }
        let (token, admitted, greeting) = (token.clone(), admitted.clone(), greeting.clone());
        let Ok(stream) = stream.try_clone() else { continue };
        std::thread::spawn(move || {
            if greets(&stream, &token) {
                // The server may have ended.
                let _ = admitted.send(Ok(stream));
            }
            greeting.fetch_sub(1, Ordering::AcqRel);
        });
    }
}

/// Whether a host begins with the token in time.
fn greets(stream: &TcpStream, token: &Token) -> bool {
    let until = Instant::now() + TO_GREET;
    let timed = Timed { stream, until };
    token.is_greeted(timed) && stream.set_read_timeout(None).is_ok()
}

/// Reads until a time, however slowly bytes come.
struct Timed<'a> {
    stream: &'a TcpStream,
    until: Instant,
}

impl io::Read for Timed<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.stream.set_read_timeout(Some(left))?;
        (&mut &*self.stream).read(out)
    }
}

/// Serves hosts on a TCP address, one at a time; others are turned away, unless the one served has
/// been silent, or sent nothing valid, for [`GIVEN_UP_AFTER`]. With a token, only hosts that know
/// it are
/// served, and no other has an effect on them. Calls `ready` with the address in force (a port 0
/// has become a number), and `link_failed` from another thread with each fault that ends a link.
///
/// # Errors
/// An address at which this machine cannot listen.
pub fn tcp(
    address: &str,
    token: Option<Token>,
    emulator: Emulator,
    ready: impl FnOnce(&str),
    link_failed: impl FnMut(ServeError<io::Error>) + Send + 'static,
) -> Result<()> {
    tcp_patient((address, token), emulator, ready, link_failed, GIVEN_UP_AFTER)
}

fn tcp_patient(
    (address, token): (&str, Option<Token>),
    mut emulator: Emulator,
    ready: impl FnOnce(&str),
    link_failed: impl FnMut(ServeError<io::Error>) + Send + 'static,
    patience: Duration,
) -> Result<()> {
    let failed = |e: io::Error| {
        Error::device(format!("cannot listen: {e}"))
            .at(address)
            .help("give an address of this machine and a free port, for instance 127.0.0.1:7420")
    };
    let listener = TcpListener::bind(address).map_err(failed)?;
    ready(&listener.local_addr().map_err(failed)?.to_string());
    let guest = Arc::new(Guest::new());
    let (accepted, links) = mpsc::channel();
    let served = guest.clone();
    std::thread::spawn(move || {
        emulator.run(
            Framing::Length,
            || {
                links
                    .recv()
                    .ok()
                    .map(|stream: TcpStream| Link { stream, guest: Some(served.clone()) })
            },
            failures(link_failed),
        );
    });
    let (admitted, hosts) = mpsc::channel();
    std::thread::spawn(move || door(listener, token, admitted));
    for stream in hosts {
        let stream = stream.map_err(failed)?;
        if !guest.takes_another(patience) {
            // Turned away; whether that works is the other side's business.
            let _ = stream.shutdown(Shutdown::Both);
            continue;
        }
        // Without it packets wait for one another; with it or not, they arrive.
        let _ = stream.set_nodelay(true);
        guest.hear();
        *guest.link() = stream.try_clone().ok();
        if accepted.send(stream).is_err() {
            break;
        }
    }
    Ok(())
}

/// Serves a device file: the gadget side of a USB device (`/dev/hidg0` with the bytes of its
/// reports, `/dev/ttyGS0`), or any raw line. Calls `link_failed` with each fault that ends a link.
///
/// # Errors
/// A device file that cannot be opened.
pub fn device(
    path: &Path,
    report_bytes: Option<u16>,
    mut emulator: Emulator,
    link_failed: impl FnMut(ServeError<io::Error>),
) -> Result<()> {
    let framing = report_bytes.map_or(Framing::Cobs, Framing::Report);
    let open = || File::options().read(true).write(true).open(path);
    let mut first = Some(open().map_err(|e| Error::io("open", path, e))?);
    let next = || first.take().or_else(|| open().ok()).map(|stream| Link { stream, guest: None });
    emulator.run(framing, next, failures(link_failed));
    Ok(())
}

/// Serves a pseudo-terminal. Calls `ready` with its name, and `link_failed` with the fault that
/// ended the link, if one did.
///
/// # Errors
/// An operating system without pseudo-terminals, or with none left.
#[cfg(feature = "serial")]
pub fn pty(
    mut emulator: Emulator,
    ready: impl FnOnce(&str),
    link_failed: impl FnMut(ServeError<io::Error>),
) -> Result<()> {
    let terminal = PseudoTerminal::open()?;
    ready(&terminal.name);
    let PseudoTerminal { end, .. } = terminal;
    let mut link = Some(Link { stream: end, guest: None });
    emulator.run(Framing::Cobs, || link.take(), failures(link_failed));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rig;

    #[test]
    fn a_silent_host_is_given_up_when_another_one_comes_and_a_talking_one_is_not() {
        const PATIENCE: Duration = Duration::from_millis(600);
        let (sender, receiver) = mpsc::channel();
        std::thread::spawn(move || {
            let ready = |address: &str| sender.send(address.to_string()).unwrap();
            tcp_patient(
                ("127.0.0.1:0", None),
                Emulator::with_threads(1, None),
                ready,
                drop,
                PATIENCE,
            )
        });
        let address = receiver.recv().unwrap();
        let _silent = TcpStream::connect(&address).unwrap();
        let url = format!("tcp://{address}");
        assert!(Rig::open(&url).is_err(), "it has not been silent for long");
        std::thread::sleep(PATIENCE);
        let mut first = Rig::open(&url).unwrap();
        for _ in 0..10 {
            std::thread::sleep(PATIENCE / 10);
            first.keep_alive().unwrap();
        }
        assert!(Rig::open(&url).is_err(), "the first one talks");
        std::thread::sleep(2 * PATIENCE);
        assert!(Rig::open(&url).is_ok(), "it has been silent since");
        assert!(first.keep_alive().is_err(), "it was given up");
    }

    /// Neither bytes without a valid packet nor packets without a Hello are signs of a host.
    #[test]
    fn a_peer_that_never_said_hello_is_given_up() {
        use camrig_rig_link::wire::{Header, Kind, seal};
        let mut sealed = [0; 20];
        let header = Header { kind: Kind::Control, flags: 0, session: 7, seq: 1, ack: 0 };
        seal(&mut sealed, header, 8);
        for packet in [[b'x'; 20], sealed] {
            is_given_up(&packet);
        }
    }

    fn is_given_up(packet: &[u8; 20]) {
        const PATIENCE: Duration = Duration::from_millis(600);
        let (sender, receiver) = mpsc::channel();
        std::thread::spawn(move || {
            let ready = |address: &str| sender.send(address.to_string()).unwrap();
            let emulator = Emulator::with_threads(1, None);
            tcp_patient(("127.0.0.1:0", None), emulator, ready, drop, PATIENCE)
        });
        let address = receiver.recv().unwrap();
        let mut noise = TcpStream::connect(&address).unwrap();
        for _ in 0..10 {
            let packet = [&20_u32.to_le_bytes()[..], packet].concat();
            io::Write::write_all(&mut noise, &packet).unwrap();
            std::thread::sleep(PATIENCE / 5);
        }
        assert!(Rig::open(&format!("tcp://{address}")).is_ok());
    }

    /// The end of a link arrives on another thread than the next host.
    #[test]
    fn a_host_may_come_back_at_once() {
        let (sender, receiver) = mpsc::channel();
        std::thread::spawn(move || {
            let ready = |address: &str| sender.send(address.to_string()).unwrap();
            tcp("127.0.0.1:0", None, Emulator::with_threads(1, None), ready, drop)
        });
        let url = format!("tcp://{}", receiver.recv().unwrap());
        for _ in 0..50 {
            Rig::open(&url).unwrap();
        }
    }

    #[test]
    fn with_a_token_others_are_not_served_and_hold_nobody_up() {
        let (sender, receiver) = mpsc::channel();
        std::thread::spawn(move || {
            let token = Token::parse("right").unwrap();
            let ready = |address: &str| sender.send(address.to_string()).unwrap();
            tcp("127.0.0.1:0", Some(token), Emulator::with_threads(1, None), ready, drop)
        });
        let address = receiver.recv().unwrap();
        // Silent strangers wait for nothing, and take no place.
        let _strangers: Vec<_> =
            (0..GREETING_AT_ONCE / 2).map(|_| TcpStream::connect(&address).unwrap()).collect();
        for url in [format!("tcp://{address}"), format!("tcp://{address}?token=wrong")] {
            let said = Rig::open(&url).err().unwrap().to_string();
            assert!(said.contains("?token="), "{said}");
        }
        let mut rig = Rig::open(&format!("tcp://{address}?token=right")).unwrap();
        assert!(rig.read_register(0x0005).is_ok());
        assert!(Rig::open(&format!("tcp://{address}?token=wrong")).is_err());
        rig.keep_alive().unwrap();
    }

    #[test]
    fn only_loopback_addresses_are_closed_to_others() {
        for address in ["127.0.0.1:0", "[::1]:7420", "127.0.0.2:1"] {
            assert!(!is_open_to_others(address), "{address}");
        }
        for address in ["0.0.0.0:0", "[::]:7420", "192.168.1.2:1"] {
            assert!(is_open_to_others(address), "{address}");
        }
    }
}
