//! The rig's end of the link: blocking `embedded_io` over two pipes, whose other ends the USB tasks
//! have.

use core::cell::Cell;
use core::convert::Infallible;
use cortex_m::asm::wfe;
use critical_section::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;

/// Bytes that may wait in either direction: 4 ms of full-speed USB, so that USB goes on while a
/// row is computed.
const WAITING: usize = 4096;

/// From the host.
pub static TO_RIG: Pipe<CriticalSectionRawMutex, WAITING> = Pipe::new();
/// To the host.
pub static FROM_RIG: Pipe<CriticalSectionRawMutex, WAITING> = Pipe::new();
/// The host has closed the port, and the rig has not noticed yet.
static CLOSED: Mutex<Cell<bool>> = Mutex::new(Cell::new(false));

/// The host has closed the port: what is under way is of no use any more.
pub fn close() {
    critical_section::with(|section| {
        CLOSED.borrow(section).set(true);
        TO_RIG.clear();
        FROM_RIG.clear();
    });
}

/// The link.
pub struct Link;

impl embedded_io::ErrorType for Link {
    type Error = Infallible;
}

impl embedded_io::Read for Link {
    /// Waits for bytes; 0 after the host has closed the port.
    fn read(&mut self, out: &mut [u8]) -> Result<usize, Infallible> {
        wait(|section| {
            if CLOSED.borrow(section).replace(false) {
                return Some(0);
            }
            TO_RIG.try_read(out).ok()
        })
    }
}

impl embedded_io::Write for Link {
    /// Waits for room. After the host has closed the port nobody wants the bytes.
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        wait(|section| {
            if CLOSED.borrow(section).get() {
                return Some(bytes.len());
            }
            FROM_RIG.try_write(bytes).ok()
        })
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// Tries, and sleeps until the next interrupt, until there is an outcome. An interrupt between the
/// two is not lost: the return from it is an event, which `wfe` does not sleep through.
fn wait(
    mut attempt: impl FnMut(critical_section::CriticalSection<'_>) -> Option<usize>,
) -> Result<usize, Infallible> {
    loop {
        if let Some(outcome) = critical_section::with(&mut attempt) {
            return Ok(outcome);
        }
        wfe();
    }
}
