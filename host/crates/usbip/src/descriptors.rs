//! What the device says of itself: descriptors of USB 2.0 and of the USB Video Class 1.0.

use crate::protocol::{ADAPTER_BUS_ID, BUS_ID, Submit};
use camrig_gige::{Pattern, Sensor};

/// High speed, in USB/IP's numbers; its bulk packets, bytes.
const HIGH_SPEED: u32 = 3;
const BULK_PACKET: u16 = 512;
/// The last twelve bytes of a format's GUID, after its four-character code.
const GUID_END: [u8; 12] = [0, 0, 0x10, 0, 0x80, 0, 0, 0xAA, 0, 0x38, 0x9B, 0x71];
/// Video class; control and streaming interfaces.
const VIDEO: u8 = 14;
const INTERFACES: [[u8; 3]; 2] = [[VIDEO, 1, 0], [VIDEO, 2, 0]];
/// Class of what follows no standard.
const VENDOR_SPECIFIC: u8 = 0xFF;

/// What a device is known by.
#[derive(Debug)]
pub struct Identity {
    /// Its place on the bus.
    pub bus_id: &'static str,
    /// Its number on the bus.
    number: u32,
    vendor: u16,
    product: u16,
    /// Class, subclass and protocol; those of its interfaces.
    class: [u8; 3],
    interfaces: &'static [[u8; 3]],
}

/// The camera: pid.codes' identifier for tests, and the class of a device whose interfaces belong
/// together.
pub const CAMERA: Identity = Identity {
    bus_id: BUS_ID,
    number: 2,
    vendor: 0x1209,
    product: 0x0001,
    class: [0xEF, 2, 1],
    interfaces: &INTERFACES,
};

/// The adapter: the identifier by which Linux' i2c-tiny-usb knows it.
pub const ADAPTER: Identity = Identity {
    bus_id: ADAPTER_BUS_ID,
    number: 3,
    vendor: 0x0403,
    product: 0xC631,
    class: [0; 3],
    interfaces: &[[VENDOR_SPECIFIC, 0, 0]],
};

/// Numbers of the camera terminal, the processing unit and the output terminal.
pub const CAMERA_TERMINAL: u8 = 1;
pub const PROCESSING_UNIT: u8 = 2;
const OUTPUT_TERMINAL: u8 = 3;
/// The endpoint that images come from, to the host.
pub const STREAM: u32 = 1;
const STREAM_ENDPOINT: u8 = 0x80 | STREAM as u8;

/// A pixel format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PixelFormat {
    /// Its name in V4L2.
    pub name: String,
    fourcc: [u8; 4],
    bits: u8,
}

impl PixelFormat {
    /// Formats of a sensor's pixels that uvcvideo knows; those with all bits of the sensor first.
    pub fn of_sensor(sensor: &Sensor) -> Vec<Self> {
        let format =
            |name: &str, fourcc: &[u8; 4], bits| Self { name: name.into(), fourcc: *fourcc, bits };
        let (order, words, bytes) = match sensor.pattern {
            Pattern::Mono => return vec![format("Y16", b"Y16 ", 16), format("GREY", b"Y800", 8)],
            Pattern::BayerRg => ("RGGB", b"RG16", b"RGGB"),
            Pattern::BayerGr => ("GRBG", b"GR16", b"GRBG"),
            Pattern::BayerGb => ("GBRG", b"GB16", b"GBRG"),
            Pattern::BayerBg => ("BGGR", b"BG16", b"BA81"),
        };
        let mut formats = vec![format(&format!("S{order}16"), words, 16)];
        if order == "RGGB" && sensor.bits == 10 && sensor.width.is_multiple_of(4) {
            formats.push(format("SRGGB10P", b"RW10", 10));
        }
        formats.push(format(&format!("S{order}8"), bytes, 8));
        formats
    }

    /// Bytes of an image.
    pub fn image_bytes(&self, sensor: &Sensor) -> u32 {
        (u64::from(sensor.width) * u64::from(sensor.height) * u64::from(self.bits) / 8) as u32
    }
}

/// Frame intervals, 100 ns: the shortest, the longest, and that at power-on.
#[derive(Clone, Copy, Debug)]
pub struct Intervals {
    pub min: u32,
    pub max: u32,
    pub usual: u32,
}

