//! Firmware of the sensor rig for the Cortex-M boards that QEMU has: mps2-an386 (M4F, f32) and mps2-an385
//! (M3, fixed point). Fixed memory, no heap; the log goes out on UART1 by defmt.

#![no_std]
#![no_main]

#[cfg(feature = "count")]
mod count;
mod link;
mod log;
mod memory;

#[cfg(feature = "count")]
use count::Counted as Calls;
use cortex_m as _; // the critical section
use defmt::{error, info};
#[cfg(not(feature = "count"))]
use camrig_firmware_sim::Plain as Calls;
use camrig_firmware_sim::serve_rig;
use camrig_rig_link::framing::Framing;

/// Name and version that the rig answers with.
pub const FIRMWARE: &str = if cfg!(feature = "float") {
    concat!("camrig rig Cortex-M4F ", env!("CARGO_PKG_VERSION"))
} else {
    concat!("camrig rig Cortex-M3 ", env!("CARGO_PKG_VERSION"))
};

#[cortex_m_rt::entry]
fn main() -> ! {
    log::init();
    memory::paint_stack();
    let Some(memory::Parts { rig, device, buffers }) = memory::take() else {
        semihosting::process::exit(2)
    };
    #[cfg(feature = "count")]
    count::start();
    let mut link = link::Link::open();
    info!("{=str} is up", FIRMWARE);
    let outcome = serve_rig::<Calls, _, { memory::RAW_BYTES }>(
        device,
        rig,
        &mut link,
        Framing::Cobs,
        buffers,
    );
    let s = device.statistics();
    info!("frames {=u32}, rows in {=u32}, out {=u32}, damaged packets {=u32}", s.frames, s.rows_in, s.rows_out, s.damaged);
    info!("stack used: {=usize} bytes of {=usize}", memory::stack_used(), memory::stack_size());
    #[cfg(feature = "count")]
    {
        let (collect, compute) = count::totals();
        info!("kilo-instructions: {=u32} to collect bands, {=u32} to compute rows", collect, compute);
    }
    if outcome.is_err() {
        error!("the link failed");
    }
    semihosting::process::exit(i32::from(outcome.is_err()))
}

/// Says where, and ends the emulation. The message is left out: its formatting takes more flash than it is
/// worth.
#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    if let Some(place) = info.location() {
        error!("panic at {=str}:{=u32}", place.file(), place.line());
    }
    semihosting::process::exit(5)
}

/// A fault ends the emulation with an error.
#[cortex_m_rt::exception]
unsafe fn HardFault(_: &cortex_m_rt::ExceptionFrame) -> ! {
    semihosting::process::exit(3)
}
