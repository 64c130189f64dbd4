//! Firmware of the camera rig for the Cortex-M boards that QEMU emulates: mps2-an386 (M4F, f32)
//! and mps2-an385 (M3, fixed point). Fixed memory, no heap; the log is written to UART1 with
//! defmt.

#![no_std]
#![no_main]

#[cfg(feature = "count")]
mod count;
mod limits;
mod link;
mod log;
mod memory;
mod stack;

#[cfg(not(feature = "count"))]
use camrig_firmware_sim::Plain as Calls;
use camrig_firmware_sim::serve_rig;
use camrig_rig_link::framing::Framing;
use cortex_m as _; // the critical section
#[cfg(feature = "count")]
use count::Counted as Calls;
use defmt::{error, info};

/// Name and version of the firmware, as the rig reports them.
pub const FIRMWARE: &str = if cfg!(feature = "float") {
    concat!("camrig rig Cortex-M4F ", env!("CARGO_PKG_VERSION"))
} else {
    concat!("camrig rig Cortex-M3 ", env!("CARGO_PKG_VERSION"))
};

/// Exit statuses of the emulation; 0 after the host has closed the link.
pub mod status {
    /// The link failed.
    pub const LINK: i32 = 1;
    /// The static memory was already taken.
    pub const MEMORY: i32 = 2;
    /// A hard fault.
    pub const HARD_FAULT: i32 = 3;
    /// Semihosting has no standard input or output.
    pub const SEMIHOSTING: i32 = 4;
    /// A panic; the log says where.
    pub const PANIC: i32 = 5;
}

#[cortex_m_rt::entry]
fn main() -> ! {
    log::init();
    stack::paint();
    let Some(memory::Parts { rig, device, buffers }) = memory::take(FIRMWARE) else {
        semihosting::process::exit(status::MEMORY)
    };
    #[cfg(feature = "count")]
    count::start();
    let mut link = link::Link::open();
    info!("{=str} is up", FIRMWARE);
    let outcome = serve_rig::<Calls, _, { limits::RAW_BYTES }>(
        device,
        rig,
        &mut link,
        Framing::Cobs,
        buffers,
    );
    let s = device.statistics();
    info!(
        "frames {=u32}, rows in {=u32}, out {=u32}, damaged packets {=u32}",
        s.frames, s.rows_in, s.rows_out, s.damaged
    );
    info!("stack used: {=usize} bytes of {=usize}", stack::used(), stack::size());
    #[cfg(feature = "count")]
    {
        let [collect, compute, link] = count::totals();
        info!(
            "kilo-instructions: {=u32} to collect bands, {=u32} to compute rows, {=u32} on the link",
            collect, compute, link
        );
    }
    if outcome.is_err() {
        error!("the link failed");
        semihosting::process::exit(status::LINK)
    }
    semihosting::process::exit(0)
}

/// Logs the place of a panic and ends the emulation. The message is left out, as formatting it
/// takes much flash.
#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    if let Some(place) = info.location() {
        error!("panic at {=str}:{=u32}", place.file(), place.line());
    }
    semihosting::process::exit(status::PANIC)
}

/// A fault ends the emulation with an error.
#[cortex_m_rt::exception]
unsafe fn HardFault(_: &cortex_m_rt::ExceptionFrame) -> ! {
    semihosting::process::exit(status::HARD_FAULT)
}