/// A text descriptor.
fn text(of: &str) -> Vec<u8> {
    let units = of.encode_utf16().take(126).flat_map(u16::to_le_bytes);
    let mut out: Vec<u8> = [0, 3].into_iter().chain(units).collect();
    out[0] = out.len() as u8;
    out
}

impl Identity {
    /// The device descriptor.
    pub fn descriptor(&self) -> Vec<u8> {
        let mut out = vec![18, 1, 0, 2];
        out.extend(self.class);
        out.push(64);
        out.extend(self.vendor.to_le_bytes());
        out.extend(self.product.to_le_bytes());
        out.extend([0, 1, 1, 2, 3, 1]);
        out
    }

    /// The device as USB/IP describes it.
    pub fn usbip(&self) -> Vec<u8> {
        let mut out = vec![0; 256 + 32];
        out[..11].copy_from_slice(b"/sys/camrig");
        out[256..256 + self.bus_id.len()].copy_from_slice(self.bus_id.as_bytes());
        for word in [1, self.number, HIGH_SPEED] {
            out.extend(word.to_be_bytes());
        }
        for word in [self.vendor, self.product, 0x0100] {
            out.extend(word.to_be_bytes());
        }
        out.extend(self.class);
        out.extend([1, 1, self.interfaces.len() as u8]); // configurations
        out
    }

    /// The same with its interfaces, as lists have it.
    pub fn listed(&self) -> Vec<u8> {
        let interfaces = self.interfaces.iter();
        let interfaces =
            interfaces.flat_map(|[class, sub, protocol]| [*class, *sub, *protocol, 0]);
        self.usbip().into_iter().chain(interfaces).collect()
    }

    /// Answers requests that all devices know (USB 2.0, 9.4); `None` refuses one.
    pub fn answer(
        &self,
        submit: &Submit,
        configuration: impl FnOnce() -> Vec<u8>,
        [model, serial]: [&str; 2],
    ) -> Option<Vec<u8>> {
        let [kind, request, value_low, value_high, ..] = submit.setup;
        Some(match (kind, request, value_high, value_low) {
            (0x80, 6, 1, _) => self.descriptor(),
            (0x80, 6, 2, 0) => configuration(),
            (0x80, 6, 3, 0) => vec![4, 3, 9, 4], // English
            (0x80, 6, 3, 1) => text("camrig"),
            (0x80, 6, 3, 2) => text(model),
            (0x80, 6, 3, 3) => text(serial),
            // Status; configuration; alternate setting.
            (0x80..=0x82, 0, ..) => vec![0, 0],
            (0x80, 8, ..) => vec![1],
            (0x81, 10, ..) => vec![0],
            (0x00, 9, ..) | (0x01, 11, ..) | (0x00..=0x02, 1 | 3, ..) => vec![],
            _ => return None,
        })
    }
}

