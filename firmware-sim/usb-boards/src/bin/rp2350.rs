//! Firmware for the RP2350, as on a Pico 2: one of its two Cortex-M33 cores.

#![no_std]
#![no_main]

use core::fmt::Write;
use cortex_m_rt::entry;
use embassy_executor::InterruptExecutor;
use embassy_rp::interrupt::{InterruptExt, Priority};
use embassy_rp::peripherals::USB;
use embassy_rp::usb::{Driver, InterruptHandler};
use embassy_rp::{bind_interrupts, interrupt, otp};
use rig_usb_boards::usb::run;
use static_cell::StaticCell;

const FIRMWARE: &str = concat!("camrig rig RP2350 ", env!("CARGO_PKG_VERSION"));

bind_interrupts!(struct Interrupts {
    USBCTRL_IRQ => InterruptHandler<USB>;
});

static EXECUTOR: InterruptExecutor = InterruptExecutor::new();
static SERIAL: StaticCell<heapless::String<16>> = StaticCell::new();

/// Runs the USB tasks: an interrupt that software alone raises.
#[interrupt]
unsafe fn SWI_IRQ_0() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { EXECUTOR.on_interrupt() }
}

#[embassy_executor::task]
async fn usb(driver: Driver<'static, USB>, serial: &'static str) {
    run(driver, serial).await;
}

#[entry]
fn main() -> ! {
    // 150 MHz from the crystal of 12 MHz, which is embassy's default.
    let chip = embassy_rp::init(embassy_rp::config::Config::default());
    let serial = SERIAL.init(heapless::String::new());
    // The chip's own number, in its one-time programmable memory; 16 digits fit.
    let _ = write!(serial, "{:016X}", otp::get_chipid().unwrap_or(0));
    let driver = Driver::new(chip.USB, Interrupts);
    // Below the USB interrupt, which wakes the tasks.
    interrupt::SWI_IRQ_0.set_priority(Priority::P2);
    EXECUTOR.start(interrupt::SWI_IRQ_0).spawn(usb(driver, serial).expect("spawned once"));
    rig_usb_boards::serve(FIRMWARE)
}
