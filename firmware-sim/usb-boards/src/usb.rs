//! The USB device: a serial port (CDC-ACM), so that no operating system needs a driver.

use crate::link::{FROM_RIG, TO_RIG, close};
use embassy_futures::join::join4;
use embassy_usb::class::cdc_acm::{CdcAcmClass, ControlChanged, Receiver, Sender, State};
use embassy_usb::driver::Driver;
use embassy_usb::{Builder, Config};
use static_cell::StaticCell;

/// Vendor and product: those that `camrig rig list` knows as ours (`camrig_rig::USB_ID`,
/// pid.codes' numbers for tests).
const USB_ID: (u16, u16) = (0x1209, 0x0001);
/// Largest packet of a bulk endpoint at full speed, bytes.
pub const PACKET: usize = 64;

/// What the USB stack keeps.
struct Memory {
    configuration: [u8; 128],
    capabilities: [u8; 16],
    control: [u8; PACKET],
    state: State<'static>,
}

static MEMORY: StaticCell<Memory> = StaticCell::new();

/// Runs the device, for ever. `serial`: its serial number.
pub async fn run<D: Driver<'static>>(driver: D, serial: &'static str) {
    let memory = MEMORY.init(Memory {
        configuration: [0; 128],
        capabilities: [0; 16],
        control: [0; PACKET],
        state: State::new(),
    });
    let mut config = Config::new(USB_ID.0, USB_ID.1);
    config.manufacturer = Some("camrig");
    config.product = Some("camrig rig");
    config.serial_number = Some(serial);
    let mut builder = Builder::new(
        driver,
        config,
        &mut memory.configuration,
        &mut memory.capabilities,
        &mut [],
        &mut memory.control,
    );
    let port = CdcAcmClass::new(&mut builder, &mut memory.state, PACKET as u16);
    let mut device = builder.build();
    let (sender, receiver, control) = port.split_with_control();
    join4(device.run(), receive(receiver), send(sender), watch(control)).await;
}

/// From the host to the rig. While the pipe is full the host waits.
async fn receive<D: Driver<'static>>(mut port: Receiver<'static, D>) {
    let mut packet = [0; PACKET];
    loop {
        port.wait_connection().await;
        while let Ok(length) = port.read_packet(&mut packet).await {
            TO_RIG.write_all(&packet[..length]).await;
        }
    }
}

/// From the rig to the host.
async fn send<D: Driver<'static>>(mut port: Sender<'static, D>) {
    let mut packet = [0; PACKET];
    loop {
        port.wait_connection().await;
        loop {
            let length = FROM_RIG.read(&mut packet).await;
            let mut sent = port.write_packet(&packet[..length]).await;
            // The host waits for more after a full packet: an empty one says that this is all.
            if length == PACKET && FROM_RIG.is_empty() {
                sent = sent.and(port.write_packet(&[]).await);
            }
            if sent.is_err() {
                break;
            }
        }
    }
}

/// Ends the session when the host closes the port, which takes back "data terminal ready", or
/// resets the device. That signal is not waited for at the beginning: not every host sets it.
async fn watch(control: ControlChanged<'static>) {
    let mut open = false;
    loop {
        control.control_changed().await;
        if open && !control.dtr() {
            close();
        }
        open = control.dtr();
    }
}
