//! Firmware for the STM32H743, with the USB connector of a Nucleo-H743ZI (PA11, PA12).

#![no_std]
#![no_main]

use cortex_m_rt::entry;
use embassy_executor::InterruptExecutor;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_stm32::peripherals::USB_OTG_FS;
use embassy_stm32::rcc;
use embassy_stm32::usb::{Driver, InterruptHandler};
use embassy_stm32::{Config, bind_interrupts, interrupt, uid};
use rig_usb_boards::usb::{PACKET, run};
use static_cell::ConstStaticCell;

const FIRMWARE: &str = concat!("camrig rig STM32H743 ", env!("CARGO_PKG_VERSION"));

bind_interrupts!(struct Interrupts {
    OTG_FS => InterruptHandler<USB_OTG_FS>;
});

static EXECUTOR: InterruptExecutor = InterruptExecutor::new();
/// Packets as they arrive: one of control and one of data.
static ARRIVED: ConstStaticCell<[u8; 4 * PACKET]> = ConstStaticCell::new([0; 4 * PACKET]);

/// Runs the USB tasks: an interrupt whose peripheral is not used.
#[interrupt]
unsafe fn UART8() {
    // SAFETY: this is the interrupt that the executor was started with.
    unsafe { EXECUTOR.on_interrupt() }
}

#[embassy_executor::task]
async fn usb(driver: Driver<'static, USB_OTG_FS>) {
    run(driver, uid::uid_hex()).await;
}

/// 400 MHz from the internal oscillator: every revision of the chip does it, on any board
/// (480 MHz needs revision V and the highest core voltage). USB has the 48-MHz oscillator, which
/// the host's frames keep in step.
fn clocks() -> Config {
    let mut config = Config::default();
    config.rcc.hsi = Some(rcc::HSIPrescaler::DIV1);
    config.rcc.hsi48 = Some(rcc::Hsi48Config { sync_from_usb: true });
    config.rcc.pll1 = Some(rcc::Pll {
        source: rcc::PllSource::HSI, // 64 MHz
        prediv: rcc::PllPreDiv::DIV4,
        mul: rcc::PllMul::MUL50, // 800 MHz
        fracn: None,
        divp: Some(rcc::PllDiv::DIV2),
        divq: None,
        divr: None,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.ahb_pre = rcc::AHBPrescaler::DIV2;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb3_pre = rcc::APBPrescaler::DIV2;
    config.rcc.apb4_pre = rcc::APBPrescaler::DIV2;
    config.rcc.voltage_scale = rcc::VoltageScale::Scale1;
    config.rcc.mux.usbsel = rcc::mux::Usbsel::HSI48;
    config
}

#[entry]
fn main() -> ! {
    let mut core = cortex_m::Peripherals::take().expect("taken once");
    // Flash and AXI SRAM have wait states. No DMA is used, so nothing bypasses the data cache.
    core.SCB.enable_icache();
    core.SCB.enable_dcache(&mut core.CPUID);
    let chip = embassy_stm32::init(clocks());
    let mut config = embassy_stm32::usb::Config::default();
    // The boards have their power from elsewhere, and most do not wire VBUS to the chip.
    config.vbus_detection = false;
    let arrived = ARRIVED.take();
    let driver =
        Driver::new_fs(chip.USB_OTG_FS, Interrupts, chip.PA12, chip.PA11, arrived, config);
    // Below the USB interrupt, which wakes the tasks.
    interrupt::UART8.set_priority(Priority::P6);
    EXECUTOR.start(interrupt::UART8).spawn(usb(driver).expect("spawned once"));
    rig_usb_boards::serve(FIRMWARE)
}
