//! Rigs that are USB devices of the class HID.

use super::transport::{MAX_PACKET, Transport};
use camrig_base::{Error, ErrorCode, Result};
use camrig_rig_link::framing::{Framing, Receiver, Sender};
use camrig_rig_link::host::Limits;
use hidapi::{HidApi, HidDevice};
use std::time::{Duration, Instant};

/// Reports that may be under way from the device: Linux drops unread ones beyond 63 without a
/// word, other systems beyond 30.
const REPORTS_UNDER_WAY: u16 = 16;

/// Reports of an earlier session that are read at most: far more than any system keeps.
const OLD_REPORTS: usize = 1024;

/// Bytes of a report where the descriptor cannot be read: the largest of a full-speed interrupt
/// endpoint (USB 2.0, 5.7.3).
const DEFAULT_REPORT: u16 = 64;

/// Longest wait for a report that is asked of the system at once.
const LONGEST_READ: Duration = Duration::from_secs(60);

/// Report sizes that can carry the protocol, bytes.
const REPORT_BYTES: std::ops::RangeInclusive<u16> = 8..=4096;

/// Opens a device. Its report size is taken from its report descriptor.
///
/// # Errors
/// No such device, one that another program holds or that this user may not open.
pub fn open(vid: u16, pid: u16, serial: Option<&str>) -> Result<Box<dyn Transport>> {
    let name = format!("hid://{vid:04x}:{pid:04x}");
    let api = HidApi::new().map_err(|e| Error::device(format!("no access to HID: {e}")))?;
    let there = api.device_list().any(|d| {
        (d.vendor_id(), d.product_id()) == (vid, pid)
            && serial.is_none_or(|s| d.serial_number() == Some(s))
    });
    if !there {
        let seen: Vec<String> = api
            .device_list()
            .map(|d| format!("{:04x}:{:04x}", d.vendor_id(), d.product_id()))
            .collect();
        let seen = if seen.is_empty() { "none".into() } else { seen.join(", ") };
        return Err(Error::device("no such HID device is connected")
            .at(name)
            .help(format!("connected: {seen}"))
            .with_code(ErrorCode::RigNotFound));
    }
    let device = match serial {
        Some(serial) => api.open_serial(vid, pid, serial),
        None => api.open(vid, pid),
    };
    let device = device.map_err(|e| {
        Error::device(format!("cannot open the HID device: {e}"))
            .at(&name)
            .help("close other programs that use it, and check the permissions of /dev/hidraw*")
    })?;
    let report = report_size(&device).unwrap_or(DEFAULT_REPORT);
    // Reports of an earlier session.
    let mut old = vec![0; usize::from(report)];
    let mut left = || matches!(device.read_timeout(&mut old, 0), Ok(n) if n > 0);
    (0..OLD_REPORTS).take_while(|_| left()).for_each(drop);
    let framing = Framing::Report(report);
    Ok(Box::new(HidLink {
        name,
        device,
        sender: Sender::new(framing, vec![0; report.into()]),
        out: vec![0; MAX_PACKET],
        receiver: Receiver::new(framing, vec![0; framing.max_encoded(MAX_PACKET)]),
        report: vec![0; report.into()],
        used: report.into(),
        bytes: (0, 0),
    }))
}

/// Bytes of an input report: report count x report size of the descriptor's only input (items 0x9x
/// and 0x7x of the HID specification 1.11, section 6.2.2).
fn report_size(device: &HidDevice) -> Option<u16> {
    let mut descriptor = [0; hidapi::MAX_REPORT_DESCRIPTOR_SIZE];
    let n = device.get_report_descriptor(&mut descriptor).ok()?;
    input_report_bytes(descriptor.get(..n)?)
}

fn input_report_bytes(mut items: &[u8]) -> Option<u16> {
    let (mut bits, mut count) = (0u32, 0u32);
    while let [head, rest @ ..] = items {
        let size = [0, 1, 2, 4][usize::from(head & 3)];
        let (data, rest) = rest.split_at_checked(size)?;
        let value = data.iter().rev().fold(0u32, |v, &byte| v << 8 | u32::from(byte));
        match head & 0xfc {
            0x74 => bits = value,
            0x94 => count = value,
            0x80 => {
                let bytes = bits.checked_mul(count)? / 8;
                return u16::try_from(bytes).ok().filter(|b| REPORT_BYTES.contains(b));
            }
            _ => {}
        }
        items = rest;
    }
    None
}

