//! Embedded data lines: the registers from which a receiver learns the settings of a frame.

/// Addresses of the registers in embedded lines: those of MIPI CCS, and from 0x3200 on those of
/// its range for manufacturers. Numbers of several bytes have the most significant first; times
/// and gains are IEEE 754 floats of 32 bits.
pub mod address {
    /// Frame counter, 8 bits.
    pub const FRAME_COUNT: u16 = 0x0005;
    /// Exposure of the frame, s; float.
    pub const EXPOSURE_S: u16 = 0x3200;
    /// Analog gain of the frame; float.
    pub const ANALOG_GAIN: u16 = 0x3204;
    /// Frame number, 32 bits.
    pub const FRAME: u16 = 0x3208;
    /// Seed of the camera, 64 bits.
    pub const SEED: u16 = 0x320c;
    /// Of a sensor with several captures: what is sent (0 companded, 1 linear, 2 captures), number
    /// of captures, bits of the linear signal; 8 bits each.
    pub const OUTPUT: u16 = 0x3214;
    /// Pedestal of the linear signal, 32 bits.
    pub const PEDESTAL: u16 = 0x3218;
    /// CRC-16 (that of packets) of the lowest linear number of each code in turn, 32 bits each:
    /// which curve it is. 0 without a curve.
    pub const CURVE: u16 = 0x321c;
    /// First register of the first capture; those of the next follow [`PER_CAPTURE`] further.
    pub const CAPTURE: u16 = 0x3220;
    /// Registers of a capture: exposure, s (float); analog gain (float); linear numbers per code
    /// in 1/256 (32 bits); black level (16 bits); virtual channel (8 bits); bits (8 bits).
    pub const PER_CAPTURE: u16 = 16;
}

/// The registers of an embedded data line.
///
/// ```
/// use camrig_formats::csi2::{Embedded, address};
///
/// let mut line = Embedded::default();
/// line.put(address::FRAME_COUNT, &[7]);
/// assert_eq!(line.line(14)[..6], [0x0A, 0xAA, 0x00, 0xA5, 0x05, 0x5A]);
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Embedded {
    registers: Vec<(u16, u8)>,
}

impl Embedded {
    /// The settings of a frame: exposure in s, analog gain, number.
    pub fn of_frame(exposure_s: f32, analog_gain: f32, frame: u32) -> Self {
        let mut line = Self::default();
        line.put(address::EXPOSURE_S, &exposure_s.to_be_bytes());
        line.put(address::ANALOG_GAIN, &analog_gain.to_be_bytes());
        line.put(address::FRAME, &frame.to_be_bytes());
        line
    }

    /// Adds the registers from an address on, one for each byte.
    pub fn put(&mut self, address: u16, bytes: &[u8]) {
        self.registers.extend((address..).zip(bytes.iter().copied()));
    }

    /// The line in the tagged format of MIPI CCS (chapter "Embedded data"; SMIA's simplified 2-byte
    /// tags), by rising addresses, for images with `bits` bits per sample. Filler bytes 0x55 stand
    /// where the image's lines have bits below the upper eight of a sample (V4L2's
    /// `metafmt-generic`): behind every 4th byte for 10 bits, every 2nd for 12, one behind each for
    /// 16, one and two in turn for 20, two for 24. With 14 bits bytes follow each other.
    pub fn line(mut self, bits: u32) -> Vec<u8> {
        self.registers.sort_unstable();
        const FORMAT: u8 = 0x0A;
        const ADDRESS_HIGH: u8 = 0xAA;
        const ADDRESS_LOW: u8 = 0xA5;
        const VALUE: u8 = 0x5A;
        const END: u8 = 0x07;
        const FILLER: u8 = 0x55;
        let mut plain = vec![FORMAT];
        let mut next = None;
        for (address, value) in self.registers {
            if next != Some(address) {
                let [high, low] = address.to_be_bytes();
                plain.extend([ADDRESS_HIGH, high, ADDRESS_LOW, low]);
            }
            plain.extend([VALUE, value]);
            next = address.checked_add(1);
        }
        plain.push(END);
        // Bytes of data, and fillers behind them, in turn.
        let groups: &[(usize, usize)] = match bits {
            10 => &[(4, 1)],
            12 => &[(2, 1)],
            16 => &[(1, 1)],
            20 => &[(1, 1), (1, 2)],
            24 => &[(1, 2)],
            _ => return plain,
        };
        plain.resize(plain.len().next_multiple_of(groups.iter().map(|(data, _)| data).sum()), END);
        let mut line = Vec::new();
        let mut rest = &plain[..];
        for &(data, fillers) in groups.iter().cycle() {
            let Some((first, behind)) = rest.split_at_checked(data).filter(|_| !rest.is_empty())
            else {
                break;
            };
            line.extend_from_slice(first);
            line.resize(line.len() + fillers, FILLER);
            rest = behind;
        }
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(registers: &[(u16, u8)], bits: u32) -> Vec<u8> {
        Embedded { registers: registers.to_vec() }.line(bits)
    }

    /// Tags as libcamera's SMIA parser reads them, with a filler after every 4 bytes.
    #[test]
    fn ccs_lines_have_tags_and_fillers() {
        assert_eq!(
            of(&[(0x0202, 1), (0x0203, 2)], 10),
            [
                0x0A, 0xAA, 0x02, 0xA5, 0x55, 0x02, 0x5A, 0x01, 0x5A, 0x55, 0x02, 0x07, 0x07,
                0x07, 0x55
            ]
        );
    }

    /// The layouts of V4L2's `metafmt-generic`, of the bytes 0A AA 00 A5 05 5A 07 07.
    #[test]
    fn fillers_stand_for_low_bits() {
        let line = |bits| of(&[(0x0005, 7)], bits);
        let plain = [0x0A, 0xAA, 0x00, 0xA5, 0x05, 0x5A, 0x07, 0x07];
        assert_eq!(line(8), plain);
        let every = |step: usize| line(4 * step as u32 + 8).chunks(2).next().map(<[u8]>::to_vec);
        assert_eq!(every(2), Some(vec![0x0A, 0x55]));
        assert_eq!(line(20)[..10], [0x0A, 0x55, 0xAA, 0x55, 0x55, 0x00, 0x55, 0xA5, 0x55, 0x55]);
        assert_eq!(line(24)[..6], [0x0A, 0x55, 0x55, 0xAA, 0x55, 0x55]);
    }
}
