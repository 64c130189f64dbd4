//! The link to the host: UART0 of the CMSDK, or the emulator's standard input and output.

use core::convert::Infallible;

/// The link.
pub struct Link(inner::Inner);

impl Link {
    /// Opens the link.
    pub fn open() -> Self {
        Self(inner::Inner::open())
    }
}

impl embedded_io::ErrorType for Link {
    type Error = Infallible;
}

impl embedded_io::Read for Link {
    fn read(&mut self, out: &mut [u8]) -> Result<usize, Infallible> {
        Ok(self.0.read(out))
    }
}

impl embedded_io::Write for Link {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.0.write(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

#[cfg(feature = "semihosting-link")]
mod inner {
    use semihosting::io::{Read, Stdin, Stdout, Write, stdin, stdout};

    /// One read or write moves as many bytes as there are: 80 MB/s and more in QEMU.
    pub struct Inner(Stdin, Stdout);

    impl Inner {
        pub fn open() -> Self {
            match (stdin(), stdout()) {
                (Ok(input), Ok(output)) => Self(input, output),
                _ => semihosting::process::exit(crate::status::SEMIHOSTING),
            }
        }

        /// Returns 0 when the host has closed its end.
        pub fn read(&mut self, out: &mut [u8]) -> usize {
            self.0.read(out).unwrap_or(0)
        }

        pub fn write(&mut self, bytes: &[u8]) {
            if self.1.write_all(bytes).is_err() {
                semihosting::process::exit(crate::status::SEMIHOSTING)
            }
        }
    }
}

#[cfg(feature = "uart")]
mod inner {
    use crate::log::Uart;

    /// UART0, polled. A UART is never closed.
    pub struct Inner(Uart);

    impl Inner {
        pub fn open() -> Self {
            Self(Uart::open(0))
        }

        pub fn read(&mut self, out: &mut [u8]) -> usize {
            let Some(first) = out.first_mut() else { return 0 };
            *first = self.0.receive();
            1
        }

        pub fn write(&mut self, bytes: &[u8]) {
            bytes.iter().for_each(|&byte| self.0.send(byte));
        }
    }
}
