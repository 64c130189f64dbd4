//! The embedded data line of a sensor with several captures: what a receiver has to know of a
//! frame to undo merge and curve.

use camrig_camera::hdr::{Hdr, HdrOutput};
use camrig_formats::csi2;
use camrig_sensor_core::config::FrameSettings;

/// Registers of MIPI CCS, and of its range for manufacturers: numbers of several bytes have the
/// most significant first; times and gains are IEEE 754 floats of 32 bits.
mod address {
    /// Frame counter, 8 bits.
    pub const FRAME_COUNT: u16 = 0x0005;
    /// Exposure of the frame, s; float.
    pub const EXPOSURE_S: u16 = 0x3200;
    /// Analog gain of the frame; float.
    pub const ANALOG_GAIN: u16 = 0x3204;
    /// Frame number, 32 bits.
    pub const FRAME: u16 = 0x3208;
    /// What is sent (0 companded, 1 linear, 2 captures), number of captures, bits of the linear
    /// signal; 8 bits each.
    pub const OUTPUT: u16 = 0x3210;
    /// Pedestal of the linear signal, 32 bits.
    pub const PEDESTAL: u16 = 0x3214;
    /// CRC-16 (that of packets) of the lowest linear number of each code in turn, 32 bits each:
    /// which curve it is. 0 without a curve.
    pub const CURVE: u16 = 0x3218;
    /// First register of the first capture; those of the next follow [`PER_CAPTURE`] further.
    pub const CAPTURE: u16 = 0x3220;
    /// Registers of a capture: exposure, s (float); analog gain (float); linear numbers per code
    /// in 1/256 (32 bits); black level (16 bits); virtual channel (8 bits); bits (8 bits).
    pub const PER_CAPTURE: u16 = 16;
}

/// The line of a frame with these settings, for image lines of `bits` bits.
pub fn embedded_line(hdr: &Hdr, settings: &FrameSettings, bits: u32) -> Vec<u8> {
    let mut registers = Vec::new();
    let mut put = |address: u16, bytes: &[u8]| {
        registers.extend((address..).zip(bytes.iter().copied()));
    };
    put(address::FRAME_COUNT, &[settings.frame as u8]);
    put(address::EXPOSURE_S, &settings.exposure_s.to_be_bytes());
    put(address::ANALOG_GAIN, &settings.analog_gain.to_be_bytes());
    put(address::FRAME, &settings.frame.to_be_bytes());
    let output = match hdr.output {
        HdrOutput::Companded => 0,
        HdrOutput::Linear => 1,
        _ => 2,
    };
    put(address::OUTPUT, &[output, hdr.captures.len() as u8, hdr.linear_bits() as u8]);
    put(address::PEDESTAL, &hdr.merge.pedestal_dn().to_be_bytes());
    put(address::CURVE, &curve(hdr).to_be_bytes());
    for (place, capture) in (0..).zip(&hdr.captures) {
        let own = hdr.settings(capture, settings);
        let bytes = [
            &own.exposure_s.to_be_bytes()[..],
            &own.analog_gain.to_be_bytes(),
            &((capture.gain * 256.0).round() as u32).to_be_bytes(),
            &capture.black_level_dn.to_be_bytes(),
            &[capture.virtual_channel, capture.bits],
        ];
        put(address::CAPTURE + place * address::PER_CAPTURE, &bytes.concat());
    }
    csi2::ccs_line(&registers, bits)
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
