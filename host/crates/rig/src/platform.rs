//! Pseudo-terminals, which only some operating systems have. Nothing else in this crate names one.
//! The crate of serial ports makes them.

use camrig_base::{Error, Result};
use serialport::SerialPort;

/// A pseudo-terminal: a serial line between this process and whoever opens its name.
pub struct PseudoTerminal {
    /// The end of this process.
    pub end: Box<dyn SerialPort>,
    /// The name by which a host opens the other end.
    pub name: String,
    /// The other end, held open so that the line outlasts its hosts.
    _other: Box<dyn SerialPort>,
}

impl PseudoTerminal {
    /// Makes a pseudo-terminal.
    ///
    /// # Errors
    /// An operating system without pseudo-terminals, or with none left.
    #[cfg(unix)]
    pub fn open() -> Result<Self> {
        /// A read that times out is tried again, so that this is only how often.
        const READ_TIMEOUT: std::time::Duration = std::time::Duration::from_secs(3600);
        let failed =
            |e: serialport::Error| Error::device(format!("cannot make a pseudo-terminal: {e}"));
        let (mut end, other) = serialport::TTYPort::pair().map_err(failed)?;
        end.set_timeout(READ_TIMEOUT).map_err(failed)?;
        let name = other.name().unwrap_or_default();
        Ok(Self { end: Box::new(end), name, _other: Box::new(other) })
    }

    /// Makes a pseudo-terminal.
    ///
    /// # Errors
    /// Always: this operating system has none.
    #[cfg(not(unix))]
    pub fn open() -> Result<Self> {
        Err(Error::unsupported("no pseudo-terminals on this system")
            .help("serve hosts on a TCP address")
            .with_code(camrig_base::ErrorCode::NoPseudoTerminals))
    }
}
