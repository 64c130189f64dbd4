//! Where streams of frames come from: standard input, a TCP port of this machine, a Unix socket.
//!
//! camrig listens, and one writer connects; who connects first is served, and the port is closed.
//! TCP is for this machine alone: frames are not encrypted, and nobody says who sends them.

use camrig_base::{Error, Result};
use std::io::{self, Read};
use std::net::{SocketAddr, TcpListener};
use std::time::{Duration, Instant};

/// How long a writer may take to connect: a renderer has its scene to load.
const CONNECT: Duration = Duration::from_secs(60);
/// Time between two looks for one.
const LOOK: Duration = Duration::from_millis(20);
const TCP: &str = "tcp://";
const UNIX: &str = "unix:";

/// Whether a scene's name is that of a socket.
pub(super) fn is_socket(spec: &str) -> bool {
    spec.starts_with(TCP) || spec.starts_with(UNIX)
}

/// Waits for a writer at the socket that `spec` names.
///
/// # Errors
/// An address of another machine, one that is taken, and none that connects within a minute.
pub(super) fn connected(spec: &str) -> Result<Box<dyn Read + Send>> {
    match (spec.strip_prefix(TCP), spec.strip_prefix(UNIX)) {
        (Some(address), _) => tcp(address),
        (_, Some(path)) => unix(path),
        _ => Err(Error::input(format!("{spec:?} is no socket"))),
    }
    .map_err(|e| e.at(spec))
}

fn failed(error: &io::Error) -> Error {
    Error::device(format!("cannot listen: {error}"))
}

/// The first connection that `accept` gives; it does not wait.
fn first<S>(mut accept: impl FnMut() -> io::Result<S>) -> Result<S> {
    let end = Instant::now() + CONNECT;
    loop {
        match accept() {
            Ok(stream) => return Ok(stream),
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => {}
            Err(e) => return Err(failed(&e)),
        }
        if Instant::now() >= end {
            let seconds = CONNECT.as_secs();
            return Err(Error::limit(format!("no writer connected within {seconds} s"))
                .help("start it so that it connects to this address"));
        }
        std::thread::sleep(LOOK);
    }
}

fn tcp(address: &str) -> Result<Box<dyn Read + Send>> {
    let wrong = || {
        Error::input(format!("{address:?} is no port of this machine"))
            .help("use tcp://127.0.0.1:PORT; from another machine, forward the port (ssh -L)")
    };
    let address: SocketAddr = address.parse().map_err(|_| wrong())?;
    if !address.ip().is_loopback() {
        return Err(wrong());
    }
    let listener = TcpListener::bind(address).map_err(|e| failed(&e))?;
    listener.set_nonblocking(true).map_err(|e| failed(&e))?;
    let stream = first(|| listener.accept().map(|(stream, _)| stream))?;
    stream.set_nonblocking(false).map_err(|e| failed(&e))?;
    Ok(Box::new(stream))
}

#[cfg(unix)]
fn unix(path: &str) -> Result<Box<dyn Read + Send>> {
    /// Removes the socket's name: once a writer is there, nobody else is to find it.
    struct Named<'a>(&'a str);
    impl Drop for Named<'_> {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(self.0);
        }
    }
    let listener = std::os::unix::net::UnixListener::bind(path).map_err(|e| failed(&e))?;
    let _named = Named(path);
    listener.set_nonblocking(true).map_err(|e| failed(&e))?;
    let stream = first(|| listener.accept().map(|(stream, _)| stream))?;
    stream.set_nonblocking(false).map_err(|e| failed(&e))?;
    Ok(Box::new(stream))
}

#[cfg(not(unix))]
fn unix(_: &str) -> Result<Box<dyn Read + Send>> {
    Err(Error::unsupported("Unix sockets on this system").help("use tcp://127.0.0.1:PORT"))
}