/// The camera's configuration descriptor with all that belongs to it.
pub fn configuration(
    sensor: &Sensor,
    formats: &[PixelFormat],
    intervals: Intervals,
    has_controls: bool,
) -> Vec<u8> {
    // Controls: exposure mode (bit 1) and absolute exposure time (bit 3); gain (bit 9).
    let [exposure, gain] = if has_controls { [0x0A, 0x02] } else { [0, 0] };
    let camera =
        [18, 0x24, 2, CAMERA_TERMINAL, 0x01, 0x02, 0, 0, 0, 0, 0, 0, 0, 0, 3, exposure, 0, 0];
    let processing = [11, 0x24, 5, PROCESSING_UNIT, CAMERA_TERMINAL, 0, 0, 2, 0x00, gain, 0];
    let output = [9, 0x24, 3, OUTPUT_TERMINAL, 0x01, 0x01, 0, PROCESSING_UNIT, 0];
    let units = [&camera[..], &processing, &output].concat();
    // Version 1.0, a clock of 48 MHz that nobody uses, and the one streaming interface.
    let mut control = vec![9, 4, 0, 0, 0, VIDEO, 1, 0, 0, 13, 0x24, 1, 0x00, 0x01];
    control.extend((13 + units.len() as u16).to_le_bytes());
    control.extend([0x00, 0x6C, 0xDC, 0x02, 1, 1]);
    control.extend(units);

    let mut described = Vec::new();
    for (index, format) in formats.iter().enumerate() {
        described.extend([27, 0x24, 4, index as u8 + 1, 1]);
        described.extend(format.fourcc);
        described.extend(GUID_END);
        described.extend([format.bits, 1, 0, 0, 0, 0]);
        let bytes = format.image_bytes(sensor);
        let rate = |interval: u32| {
            let bits_per_s = u64::from(bytes) * 8 * 10_000_000 / u64::from(interval.max(1));
            bits_per_s.min(u32::MAX.into()) as u32
        };
        described.extend([38, 0x24, 5, 1, 0]);
        described.extend((sensor.width as u16).to_le_bytes());
        described.extend((sensor.height as u16).to_le_bytes());
        let words = [rate(intervals.max), rate(intervals.min), bytes, intervals.usual];
        described.extend(words.into_iter().flat_map(u32::to_le_bytes));
        described.push(0); // any interval from the shortest to the longest
        described.extend([intervals.min, intervals.max, 1].into_iter().flat_map(u32::to_le_bytes));
    }
    let mut streaming = vec![9, 4, 1, 0, 1, VIDEO, 2, 0, 0];
    let length = 13 + formats.len();
    streaming.extend([length as u8, 0x24, 1, formats.len() as u8]);
    streaming.extend(((length + described.len()) as u16).to_le_bytes());
    streaming.extend([STREAM_ENDPOINT, 0, OUTPUT_TERMINAL, 0, 0, 0, 1]);
    streaming.resize(streaming.len() + formats.len(), 0);
    streaming.extend(described);
    streaming.extend([7, 5, STREAM_ENDPOINT, 2]);
    streaming.extend(BULK_PACKET.to_le_bytes());
    streaming.push(0);

    let association = [8, 11, 0, 2, VIDEO, 3, 0, 0];
    let length = 9 + association.len() + control.len() + streaming.len();
    let mut out = vec![9, 2];
    out.extend((length as u16).to_le_bytes());
    out.extend([2, 1, 0, 0x80, 50]);
    out.extend(association);
    out.extend(control);
    out.extend(streaming);
    out
}

/// The adapter's configuration descriptor: control transfers alone.
pub fn adapter_configuration() -> Vec<u8> {
    vec![9, 2, 18, 0, 1, 1, 0, 0x80, 50, 9, 4, 0, 0, 0, VENDOR_SPECIFIC, 0, 0, 0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_gige::Timing;

    fn sensor(pattern: Pattern, bits: u32) -> Sensor {
        Sensor {
            model: "m".into(),
            serial: "1".into(),
            width: 64,
            height: 48,
            pattern,
            bits,
            line_ns: 10_000,
            min_frame_lines: 48,
            timing: Timing { exposure_lines: 1, frame_lines: 100, gain_code: 256 },
        }
    }

    /// Every descriptor begins with its length, and they fill the configuration.
    #[test]
    fn lengths_of_descriptors_add_up() {
        let sensor = sensor(Pattern::BayerRg, 10);
        let formats = PixelFormat::of_sensor(&sensor);
        let all = configuration(&sensor, &formats, Intervals { min: 1, max: 9, usual: 5 }, true);
        assert_eq!(usize::from(u16::from_le_bytes([all[2], all[3]])), all.len());
        let (mut at, mut kinds) = (0, Vec::new());
        while at < all.len() {
            kinds.push(all[at + 1]);
            at += usize::from(all[at]);
        }
        assert_eq!(at, all.len());
        let class = 0x24;
        let expected = [
            &[2, 11, 4][..],
            &[class; 4],
            &[4],
            &[class; 7], // header, three formats with a frame each
            &[5],
        ]
        .concat();
        assert_eq!(kinds, expected);
        for identity in [CAMERA, ADAPTER] {
            assert_eq!(identity.descriptor().len(), 18);
            assert_eq!(identity.usbip().len(), 0x138, "usbip_usb_device of Linux");
        }
    }

    #[test]
    fn formats_are_those_that_uvcvideo_knows() {
        let names = |pattern, bits| {
            let formats = PixelFormat::of_sensor(&sensor(pattern, bits));
            formats.into_iter().map(|f| (f.name, f.fourcc)).collect::<Vec<_>>()
        };
        assert_eq!(
            names(Pattern::BayerRg, 10),
            [
                ("SRGGB16".to_string(), *b"RG16"),
                ("SRGGB10P".to_string(), *b"RW10"),
                ("SRGGB8".to_string(), *b"RGGB"),
            ]
        );
        assert_eq!(names(Pattern::BayerBg, 10).len(), 2);
        assert_eq!(names(Pattern::Mono, 12)[0], ("Y16".to_string(), *b"Y16 "));
    }
}