/// Packet sizes and credit for reports of this many bytes. Packets fill whole reports, and those
/// that credit lets under way all but one of the reports that may be: an acknowledgement has room
/// as well.
pub fn limits(report: u16) -> Limits {
    // Reports per packet, and bytes of the pointer that begins each report; a length of two bytes
    // begins each packet. Credit is then two packets of short reports, or five of long ones.
    let (reports, pointer) = if report <= u16::from(u8::MAX) { (7, 1) } else { (3, 2) };
    let packet_bytes = reports * (report - pointer) - 2;
    let mut limits = Limits::default();
    limits.packet_bytes = packet_bytes;
    limits.credit = (REPORTS_UNDER_WAY - 1) / reports;
    limits.send_bytes = 4096;
    limits.rows_ahead = 1;
    limits.timeout = 500_000;
    limits.idle_steps = 10;
    limits
}

struct HidLink {
    name: String,
    device: HidDevice,
    sender: Sender<Vec<u8>>,
    /// The packet that is being made.
    out: Vec<u8>,
    receiver: Receiver<Vec<u8>>,
    /// The report that was read last, and how much of it has been used.
    report: Vec<u8>,
    used: usize,
    bytes: (u64, u64),
}

fn gone(name: &str, e: hidapi::HidError) -> Error {
    Error::device(format!("the HID device is gone: {e}"))
        .at(name)
        .help("check the rig and its cable, and try again")
}

/// Writes a report behind the number 0, which says that reports have no numbers.
fn write<'a>(
    device: &'a HidDevice,
    name: &'a str,
    sent: &'a mut u64,
) -> impl FnMut(&[u8]) -> Result<()> {
    move |report| {
        *sent += report.len() as u64;
        let mut numbered = Vec::with_capacity(report.len() + 1);
        numbered.push(0);
        numbered.extend_from_slice(report);
        device.write(&numbered).map(drop).map_err(|e| gone(name, e))
    }
}

impl Transport for HidLink {
    fn room(&mut self) -> Result<&mut [u8]> {
        Ok(&mut self.out)
    }

    fn send(&mut self, bytes: usize) -> Result<()> {
        let write = write(&self.device, &self.name, &mut self.bytes.0);
        self.sender.push(&self.out[..bytes], write)
    }

    fn flush(&mut self) -> Result<()> {
        self.sender.flush(write(&self.device, &self.name, &mut self.bytes.0))
    }

    fn receive(&mut self, wait: Duration) -> Result<bool> {
        let until = Instant::now() + wait.min(LONGEST_READ);
        let mut read = false;
        loop {
            let mut rest = &self.report[self.used..];
            let whole = self.receiver.push(&mut rest) == Ok(true);
            self.used = self.report.len() - rest.len();
            if whole {
                return Ok(true);
            }
            let left = until.saturating_duration_since(Instant::now());
            if read && left.is_zero() {
                return Ok(false);
            }
            read = true;
            let n = self
                .device
                .read_timeout(&mut self.report, left.as_millis() as i32) // at most LONGEST_READ
                .map_err(|e| gone(&self.name, e))?;
            if n == 0 {
                return Ok(false);
            }
            self.bytes.1 += n as u64;
            // A report that is cut short is dropped.
            self.used = if n == self.report.len() { 0 } else { self.report.len() };
        }
    }

    fn packet(&mut self) -> &[u8] {
        self.receiver.packet()
    }

    fn limits(&self) -> Limits {
        limits(self.report.len() as u16) // read from a descriptor as a u16
    }

    fn bytes(&self) -> (u64, u64) {
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn report_sizes_come_from_the_descriptor() {
        // Vendor page, usage 1, collection, bytes, count, usage, input, count, usage, output, end.
        let descriptor = |low, high| {
            [
                6, 0, 0xff, 9, 1, 0xa1, 1, 0x15, 0, 0x26, 0xff, 0, 0x75, 8, 0x96, low, high, 9, 1,
                0x81, 2, 0x96, low, high, 9, 1, 0x91, 2, 0xc0,
            ]
        };
        assert_eq!(input_report_bytes(&descriptor(64, 0)), Some(64));
        assert_eq!(input_report_bytes(&descriptor(0, 4)), Some(1024));
        assert_eq!(input_report_bytes(&[0x75, 8, 0x96, 64]), None);
        assert_eq!(input_report_bytes(&[]), None);
    }
}
