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

/// Serial ports and HID devices (each with the feature of its name), our own first. Where the
/// operating system lists neither, the list is empty.
pub fn list() -> Vec<Found> {
    let mut found: Vec<Found> = Vec::new();
    #[cfg(feature = "serial")]
    found.extend(serial_ports());
    #[cfg(feature = "hid")]
    found.extend(hid_devices());
    found.sort_by(|a, b| (!a.ours, &a.url).cmp(&(!b.ours, &b.url)));
    found.dedup();
    found
}

#[cfg(feature = "serial")]
fn serial_ports() -> impl Iterator<Item = Found> {
    serialport::available_ports().unwrap_or_default().into_iter().map(|port| {
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
        Found { url: format!("serial://{}", port.port_name), description, ours }
    })
}

#[cfg(feature = "hid")]
fn hid_devices() -> Vec<Found> {
    let Ok(api) = hidapi::HidApi::new() else { return Vec::new() };
    let found = api.device_list().map(|device| {
        let (vid, pid) = (device.vendor_id(), device.product_id());
        let serial = device.serial_number().filter(|s| !s.is_empty());
        let serial = serial.map_or_else(String::new, |s| format!("/{s}"));
        Found {
            url: format!("hid://{vid:04x}:{pid:04x}{serial}"),
            description: device.product_string().unwrap_or("HID device").to_string(),
            ours: (vid, pid) == USB_ID,
        }
    });
    found.collect()
}
