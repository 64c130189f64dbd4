//! Register maps of sensors from arbitrary text, and a sensor against arbitrary transactions.

use camrig_profiles::{Profile, Sensor};
use embedded_hal::i2c::I2c;

/// The text of a profile, or one of the known ones, before a form feed; behind it transactions in
/// chunks of [length and whether it reads, bytes...].
pub fn drive(data: &[u8]) {
    let (text, mut rest) = match data.iter().position(|byte| *byte == b'\x0c') {
        Some(at) => (&data[..at], &data[at + 1..]),
        None => (data, &data[..0]),
    };
    let text = String::from_utf8_lossy(text);
    let Ok(profile) = Profile::builtin(&text).or_else(|_| Profile::parse(&text)) else { return };
    let address = profile.i2c[0];
    let mut sensor = Sensor::new(profile);
    while let [kind, left @ ..] = rest {
        let (body, left) = left.split_at(usize::from(kind & 0x3f).min(left.len()));
        rest = left;
        let mut read = [0; 8];
        let _ = match kind & 0x80 {
            0 => sensor.write(address, body),
            _ => sensor.write_read(address, body, &mut read),
        };
        if let Some(frame) = sensor.next_frame() {
            assert!(frame.exposure_s >= 0.0 && frame.frame_s.is_finite(), "{frame:?}");
            assert!(frame.analog_gain > 0.0 && frame.digital_gain > 0.0, "{frame:?}");
        }
    }
}
