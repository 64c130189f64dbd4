//! The emulator as a server: on TCP, on a pseudo-terminal, or as the device side of a USB gadget.

use super::emulator::Emulator;
use super::platform::PseudoTerminal;
use camrig_base::{Error, Result};
pub use camrig_firmware_sim::ServeError;
use camrig_rig_link::framing::Framing;
use std::fs::File;
use std::io;
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};

/// A `std` stream as an `embedded_io` link.
struct Link<T> {
    stream: T,
    /// Set while a host is served.
    busy: Option<Arc<AtomicBool>>,
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
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

impl<T> Drop for Link<T> {
    fn drop(&mut self) {
        if let Some(busy) = &self.busy {
            busy.store(false, Ordering::Release);
        }
    }
}

/// Passes on why a link ended, where it did not end in good order.
fn failures(
    mut failed: impl FnMut(ServeError<io::Error>),
) -> impl FnMut(Result<(), ServeError<io::Error>>) {
    move |outcome| outcome.unwrap_or_else(&mut failed)
}

/// Serves hosts on a TCP address, one at a time; others are turned away at once. Calls `ready`
/// with the address in force (a port 0 has become a number), and `link_failed` from another thread
/// with each fault that ends a link.
///
/// # Errors
/// An address at which this machine cannot listen.
pub fn tcp(
    address: &str,
    mut emulator: Emulator,
    ready: impl FnOnce(&str),
    link_failed: impl FnMut(ServeError<io::Error>) + Send + 'static,
) -> Result<()> {
    let failed = |e: io::Error| {
        Error::device(format!("cannot listen: {e}"))
            .at(address)
            .help("give an address of this machine and a free port, for instance 127.0.0.1:7420")
    };
    let listener = TcpListener::bind(address).map_err(failed)?;
    ready(&listener.local_addr().map_err(failed)?.to_string());
    let busy = Arc::new(AtomicBool::new(false));
    let (accepted, links) = mpsc::channel();
    let served = busy.clone();
    std::thread::spawn(move || {
        emulator.run(
            Framing::Length,
            || {
                links
                    .recv()
                    .ok()
                    .map(|stream: TcpStream| Link { stream, busy: Some(served.clone()) })
            },
            failures(link_failed),
        );
    });
    for stream in listener.incoming() {
        let stream = stream.map_err(failed)?;
        if busy.swap(true, Ordering::AcqRel) {
            // Turned away; whether that works is the other side's business.
            let _ = stream.shutdown(Shutdown::Both);
            continue;
        }
        // Without it packets wait for one another; with it or not, they arrive.
        let _ = stream.set_nodelay(true);
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
    let next = || first.take().or_else(|| open().ok()).map(|stream| Link { stream, busy: None });
    emulator.run(framing, next, failures(link_failed));
    Ok(())
}

/// Serves a pseudo-terminal. Calls `ready` with its name, and `link_failed` with the fault that
/// ended the link, if one did.
///
/// # Errors
/// An operating system without pseudo-terminals, or with none left.
pub fn pty(
    mut emulator: Emulator,
    ready: impl FnOnce(&str),
    link_failed: impl FnMut(ServeError<io::Error>),
) -> Result<()> {
    let terminal = PseudoTerminal::open()?;
    ready(&terminal.name);
    let PseudoTerminal { end, .. } = terminal;
    let mut link = Some(Link { stream: end, busy: None });
    emulator.run(Framing::Cobs, || link.take(), failures(link_failed));
    Ok(())
}
