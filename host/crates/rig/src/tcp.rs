//! Rigs behind TCP.

use super::Token;
use super::transport::{ByteLink, MAX_PACKET, Transport};
use camrig_base::{Error, ErrorCode, Result};
use camrig_rig_link::framing::Framing;
use camrig_rig_link::host::Limits;
use std::io::Write;
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

/// Longest wait for a connection, and for a rig that stops reading.
const PATIENCE: Duration = Duration::from_secs(5);

/// Connects to `HOST:PORT`, and gives the token of a rig that asks for one.
///
/// # Errors
/// A name that does not resolve, and no answer within 5 s at any of its addresses.
pub fn open(address: &str, token: Option<&Token>) -> Result<Box<dyn Transport>> {
    let name = format!("tcp://{address}");
    let failed = |e: std::io::Error| {
        Error::device(format!("no rig answers: {e}"))
            .at(&name)
            .help("correct the address, or start a rig there")
            .with_code(ErrorCode::RigUnreachable)
    };
    let mut last = std::io::ErrorKind::NotFound.into();
    for candidate in address.to_socket_addrs().map_err(failed)? {
        match TcpStream::connect_timeout(&candidate, PATIENCE) {
            Ok(stream) => return link(stream, name.clone(), token).map_err(failed),
            Err(e) => last = e,
        }
    }
    Err(failed(last))
}

fn link(
    mut stream: TcpStream,
    name: String,
    token: Option<&Token>,
) -> std::io::Result<Box<dyn Transport>> {
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(PATIENCE))?;
    if let Some(token) = token {
        stream.write_all(&token.greeting())?;
    }
    let reader = stream.try_clone()?;
    let mut limits = Limits::default();
    limits.packet_bytes = MAX_PACKET as u16;
    Ok(Box::new(ByteLink::new(name, Framing::Length, limits, Closing(stream), reader)))
}

/// Shuts both directions down when it is dropped, which ends the reading thread.
struct Closing(TcpStream);

impl std::io::Write for Closing {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.write(bytes)
    }

    /// A rig that takes a byte now and then gets no more time than one that takes none.
    fn write_all(&mut self, mut bytes: &[u8]) -> std::io::Result<()> {
        let until = Instant::now() + PATIENCE;
        while !bytes.is_empty() {
            match self.0.write(bytes) {
                Ok(0) => return Err(std::io::ErrorKind::WriteZero.into()),
                Ok(n) => bytes = &bytes[n..],
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
            if !bytes.is_empty() && Instant::now() >= until {
                return Err(std::io::ErrorKind::TimedOut.into());
            }
        }
        Ok(())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

impl Drop for Closing {
    fn drop(&mut self) {
        // An error means that it is closed already.
        let _ = self.0.shutdown(std::net::Shutdown::Both);
    }
}
