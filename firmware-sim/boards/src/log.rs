//! The log: defmt on UART1 of the CMSDK (Arm Cortex-M System Design Kit), encoded with rzCOBS.

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, Ordering};

/// A CMSDK APB UART, polled (Arm Cortex-M System Design Kit, DDI 0479, section 4.3).
#[derive(Clone, Copy)]
pub struct Uart(*mut u32);

const STATE: usize = 1;
const CONTROL: usize = 2;
const BAUD_DIVISOR: usize = 4;
/// The smallest divisor that the UART takes.
const FASTEST: u32 = 16;
const ENABLE_TX: u32 = 1;
const ENABLE_RX: u32 = 2;
const TX_FULL: u32 = 1;
#[cfg(feature = "uart")]
const RX_FULL: u32 = 2;

impl Uart {
    /// Enables UART 0 or 1 of an mps2 board in both directions.
    pub fn open(number: usize) -> Self {
        let uart = Self((0x4000_4000 + 0x1000 * number) as *mut u32);
        uart.write(BAUD_DIVISOR, FASTEST);
        uart.write(CONTROL, ENABLE_TX | ENABLE_RX);
        uart
    }

    fn read(self, register: usize) -> u32 {
        // SAFETY: `open` points at five registers of a device that is always there.
        unsafe { self.0.add(register).read_volatile() }
    }

    fn write(self, register: usize, value: u32) {
        // SAFETY: as in `read`.
        unsafe { self.0.add(register).write_volatile(value) }
    }

    /// Sends a byte.
    pub fn send(self, byte: u8) {
        while self.read(STATE) & TX_FULL != 0 {}
        self.write(0, byte.into());
    }

    /// Waits for a byte.
    #[cfg(feature = "uart")]
    pub fn receive(self) -> u8 {
        while self.read(STATE) & RX_FULL == 0 {}
        self.read(0) as u8
    }
}

#[defmt::global_logger]
struct Logger;

struct State {
    encoder: defmt::Encoder,
    section: critical_section::RestoreState,
}

struct Shared(UnsafeCell<State>);

// SAFETY: used between `acquire` and `release` only, inside a critical section on a single core.
unsafe impl Sync for Shared {}

static SHARED: Shared = Shared(UnsafeCell::new(State {
    encoder: defmt::Encoder::new(),
    section: critical_section::RestoreState::invalid(),
}));
static TAKEN: AtomicBool = AtomicBool::new(false);

/// Enables the log.
pub fn init() {
    Uart::open(1);
}

fn send(bytes: &[u8]) {
    let uart = Uart((0x4000_5000) as *mut u32);
    bytes.iter().for_each(|&byte| uart.send(byte));
}

// SAFETY: `acquire` and `release` bracket the writes with a critical section and forbid re-entry,
// as defmt::Logger asks.
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        // SAFETY: released in `release`.
        let section = unsafe { critical_section::acquire() };
        if TAKEN.swap(true, Ordering::Relaxed) {
            panic!("the log was used while it was in use");
        }
        // SAFETY: TAKEN says that nobody else has it.
        let state = unsafe { &mut *SHARED.0.get() };
        state.section = section;
        state.encoder.start_frame(send);
    }

    unsafe fn flush() {}

    unsafe fn release() {
        // SAFETY: called after `acquire`.
        let state = unsafe { &mut *SHARED.0.get() };
        state.encoder.end_frame(send);
        TAKEN.store(false, Ordering::Relaxed);
        // SAFETY: `section` is from the `acquire` before.
        unsafe { critical_section::release(state.section) };
    }

    unsafe fn write(bytes: &[u8]) {
        // SAFETY: called between `acquire` and `release`.
        unsafe { (*SHARED.0.get()).encoder.write(bytes, send) };
    }
}
