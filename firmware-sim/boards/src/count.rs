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

/// Instructions per tick: 40 / 1024.
const INSTRUCTIONS_PER_TICK: (u64, u64) = (5, 128);

/// Collecting bands.
static COLLECT: Counter = Counter::new();
/// Computing rows.
static COMPUTE: Counter = Counter::new();
/// Everything between those: packets in and out.
static LINK: Counter = Counter::new();
/// The timer when the present stretch began.
static BEGAN: AtomicU32 = AtomicU32::new(0);

/// Ticks: the lower half and how often it overflowed.
struct Counter {
    low: AtomicU32,
    high: AtomicU32,
}

impl Counter {
    const fn new() -> Self {
        Self { low: AtomicU32::new(0), high: AtomicU32::new(0) }
    }

    /// Ends a stretch and begins the next one, so that counting itself is in neither.
    fn lap(&self) {
        let ticks = BEGAN.load(Relaxed).wrapping_sub(now()); // It counts down.
        let low = self.low.fetch_add(ticks, Relaxed);
        self.high.fetch_add(u32::from(low.checked_add(ticks).is_none()), Relaxed);
        BEGAN.store(now(), Relaxed);
    }

    fn kilo_instructions(&self) -> u32 {
        let halves = [&self.high, &self.low].map(|half| u64::from(half.load(Relaxed)));
        let (times, over) = INSTRUCTIONS_PER_TICK;
        ((halves[0] << 32 | halves[1]) * times / over / 1000) as u32
    }
}

/// Counts work, and what was done before it for the link.
fn count(counter: &Counter, work: impl FnOnce()) {
    LINK.lap();
    work();
    counter.lap();
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
    BEGAN.store(now(), Relaxed);
}

/// Thousands of instructions so far for collecting bands, computing rows, and the link.
pub fn totals() -> [u32; 3] {
    LINK.lap();
    [&COLLECT, &COMPUTE, &LINK].map(Counter::kilo_instructions)
}

/// Calls the row functions and counts.
pub struct Counted;

impl Dispatch for Counted {
    fn units(running: &mut AnyRunning<'_, '_>, row: u16, first: u16, units: &[u8]) {
        count(&COLLECT, || Plain::units(running, row, first, units));
    }

    fn raw_row(running: &mut AnyRunning<'_, '_>, row: u16, out: &mut [u8]) {
        count(&COMPUTE, || Plain::raw_row(running, row, out));
    }
}
