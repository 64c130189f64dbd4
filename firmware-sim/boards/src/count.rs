//! Counts instructions: with QEMU's `-icount shift=10` an instruction takes 1024 ns of the board's
//! time, and TIMER0 of the CMSDK (Arm Cortex-M System Design Kit) has ticks of 40 ns. The count is
//! exact to one tick and the same in every run. Instructions are not cycles: neither a pipeline
//! nor flash wait states are emulated.

use camrig_firmware_sim::running::AnyRunning;
use camrig_firmware_sim::{Dispatch, Plain};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

const TIMER0: *mut u32 = 0x4000_0000 as *mut u32;
const VALUE: usize = 1;
const RELOAD: usize = 2;

/// Ticks per instruction: 1024 / 40.
const TICKS_PER_16_INSTRUCTIONS: u64 = 16 * 1024 / 40;

/// Thousands of instructions, and the remainder, for collecting bands and for computing rows.
static COLLECT: Counter = Counter::new();
static COMPUTE: Counter = Counter::new();

struct Counter {
    kilo: AtomicU32,
    rest: AtomicU32,
}

impl Counter {
    const fn new() -> Self {
        Self { kilo: AtomicU32::new(0), rest: AtomicU32::new(0) }
    }

    fn time(&self, work: impl FnOnce()) {
        let start = now();
        work();
        let ticks = u64::from(start.wrapping_sub(now())); // It counts down.
        let count = (ticks * 16 / TICKS_PER_16_INSTRUCTIONS) as u32 + self.rest.load(Relaxed);
        self.kilo.fetch_add(count / 1000, Relaxed);
        self.rest.store(count % 1000, Relaxed);
    }
}

fn now() -> u32 {
    // SAFETY: a register of a timer that is always there.
    unsafe { TIMER0.add(VALUE).read_volatile() }
}

/// Starts the timer.
pub fn start() {
    for (register, value) in [(RELOAD, u32::MAX), (VALUE, u32::MAX), (0, 1)] {
        // SAFETY: as in `now`.
        unsafe { TIMER0.add(register).write_volatile(value) };
    }
}

/// Thousands of instructions so far for (collecting bands, computing rows).
pub fn totals() -> (u32, u32) {
    (COLLECT.kilo.load(Relaxed), COMPUTE.kilo.load(Relaxed))
}

/// Calls the row functions and counts.
pub struct Counted;

impl Dispatch for Counted {
    fn units(running: &mut AnyRunning<'_>, row: u16, first: u16, units: &[u8]) {
        COLLECT.time(|| Plain::units(running, row, first, units));
    }

    fn raw_row(running: &mut AnyRunning<'_>, row: u16, out: &mut [u8]) {
        COMPUTE.time(|| Plain::raw_row(running, row, out));
    }
}
