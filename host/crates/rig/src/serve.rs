//! The emulator as a server: on TCP, on a pseudo-terminal, or as the device side of a USB gadget.

use super::emulator::Emulator;
use camrig_base::{Error, Result};
use camrig_firmware_sim::ServeError;
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
                    if matches!(e.kind(), io::ErrorKind::TimedOut | io::ErrorKind::Interrupted) => {
                }
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

fn report(outcome: Result<(), ServeError<io::Error>>) {
    match outcome {
        Ok(()) => {}
        Err(ServeError::Link(e)) => eprintln!("the link ended: {e}"),
        Err(ServeError::OutOfStep) => eprintln!("the link ended: what came is not the protocol"),
    }
}

/// Serves hosts on a TCP address, one at a time; others are turned away at once. Calls `ready` with the
/// address in force (a port 0 has become a number).
pub fn tcp(address: &str, mut emulator: Emulator, ready: impl FnOnce(&str)) -> Result<()> {
    let failed = |e: io::Error| {
        Error::input(format!("cannot listen: {e}"))
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
            report,
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

/// Serves a device file: the gadget side of a USB device (`/dev/hidg0` with its report size, `/dev/ttyGS0`), or
/// any raw line.
pub fn device(path: &Path, report_bytes: Option<u16>, mut emulator: Emulator) -> Result<()> {
    let framing = report_bytes.map_or(Framing::Cobs, Framing::Report);
    let open = || File::options().read(true).write(true).open(path);
    let mut first = Some(open().map_err(|e| Error::io("open", path, e))?);
    let next = || first.take().or_else(|| open().ok()).map(|stream| Link { stream, busy: None });
    emulator.run(framing, next, report);
    Ok(())
}

/// Serves a pseudo-terminal; calls `ready` with its name.
#[cfg(unix)]
pub fn pty(mut emulator: Emulator, ready: impl FnOnce(&str)) -> Result<()> {
    use serialport::{SerialPort, TTYPort};
    let failed = |e: serialport::Error| Error::input(format!("cannot make a pseudo-terminal: {e}"));
    // The terminal lives as long as this end holds it open too.
    let (mut master, terminal) = TTYPort::pair().map_err(failed)?;
    master.set_timeout(std::time::Duration::from_secs(3600)).map_err(failed)?;
    ready(&terminal.name().unwrap_or_default());
    let mut link = Some(Link { stream: master, busy: None });
    emulator.run(Framing::Cobs, || link.take(), report);
    drop(terminal);
    Ok(())
}
