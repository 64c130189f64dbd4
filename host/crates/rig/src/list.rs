//! Serial ports and HID devices that are connected and may be rigs.

use serde::Serialize;

/// Vendor and product of our own USB devices: pid.codes' numbers for tests.
pub const USB_ID: (u16, u16) = (0x1209, 0x0001);

/// Something that may be a rig.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    /// Its address, as [`crate::Url::parse`] reads it.
    pub url: String,
    /// What the system says about it.
    pub description: String,
    /// It has the vendor and product of our own devices.
    pub ours: bool,
}

/// Serial ports and HID devices, our own first. Where the operating system lists neither, the list
/// is empty.
pub fn list() -> Vec<Found> {
    let mut found = Vec::new();
    for port in serialport::available_ports().unwrap_or_default() {
        let (description, ours) = match &port.port_type {
            serialport::SerialPortType::UsbPort(usb) => (
                format!(
                    "{:04x}:{:04x} {} {}",
                    usb.vid,
                    usb.pid,
                    usb.product.as_deref().unwrap_or("USB serial"),
                    usb.serial_number.as_deref().unwrap_or("")
                ),
                (usb.vid, usb.pid) == USB_ID,
            ),
            _ => ("serial port".into(), false),
        };
        found.push(Found { url: format!("serial://{}", port.port_name), description, ours });
    }
    if let Ok(api) = hidapi::HidApi::new() {
        for device in api.device_list() {
            let (vid, pid) = (device.vendor_id(), device.product_id());
            let serial = device.serial_number().filter(|s| !s.is_empty());
            found.push(Found {
                url: format!(
                    "hid://{vid:04x}:{pid:04x}{}",
                    serial.map_or_else(String::new, |s| format!("/{s}"))
                ),
                description: device.product_string().unwrap_or("HID device").to_string(),
                ours: (vid, pid) == USB_ID,
            });
        }
    }
    found.sort_by(|a, b| (!a.ours, &a.url).cmp(&(!b.ours, &b.url)));
    found.dedup();
    found
}
