//! The embedded data line of a sensor with several captures: what a receiver has to know of a
//! frame to undo merge and curve.

use camrig_camera::hdr::{Hdr, HdrOutput};
use camrig_formats::csi2::{self, Embedded, address};
use camrig_sensor_core::config::FrameSettings;

/// The line of a frame with these settings, for image lines of `bits` bits.
pub fn embedded_line(hdr: &Hdr, settings: &FrameSettings, bits: u32) -> Vec<u8> {
    let FrameSettings { exposure_s, analog_gain, frame, .. } = *settings;
    let mut line = Embedded::of_frame(exposure_s, analog_gain, frame);
    line.put(address::FRAME_COUNT, &[frame as u8]); // CCS counts in 8 bits
    let output = match hdr.output {
        HdrOutput::Companded => 0,
        HdrOutput::Linear => 1,
        _ => 2,
    };
    line.put(address::OUTPUT, &[output, hdr.captures.len() as u8, hdr.linear_bits() as u8]);
    line.put(address::PEDESTAL, &hdr.merge.pedestal_dn().to_be_bytes());
    line.put(address::CURVE, &curve(hdr).to_be_bytes());
    for (place, capture) in (0..).zip(&hdr.captures) {
        let own = hdr.settings(capture, settings);
        let bytes = [
            &own.exposure_s.to_be_bytes()[..],
            &own.analog_gain.to_be_bytes(),
            &((capture.gain * 256.0).round() as u32).to_be_bytes(),
            &capture.black_level_dn.to_be_bytes(),
            &[capture.virtual_channel, capture.bits],
        ];
        line.put(address::CAPTURE + place * address::PER_CAPTURE, &bytes.concat());
    }
    line.line(bits)
}

/// Which curve the codes are on.
fn curve(hdr: &Hdr) -> u16 {
    let Some(companding) = &hdr.companding else { return 0 };
    let codes = 0..=((1u32 << companding.bits) - 1) as u16;
    let lowest = codes.flat_map(|code| (companding.lowest(code) as u32).to_be_bytes());
    csi2::checksum(&lowest.collect::<Vec<u8>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use camrig_camera::Camera;

    /// The bytes of a register in a line of tagged values without fillers.
    fn register(line: &[u8], at: u16, count: usize) -> Vec<u8> {
        let (mut address, mut found) = (0u16, Vec::new());
        for pair in line[1..].chunks_exact(2) {
            match pair[0] {
                0xAA => address = u16::from(pair[1]) << 8 | address & 0xFF,
                0xA5 => address = address & 0xFF00 | u16::from(pair[1]),
                0x5A => {
                    if (at..at + count as u16).contains(&address) {
                        found.push(pair[1]);
                    }
                    address += 1;
                }
                _ => break,
            }
        }
        found
    }

    #[test]
    fn a_line_says_what_a_receiver_needs() {
        let camera = Camera::load("ox03c10").unwrap();
        let hdr = camera.sensor.hdr.as_ref().unwrap();
        let settings = FrameSettings::new(0.016).with_gain(2.0).with_frame(300);
        // 14 bits have no fillers.
        let line = embedded_line(hdr, &settings, 14);
        let float = |at| {
            let bytes = register(&line, at, 4);
            f32::from_be_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
        };
        assert_eq!((float(address::EXPOSURE_S), float(address::ANALOG_GAIN)), (0.016, 2.0));
        assert_eq!(register(&line, address::FRAME, 4), [0, 0, 1, 44]);
        assert_eq!(register(&line, address::OUTPUT, 3), [0, 4, 24]);
        let last = address::CAPTURE + 3 * address::PER_CAPTURE;
        assert_eq!(float(last), 0.016 / 512.0);
        let gain = ((hdr.captures[3].gain * 256.0) as u32).to_be_bytes();
        assert_eq!(register(&line, last + 8, 4), gain);
        let other = Camera::load("imx585-clear-hdr").unwrap();
        let curve = |line: &[u8]| register(line, address::CURVE, 2);
        let other = embedded_line(other.sensor.hdr.as_ref().unwrap(), &settings, 14);
        assert_ne!(curve(&line), curve(&other));
    }
}
